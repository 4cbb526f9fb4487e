#pragma once

#include <gmock/gmock.h>

#include <array>
#include <cstdio>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

namespace kdl_calibration::testing {

/// "12.346" for 12.3456 with 3 decimals, by another way than the program's. No zero has a sign.
inline std::string decimals(double value, int count) {
  std::array<char, 400> text{};
  std::snprintf(text.data(), text.size(), "%.*f", count, value);
  const bool is_zero = std::string_view(text.data()).find_first_not_of("-0.") == std::string_view::npos;
  return text.data() + (is_zero && text[0] == '-' ? 1 : 0);
}

/// printf.
template <class... Values>
std::string printed(const char* format, Values... values) {
  std::array<char, 1000> text{};
  std::snprintf(text.data(), text.size(), format, values...);
  return text.data();
}

/// The text without blanks at either end, and each run of blanks as one.
inline std::string squeezed(std::string_view text) {
  std::string result;
  for (const char c : text) {
    if (c != ' ' || (!result.empty() && result.back() != ' ')) {
      result += c;
    }
  }
  return result.empty() || result.back() != ' ' ? result : result.substr(0, result.size() - 1);
}

/// The lines of a printed text, which must end with a line break.
inline std::vector<std::string> lines_of(std::string_view text) {
  EXPECT_TRUE(text.empty() || text.back() == '\n') << "expected a line break at the end, got: " << text;
  std::vector<std::string> lines;
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    lines.emplace_back(text.substr(0, end));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  }
  return lines;
}

/// Of a CSV file without quotes, by rows.
inline std::vector<std::vector<std::string>> cells_of(std::string_view csv) {
  std::vector<std::vector<std::string>> rows;
  for (const std::string& line : lines_of(csv)) {
    rows.emplace_back();
    std::istringstream fields(line);
    for (std::string field; std::getline(fields, field, ',');) {
      rows.back().push_back(field);
    }
  }
  return rows;
}

/// Expects line by line the same words, however many blanks are between them.
inline void expect_lines(std::string_view printed, const std::vector<std::string>& expected, const std::string& what) {
  const std::vector<std::string> lines = lines_of(printed);
  for (std::size_t i = 0; i < std::max(lines.size(), expected.size()); ++i) {
    const std::string got = i < lines.size() ? squeezed(lines[i]) : "no such line";
    const std::string wanted = i < expected.size() ? squeezed(expected[i]) : "no such line";
    EXPECT_EQ(got, wanted) << what << ", line " << i + 1;
  }
}

/// Columns behind which each of the `count` last words of a line ends.
inline std::vector<std::size_t> word_ends(const std::string& line, std::size_t count) {
  std::vector<std::size_t> ends;
  for (std::size_t i = line.size(); i > 0 && ends.size() < count; --i) {
    if (line[i - 1] != ' ' && (i == line.size() || line[i] == ' ')) {
      ends.insert(ends.begin(), i);
    }
  }
  return ends;
}

}  // namespace kdl_calibration::testing
