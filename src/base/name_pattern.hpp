#pragma once

// Names that stand for several. Not installed.

#include <string_view>

namespace kdl_calibration {

/// Whether the name is one of those that a shell's pattern stands for: * is any text, ? any one character.
bool matches_pattern(std::string_view pattern, std::string_view name);

}  // namespace kdl_calibration
