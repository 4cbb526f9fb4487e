#pragma once

// Units in the headers of tables.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

namespace kdl_calibration {

enum class Unit : std::uint8_t { none, rad, deg, m, mm };

double to_si(double value, Unit unit);
/// The SI value as text in the unit, without the last digits, which the conversion makes inexact.
std::string in_unit(double value, Unit unit);
/// The unit of its canonical word; `none` for any other text.
Unit unit_named(std::string_view word);

std::string lower_case(std::string_view text);

/// A lower-case word of a file and its meaning.
using Word = std::pair<std::string_view, std::string_view>;

/// In octal: the degree sign in UTF-8, and the single byte in Windows-1252.
inline constexpr std::array kUnitWords = {
    Word{"rad", "rad"},        Word{"deg", "deg"},    Word{"degree", "deg"}, Word{"degrees", "deg"},
    Word{"\302\260", "deg"},   Word{"\260", "deg"},   Word{"m", "m"},        Word{"mm", "mm"},
    Word{"nm", "Nm"},          Word{"n", "N"},        Word{"degc", "degC"},  Word{"c", "degC"},
    Word{"\302\260c", "degC"}, Word{"\260c", "degC"}, Word{"kg", "kg"}};

/// The meaning of the text, ignoring case; the text itself if unknown.
std::string_view translated(std::string_view text, std::span<const Word> words);

/// The header cell "name [unit]" or "name (unit)" cut in two. Without brackets at the end the unit is absent.
std::pair<std::string_view, std::optional<std::string_view>> name_and_unit(std::string_view cell);

}  // namespace kdl_calibration
