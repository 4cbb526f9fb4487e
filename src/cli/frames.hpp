#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration::cli {

using Json = nlohmann::ordered_json;

/// Throws InputError naming file and line where the file cannot be read or is no JSON.
Json read_json(const std::filesystem::path& file);

/// X_WB of {"position": […], "quaternion_wxyz": […]}, or of the "base" of a result or a truth.
Eigen::Isometry3d read_base(const std::filesystem::path& file);

/// "targets": [{"name", "position"[, "quaternion_wxyz"]}] in the flange frame, of a result or a truth as well.
std::vector<TargetFrame> read_targets(const std::filesystem::path& file);

/// The errors of the model's parameters in a result or a truth; zero for those that it does not name.
Eigen::VectorXd read_errors(const std::filesystem::path& file, const ErrorModel& model);

/// [x, y, z]
Json position_json(const Eigen::Vector3d& position);
/// {"position": […], "quaternion_wxyz": […]}
Json frame_json(const Eigen::Isometry3d& frame);
/// {"name", "position"[, "quaternion_wxyz"]}
Json target_json(const TargetFrame& target);

/// Indented, with a line break at the end; text that is not UTF-8 is replaced rather than refused.
std::string json_text(const Json& json);

}  // namespace kdl_calibration::cli
