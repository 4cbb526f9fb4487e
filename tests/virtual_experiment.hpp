#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <optional>
#include <vector>

#include "base/random.hpp"
#include "estimation/identification.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "model/kinematics.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"

namespace kdl_calibration::testing {

/// All parameters of the model, those of the base link included, which no reduced model keeps.
inline std::vector<std::size_t> all_parameters(const ErrorModel& model) {
  std::vector<std::size_t> all(model.parameters.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return all;
}

/// Where a target is in the measuring frame, by KDL's solver.
template <class Index>
Eigen::Vector3d kdl_point(const KDL::Chain& chain, const Estimate& estimate, const Eigen::VectorXd& q, Index target) {
  const Eigen::Vector3d in_flange = estimate.frames.targets[static_cast<std::size_t>(target)].X_FT.translation();
  return estimate.frames.base() * (to_eigen(kdl_pose(chain, q)) * in_flange);
}

/// Targets of which not just the position is measured.
inline std::vector<TargetFrame> as_frames(std::vector<TargetFrame> targets) {
  for (TargetFrame& target : targets) {
    target.with_orientation = true;
  }
  return targets;
}

/// The same rows as from a tracker that states no sigma.
inline Measurements without_sigmas(Measurements measurements) {
  for (Observation& observation : measurements.observations) {
    observation.sigma = 0.0;
  }
  return measurements;
}

struct VirtualExperimentOptions {
  ErrorModel model = complete_model(fanuc());
  std::vector<TargetFrame> targets = published_targets();
  /// Which parameters have errors (indices into the model's); without: those that the reduced model keeps.
  std::optional<std::vector<std::size_t>> with_errors = std::nullopt;
  ErrorSizes sizes = {.length = 0.001, .angle = 0.001};
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();  ///< where the base stands, but for an error of it
  JointRanges (*ranges)(const std::vector<MovingJoint>& joints) = limits_of;  ///< or published_ranges
  Random random = Random(1);
};

/// An arm whose errors, base and targets are known, and a tracker that measures it. One sequence of random numbers
/// gives first the errors, then whatever is asked for, in that order.
struct VirtualExperiment {
  ErrorModel model;
  std::vector<TargetFrame> targets;  ///< as they are stated, not as they are
  Reduction reduction;
  Unknowns free;  ///< what the reduction keeps
  std::vector<std::size_t> with_errors;
  ErrorSizes sizes;
  Eigen::Isometry3d X_WB;
  JointRanges ranges;
  Random random;
  VirtualRobot robot;  ///< with the truth

  explicit VirtualExperiment(const VirtualExperimentOptions& options = {})
      : model(options.model),
        targets(options.targets),
        reduction(reduced_model(model, targets)),
        free(model, targets, reduction.kept),
        with_errors(options.with_errors.value_or(free.geometric())),
        sizes(options.sizes),
        X_WB(options.X_WB),
        ranges(options.ranges(model.joints)),
        random(options.random) {
    draw_robot();
  }

  /// Another robot of the same kind.
  void draw_robot() { robot = placed(virtual_robot(model, with_errors, targets, sizes, random), X_WB); }

  /// Begins anew with these random numbers, and so with another robot. The reduction, which takes its time, stays.
  void restart(const Random& from) {
    random = from;
    draw_robot();
  }

  Eigen::MatrixXd configurations(int count) { return random_configurations(model.joints, ranges, count, random); }

  /// Every target in every configuration (joints x N).
  Measurements measure(const Eigen::MatrixXd& q, const MeasuringNoise& noise = {}, Split split = Split::train) {
    return kdl_calibration::measure(robot, q, noise, random, split);
  }
  /// The same in so many random configurations.
  Measurements measure(int count, const MeasuringNoise& noise = {}, Split split = Split::train) {
    const Eigen::MatrixXd q = configurations(count);
    return measure(q, noise, split);
  }
};

/// The published experiment: true errors of the irreducible model and its gauge, three tools.
inline VirtualExperiment published_experiment(std::uint64_t seed = 1, const ErrorSizes& sizes = {}) {
  static const ErrorModel model = complete_model(fanuc());
  static const Reduction reduction = reduced_model(model, published_targets());
  return VirtualExperiment({.with_errors = with_true_errors(model, reduction, false),
                            .sizes = sizes,
                            .ranges = published_ranges,
                            .random = Random(seed)});
}

/// The joint fit of what the reduction keeps, from the nominal arm.
inline Identification joint_fit(const VirtualExperiment& experiment, const Measurements& measured,
                                const JointOptions& options = {}) {
  return identify_jointly(experiment.model, measured, nominal_start(experiment.model, measured), experiment.free,
                          options);
}

/// 3D RMS of what the estimate predicts against the truth at fresh configurations.
inline double held_out_rms(VirtualExperiment& experiment, const Estimate& estimate, int count) {
  const Eigen::MatrixXd q = experiment.configurations(count);
  const VirtualRobot& robot = experiment.robot;
  const FoldedChain truth = folded(robot.model, robot.truth.errors);
  const FoldedChain found = folded(robot.model, estimate.errors);
  double sum = 0.0;
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    const Eigen::Isometry3d X_true = robot.truth.frames.base() * flange_pose(truth, q.col(c));
    const Eigen::Isometry3d X_found = estimate.frames.base() * flange_pose(found, q.col(c));
    for (std::size_t k = 0; k < estimate.frames.targets.size(); ++k) {
      sum += (X_true * robot.truth.frames.targets[k].X_FT.translation() -
              X_found * estimate.frames.targets[k].X_FT.translation())
                 .squaredNorm();
    }
  }
  return std::sqrt(sum / static_cast<double>(q.cols() * static_cast<Eigen::Index>(estimate.frames.targets.size())));
}

}  // namespace kdl_calibration::testing
