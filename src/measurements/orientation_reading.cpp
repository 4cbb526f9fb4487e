#include "kdl_calibration/orientation_reading.hpp"

#include <array>
#include <utility>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

constexpr std::array kReadingWords = {std::pair{OrientationReading::rotation_vector, "rotation-vector"},
                                      std::pair{OrientationReading::fixed_xyz, "fixed-xyz"},
                                      std::pair{OrientationReading::moving_xyz, "moving-xyz"},
                                      std::pair{OrientationReading::moving_zyx, "moving-zyx"}};

}  // namespace

std::string to_string(OrientationReading reading) {
  for (const auto& [each, word] : kReadingWords) {
    if (each == reading) {
      return word;
    }
  }
  return {};
}

std::vector<std::string> orientation_words() {
  std::vector<std::string> words;
  for (const auto& entry : kReadingWords) {
    words.emplace_back(entry.second);
  }
  return words;
}

OrientationReading orientation_reading(std::string_view word) {
  for (const auto& [each, name] : kReadingWords) {
    if (name == word) {
      return each;
    }
  }
  if (!word.empty()) {
    throw InputError("orientation: " + shown(word) + " is unknown, expected one of " +
                     comma_separated(orientation_words()));
  }
  return OrientationReading::usual;
}

}  // namespace kdl_calibration
