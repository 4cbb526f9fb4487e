#include "cli/frames.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <set>

#include "base/json_tree.hpp"
#include "base/sha256.hpp"
#include "base/text_file.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/measurements_check.hpp"
#include "results/saved_calibration.hpp"

namespace kdl_calibration::cli {
namespace {

using tree::elements;
using tree::fail;
using tree::has;
using tree::member;
using tree::name;
using tree::Node;
using tree::number;
using tree::pose;

}  // namespace

Json json_of(std::string_view text, const std::string& source) { return tree::parsed(text, source); }

Eigen::Isometry3d base_of(const Json& json, const std::string& source) {
  const Node top{.json = json, .where = source};
  return pose(has(top, "base") ? member(top, "base") : top);
}

ControllerFrames controller_frames_of(const Json& json, const std::string& source) {
  const Node top{.json = json, .where = source};
  if (!has(top, "user") && !has(top, "tool")) {
    fail(top, "a frame \"user\" or \"tool\", as kdlcal frames writes them");
  }
  ControllerFrames frames;
  if (has(top, "user")) {
    frames.X_BU = pose(member(top, "user"));
  }
  if (has(top, "tool")) {
    frames.X_FT = pose(member(top, "tool"));
  }
  frames.found_with = found_with(json, source);
  return frames;
}

std::optional<std::string> found_with(const Json& json, const std::string& source) {
  const Node top{.json = json, .where = source};
  if (!has(top, "calibration")) {
    return std::nullopt;
  }
  const Node calibration = member(top, "calibration");
  return calibration.json.is_null() ? "" : name(calibration);
}

bool states_orientation(const Json& tool) {
  return !tool.contains("orientation") || tool["orientation"] != kNotMeasured;
}

void warn_if_not_turned(const Json& tool, const std::string& name, const std::string& frames) {
  if (!states_orientation(tool)) {
    warn(frames + ": " + name + " is turned as the flange, because touches find only its origin: if the controller's " +
         "is turned in another way, state it (kdlcal frames --frames)");
  }
}

void warn_if_found_with_another(const std::optional<std::string>& hash, const std::string& frames,
                                const std::string& result) {
  if (hash && *hash != sha256_of_file(result)) {
    warn(frames + " was found with " + (hash->empty() ? "the nominal robot" : "another result") +
         ": find user and tool frames with this calibration (kdlcal frames --result)");
  }
}

std::vector<TargetFrame> targets_of(const Json& json, const std::string& source) {
  const std::vector<Node> nodes = elements(member({.json = json, .where = source}, "targets"));
  if (nodes.size() > kMostTargets) {
    throw InputError(fmt::format("{}: targets: {}, expected at most {}", source, nodes.size(), kMostTargets));
  }
  std::vector<TargetFrame> targets;
  std::set<std::string> names;
  for (const Node& node : nodes) {
    const std::string target = name(member(node, "name"));
    if (!names.insert(target).second) {
      throw InputError(node.where + ": target '" + target + "' is there twice, expected each once");
    }
    targets.push_back(target_of(node));
  }
  return targets;
}

void require_same_nominal(const Json& json, const std::string& source, const ErrorModel& model) {
  constexpr double kRounding = 1e-9;  // [m]
  for (const Node& node : elements(member({.json = json, .where = source}, "parameters"))) {
    const std::string parameter = name(member(node, "name"));
    const auto known = std::find_if(model.parameters.begin(), model.parameters.end(),
                                    [&](const ErrorParameter& candidate) { return candidate.name == parameter; });
    if (known != model.parameters.end() && has(node, "nominal") &&
        std::abs(number(member(node, "nominal")) - known->nominal) > kRounding) {
      throw InputError(node.where + ": nominal " + node.json["nominal"].dump() + " of '" + parameter + "' is " +
                       Json(known->nominal).dump() + " in this URDF, expected the URDF, base and tip that " +
                       "the file comes from");
    }
  }
}

std::vector<std::optional<std::pair<double, double>>> ranges_of(const Json& json, const std::string& source,
                                                                const ErrorModel& model) {
  std::vector<std::optional<std::pair<double, double>>> ranges(model.joints.size());
  const Node top{.json = json, .where = source};
  if (!has(top, "joint_ranges")) {
    return ranges;
  }
  for (const Node& node : elements(member(top, "joint_ranges"))) {
    const std::string joint = name(member(node, "joint"));
    const double lower = number(member(node, "lower"));
    const double upper = number(member(node, "upper"));
    if (!(lower <= upper)) {
      fail(node, "lower <= upper");
    }
    for (std::size_t i = 0; i < model.joints.size(); ++i) {
      if (model.joints[i].name == joint) {
        ranges[i] = {lower, upper};
      }
    }
  }
  return ranges;
}

Json read_json(const std::filesystem::path& file) { return json_of(read_text_file(file), file.string()); }

Eigen::Isometry3d read_base(const std::filesystem::path& file) { return base_of(read_json(file), file.string()); }

std::vector<TargetFrame> read_targets(const std::filesystem::path& file) {
  return targets_of(read_json(file), file.string());
}

Json position_json(const Eigen::Vector3d& position) { return Json{position.x(), position.y(), position.z()}; }

Json frame_json(const Eigen::Isometry3d& frame) {
  Eigen::Quaterniond q(frame.linear());
  q.normalize();
  if (q.w() < 0.0) {
    q.coeffs() *= -1.0;
  }
  return {{"position", position_json(frame.translation())}, {"quaternion_wxyz", Json{q.w(), q.x(), q.y(), q.z()}}};
}

Json target_json(const TargetFrame& target) {
  Json json = {{"name", target.name}};
  json.update(target.with_orientation ? frame_json(target.X_FT)
                                      : Json{{"position", position_json(target.X_FT.translation())}});
  return json;
}

std::string json_text(const Json& json) { return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n"; }

}  // namespace kdl_calibration::cli
