#pragma once

// Lines, words, numbers and aggregates of the KUKA Robot Language (KRL). Words are the same in upper and lower case.

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "programs/program.hpp"

namespace kdl_calibration::krl {

/// Where something stands in a text.
struct Place {
  const ProgramText* text = nullptr;
  std::size_t file = 0;  ///< index of the text
  std::size_t line = 0;  ///< from 1
};

/// Throws InputError: "source:line: what".
[[noreturn]] void fail(const Place& place, const std::string& what);

/// The lines of a text that hold more than a comment or a header ("&ACCESS RVP"), without comments and outer blanks.
class Lines {
public:
  explicit Lines(const ProgramText& text, std::size_t file = 0);

  /// The next such line. False at the end of the text.
  bool next(std::string_view& line);
  /// Of the line that `next` gave last; at the end of the text, of its last line.
  const Place& place() const { return place_; }

private:
  std::size_t at_ = 0;
  Place place_;
};

/// Without blanks and control characters at both ends.
std::string_view stripped(std::string_view text);

/// Letters of ASCII in upper case.
std::string in_upper_case(std::string_view text);

/// Letters, digits, _ and $ at the beginning; empty where a digit or another character stands there.
std::string_view word_at(std::string_view text);

/// Whether the text is this word, which is in upper case.
bool is_word(std::string_view text, std::string_view word);

/// What follows the first `size` bytes, without outer blanks.
std::string_view rest_after(std::string_view text, std::size_t size);

/// A variable with its index and member, such as XP[3].X
struct Reference {
  std::string name;                       ///< in upper case; empty: the text begins with no variable
  std::optional<std::string_view> index;  ///< between the brackets
  std::string_view member;                ///< the first; empty: none
  std::size_t size = 0;                   ///< bytes of the whole variable
};
Reference reference_at(std::string_view text);

/// The right side of an assignment behind the variable on its left; none where no = follows.
std::optional<std::string_view> assigned_value(std::string_view text, const Reference& left);

/// Where the bracket that opens at `begin` closes; none if it does not. Brackets in strings do not count.
std::optional<std::size_t> closing_bracket(std::string_view text, std::size_t begin = 0);

/// The parts between commas outside of brackets and strings, without outer blanks.
std::vector<std::string_view> list_parts(std::string_view text);

/// A member of an aggregate: X 10.0 in {X 10.0,Y 20.0}.
struct Member {
  std::string_view name;
  std::string_view value;
};
struct Aggregate {
  std::vector<Member> members;
  std::size_t size = 0;  ///< bytes with both braces
};
/// The aggregate at the beginning of the text, with or without its type: {E6POS: X 10.0}. None without a {; throws
/// InputError where it does not close in its line.
std::optional<Aggregate> aggregate_at(std::string_view text, const Place& place);

/// A number that is the whole text: 12, +3, -.5, 1.5E-3
std::optional<double> number_in(std::string_view text);
/// The same without decimals, or in binary or hexadecimal digits: 50, 'B110010', 'H32'
std::optional<int> whole_number_in(std::string_view text);

}  // namespace kdl_calibration::krl
