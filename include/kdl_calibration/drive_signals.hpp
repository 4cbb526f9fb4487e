#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace kdl_calibration {

/// What the drives told of configurations besides their joint values: joints x configurations each, or empty where
/// nothing is known of any.
struct DriveSignals {
  /// Sign of the joint's last motion before it was measured: -1 or 1, between them where repeats were approached from
  /// both sides (their mean), NaN where it is not known.
  Eigen::MatrixXd approach;
  /// [Nm], or [N] where the joint slides; NaN where none was measured.
  Eigen::MatrixXd torques;
};

/// Whether some configuration has a torque of the joint.
bool has_torques(const DriveSignals& signals, Eigen::Index joint);

/// What keeps the signals from being those of joint values (joints x N), in words that name `what` they are for; empty
/// where they are.
std::string fault_of(const DriveSignals& signals, const Eigen::MatrixXd& joint_values, const std::string& what = "");

/// Those of some of the configurations, in this order.
DriveSignals columns(const DriveSignals& signals, const std::vector<Eigen::Index>& which);
/// Those of one.
DriveSignals column(const DriveSignals& signals, Eigen::Index which);

/// Those of `first`, then those of `second`: what only one of them has is lost.
DriveSignals side_by_side(const DriveSignals& first, const DriveSignals& second);

/// Joint values joints x N and what is known besides them.
struct DrivenConfigurations {
  Eigen::MatrixXd joint_values;
  DriveSignals signals;
};

/// The sign of each joint's last motion of more than 1e-6 rad or m on the way from stop to stop (`stops`: joints x N):
/// joints x N, NaN before the joint has moved for the first time.
Eigen::MatrixXd directions_of_motion(const Eigen::MatrixXd& stops);

}  // namespace kdl_calibration
