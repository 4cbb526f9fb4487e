#include "model/reduction.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "base/decompositions.hpp"
#include "base/preconditions.hpp"
#include "base/random.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

// Stacks the Jacobian columns of base, targets and geometric parameters for one configuration, in the flange frame.
class CandidateJacobian {
public:
  CandidateJacobian(const ErrorModel& model, const std::vector<TargetFrame>& targets, const ReductionOptions& options)
      : model_(model), targets_(targets), options_(options), twists_(base_twists()) {
    names_ = frame_parameter_names(targets);
    first_geometric_ = names_.size();
    std::vector<std::size_t> all(model.parameters.size());
    std::iota(all.begin(), all.end(), std::size_t{0});
    for (const ErrorParameter& parameter : model.parameters) {
      names_.push_back(parameter.name);
    }
    const Eigen::VectorXd errors =
        options.errors.size() != 0 ? options.errors : Eigen::VectorXd::Zero(static_cast<Eigen::Index>(all.size()));
    chain_ = folded(model, errors);
    const std::vector<ParameterTwist> geometric = parameter_twists(model, errors, all);
    twists_.insert(twists_.end(), geometric.begin(), geometric.end());
  }

  const std::vector<std::string>& names() const { return names_; }
  std::size_t first_geometric() const { return first_geometric_; }

  Eigen::MatrixXd stacked() {
    Eigen::Index rows_each = 0;
    for (const TargetFrame& target : targets_) {
      rows_each += target.with_orientation ? 6 : 3;
    }
    Eigen::MatrixXd stack =
        Eigen::MatrixXd::Zero(rows_each * options_.configurations, static_cast<Eigen::Index>(names_.size()));
    Random random(options_.seed);
    Eigen::VectorXd q(static_cast<Eigen::Index>(model_.joints.size()));
    for (int c = 0; c < options_.configurations; ++c) {
      for (std::size_t i = 0; i < model_.joints.size(); ++i) {
        const double range = model_.joints[i].type == JointType::prismatic ? 1.0 : std::numbers::pi;
        q[static_cast<Eigen::Index>(i)] = random.uniform(-range, range);
      }
      follow(model_.joints, q);
      fill(q, stack.middleRows(rows_each * c, rows_each));
    }
    return stack;
  }

private:
  void fill(const Eigen::VectorXd& q, Eigen::Ref<Eigen::MatrixXd> rows) {
    flange_jacobian(chain_, twists_, q, motions_);
    Eigen::Index row = 0;
    Eigen::Index target_column = 6;
    for (const TargetFrame& target : targets_) {
      const Eigen::Index height = target.with_orientation ? 6 : 3;
      const Eigen::Matrix3d lever = skew(target.X_FT.translation());
      const auto write = [&](Eigen::Index first, const auto& motions) {
        auto block = rows.block(row, first, height, motions.cols());
        block.template topRows<3>() = motions.template topRows<3>() - lever * motions.template bottomRows<3>();
        if (target.with_orientation) {
          block.template bottomRows<3>() = motions.template bottomRows<3>();
        }
      };
      write(0, motions_.leftCols<6>());
      write(static_cast<Eigen::Index>(first_geometric_), motions_.rightCols(motions_.cols() - 6));
      rows.block<3, 3>(row, target_column).setIdentity();
      if (target.with_orientation) {
        rows.block<3, 3>(row + 3, target_column + 3) = target.X_FT.linear();
      }
      target_column += height;
      row += height;
    }
  }

  const ErrorModel& model_;
  const std::vector<TargetFrame>& targets_;
  const ReductionOptions& options_;
  FoldedChain chain_;
  std::vector<ParameterTwist> twists_;  // of the base, then the parameters
  Matrix6Xd motions_;                   // motion of the flange per unit of each
  std::vector<std::string> names_;
  std::size_t first_geometric_ = 0;
};

// Below this limit 0.1 rad moves a point by 10 nm, which no device can measure.
bool without_effect(const Eigen::MatrixXd& columns, Eigen::Index column) {
  return columns.col(column).cwiseAbs().maxCoeff() < 1e-7;  // [m] or [rad] per unit
}

using Combination = std::map<std::string, double>;

constexpr double kSpanned = 1e-7;  // largest remainder of a spanned column, relative to its norm

// The span of some of the columns. Keeps references.
class Span {
public:
  Span(const Eigen::MatrixXd& columns, const std::vector<std::string>& names, const std::vector<Eigen::Index>& among)
      : columns_(columns), names_(names), among_(among), basis_(columns(Eigen::all, among)) {
    if (!among.empty()) {
      factors_.compute(basis_);
    }
  }

  // Coefficients of `column` in the span; empty if the remainder exceeds `left` times its norm.
  Combination combination(Eigen::Index column, double left = kSpanned) const {
    Combination result;
    if (among_.empty()) {
      return result;
    }
    const Eigen::VectorXd coefficients = factors_.solve(columns_.col(column));
    const double norm = columns_.col(column).norm();
    if ((basis_ * coefficients - columns_.col(column)).norm() > left * norm) {
      return result;
    }
    for (std::size_t i = 0; i < among_.size(); ++i) {
      const double contribution = coefficients[static_cast<Eigen::Index>(i)];
      if (std::abs(contribution) * basis_.col(static_cast<Eigen::Index>(i)).norm() > 1e-7 * norm) {
        const double rounded = std::round(contribution * 1e9) * 1e-9;
        result[names_[static_cast<std::size_t>(among_[i])]] =
            std::abs(rounded - std::round(rounded)) < 1e-8 ? std::round(rounded) : contribution;
      }
    }
    return result;
  }

private:
  const Eigen::MatrixXd& columns_;
  const std::vector<std::string>& names_;
  std::vector<Eigen::Index> among_;
  Eigen::MatrixXd basis_;
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> factors_;
};

// Remainders of unit columns outside the span of the kept ones: modified Gram-Schmidt, column by column.
class Remainders {
public:
  Remainders(const Eigen::MatrixXd& columns, const std::vector<bool>& candidate)
      : norms_(columns.colwise().norm()), rest_(columns) {
    const double rounding = kRounding * std::max(1.0, norms_.maxCoeff());
    for (Eigen::Index c = 0; c < rest_.cols(); ++c) {
      const bool usable = candidate[static_cast<std::size_t>(c)] && norms_[c] > rounding;
      rest_.col(c) *= usable ? 1.0 / norms_[c] : 0.0;
    }
    basis_.resize(rest_.rows(), rest_.cols());
  }

  double sine(Eigen::Index column) const { return rest_.col(column).norm(); }
  double norm(Eigen::Index column) const { return norms_[column]; }

  void take(Eigen::Index column) {
    // Orthogonalised again, because the remainder is much smaller than the column.
    Eigen::VectorXd direction = rest_.col(column).normalized();
    direction -= basis_.leftCols(taken_) * (basis_.leftCols(taken_).transpose() * direction);
    direction.normalize();
    const Eigen::RowVectorXd shares = direction.transpose() * rest_;
    rest_.noalias() -= direction * shares;
    rest_.col(column).setZero();
    basis_.col(taken_++) = direction;
  }

private:
  static constexpr double kRounding = 1e-12;
  Eigen::RowVectorXd norms_;
  Eigen::MatrixXd rest_;
  Eigen::MatrixXd basis_;
  Eigen::Index taken_ = 0;
};

}  // namespace

std::vector<bool> independent_columns(const Eigen::MatrixXd& columns, const std::vector<bool>& candidate,
                                      const ColumnLimits& limits, std::vector<bool>* replaceable) {
  std::vector<bool> kept(static_cast<std::size_t>(columns.cols()), false);
  if (replaceable != nullptr) {
    *replaceable = kept;
  }
  if (columns.size() == 0) {
    return kept;
  }
  Remainders remainders(columns, candidate);
  const auto keep = [&](Eigen::Index column) {
    kept[static_cast<std::size_t>(column)] = true;
    remainders.take(column);
  };
  for (Eigen::Index c = 0; c < columns.cols(); ++c) {
    if (remainders.sine(c) >= limits.clear) {
      keep(c);
    }
  }
  while (true) {
    std::vector<Eigen::Index> addable;
    double largest = 0.0;
    for (Eigen::Index c = 0; c < columns.cols(); ++c) {
      const double sine = remainders.sine(c);
      if (sine > limits.least && (limits.seen.size() == 0 || sine * remainders.norm(c) >= limits.seen[c])) {
        addable.push_back(c);
        largest = std::max(largest, sine);
      }
    }
    if (addable.empty()) {
      return kept;
    }
    const Eigen::Index next = *std::find_if(addable.begin(), addable.end(),
                                            [&](Eigen::Index c) { return remainders.sine(c) >= 0.5 * largest; });
    keep(next);
    if (replaceable != nullptr) {
      (*replaceable)[static_cast<std::size_t>(next)] = true;
    }
  }
}

namespace {

// Least norms of the columns' remainders to be visible in noise, see reduced_model.
Eigen::VectorXd visible_norms(const ErrorModel& model, const Eigen::MatrixXd& columns, double noise) {
  constexpr double kShareOfNoise = 0.1;
  Eigen::VectorXd norms = Eigen::VectorXd::Zero(columns.cols());
  const Eigen::Index frames = columns.cols() - static_cast<Eigen::Index>(model.parameters.size());
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    norms[frames + static_cast<Eigen::Index>(p)] = kShareOfNoise * noise *
                                                   std::sqrt(static_cast<double>(columns.rows())) /
                                                   usual_error(model, model.parameters[p]);
  }
  return norms;
}

// Marks the names that are not fixed. Throws InputError for a fixed name that does not exist.
std::vector<bool> not_fixed(const std::vector<std::string>& names, const std::vector<std::string>& fixed) {
  for (const std::string& name : fixed) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      refuse_input("no parameter is named '" + name + "'", "one of the base or of a target");
    }
  }
  std::vector<bool> result(names.size());
  std::transform(names.begin(), names.end(), result.begin(),
                 [&](const std::string& name) { return std::find(fixed.begin(), fixed.end(), name) == fixed.end(); });
  return result;
}

// Between parallel axes only the length of a link shows, not its direction. If the link is askew in its frame, the
// coordinate that is kept must be the longer one, or it has to be off by more than the arm is. Exchanges kept lengths
// for candidates of the same frame that they would replace at more than their size.
void keep_longer_coordinates(const ErrorModel& model, const Eigen::MatrixXd& columns,
                             const std::vector<std::string>& names, const std::vector<bool>& candidate,
                             std::vector<bool>& raises) {
  constexpr double kLonger = 1.2;
  const std::size_t first = names.size() - model.parameters.size();
  const auto is_length = [&](std::size_t p) { return model.parameters[p].kind == ParameterKind::translation; };
  for (std::size_t dropped = 0; dropped < model.parameters.size(); ++dropped) {
    if (!candidate[first + dropped] || raises[first + dropped] || !is_length(dropped)) {
      continue;
    }
    std::vector<Eigen::Index> kept;
    for (std::size_t c = 0; c < raises.size(); ++c) {
      if (raises[c]) {
        kept.push_back(static_cast<Eigen::Index>(c));
      }
    }
    const Combination by = Span(columns, names, kept).combination(static_cast<Eigen::Index>(first + dropped));
    for (std::size_t other = 0; other < model.parameters.size(); ++other) {
      const bool beside = is_length(other) && model.parameters[other].frame == model.parameters[dropped].frame;
      const auto found = beside ? by.find(names[first + other]) : by.end();
      if (found != by.end() && std::abs(found->second) > kLonger) {
        raises[first + other] = false;
        raises[first + dropped] = true;
        break;
      }
    }
  }
}

// Replacements of the columns that are not kept.
class Replacements {
public:
  // `frames`: kept columns of base and targets. Keeps references to columns and names.
  Replacements(const Eigen::MatrixXd& columns, const std::vector<std::string>& names,
               const std::vector<Eigen::Index>& kept, const std::vector<Eigen::Index>& frames)
      : columns_(columns), names_(names), kept_(columns, names, kept), frames_(columns, names, frames) {}

  void add(Eigen::Index column, bool joint_offset, Reduction& reduction) {
    const std::string& name = names_[static_cast<std::size_t>(column)];
    const Combination tied = frames_.combination(column);
    if (joint_offset && (without_effect(columns_, column) || !tied.empty())) {
      GaugeParameter parameter{.name = name, .tied_to = {}};
      for (const auto& entry : tied) {
        parameter.tied_to.push_back(entry.first);
      }
      reduction.gauge.push_back(std::move(parameter));
      gauge_.push_back(column);
      return;
    }
    const bool replaced = !without_effect(columns_, column);
    reduction.dropped.push_back({.name = name, .replaced_by = replaced ? replacement(column) : Combination()});
  }

private:
  // Prefers a single gauge parameter to a combination of base and target parameters.
  Combination replacement(Eigen::Index column) const {
    for (const Eigen::Index g : gauge_) {
      Combination by_gauge = Span(columns_, names_, {g}).combination(column);
      if (!by_gauge.empty()) {
        return by_gauge;
      }
    }
    return kept_.combination(column, 1.0);  // including parts hidden by the noise
  }

  const Eigen::MatrixXd& columns_;
  const std::vector<std::string>& names_;
  Span kept_;
  Span frames_;
  std::vector<Eigen::Index> gauge_;  // found so far
};

}  // namespace

Reduction reduced_model(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                        const ReductionOptions& options) {
  CandidateJacobian candidates(model, targets, options);
  const Eigen::MatrixXd stack = candidates.stacked();
  const Eigen::MatrixXd columns = triangular_factor(stack);
  const std::vector<std::string>& names = candidates.names();
  const std::vector<bool> candidate = not_fixed(names, options.fixed);
  std::vector<bool> seen = candidate;
  for (std::size_t c = 0; c < seen.size(); ++c) {
    seen[c] = seen[c] && !without_effect(columns, static_cast<Eigen::Index>(c));
  }
  std::vector<bool> replaceable;
  std::vector<bool> raises =
      independent_columns(columns, seen, {.seen = visible_norms(model, stack, options.noise)}, &replaceable);
  keep_longer_coordinates(model, columns, names, seen, raises);

  Reduction reduction;
  reduction.candidates = static_cast<int>(std::count(candidate.begin(), candidate.end(), true));
  std::vector<Eigen::Index> kept;
  std::vector<Eigen::Index> frames;
  for (std::size_t c = 0; c < names.size(); ++c) {
    if (raises[c]) {
      kept.push_back(static_cast<Eigen::Index>(c));
      reduction.kept.push_back(names[c]);
      if (replaceable[c]) {
        reduction.replaceable.push_back(names[c]);
      }
      if (c < candidates.first_geometric()) {
        frames.push_back(static_cast<Eigen::Index>(c));
      }
    }
  }
  reduction.rank = static_cast<int>(kept.size());
  Replacements replacements(columns, names, kept, frames);
  for (std::size_t c = 0; c < names.size(); ++c) {
    if (candidate[c] && !raises[c]) {
      const bool joint_offset = c >= candidates.first_geometric() &&
                                model.parameters[c - candidates.first_geometric()].kind == ParameterKind::joint_offset;
      replacements.add(static_cast<Eigen::Index>(c), joint_offset, reduction);
    }
  }
  return reduction;
}

std::vector<TargetFrame> generic_targets(int count, std::uint64_t seed) {
  std::vector<TargetFrame> targets;
  Random random(seed);
  for (int k = 0; k < count; ++k) {
    TargetFrame target{.name = k < 26 ? std::string(1, static_cast<char>('A' + k)) : "T" + std::to_string(k + 1)};
    for (int axis = 0; axis < 3; ++axis) {
      target.X_FT.translation()[axis] = random.uniform(-0.2, 0.2);
    }
    targets.push_back(std::move(target));
  }
  return targets;
}

}  // namespace kdl_calibration
