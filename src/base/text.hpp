#pragma once

// Text functions for messages.

#include <string>
#include <string_view>
#include <vector>

namespace kdl_calibration {

/// The text without blanks and tabs at both ends.
std::string_view trimmed(std::string_view text);

bool is_control(char c);

/// Whether the JSON writer accepts the text, because labels are written to JSON results.
bool is_utf8(std::string_view text);

/// The text, escaped, with line breaks and tabs replaced by blanks.
std::string one_line(std::string text);
/// The text with control characters except line feeds and tabs written as \x1b, so that terminals ignore them. In texts
/// that are not UTF-8, such as file names, every byte beyond ASCII is written so too.
std::string escaped(std::string_view text);
/// The text if it has at most `longest` bytes, else its beginning and an ellipsis.
std::string shortened(const std::string& text, std::size_t longest);
std::string in_quotes(const std::string& name);
/// The text, with blanks after it up to so many bytes.
std::string padded(std::string text, std::size_t width);

/// At most about 40 characters of a text, on one line and printable, for messages.
std::string printable(std::string_view value);
/// The same in quotes.
std::string shown(std::string_view value);

/// "a, b, c"
std::string comma_separated(const std::vector<std::string>& words);

}  // namespace kdl_calibration
