#include "selection/earlier_result.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>

#include "base/decompositions.hpp"
#include "base/degree.hpp"
#include "base/distributions.hpp"
#include "base/preconditions.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/prediction.hpp"
#include "estimation/registration.hpp"
#include "model/parameters.hpp"
#include "selection/group_sizes.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kEvidence = 3.0;  // log evidence that a change must add, as the best of many adds some by chance

NoiseModel scaled(NoiseModel noise, double factor) {
  noise.common *= factor;
  noise.misfit *= factor;
  noise.target_misfit *= factor;
  if (noise.tracker) {
    noise.tracker->range *= factor;
    noise.tracker->range_per_metre *= factor;
    noise.tracker->transverse *= factor;
    noise.tracker->transverse_per_metre *= factor;
  }
  if (!noise.is_absolute()) {
    noise.independent.setOnes();
  }
  noise.independent *= factor;
  return noise;
}

Unknowns with_frames(const ErrorModel& model, const std::vector<TargetFrame>& targets, std::vector<std::string> names) {
  const std::vector<std::string> frames = frame_parameter_names(targets, base_parameter_names(model));
  names.insert(names.end(), frames.begin(), frames.end());
  return {model, targets, names};
}

// The earlier arm, with base and targets registered to the measurements.
Estimate registered(const ErrorModel& model, const Unknowns& own, const VectorXd& mean, const Measurements& training) {
  Estimate arm = own.moved({.errors = VectorXd::Zero(static_cast<Index>(model.parameters.size()))}, mean);
  Registration registration = register_base_and_targets(flange_poses(model, arm, training), training);
  arm.frames = std::move(registration.frames);
  return arm;
}

// The measurements, linearised: whitened rows y = F f + G (x - mean) with the columns G of the earlier result, and F of
// base and targets.
struct EarlierRows {
  MatrixXd F;
  MatrixXd G;
  VectorXd y;
};

// With x - mean = L u + d, where L L^T is the earlier covariance and d are the changes, u is standard normal and each
// change has its own size.
class ChangeSizes {
public:
  ChangeSizes(const EarlierRows& rows, const MatrixXd& L, Index changeable)
      : frames_(rows.F.cols()), earlier_(L.cols()), changeable_(changeable) {
    MatrixXd J(rows.y.size(), frames_ + earlier_ + changeable);
    J << rows.F, rows.G * L, rows.G.leftCols(changeable);
    sums_ = {.information = J.transpose() * J,
             .moment = J.transpose() * rows.y,
             .squares = rows.y.squaredNorm(),
             .equations = static_cast<double>(rows.y.size())};
  }

  // Adds changes one by one, each time that with the most evidence. Empty if the measurements do not determine base and
  // targets.
  GroupSizes estimate() {
    GroupSizes best = with_changes(changed_);
    while (best.values.size() > 0) {
      GroupSizes next = best;
      Index chosen = -1;
      for (Index change = 0; change < changeable_; ++change) {
        if (std::find(changed_.begin(), changed_.end(), change) == changed_.end()) {
          std::vector<Index> more = changed_;
          more.push_back(change);
          GroupSizes sizes = with_changes(more);
          if (sizes.evidence > next.evidence) {
            next = std::move(sizes);
            chosen = change;
          }
        }
      }
      if (chosen < 0 || next.evidence < best.evidence + kEvidence) {
        return best;
      }
      changed_.push_back(chosen);
      best = std::move(next);
    }
    return best;
  }

  const std::vector<Index>& changed() const { return changed_; }

private:
  GroupSizes with_changes(const std::vector<Index>& changes) const {
    std::vector<Index> columns(static_cast<std::size_t>(frames_ + earlier_));
    std::iota(columns.begin(), columns.end(), Index{0});
    SizedGroups groups{{columns.begin() + frames_, columns.end()}};
    for (const Index change : changes) {
      columns.push_back(frames_ + earlier_ + change);
      groups.push_back({columns.back()});
    }
    SizeLimits limits{.held = std::vector<double>(groups.size(), 0.0), .most = {}, .inflated = {}};
    limits.held.front() = 1.0;
    constexpr double kRounding = 1e-9;  // of the noise
    const SizeEstimator estimator(sums_, columns, groups);
    return estimator.is_determined() ? estimator.estimate({}, limits, kRounding) : GroupSizes();
  }

  Index frames_;
  Index earlier_;
  Index changeable_;
  LinearSums sums_;
  std::vector<Index> changed_;
};

// After elimination of base and targets, with the whitened rows z = H u + noise of unknown size s, H^T H = V diag(l)
// V^T and w = V^T H^T z: Delta^T (C1 + C2)^-1 Delta = sum w^2 / (l (s^2 + l)) over the directions that the measurements
// determine. s is that of the measurements alone. It may differ from the earlier noise (s = 1), which counts as some
// more degrees of freedom only.
EarlierComparison compared(const EarlierRows& rows, const MatrixXd& L) {
  constexpr double kTold = 1e-8;
  constexpr double kFreedomOfEarlier = 10.0;
  MatrixXd left(rows.y.size(), L.cols() + 1);
  left << rows.G * L, rows.y;
  left = outside_span(rows.F, left);
  const MatrixXd H = left.leftCols(L.cols());
  const VectorXd z = left.rightCols<1>();
  const auto [values, vectors] = spectrum(H.transpose() * H);
  const Index rank = (values.array() > kTold).count();
  const Eigen::ArrayXd l = values.tail(rank);
  const Eigen::ArrayXd w2 = (vectors.rightCols(rank).transpose() * (H.transpose() * z)).cwiseAbs2();
  const double freedom = kFreedomOfEarlier + static_cast<double>(std::max(z.size() - rank, Index{0}));
  const double s2 = (kFreedomOfEarlier + std::max(z.squaredNorm() - (w2 / l).sum(), 0.0)) / freedom;
  const auto k = static_cast<double>(rank);
  const double chi_square = (w2 / (l * (s2 + l))).sum();
  return {.chi_square = chi_square,
          .degrees_of_freedom = k,
          .p_value = rank > 0 ? f_upper_tail(chi_square / k, k, freedom) : 1.0,
          .changes = {}};
}

ContinuedResult assembled(const EarlierResult& earlier, const VectorXd& variances, const NoiseModel& noise) {
  GaussianPrior prior = earlier.prior;
  prior.covariance.diagonal().head(variances.size()) += variances;
  ContinuedResult result{.prior = std::make_shared<GaussianPrior>(prior), .rigid = {}, .noise = noise};
  result.rigid = result.prior;
  if (!earlier.terms.empty()) {
    const Index count = earlier.rigid.size();
    prior.names.resize(static_cast<std::size_t>(count));
    result.rigid = std::make_shared<GaussianPrior>(GaussianPrior{
        .names = prior.names, .mean = earlier.rigid, .covariance = prior.covariance.topLeftCorner(count, count)});
  }
  return result;
}

// Zeros of the first and the last joint, if they were no parameters before.
std::vector<std::string> unseen_zeros(const ErrorModel& model, const std::vector<std::string>& names) {
  std::vector<std::string> result;
  for (const ErrorParameter& parameter : model.parameters) {
    const bool at_an_end = parameter.joint == model.joints.front().name || parameter.joint == model.joints.back().name;
    if (parameter.kind == ParameterKind::joint_offset && at_an_end &&
        std::find(names.begin(), names.end(), parameter.name) == names.end()) {
      result.push_back(parameter.joint);
    }
  }
  return result;
}

}  // namespace

std::vector<std::string> in_words(const ErrorModel& model, const EarlierComparison& comparison) {
  std::vector<std::string> result;
  for (const auto& [name, change] : comparison.changes) {
    const bool length = is_length(model, model.parameters[parameter_index(model, name)]);
    result.push_back(name + (length ? fmt::format(" by {:.4f} mm", change * 1e3)
                                    : fmt::format(" by {:.5f} degrees", change / kDegree)));
  }
  return result;
}

ContinuedResult continue_result(const ErrorModel& rigid, const Measurements& training, const EarlierResult& earlier,
                                const ResidualOptions& options) {
  constexpr int kRounds = 3;  // of linearisation, each at the estimate of the one before
  ErrorModel model = rigid;
  model.effects = earlier.terms;
  const Unknowns own(model, {}, earlier.prior.names);
  const auto changeable = static_cast<Index>(own.geometric().size());
  const Eigen::LLT<MatrixXd> root(earlier.prior.covariance);
  if (root.info() != Eigen::Success) {
    refuse_input("the covariance of the earlier result", "a positive definite one");
  }
  const MatrixXd L = root.matrixL();
  Estimate at = registered(model, own, earlier.prior.mean, training);
  const Unknowns free = with_frames(model, at.frames.targets, earlier.prior.names);
  const LeastSquaresProblem problem(model, training, free, options);
  const Index first = free.range(UnknownGroup::geometric).first;
  const Index targets = free.range(UnknownGroup::targets).count;
  EarlierRows rows;
  ContinuedResult result;
  for (int round = 0; round < kRounds; ++round) {
    const WhitenedSystem system = problem.whitened(at);
    const auto J = system.jacobian.topRows(system.blocks.back());
    rows.F.resize(J.rows(), first + targets);
    rows.F << J.leftCols(first), J.rightCols(targets);
    rows.G = J.middleCols(first, L.cols());
    rows.y = system.residual.head(J.rows()) + rows.G * (own.values(at) - earlier.prior.mean);
    ChangeSizes changes(rows, L, changeable);
    const GroupSizes sizes = changes.estimate();
    if (sizes.values.size() == 0) {
      return assembled(earlier, VectorXd::Zero(changeable), options.noise);
    }
    VectorXd variances = VectorXd::Zero(changeable);
    VectorXd x = earlier.prior.mean + L * sizes.values.segment(rows.F.cols(), L.cols());
    std::vector<std::pair<std::string, double>> found;
    for (std::size_t i = 0; i < changes.changed().size(); ++i) {
      const Index place = changes.changed()[i];
      const double change = sizes.values[rows.F.cols() + L.cols() + place];
      variances[place] = sizes.sizes[i + 1] * sizes.sizes[i + 1];
      x[place] += change;
      found.emplace_back(earlier.prior.names[static_cast<std::size_t>(place)], change);
    }
    VectorXd step(free.size());
    step << sizes.values.head(first), x - own.values(at), sizes.values.segment(first, targets);
    at = free.moved(at, step);
    result = assembled(earlier, variances, scaled(options.noise, sizes.sigma));
    result.comparison = compared(rows, L);
    result.comparison.changes = found;
    result.comparison.changeable = static_cast<std::size_t>(changeable);
    result.comparison.noise_ratio = sizes.sigma;
  }
  result.comparison.unseen_zeros = unseen_zeros(model, earlier.prior.names);
  return result;
}

}  // namespace kdl_calibration
