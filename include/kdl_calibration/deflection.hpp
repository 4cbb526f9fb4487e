#pragma once

#include <Eigen/Core>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// Compliance of the joints under gravity. Where the URDF states link masses each revolute joint gets one parameter
/// with the torque of those masses; else one for each distinct torque that a mass at a later joint frame or at the tip
/// exerts. Torques that are small beside the largest of the robot, or that differ little from others of the same joint
/// or from a constant, are left out: measurements could not tell them apart.
std::vector<Deflection> gravity_deflections(const ErrorModel& model);

/// One gain per moving joint.
std::vector<Deflection> gain_deflections(const ErrorModel& model);

/// basis(q) of every deflection of the model: deflections x N for joint values joints x N. At the nominal geometry.
Eigen::MatrixXd deflection_basis(const ErrorModel& model, const Eigen::MatrixXd& joint_values);

/// The joint values that the rigid chain needs to stand where the real one does: joints x N. `values` holds one value
/// per deflection of the model; empty means none.
Eigen::MatrixXd deflected(const ErrorModel& model, const Eigen::VectorXd& values, const Eigen::MatrixXd& joint_values);

}  // namespace kdl_calibration
