#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

#include "cli/frames.hpp"

namespace kdl_calibration::cli {

/// What a number of the result must be: "leave_one_out.rms<=0.25mm".
struct Requirement {
  std::string text;               ///< as it was given
  std::vector<std::string> path;  ///< keys, or numbers of an array's entries, from 0
  std::string comparison;         ///< "<", "<=", ">", ">=", "=="
  double value = 0.0;             ///< SI
};

/// Throws InputError where the text is none.
Requirement parse_requirement(const std::string& text);

/// What came of one. `position_error.` before a path and `.after` in it may be left out; what is null or absent fulfils
/// nothing.
struct Judged {
  std::string text;     ///< of the requirement
  std::string message;  ///< a sentence where it is not fulfilled, else empty
};
std::vector<Judged> outcomes_of(const std::vector<Requirement>& requirements, const Json& json);

/// The messages of those that are not fulfilled.
std::vector<std::string> unfulfilled(const std::vector<Judged>& outcomes);

/// [{text, fulfilled, message}], as a result has it under "requirements".
Json judged_json(const std::vector<Judged>& outcomes);

/// --require
void add_require(CLI::App& app, std::vector<std::string>& texts);
std::vector<Requirement> parse_requirements(const std::vector<std::string>& texts);

}  // namespace kdl_calibration::cli
