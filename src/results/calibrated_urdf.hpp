#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/robot.hpp"
#include "robot/urdf_correction.hpp"

namespace kdl_calibration {

struct CalibrationResult;

/// Corrections of the URDF's joint origins that represent the errors. Throws InputError if an error behind the last
/// joint has no fixed joint whose origin could carry it.
std::vector<OriginCorrection> origin_corrections(const ErrorModel& model, const Eigen::VectorXd& errors);

/// The robot's URDF with the errors corrected.
std::string calibrated_urdf(const Robot& robot, const ErrorModel& model, const Eigen::VectorXd& errors);
/// The robot's URDF with the calibrated geometry: that of the rigid fit if effects were fitted.
std::string calibrated_urdf(const Robot& robot, const CalibrationResult& calibration);

}  // namespace kdl_calibration
