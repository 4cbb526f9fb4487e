#include "cli/frames.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "base/json_reading.hpp"
#include "base/number_range.hpp"
#include "base/text_file.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr double kQuaternionTolerance = 1e-3;

// A value inside a file, with the way to it for messages.
struct Node {
  const Json& json;
  std::string where;
};

[[noreturn]] void fail(const Node& node, const std::string& expected) {
  throw InputError(node.where + ": expected " + expected);
}

bool has(const Node& object, const std::string& key) { return object.json.is_object() && object.json.contains(key); }

Node member(const Node& object, const std::string& key) {
  if (!object.json.is_object()) {
    fail(object, "an object with the key \"" + key + "\"");
  }
  if (!object.json.contains(key)) {
    throw InputError(object.where + ": the key \"" + key + "\" is missing");
  }
  return {.json = object.json.at(key), .where = object.where + ": " + key};
}

std::vector<Node> elements(const Node& node) {
  if (!node.json.is_array() || node.json.empty()) {
    fail(node, "an array that is not empty");
  }
  std::vector<Node> result;
  for (std::size_t i = 0; i < node.json.size(); ++i) {
    result.push_back({.json = node.json[i], .where = node.where + "[" + std::to_string(i) + "]"});
  }
  return result;
}

double number(const Node& node) {
  if (!node.json.is_number() || !(std::abs(node.json.get<double>()) <= kLargestNumber)) {
    fail(node, "a finite number of at most 1e12");
  }
  return node.json.get<double>();
}

std::string name(const Node& node) {
  if (!node.json.is_string() || node.json.get<std::string>().empty()) {
    fail(node, "a name");
  }
  return node.json.get<std::string>();
}

template <int kSize>
Eigen::Matrix<double, kSize, 1> numbers(const Node& node) {
  if (!node.json.is_array() || node.json.size() != kSize) {
    fail(node, "an array of " + std::to_string(kSize) + " numbers");
  }
  Eigen::Matrix<double, kSize, 1> result;
  const std::vector<Node> nodes = elements(node);
  for (int i = 0; i < kSize; ++i) {
    result[i] = number(nodes[static_cast<std::size_t>(i)]);
  }
  return result;
}

Eigen::Quaterniond quaternion(const Node& node) {
  const Eigen::Vector4d wxyz = numbers<4>(node);
  if (!(std::abs(wxyz.norm() - 1.0) <= kQuaternionTolerance)) {
    fail(node, "a quaternion of norm 1");
  }
  return Eigen::Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]).normalized();
}

}  // namespace

Json json_of(std::string_view text, const std::string& source) {
  return parse_json<Json>(text, source, [](int, Json::parse_event_t, const Json&) {});
}

Eigen::Isometry3d base_of(const Json& json, const std::string& source) {
  const Node top{.json = json, .where = source};
  const Node base = has(top, "base") ? member(top, "base") : top;
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
  X_WB.translation() = numbers<3>(member(base, "position"));
  X_WB.linear() = quaternion(member(base, "quaternion_wxyz")).toRotationMatrix();
  return X_WB;
}

std::vector<TargetFrame> targets_of(const Json& json, const std::string& source) {
  constexpr std::size_t kMostTargets = 100;
  const std::vector<Node> nodes = elements(member({.json = json, .where = source}, "targets"));
  if (nodes.size() > kMostTargets) {
    throw InputError(source + ": targets: " + std::to_string(nodes.size()) + ", expected at most " +
                     std::to_string(kMostTargets));
  }
  std::vector<TargetFrame> targets;
  std::set<std::string> names;
  for (const Node& node : nodes) {
    TargetFrame target;
    target.name = name(member(node, "name"));
    if (!names.insert(target.name).second) {
      throw InputError(node.where + ": target '" + target.name + "' is there twice, expected each once");
    }
    target.X_FT.translation() = numbers<3>(member(node, "position"));
    target.with_orientation = has(node, "quaternion_wxyz");
    if (target.with_orientation) {
      target.X_FT.linear() = quaternion(member(node, "quaternion_wxyz")).toRotationMatrix();
    }
    targets.push_back(target);
  }
  return targets;
}

Eigen::VectorXd errors_of(const Json& json, const std::string& source, const ErrorModel& model) {
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  for (const Node& node : elements(member({.json = json, .where = source}, "parameters"))) {
    const std::string parameter = name(member(node, "name"));
    if (parameter.find('.') != std::string::npos) {  // of the base or a target
      continue;
    }
    const auto known = std::find_if(model.parameters.begin(), model.parameters.end(),
                                    [&](const ErrorParameter& candidate) { return candidate.name == parameter; });
    if (known == model.parameters.end()) {
      throw InputError(node.where + ": this robot has no parameter '" + parameter +
                       "', expected the result of the same URDF, base and tip");
    }
    errors[known - model.parameters.begin()] = number(member(node, "error"));
  }
  return errors;
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

Eigen::VectorXd read_errors(const std::filesystem::path& file, const ErrorModel& model) {
  return errors_of(read_json(file), file.string(), model);
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
