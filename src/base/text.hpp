#pragma once

// Words in messages. Not installed.

#include <algorithm>
#include <string>
#include <vector>

namespace kdl_calibration {

/// The text with every control character turned into a blank, so that a message stays on one line.
inline std::string one_line(std::string text) {
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < 0x20U || c == '\x7f'; };
  std::replace_if(text.begin(), text.end(), is_control, ' ');
  return text;
}

inline std::string in_quotes(const std::string& name) { return "'" + one_line(name) + "'"; }

/// "a, b, c"
inline std::string comma_separated(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    text += (text.empty() ? "" : ", ") + word;
  }
  return text;
}

}  // namespace kdl_calibration
