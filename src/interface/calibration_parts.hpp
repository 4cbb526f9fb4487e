#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "calibration/calibration_settings.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/robot.hpp"
#include "results/saved_calibration.hpp"

namespace kdl_calibration {

/// A calibration with the settings that made it.
struct FittedCalibration {
  std::string measurements;  ///< hash_of
  CalibrationSettings settings;
  CalibrationResult result;
};

/// What a Calibration holds, whether it was fitted or read from a file.
struct CalibrationParts : SavedCalibration {
  std::string robot;                        ///< hash_of
  std::optional<FittedCalibration> fitted;  ///< none if it was read from a file
};

/// Throws InputError for another number of joint values, values that are not finite and a mimic joint that does not
/// follow its leader.
void require_joint_values(const Eigen::Ref<const Eigen::VectorXd>& q, const std::vector<MovingJoint>& joints);
/// Hash of the URDF, base and tip.
std::string hash_of(const Robot& robot);
/// Hash of the rows, joint values, signals and names: of all that a fit reads.
std::string hash_of(const Measurements& measurements);
/// Throws InputError if the joints are not those of the URDF text: errors would go into a text that they do not fit.
void require_as_parsed(const Robot& robot);
/// Throws InputError if the calibration is one of another robot.
void require_same_robot(const Robot& robot, const Calibration& calibration);
/// The fit. Throws InputError if the calibration was read from a file, or for another robot or other measurements.
const FittedCalibration& fitted_calibration(const Robot& robot, const Measurements& measurements,
                                            const Calibration& calibration);

}  // namespace kdl_calibration
