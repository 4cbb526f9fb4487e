#include "selection/ripple_search.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <optional>

#include "base/dense.hpp"
#include "base/distributions.hpp"
#include "base/parallel.hpp"
#include "effects/effect_terms.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Matrix2d;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLowest = 2.0;  // per turn; the harmonics cover 1 and 2
constexpr double kHighest = 400.0;
constexpr double kLevel = 0.001;
constexpr double kMostFrequencies = 20'000.0;  // enough for a joint range of 25 turns
constexpr int kMostFound = 12;

// Frequencies of one joint.
struct Grid {
  std::size_t joint = 0;
  double step = 0.0;
  double highest = kHighest;
  Index count = 0;

  double times(Index i) const { return kLowest + step * static_cast<double>(i + 1); }
};

// Spacing of a lattice on which all values lie, up to rounding; 0 if there is none. It is refined with each value, in
// ascending order.
double lattice(std::vector<double> values) {
  constexpr double kRounding = 2e-4;  // [rad]
  std::sort(values.begin(), values.end());
  double least = 0.0;
  for (std::size_t i = 1; i < values.size(); ++i) {
    const double gap = values[i] - values[i - 1];
    if (gap > kRounding && (least == 0.0 || gap < least)) {
      least = gap;
    }
  }
  constexpr int kMostParts = 6;
  for (int part = 1; part <= kMostParts && least > 0.0; ++part) {
    double spacing = least / part;
    if (spacing < std::numbers::pi / kHighest) {
      return 0.0;  // no lattice
    }
    const bool fits = std::all_of(values.begin(), values.end(), [&](double value) {
      const double distance = value - values.front();
      const double steps = std::round(distance / spacing);
      if (std::abs(distance - steps * spacing) > kRounding) {
        return false;
      }
      spacing = steps > 0.0 ? distance / steps : spacing;
      return true;
    });
    if (fits) {
      return spacing;
    }
  }
  return 0.0;
}

std::vector<Grid> grids(const ErrorModel& model, const MatrixXd& q) {
  constexpr double kLeastRange = std::numbers::pi / 18.0;
  std::vector<Grid> result;
  for (std::size_t joint = 0; joint < model.joints.size(); ++joint) {
    const auto row = q.row(static_cast<Index>(joint));
    const double range = row.maxCoeff() - row.minCoeff();
    if (model.joints[joint].type == JointType::prismatic || range < kLeastRange) {
      continue;
    }
    const double spacing = lattice({row.begin(), row.end()});
    const double highest = spacing > 0.0 ? std::min(kHighest, std::numbers::pi / spacing) : kHighest;
    const double step = std::numbers::pi / range;
    const double count = std::floor((highest - kLowest) / step);
    if (count >= 1.0 && count <= kMostFrequencies) {
      result.push_back({.joint = joint, .step = step, .highest = highest, .count = static_cast<Index>(count)});
    }
  }
  return result;
}

// Hotelling's T^2 for zero mean of the two columns of `sample`, one observation per row.
double hotelling(const Eigen::MatrixX2d& sample) {
  const auto n = static_cast<double>(sample.rows());
  const Eigen::RowVector2d mean = sample.colwise().mean();
  const Eigen::MatrixX2d centred = sample.rowwise() - mean;
  const Matrix2d covariance = centred.transpose() * centred / (n - 1.0);
  const Eigen::Vector2d centre = mean.transpose();
  return n * centre.dot(covariance.ldlt().solve(centre));
}

double p_of(double t_squared, Index observations) {
  const auto n = static_cast<double>(observations);
  return f_upper_tail((n - 2.0) / (2.0 * (n - 1.0)) * t_squared, 2.0, n - 2.0);
}

struct Swing {
  std::size_t joint = 0;
  double times = 0.0;
  double t_squared = 0.0;
};

// Sine and cosine at every configuration: configurations x 2.
Eigen::MatrixX2d functions(const MatrixXd& q, const Swing& swing) {
  const Eigen::ArrayXd phase = swing.times * q.row(static_cast<Index>(swing.joint)).transpose().array();
  Eigen::MatrixX2d result(phase.size(), 2);
  result << phase.sin(), phase.cos();
  return result;
}

class Search {
public:
  explicit Search(RippleData data)
      : data_(std::move(data)),
        root_(data_.information),
        rest_(data_.rows.residual(data_.rows.y, data_.values)),
        grids_(factorise(root_) ? grids(data_.model, data_.joint_values) : std::vector<Grid>()) {}

  bool is_possible() const { return !grids_.empty(); }

  /// The most significant frequency; empty if not significant.
  std::optional<Swing> next(int threads) {
    const Index n = data_.joint_values.cols();
    std::vector<Swing> best(grids_.size());
    Index tried = 0;
    parallel_for(grids_.size(), threads, [&](std::size_t g) { best[g] = best_of(grids_[g]); });
    for (const Grid& grid : grids_) {
      tried += grid.count;
    }
    const auto found = std::max_element(best.begin(), best.end(),
                                        [](const Swing& a, const Swing& b) { return a.t_squared < b.t_squared; });
    *found = refined(*found, grids_[static_cast<std::size_t>(found - best.begin())]);
    const MatrixXd columns = columns_of(*found);
    const MatrixXd own = projected(columns);
    if (p_of(hotelling(sums(own)), n) * static_cast<double>(tried) > kLevel) {
      return std::nullopt;
    }
    const Matrix2d information = columns.transpose() * own;
    const Eigen::Vector2d moment = columns.transpose() * rest_;
    rest_ -= own * information.ldlt().solve(moment);
    return *found;
  }

private:
  // Per configuration: (derivatives by the joint's motion) · `column`.
  VectorXd moments(std::size_t joint, const Eigen::Ref<const VectorXd>& column) const {
    VectorXd result(data_.joint_values.cols());
    for (Index c = 0; c < result.size(); ++c) {
      const auto [first, count] = range(c);
      result[c] =
          data_.joints.motions.col(static_cast<Index>(joint)).segment(first, count).dot(column.segment(first, count));
    }
    return result;
  }

  // Sines and cosines of the next frequency follow from the last by a rotation.
  Swing best_of(const Grid& grid) const {
    const VectorXd moment = moments(grid.joint, rest_);
    const Eigen::MatrixX2d step = functions(data_.joint_values, {.joint = grid.joint, .times = grid.step});
    Eigen::MatrixX2d basis = functions(data_.joint_values, {.joint = grid.joint, .times = kLowest});
    Swing best{.joint = grid.joint};
    for (Index i = 0; i < grid.count; ++i) {
      const VectorXd cosine = basis.col(1).cwiseProduct(step.col(1)) - basis.col(0).cwiseProduct(step.col(0));
      basis.col(0) = basis.col(0).cwiseProduct(step.col(1)) + basis.col(1).cwiseProduct(step.col(0));
      basis.col(1) = cosine;
      const double t_squared = hotelling(moment.asDiagonal() * basis);
      if (t_squared > best.t_squared) {
        best.times = grid.times(i);
        best.t_squared = t_squared;
      }
    }
    return best;
  }

  // The frequency between its grid neighbours that reduces the squares most, to two decimals as in its name.
  Swing refined(const Swing& found, const Grid& grid) const {
    const VectorXd moment = moments(found.joint, rest_);
    const VectorXd weight = moments(found.joint, data_.joints.motions.col(static_cast<Index>(found.joint)));
    constexpr int kParts = 20;
    Swing best = found;
    double most = 0.0;
    for (int part = -kParts; part <= kParts; ++part) {
      Swing swing{.joint = found.joint, .times = std::round(100.0 * (found.times + grid.step * part / kParts)) / 100.0};
      if (swing.times <= kLowest || swing.times > grid.highest) {
        continue;
      }
      const Eigen::MatrixX2d basis = functions(data_.joint_values, swing);
      const Matrix2d information = basis.transpose() * weight.asDiagonal() * basis;
      const Eigen::Vector2d gradient = basis.transpose() * moment;
      const double squares = gradient.dot(information.ldlt().solve(gradient));
      if (squares > most) {
        most = squares;
        best = swing;
      }
    }
    return best;
  }

  // rows x 2
  MatrixXd columns_of(const Swing& swing) const {
    const Eigen::MatrixX2d basis = functions(data_.joint_values, swing);
    MatrixXd result(rest_.size(), 2);
    for (Index c = 0; c < basis.rows(); ++c) {
      const auto [first, count] = range(c);
      result.middleRows(first, count) =
          data_.joints.motions.col(static_cast<Index>(swing.joint)).segment(first, count) * basis.row(c);
    }
    return result;
  }

  // The columns without their projection onto the model's columns.
  MatrixXd projected(const MatrixXd& columns) const {
    MatrixXd result = columns;
    for (auto column : result.colwise()) {
      VectorXd own = VectorXd::Zero(data_.rows.columns());
      MatrixXd solution = data_.rows.moments(column)(data_.columns);
      root_.triangularView<Eigen::Lower>().solveInPlace(solution);
      root_.triangularView<Eigen::Lower>().adjoint().solveInPlace(solution);
      own(data_.columns) = solution.col(0);
      column = data_.rows.residual(column, own);
    }
    return result;
  }

  // Per configuration: projected columns · residuals.
  Eigen::MatrixX2d sums(const MatrixXd& own) const {
    Eigen::MatrixX2d result(data_.joint_values.cols(), 2);
    for (Index c = 0; c < result.rows(); ++c) {
      const auto [first, count] = range(c);
      result.row(c) = rest_.segment(first, count).transpose() * own.middleRows(first, count);
    }
    return result;
  }

  std::pair<Index, Index> range(Index configuration) const {
    const auto c = static_cast<std::size_t>(configuration);
    return {data_.rows.first[c], data_.rows.first[c + 1] - data_.rows.first[c]};
  }

  RippleData data_;
  MatrixXd root_;  // L of the information
  VectorXd rest_;
  std::vector<Grid> grids_;
};

}  // namespace

std::vector<EffectTerm> find_ripple(RippleData data, int threads) {
  const ErrorModel& model = data.model;
  const MatrixXd& q = data.joint_values;
  Search search(std::move(data));
  std::vector<EffectTerm> terms;
  for (int i = 0; i < kMostFound && search.is_possible(); ++i) {
    const std::optional<Swing> found = search.next(threads);
    if (!found) {
      break;
    }
    const std::vector<EffectTerm> pair = ripple_terms(model, q, found->joint, found->times);
    const bool is_new = std::none_of(terms.begin(), terms.end(), [&](const EffectTerm& term) {
      return !pair.empty() && term.name == pair.front().name;
    });
    if (is_new) {
      terms.insert(terms.end(), pair.begin(), pair.end());
    }
  }
  return terms;
}

}  // namespace kdl_calibration
