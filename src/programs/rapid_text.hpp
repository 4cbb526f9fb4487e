#pragma once

// Words and values of RAPID, the language of ABB's controllers.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/units.hpp"
#include "programs/program.hpp"

namespace kdl_calibration::rapid {

enum class TokenKind : std::uint8_t { word, number, text, sign, end };

struct Token {
  TokenKind kind = TokenKind::end;
  std::string_view text;  ///< of the file; a text literal with its quotes
  std::size_t begin = 0;
  std::size_t line = 1;
};

enum class ValueKind : std::uint8_t {
  number,
  name,       ///< p10
  element,    ///< path{3}, path{i}
  call,       ///< Offs(p10, 0, 0, 100)
  aggregate,  ///< [a, b, c]
  other       ///< what is computed otherwise
};

/// A value as the text writes it.
struct Value {
  ValueKind kind = ValueKind::other;
  NumberField number;          ///< of a number
  std::string name;            ///< of a name, an element or a call: in lower case
  std::string index;           ///< of an element: "3" or "2,1"; empty where it is computed
  std::vector<Value> members;  ///< of an aggregate; the first argument of a call
  std::string_view text;
  std::size_t line = 0;
};

template <typename List>
bool contains(const List& words, std::string_view word) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

/// The words of a text one after the other, without comments and header lines.
class Words {
public:
  Words(std::string_view text, std::string source);

  const Token& peek() const { return next_; }
  Token take();
  bool is(std::string_view sign) const { return next_.kind == TokenKind::sign && next_.text == sign; }
  /// `name` in lower case.
  bool is_word(std::string_view name) const;
  bool is_end() const { return next_.kind == TokenKind::end; }
  bool take_if(std::string_view sign);
  void expect(std::string_view sign);
  Token expect_word(std::string_view what);

  /// A value up to a comma, a backslash or a closing sign outside of brackets.
  Value value(int depth = 0);
  /// Goes on behind the semicolon that ends the statement.
  void skip_statement();
  /// Goes on behind the bracket that closes the one that comes next.
  void skip_brackets();
  /// Goes on behind the condition of IF, ELSEIF or WHILE and its THEN or DO; or before the one statement of a short IF.
  void skip_condition();

  [[noreturn]] void fail(const std::string& what) const { fail(next_.line, what); }
  [[noreturn]] void fail(std::size_t line, const std::string& what) const;
  /// "'text' here", or that the text ends.
  std::string found() const;

private:
  void advance();
  void skip_blanks();
  void pass_text();
  Value aggregate(int depth);
  Value operand(int depth);
  void number(Value& value, const Token& sign, std::string_view digits) const;
  void named(Value& value, int depth);
  void first_argument(Value& value, int depth);

  std::string_view text_;
  std::string source_;
  std::size_t at_ = 0;
  std::size_t line_ = 1;
  Token next_;
  std::size_t taken_ = 0;  // end of the last word that was taken
};

}  // namespace kdl_calibration::rapid
