#pragma once

// Not installed.

#include <array>
#include <charconv>
#include <string>

namespace kdl_calibration {

/// Shortest text that reads back to the same double, with a point in every locale; never "-0".
inline std::string shortest(double value) {
  std::array<char, 32> digits{};
  const auto result = std::to_chars(digits.data(), digits.data() + digits.size(), value + 0.0);
  return {digits.data(), result.ptr};
}

/// "12.346" for 12.34567 with 3 decimals, with a point in every locale; never "-0.000".
inline std::string fixed(double value, int decimals) {
  std::array<char, 512> buffer{};
  // Adding zero turns -0 into 0.
  const auto result =
      std::to_chars(buffer.data(), buffer.data() + buffer.size(), value + 0.0, std::chars_format::fixed, decimals);
  std::string text(buffer.data(), result.ptr);
  const bool negative_zero = text.front() == '-' && text.find_first_of("123456789in") == std::string::npos;
  return negative_zero ? text.substr(1) : text;
}

/// Text with at most `digits` significant digits, with a point in every locale.
inline std::string significant(double value, int digits) {
  std::array<char, 32> text{};
  const auto result = std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general, digits);
  return {text.data(), result.ptr};
}

}  // namespace kdl_calibration
