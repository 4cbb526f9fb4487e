#include "cli/compensate_program.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <iterator>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/parallel.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "base/units.hpp"
#include "cli/compensation_summary.hpp"
#include "cli/frames.hpp"
#include "cli/output_files.hpp"
#include "cli/report_pages.hpp"
#include "cli/robot_controller.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/result_file.hpp"
#include "programs/compensated_program.hpp"
#include "programs/program_language.hpp"
#include "results/result_blocks.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr std::string_view kRecord = ".kdlcal.json";  // after the name of the program
constexpr std::size_t kMostOfAProgram = 512;          // [MiB] of each file: about two million points

// Joints of the robot by the number of an external axis, from texts such as "E1=rail" and "E2=-turntable".
std::map<int, ExternalAxis> external_axes_of(const std::vector<std::string>& texts, const Robot& robot) {
  std::map<int, ExternalAxis> axes;
  const std::vector<std::string> joints = joint_names(robot);
  for (const auto& [axis, joint] : keys_and_values("--external-axis", texts)) {
    if (axis.size() != 2 || axis.front() != 'E' || axis.back() < '1' || axis.back() > '6') {
      throw InputError("--external-axis: " + shown(axis) + " is no external axis, expected E1 to E6");
    }
    const bool is_reversed = joint.starts_with('-');
    const std::string name = joint.substr(is_reversed ? 1 : 0);
    if (joint != kNotOfTheArm && std::find(joints.begin(), joints.end(), name) == joints.end()) {
      throw InputError("--external-axis: " + robot.source + " has no joint " + shown(joint) +
                       ", expected none, or one of " + comma_separated(joints));
    }
    axes[axis.back() - '0'] = {.joint = name, .is_reversed = is_reversed};
  }
  return axes;
}

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
  controller.external_axes = external_axes_of(arguments.external_axes, robot);
  if (!arguments.frames.empty()) {
    controller.frames = read_program_frames(arguments.frames, language);
    if (std::filesystem::path(arguments.frames).extension() == ".json") {
      warn_if_found_with_another(found_with(read_json(arguments.frames), arguments.frames), arguments.frames,
                                 arguments.result);
    }
  }
  return controller;
}

// The file of the same stem with this extension, in small or capital letters; empty if there is none.
std::string file_beside(const std::string& file, std::string_view extension) {
  std::string capital(extension);
  std::transform(capital.begin(), capital.end(), capital.begin(), [](unsigned char c) { return std::toupper(c); });
  for (const std::string& each : {std::string(extension), capital}) {
    const std::filesystem::path path = std::filesystem::path(file).replace_extension(each);
    if (path != file && std::filesystem::exists(path)) {
      return path.string();
    }
  }
  return {};
}

bool has_extension(const std::string& file, std::string_view extension) {
  return lower_case(std::filesystem::path(file).extension().string()) == extension;
}

// The program, and the file that belongs to it in its language: motions before points.
std::vector<ProgramText> texts_of(const std::string& file, const ProgramLanguage*& language) {
  std::vector<ProgramText> texts;
  texts.push_back({.source = file, .text = read_text_file(file, kMostOfAProgram)});
  language = &language_of(texts.front());
  if (language->companion.empty()) {
    return texts;
  }
  const bool is_companion = has_extension(file, language->companion);
  const std::string main_extension(language->files.substr(0, language->files.find_first_of(", ")));
  const std::string other = file_beside(file, is_companion ? main_extension : language->companion);
  if (!other.empty()) {
    texts.insert(is_companion ? texts.begin() : texts.end(),
                 {.source = other, .text = read_text_file(other, kMostOfAProgram)});
  }
  return texts;
}

// Where each text goes: the given program to --output, the file beside it to the same stem.
std::vector<OutputFile> outputs_of(const ProgramArguments& arguments, const std::vector<ProgramText>& texts) {
  std::vector<OutputFile> files;
  for (const ProgramText& text : texts) {
    std::filesystem::path path = arguments.output;
    if (text.source != arguments.program) {
      path.replace_extension(std::filesystem::path(text.source).extension());
    }
    files.push_back({.option = "--output", .path = path.string(), .text = {}});
  }
  return files;
}

// A program that this command wrote has its record beside it, or beside the file that belongs to it.
void require_programs_of_the_user(const std::vector<ProgramText>& texts) {
  for (const ProgramText& beside : texts) {
    const std::string record = beside.source + std::string(kRecord);
    if (!std::filesystem::exists(record)) {
      continue;
    }
    const std::string written = read_text_file(record, kMostOfAProgram);
    for (const ProgramText& text : texts) {
      if (written.find(sha256(text.text)) != std::string::npos) {
        throw InputError(text.source + ": this program is compensated already, expected the original");
      }
    }
  }
}

// A line of JSON. As trees a program's positions would take ten times the memory and time of their compensation.
void add_line(std::string& text, const CompensatedPosition& position) {
  std::string change;
  for (const double each : position.change) {
    change += (change.empty() ? "" : ", ") + shortest(each);
  }
  const CommandedPoint& point = position.point;
  fmt::format_to(
      std::back_inserter(text),
      R"({{"position": {}, "line": {}, "status": "{}", "written": {}, "change": [{}], "position_error": {}, "orientation_error": {}}})",
      Json(position.name).dump(), position.line, to_string(point.status), position.written, change,
      shortest(point.position_error), shortest(point.orientation_error));
}

// The record without the positions.
std::string record_of(const ProgramArguments& arguments, const CompensatedProgram& program) {
  Json hashes = Json::array();
  for (const std::string& text : program.texts) {
    hashes.push_back(sha256(text));
  }
  Json paths = Json::array();
  for (const PathDeviation& path : program.paths) {
    paths.push_back({{"line", path.line},
                     {"from", path.from},
                     {"to", path.to},
                     {"deviation", finite_or_null(path.deviation.position)},
                     {"orientation_deviation", finite_or_null(path.deviation.orientation)}});
  }
  const Json rest = {{"result_sha256", sha256_of_file(arguments.result)},
                     {"program_sha256", hashes.size() == 1 ? hashes.front() : hashes},
                     {"largest_rounding", program.rounding},
                     {"lines",
                      {{"tried", program.lines},
                       {"tolerance", arguments.line_tolerance},
                       {"above_tolerance", program.paths.size()},
                       {"largest_deviation", finite_or_null(program.largest_deviation.position)},
                       {"largest_orientation_deviation", finite_or_null(program.largest_deviation.orientation)}}},
                     {"paths", paths},
                     {"warnings", program.warnings}};
  std::string text = json_text(rest);
  text.resize(text.size() - std::string_view("\n}\n").size());
  return text + ",\n  \"positions\": [";
}

// A text of many positions, piece by piece: add(i, text) appends that of a position.
template <class Add>
void write_positions(std::size_t count, const TextSink& sink, const Add& add) {
  constexpr std::size_t kBlock = 512;
  constexpr std::size_t kAtOnce = 64 * kBlock;
  for (std::size_t first = 0; first < count; first += kAtOnce) {
    const std::size_t size = std::min(kAtOnce, count - first);
    std::vector<std::string> blocks((size + kBlock - 1) / kBlock);
    parallel_blocks(size, kBlock, 0, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        add(first + i, blocks[begin / kBlock]);
      }
    });
    for (const std::string& block : blocks) {
      sink(block);
    }
  }
}

void write_record(const std::string& begin, const CompensatedProgram& program, const TextSink& sink) {
  sink(begin);
  write_positions(program.positions.size(), sink, [&](std::size_t i, std::string& text) {
    text += i == 0 ? "\n    " : ",\n    ";
    add_line(text, program.positions[i]);
  });
  sink("\n  ]\n}\n");
}

CompensationSummary summary_of(const CompensatedProgram& program, const Robot& robot, const CalibratedArm& arm) {
  CompensationSummary summary(robot, arm);
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
  const ProgramLanguage* language = nullptr;
  const std::vector<ProgramText> texts = texts_of(arguments.program, language);
  std::vector<OutputFile> files = outputs_of(arguments, texts);
  files.push_back({.option = "--output", .path = arguments.output + std::string(kRecord), .text = {}});
  for (OutputFile& file : given_outputs(
           {{.option = "--predict", .path = arguments.predict}, {.option = "--report", .path = arguments.report}})) {
    files.push_back(std::move(file));
  }
  require_programs_of_the_user(texts);
  const Controller controller = controller_of(arguments, robot, *language);
  CompensationOptions options = arguments.options;
  for (const auto& [number, axis] : controller.external_axes) {
    if (axis.joint != kNotOfTheArm) {
      options.held.push_back(axis.joint);
    }
  }
  const Calibration calibration = load_calibration(arguments.result, robot).at(arguments.circumstances);
  require_writable(files, arguments.force);
  CompensatedJoints near;
  if (!arguments.near.empty()) {
    near = joint_values(robot, {.joints = arguments.near, .joint_convention = {}, .degrees = true, .option = "--near"});
  }
  const Compensator compensator(calibration, options);
  CompensatedProgram program =
      compensated_program({.robot = robot, .compensator = compensator, .controller = controller, .language = *language},
                          texts, near, arguments.line_tolerance);
  const CompensationSummary summary = summary_of(program, robot, calibration.arm());
  const std::vector<std::string> warnings = warnings_of(program, summary, arguments.line_tolerance);
  const std::string record = record_of(arguments, program);
  for (std::size_t i = 0; i < program.texts.size(); ++i) {
    files[i].text = std::move(program.texts[i]);
  }
  files[program.texts.size()].pieces = [&](const TextSink& sink) { write_record(record, program, sink); };
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
      write_record(record, program, [&](std::string_view piece) { printed += piece; });
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
