#include <fmt/core.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/csv.hpp"
#include "base/degree.hpp"
#include "base/parallel.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "cli/compensate_program.hpp"
#include "cli/compensation_summary.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/plan_command.hpp"
#include "cli/pose_ways.hpp"
#include "cli/progress.hpp"
#include "cli/report_pages.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "interface/compensated_line.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/orientation_reading.hpp"
#include "kdl_calibration/result_file.hpp"
#include "measurements/program_file.hpp"
#include "model/parameters.hpp"
#include "programs/controller.hpp"

namespace kdl_calibration::cli {
namespace {

using Eigen::Index;

constexpr std::string_view kCompensated = "# compensated ";

struct CompensateArguments {
  RobotArguments robot;
  std::string result;
  std::string joints;
  std::string poses;
  std::string program;
  std::string controller;
  std::string frames;
  std::string orientation;
  std::vector<std::string> external_axes;
  std::string joint_convention;
  std::vector<std::string> near;
  Circumstances circumstances;
  double most_change = 5.0;
  bool position_first = false;
  std::optional<double> linear;  ///< [mm] tolerance
  std::string output;
  std::string predict;
  std::string report;
  std::vector<std::string> notes;
  bool force = false;
  bool json = false;
};

void require_not_compensated(const std::string& file) {
  LineReader lines(file);
  std::string_view first;
  if (lines.next(first) && first.starts_with(kCompensated)) {
    throw InputError(file + ":1: these points are compensated already, expected those of the program");
  }
}

// User and tool frame of the poses: those of the file, else world and faceplate of the controller, else base and
// flange.
ControllerFrames frames_of(const CompensateArguments& arguments, const std::optional<Controller>& controller) {
  if (arguments.frames.empty()) {
    return controller ? ControllerFrames{.X_BU = controller->X_BW, .X_FT = controller->X_FP, .found_with = {}}
                      : ControllerFrames();
  }
  if (controller) {
    throw InputError("--controller: its world and faceplate are the frames of --poses, expected no --frames");
  }
  const Json json = read_json(arguments.frames);
  ControllerFrames frames = controller_frames_of(json, arguments.frames);
  warn_if_not_turned(json.value("tool", Json()), "the tool", arguments.frames);
  warn_if_found_with_another(frames.found_with, arguments.frames, arguments.result);
  return frames;
}

// Where the result notes something else than the user, such as another payload.
std::vector<std::string> other_notes(const CompensateArguments& arguments) {
  std::vector<std::string> result;
  if (arguments.notes.empty()) {
    return result;
  }
  const Json saved = read_json(arguments.result);
  const Json noted = saved.value("/provenance/notes"_json_pointer, Json::object());
  for (const auto& [key, value] : notes_of(arguments.notes)) {
    if (!noted.contains(key)) {
      result.push_back("the result does not note " + shown(key));
    } else if (noted[key] != value) {
      result.push_back("the calibration was made with " + shown(key) + " " + noted[key].dump() + ", not " +
                       shown(value) + ": it may be wrong here");
    }
  }
  return result;
}

// Joint values of a file of poses that stand elsewhere than its poses: nobody knows which of the two is meant.
class Contradictions {
public:
  explicit Contradictions(const Robot& robot) : far_(0.2 * reach(complete_model(robot))) {}

  // `asked` and `stated`: X_BF of the row's pose, and of its joint values.
  void add(const Eigen::Isometry3d& asked, const Eigen::Isometry3d& stated, const std::function<std::string()>& label) {
    constexpr double kTurned = 45.0 * kDegree;  // more than roughly stated joint values are off by
    ++rows_;
    const double distance = (stated.translation() - asked.translation()).norm();
    const double angle = Eigen::AngleAxisd(asked.linear().transpose() * stated.linear()).angle();
    if (distance < far_ && angle < kTurned) {
      return;
    }
    if (count_++ == 0) {
      first_ = fmt::format("{}: {:.3g} m and {:.3g} degrees", shown(label()), distance, angle / kDegree);
    }
  }
  /// Empty if there are none.
  std::string words(const std::string& file) const {
    return count_ == 0 ? std::string()
                       : fmt::format(
                             "{}: in {} of {} rows the joint values stand elsewhere than the pose, first {}; "
                             "are frames (--frames, --controller), joints (--joint-convention) and angles "
                             "(--orientation) right?",
                             file, count_, rows_, first_);
  }

private:
  double far_;  // [m]
  std::size_t rows_ = 0;
  std::size_t count_ = 0;
  std::string first_;
};

// The rows of a program that are in memory at a time, and what becomes of them.
struct Piece {
  std::vector<ProgramLine> lines;
  std::vector<Eigen::Isometry3d> asked;   // flange poses in the base
  std::vector<Eigen::Isometry3d> stated;  // those of the joint values beside poses; else none
  std::vector<CompensatedPoint> points;
  std::vector<double> corrections;     // [m] of the flange
  std::vector<std::string> texts;      // of each block
  std::vector<std::string> predicted;  // of each block
};

/// Reads a program, and writes the commands for it.
class Compensation {
public:
  Compensation(const CompensateArguments& arguments, const Robot& robot,
               const std::optional<JointConvention>& convention, const std::optional<Controller>& controller)
      : arguments_(arguments),
        calibration_(at_circumstances(load_calibration(arguments.result, robot), arguments.circumstances)),
        compensator_(calibration_,
                     {.most_change = arguments.most_change * kDegree, .position_first = arguments.position_first}),
        frames_(frames_of(arguments, controller)),
        program_(file(), robot, convention ? &*convention : nullptr,
                 arguments.poses.empty() ? FileContent::configurations : FileContent::poses,
                 orientation_reading(arguments.orientation)),
        ways_(robot, compensator_),
        summary_(robot, calibration_.arm(), convention),
        contradictions_(robot),
        warnings_(other_notes(arguments)) {
    if (!arguments.near.empty()) {
      previous_ =
          joint_values(robot, {.joints = arguments.near, .joint_convention = {}, .degrees = true, .option = "--near"},
                       fitting_convention(convention, robot));
    }
  }

  void write(const TextSink& sink) {
    constexpr std::size_t kAtOnce = 8192;
    Progress progress("compensating");
    sink(std::string(kCompensated) + sha256_of_file(arguments_.result) + "\n" + program_.head());
    while (true) {
      Piece piece{.lines = program_.next(kAtOnce)};
      if (piece.lines.empty()) {
        break;
      }
      solve(piece);
      for (const std::string& text : piece.texts) {
        sink(text);
      }
      for (const std::string& text : piece.predicted) {
        predicted_ += text;
      }
      const PointLabel label = label_of(piece, summary_.points());
      for (std::size_t i = 0; i < piece.stated.size(); ++i) {
        contradictions_.add(piece.asked[i], piece.stated[i], [&] { return label(i); });
      }
      summary_.add(piece.points, piece.corrections, label);
      if (arguments_.linear) {
        add_lines(piece, label);
      }
      progress(program_.share());
    }
    if (summary_.points() == 0) {
      throw InputError(file() + ": no rows after the header");
    }
  }

  const CompensationSummary& summary() const { return summary_; }
  /// How the poses' orientations were read; empty if there is one way.
  std::string orientations() const { return arguments_.poses.empty() ? "" : program_.orientations(); }
  /// Why the commands may be wrong although each point is exact; empty if they are not.
  std::string doubt() const {
    if (std::string words = contradictions_.words(file()); !words.empty()) {
      return words;
    }
    if (!depends_on_way()) {
      return {};
    }
    return fmt::format(
        "{} has no joint values, and the commands depend on the way in which the arm reaches a pose (elbow, shoulder, "
        "wrist): by {:.2f} mm; add joint columns, or state the first row's joint values (--near)",
        file(), spread_of_ways_ * 1e3);
  }
  std::vector<std::string> warnings() const {
    std::vector<std::string> result = warnings_;
    for (const auto& warnings : {summary_.warnings(), ways_.warnings()}) {
      result.insert(result.end(), warnings.begin(), warnings.end());
    }
    return result;
  }
  /// How well each point is known (CSV), if it was asked for.
  const std::string& predicted() const { return predicted_; }

private:
  const std::string& file() const { return arguments_.poses.empty() ? arguments_.joints : arguments_.poses; }

  // The row's own label, else its ordinal behind `before` rows.
  PointLabel label_of(const Piece& piece, std::size_t before) const {
    return [this, &piece, before](std::size_t i) {
      const std::string stated = program_.label(piece.lines[i]);
      return stated.empty() ? std::to_string(before + i + 1) : stated;
    };
  }

  void solve(Piece& piece) {
    constexpr std::size_t kBlock = 64;
    piece.asked.resize(piece.lines.size());
    piece.points.resize(piece.lines.size());
    piece.corrections.resize(piece.lines.size());
    piece.stated.resize(!arguments_.poses.empty() && program_.states_joints() ? piece.lines.size() : 0);
    piece.texts.resize((piece.lines.size() + kBlock - 1) / kBlock);
    piece.predicted.resize(piece.texts.size());
    // Without joint values each row starts from the previous one.
    parallel_blocks(piece.lines.size(), kBlock, program_.states_joints() ? 0 : 1,
                    [&](std::size_t begin, std::size_t end) {
                      piece.texts[begin / kBlock] = solved(piece, begin, end);
                      if (!arguments_.predict.empty()) {
                        piece.predicted[begin / kBlock] = predicted_rows(piece, begin, end);
                      }
                    });
  }

  // Solves the rows from `begin` to `end`; their text.
  std::string solved(Piece& piece, std::size_t begin, std::size_t end) {
    const std::span<const ProgramLine> lines = std::span(piece.lines).subspan(begin, end - begin);
    ProgramPoints program = program_.points(lines);
    for (std::size_t i = 0; i < lines.size(); ++i) {
      CompensatedPoint& point = piece.points[begin + i];
      Eigen::Isometry3d& asked = piece.asked[begin + i];
      const auto column = static_cast<Index>(i);
      if (program.poses.empty()) {
        asked = compensator_.nominal_pose(program.joint_values.col(column));
        point = compensator_.solve(program.joint_values.col(column));
      } else {
        asked = frames_.X_BU * program.poses[i] * frames_.X_FT.inverse();
        if (program_.states_joints()) {
          piece.stated[begin + i] = compensator_.nominal_pose(program.joint_values.col(column));
        }
        point = program_.states_joints()
                    ? compensator_.solve(asked, program.joint_values.col(column))
                    : near_previous(asked, [&] { return label_of(piece, summary_.points())(begin + i); });
        if (!nominal_reaches(asked, point)) {
          continue;  // the row stays as it is
        }
      }
      const Eigen::Isometry3d commanded = compensator_.nominal_pose(point.joint_values);
      piece.corrections[begin + i] = (commanded.translation() - asked.translation()).norm();
      if (!program.poses.empty()) {
        program.poses[i] = frames_.X_BU.inverse() * commanded * frames_.X_FT;
      }
      if (program_.states_joints()) {
        program.joint_values.col(column) = point.joint_values;
      }
    }
    return program_.text(lines, program);
  }

  // If the nominal robot is far from the asked pose, so is the compensated one: nobody wants to go there.
  bool nominal_reaches(const Eigen::Isometry3d& asked, const CompensatedPoint& point) const {
    constexpr double kReached = 1e-6;
    return asked.isApprox(compensator_.nominal_pose(point.joint_values - point.change), kReached);
  }

  std::string predicted_rows(const Piece& piece, std::size_t begin, std::size_t end) const {
    const CalibratedArm arm = calibration_.arm();
    const PointLabel label = label_of(piece, summary_.points());
    std::string text;
    for (std::size_t i = begin; i < end; ++i) {
      text += prediction_row(arm, label(i), piece.points[i]);
    }
    return text;
  }

  bool depends_on_way() const {
    constexpr double kTold = 1e-4;  // [m]
    return spread_of_ways_ > kTold;
  }

  // `label`: of the row.
  CompensatedPoint near_previous(const Eigen::Isometry3d& asked, const std::function<std::string()>& label) {
    constexpr int kMostChecked = 100;
    CompensatedPoint point;
    if (arguments_.near.empty() && !depends_on_way() && checked_++ < kMostChecked) {
      spread_of_ways_ = std::max(spread_of_ways_, compensator_.spread_of_ways(asked));
    }
    if (previous_.size() > 0) {
      point = arguments_.near.empty() ? compensator_.solve(asked, previous_) : ways_.solve(asked, previous_, label);
    }
    if (point.status == CompensationStatus::unreachable || point.status == CompensationStatus::out_of_limits) {
      point = compensator_.solve(asked);
    }
    previous_ = point.joint_values;
    return point;
  }

  void add_lines(const Piece& piece, const PointLabel& label) {
    std::vector<LineEnd> ends = {last_};
    for (std::size_t i = 0; i < piece.lines.size(); ++i) {
      ends.push_back({.X_BT = piece.asked[i] * frames_.X_FT, .joint_values = piece.points[i].joint_values});
    }
    std::vector<LineDeviation> deviations(piece.lines.size());
    parallel_for(deviations.size(), 0, [&](std::size_t i) {
      if (ends[i].joint_values.size() > 0) {  // there is no line to the first point
        deviations[i] = line_deviation(compensator_, frames_.X_FT, ends[i], ends[i + 1]);
      }
    });
    summary_.add_lines(deviations, *arguments_.linear * 1e-3, label);
    last_ = ends.back();
  }

  const CompensateArguments& arguments_;
  Calibration calibration_;
  Compensator compensator_;
  ControllerFrames frames_;
  ProgramFile program_;
  PoseWays ways_;
  CompensationSummary summary_;
  Contradictions contradictions_;
  std::vector<std::string> warnings_;
  std::string predicted_{kPredictionHeader};
  CompensatedJoints previous_;
  double spread_of_ways_ = 0.0;  // [m] over the rows that were checked
  int checked_ = 0;
  LineEnd last_;
};

std::string page_of(const CompensateArguments& arguments, const Robot& robot, const Compensation& compensation) {
  return compensation.summary().page(with_files(compensation.summary().json(), arguments.robot, robot,
                                                {{"result", arguments.result},
                                                 {"joints", arguments.joints},
                                                 {"poses", arguments.poses},
                                                 {"frames", arguments.frames},
                                                 {"controller", arguments.controller},
                                                 {"joint-convention", arguments.joint_convention}}),
                                     compensation.warnings());
}

ProgramArguments of_program(const CompensateArguments& arguments) {
  return {.robot = arguments.robot,
          .result = arguments.result,
          .program = arguments.program,
          .controller = arguments.controller,
          .joint_convention = arguments.joint_convention,
          .frames = arguments.frames,
          .external_axes = arguments.external_axes,
          .near = arguments.near,
          .circumstances = arguments.circumstances,
          .line_tolerance = arguments.linear ? *arguments.linear * 1e-3 : kLineTolerance,
          .options = {.most_change = arguments.most_change * kDegree, .position_first = arguments.position_first},
          .output = arguments.output,
          .predict = arguments.predict,
          .report = arguments.report,
          .force = arguments.force,
          .json = arguments.json};
}

std::optional<Controller> given_controller(const CompensateArguments& arguments) {
  return arguments.controller.empty() ? std::nullopt : std::optional(read_controller(arguments.controller));
}

std::optional<JointConvention> given_convention(const CompensateArguments& arguments,
                                                const std::optional<Controller>& controller) {
  return controller && arguments.joint_convention.empty() ? controller->convention
                                                          : convention_of(arguments.joint_convention);
}

ExitStatus run(const CompensateArguments& arguments) {
  const auto given = {!arguments.joints.empty(), !arguments.poses.empty(), !arguments.program.empty()};
  if (std::count(given.begin(), given.end(), true) != 1) {
    throw InputError("expected one of --joints, --poses and --program");
  }
  warn_of_other_convention(arguments.result, arguments.joint_convention);
  if (!arguments.program.empty()) {
    return compensate_program(of_program(arguments), load(arguments.robot));
  }
  const Robot robot = load(arguments.robot);
  std::vector<OutputFile> files = given_outputs({{.option = "--output", .path = arguments.output},
                                                 {.option = "--predict", .path = arguments.predict},
                                                 {.option = "--report", .path = arguments.report}});
  require_writable(files, arguments.force);
  require_not_compensated(arguments.poses.empty() ? arguments.joints : arguments.poses);
  const std::optional<Controller> controller = given_controller(arguments);
  const std::optional<JointConvention> convention = given_convention(arguments, controller);
  Compensation compensation(arguments, robot, convention, controller);
  // Files are written one after the other: the program first, and all else is known then.
  for (OutputFile& file : files) {
    file.pieces = [&](const TextSink& sink) {
      if (file.option == "--output") {
        compensation.write(sink);
      } else {
        sink(file.option == "--predict" ? compensation.predicted() : page_of(arguments, robot, compensation));
      }
    };
  }
  write_whole(files, arguments.force, [&] {
    const std::vector<std::string> warnings = compensation.warnings();
    std::for_each(warnings.begin(), warnings.end(), warn);
    const std::string orientations = compensation.orientations();
    if (arguments.json) {
      Json json = compensation.summary().json();
      json["read"] = orientations.empty() ? Json() : Json(orientations);
      return json_text(json);
    }
    const bool of_links = !arguments.poses.empty() && arguments.frames.empty() && !controller;
    return (of_links ? "poses of " + robot.tip + " in " + robot.base + ", as no --frames or --controller are given\n"
                     : "") +
           (orientations.empty() ? "" : "read: " + orientations + "\n") + compensation.summary().table();
  });
  if (const std::string doubt = compensation.doubt(); !doubt.empty()) {
    print_doubt(doubt);
    return not_to_be_trusted;
  }
  return compensation.summary().is_exact() ? done : not_to_be_trusted;
}

void add_bounds(CLI::App& app, CompensateArguments& arguments) {
  app.add_option("--most-change", arguments.most_change,
                 "Largest change of a joint; a degree counts as 17.45 mm of a joint that slides")
      ->type_name("DEG")
      ->check(number_between(1e-6, 360.0, "degrees from 0.000001 to 360"))
      ->capture_default_str();
  app.add_flag("--position-first", arguments.position_first,
               "Where a joint is held at a bound, keep the position exact at the cost of the orientation");
  app.add_option("--linear", arguments.linear,
                 "Warn where the tool leaves a straight line by more than this: from row to row, or of --program")
      ->type_name("MM")
      ->check(number_between(1e-3, 1e3, "millimetres from 0.001 to 1000"))
      ->expected(0, 1)
      ->default_str("0.1");
}

}  // namespace

Subcommand add_compensate(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand(
      "compensate",
      "Joint values or poses that bring the real robot where the program's mean\n"
      "Poses stand between base and flange of the result: find user and tool frames with the calibrated robot (kdlcal "
      "frames). Leave points alone that were touched up on the robot: they are right already.");
  const auto arguments = std::make_shared<CompensateArguments>();
  add_robot_options(*app, arguments->robot);
  add_file(*app, "--result", arguments->result, "The result that calibrate wrote (JSON)")->required();
  CLI::Option* joints = add_file(*app, "--joints", arguments->joints,
                                 "Joint values of the program: a CSV file as for calibrate --predict-at");
  add_file(*app, "--poses", arguments->poses,
           "Poses of the program: a CSV file with x, y, z, an orientation and, if known, joint values near the pose")
      ->excludes(joints);
  add_orientation(*app, arguments->orientation)->needs("--poses");
  add_list(*app, "--near", arguments->near,
           "Joint values near the first pose of --poses or --program that states no joint values, degrees or m: its "
           "elbow, shoulder and wrist")
      ->type_name("q1,...,qn")
      ->excludes(joints);
  CLI::Option* program =
      add_file(*app, "--program", arguments->program, "A program as text: its language is told from the text");
  add_file(*app, "--controller", arguments->controller,
           "Joint convention, world frame and faceplate (JSON) [joints of the URDF; of --program its links base and "
           "tool0, FANUC: those of the R-2000iC/165F; of --poses base and flange]")
      ->excludes(joints);
  add_list(
      *app, "--external-axis", arguments->external_axes,
      "External axis of --program and the joint of the URDF that it is, such as a rail before the arm (-JOINT where "
      "it counts the other way), or none if it does not carry the arm; it keeps its values; repeatable")
      ->type_name("E1=JOINT")
      ->needs(program);
  add_file(*app, "--frames", arguments->frames,
           "User and tool frame of the poses: JSON as kdlcal frames writes it [base and flange]; for --program "
           "SYSFRAME.VA of a backup, or JSON");
  add_circumstances(*app, arguments->circumstances);
  add_file(*app, "--joint-convention", arguments->joint_convention,
           "Joint values are the controller's, which this file turns into the URDF's");
  add_bounds(*app, *arguments);
  add_file(*app, "--output", arguments->output, "Write what to command, in the same columns (CSV)")->required();
  add_file(*app, "--predict", arguments->predict,
           "Write how well each point is known (CSV): remaining error, predicted 1 sigma, radius of 95 %");
  add_report_file(*app, arguments->report);
  app->add_option("--note", arguments->notes,
                  "What holds now, such as payload=165: warn if the calibration noted something else; repeatable")
      ->type_name("KEY=VALUE")
      ->excludes(program);
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_json_flag(*app, arguments->json);
  add_example(*app, "kdlcal compensate --result result.json --joints program.csv --output commands.csv");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
