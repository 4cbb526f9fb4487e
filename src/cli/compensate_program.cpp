#include "cli/compensate_program.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <string_view>
#include <utility>
#include <vector>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/parallel.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "cli/data_dir.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/compensated_program.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr std::string_view kRecord = ".kdlcal.json";  // after the name of the program
constexpr std::size_t kJoints = 6;

// Only one controller comes with kdlcal: that of its robot.
Controller controller_of(const ProgramArguments& arguments, const Robot& robot) {
  if (!arguments.controller.empty()) {
    return read_controller(arguments.controller);
  }
  const Robot bundled = load({});
  if (robot.urdf != bundled.urdf || robot.base != bundled.base || robot.tip != bundled.tip) {
    throw InputError(robot.source + " is not the R-2000iC/165F that comes with kdlcal, expected --controller");
  }
  return read_controller(urdf_dir() / "fanuc_r2000ic_165f_controller.json");
}

// A program that this command wrote has its record beside it.
void require_program_of_the_user(const std::string& file, const std::string& text) {
  const std::string record = file + std::string(kRecord);
  if (std::filesystem::exists(record) && read_text_file(record).find(sha256(text)) != std::string::npos) {
    throw InputError(file + ": this program is compensated already, expected the original");
  }
}

// A line of JSON. As trees a program's positions would take ten times the memory and time of their compensation.
std::string line_of(const CompensatedPosition& position) {
  std::string change;
  for (const double each : position.change) {
    change += (change.empty() ? "" : ", ") + shortest(each);
  }
  return fmt::format(
      R"({{"position": {}, "status": "{}", "written": {}, "change": [{}], "position_error": {}, "orientation_error": {}}})",
      position.number, to_string(position.status), position.written, change, shortest(position.position_error),
      shortest(position.orientation_error));
}

std::string record_of(const ProgramArguments& arguments, const CompensatedProgram& program) {
  Json paths = Json::array();
  for (const PathDeviation& path : program.paths) {
    paths.push_back({{"line", path.line},
                     {"from", path.from},
                     {"to", path.to},
                     {"deviation", std::isfinite(path.deviation) ? Json(path.deviation) : Json()}});
  }
  const Json rest = {{"result_sha256", sha256_of_file(arguments.result)},
                     {"program_sha256", sha256(program.text)},
                     {"largest_rounding", program.rounding},
                     {"paths", paths},
                     {"warnings", program.warnings}};
  std::string text = json_text(rest);
  text.resize(text.size() - std::string_view("\n}\n").size());
  text += ",\n  \"positions\": [";
  constexpr std::size_t kBlock = 1024;
  std::vector<std::string> blocks((program.positions.size() + kBlock - 1) / kBlock);
  parallel_blocks(program.positions.size(), kBlock, 0, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      blocks[begin / kBlock] += (i == 0 ? "\n    " : ",\n    ") + line_of(program.positions[i]);
    }
  });
  for (const std::string& block : blocks) {
    text += block;
  }
  text += "\n  ]\n}\n";
  return text;
}

std::string largest_change(const CompensatedProgram& program) {
  std::array<double, kJoints> largest{};
  for (const CompensatedPosition& position : program.positions) {
    for (std::size_t i = 0; i < kJoints; ++i) {
      largest[i] = std::max(largest[i], std::abs(position.change[static_cast<Eigen::Index>(i)]));
    }
  }
  std::string text = "largest change [deg]:";
  for (std::size_t i = 0; i < kJoints; ++i) {
    text += fmt::format(" J{} {}", i + 1, fixed(largest[i] / kDegree, 3));
  }
  return text + "\n";
}

std::string table(const CompensatedProgram& program) {
  constexpr std::size_t kMostLines = 10;
  std::vector<std::string> inexact;
  for (const CompensatedPosition& position : program.positions) {
    if (position.status != CompensationStatus::exact) {
      inexact.push_back(fmt::format(
          "P[{}]: {}, {}", position.number, to_string(position.status),
          position.written ? fmt::format("orientation off by {} mrad", fixed(position.orientation_error * 1e3, 3))
                           : std::string("left as it was")));
    }
  }
  std::string text = fmt::format("{} positions, {} of them exact\n", program.positions.size(),
                                 program.positions.size() - inexact.size()) +
                     largest_change(program) + "rounding to 0.001 mm and degrees moves the flange by at most " +
                     fixed(program.rounding * 1e3, 3) + " mm\n";
  for (std::size_t i = 0; i < std::min(kMostLines, inexact.size()); ++i) {
    text += inexact[i] + "\n";
  }
  if (inexact.size() > kMostLines) {
    text += fmt::format("and {} more\n", inexact.size() - kMostLines);
  }
  return text;
}

}  // namespace

std::map<int, std::string> external_axes_of(const std::vector<std::string>& texts, const Robot& robot) {
  std::map<int, std::string> axes;
  const std::vector<std::string> joints = joint_names(robot);
  for (const auto& [axis, joint] : keys_and_values("--external-axis", texts)) {
    if (axis.size() != 2 || axis.front() != 'E' || axis.back() < '1' || axis.back() > '6') {
      throw InputError("--external-axis: " + shown(axis) + " is no external axis, expected E1 to E6");
    }
    if (std::find(joints.begin(), joints.end(), joint) == joints.end()) {
      throw InputError("--external-axis: " + robot.source + " has no joint " + shown(joint) + ", expected one of " +
                       comma_separated(joints));
    }
    axes[axis.back() - '0'] = joint;
  }
  return axes;
}

ExitStatus compensate_program(const ProgramArguments& arguments, const Robot& robot, const Compensator& compensator) {
  const std::string record = arguments.output + std::string(kRecord);
  std::vector<OutputFile> files = {{.option = "--output", .path = arguments.output, .text = {}},
                                   {.option = "--output", .path = record, .text = {}}};
  require_writable(files, arguments.force);
  const std::string text = read_text_file(arguments.program);
  require_program_of_the_user(arguments.program, text);
  Controller controller = controller_of(arguments, robot);
  controller.external_axes = arguments.external_axes;
  if (!arguments.frames.empty()) {
    controller.frames = read_numbered_frames(arguments.frames);
    if (std::filesystem::path(arguments.frames).extension() == ".json") {
      warn_if_found_with_another(found_with(read_json(arguments.frames), arguments.frames), arguments.frames,
                                 arguments.result);
    }
  }
  CompensatedProgram program = compensated_program(robot, compensator, controller, text, arguments.program);
  files[1].text = record_of(arguments, program);
  files[0].text = std::move(program.text);
  write_whole(files, arguments.force, arguments.json ? files[1].text : table(program));
  for (const std::string& warning : program.warnings) {
    warn(warning);
  }
  for (const PathDeviation& path : program.paths) {
    warn(fmt::format(
        "{}:{}: from P[{}] to P[{}] the tool leaves the asked path by {}: more positions help", arguments.program,
        path.line, path.from, path.to,
        std::isfinite(path.deviation) ? fixed(path.deviation * 1e3, 3) + " mm" : "more than can be followed"));
  }
  const bool all_exact =
      std::all_of(program.positions.begin(), program.positions.end(),
                  [](const CompensatedPosition& position) { return position.status == CompensationStatus::exact; });
  return all_exact ? done : not_to_be_trusted;
}

}  // namespace kdl_calibration::cli
