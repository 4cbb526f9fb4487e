#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace kdl_calibration::cli {

/// The number that the whole text is, in any locale; none where it is none or not finite.
std::optional<double> parsed_number(std::string_view text);

/// "1.23e-05" for 0.000012345 with 2 decimals.
std::string scientific(double value, int decimals);

/// The text with blanks in front (or behind, for a negative width) up to this many characters.
std::string padded(const std::string& text, int width);

/// Writes to standard output. Throws InputError where that fails.
void print(std::string_view text);

/// One line on standard error that starts with "kdlcal: warning: ".
void warn(const std::string& text);
/// One line on standard error that starts with "kdlcal: not to be trusted: ".
void doubt_aloud(const std::string& text);
/// One line on standard error that starts with "kdlcal: required: ".
void require_aloud(const std::string& text);

}  // namespace kdl_calibration::cli
