#include "base/text.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace kdl_calibration {

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

namespace {

void append_code(char c, std::string& text) {
  constexpr std::string_view kHexDigits = "0123456789abcdef";
  const auto byte = static_cast<unsigned char>(c);
  text += {'\\', 'x', kHexDigits[byte >> 4U], kHexDigits[byte & 0xfU]};
}

bool is_ascii(char c) { return static_cast<unsigned char>(c) < 0x80U; }

}  // namespace

bool is_control(char c) { return static_cast<unsigned char>(c) < 0x20U || c == '\x7f'; }

bool is_utf8(std::string_view text) {
  if (std::all_of(text.begin(), text.end(), is_ascii)) return true;
  try {
    static_cast<void>(nlohmann::json(text).dump());
    return true;
  } catch (const nlohmann::json::type_error&) {
    return false;
  }
}

std::string printable(std::string_view value) {
  constexpr std::size_t kLongest = 40;
  const bool keep_unicode = is_utf8(value);
  std::size_t length = std::min(value.size(), kLongest);
  if (keep_unicode && length < value.size()) {
    while (length > 0 && (static_cast<unsigned char>(value[length]) & 0xc0U) == 0x80U) --length;
  }
  std::string text;
  for (const char c : value.substr(0, length)) {
    if (is_control(c) || (!is_ascii(c) && !keep_unicode)) {
      append_code(c, text);
    } else {
      text += c;
    }
  }
  return text + (length < value.size() ? "..." : "");
}

std::string shown(std::string_view value) { return "'" + printable(value) + "'"; }

std::string one_line(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '\n' || c == '\r' || c == '\t'; }, ' ');
  return escaped(text);
}

std::string escaped(std::string_view text) {
  const bool keep_unicode = is_utf8(text);
  std::string result;
  for (const char c : text) {
    if ((is_control(c) && c != '\n' && c != '\t') || (!is_ascii(c) && !keep_unicode)) {
      append_code(c, result);
    } else {
      result += c;
    }
  }
  return result;
}

std::string shortened(const std::string& text, std::size_t longest) {
  if (text.size() <= longest) {
    return text;
  }
  std::size_t length = longest;
  while (length > 0 && (static_cast<unsigned char>(text[length]) & 0xc0U) == 0x80U) {  // inside a UTF-8 character
    --length;
  }
  return text.substr(0, length) + "...";
}

std::string in_quotes(const std::string& name) { return "'" + one_line(name) + "'"; }

std::string padded(std::string text, std::size_t width) {
  text.resize(std::max(width, text.size()), ' ');
  return text;
}

std::string comma_separated(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    text += (text.empty() ? "" : ", ") + word;
  }
  return text;
}

}  // namespace kdl_calibration
