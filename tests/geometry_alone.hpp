#pragma once

// The bundled robot, read once, the options of a fit of its geometry alone, and how far such a fit is from the truth.

#include <Eigen/Geometry>

#include "effects/arm_kinematics.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "support.hpp"

namespace kdl_calibration::testing {

inline const Robot& bundled_robot() {
  static const Robot robot = fanuc();
  return robot;
}

/// Equal weights: the covariance is exact for noise that is equal and independent.
inline CalibrationOptions geometry_alone() {
  return {.priors = {.automatic = false},
          .effects = {.groups = {}, .automatic = false},
          .noise = {.weights = Weights::equal, .scale_sigma = 0.0, .length_sigma = 0.0},  // the devices are exact
          .validation = {.held_out = false},
          .diagnosis = {.try_readings = false},
          .threads = 1};
}

/// Points of the targets in the base frame.
inline Eigen::Matrix3Xd points(const ErrorModel& model, const Estimate& estimate, const Eigen::MatrixXd& q) {
  const ArmKinematics arm(model, estimate.errors, estimate.effects);
  Eigen::Matrix3Xd result(3, q.cols() * static_cast<Eigen::Index>(estimate.frames.targets.size()));
  Eigen::Index column = 0;
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    for (const TargetFrame& target : estimate.frames.targets) {
      result.col(column++) = arm.flange_pose(q.col(c)) * target.X_FT.translation();
    }
  }
  return result;
}

/// The largest distance of the found points from the true ones after the best rigid motion: what is left of the base's
/// gauge is such a motion, what is left of the targets' does not move the points.
inline double distance_up_to_gauge(const Eigen::Matrix3Xd& found, const Eigen::Matrix3Xd& truth) {
  const Eigen::Matrix4d motion = Eigen::umeyama(found, truth, false);
  return ((motion * found.colwise().homogeneous()).topRows<3>() - truth).colwise().norm().maxCoeff();
}

}  // namespace kdl_calibration::testing
