#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/urdf_export.hpp"

namespace kdl_calibration {

struct Calibration;

/// What the errors mean for the URDF's joint origins. Throws InputError where an error behind the last joint has no
/// fixed joint to carry it.
std::vector<OriginCorrection> origin_corrections(const ErrorModel& model, const Eigen::VectorXd& errors);

/// The robot's URDF with the errors corrected.
std::string calibrated_urdf(const Robot& robot, const ErrorModel& model, const Eigen::VectorXd& errors);
/// The robot's URDF with what it can carry of a calibration: the rigid fit, where effects were fitted as well.
std::string calibrated_urdf(const Robot& robot, const Calibration& calibration);

}  // namespace kdl_calibration
