#include "programs/ls_program.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <set>

#include "base/number_text.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

constexpr std::array kCartesian = {"X", "Y", "Z", "W", "P", "R"};
constexpr std::array kJoints = {"J1", "J2", "J3", "J4", "J5", "J6"};

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

// Reads the positions of a program from their beginning.
class PositionReader {
public:
  PositionReader(std::string_view text, std::string source, std::size_t at, std::size_t line)
      : text_(text), source_(std::move(source)), at_(at), line_(line) {}

  std::vector<ProgramPosition> read() {
    std::vector<ProgramPosition> positions;
    std::set<int> numbers;
    for (skip_blanks(); !at_end() && !starts("/END"); skip_blanks()) {
      positions.push_back(position());
      if (!numbers.insert(positions.back().number).second) {
        line_ = positions.back().line;
        fail("is there twice, expected each position once");
      }
    }
    where_.clear();
    if (at_end()) {
      fail("ends here without /END, expected the whole program");
    }
    take("/END");
    skip_blanks();
    if (!at_end()) {
      fail("goes on after /END with " + shown(rest_of_line()) + ", expected one program in a file");
    }
    return positions;
  }

private:
  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(fmt::format("{}:{}: {}{}", source_, line_, where_, what));
  }

  bool at_end() const { return at_ == text_.size(); }
  bool starts(std::string_view expected) const { return text_.substr(at_).starts_with(expected); }

  void skip_blanks() {
    while (!at_end() && (is_blank(text_[at_]) || text_[at_] == ',')) {
      line_ += text_[at_++] == '\n' ? 1U : 0U;
    }
  }

  bool take(std::string_view expected) {
    if (!starts(expected)) {
      return false;
    }
    at_ += expected.size();
    return true;
  }

  void expect(std::string_view expected) {
    skip_blanks();
    if (!take(expected)) {
      fail("expected " + in_quotes(std::string(expected)) + " here, found " + shown(rest_of_line()));
    }
  }

  std::string_view rest_of_line() const {
    const std::string_view rest = text_.substr(at_);
    return trimmed(rest.substr(0, rest.find_first_of("\r\n")));
  }

  // Up to one of these characters or a line's end.
  std::string_view word(std::string_view ends) {
    const std::size_t begin = at_;
    while (!at_end() && ends.find(text_[at_]) == std::string_view::npos && text_[at_] != '\n' && text_[at_] != '\r') {
      ++at_;
    }
    return trimmed(text_.substr(begin, at_ - begin));
  }

  std::optional<int> whole_number(std::string_view word) const {
    int value = 0;
    const auto result = std::from_chars(word.data(), word.data() + word.size(), value);
    return result.ec == std::errc() && result.ptr == word.data() + word.size() ? std::optional(value) : std::nullopt;
  }

  ProgramPosition position();
  void group(ProgramPosition& position);
  void skip_group();
  void entry(ProgramPosition& position, std::uint32_t& found);
  RobotConfiguration configuration();
  NumberField number(std::string_view name);

  std::string_view text_;
  std::string source_;
  std::size_t at_;
  std::size_t line_;
  std::string where_;  // "P[3]: "
};

ProgramPosition PositionReader::position() {
  where_.clear();
  ProgramPosition result;
  result.line = line_;
  expect("P[");
  const std::optional<int> number = whole_number(word(":]"));
  if (!number || *number < 1) {
    fail("a position has no number, expected P[1] or above");
  }
  result.number = *number;
  where_ = fmt::format("P[{}]: ", *number);
  if (take(":")) {  // a comment in quotes may hold any character
    expect("\"");
    const std::size_t quote = text_.find("\"]", at_);
    at_ = quote == std::string_view::npos ? text_.size() : quote + 1;
  }
  expect("]");
  expect("{");
  bool has_group = false;
  for (skip_blanks(); !take("}"); skip_blanks()) {
    if (at_end()) {
      fail("does not end, expected '};'");
    }
    expect("GP");
    const std::optional<int> group_number = whole_number(word(":"));
    expect(":");
    if (group_number == 1) {
      if (has_group) {
        fail("has GP1 twice, expected each group once");
      }
      group(result);
      has_group = true;
    } else {
      skip_group();
    }
  }
  expect(";");
  if (!has_group) {
    fail("has no group 1, expected GP1");
  }
  return result;
}

void PositionReader::group(ProgramPosition& position) {
  std::uint32_t found = 0;  // a bit for each of the six fields
  for (skip_blanks(); !at_end() && !starts("GP") && !starts("}"); skip_blanks()) {
    entry(position, found);
  }
  if (found != (1U << kJoints.size()) - 1U) {
    fail(position.configuration ? "has no complete pose, expected X Y Z W P R"
                                : "has no complete joint values, expected J1 to J6, or CONFIG with X Y Z W P R");
  }
}

// The other groups stay as they are.
void PositionReader::skip_group() {
  const std::size_t end = std::min({text_.find('}', at_), text_.find("GP", at_), text_.size()});
  line_ += static_cast<std::size_t>(std::count(text_.begin() + static_cast<std::ptrdiff_t>(at_),
                                               text_.begin() + static_cast<std::ptrdiff_t>(end), '\n'));
  at_ = end;
}

// UF : 0 | UT : 1 | CONFIG : '...' | X = ... mm | J1= ... deg | E1= ... mm
void PositionReader::entry(ProgramPosition& position, std::uint32_t& found) {
  const std::string_view name = word(":=");
  if (take(":")) {
    skip_blanks();
    if (name == "CONFIG") {
      position.configuration = configuration();
    } else if (name == "UF" || name == "UT") {
      (name == "UF" ? position.user_frame : position.tool_frame) = whole_number(word(","));
    } else {
      fail("has " + shown(name) + ", expected UF, UT or CONFIG");
    }
    return;
  }
  const auto& names = position.configuration ? kCartesian : kJoints;
  const auto place = static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
  const bool is_extended = name.size() == 2 && name.front() == 'E' && name.back() >= '1' && name.back() <= '9';
  if (place == names.size() && !is_extended) {
    fail("has " + shown(name) + ", expected " + (position.configuration ? "X Y Z W P R" : "J1 to J6, or CONFIG"));
  }
  expect("=");
  const NumberField field = number(name);
  const std::string_view unit = word(",}");
  if (is_extended) {
    position.has_extended_axes = true;
    return;
  }
  const char* expected_unit = position.configuration && place < 3 ? "mm" : "deg";
  if (unit != expected_unit) {
    fail(std::string(name) + " is in " + shown(unit) + ", expected " + expected_unit);
  }
  if ((found >> place & 1U) != 0U) {
    fail("has " + std::string(name) + " twice");
  }
  found |= 1U << place;
  position.fields[place] = field;
}

RobotConfiguration PositionReader::configuration() {
  expect("'");
  const std::string_view text = word("'");
  std::string_view rest = text;
  const auto next = [&](std::string_view expected) {  // the one of these characters that comes next
    rest = trimmed(rest);
    if (rest.empty() || expected.find(rest.front()) == std::string_view::npos) {
      fail("CONFIG is " + shown(text) + ", expected for example 'N U T, 0, 0, 0'");
    }
    const char c = rest.front();
    rest.remove_prefix(1);
    return c;
  };
  RobotConfiguration result;
  result.flip = next("FN") == 'F';
  result.elbow_up = next("UD") == 'U';
  result.front = next("TB") == 'T';
  for (int& turn : result.turns) {
    next(",");
    const bool is_negative = trimmed(rest).starts_with('-');
    if (is_negative) {
      next("-");
    }
    turn = (next("0123456789") - '0') * (is_negative ? -1 : 1);
  }
  if (!trimmed(rest).empty()) {
    next("");
  }
  expect("'");
  return result;
}

NumberField PositionReader::number(std::string_view name) {
  NumberField field{.begin = at_};
  at_ = std::min(text_.find_first_not_of(" \t", at_), text_.size());
  const char* begin = text_.data() + at_;
  const auto result = std::from_chars(begin, text_.data() + text_.size(), field.value, std::chars_format::fixed);
  constexpr double kMost = 1e6;
  if (result.ec != std::errc() || !(std::abs(field.value) < kMost)) {
    fail(std::string(name) + " is " + shown(word(",}")) + ", expected a number: a position that was taught");
  }
  at_ += static_cast<std::size_t>(result.ptr - begin);
  field.end = at_;
  return field;
}

// What of a motion instruction only the controller knows. Registers have comments in their brackets, which may hold any
// word.
std::string run_time_part(std::string_view instruction) {
  for (const char* place : {"PR[", "P[R["}) {
    if (instruction.starts_with(place)) {
      return place;
    }
  }
  std::string words;
  int depth = 0;
  for (const char c : instruction) {
    depth += c == '[' ? 1 : 0;
    words += depth > 0 ? ' ' : c;
    depth -= c == ']' ? 1 : 0;
  }
  for (const char* option : {"Tool_Offset", "VOFFSET", "Offset"}) {
    if (words.find(option) != std::string::npos) {
      return option;
    }
  }
  const std::size_t at = words.find(" INC");
  const bool is_increment = at != std::string::npos && words.find_first_of(" ;,\r", at + 1) == at + 4;
  return is_increment ? "INC" : "";
}

// The motion of a program line such as "   7:L P[1] 100mm/sec FINE ;". The second line of a circular motion,
// "    :  P[2] 100mm/sec FINE ;", has no letter.
std::optional<ProgramMotion> motion_of(std::string_view line) {
  constexpr std::size_t kNone = std::string_view::npos;
  const std::size_t colon = line.find(':');
  if (colon == kNone || line.substr(0, colon).find_first_not_of(" \t0123456789") != kNone) {
    return std::nullopt;
  }
  std::string_view rest = trimmed(line.substr(colon + 1));
  const char kind = rest.empty() ? ' ' : rest.front();
  const bool has_letter = std::string_view("JLCAS").find(kind) != kNone;
  rest = trimmed(rest.substr(has_letter ? 1 : 0));
  if (!(rest.starts_with("P[") || rest.starts_with("PR[")) || (!has_letter && rest.find('=') != kNone)) {
    return std::nullopt;
  }
  ProgramMotion motion;
  motion.is_straight = kind != 'J';
  motion.run_time_part = run_time_part(rest);
  int number = 0;
  const char* digits = rest.data() + 2;
  if (rest.starts_with("P[") && std::from_chars(digits, rest.data() + rest.size(), number).ptr != digits) {
    motion.position = number;
  }
  return motion;
}

}  // namespace

LsProgram parse_ls_program(std::string_view text, const std::string& source) {
  if (!text.starts_with("/PROG")) {
    throw InputError(source + ":1: begins with " + shown(text.substr(0, text.find('\n'))) +
                     ", expected /PROG: a FANUC program as text (LS)");
  }
  LsProgram program;
  std::size_t line = 0;
  bool has_positions = false;
  for (std::size_t at = 0; at < text.size() && !has_positions;) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view content = text.substr(at, end - at);
    ++line;
    at = std::min(end + 1, text.size());
    if (content.starts_with("/POS")) {
      program.positions = PositionReader(text, source, at, line + 1).read();
      has_positions = true;
    } else if (line > 1 && (content.starts_with("/PROG") || content.starts_with("/END"))) {
      throw InputError(
          fmt::format("{}:{}: has {} before /POS, expected one whole program in a file", source, line, shown(content)));
    } else if (std::optional<ProgramMotion> motion = motion_of(content)) {
      motion->line = line;
      program.motions.push_back(*std::move(motion));
    }
  }
  if (!has_positions) {
    throw InputError(fmt::format("{}:{}: ends here without /POS, expected the whole program", source, line));
  }
  return program;
}

std::string with_numbers(std::string_view text, const std::vector<NumberField>& fields) {
  std::string result;
  result.reserve(text.size());
  std::size_t copied = 0;
  for (const NumberField& field : fields) {
    const std::string_view old = text.substr(field.begin, field.end - field.begin);
    std::string number = fixed(field.value, 3);
    double before = 0.0;
    const std::string_view digits = trimmed(old);
    std::from_chars(digits.data(), digits.data() + digits.size(), before);
    if (number == fixed(before, 3)) {
      continue;
    }
    if (const std::size_t zero = number.find("0."); zero == 0 || (zero == 1 && number.front() == '-')) {
      number.erase(zero, 1);  // the controller writes -.250
    }
    result += text.substr(copied, field.begin - copied);
    result += fmt::format("{:>{}}", number, std::max(old.size(), number.size() + 1));
    copied = field.end;
  }
  result += text.substr(copied);
  return result;
}

}  // namespace kdl_calibration
