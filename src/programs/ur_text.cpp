#include "programs/ur_text.hpp"

#include <array>
#include <charconv>
#include <cmath>

#include "programs/number_fields.hpp"

namespace kdl_calibration::ur {
namespace {

constexpr std::array kBlocks = std::to_array<std::string_view>({"def", "thread", "sec", "while", "if"});

// What a bracket or a block needs behind it; empty if nothing begins here.
std::string_view end_of(std::string_view word) {
  if (word == "(") {
    return ")";
  }
  if (word == "[" || word == "{") {
    return word == "[" ? "]" : "}";
  }
  return std::find(kBlocks.begin(), kBlocks.end(), word) == kBlocks.end() ? "" : "end";
}

bool is_end(std::string_view word) { return word == ")" || word == "]" || word == "}" || word == "end"; }

}  // namespace

bool is_letter(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

Text::Text(const ProgramText& program) : text_(program.text), source_(program.source) {
  for (std::size_t at = text_.find('\n'); at != std::string_view::npos; at = text_.find('\n', at + 1)) {
    line_begins_.push_back(at + 1);
  }
}

Span Text::stripped(Span span) const {
  constexpr std::string_view kBlanks = " \t\r\n";
  while (span.begin < span.end && kBlanks.find(text_[span.begin]) != std::string_view::npos) {
    ++span.begin;
  }
  while (span.end > span.begin && kBlanks.find(text_[span.end - 1]) != std::string_view::npos) {
    --span.end;
  }
  return span;
}

void Text::require_whole() const {
  std::vector<Span> open;
  std::size_t word_end = 0;
  for_each_byte([&](std::size_t at) {
    if (at < word_end) {
      return;
    }
    for (word_end = at + 1; is_letter(text_[at]) && word_end < text_.size() && is_letter(text_[word_end]);) {
      ++word_end;
    }
    const Span span{.begin = at, .end = word_end};
    const std::string_view word = in(span);
    const bool is_member = at > 0 && text_[at - 1] == '.' && is_letter(text_[at]);
    if (!is_member && !end_of(word).empty()) {
      open.push_back(span);
    } else if (!is_member && is_end(word)) {
      if (open.empty() || end_of(in(open.back())) != word) {
        fail(open.empty() ? at : open.back().begin,
             open.empty() ? fmt::format("'{}' ends nothing, expected the whole program", word)
                          : fmt::format("'{}' has no '{}' before the '{}' in line {}, expected the whole program",
                                        in(open.back()), end_of(in(open.back())), word, line(at)));
      }
      open.pop_back();
    }
  });
  if (!open.empty()) {
    fail(open.back().begin,
         fmt::format("'{}' has no '{}', expected the whole program", in(open.back()), end_of(in(open.back()))));
  }
}

std::size_t Text::behind_comment_or_string(std::size_t at) const {
  if (text_[at] == '#') {
    return std::min(text_.find('\n', at), text_.size());
  }
  if (text_[at] == '"') {
    const std::size_t end = text_.find_first_of("\"\n", at + 1);
    return end == std::string_view::npos ? text_.size() : end + 1;
  }
  return at;
}

std::optional<std::vector<Span>> Text::arguments(std::size_t open) const {
  std::vector<Span> result;
  Span current{.begin = open + 1, .end = open + 1};
  int depth = 0;
  for (std::size_t at = open; at < text_.size();) {
    if (const std::size_t behind = behind_comment_or_string(at); behind != at) {
      at = behind;
      continue;
    }
    const char c = text_[at];
    depth += c == '(' || c == '[' ? 1 : c == ')' || c == ']' ? -1 : 0;
    if (depth == 0 || (depth == 1 && c == ',')) {
      current.end = at;
      result.push_back(stripped(current));
      current.begin = at + 1;
    }
    if (depth == 0) {
      return result;
    }
    ++at;
  }
  return std::nullopt;
}

std::optional<Literal> Text::literal(Span span) const {
  constexpr std::size_t kFields = 6;
  if (span.is_empty()) {
    return std::nullopt;
  }
  Literal result{.is_pose = text_[span.begin] == 'p', .span = span, .fields = {}};
  std::size_t at = span.begin + (result.is_pose ? 1 : 0);
  if (at >= span.end || text_[at] != '[' || text_[span.end - 1] != ']') {
    return std::nullopt;
  }
  while (at + 1 < span.end) {
    const std::size_t end = std::min(text_.find_first_of(",]", at + 1), span.end - 1);
    const Span number = stripped({.begin = at + 1, .end = end});
    NumberField field{.begin = number.begin, .end = number.end};
    const auto read = std::from_chars(text_.data() + number.begin, text_.data() + number.end, field.value);
    constexpr double kMost = 1e6;
    constexpr int kDecimals = 6;
    if (read.ec != std::errc() || read.ptr != text_.data() + number.end || !(std::abs(field.value) < kMost)) {
      return std::nullopt;
    }
    field.decimals = decimals_of(in(number), kDecimals);
    result.fields.push_back(field);
    at = end;
  }
  return result.fields.size() == kFields ? std::optional(result) : std::nullopt;
}

}  // namespace kdl_calibration::ur
