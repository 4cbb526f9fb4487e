#include "programs/krl_text.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::krl {
namespace {

constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

bool is_space(char c) { return static_cast<unsigned char>(c) <= 0x20U; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || c == '$'; }
char upper(char c) { return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c; }

std::size_t spaces_at(std::string_view text, std::size_t at) {
  while (at < text.size() && is_space(text[at])) {
    ++at;
  }
  return at;
}

// A comment goes from a semicolon outside of a string to the end of the line.
std::string_view without_comment(std::string_view line) {
  std::size_t string = line.find('"');
  std::size_t comment = line.find(';');
  while (comment != std::string_view::npos && string < comment) {
    const std::size_t end = line.find('"', string + 1);
    if (end == std::string_view::npos) {
      return line;
    }
    comment = line.find(';', std::max(comment, end));
    string = line.find('"', end + 1);
  }
  return line.substr(0, comment);
}

char closing_of(char opening) { return opening == '{' ? '}' : opening == '(' ? ')' : ']'; }

}  // namespace

void fail(const Place& place, const std::string& what) {
  throw InputError(fmt::format("{}:{}: {}", place.text->source, place.line, what));
}

Lines::Lines(const ProgramText& text, std::size_t file)
    : at_(text.text.starts_with(kByteOrderMark) ? kByteOrderMark.size() : 0), place_{.text = &text, .file = file} {}

bool Lines::next(std::string_view& line) {
  const std::string_view text = place_.text->text;
  while (at_ < text.size()) {
    const std::size_t end = std::min(text.find('\n', at_), text.size());
    line = stripped(without_comment(text.substr(at_, end - at_)));
    at_ = end + 1;
    ++place_.line;
    if (!line.empty() && line.front() != '&') {
      return true;
    }
  }
  place_.line = std::max<std::size_t>(place_.line, 1);
  return false;
}

std::string_view stripped(std::string_view text) {
  while (!text.empty() && is_space(text.front())) {
    text.remove_prefix(1);
  }
  while (!text.empty() && is_space(text.back())) {
    text.remove_suffix(1);
  }
  return text;
}

std::string in_upper_case(std::string_view text) {
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(), upper);
  return result;
}

std::string_view word_at(std::string_view text) {
  std::size_t end = 0;
  while (end < text.size() && (is_letter(text[end]) || (end > 0 && is_digit(text[end])))) {
    ++end;
  }
  return text.substr(0, end);
}

bool is_word(std::string_view text, std::string_view word) {
  return text.size() == word.size() &&
         std::equal(text.begin(), text.end(), word.begin(), [](char a, char b) { return upper(a) == b; });
}

std::string_view rest_after(std::string_view text, std::size_t size) { return stripped(text.substr(size)); }

Reference reference_at(std::string_view text) {
  const std::string_view word = word_at(text);
  Reference result{.name = in_upper_case(word), .index = {}, .member = {}, .size = word.size()};
  if (word.empty()) {
    return result;
  }
  std::size_t at = spaces_at(text, result.size);
  while (at < text.size() && (text[at] == '[' || text[at] == '.')) {
    if (text[at] == '[') {
      const std::size_t end = closing_bracket(text, at).value_or(text.size());
      if (!result.index && result.member.empty()) {
        result.index = stripped(text.substr(at + 1, end - at - 1));
      }
      result.size = std::min(end + 1, text.size());
    } else {
      const std::size_t begin = spaces_at(text, at + 1);
      const std::string_view member = word_at(text.substr(begin));
      result.member = result.member.empty() ? member : result.member;
      result.size = begin + member.size();
    }
    at = spaces_at(text, result.size);
  }
  return result;
}

std::optional<std::string_view> assigned_value(std::string_view text, const Reference& left) {
  const std::string_view rest = rest_after(text, left.size);
  if (left.name.empty() || !rest.starts_with('=') || rest.starts_with("==")) {
    return std::nullopt;
  }
  return rest_after(rest, 1);
}

std::optional<std::size_t> closing_bracket(std::string_view text, std::size_t begin) {
  const char opening = text[begin];
  const char closing = closing_of(opening);
  std::size_t depth = 0;
  bool is_in_string = false;
  for (std::size_t i = begin; i < text.size(); ++i) {
    is_in_string = is_in_string != (text[i] == '"');
    if (is_in_string) {
      continue;
    }
    depth += text[i] == opening ? 1 : 0;
    if (text[i] == closing && --depth == 0) {
      return i;
    }
  }
  return std::nullopt;
}

std::vector<std::string_view> list_parts(std::string_view text) {
  std::vector<std::string_view> parts;
  std::size_t begin = 0;
  std::size_t depth = 0;
  bool is_in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    is_in_string = is_in_string != (c == '"');
    if (is_in_string) {
      continue;
    }
    if (c == '{' || c == '(' || c == '[') {
      ++depth;
    } else if (c == '}' || c == ')' || c == ']') {
      depth -= depth > 0 ? 1 : 0;
    } else if (c == ',' && depth == 0) {
      parts.push_back(stripped(text.substr(begin, i - begin)));
      begin = i + 1;
    }
  }
  parts.push_back(stripped(text.substr(begin)));
  return parts;
}

std::optional<Aggregate> aggregate_at(std::string_view text, const Place& place) {
  if (!text.starts_with('{')) {
    return std::nullopt;
  }
  const std::optional<std::size_t> end = closing_bracket(text);
  if (!end) {
    fail(place, "has " + shown(text) + " without its end, expected } in the same line");
  }
  std::string_view content = stripped(text.substr(1, *end - 1));
  const std::string_view type = word_at(content);
  if (const std::string_view rest = rest_after(content, type.size()); !type.empty() && rest.starts_with(':')) {
    content = rest_after(rest, 1);
  }
  Aggregate result{.members = {}, .size = *end + 1};
  for (const std::string_view part : list_parts(content)) {
    const std::string_view name = word_at(part);
    if (!part.empty()) {
      result.members.push_back({.name = name, .value = rest_after(part, name.size())});
    }
  }
  return result;
}

std::optional<double> number_in(std::string_view text) {
  if (text.starts_with('+')) {
    text.remove_prefix(1);
    if (text.starts_with('-')) {
      return std::nullopt;
    }
  }
  double value = 0.0;
  const char* end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, value);
  if (result.ec != std::errc() || result.ptr != end || !std::isfinite(value)) {
    return std::nullopt;
  }
  return value;
}

std::optional<int> whole_number_in(std::string_view text) {
  int base = 10;
  if (text.size() > 3 && text.front() == '\'' && text.back() == '\'') {
    base = upper(text[1]) == 'B' ? 2 : upper(text[1]) == 'H' ? 16 : 0;
    text = text.substr(2, text.size() - 3);
  }
  int value = 0;
  const char* end = text.data() + text.size();
  if (base == 0 || text.empty()) {
    return std::nullopt;
  }
  const auto result = std::from_chars(text.data(), end, value, base);
  return result.ec == std::errc() && result.ptr == end ? std::optional(value) : std::nullopt;
}

}  // namespace kdl_calibration::krl
