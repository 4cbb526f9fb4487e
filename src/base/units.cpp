#include "base/units.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/number_text.hpp"
#include "base/text.hpp"

namespace kdl_calibration {
namespace {

/// Position of the opening bracket whose closing one ends the cell.
std::size_t opening_bracket(std::string_view cell) {
  if (cell.ends_with(']')) return cell.rfind('[');
  return cell.ends_with(')') ? cell.rfind('(') : std::string_view::npos;
}

}  // namespace

double to_si(double value, Unit unit) {
  if (unit == Unit::deg) return value * (std::numbers::pi / 180.0);
  if (unit == Unit::mm) return value / 1000.0;
  return value;
}

std::string in_unit(double value, Unit unit) { return shortest(std::round(value / to_si(1.0, unit) * 1e9) / 1e9); }

Unit unit_named(std::string_view word) {
  if (word == "rad") return Unit::rad;
  if (word == "deg") return Unit::deg;
  if (word == "m") return Unit::m;
  return word == "mm" ? Unit::mm : Unit::none;
}

std::string lower_case(std::string_view text) {
  std::string result(text);
  for (char& c : result) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return result;
}

std::string_view translated(std::string_view text, std::span<const Word> words) {
  const auto found =
      std::find_if(words.begin(), words.end(), [lower = lower_case(text)](const Word& w) { return w.first == lower; });
  return found == words.end() ? text : found->second;
}

std::pair<std::string_view, std::optional<std::string_view>> name_and_unit(std::string_view cell) {
  const std::size_t open = opening_bracket(cell);
  if (open == std::string_view::npos) return {cell, std::nullopt};
  return {trimmed(cell.substr(0, open)), trimmed(cell.substr(open + 1, cell.size() - open - 2))};
}

}  // namespace kdl_calibration
