#include "kdl_calibration/saved_calibration.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <set>
#include <utility>

#include "base/json_tree.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "kdl_calibration/input_error.hpp"
#include "results/effects_json.hpp"

namespace kdl_calibration {
namespace {

using tree::elements;
using tree::has;
using tree::member;
using tree::Node;
using tree::number;

void require_same_robot(const Node& top, const Robot& robot) {
  if (!has(top, "input")) {
    return;
  }
  const Node input = member(top, "input");
  if (has(input, "sha256") && tree::name(member(input, "sha256")) != sha256(robot.urdf)) {
    throw InputError(top.where + ": was not made with " + robot.source +
                     ": its hash is another one; expected the URDF that was calibrated, not a corrected one");
  }
  for (const auto& [key, link] : {std::pair{"base", robot.base}, std::pair{"tip", robot.tip}}) {
    if (has(input, key) && tree::name(member(input, key)) != link) {
      throw InputError(top.where + ": input: " + key + " is '" + tree::name(member(input, key)) +
                       "', expected that of this robot, '" + link + "'");
    }
  }
}

std::vector<TargetFrame> targets_of(const Node& top) {
  std::vector<TargetFrame> targets;
  for (const Node& node : elements(member(top, "targets"))) {
    TargetFrame target;
    target.name = tree::name(member(node, "name"));
    target.X_FT.translation() = tree::numbers<3>(member(node, "position"));
    target.with_orientation = has(node, "quaternion_wxyz");
    if (target.with_orientation) {
      target.X_FT.linear() = tree::quaternion(member(node, "quaternion_wxyz")).toRotationMatrix();
    }
    targets.push_back(target);
  }
  return targets;
}

// Consistency check for files without hashes, such as a truth or a result of version 0.1.0.
void require_sound(const Node& parameter, double error, bool is_angle) {
  constexpr double kRounding = 1e-9;
  constexpr double kTurn = 2.0 * std::numbers::pi;
  if (is_angle && std::abs(error) > kTurn) {
    fail(member(parameter, "error"), "an angle of at most a turn, in radians");
  }
  if (has(parameter, "value") && has(parameter, "nominal") &&
      !(std::abs(number(member(parameter, "value")) - number(member(parameter, "nominal")) - error) <= kRounding)) {
    fail(member(parameter, "value"), "the sum of \"nominal\" and \"error\"");
  }
}

void read_parameters(const Node& top, SavedCalibration& saved) {
  saved.estimate.errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(saved.model.parameters.size()));
  std::set<std::string> names;
  for (const Node& node : elements(member(top, "parameters"))) {
    const std::string name = tree::name(member(node, "name"));
    if (name.find('.') != std::string::npos) {  // base and targets are in separate blocks
      continue;
    }
    const auto known = std::find_if(saved.model.parameters.begin(), saved.model.parameters.end(),
                                    [&](const ErrorParameter& parameter) { return parameter.name == name; });
    if (known == saved.model.parameters.end()) {
      throw InputError(node.where + ": this robot has no parameter '" + name +
                       "', expected the result of the same URDF, base and tip");
    }
    if (!names.insert(name).second) {
      throw InputError(node.where + ": parameter '" + name + "' is there twice, expected each once");
    }
    const double error = number(member(node, "error"));
    if (!has(top, "hashes")) {
      require_sound(node, error, !is_length(saved.model, *known));
    }
    saved.estimate.errors[known - saved.model.parameters.begin()] = error;
  }
  if (has(top, "effects")) {
    SavedEffects effects = read_effects(member(top, "effects"), saved.model);
    saved.model.gravity = effects.gravity;
    saved.model.effects = std::move(effects.terms);
    saved.estimate.effects = std::move(effects.values);
  }
}

// {"names": […], "lower_triangle": [[…], …]}; null is an infinite variance.
void read_covariance(const Node& block, SavedCalibration& saved) {
  std::vector<std::string> names;
  for (const Node& node : elements(member(block, "names"))) {
    names.push_back(tree::name(node));
  }
  saved.free = Unknowns(saved.model, saved.estimate.targets, names);
  if (saved.free.names() != names) {
    fail(member(block, "names"), "the parameters in the order base, geometry, effects, targets");
  }
  const std::vector<Node> rows = elements(member(block, "lower_triangle"));
  const auto size = static_cast<Eigen::Index>(names.size());
  if (rows.size() != names.size()) {
    fail(member(block, "lower_triangle"), "a row for each name");
  }
  saved.covariance.resize(size, size);
  for (Eigen::Index r = 0; r < size; ++r) {
    const std::vector<Node> row = elements(rows[static_cast<std::size_t>(r)]);
    if (static_cast<Eigen::Index>(row.size()) != r + 1) {
      fail(rows[static_cast<std::size_t>(r)], std::to_string(r + 1) + " numbers");
    }
    for (Eigen::Index c = 0; c <= r; ++c) {
      const Node& value = row[static_cast<std::size_t>(c)];
      const double read = value.json.is_null() ? std::numeric_limits<double>::infinity() : number(value);
      if (r == c && read < 0.0) {
        fail(value, "a variance, 0 or more");
      }
      saved.covariance(r, c) = saved.covariance(c, r) = read;
    }
  }
}

}  // namespace

SavedCalibration parse_calibration(std::string_view json, const Robot& robot, const std::string& source) {
  const tree::Json document = tree::parsed(json, source);
  const Node top{.json = document, .where = source};
  require_same_robot(top, robot);
  SavedCalibration saved;
  saved.model = complete_model(robot);
  read_parameters(top, saved);
  if (has(top, "base")) {
    const Node base = member(top, "base");
    saved.estimate.X_WB.translation() = tree::numbers<3>(member(base, "position"));
    saved.estimate.X_WB.linear() = tree::quaternion(member(base, "quaternion_wxyz")).toRotationMatrix();
  }
  if (has(top, "targets")) {
    saved.estimate.targets = targets_of(top);
  }
  if (has(top, "covariance") && !member(top, "covariance").json.is_null()) {
    read_covariance(member(top, "covariance"), saved);
  }
  saved.trusted = has(top, "trusted") && tree::truth(member(top, "trusted"));
  if (has(top, "doubts") && !member(top, "doubts").json.empty()) {
    for (const Node& doubt : elements(member(top, "doubts"))) {
      const std::string name = tree::name(member(doubt, "cause"));
      const std::optional<Cause> cause = cause_named(name);
      if (!cause) {
        throw InputError(doubt.where + ": cause: " + shown(name) + " is unknown, expected one that calibrate writes");
      }
      saved.doubts.push_back({.cause = *cause, .message = tree::name(member(doubt, "message"))});
    }
    if (saved.trusted) {
      fail(member(top, "trusted"), "false, as there are doubts");
    }
  }
  return saved;
}

SavedCalibration load_calibration(const std::filesystem::path& result, const Robot& robot) {
  return parse_calibration(read_text_file(result), robot, result.string());
}

std::vector<Eigen::Isometry3d> flange_poses(const SavedCalibration& saved, const Eigen::MatrixXd& joint_values,
                                            const DriveSignals& signals) {
  return flange_poses(saved.model, saved.estimate, joint_values, signals);
}

}  // namespace kdl_calibration
