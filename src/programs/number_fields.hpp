#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "programs/program.hpp"

namespace kdl_calibration {

/// `text` with the values of these fields, which are in the order of the text, each written by `language.write`. A
/// number that is the same to its decimals keeps its bytes.
std::string with_numbers(std::string_view text, const std::vector<NumberField>& fields,
                         const ProgramLanguage& language);
/// The same for the fields that `add(i, fields)` appends for each i below `count`. Called from several threads.
std::string with_numbers(std::string_view text, std::size_t count,
                         const std::function<void(std::size_t i, std::vector<NumberField>& fields)>& add,
                         const ProgramLanguage& language);

/// The value with this many decimals behind the blanks of `old`, for languages that need no more.
std::string written_plainly(std::string_view old, double value, int decimals);

/// Digits behind the decimal point of a number, at least `least`; the exponent of "1.5E-3" counts.
int decimals_of(std::string_view number, int least);

}  // namespace kdl_calibration
