#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// What a result says of the robot: enough for every prediction of the calibrated arm, without a fit.
struct SavedCalibration {
  ErrorModel model;   ///< with the effects that were estimated
  Estimate estimate;  ///< base and targets: identity and none where the file does not have them
  Unknowns free;
  /// Of the columns of `free` in their order; infinite variance where not determined; empty where the
  /// file has none.
  Eigen::MatrixXd covariance;
  bool trusted = false;
  std::vector<Doubt> doubts;
};

/// Reads what calibrate wrote (result_json) for this robot. A file that names the hash of its URDF, its base or its tip
/// is refused with another robot: the errors of a robot that was corrected already would be applied twice.
/// Throws InputError: unreadable file, malformed JSON, a missing key or a value of another sort, a parameter that the
/// robot does not have, another robot, a member that is not as its hash says.
SavedCalibration load_calibration(const std::filesystem::path& result, const Robot& robot);
SavedCalibration parse_calibration(std::string_view json, const Robot& robot, const std::string& source = "result");

/// Poses of the flange in the base frame at the joint values (joints x N), effects included. Throws InputError where
/// some of these are functions of measured torques and `signals` has none.
std::vector<Eigen::Isometry3d> flange_poses(const SavedCalibration& saved, const Eigen::MatrixXd& joint_values,
                                            const DriveSignals& signals = {});

}  // namespace kdl_calibration
