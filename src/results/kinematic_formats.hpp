#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/robot.hpp"
#include "robot/dh_table.hpp"

namespace kdl_calibration {

// Texts for other programs. A note, if there is one, stands in the first line as a comment, or as a member of JSON.

/// The DH table of the robot as JSON, with the largest difference that remains when it is read again.
std::string dh_export(const Robot& robot, DhConvention convention, const std::string& note);

/// joint: {xyz: "x y z", rpy: "roll pitch yaw"}, of every joint of the chain: origins for xacro, in m and rad.
std::string xacro_yaml(const Robot& robot, const std::string& note);

/// Parameters of OPW kinematics as the plugin of MoveIt reads them, with the frames of opw.hpp. Throws InputError for
/// an arm that is not of this family.
std::string opw_yaml(const Robot& robot, const std::string& note);

/// kinematics: {shoulder: {x, y, z, roll, pitch, yaw}, ..., hash}, as the description of Universal Robots for ROS reads
/// it. Throws InputError for another robot or another description, and if the calibrated tip is not where the nominal
/// one is, as the file has no place for that.
std::string ur_yaml(const Robot& nominal, const Robot& calibrated, const std::string& note);

/// Name, joint, kind, axis, unit, nominal value, value and error of each parameter that is in `estimates` or has an
/// error; the standard deviation where `estimates` are of these errors.
std::string parameters_csv(const ErrorModel& model, const Eigen::VectorXd& errors,
                           const std::vector<ParameterEstimate>& estimates, const std::string& note);

}  // namespace kdl_calibration
