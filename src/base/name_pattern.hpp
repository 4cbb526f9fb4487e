#pragma once

// Name patterns with wildcards.

#include <string_view>

namespace kdl_calibration {

/// Whether the name matches a shell pattern: * is any text, ? any one character.
bool matches_pattern(std::string_view pattern, std::string_view name);

}  // namespace kdl_calibration
