#pragma once

// Line wrapping for terminals.

#include <cstddef>
#include <string>
#include <string_view>

namespace kdl_calibration {

/// The text in lines of at most `width` characters, broken at blanks: the first begins with `first` blanks, the others
/// with `indent`. A longer word gets its own line. Ends with a line break.
std::string wrapped(std::string_view text, std::size_t first, std::size_t indent, std::size_t width = 80);

}  // namespace kdl_calibration
