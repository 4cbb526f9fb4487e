#include "planning/truth_comparison.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "base/decompositions.hpp"
#include "base/preconditions.hpp"
#include "estimation/identification.hpp"
#include "estimation/input_check.hpp"
#include "estimation/prediction.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;

// The truth with the estimate's targets only, in their order.
Estimate with_targets_of(const Estimate& estimate, Estimate truth) {
  std::vector<TargetFrame> targets;
  for (const TargetFrame& target : estimate.frames.targets) {
    const TargetFrame* const found = find_target(truth.frames.targets, target.name);
    if (found == nullptr) {
      throw InputError("target '" + target.name + "' of the result is not in the truth, expected the truth of the " +
                       "robot that was measured");
    }
    targets.push_back(*found);
    targets.back().with_orientation = target.with_orientation;
  }
  truth.frames.targets = std::move(targets);
  return truth;
}

double rms(const std::vector<double>& distances) { return error_statistics(distances).rms; }

// Parameters that are estimated, gauge, or not nominal in the estimate or the truth.
std::vector<ComparedParameter> compared_parameters(const ErrorModel& model, const Reduction& reduction,
                                                   const Estimate& estimate, const Estimate& truth,
                                                   const Estimate& truth_in_gauge) {
  const std::set<std::string> kept(reduction.kept.begin(), reduction.kept.end());
  std::vector<ComparedParameter> result;
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const ErrorParameter& parameter = model.parameters[p];
    const auto i = static_cast<Index>(p);
    const bool free = kept.count(parameter.name) > 0;
    if (free || estimate.errors[i] != 0.0 || truth.errors[i] != 0.0) {
      result.push_back({.index = p,
                        .estimated = parameter.nominal + estimate.errors[i],
                        .truth = parameter.nominal + truth.errors[i],
                        .truth_in_gauge = parameter.nominal + truth_in_gauge.errors[i],
                        .gauge = !free});
    }
  }
  return result;
}

void take_largest_differences(const ErrorModel& model, const Estimate& estimate, TruthComparison& result) {
  double length = result.base_difference.head<3>().cwiseAbs().maxCoeff();
  double angle = result.base_difference.tail<3>().cwiseAbs().maxCoeff();
  for (const ComparedParameter& parameter : result.parameters) {
    if (!parameter.gauge) {
      double& largest = is_length(model, model.parameters[parameter.index]) ? length : angle;
      largest = std::max(largest, std::abs(parameter.estimated - parameter.truth_in_gauge));
    }
  }
  for (std::size_t t = 0; t < estimate.frames.targets.size(); ++t) {
    const Eigen::Isometry3d& estimated = estimate.frames.targets[t].X_FT;
    const Eigen::Isometry3d& truth = result.truth_in_gauge.frames.targets[t].X_FT;
    length = std::max(length, (estimated.translation() - truth.translation()).cwiseAbs().maxCoeff());
    if (estimate.frames.targets[t].with_orientation) {
      angle = std::max(angle, rotation_log(truth.linear().transpose() * estimated.linear()).cwiseAbs().maxCoeff());
    }
  }
  result.largest_length = length;
  result.largest_angle = angle;
}

// `count` values: `own` from index `first` on, else zero.
Eigen::VectorXd among(Index count, Index first, const Eigen::VectorXd& own) {
  Eigen::VectorXd result = Eigen::VectorXd::Zero(count);
  result.segment(first, own.size()) = own;
  return result;
}

}  // namespace

ArmAndTruth arm_and_truth(const ErrorModel& model, const Estimate& estimate, const VirtualRobot& truth) {
  const std::vector<EffectTerm>& added = truth.model.effects;
  if (!model.effects.empty() && !added.empty() && !KDL::Equal(model.gravity, truth.model.gravity, 1e-9)) {
    throw InputError("gravity pulls in another direction in the truth than in the result, expected the same");
  }
  ArmAndTruth result{.model = model, .estimate = estimate, .truth = truth.truth};
  if (model.effects.empty()) {
    result.model.gravity = truth.model.gravity;
  }
  result.model.effects.insert(result.model.effects.end(), added.begin(), added.end());
  const auto own = static_cast<Index>(model.effects.size());
  const auto all = static_cast<Index>(result.model.effects.size());
  result.estimate.effects = among(all, 0, estimate.effects);
  result.truth.effects = among(all, own, truth.truth.effects);
  return result;
}

ArmAndTruth without_stations(ArmAndTruth arms, const Eigen::MatrixXd& joint_values) {
  Estimate& estimate = arms.estimate;
  if (arms.model.has_undetermined_bases) {
    const auto points = [&](const Estimate& arm) {
      Eigen::Matrix3Xd result(3, 0);
      for (const Eigen::Isometry3d& X_BF : flange_poses(arms.model, arm, joint_values)) {
        for (const TargetFrame& target : arm.frames.targets) {
          result.conservativeResize(3, result.cols() + 1);
          result.rightCols<1>() = arm.frames.base() * X_BF * target.X_FT.translation();
        }
      }
      return result;
    };
    estimate.frames.base() =
        rigid_motion(points(estimate), points(with_targets_of(estimate, arms.truth))) * estimate.frames.base();
  }
  arms.model = model_at_stations({}, std::move(arms.model));
  estimate.frames.bases.resize(1);
  arms.truth.frames.bases.resize(1);
  return arms;
}

std::vector<double> distances_from_truth(const ErrorModel& model, const Estimate& estimate, const Estimate& truth,
                                         const Eigen::MatrixXd& joint_values) {
  require_count("targets of the truth", truth.frames.targets.size(), estimate.frames.targets.size());
  const std::vector<Eigen::Isometry3d> estimated = flange_poses(model, estimate, joint_values);
  const std::vector<Eigen::Isometry3d> true_poses = flange_poses(model, truth, joint_values);
  std::vector<double> distances;
  distances.reserve(estimated.size() * estimate.frames.targets.size());
  for (std::size_t c = 0; c < estimated.size(); ++c) {
    for (std::size_t t = 0; t < estimate.frames.targets.size(); ++t) {
      const Eigen::Vector3d predicted =
          estimate.frames.base() * (estimated[c] * estimate.frames.targets[t].X_FT.translation());
      const Eigen::Vector3d position =
          truth.frames.base() * (true_poses[c] * truth.frames.targets[t].X_FT.translation());
      distances.push_back((predicted - position).norm());
    }
  }
  return distances;
}

Estimate truth_in_gauge_of(const ErrorModel& model, const Reduction& reduction, const Estimate& estimate,
                           const Estimate& truth, const Eigen::MatrixXd& joint_values) {
  Random none(0);  // unused: the predictions are exact
  const Measurements predictions = measure({.model = model, .truth = truth}, joint_values, {}, none);
  const Unknowns free = Unknowns(model, estimate.frames.targets, reduction.kept);
  Estimate start = estimate;
  start.effects = truth.effects;
  return identify_jointly(model, predictions, start, free, {.step_tolerance = 1e-13}).estimate;
}

TruthComparison compare_with_truth(const ErrorModel& model, const Estimate& estimate, const Estimate& truth,
                                   const Eigen::MatrixXd& joint_values) {
  check(estimate, model, estimate.frames.targets.size());
  check(truth, model, truth.frames.targets.size());
  const Estimate matched = with_targets_of(estimate, truth);
  const Reduction reduction = reduced_model(model, estimate.frames.targets);
  const Eigen::MatrixXd few = joint_values.leftCols(std::min<Index>(kGenericConfigurations, joint_values.cols()));
  TruthComparison result;
  result.truth_in_gauge = truth_in_gauge_of(model, reduction, estimate, matched, few);
  result.gauge_misfit = rms(distances_from_truth(model, result.truth_in_gauge, matched, joint_values));
  result.parameters = compared_parameters(model, reduction, estimate, matched, result.truth_in_gauge);
  const Eigen::Isometry3d base = result.truth_in_gauge.frames.base().inverse() * estimate.frames.base();
  result.base_difference << base.translation(), rotation_log(base.linear());
  take_largest_differences(model, estimate, result);
  result.points = error_statistics(distances_from_truth(model, estimate, matched, joint_values));
  return result;
}

}  // namespace kdl_calibration
