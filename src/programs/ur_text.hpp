#pragma once

// Words, calls and literals of URScript, the language of Universal Robots.

#include <fmt/core.h>
#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/input_error.hpp"
#include "programs/program.hpp"

namespace kdl_calibration::ur {

/// A part of the text.
struct Span {
  std::size_t begin = 0;
  std::size_t end = 0;

  bool is_empty() const { return begin == end; }
};

/// A pose or a list of joint values that the text states in numbers.
struct Literal {
  bool is_pose = false;
  Span span;
  std::vector<NumberField> fields;  ///< six
};

bool is_letter(char c);  ///< of a word: digits too

class Text {
public:
  explicit Text(const ProgramText& program);

  std::string_view all() const { return text_; }
  std::string_view in(Span span) const { return text_.substr(span.begin, span.end - span.begin); }
  std::size_t line(std::size_t at) const {
    return static_cast<std::size_t>(std::upper_bound(line_begins_.begin(), line_begins_.end(), at) -
                                    line_begins_.begin());
  }
  const std::vector<std::size_t>& line_begins() const { return line_begins_; }
  Span stripped(Span span) const;

  /// Throws InputError unless every block (def, thread, sec, while, if) has its end and every bracket closes.
  void require_whole() const;

  /// Behind a comment or a string that begins here; the same place if none does.
  std::size_t behind_comment_or_string(std::size_t at) const;
  /// The arguments of a call whose parenthesis opens at `open`; none if that does not close.
  std::optional<std::vector<Span>> arguments(std::size_t open) const;
  /// Calls work(at) for each byte outside of comments and strings.
  template <typename Work>
  void for_each_byte(const Work& work) const {
    for (std::size_t at = 0; at < text_.size();) {
      const std::size_t behind = behind_comment_or_string(at);
      if (behind == at) {
        work(at++);
      } else {
        at = behind;
      }
    }
  }
  /// Calls work(word) for each word outside of comments and strings.
  template <typename Work>
  void for_each_word(const Work& work) const {
    std::size_t end = 0;
    for_each_byte([&](std::size_t at) {
      if (at >= end && is_letter(text_[at])) {
        for (end = at; end < text_.size() && is_letter(text_[end]);) {
          ++end;
        }
        work(Span{.begin = at, .end = end});
      }
    });
  }

  /// "p[0.1, -0.2, 0.3, 0, 3.14, 0]" or "[0, -1.57, 1.57, 0, 1.57, 0]".
  std::optional<Literal> literal(Span span) const;

private:
  [[noreturn]] void fail(std::size_t at, const std::string& what) const {
    throw InputError(fmt::format("{}:{}: {}", source_, line(at), what));
  }

  std::string_view text_;
  std::string source_;
  std::vector<std::size_t> line_begins_{0};
};

}  // namespace kdl_calibration::ur
