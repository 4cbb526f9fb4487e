#include "interface/touched_frames.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/plan_command.hpp"
#include "cli/robot_controller.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/controller.hpp"
#include "programs/pose_numbers.hpp"
#include "programs/program_language.hpp"

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
  std::string controller;
  int tool_number = 1;
  int user_number = 1;
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
    points.col(i) = touches.observations[static_cast<std::size_t>(i)].position();
  }
  return points.isZero(0.0) ? Matrix3Xd() : points;
}

// The language of the controller whose file of frames this is. JSON is the same in all of them.
const ProgramLanguage& language_of_frames(const std::string& file) {
  const std::vector<const ProgramLanguage*>& languages = program_languages();
  const auto of_companion = std::find_if(languages.begin(), languages.end(), [&](const ProgramLanguage* language) {
    return language->companion == lower_ending(file);  // $config.dat
  });
  return of_companion != languages.end() ? **of_companion : *languages.front();
}

struct KnownTool {
  Eigen::Isometry3d X_FT;
  bool is_turned = false;  // whether its orientation is known, too
};

// The tool of a file that kdlcal frames wrote, or that of --tool-number in a file of the controller. Without a file it
// has the orientation of flange or faceplate.
KnownTool known_tool(const FramesArguments& arguments, const Controller& controller) {
  if (arguments.frames.empty()) {
    return {.X_FT = arguments.controller.empty() ? Eigen::Isometry3d::Identity() : controller.X_FP};
  }
  const bool is_json = lower_ending(arguments.frames) == ".json";
  const Json json = is_json ? read_json(arguments.frames) : Json();
  if (is_json && (!json.is_object() || json.contains("tool") || !json.contains("tool_frames"))) {
    const Eigen::Isometry3d X_FT = controller_frames_of(json, arguments.frames).X_FT;
    return {.X_FT = X_FT, .is_turned = json.contains("tool") && states_orientation(json["tool"])};
  }
  const ProgramFrames frames = read_program_frames(arguments.frames, language_of_frames(arguments.frames));
  const std::string number = std::to_string(arguments.tool_number);
  const auto tool = frames.tool.find(number);
  if (tool == frames.tool.end()) {
    throw InputError(
        fmt::format("--frames: {} has no tool {}, expected that of --tool-number", arguments.frames, number));
  }
  return {.X_FT = controller.X_FP * tool->second,
          .is_turned = !is_json || states_orientation(json["tool_frames"][number])};
}

FrameTouches touches_of(const FramesArguments& arguments, const Robot& robot, const Eigen::Isometry3d& X_FT) {
  if (arguments.tool_touches.empty() && arguments.user_touches.empty() &&
      (arguments.result.empty() || arguments.controller.empty())) {
    throw InputError(
        "no touches, expected --tool-touches or --user-touches; or, for the targets of a calibration, --result and "
        "--controller");
  }
  FrameTouches touches{.tool = {}, .user = {}, .user_points = {}, .X_FT = X_FT};
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
  const auto or_null = [](const std::optional<double>& value) { return value ? Json(*value) : Json(); };
  json.update({{"std", std_json(found.std())}, {"rms", or_null(found.rms)}, {"largest", or_null(found.largest)}});
  return json;
}

// A frame as the controller numbers it: in its world, or on its faceplate.
struct PendantFrame {
  bool is_tool = false;
  int number = 0;
  std::string target;     // of the calibration; else it was touched
  bool is_turned = true;  // whether its orientation is known
  Eigen::Isometry3d frame;
  Eigen::VectorXd std;  // along and about the axes of world or faceplate

  std::string name() const { return fmt::format("{}[{}]", is_tool ? "UTOOL" : "UFRAME", number); }
};

// Target k as a tool. A point has the orientation of the faceplate.
TouchedFrame tool_of_target(const PredictionBasis& basis, std::size_t k, const Eigen::Isometry3d& X_FP) {
  const TargetFrame& target = basis.estimate.frames.targets[k];
  const Index size = target.with_orientation ? 6 : 3;
  TouchedFrame tool{.frame = target.X_FT, .covariance = Eigen::MatrixXd::Zero(size, size)};
  if (basis.free.size() == 0 || basis.covariance.rows() != basis.free.size()) {
    tool.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  } else {
    const auto& columns = basis.free.target_columns(k);
    for (Index i = 0; i < size; ++i) {
      for (Index j = 0; j < size; ++j) {
        const int row = columns[static_cast<std::size_t>(i)];
        const int column = columns[static_cast<std::size_t>(j)];
        tool.covariance(i, j) = row >= 0 && column >= 0 ? basis.covariance(row, column) : 0.0;
      }
    }
  }
  if (target.with_orientation) {  // rotations about the target's axes
    const Eigen::Matrix3d& R = tool.frame.linear();
    tool.covariance.bottomRightCorner<3, 3>() = R * tool.covariance.bottomRightCorner<3, 3>() * R.transpose();
  } else {
    tool.frame.linear() = X_FP.linear();
  }
  return tool;
}

// What was touched, or else the targets of the calibration. `is_turned`: whether the touched tool's orientation is
// known.
std::vector<PendantFrame> pendant_frames(const FramesArguments& arguments, const Controller& controller,
                                         const PredictionBasis& basis, const TouchedFrames& found, bool is_turned) {
  std::vector<PendantFrame> frames;
  const auto add_tool = [&](int number, const std::string& target, const TouchedFrame& tool) {
    frames.push_back({.is_tool = true,
                      .number = number,
                      .target = target,
                      .is_turned = !target.empty() || is_turned,
                      .frame = controller.X_FP.inverse() * tool.frame,
                      .std = tool.std(controller.X_FP.linear())});
  };
  if (found.user) {
    frames.push_back({.number = arguments.user_number,
                      .target = {},
                      .frame = controller.X_BW.inverse() * found.user->frame,
                      .std = found.user->std(controller.X_BW.linear())});
  }
  if (found.tool) {
    add_tool(arguments.tool_number, {}, *found.tool);
  }
  for (std::size_t k = 0; k < basis.estimate.frames.targets.size() && !found.user && !found.tool; ++k) {
    add_tool(arguments.tool_number + static_cast<int>(k), basis.estimate.frames.targets[k].name,
             tool_of_target(basis, k, controller.X_FP));
  }
  return frames;
}

Json frames_json(const TouchedFrames& found, const std::vector<PendantFrame>& frames, bool is_turned,
                 const std::string& result) {
  Json json = Json::object();
  if (found.tool) {
    json["tool"] = touched_json(*found.tool);
    if (!is_turned) {
      json["tool"]["orientation"] = kNotMeasured;
    }
  }
  if (found.user) {
    json["user"] = touched_json(*found.user);
  }
  for (const PendantFrame& frame : frames) {
    Json& entry = json[frame.is_tool ? "tool_frames" : "user_frames"][std::to_string(frame.number)];
    entry = frame_json(frame.frame);
    entry["std"] = std_json(frame.std);
    if (!frame.is_turned) {
      entry["orientation"] = kNotMeasured;
    }
    if (!frame.target.empty()) {
      entry["target"] = frame.target;
    }
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

constexpr double kMillimetre = 1e-3;

std::string rows(const PendantFrame& frame) {
  const Eigen::Matrix<double, 6, 1> numbers = xyzwpr_of(frame.frame, Eigen::Matrix<double, 6, 1>::Zero());
  const Index of_rotations = frame.std.size() - 3;
  return numbers_row(frame.name() + " X Y Z [mm]", numbers.head<3>(), frame.std.head<3>(), kMillimetre) +
         numbers_row(frame.name() + " W P R [deg]", numbers.tail<3>(), frame.std.tail(of_rotations), kDegree) +
         (frame.is_turned
              ? ""
              : frame.name() +
                    " W P R: not measured. Keep those of the pendant, and state them by --frames if they are not 0\n") +
         (frame.target.empty() ? "" : frame.name() + ": target " + frame.target + "\n");
}

constexpr std::string_view kHead =
    "frame                              x           y           z   std x     std y     std z\n";

// What to type.
std::string pendant_table(const std::vector<PendantFrame>& frames) {
  std::string text = "on the pendant\n";
  text += kHead;
  for (const PendantFrame& frame : frames) {
    text += rows(frame);
  }
  return text;
}

// On the flange and in the base frame of the model.
std::string table(const TouchedFrames& found, const Robot& robot) {
  if (!found.tool && !found.user) {
    return {};
  }
  std::string text = fmt::format("in the model: tool in {}, user in {}\n{}", robot.tip, robot.base, kHead);
  const auto add = [&](const std::string& name, const TouchedFrame& frame) {
    const Eigen::VectorXd std = frame.std();
    text += numbers_row(name + " origin [mm]", frame.frame.translation(), std.head<3>(), kMillimetre);
    if (std.size() == 6) {
      double roll = 0.0;
      double pitch = 0.0;
      double yaw = 0.0;
      to_kdl(frame.frame).M.GetRPY(roll, pitch, yaw);
      text += numbers_row(name + " roll pitch yaw [deg]", {roll, pitch, yaw}, std.tail<3>(), kDegree);
    }
    if (frame.rms) {
      text += name + ": the touches are off by " + fixed(*frame.rms * 1e3, 4) + " mm (rms), at most " +
              fixed(*frame.largest * 1e3, 4) + " mm\n";
    }
  };
  if (found.tool) {
    add("tool", *found.tool);
  }
  if (found.user) {
    add("user", *found.user);
  }
  return text;
}

// What contradicts the frames. Even the nominal robot errs by less than 5 mm.
std::vector<std::string> contradictions(const TouchedFrames& found) {
  constexpr double kFar = 5e-3;  // [m]
  std::vector<std::string> result;
  for (const auto& [name, frame] : {std::pair{"tool", &found.tool}, std::pair{"user", &found.user}}) {
    if (*frame && (*frame)->rms.value_or(0.0) >= kFar) {
      result.push_back(
          fmt::format("the touches of the {} frame are off by {:.1f} mm; are units, rows and joint values right "
                      "(--joint-convention)?",
                      name, *(*frame)->rms * 1e3));
    }
  }
  if (found.flange_height < -kFar) {
    result.push_back(
        fmt::format("the flange is {:.1f} mm or more below the x-y plane of the user frame where it touched: is the "
                    "sign of y right, "
                    "and are rows exchanged?",
                    -found.flange_height * 1e3));
  }
  if (found.least_y < -kFar) {
    result.push_back(
        fmt::format("a touch with y above 0 was expected at y = {:.1f} mm of the user frame; is its row exchanged with "
                    "another one?",
                    found.least_y * 1e3));
  }
  return result;
}

ExitStatus run(const FramesArguments& arguments) {
  const Robot robot = load(arguments.robot);
  const PredictionBasis basis =
      arguments.result.empty() ? nominal_basis(robot) : PredictionBasis(read_result(arguments.result, robot));
  warn_of_other_convention(arguments.result, arguments.joint_convention);
  const bool is_described = !arguments.controller.empty();
  const Controller controller = is_described ? read_controller(arguments.controller) : controller_of_robot(robot);
  std::vector<OutputFile> files = {{.option = "--output", .path = arguments.output, .text = {}}};
  require_writable(files, arguments.force);
  const KnownTool tool = known_tool(arguments, controller);
  const TouchedFrames found = touched_frames(basis, touches_of(arguments, robot, tool.X_FT));
  const std::vector<PendantFrame> frames = pendant_frames(arguments, controller, basis, found, tool.is_turned);
  files.front().text = json_text(frames_json(found, frames, tool.is_turned, arguments.result));
  write_whole(files, arguments.force,
              arguments.json ? files.front().text : (is_described ? pendant_table(frames) : "") + table(found, robot));
  if (found.user && !found.user->rms) {
    warn("three touches of the user frame leave no check, and do not show how accurate it is; touch a fourth point");
  }
  const std::vector<std::string> doubts = contradictions(found);
  std::for_each(doubts.begin(), doubts.end(), print_doubt);
  return doubts.empty() ? done : not_to_be_trusted;
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
           "The tool, where it is known: JSON as written by --output, or --tool-number of a controller's file "
           "(SYSFRAME.VA, $config.dat) [the flange]");
  add_file(*app, "--joint-convention", arguments->joint_convention,
           "Joint values are the controller's, which this file turns into the URDF's");
  add_file(*app, "--controller", arguments->controller,
           "A FANUC controller's world frame and faceplate (JSON): prints the frames as X Y Z W P R in these; without "
           "touches the targets of --result as tools");
  constexpr std::pair<int, int> kFrameNumbers = {1, 99};
  add_count(*app, "--tool-number", arguments->tool_number, kFrameNumbers, "Number of the (first) tool frame, UTOOL");
  add_count(*app, "--user-number", arguments->user_number, kFrameNumbers, "Number of the user frame, UFRAME");
  add_file(*app, "--output", arguments->output, "Write the frames for compensate --frames (JSON)")->required();
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_json_flag(*app, arguments->json);
  add_example(
      *app,
      "kdlcal frames --result result.json --tool-touches tip.csv --user-touches fixture.csv --output frames.json");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
