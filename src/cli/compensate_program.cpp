#include "cli/compensate_program.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/sha256.hpp"
#include "base/text_file.hpp"
#include "cli/compensation_summary.hpp"
#include "cli/frames.hpp"
#include "cli/output_files.hpp"
#include "cli/report_pages.hpp"
#include "cli/robot_controller.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/result_file.hpp"
#include "programs/compensated_program.hpp"
#include "programs/program_files.hpp"
#include "programs/program_language.hpp"

namespace kdl_calibration::cli {
namespace {

// A FANUC controller seldom counts joints as a URDF does, and only one comes with kdlcal: that of its robot.
Controller described_controller(const ProgramArguments& arguments, const Robot& robot,
                                const ProgramLanguage& language) {
  if (!arguments.controller.empty()) {
    return read_controller(arguments.controller);
  }
  if (!language.needs_description) {
    return controller_of_links(robot);
  }
  const std::optional<Controller> bundled = bundled_controller(robot);
  if (!bundled) {
    throw InputError(robot.source + " is not the R-2000iC/165F that comes with kdlcal, expected --controller");
  }
  return *bundled;
}

Controller controller_of(const ProgramArguments& arguments, const Robot& robot, const ProgramLanguage& language) {
  Controller controller = described_controller(arguments, robot, language);
  if (!arguments.joint_convention.empty()) {
    controller.convention = read_joint_convention(arguments.joint_convention);
  }
  controller.external_axes =
      external_axes(keys_and_values("--external-axis", arguments.external_axes), robot, "--external-axis");
  if (!arguments.frames.empty()) {
    controller.frames = read_program_frames(arguments.frames, language);
    if (lower_ending(arguments.frames) == ".json") {
      const Json json = read_json(arguments.frames);
      warn_if_found_with_another(found_with(json, arguments.frames), arguments.frames, arguments.result);
      const Json tools = json.value("tool_frames", Json::object());
      for (const auto& [name, tool] : tools.items()) {
        warn_if_not_turned(tool, fmt::format("{} {}", language.tool_frame, name), arguments.frames);
      }
    }
  }
  return controller;
}

std::vector<OutputFile> outputs_of(const ProgramArguments& arguments, const ProgramFiles& program) {
  std::vector<OutputFile> files = program_outputs(program, arguments.output);
  for (OutputFile& file : files) {
    file.option = "--output";
  }
  for (OutputFile& file : given_outputs(
           {{.option = "--predict", .path = arguments.predict}, {.option = "--report", .path = arguments.report}})) {
    files.push_back(std::move(file));
  }
  return files;
}

CompensationSummary summary_of(const CompensatedProgram& program, const Robot& robot, const CalibratedArm& arm,
                               const Controller& controller) {
  CompensationSummary summary(robot, arm, controller.convention);
  for (const CompensatedPosition& position : program.positions) {
    const CompensatedPoint point = position.point;
    summary.add(std::span(&point, 1), std::span(&position.displacement, 1),
                [&](std::size_t /*first*/) { return position.name; });
  }
  return summary;
}

void write_predictions(const CompensatedProgram& program, const CalibratedArm& arm, const TextSink& sink) {
  sink(kPredictionHeader);
  write_positions(program.positions.size(), sink, [&](std::size_t i, std::string& text) {
    text += prediction_row(arm, program.positions[i].name, program.positions[i].point);
  });
}

// The worst line, and those that follow.
std::string warning_of_lines(const CompensatedProgram& program, double tolerance) {
  constexpr std::size_t kMostLines = 10;
  const PathDeviation& worst = program.paths.front();
  const LineDeviation& off = worst.deviation;
  std::string text = fmt::format("{}:{}: from {} to {} {}", worst.source, worst.line, worst.from, worst.to,
                                 std::isfinite(off.position)
                                     ? fmt::format("the tool leaves the straight line by {} mm and {} deg",
                                                   fixed(off.position * 1e3, 3), fixed(off.orientation / kDegree, 3))
                                     : "the controller cannot move the tool straight");
  text += fmt::format("; {} of {} straight lines are off by more than {} mm", program.paths.size(), program.lines,
                      shortest(tolerance * 1e3));
  for (std::size_t i = 1; i < std::min(kMostLines, program.paths.size()); ++i) {
    text += (i == 1 ? ", next those in lines " : ", ") + std::to_string(program.paths[i].line);
  }
  if (program.paths.size() > kMostLines) {
    text += fmt::format(" and {} more", program.paths.size() - kMostLines);
  }
  return text + ": more positions help";
}

std::vector<std::string> warnings_of(const CompensatedProgram& program, const CompensationSummary& summary,
                                     double tolerance) {
  std::vector<std::string> warnings = program.warnings;
  if (program.positions.empty()) {
    warnings.emplace_back("no point of the program is compensated");
  }
  for (const std::string& each : summary.warnings()) {
    warnings.push_back(each);
  }
  if (!program.paths.empty()) {
    warnings.push_back(warning_of_lines(program, tolerance));
  }
  return warnings;
}

}  // namespace

ExitStatus compensate_program(const ProgramArguments& arguments, const Robot& robot) {
  const ProgramFiles given = read_program(arguments.program);
  std::vector<OutputFile> files = outputs_of(arguments, given);
  require_original(given);
  const Calibration calibration = at_circumstances(load_calibration(arguments.result, robot), arguments.circumstances);
  const Controller controller = controller_of(arguments, robot, *given.language);
  CompensationOptions options = arguments.options;
  for (std::string& joint : carrying_joints(controller)) {
    options.held.push_back(std::move(joint));
  }
  require_writable(files, arguments.force);
  CompensatedJoints near;
  if (!arguments.near.empty()) {
    near = joint_values(robot, {.joints = arguments.near, .joint_convention = {}, .degrees = true, .option = "--near"},
                        fitting_convention(controller.convention, robot));
  }
  const Compensator compensator(calibration, options);
  CompensatedProgram program = compensated_program(
      {.robot = robot, .compensator = compensator, .controller = controller, .language = *given.language}, given.texts,
      near, arguments.line_tolerance);
  const CompensationSummary summary = summary_of(program, robot, calibration.arm(), controller);
  const std::vector<std::string> warnings = warnings_of(program, summary, arguments.line_tolerance);
  const std::string head = record_head(program, sha256_of_file(arguments.result), arguments.line_tolerance);
  for (std::size_t i = 0; i < program.texts.size(); ++i) {
    files[i].text = std::move(program.texts[i]);
  }
  files[program.texts.size()].pieces = [&](const TextSink& sink) { write_record(head, program, sink); };
  for (OutputFile& file : files) {
    if (file.option == "--predict") {
      file.pieces = [&](const TextSink& sink) { write_predictions(program, calibration.arm(), sink); };
    } else if (file.option == "--report") {
      file.text = summary.page(with_files(summary.json(), arguments.robot, robot,
                                          {{"result", arguments.result},
                                           {"program", arguments.program},
                                           {"controller", arguments.controller},
                                           {"frames", arguments.frames},
                                           {"joint-convention", arguments.joint_convention}}),
                               warnings);
    }
  }
  write_whole(files, arguments.force, [&] {
    std::string printed;
    if (arguments.json) {
      write_record(head, program, [&](std::string_view piece) { printed += piece; });
    } else {
      printed = summary.table() + "rounding to the digits of the program moves the flange by at most " +
                fixed(program.rounding * 1e3, 3) + " mm\n";
    }
    return printed;
  });
  std::for_each(warnings.begin(), warnings.end(), warn);
  return summary.is_exact() ? done : not_to_be_trusted;
}

}  // namespace kdl_calibration::cli
