#pragma once

// Tool and user frames from points that the robot touched.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

#include "interface/calibration_parts.hpp"
#include "kdl_calibration/robot.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {

struct FrameTouches {
  Eigen::MatrixXd tool;  ///< joints x N: the tool's tip touches one point in different orientations; may be empty
  Eigen::MatrixXd user;  ///< joints x M: the tip touches points of the user frame; may be empty
  /// Coordinates of these points in the user frame, 3 x M [m]. Empty: the first is its origin, the second on its
  /// x axis, the others have z = 0 and y > 0.
  Matrix3Xd user_points;
  /// The tool, as far as it is known. Only its origin is found from touches.
  Eigen::Isometry3d X_FT = Eigen::Isometry3d::Identity();
};

struct TouchedFrame {
  Eigen::Isometry3d frame;  ///< of the tool in the flange, or of the user in the base
  /// Of its origin along the axes of flange or base [m], and of the user's rotations about these axes [rad]. By touches
  /// and calibration; NaN where the calibration does not determine it.
  Eigen::MatrixXd covariance;
  /// [m] distance of the touches from the point, from the given coordinates, or from the x-y plane. Empty if the
  /// touches only just determine the frame.
  std::optional<double> rms;
  std::optional<double> largest;

  /// 1 sigma in the order of `covariance`, along and about the axes of another frame that has the rotation R in flange
  /// or base.
  Eigen::VectorXd std(const Eigen::Matrix3d& R = Eigen::Matrix3d::Identity()) const;
};

struct TouchedFrames {
  std::optional<TouchedFrame> tool;
  std::optional<TouchedFrame> user;
  /// [m] 1 sigma of a coordinate of a touch, from the residuals. Empty if there are none; `covariance` is then NaN.
  std::optional<double> touch_sigma;
  /// [m] height of the flange above the x-y plane of the user frame, where it is highest. An arm that touches a part
  /// from outside is above it. 0 if the flange itself touched.
  double flange_height = 0.0;
  /// [m] least y of the touches that were to have y > 0. 0 if coordinates were given.
  double least_y = 0.0;
};

/// The arm of a calibration, or the nominal one (see nominal_basis). The tool is the one found if it was touched.
/// Throws InputError for fewer than 4 touches of a tool or 3 of a user frame, and for touches that do not determine it.
TouchedFrames touched_frames(const PredictionBasis& basis, const FrameTouches& touches);

}  // namespace kdl_calibration
