#include "interface/touched_frames.hpp"

#include <fmt/core.h>
#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/subcommands.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {
namespace {

using Eigen::Index;

struct FramesArguments {
  RobotArguments robot;
  std::string result;
  std::string tool_touches;
  std::string user_touches;
  std::string frames;
  std::string joint_convention;
  std::string output;
  bool force = false;
  bool json = false;
};

// The joint values of each row of the file.
Eigen::MatrixXd of_rows(const Measurements& touches) {
  std::vector<Index> columns;
  for (const Observation& touch : touches.observations) {
    columns.push_back(touch.configuration);
  }
  return touches.joint_values(Eigen::all, columns);
}

// The coordinates in the rows; none if all are zero, as without these columns.
Matrix3Xd points_of(const Measurements& touches) {
  Matrix3Xd points(3, static_cast<Index>(touches.observations.size()));
  for (Index i = 0; i < points.cols(); ++i) {
    points.col(i) = touches.observations[static_cast<std::size_t>(i)].position;
  }
  return points.isZero(0.0) ? Matrix3Xd() : points;
}

FrameTouches touches_of(const FramesArguments& arguments, const Robot& robot) {
  if (arguments.tool_touches.empty() && arguments.user_touches.empty()) {
    throw InputError("no touches, expected --tool-touches or --user-touches");
  }
  FrameTouches touches;
  if (!arguments.frames.empty()) {
    touches.X_FT = controller_frames_of(read_json(arguments.frames), arguments.frames).X_FT;
  }
  if (!arguments.tool_touches.empty()) {
    touches.tool = of_rows(configurations_of(robot, arguments.tool_touches, arguments.joint_convention));
  }
  if (!arguments.user_touches.empty()) {
    const Measurements rows = configurations_of(robot, arguments.user_touches, arguments.joint_convention);
    touches.user = of_rows(rows);
    touches.user_points = points_of(rows);
  }
  return touches;
}

Json std_json(const Eigen::VectorXd& std) {
  Json list = Json::array();
  for (const double sigma : std) {
    list.push_back(std::isfinite(sigma) ? Json(sigma) : Json());
  }
  return list;
}

Json touched_json(const TouchedFrame& found) {
  Json json = frame_json(found.frame);
  json.update({{"std", std_json(found.std)}, {"rms", found.rms}, {"largest", found.largest}});
  return json;
}

Json touched_json(const TouchedFrames& found, const std::string& result) {
  Json json = Json::object();
  if (found.tool) {
    json["tool"] = touched_json(*found.tool);
  }
  if (found.user) {
    json["user"] = touched_json(*found.user);
  }
  json["touch_sigma"] = found.touch_sigma ? Json(*found.touch_sigma) : Json();
  json["calibration"] = result.empty() ? Json() : Json(sha256_of_file(result));
  return json;
}

// A line of three numbers in `unit` and their 1 sigma.
std::string numbers_row(const std::string& name, const Eigen::Vector3d& values,
                        const Eigen::Ref<const Eigen::VectorXd>& std, double unit) {
  constexpr std::size_t kWidth = 24;
  std::string text = padded(name, kWidth);
  for (const double value : values) {
    text += fmt::format("{:>12}", fixed(value / unit, 4));
  }
  for (const double sigma : std) {
    text += fmt::format("{:>10}", std::isfinite(sigma) ? fixed(sigma / unit, 4) : "unknown");
  }
  return text + "\n";
}

std::string table(const TouchedFrames& found) {
  constexpr double kMillimetre = 1e-3;
  std::string text = "frame                              x           y           z   std x     std y     std z\n";
  const auto add = [&](const std::string& name, const TouchedFrame& frame) {
    text += numbers_row(name + " origin [mm]", frame.frame.translation(), frame.std.head<3>(), kMillimetre);
    if (frame.std.size() == 6) {
      double roll = 0.0;
      double pitch = 0.0;
      double yaw = 0.0;
      to_kdl(frame.frame).M.GetRPY(roll, pitch, yaw);
      text += numbers_row(name + " roll pitch yaw [deg]", {roll, pitch, yaw}, frame.std.tail<3>(), kDegree);
    }
    text += name + ": the touches are off by " + fixed(frame.rms * 1e3, 4) + " mm (rms), at most " +
            fixed(frame.largest * 1e3, 4) + " mm\n";
  };
  if (found.tool) {
    add("tool", *found.tool);
  }
  if (found.user) {
    add("user", *found.user);
  }
  return text;
}

ExitStatus run(const FramesArguments& arguments) {
  std::vector<OutputFile> files = {{.option = "--output", .path = arguments.output, .text = {}}};
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.robot);
  const PredictionBasis basis =
      arguments.result.empty() ? nominal_basis(robot) : PredictionBasis(read_result(arguments.result, robot));
  const TouchedFrames found = touched_frames(basis, touches_of(arguments, robot));
  files.front().text = json_text(touched_json(found, arguments.result));
  write_whole(files, arguments.force, arguments.json ? files.front().text : table(found));
  return done;
}

}  // namespace

Subcommand add_frames(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand(
      "frames",
      "Tool and user frame from points that the robot touched\nWith the calibrated robot, so that compensated "
      "poses are right in them. Without --result it is the ordinary calibration of a tool.");
  const auto arguments = std::make_shared<FramesArguments>();
  add_robot_options(*app, arguments->robot);
  add_file(*app, "--result", arguments->result, "The result that calibrate wrote (JSON) [the nominal robot]");
  add_file(*app, "--tool-touches", arguments->tool_touches,
           "Joint values at which the tool's tip touches one point, in at least four orientations (CSV)");
  add_file(*app, "--user-touches", arguments->user_touches,
           "Joint values at which the tip touches points of the user frame (CSV): with their coordinates x, y, z, or "
           "the origin, a point on the x axis, and points in the x-y plane with y above 0");
  add_file(*app, "--frames", arguments->frames,
           "The tool, where it is known: JSON as written by --output [the flange]");
  add_file(*app, "--joint-convention", arguments->joint_convention,
           "Joint values are the controller's, which this file turns into the URDF's");
  add_file(*app, "--output", arguments->output, "Write the frames for compensate --frames (JSON)")->required();
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_json_flag(*app, arguments->json);
  add_example(
      *app,
      "kdlcal frames --result result.json --tool-touches tip.csv --user-touches fixture.csv --output frames.json");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
