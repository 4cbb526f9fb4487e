#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// The calibrated arm as read from a result file, sufficient for predictions without a fit.
struct SavedCalibration {
  ErrorModel model;   ///< with the effects that were estimated
  Estimate estimate;  ///< base identity and no targets if the file has none
  Unknowns free;
  /// Of the columns of `free` in their order; infinite variance if not determined; empty if the file has none.
  Eigen::MatrixXd covariance;
  bool trusted = false;
  std::vector<Doubt> doubts;
};

/// Reads a result of calibrate (result_json). If the file states its URDF's hash, base or tip, another robot is
/// refused: errors must not be applied twice to a corrected URDF. Throws InputError: unreadable file, malformed JSON, a
/// missing key, a value of the wrong type, a parameter unknown to the robot, another robot, a member that does not
/// match its hash.
SavedCalibration load_calibration(const std::filesystem::path& result, const Robot& robot);
SavedCalibration parse_calibration(std::string_view json, const Robot& robot, const std::string& source = "result");

/// Poses of the flange in the base frame at the joint values (joints x N), effects included. Throws InputError if an
/// effect needs measured torques that `signals` lacks.
std::vector<Eigen::Isometry3d> flange_poses(const SavedCalibration& saved, const Eigen::MatrixXd& joint_values,
                                            const DriveSignals& signals = {});

}  // namespace kdl_calibration
