#pragma once

// Not installed.

#include <string>

namespace kdl_calibration {

/// The text as one field of a CSV line, in quotes where it would otherwise be read as something else.
inline std::string csv_cell(const std::string& text) {
  const bool plain = !text.empty() && text.front() != '#' && text.find_first_of(",;\"") == std::string::npos &&
                     text.front() != ' ' && text.back() != ' ';
  if (plain) {
    return text;
  }
  std::string quoted = "\"";
  for (const char c : text) {
    quoted += c == '"' ? "\"\"" : std::string(1, c);
  }
  return quoted + "\"";
}

}  // namespace kdl_calibration
