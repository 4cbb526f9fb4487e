#include "cli/compensate_program.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <string_view>
#include <vector>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "cli/data_dir.hpp"
#include "cli/frames.hpp"
#include "cli/output_files.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/compensated_program.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr std::string_view kRecord = ".kdlcal.json";  // after the name of the program
constexpr std::size_t kJoints = 6;

// A program that this command wrote has its record beside it.
void require_program_of_the_user(const std::string& file, const std::string& text) {
  const std::string record = file + std::string(kRecord);
  if (std::filesystem::exists(record) && read_text_file(record).find(sha256(text)) != std::string::npos) {
    throw InputError(file + ": this program is compensated already, expected the original");
  }
}

Json record_of(const ProgramArguments& arguments, const CompensatedProgram& program) {
  Json positions = Json::array();
  for (const CompensatedPosition& position : program.positions) {
    Json change = Json::array();
    for (const double each : position.change) {
      change.push_back(each);
    }
    positions.push_back({{"position", position.number},
                         {"status", to_string(position.status)},
                         {"written", position.written},
                         {"change", change},
                         {"position_error", position.position_error},
                         {"orientation_error", position.orientation_error}});
  }
  Json paths = Json::array();
  for (const PathDeviation& path : program.paths) {
    paths.push_back({{"line", path.line},
                     {"from", path.from},
                     {"to", path.to},
                     {"deviation", std::isfinite(path.deviation) ? Json(path.deviation) : Json()}});
  }
  return {{"result_sha256", sha256_of_file(arguments.result)},
          {"program_sha256", sha256(program.text)},
          {"positions", positions},
          {"largest_rounding", program.rounding},
          {"paths", paths},
          {"warnings", program.warnings}};
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

ExitStatus compensate_program(const ProgramArguments& arguments, const Robot& robot, const Compensator& compensator) {
  const std::string record = arguments.output + std::string(kRecord);
  std::vector<OutputFile> files = {{.option = "--output", .path = arguments.output, .text = {}},
                                   {.option = "--output", .path = record, .text = {}}};
  require_writable(files, arguments.force);
  const std::string text = read_text_file(arguments.program);
  require_program_of_the_user(arguments.program, text);
  Controller controller =
      read_controller(arguments.controller.empty() ? urdf_dir() / "fanuc_r2000ic_165f_controller.json"
                                                   : std::filesystem::path(arguments.controller));
  if (!arguments.frames.empty()) {
    controller.frames = read_numbered_frames(arguments.frames);
  }
  const CompensatedProgram program = compensated_program(robot, compensator, controller, text, arguments.program);
  const Json details = record_of(arguments, program);
  files[0].text = program.text;
  files[1].text = json_text(details);
  write_whole(files, arguments.force, arguments.json ? json_text(details) : table(program));
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
