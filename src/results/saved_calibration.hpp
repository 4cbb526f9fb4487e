#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "calibration/point_predictor.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// A calibration as read from a result file. Files of version 0.1 and truth files hold a part of it: without a base it
/// is the identity, without a covariance that is empty.
struct SavedCalibration : PredictionBasis {
  Verdict verdict = Verdict::not_trusted;
  std::vector<Doubt> doubts;  ///< with the reservation
  std::vector<std::string> warnings;
  Accuracy accuracy;
  std::vector<ParameterEstimate> parameters;
  Eigen::VectorXd urdf_errors;     ///< of the exported URDF
  bool continues_earlier = false;  ///< whether an earlier result was its prior
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
