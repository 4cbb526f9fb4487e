#include "cli/plan_command.hpp"

#include <string_view>

namespace kdl_calibration::cli {
namespace {

constexpr int kConfigurationsToAdd = 10;

// Path of an input file, by its role.
std::string path_of(const Json& result, const std::string& role) {
  if (!result.contains("provenance") || !result["provenance"].is_object() ||
      !result["provenance"].contains("files_read") || !result["provenance"]["files_read"].is_array()) {
    return {};
  }
  for (const Json& file : result["provenance"]["files_read"]) {
    if (text_at(file, "role") == role) {
      return text_at(file, "path");
    }
  }
  return {};
}

}  // namespace

std::string text_at(const Json& object, const char* key) {
  return object.is_object() && object.contains(key) && object[key].is_string() ? object[key].get<std::string>()
                                                                               : std::string();
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

std::string plan_command(const Json& result) {
  if (!result.is_object() || !result.contains("input") || result.contains("stations")) {
    return {};
  }
  const Json& input = result["input"];
  const std::string measured = text_at(input, "measurements");
  if (measured.empty()) {
    return {};
  }
  std::string command = "kdlcal plan";
  const bool is_table = !path_of(result, "dh").empty();
  for (const auto& [option, value] :
       {std::pair{is_table ? "--dh" : "--urdf", text_at(input, "urdf")}, std::pair{"--base", text_at(input, "base")},
        std::pair{"--tip", text_at(input, "tip")}, std::pair{"--joint-convention", path_of(result, "joint-convention")},
        std::pair{"--measured", measured}}) {
    if (!value.empty()) {
      command += " " + std::string(option) + " " + shell_word(value);
    }
  }
  return command + " --add " + std::to_string(kConfigurationsToAdd) + " --output plan.csv";
}

}  // namespace kdl_calibration::cli
