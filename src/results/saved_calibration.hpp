#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/json_tree.hpp"
#include "calibration/calibration_result.hpp"
#include "calibration/point_predictor.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// What a Calibration holds, whether it was fitted or read from a file. Files of version 0.1 and truth files hold a
/// part of it: without a base it is the identity, without a covariance that is empty.
struct CalibrationParts : PredictionBasis {
  Verdict verdict = Verdict::not_trusted;
  std::vector<Doubt> doubts;  ///< with the reservation
  std::vector<std::string> warnings;
  std::vector<Remark> remarks;  ///< whose messages are the warnings; empty if the file states no causes
  Accuracy accuracy;
  std::vector<ParameterEstimate> parameters;
  Eigen::MatrixXd shifts;          ///< see Uncertainty; empty: unknown
  Eigen::VectorXd urdf_errors;     ///< of the exported URDF
  bool continues_earlier = false;  ///< whether an earlier result was its prior
  std::string robot;               ///< hash_of
  std::string measurements;        ///< hash_of; of the file of measurements if this was read from a file
  std::shared_ptr<const CalibrationResult> fitted;  ///< null if it was read from a file
};

/// Hash of the URDF, base and tip.
std::string hash_of(const Robot& robot);

/// Reads a result of calibrate (result_json). If the file states its URDF's hash, base or tip, another robot is
/// refused: errors must not be applied twice to a corrected URDF. Throws InputError: unreadable file, malformed JSON, a
/// missing key, a value of the wrong type, a parameter unknown to the robot, another robot, a member that does not
/// match its hash, an effect of a program's own that is not among `own`.
CalibrationParts read_calibration(const std::filesystem::path& result, const Robot& robot,
                                  std::span<const OwnEffect> own = {});
CalibrationParts parse_calibration(std::string_view json, const Robot& robot, const std::string& source = "result",
                                   std::span<const OwnEffect> own = {});

/// {"name", "position"}, and "quaternion_wxyz" if its orientation is measured.
TargetFrame target_of(const tree::Node& node);

}  // namespace kdl_calibration
