#pragma once

// Words in messages. Not installed.

#include <string>
#include <string_view>
#include <vector>

namespace kdl_calibration {

/// Without blanks and tabs at both ends.
std::string_view trimmed(std::string_view text);

bool is_control(char c);

/// Labels end up in JSON results, so what counts is what the JSON writer takes.
bool is_utf8(std::string_view text);

/// The text with line breaks and tabs turned into blanks, so that a message stays on one line, and escaped.
std::string one_line(std::string text);
/// The text with every control character but line feeds and tabs written out, as \x1b, so that no terminal obeys it. A
/// text that is not UTF-8, such as the name of a file, has every byte beyond ASCII written out as well.
std::string escaped(std::string_view text);
/// The text if it has at most `longest` bytes, else its beginning and an ellipsis.
std::string shortened(const std::string& text, std::size_t longest);
std::string in_quotes(const std::string& name);

/// At most some 40 characters of a text for a message, on one line and printable.
std::string printable(std::string_view value);
/// The same in quotes.
std::string shown(std::string_view value);

/// "a, b, c"
std::string comma_separated(const std::vector<std::string>& words);

}  // namespace kdl_calibration
