#pragma once

// How well a geometry explains measurements: base and targets are registered, nothing else is fitted.
//
//     const PositionErrors errors = validate(load_robot("calibrated.urdf"), measurements);
//     std::cout << errors.all.rms << " m\n";

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/accuracy.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// Frames that are known and not registered.
struct KnownFrames {
  std::optional<Eigen::Isometry3d> base = std::nullopt;  ///< X_WB
  std::vector<TargetFrame> targets = {};
};

struct PositionErrors {
  ErrorStatistics all;
  ErrorStatistics train;
  ErrorStatistics test;  ///< predicted only; if there are no other rows, base and targets are registered to them
  /// The same of the means of repeats, where there are repeats.
  std::optional<ErrorStatistics> all_means;
  std::optional<ErrorStatistics> train_means;
  std::optional<ErrorStatistics> test_means;
  Iso9283 iso_9283;  ///< over all rows
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
  std::vector<TargetFrame> targets;
  std::string ambiguity;  ///< why another base would fit about as well; empty if none would
};

/// The robot as its URDF says. Throws InputError: measurements of another robot, fewer coordinates than base and
/// targets take.
PositionErrors validate(const Robot& robot, const Measurements& measurements, const KnownFrames& known = {});
/// The calibrated arm, effects included.
PositionErrors validate(const Calibration& calibration, const Measurements& measurements,
                        const KnownFrames& known = {});

}  // namespace kdl_calibration
