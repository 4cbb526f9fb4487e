#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/csv.hpp"
#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/parallel.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/progress.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/result_file.hpp"
#include "measurements/replaced_joints.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

using Eigen::Index;

constexpr std::string_view kCompensated = "# compensated ";
constexpr std::array kStatuses = {CompensationStatus::exact, CompensationStatus::position_only,
                                  CompensationStatus::unreachable, CompensationStatus::out_of_limits,
                                  CompensationStatus::branch_changed};

struct CompensateArguments {
  RobotArguments robot;
  std::string result;
  std::string joints;
  std::string joint_convention;
  double most_change = 5.0;
  std::string output;
  bool force = false;
  bool json = false;
};

void require_not_compensated(const std::string& file) {
  LineReader lines(file);
  std::string_view first;
  if (lines.next(first) && first.starts_with(kCompensated)) {
    throw InputError(file + ":1: these joint values are compensated already, expected those of the program");
  }
}

std::vector<CompensatedPoint> compensated(const Compensator& compensator, const Eigen::MatrixXd& joint_values) {
  constexpr std::size_t kAtOnce = 8192;
  constexpr std::size_t kBlock = 64;
  const auto count = static_cast<std::size_t>(joint_values.cols());
  std::vector<CompensatedPoint> points(count);
  Progress progress("compensating");
  for (std::size_t first = 0; first < count; first += kAtOnce) {
    parallel_blocks(std::min(kAtOnce, count - first), kBlock, 0, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = first + begin; i < first + end; ++i) {
        points[i] = compensator.solve(joint_values.col(static_cast<Index>(i)));
      }
    });
    progress(static_cast<double>(std::min(first + kAtOnce, count)) / static_cast<double>(count));
  }
  return points;
}

struct Compensated {
  const Robot& robot;
  const Measurements& asked;
  std::vector<CompensatedPoint> points;

  Eigen::MatrixXd joint_values() const {
    Eigen::MatrixXd values(asked.joint_values.rows(), asked.joint_values.cols());
    for (std::size_t i = 0; i < points.size(); ++i) {
      values.col(static_cast<Index>(i)) = points[i].joint_values;
    }
    return values;
  }

  long count(CompensationStatus status) const {
    return std::count_if(points.begin(), points.end(),
                         [&](const CompensatedPoint& point) { return point.status == status; });
  }

  double largest(double CompensatedPoint::*error) const {
    double result = 0.0;
    for (const CompensatedPoint& point : points) {
      result = std::max(result, point.*error);
    }
    return result;
  }
};

std::string json(const Compensated& result, const Eigen::VectorXd& changes) {
  Json statuses = Json::object();
  for (const CompensationStatus status : kStatuses) {
    statuses[to_string(status)] = result.count(status);
  }
  Json joints = Json::array();
  for (const std::size_t i : independent_joints(result.robot.joints)) {
    joints.push_back({{"joint", result.robot.joints[i].name}, {"change", changes[static_cast<Index>(i)]}});
  }
  Json inexact = Json::array();
  for (std::size_t i = 0; i < result.points.size(); ++i) {
    const CompensatedPoint& point = result.points[i];
    if (point.status != CompensationStatus::exact) {
      inexact.push_back({{"configuration", result.asked.configurations[i]},
                         {"status", to_string(point.status)},
                         {"position_error", point.position_error},
                         {"orientation_error", point.orientation_error}});
    }
  }
  return json_text({{"points", result.points.size()},
                    {"status", statuses},
                    {"largest_change", joints},
                    {"largest_position_error", result.largest(&CompensatedPoint::position_error)},
                    {"largest_orientation_error", result.largest(&CompensatedPoint::orientation_error)},
                    {"not_exact", inexact}});
}

std::string off(double position, double orientation) {
  return fixed(position * 1e3, 4) + " mm and " + fixed(orientation * 1e3, 4) + " mrad";
}

std::string table(const Compensated& result, const Eigen::VectorXd& changes) {
  constexpr std::size_t kWidth = 24;
  constexpr int kMostLines = 10;
  std::string text = padded("status", kWidth) + "  points\n";
  for (const CompensationStatus status : kStatuses) {
    text += padded(to_string(status), kWidth) + fmt::format("{:>8}\n", result.count(status));
  }
  text += padded("joint", kWidth) + "  largest change\n";
  for (const std::size_t i : independent_joints(result.robot.joints)) {
    const MovingJoint& joint = result.robot.joints[i];
    const double change = changes[static_cast<Index>(i)];
    const bool slides = joint.type == JointType::prismatic;
    text += padded(joint.name, kWidth) +
            fmt::format("{:>12} {}\n", fixed(slides ? change * 1e3 : change / kDegree, 4), slides ? "mm" : "deg");
  }
  text += "remaining error of the flange: at most " +
          off(result.largest(&CompensatedPoint::position_error), result.largest(&CompensatedPoint::orientation_error)) +
          "\n";
  int lines = 0;
  for (std::size_t i = 0; i < result.points.size() && lines <= kMostLines; ++i) {
    const CompensatedPoint& point = result.points[i];
    if (point.status != CompensationStatus::exact) {
      text += ++lines > kMostLines
                  ? "further ones: --json lists all\n"
                  : "configuration " + shown(result.asked.configurations[i]) + ": " + to_string(point.status) +
                        ", off by " + off(point.position_error, point.orientation_error) + "\n";
    }
  }
  return text;
}

ExitStatus run(const CompensateArguments& arguments) {
  std::vector<OutputFile> files = {{.option = "--output", .path = arguments.output, .text = {}}};
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.robot);
  const Compensator compensator(load_calibration(arguments.result, robot),
                                {.most_change = arguments.most_change * kDegree});
  require_not_compensated(arguments.joints);
  const std::optional<JointConvention> convention = convention_of(arguments.joint_convention);
  const JointConvention* used = convention ? &*convention : nullptr;
  const Measurements asked = read_configurations(robot, arguments.joints, used);
  const Compensated result{.robot = robot, .asked = asked, .points = compensated(compensator, asked.joint_values)};
  const Eigen::MatrixXd commanded = result.joint_values();
  files.front().text = std::string(kCompensated) + sha256_of_file(arguments.result) + "\n" +
                       with_joint_values(robot, arguments.joints, used, asked, commanded);
  const Eigen::VectorXd changes = (commanded - asked.joint_values).cwiseAbs().rowwise().maxCoeff();
  write_whole(files, arguments.force, arguments.json ? json(result, changes) : table(result, changes));
  return result.count(CompensationStatus::exact) == static_cast<long>(result.points.size()) ? done : not_to_be_trusted;
}

}  // namespace

Subcommand add_compensate(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand(
      "compensate",
      "Joint values that bring the real robot where the program's values mean\n"
      "Poses stand between base and flange of the result: find user and tool frames with the calibrated robot. Leave "
      "points alone that were touched up on the robot: their joint values are right already.");
  const auto arguments = std::make_shared<CompensateArguments>();
  add_robot_options(*app, arguments->robot);
  add_file(*app, "--result", arguments->result, "The result that calibrate wrote (JSON)")->required();
  add_file(*app, "--joints", arguments->joints, "Joint values of the program: a CSV file as for calibrate --predict-at")
      ->required();
  add_file(*app, "--joint-convention", arguments->joint_convention,
           "Joint values are the controller's, which this file turns into the URDF's");
  app->add_option("--most-change", arguments->most_change,
                  "Largest change of a joint; a degree counts as 17.45 mm of a joint that slides")
      ->type_name("DEG")
      ->check(number_between(1e-6, 360.0, "degrees from 0.000001 to 360"))
      ->capture_default_str();
  add_file(*app, "--output", arguments->output, "Write the joint values to command, in the same columns (CSV)")
      ->required();
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_json_flag(*app, arguments->json);
  add_example(*app, "kdlcal compensate --result result.json --joints program.csv --output commands.csv");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
