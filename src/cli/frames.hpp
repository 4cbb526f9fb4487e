#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration::cli {

using Json = nlohmann::ordered_json;

/// JSON text; `source` names it in messages. Throws InputError naming source and line if it is not JSON.
Json json_of(std::string_view text, const std::string& source);

/// X_WB of {"position": […], "quaternion_wxyz": […]}, or of the "base" of a result or a truth.
Eigen::Isometry3d base_of(const Json& json, const std::string& source);

/// Frames of a controller, as `kdlcal frames` writes them.
struct ControllerFrames {
  Eigen::Isometry3d X_BU = Eigen::Isometry3d::Identity();  ///< the user frame in the base
  Eigen::Isometry3d X_FT = Eigen::Isometry3d::Identity();  ///< the tool on the flange
  std::optional<std::string> found_with;  ///< hash of the result, empty for the nominal robot; none if not stated
};
/// {"user": frame, "tool": frame, "calibration": hash or null}; at least one of the frames.
ControllerFrames controller_frames_of(const Json& json, const std::string& source);
/// ControllerFrames::found_with
std::optional<std::string> found_with(const Json& json, const std::string& source);
/// Of a tool whose origin alone was touched: its orientation in the file is that of flange or faceplate.
inline constexpr const char* kNotMeasured = "not measured";
/// Whether the tool of a file has an orientation of its own.
bool states_orientation(const Json& tool);
/// Warns if the tool has such an orientation. `name`: "tool", "UTOOL 1".
void warn_if_not_turned(const Json& tool, const std::string& name, const std::string& frames);

/// Warns if `hash` is stated and not that of the result: frames and program belong to one calibration.
void warn_if_found_with_another(const std::optional<std::string>& hash, const std::string& frames,
                                const std::string& result);

/// "targets": [{"name", "position"[, "quaternion_wxyz"]}] in the flange frame; a result or a truth has this key too.
std::vector<TargetFrame> targets_of(const Json& json, const std::string& source);

/// Throws InputError if a parameter's "nominal" differs from the model's: the file is of another robot.
void require_same_nominal(const Json& json, const std::string& source, const ErrorModel& model);

/// "joint_ranges": [{"joint", "lower", "upper"}] [rad] or [m] of a truth; empty for joints that it does not name.
std::vector<std::optional<std::pair<double, double>>> ranges_of(const Json& json, const std::string& source,
                                                                const ErrorModel& model);

/// JSON from a file of at most 64 MiB.
Json read_json(const std::filesystem::path& file);
Eigen::Isometry3d read_base(const std::filesystem::path& file);
std::vector<TargetFrame> read_targets(const std::filesystem::path& file);

/// [x, y, z]
Json position_json(const Eigen::Vector3d& position);
/// {"position": […], "quaternion_wxyz": […]}
Json frame_json(const Eigen::Isometry3d& frame);
/// {"name", "position"[, "quaternion_wxyz"]}
Json target_json(const TargetFrame& target);

/// Indented, with a line break at the end; bytes that are not UTF-8 are replaced.
std::string json_text(const Json& json);

}  // namespace kdl_calibration::cli
