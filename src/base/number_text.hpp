#pragma once

#include <fmt/core.h>
#include <array>
#include <charconv>
#include <string>

namespace kdl_calibration {

/// Shortest text that reads back to the same double, with a point in every locale; never "-0". The "{}" of fmt writes
/// other texts, such as 100000 for 1e+05.
inline std::string shortest(double value) {
  std::array<char, 32> digits{};
  const auto result = std::to_chars(digits.data(), digits.data() + digits.size(), value + 0.0);
  return {digits.data(), result.ptr};
}

/// "12.346" for 12.34567 with 3 decimals, with a point in every locale; never "-0.000".
inline std::string fixed(double value, int decimals) {
  std::string text = fmt::format("{:.{}f}", value + 0.0, decimals);  // adding zero turns -0 into 0
  const bool negative_zero = text.front() == '-' && text.find_first_of("123456789in") == std::string::npos;
  return negative_zero ? text.substr(1) : text;
}

}  // namespace kdl_calibration
