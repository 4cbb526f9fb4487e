#pragma once

// Parsing of all JSON input.

#include <fmt/core.h>
#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {

/// Parses JSON of at most 100 nested levels, because printing is recursive. `check` is the parser's callback and may
/// throw. Throws InputError with the line if the text is not JSON.
template <class Json, class Check>
Json parse_json(std::string_view text, const std::string& source, const Check& check) {
  constexpr int kDeepest = 100;
  const auto checked = [&](int depth, typename Json::parse_event_t event, const Json& value) {
    if (depth > kDeepest) {
      throw InputError(source + ": values are nested deeper than the limit of 100");
    }
    check(depth, event, value);
    return true;
  };
  try {
    return Json::parse(text, checked);
  } catch (const typename Json::parse_error& error) {
    const std::size_t end = std::min(error.byte, text.size());
    const auto line = 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(end), '\n');
    throw InputError(fmt::format("{}:{}: malformed JSON at byte {}", source, line, error.byte));
  } catch (const typename Json::exception&) {
    throw InputError(source + ": JSON with a number outside the range of a double, expected finite numbers");
  }
}

}  // namespace kdl_calibration
