#include "kdl_calibration/reduction.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <numbers>
#include <utility>

#include "kdl_calibration/random.hpp"

namespace kdl_calibration {
namespace {

// Stacks the Jacobian columns of base, targets and geometric parameters for one configuration, in the frame B.
class CandidateJacobian {
public:
  CandidateJacobian(const ErrorModel& model, const std::vector<TargetFrame>& targets, const ReductionOptions& options)
      : model_(model),
        targets_(targets),
        options_(options),
        chain_(parameter_chain(model)),
        forward_(chain_.chain),
        jacobian_(chain_.chain) {
    names_ = base_parameter_names();
    for (const TargetFrame& target : targets) {
      const auto target_names = target_parameter_names(target);
      names_.insert(names_.end(), target_names.begin(), target_names.end());
    }
    first_geometric_ = names_.size();
    for (const ErrorParameter& parameter : model.parameters) {
      names_.push_back(parameter.name);
    }
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
    KDL::JntArray q(chain_.chain.getNrOfJoints());
    for (int c = 0; c < options_.configurations; ++c) {
      for (std::size_t i = 0; i < model_.joints.size(); ++i) {
        const double range = model_.joints[i].type == JointType::prismatic ? 1.0 : std::numbers::pi;
        q(chain_.joint_index[i]) = random.uniform(-range, range);
      }
      fill(q, stack.middleRows(rows_each * c, rows_each));
    }
    return stack;
  }

private:
  void fill(const KDL::JntArray& q, Eigen::Ref<Eigen::MatrixXd> rows) {
    KDL::Frame flange;
    forward_.JntToCart(q, flange);
    KDL::Jacobian flange_jacobian(chain_.chain.getNrOfJoints());
    jacobian_.JntToJac(q, flange_jacobian);
    Eigen::Index row = 0;
    Eigen::Index target_column = 6;
    for (const TargetFrame& target : targets_) {
      const Eigen::Index height = target.with_orientation ? 6 : 3;
      const KDL::Frame X_FT = to_kdl(target.X_FT);
      const KDL::Vector lever = flange.M * X_FT.p;
      auto block = rows.middleRows(row, height);
      const KDL::Rotation orientation = flange.M * X_FT.M;
      for (int axis = 0; axis < 3; ++axis) {
        KDL::Vector e = KDL::Vector::Zero();
        e[axis] = 1.0;
        write(block, axis, KDL::Twist(e, KDL::Vector::Zero()));
        write(block, 3 + axis, KDL::Twist(e * (flange.p + lever), e));
        write(block, target_column + axis, KDL::Twist(flange.M * e, KDL::Vector::Zero()));
        if (target.with_orientation) {
          write(block, target_column + 3 + axis, KDL::Twist(KDL::Vector::Zero(), orientation * e));
        }
      }
      target_column += height;
      for (std::size_t p = 0; p < model_.parameters.size(); ++p) {
        const KDL::Twist column = flange_jacobian.getColumn(chain_.parameter_index[p]);
        write(block, static_cast<Eigen::Index>(first_geometric_ + p), column.RefPoint(lever));
      }
      row += height;
    }
  }

  static void write(Eigen::Ref<Eigen::MatrixXd> block, Eigen::Index column, const KDL::Twist& twist) {
    block.col(column).head<3>() = to_eigen(twist.vel);
    if (block.rows() == 6) {
      block.col(column).tail<3>() = to_eigen(twist.rot);
    }
  }

  const ErrorModel& model_;
  const std::vector<TargetFrame>& targets_;
  const ReductionOptions& options_;
  ParameterChain chain_;
  KDL::ChainFkSolverPos_recursive forward_;
  KDL::ChainJntToJacSolver jacobian_;
  std::vector<std::string> names_;
  std::size_t first_geometric_ = 0;
};

bool without_effect(const Eigen::MatrixXd& columns, Eigen::Index column) {
  return columns.col(column).cwiseAbs().maxCoeff() < 1e-12;  // [m] or [rad] per unit: rounding
}

using Combination = std::map<std::string, double>;

// Coefficients of `column` over the columns in `among`; empty where they do not span it.
Combination combination(const Eigen::MatrixXd& columns, Eigen::Index column, const std::vector<Eigen::Index>& among,
                        const std::vector<std::string>& names) {
  Combination result;
  if (among.empty()) {
    return result;
  }
  const Eigen::MatrixXd basis = columns(Eigen::all, among);
  const Eigen::VectorXd coefficients = basis.colPivHouseholderQr().solve(columns.col(column));
  const double norm = columns.col(column).norm();
  if ((basis * coefficients - columns.col(column)).norm() > 1e-7 * norm) {
    return result;
  }
  for (std::size_t i = 0; i < among.size(); ++i) {
    const double contribution = coefficients[static_cast<Eigen::Index>(i)];
    if (std::abs(contribution) * basis.col(static_cast<Eigen::Index>(i)).norm() > 1e-7 * norm) {
      const double rounded = std::round(contribution * 1e9) * 1e-9;
      result[names[static_cast<std::size_t>(among[i])]] =
          std::abs(rounded - std::round(rounded)) < 1e-8 ? std::round(rounded) : contribution;
    }
  }
  return result;
}

}  // namespace

// Modified Gram-Schmidt with one repetition, which keeps the basis orthogonal to rounding.
std::vector<bool> columns_that_raise_the_rank(const Eigen::MatrixXd& columns, const std::vector<bool>& candidate,
                                              double tolerance) {
  std::vector<bool> raises(static_cast<std::size_t>(columns.cols()), false);
  Eigen::MatrixXd basis(columns.rows(), columns.cols());
  Eigen::Index rank = 0;
  for (Eigen::Index c = 0; c < columns.cols(); ++c) {
    if (!candidate[static_cast<std::size_t>(c)]) {
      continue;
    }
    Eigen::VectorXd rest = columns.col(c);
    const double norm = rest.norm();
    for (int pass = 0; pass < 2; ++pass) {
      rest -= basis.leftCols(rank) * (basis.leftCols(rank).transpose() * rest);
    }
    if (rest.norm() > tolerance * norm && !without_effect(columns, c)) {
      basis.col(rank++) = rest.normalized();
      raises[static_cast<std::size_t>(c)] = true;
    }
  }
  return raises;
}

Reduction reduced_model(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                        const ReductionOptions& options) {
  CandidateJacobian candidates(model, targets, options);
  const Eigen::MatrixXd columns = candidates.stacked();
  const std::vector<std::string>& names = candidates.names();
  std::vector<bool> candidate(names.size());
  for (std::size_t c = 0; c < names.size(); ++c) {
    candidate[c] = std::find(options.fixed.begin(), options.fixed.end(), names[c]) == options.fixed.end();
  }
  const std::vector<bool> raises = columns_that_raise_the_rank(columns, candidate, options.tolerance);

  Reduction reduction;
  reduction.candidates = static_cast<int>(std::count(candidate.begin(), candidate.end(), true));
  std::vector<Eigen::Index> kept;
  std::vector<Eigen::Index> frames;  // the kept ones of base and targets
  for (std::size_t c = 0; c < names.size(); ++c) {
    if (raises[c]) {
      kept.push_back(static_cast<Eigen::Index>(c));
      reduction.kept.push_back(names[c]);
      if (c < candidates.first_geometric()) {
        frames.push_back(static_cast<Eigen::Index>(c));
      }
    }
  }
  reduction.rank = static_cast<int>(kept.size());

  std::vector<Eigen::Index> gauge;
  for (std::size_t c = 0; c < names.size(); ++c) {
    if (raises[c] || !candidate[c]) {
      continue;
    }
    const auto column = static_cast<Eigen::Index>(c);
    const bool joint_offset = c >= candidates.first_geometric() &&
                              model.parameters[c - candidates.first_geometric()].kind == ParameterKind::joint_offset;
    const Combination tied = combination(columns, column, frames, names);
    if (joint_offset && (without_effect(columns, column) || !tied.empty())) {
      GaugeParameter parameter{.name = names[c], .tied_to = {}};
      for (const auto& entry : tied) {
        parameter.tied_to.push_back(entry.first);
      }
      reduction.gauge.push_back(std::move(parameter));
      gauge.push_back(column);
      continue;
    }
    // A single gauge parameter says it in one word where base or targets would need many.
    Combination replacement;
    for (const Eigen::Index g : gauge) {
      replacement = combination(columns, column, {g}, names);
      if (!replacement.empty()) {
        break;
      }
    }
    if (replacement.empty()) {
      replacement = combination(columns, column, kept, names);
    }
    reduction.dropped.push_back({.name = names[c], .replaced_by = std::move(replacement)});
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
