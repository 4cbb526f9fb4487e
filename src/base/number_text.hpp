#pragma once

// Not installed.

#include <array>
#include <charconv>
#include <string>

namespace kdl_calibration {

/// The fewest digits that read back to the same double, with a point in every locale; never "-0".
inline std::string shortest(double value) {
  std::array<char, 32> digits{};
  const auto result = std::to_chars(digits.data(), digits.data() + digits.size(), value + 0.0);
  return {digits.data(), result.ptr};
}

/// At most so many significant digits, with a point in every locale.
inline std::string significant(double value, int digits) {
  std::array<char, 32> text{};
  const auto result = std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general, digits);
  return {text.data(), result.ptr};
}

}  // namespace kdl_calibration
