#include "programs/program_files.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cctype>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "base/number_text.hpp"
#include "base/sha256.hpp"
#include "base/text_file.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/program_language.hpp"
#include "results/result_blocks.hpp"

namespace kdl_calibration {
namespace {

constexpr std::string_view kRecord = ".kdlcal.json";  // after the name of the program
constexpr std::size_t kMostOfAProgram = 512;          // [MiB] of each file: about two million points

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

// A line of JSON. As trees a program's positions would take ten times the memory and time of their compensation.
void add_line(std::string& text, const CompensatedPosition& position) {
  std::string change;
  for (const double each : position.change) {
    change += (change.empty() ? "" : ", ") + shortest(each);
  }
  const CommandedPoint& point = position.point;
  text += fmt::format(
      R"({{"position": {}, "line": {}, "status": "{}", "written": {}, "change": [{}], "position_error": {}, "orientation_error": {}}})",
      Json(position.name).dump(), position.line, to_string(point.status), position.written, change,
      shortest(point.position_error), shortest(point.orientation_error));
}

}  // namespace

ProgramFiles read_program(const std::string& file) {
  ProgramFiles program{.named = file};
  std::vector<ProgramText>& texts = program.texts;
  texts.push_back({.source = file, .text = read_text_file(file, kMostOfAProgram)});
  program.language = &language_of(texts.front());
  const ProgramLanguage& language = *program.language;
  if (language.companion.empty()) {
    return program;
  }
  const bool is_companion = lower_ending(file) == language.companion;
  const std::string main_extension(language.files.substr(0, language.files.find_first_of(", ")));
  const std::string other = file_beside(file, is_companion ? main_extension : language.companion);
  if (!other.empty()) {
    texts.insert(is_companion ? texts.begin() : texts.end(),
                 {.source = other, .text = read_text_file(other, kMostOfAProgram)});
  }
  return program;
}

void require_original(const ProgramFiles& program) {
  for (const ProgramText& beside : program.texts) {
    const std::string record = beside.source + std::string(kRecord);
    if (!std::filesystem::exists(record)) {
      continue;
    }
    const std::string written = read_text_file(record, kMostOfAProgram);
    for (const ProgramText& text : program.texts) {
      if (written.find(sha256(text.text)) != std::string::npos) {
        throw InputError(text.source + ": this program is compensated already, expected the original");
      }
    }
  }
}

std::vector<OutputFile> program_outputs(const ProgramFiles& program, const std::string& output) {
  std::vector<OutputFile> files;
  for (const ProgramText& text : program.texts) {
    std::filesystem::path path = output;
    if (text.source != program.named) {
      path.replace_extension(std::filesystem::path(text.source).extension());
    }
    files.push_back({.option = {}, .path = path.string(), .text = {}});
  }
  files.push_back({.option = {}, .path = output + std::string(kRecord), .text = {}});
  return files;
}

std::string record_head(const CompensatedProgram& program, const std::string& result_sha256, double line_tolerance) {
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
  const Json rest = {{"result_sha256", result_sha256},
                     {"program_sha256", hashes.size() == 1 ? hashes.front() : hashes},
                     {"largest_rounding", program.rounding},
                     {"lines",
                      {{"tried", program.lines},
                       {"tolerance", line_tolerance},
                       {"above_tolerance", program.paths.size()},
                       {"largest_deviation", finite_or_null(program.largest_deviation.position)},
                       {"largest_orientation_deviation", finite_or_null(program.largest_deviation.orientation)}}},
                     {"paths", paths},
                     {"warnings", program.warnings}};
  std::string text = rest.dump(2, ' ', false, Json::error_handler_t::replace);
  text.resize(text.size() - std::string_view("\n}").size());
  return text + ",\n  \"positions\": [";
}

void write_record(const std::string& head, const CompensatedProgram& program, const TextSink& sink) {
  sink(head);
  write_positions(program.positions.size(), sink, [&](std::size_t i, std::string& text) {
    text += i == 0 ? "\n    " : ",\n    ";
    add_line(text, program.positions[i]);
  });
  sink("\n  ]\n}\n");
}

}  // namespace kdl_calibration
