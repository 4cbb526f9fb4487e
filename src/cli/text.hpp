#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace kdl_calibration::cli {

/// Parses the whole text as a finite number, in any locale; else empty.
std::optional<double> parsed_number(std::string_view text);

/// Writes to standard output. Throws InputError on failure.
void print(std::string_view text);

/// One line on standard error that starts with "kdlcal: note: ", for what asks for no action.
void inform(const std::string& text);
/// One line on standard error that starts with "kdlcal: warning: ".
void warn(const std::string& text);
/// One line on standard error that starts with "kdlcal: not to be trusted: ".
void print_doubt(const std::string& text);
/// One line on standard error that starts with "kdlcal: required: ".
void print_requirement(const std::string& text);

}  // namespace kdl_calibration::cli
