#include "programs/rapid_text.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::rapid {
namespace {

constexpr int kDeepest = 32;  // brackets within brackets

// A statement that goes on with one of these has no semicolon.
constexpr std::array kStructure =
    std::to_array<std::string_view>({"endproc", "endfunc", "endtrap", "endmodule", "endrecord", "endif", "endfor",
                                     "endwhile", "endtest", "proc", "func", "trap", "module"});
constexpr std::array kOperators = std::to_array<std::string_view>({"and", "or", "xor", "not", "mod", "div"});

bool is_digit(char c) { return c >= '0' && c <= '9'; }

// Letters of other languages have bytes beyond ASCII.
bool begins_word(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || static_cast<unsigned char>(c) >= 0x80U;
}

bool is_blank(char c) { return static_cast<unsigned char>(c) <= 0x20U; }

bool is_operand(TokenKind kind) { return kind != TokenKind::sign && kind != TokenKind::end; }

bool is_operator_word(const Token& token) {
  constexpr std::size_t kLongest = 3;
  return token.kind == TokenKind::word && token.text.size() <= kLongest && contains(kOperators, lower_case(token.text));
}

// "3" or "2,1"; empty where an index is computed.
std::string index_of(std::string_view text) {
  std::string index;
  for (const char c : text) {
    if (is_digit(c) || c == ',') {
      index += c;
    } else if (!is_blank(c)) {
      return {};
    }
  }
  return index;
}

}  // namespace

Words::Words(std::string_view text, std::string source) : text_(text), source_(std::move(source)) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  at_ = text.starts_with(kByteOrderMark) ? kByteOrderMark.size() : 0;
  advance();
}

void Words::fail(std::size_t line, const std::string& what) const {
  throw InputError(fmt::format("{}:{}: {}", source_, line, what));
}

std::string Words::found() const { return is_end() ? "the text ends" : shown(next_.text) + " is here"; }

bool Words::is_word(std::string_view name) const {
  return next_.kind == TokenKind::word && next_.text.size() == name.size() && lower_case(next_.text) == name;
}

Token Words::take() {
  Token token = next_;
  advance();
  return token;
}

bool Words::take_if(std::string_view sign) {
  if (!is(sign)) {
    return false;
  }
  advance();
  return true;
}

void Words::expect(std::string_view sign) {
  if (!take_if(sign)) {
    fail(found() + ", expected '" + std::string(sign) + "'");
  }
}

Token Words::expect_word(std::string_view what) {
  if (next_.kind != TokenKind::word) {
    fail(found() + ", expected " + std::string(what));
  }
  return take();
}

// Blanks, comments, and headers such as %%% VERSION:1 LANGUAGE:ENGLISH %%%.
void Words::skip_blanks() {
  while (at_ < text_.size()) {
    if (text_[at_] == '!') {
      at_ = std::min(text_.find('\n', at_), text_.size());
    } else if (text_.substr(at_).starts_with("%%%")) {
      const std::size_t end = text_.find("%%%", at_ + 3);
      if (end == std::string_view::npos) {
        fail(line_, "the header %%% does not end, expected %%% behind it");
      }
      line_ += static_cast<std::size_t>(std::count(text_.data() + at_, text_.data() + end, '\n'));
      at_ = end + 3;
    } else if (is_blank(text_[at_])) {
      line_ += text_[at_++] == '\n' ? 1U : 0U;
    } else {
      return;
    }
  }
}

void Words::advance() {
  taken_ = at_;
  skip_blanks();
  next_ = {.begin = at_, .line = line_};
  if (at_ >= text_.size()) {
    return;
  }
  const std::size_t begin = at_;
  const char c = text_[at_];
  const char after = at_ + 1 < text_.size() ? text_[at_ + 1] : ' ';
  if (begins_word(c)) {
    next_.kind = TokenKind::word;
    while (at_ < text_.size() && (begins_word(text_[at_]) || is_digit(text_[at_]))) {
      ++at_;
    }
  } else if (is_digit(c) || (c == '.' && is_digit(after))) {
    next_.kind = TokenKind::number;
    double number = 0.0;
    at_ += static_cast<std::size_t>(std::from_chars(text_.data() + at_, text_.data() + text_.size(), number).ptr -
                                    (text_.data() + at_));
    while (at_ < text_.size() && (begins_word(text_[at_]) || is_digit(text_[at_]))) {  // 0xFF
      ++at_;
    }
  } else if (c == '"') {
    next_.kind = TokenKind::text;
    pass_text();
  } else {
    next_.kind = TokenKind::sign;
    at_ += c == ':' && after == '=' ? 2 : 1;
  }
  next_.text = text_.substr(begin, at_ - begin);
}

// Two quotes stand for one within the text.
void Words::pass_text() {
  const std::size_t begin = at_;
  do {
    at_ = std::min(text_.find_first_of("\"\n", at_ + 1), text_.size());
    if (at_ == text_.size() || text_[at_] == '\n') {
      fail(line_, "the text " + shown(trimmed(text_.substr(begin, at_ - begin))) +
                      " does not end in its line, expected a quote behind it");
    }
    ++at_;
  } while (at_ < text_.size() && text_[at_] == '"');
}

// ---- Statements ----------------------------------------------------------------------------------------------------

void Words::skip_statement() {
  bool is_name_behind_sign = false;  // \Default, .error
  while (!is(";")) {
    if (is_end() ||
        (next_.kind == TokenKind::word && !is_name_behind_sign && contains(kStructure, lower_case(next_.text)))) {
      fail(found() + ", expected ';' behind the statement");
    }
    is_name_behind_sign = is("\\") || is(".");
    advance();
  }
  advance();
}

void Words::skip_brackets() {
  int depth = 0;
  const std::size_t line = next_.line;
  do {
    if (is_end() || is(";")) {
      fail(line, "a bracket does not close, expected its end");
    }
    depth += is("(") || is("[") || is("{") ? 1 : is(")") || is("]") || is("}") ? -1 : 0;
    advance();
  } while (depth > 0);
}

void Words::skip_condition() {
  const std::size_t line = next_.line;
  bool after_operand = false;
  while (!is_word("then") && !is_word("do")) {
    if (is_end() || is(";") || contains(kStructure, lower_case(next_.text))) {
      fail(line, "a condition has no THEN and no statement, expected one");
    }
    if (is("(") || is("{") || is("[")) {
      skip_brackets();
      after_operand = true;
      continue;
    }
    const bool is_operator = is_operator_word(next_);
    if (after_operand && !is_operator && (next_.kind == TokenKind::word || is("%"))) {
      return;
    }
    after_operand = !is_operator && is_operand(next_.kind);
    advance();
  }
  advance();
}

// ---- Values --------------------------------------------------------------------------------------------------------

Value Words::value(int depth) {
  if (depth > kDeepest) {
    fail(fmt::format("more than {} brackets are within each other, expected fewer", kDeepest));
  }
  const std::size_t begin = next_.begin;
  const std::size_t line = next_.line;
  Value result;
  bool after_operand = false;
  std::size_t parts = 0;
  for (; !is(",") && !is(";") && !is("]") && !is(")") && !is("\\") && !is(":="); ++parts) {
    const bool is_operator = !is_operand(next_.kind) || is_operator_word(next_);
    if (is_end() || (after_operand && !is_operator)) {
      fail(found() + ", expected ',' or ';' behind the value");
    }
    after_operand = !is_operator || is("[") || is("(");
    Value part = is("[") ? aggregate(depth) : operand(depth);
    result = parts == 0 ? std::move(part) : Value();
  }
  if (parts == 0) {
    fail(found() + ", expected a value");
  }
  result.text = text_.substr(begin, taken_ - begin);
  result.line = line;
  return result;
}

Value Words::aggregate(int depth) {
  Value result{.kind = ValueKind::aggregate};
  expect("[");
  if (!is("]")) {
    do {
      result.members.push_back(value(depth + 1));
    } while (take_if(","));
  }
  expect("]");
  return result;
}

Value Words::operand(int depth) {
  Value result;
  if (is("(") || is("{")) {
    skip_brackets();
    return result;
  }
  const Token token = take();
  const bool is_sign = token.text == "-" || token.text == "+";
  if (token.kind == TokenKind::number) {
    number(result, token, token.text);
  } else if (is_sign && next_.kind == TokenKind::number && next_.begin == token.begin + 1) {
    number(result, token, take().text);
  } else if (token.kind == TokenKind::word && !is_operator_word(token)) {
    result.kind = ValueKind::name;
    result.name = lower_case(token.text);
    named(result, depth);
  }
  return result;
}

// Another notation, such as 0xFF, is a computed value here.
void Words::number(Value& value, const Token& sign, std::string_view digits) const {
  double magnitude = 0.0;
  const auto read = std::from_chars(digits.data(), digits.data() + digits.size(), magnitude);
  if (read.ec != std::errc() || read.ptr != digits.data() + digits.size()) {
    return;
  }
  value.kind = ValueKind::number;
  value.number = {.begin = sign.begin, .end = taken_, .value = sign.text == "-" ? -magnitude : magnitude};
}

// What follows a name: path{3}, path{i}, target.trans, Offs(p10, 0, 0, 100).
void Words::named(Value& value, int depth) {
  while (is("{") || is(".") || is("(")) {
    if (value.kind == ValueKind::name && is("(")) {
      value.kind = ValueKind::call;
      first_argument(value, depth);
    } else if (value.kind == ValueKind::name && is("{")) {
      value.kind = ValueKind::element;
      const std::size_t begin = next_.begin + 1;
      skip_brackets();
      value.index = index_of(text_.substr(begin, taken_ - 1 - begin));
    } else if (is(".")) {
      value.kind = ValueKind::other;
      take();
      expect_word("a component behind '.'");
    } else {
      value.kind = ValueKind::other;
      skip_brackets();
    }
  }
}

void Words::first_argument(Value& value, int depth) {
  expect("(");
  while (!is(")")) {
    if (take_if(",")) {
      continue;
    }
    if (take_if("\\")) {
      expect_word("a name behind '\\'");
      if (!take_if(":=")) {
        continue;
      }
      this->value(depth + 1);
    } else if (Value argument = this->value(depth + 1); value.members.empty()) {
      value.members.push_back(std::move(argument));
    }
  }
  expect(")");
}

}  // namespace kdl_calibration::rapid
