#include "cli/cell_options.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "base/degree.hpp"
#include "base/number_range.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "model/parameters.hpp"
#include "robot/joint_ranges.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

[[noreturn]] void refuse(const std::string& option, const std::string& text, const std::string& expected) {
  throw InputError(option + ": '" + text + "' is out of place, expected " + expected);
}

// The frame with its axes exactly along those of the base.
Eigen::Isometry3d with_right_angles(const Eigen::Isometry3d& X_BW) {
  constexpr double kTurned = 1e-6;  // [rad]
  Eigen::Isometry3d result = X_BW;
  result.linear() = X_BW.linear().array().round().matrix();
  if ((result.linear() - X_BW.linear()).cwiseAbs().maxCoeff() > kTurned || result.linear()(2, 2) < 0.5) {
    throw InputError(
        "--frame: the controller's world is turned against the base by more than right angles about z, and boxes would "
        "be too, expected --frame base");
  }
  return result;
}

Box moved(const Eigen::Isometry3d& X_BW, const Box& box) {
  const Eigen::Vector3d a = X_BW * box.lower;
  const Eigen::Vector3d b = X_BW * box.upper;
  return {.lower = a.cwiseMin(b), .upper = a.cwiseMax(b)};
}

Box box(const std::string& option, const std::string& text) {
  const std::string expected = "xmin,ymin,zmin,xmax,ymax,zmax in metres";
  const std::vector<double> v = numbers(option, text, 6, expected);
  Box result{.lower = {v[0], v[1], v[2]}, .upper = {v[3], v[4], v[5]}};
  if (!(result.lower.array() <= result.upper.array()).all()) {
    refuse(option, text, expected);
  }
  return result;
}

// A named value: weights. q + offset.
struct Named {
  std::string name;
  Eigen::VectorXd weights;
  double offset = 0.0;
};

// The controller's names come first: a name used on both sides means the controller's value, as in files.
std::vector<Named> named_values(const Robot& robot, const JointConvention* convention) {
  const auto count = static_cast<Eigen::Index>(robot.joints.size());
  std::vector<Named> result;
  if (convention != nullptr) {
    const std::vector<std::size_t> independent = independent_joints(robot.joints);
    const Eigen::MatrixXd inverse = convention->matrix.inverse();
    const Eigen::VectorXd offset = -inverse * convention->offset;
    for (Eigen::Index i = 0; i < inverse.rows(); ++i) {
      Eigen::VectorXd weights = Eigen::VectorXd::Zero(count);
      weights(independent) = inverse.row(i).transpose();
      result.push_back({.name = convention->controller_joints[static_cast<std::size_t>(i)],
                        .weights = weights,
                        .offset = offset[i]});
    }
  }
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    if (const std::optional<Drive>& drive = robot.joints[i].drive) {
      result.push_back({.name = drive->name,
                        .weights = Eigen::VectorXd::Unit(count, static_cast<Eigen::Index>(i)) / drive->multiplier,
                        .offset = -drive->offset / drive->multiplier});
    }
  }
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {  // a follower's value is multiplier * its leader's + offset
    const Mimic itself{.leader = i};
    const Mimic& mimic = robot.joints[i].mimic ? *robot.joints[i].mimic : itself;
    result.push_back(
        {.name = robot.joints[i].name,
         .weights = mimic.multiplier * Eigen::VectorXd::Unit(count, static_cast<Eigen::Index>(mimic.leader)),
         .offset = mimic.offset});
  }
  return result;
}

// "joint_2+joint_3-joint_4": parsed with the longest matching name at each position.
std::optional<Named> sum_of(const std::vector<Named>& known, const std::string& text) {
  Named sum{.name = text, .weights = Eigen::VectorXd::Zero(known.front().weights.size())};
  std::string_view rest = text;
  while (!rest.empty()) {
    double sign = 1.0;
    if (rest.front() == '+' || rest.front() == '-') {
      sign = rest.front() == '-' ? -1.0 : 1.0;
      rest.remove_prefix(1);
    } else if (rest.size() != text.size()) {
      return std::nullopt;
    }
    const Named* longest = nullptr;
    for (const Named& candidate : known) {
      if (rest.substr(0, candidate.name.size()) == candidate.name &&
          (longest == nullptr || candidate.name.size() > longest->name.size())) {
        longest = &candidate;
      }
    }
    if (longest == nullptr) {
      return std::nullopt;
    }
    sum.weights += sign * longest->weights;
    sum.offset += sign * longest->offset;
    rest.remove_prefix(longest->name.size());
  }
  return sum;
}

double unit_of(const Robot& robot, const Eigen::VectorXd& weights, const std::string& text) {
  bool any_length = false;
  bool any_angle = false;
  for (Eigen::Index i = 0; i < weights.size(); ++i) {
    if (std::abs(weights[i]) > 1e-12) {
      (robot.joints[static_cast<std::size_t>(i)].type == JointType::prismatic ? any_length : any_angle) = true;
    }
  }
  if (any_length == any_angle) {
    refuse("--joint-range", text, "a sum of angles or of lengths");
  }
  return any_length ? 1e-3 : kDegree;
}

void add_joint_range(const Robot& robot, const std::vector<Named>& known, const std::string& text, Cell& cell) {
  const std::string expected = "NAME=lower:upper in degrees (mm for lengths), NAME a joint or a sum such as " +
                               known.front().name + "+" + known.back().name;
  const std::size_t equals = text.rfind('=');
  const std::optional<Named> sum =
      equals == std::string::npos || equals == 0 ? std::nullopt : sum_of(known, text.substr(0, equals));
  if (!sum) {
    refuse("--joint-range", text, expected);
  }
  const double unit = unit_of(robot, sum->weights, text);
  auto [lower, upper] = bounds("--joint-range", text, expected, equals + 1);
  lower *= unit;
  upper *= unit;
  Eigen::Index joint = 0;
  const double weight = sum->weights.cwiseAbs().maxCoeff(&joint);
  if (sum->weights.cwiseAbs().sum() > weight + 1e-12) {
    cell.sums.push_back(
        {.name = sum->name, .weights = sum->weights, .offset = sum->offset, .lower = lower, .upper = upper});
    return;
  }
  // The range of a single joint limits the sampling and rejects no samples.
  const auto [first, second] =
      std::minmax({(lower - sum->offset) / sum->weights[joint], (upper - sum->offset) / sum->weights[joint]});
  auto& range = cell.ranges[static_cast<std::size_t>(joint)];
  range = {std::max(range.first, first), std::min(range.second, second)};
  if (range.first > range.second) {
    refuse("--joint-range", text, "a range that the joint's limits and the other ranges leave open");
  }
}

Tracker tracker(const CellArguments& arguments, const Eigen::Isometry3d& X_BW) {
  const std::vector<double> p = numbers("--tracker", arguments.tracker, 3, "x,y,z in metres");
  Tracker result{.position = X_BW * Eigen::Vector3d(p[0], p[1], p[2])};
  if (!arguments.distance_range.empty()) {
    const auto [least, greatest] = bounds("--distance-range", arguments.distance_range, "least:greatest in metres");
    result.least_distance = std::max(0.0, least);
    result.greatest_distance = greatest;
  }
  if (arguments.acceptance_deg) {
    result.acceptance = *arguments.acceptance_deg * kDegree;
  }
  return result;
}

std::vector<Capsule> body(const CellArguments& arguments, const Robot& robot, const std::vector<TargetFrame>& targets) {
  const bool counts = arguments.clearance || arguments.arm_radius || !arguments.tracker.empty() ||
                      !arguments.out_spheres.empty() || !arguments.out_boxes.empty();
  if (!counts) {
    return {};
  }
  ArmBody body = arguments.arm_radius ? body_with_radius(robot, *arguments.arm_radius) : body_from_urdf(robot);
  body.without_shape.erase(std::remove(body.without_shape.begin(), body.without_shape.end(), robot.tip),
                           body.without_shape.end());
  if (!body.without_shape.empty()) {
    warn("links without boxes, cylinders or spheres are not kept clear of anything: " +
         comma_separated(body.without_shape) + "; --arm-radius gives all links a shape");
  }
  for (Capsule& capsule : tool_body(robot, targets, arguments.tool_radius)) {
    body.capsules.push_back(std::move(capsule));
  }
  return body.capsules;
}

void require_tracker(const CellArguments& arguments) {
  if (arguments.tracker.empty() && (!arguments.distance_range.empty() || arguments.acceptance_deg)) {
    throw InputError(std::string(arguments.acceptance_deg ? "--acceptance-angle" : "--distance-range") +
                     ": needs the tracker's position, expected --tracker x,y,z");
  }
}

}  // namespace

void add_cell_options(CLI::App& app, CellArguments& arguments) {
  const auto repeated = [&](const std::string& name, std::vector<std::string>& values, const std::string& help) {
    return app.add_option(name, values, help)->allow_extra_args(false);
  };
  const auto length = [&](const std::string& name, auto& value, const std::string& help) {
    return app.add_option(name, value, help)->type_name("M")->check(number_from(0.0, "a length in metres"));
  };
  add_word(app, "--frame", arguments.frame, {"base", "world"},
           "Where boxes, spheres, heights and the tracker are stated: base link of the URDF, or the controller's world "
           "[world with --joint-convention, else base]");
  repeated("--joint-range", arguments.joint_ranges,
           "Range of a joint or of a sum of joints in deg (mm), NAME=lower:upper; more than once [the limits]")
      ->type_name("RANGE");
  app.add_option("--box", arguments.box, "Targets stay in xmin,ymin,zmin,xmax,ymax,zmax (m, --frame)")
      ->type_name("BOX");
  app.add_option("--least-height", arguments.least_height, "Least z of the targets (m, --frame)")
      ->type_name("M")
      ->check(number_between(-1e6, kLargestNumber, "metres from -1e6 to 1e12"));
  length("--least-radius", arguments.least_radius, "Least distance of the targets from the first joint's axis");
  repeated("--keep-out-sphere", arguments.out_spheres,
           "Arm and targets keep out of x,y,z,radius (m, --frame); more than once")
      ->type_name("SPHERE");
  repeated("--keep-out-box", arguments.out_boxes,
           "Arm and targets keep out of xmin,ymin,zmin,xmax,ymax,zmax (m, --frame); more than once")
      ->type_name("BOX");
  length("--clearance", arguments.clearance, "Least distance between parts of the arm and the tool");
  length("--arm-radius", arguments.arm_radius, "The arm is this thick [the shapes in the URDF]");
  length("--tool-radius", arguments.tool_radius, "What carries the targets is this thick")->capture_default_str();
  app.add_option("--tracker", arguments.tracker, "The tracker stands at x,y,z (m, --frame) and sees every target")
      ->type_name("x,y,z");
  app.add_option("--distance-range", arguments.distance_range, "Distance of the targets from it, least:greatest in m")
      ->type_name("RANGE");
  app.add_option("--acceptance-angle", arguments.acceptance_deg,
                 "Largest angle between the beam and a target's facing direction, deg")
      ->type_name("DEG")
      ->check(number_between(0.0, 180.0, "degrees from 0 to 180"));
}

std::pair<double, double> bounds(const std::string& option, const std::string& text, const std::string& expected,
                                 std::size_t start) {
  const std::string range = text.substr(start);
  const std::size_t colon = range.find(':');
  if (colon == std::string::npos) {
    refuse(option, text, expected);
  }
  const auto bound = [&](const std::string& part, double none) {
    if (part.empty()) {
      return none;
    }
    const std::optional<double> value = parsed_number(part);
    if (!value) {
      refuse(option, text, expected);
    }
    return *value;
  };
  const double infinity = std::numeric_limits<double>::infinity();
  const std::pair<double, double> result{bound(range.substr(0, colon), -infinity),
                                         bound(range.substr(colon + 1), infinity)};
  if (!(result.first <= result.second)) {
    refuse(option, text, expected);
  }
  return result;
}

std::vector<double> numbers(const std::string& option, const std::string& text, std::size_t count,
                            const std::string& expected) {
  std::vector<double> values;
  for (std::size_t start = 0; start <= text.size();) {
    const std::size_t end = std::min(text.find(',', start), text.size());
    const std::optional<double> value = parsed_number(std::string_view(text).substr(start, end - start));
    if (!value) {
      refuse(option, text, expected);
    }
    values.push_back(*value);
    start = end + 1;
  }
  if (values.size() != count) {
    refuse(option, text, expected);
  }
  return values;
}

FacingTargets facing_targets_of(const Json& json, const std::string& source) {
  FacingTargets result{.targets = targets_of(json, source), .facing = {}};
  for (std::size_t k = 0; k < result.targets.size(); ++k) {
    const Json& target = json.at("targets").at(k);
    Eigen::Vector3d facing = Eigen::Vector3d::Zero();
    if (target.contains("facing")) {
      const Json& given = target.at("facing");
      const bool three = given.is_array() && given.size() == 3 &&
                         std::all_of(given.begin(), given.end(), [](const Json& v) { return v.is_number(); });
      if (three) {
        facing = {given[0].get<double>(), given[1].get<double>(), given[2].get<double>()};
      }
      if (!(facing.norm() > 0.0) || !facing.allFinite()) {
        throw InputError(
            fmt::format("{}: targets[{}]: facing: expected three numbers that are not all zero", source, k));
      }
    }
    result.facing.push_back(facing);
  }
  return result;
}

FacingTargets read_facing_targets(const std::string& file) { return facing_targets_of(read_json(file), file); }

namespace {

// Millimetres where metres are expected put a wall where it forbids nothing.
class NearRobot {
public:
  explicit NearRobot(const Robot& robot) : farthest_(std::max(20.0 * reach(complete_model(robot)), 100.0)) {}

  void require(const std::string& option, const std::string& text, double distance) const {
    if (!(distance <= farthest_)) {
      refuse(option, text, fmt::format("a place within {:.0f} m of the robot, in metres", farthest_));
    }
  }
  void require(const std::string& option, const std::string& text, const Box& box) const {
    require(option, text, Eigen::Vector3d::Zero().cwiseMax(box.lower).cwiseMin(box.upper).norm());
  }

private:
  double farthest_;  // [m]
};

}  // namespace

Cell cell(const CellArguments& arguments, const Robot& robot, const FacingTargets& targets,
          const JointConvention* convention, const Eigen::Isometry3d& X_BW) {
  require_tracker(arguments);
  const Eigen::Isometry3d frame = with_right_angles(X_BW);
  Cell cell;
  cell.ranges = limits_of(robot.joints);
  const std::vector<Named> known = named_values(robot, convention);
  for (const std::string& text : arguments.joint_ranges) {
    add_joint_range(robot, known, text, cell);
  }
  const NearRobot near(robot);
  if (!arguments.box.empty()) {
    cell.box = moved(frame, box("--box", arguments.box));
    near.require("--box", arguments.box, cell.box);
  }
  if (arguments.least_height) {
    near.require("--least-height", shortest(*arguments.least_height), std::abs(*arguments.least_height));
    cell.height = *arguments.least_height + frame.translation().z();
  }
  cell.radius = arguments.least_radius;
  for (const std::string& text : arguments.out_spheres) {
    const std::string expected = "x,y,z,radius in metres, the radius 0 or more";
    const std::vector<double> v = numbers("--keep-out-sphere", text, 4, expected);
    if (v[3] < 0.0) {
      refuse("--keep-out-sphere", text, expected);
    }
    cell.out_spheres.push_back({.center = frame * Eigen::Vector3d(v[0], v[1], v[2]), .radius = v[3]});
    near.require("--keep-out-sphere", text, cell.out_spheres.back().center.norm() - v[3]);
  }
  for (const std::string& text : arguments.out_boxes) {
    cell.out_boxes.push_back(moved(frame, box("--keep-out-box", text)));
    near.require("--keep-out-box", text, cell.out_boxes.back());
  }
  cell.body = body(arguments, robot, targets.targets);
  cell.clearance = arguments.clearance;
  if (!arguments.tracker.empty()) {
    cell.tracker = tracker(arguments, frame);
    near.require("--tracker", arguments.tracker, cell.tracker->position.norm());
  }
  cell.facing = targets.facing;
  return cell;
}

bool has_places(const CellArguments& arguments) {
  return !arguments.box.empty() || arguments.least_height || !arguments.out_spheres.empty() ||
         !arguments.out_boxes.empty() || !arguments.tracker.empty();
}

std::string places_text(const CellArguments& arguments, const Cell& cell, const std::string& base,
                        const Eigen::Isometry3d& X_BW) {
  if (!has_places(arguments)) {
    return {};
  }
  std::string text = "places are stated in    " + base + "\n";
  if (!X_BW.isApprox(Eigen::Isometry3d::Identity())) {
    const Eigen::Vector3d origin = X_BW.translation();
    const Eigen::Vector3d x = X_BW.linear().col(0);
    text = fmt::format(
        "places are stated in    the controller's world: its origin at {}, {}, {} m in {}, its x along {}{} there\n",
        fixed(origin.x(), 3), fixed(origin.y(), 3), fixed(origin.z(), 3), base, x.sum() < 0.0 ? "-" : "",
        std::abs(x.x()) > 0.5 ? "x" : "y");
  }
  const auto add = [&](const std::string& name, const Box& box) {
    text += fmt::format("{:<24}in {}: x {} to {}, y {} to {}, z {} to {} m\n", name, base, fixed(box.lower.x(), 3),
                        fixed(box.upper.x(), 3), fixed(box.lower.y(), 3), fixed(box.upper.y(), 3),
                        fixed(box.lower.z(), 3), fixed(box.upper.z(), 3));
  };
  if (!arguments.box.empty()) {
    add("box of the targets", cell.box);
  }
  if (cell.height) {
    text += fmt::format("{:<24}in {}: z {} m\n", "least height", base, fixed(*cell.height, 3));
  }
  for (std::size_t i = 0; i < cell.out_boxes.size(); ++i) {
    add(fmt::format("keep-out box {}", i + 1), cell.out_boxes[i]);
  }
  return text;
}

}  // namespace kdl_calibration::cli
