#include "cli/plan_command.hpp"

#include <string_view>

#include "base/sha256.hpp"
#include "cli/planned_cell.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr int kConfigurationsToAdd = 10;

// This member of an input file, by its role.
std::string of_input(const Json& result, const std::string& role, const char* key) {
  if (!result.is_object() || !result.contains("provenance") || !result["provenance"].is_object() ||
      !result["provenance"].contains("files_read") || !result["provenance"]["files_read"].is_array()) {
    return {};
  }
  for (const Json& file : result["provenance"]["files_read"]) {
    if (text_at(file, "role") == role) {
      return text_at(file, key);
    }
  }
  return {};
}

std::string path_of(const Json& result, const std::string& role) { return of_input(result, role, "path"); }

}  // namespace

std::string text_at(const Json& object, const char* key) {
  return object.is_object() && object.contains(key) && object[key].is_string() ? object[key].get<std::string>()
                                                                               : std::string();
}

std::optional<std::string> hash_of_input(const Json& result, const std::string& role) {
  const std::string hash = of_input(result, role, "sha256");
  return hash.empty() ? std::nullopt : std::optional(hash);
}

void require_same_input(const Json& result, const std::string& source, const std::string& role,
                        const std::string& path) {
  const std::optional<std::string> hash = hash_of_input(result, role);
  if (!hash) {
    return;
  }
  if (path.empty()) {
    throw InputError("--" + role + ": " + source + " was made with one, expected the same file here");
  }
  if (sha256_of_file(path) != *hash) {
    throw InputError("--" + role + ": '" + path + "' is not the file that " + source +
                     " was made with, its hash is another one; expected that file");
  }
}

void warn_of_other_convention(const Json& result, const std::string& source, const std::string& path) {
  const std::optional<std::string> hash = hash_of_input(result, "joint-convention");
  if (hash && sha256_of_file(path) != *hash) {
    warn("--joint-convention: " + source + " was made with another one than '" + path +
         "'; are these joint values counted as that says?");
  }
}

void warn_of_other_convention(const std::string& source, const std::string& path) {
  if (!source.empty() && !path.empty()) {
    warn_of_other_convention(read_json(source), source, path);
  }
}

void require_after_entry(const Json& result, const std::string& source, const std::string& measurements) {
  if (result.is_object() && result.contains("mastering_entered") &&
      hash_of_input(result, "measurements") == sha256_of_file(measurements)) {
    throw InputError("--measurements: were taken before the mastering of " + source +
                     " was entered, expected others, or the result before the entry");
  }
}

std::string shell_word(const std::string& text) {
  constexpr std::string_view kPlain = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_./+=:@%,-";
  if (!text.empty() && text.find_first_not_of(kPlain) == std::string::npos) {
    return text;
  }
  std::string quoted = "'";
  for (const char c : text) {
    if (c == '\'') {
      quoted += "'\\''";
    } else {
      quoted += c;
    }
  }
  return quoted + "'";
}

namespace {

// The options that name the robot and its joints.
std::string robot_options(const Json& result) {
  const Json& input = result["input"];
  const bool is_table = !path_of(result, "dh").empty();
  std::string options;
  for (const auto& [option, value] :
       {std::pair{is_table ? "--dh" : "--urdf", text_at(input, "urdf")}, std::pair{"--base", text_at(input, "base")},
        std::pair{"--tip", text_at(input, "tip")},
        std::pair{"--joint-convention", path_of(result, "joint-convention")}}) {
    options += value.empty() ? "" : " " + std::string(option) + " " + shell_word(value);
  }
  return options;
}

// The options that say how the measurements are read, and the cell of the plan that was measured.
std::string reading_and_cell(const Json& result) {
  const Json provenance = result.value("provenance", Json());
  const Json stated = provenance.is_object() ? provenance.value("options", Json()) : Json();
  const std::string joints = path_of(result, "joints-file");
  std::string options = joints.empty() ? "" : " --joints-file " + shell_word(joints);
  for (const char* option : {"--point-names", "--exclude", "--orientation"}) {
    const std::string value = text_at(stated, option);
    options += value.empty() ? "" : " " + std::string(option) + " " + shell_word(value);
  }
  const std::string cell = planned_cell_of(result);
  return options + (cell.empty() ? "" : " " + cell);
}

}  // namespace

std::string plan_command(const Json& result) {
  if (!result.is_object() || !result.contains("input") || result.contains("stations")) {
    return {};
  }
  const std::string measured = text_at(result["input"], "measurements");
  return measured.empty()
             ? std::string()
             : "kdlcal plan" + robot_options(result) + " --measured " + shell_word(measured) +
                   reading_and_cell(result) + " --add " + std::to_string(kConfigurationsToAdd) + " --output plan.csv";
}

std::string apply_command(const Json& result, const std::string& file) {
  if (!result.is_object() || !result.contains("input") || !result.contains("joint_offsets")) {
    return {};
  }
  const std::string entered = result.contains("mastering_entered") ? "entered_again" : "entered";
  return "kdlcal apply --result " + shell_word(file.empty() ? "result.json" : file) + robot_options(result) +
         " --mastering-entered " + entered + ".csv --output " + entered + ".json --output-urdf " + entered + ".urdf";
}

}  // namespace kdl_calibration::cli
