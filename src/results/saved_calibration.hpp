#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "calibration/new_point.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// A calibration as read from a result file. Files of version 0.1 and truth files hold a part of it.
struct SavedCalibration {
  ErrorModel model;   ///< with the effects that were estimated
  Estimate estimate;  ///< base identity and no targets if the file has none
  Unknowns free;
  /// Of the columns of `free` in their order; infinite variance if not determined; empty if the file has none.
  Eigen::MatrixXd covariance;
  Verdict verdict = Verdict::not_trusted;
  std::vector<Doubt> doubts;  ///< with the reservation
  std::vector<std::string> warnings;
  Accuracy accuracy;
  std::vector<ParameterEstimate> parameters;
  Unknowns candidates;
  Eigen::MatrixXd undetermined;  ///< candidates x directions that the measurements do not determine
  NewPointNoise noise;
  MeasuredRegion region;
  Eigen::VectorXd urdf_errors;  ///< of the exported URDF

  bool trusted() const { return verdict != Verdict::not_trusted; }
};

/// Reads a result of calibrate (result_json). If the file states its URDF's hash, base or tip, another robot is
/// refused: errors must not be applied twice to a corrected URDF. Throws InputError: unreadable file, malformed JSON, a
/// missing key, a value of the wrong type, a parameter unknown to the robot, another robot, a member that does not
/// match its hash.
SavedCalibration read_calibration(const std::filesystem::path& result, const Robot& robot);
SavedCalibration parse_calibration(std::string_view json, const Robot& robot, const std::string& source = "result");

/// Poses of the flange in the base frame at the joint values (joints x N), effects included. Throws InputError if an
/// effect needs measured torques that `signals` lacks.
std::vector<Eigen::Isometry3d> flange_poses(const SavedCalibration& saved, const Eigen::MatrixXd& joint_values,
                                            const DriveSignals& signals = {});

}  // namespace kdl_calibration
