#include "base/wrapped_text.hpp"

#include <algorithm>

namespace kdl_calibration {

std::string wrapped(std::string_view text, std::size_t first, std::size_t indent, std::size_t width) {
  std::string result(first, ' ');
  std::size_t column = first;  // characters, not bytes
  bool at_start = true;
  while (!text.empty()) {
    const std::string_view word = text.substr(0, text.find(' '));
    text.remove_prefix(std::min(text.size(), word.size() + 1));
    if (word.empty()) {
      continue;
    }
    const auto length = static_cast<std::size_t>(std::count_if(
        word.begin(), word.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
    if (!at_start && column + 1 + length > width) {
      result += "\n" + std::string(indent, ' ');
      column = indent;
      at_start = true;
    }
    result += at_start ? "" : " ";
    column += (at_start ? 0 : 1) + length;
    result += word;
    at_start = false;
  }
  return result + "\n";
}

}  // namespace kdl_calibration
