#include "programs/ls_positions.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/add_remark.hpp"

namespace kdl_calibration {
namespace {

constexpr std::array kCartesian = {"X", "Y", "Z", "W", "P", "R"};
constexpr std::array kJoints = {"J1", "J2", "J3", "J4", "J5", "J6"};

// Why a position stays as it is.
enum class Left : std::uint8_t { untaught, remote_tool, other_groups, perhaps_increment };
constexpr std::array kLeftBecause = {
    "******** marks positions that are not taught: left as they are",
    "RX RY RZ state positions relative to a tool that stands in the cell (remote TCP): left as they are",
    "positions without GP1 are those of other motion groups: left as they are",
    "positions that INC may take as increments at run time, and that no motion names as a place: left as they are"};

// What is read of a position.
struct ReadPosition {
  int number = 0;
  ProgramPoint position;
  std::optional<Left> left = Left::other_groups;
  std::uint32_t found = 0;  // a bit for each of the six fields
};

// Reads the positions of a program from their beginning.
class PositionReader {
public:
  PositionReader(std::string_view text, std::string source, std::size_t at, std::size_t line)
      : text_(text), source_(std::move(source)), at_(at), line_(line) {}

  // `motions`: their positions by number.
  void read(Program& program, const std::vector<LsMotion>& motions) {
    for (const LsMotion& motion : motions) {
      if (motion.position) {
        (motion.is_increment ? increments_ : places_).insert(*motion.position);
      }
      any_may_be_increment_ = any_may_be_increment_ || (motion.is_increment && motion.is_indirect);
    }
    program.points.reserve(motions.size());
    for (skip_blanks(); !at_end() && !starts("/END"); skip_blanks()) {
      add(position(), program);
    }
    require_end();
    program.motions.reserve(motions.size());
    for (const LsMotion& each : motions) {
      program.motions.push_back(each.motion);
      program.motions.back().point = place_of(each);
    }
    for (std::size_t i = 0; i < left_.size(); ++i) {
      add_remark(program.remarks, kLeftBecause[i], std::move(left_[i]));
    }
    add_remark(program.remarks, "a motion is to a position that /POS does not have", std::move(missing_));
  }

private:
  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(fmt::format("{}:{}: {}{}", source_, line_, where_, what));
  }

  // A position that a motion with INC uses is no place, but an increment: it stays as it is.
  void add(ReadPosition read, Program& program) {
    const bool is_named = increments_.contains(read.number) || places_.contains(read.number);
    if (!read.left && any_may_be_increment_ && !is_named) {
      read.left = Left::perhaps_increment;
    }
    const bool is_point = !read.left && !increments_.contains(read.number);
    const Found found{.point = is_point ? std::optional(program.points.size()) : std::nullopt,
                      .is_untaught = read.left == Left::untaught};
    if (!found_.try_emplace(read.number, found).second) {
      line_ = read.position.line;
      fail("is there twice, expected each position once");
    }
    if (read.left) {
      left_[static_cast<std::size_t>(*read.left)].push_back(read.position.line);
    } else if (is_point) {
      program.points.push_back(std::move(read.position));
    }
  }

  std::optional<std::size_t> place_of(const LsMotion& motion) {
    const auto found = motion.position ? found_.find(*motion.position) : found_.end();
    if (found == found_.end()) {
      if (motion.position) {
        missing_.push_back(motion.motion.line);
      }
      return std::nullopt;
    }
    if (found->second.is_untaught) {
      line_ = motion.motion.line;
      fail(fmt::format("moves to P[{}], which is not taught (********), expected a taught position", *motion.position));
    }
    return found->second.point;
  }

  void require_end() {
    where_.clear();
    if (at_end()) {
      fail("ends here without /END, expected the whole program");
    }
    take("/END");
    skip_blanks();
    while (take("\x1a")) {  // end of file of DOS
      skip_blanks();
    }
    if (!at_end()) {
      fail("goes on after /END with " + shown(rest_of_line()) + ", expected one program in a file");
    }
  }

  bool at_end() const { return at_ == text_.size(); }
  bool starts(std::string_view expected) const { return text_.substr(at_).starts_with(expected); }

  void skip_blanks() {
    while (!at_end() && (is_ls_blank(text_[at_]) || text_[at_] == ',')) {
      line_ += text_[at_++] == '\n' ? 1U : 0U;
    }
  }

  // In the same line.
  std::size_t after_blanks() const {
    std::size_t at = at_;
    while (at < text_.size() && (text_[at] == ' ' || text_[at] == '\t')) {
      ++at;
    }
    return at;
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

  ReadPosition position();
  void group(ReadPosition& read);
  void skip_group();
  void entry(ReadPosition& read);
  void frame_or_configuration(ProgramPoint& position, std::string_view name);
  void external(ProgramPoint& position, const ExternalValue& value, std::string_view unit) const;
  ArmBranch configuration();
  NumberField number(std::string_view name);

  std::string_view text_;
  std::string source_;
  std::size_t at_;
  std::size_t line_;
  std::string where_;  // "P[3]: "

  struct Found {
    std::optional<std::size_t> point;  // index
    bool is_untaught = false;
  };
  std::unordered_map<int, Found> found_;  // by number
  std::unordered_set<int> increments_;
  std::unordered_set<int> places_;  // that motions name
  bool any_may_be_increment_ = false;
  std::array<std::vector<std::size_t>, kLeftBecause.size()> left_;  // lines
  std::vector<std::size_t> missing_;                                // lines of motions
};

ReadPosition PositionReader::position() {
  where_.clear();
  ReadPosition result;
  result.position.line = line_;
  expect("P[");
  const std::optional<int> number = whole_number(word(":]"));
  if (!number || *number < 1) {
    fail("a position has no number, expected P[1] or above");
  }
  result.number = *number;
  result.position.name = fmt::format("P[{}]", *number);
  result.position.fields.resize(kJoints.size());
  where_ = result.position.name + ": ";
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
  return result;
}

void PositionReader::group(ReadPosition& read) {
  read.left.reset();
  for (skip_blanks(); !at_end() && !starts("GP") && !starts("}"); skip_blanks()) {
    entry(read);
  }
  if (read.found != (1U << kJoints.size()) - 1U) {
    fail(read.position.branch ? "has no complete pose, expected X Y Z W P R"
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

void PositionReader::frame_or_configuration(ProgramPoint& position, std::string_view name) {
  if (name == "CONFIG" || name == "KONFIG") {  // the second on controllers in German
    position.branch = configuration();
    position.notation = PointNotation::fixed_xyz;
  } else if (name == "UF" || name == "UT") {
    if (const std::optional<int> number = whole_number(word(","))) {
      (name == "UF" ? position.user_frame : position.tool_frame) = std::to_string(*number);
    }
  } else {
    fail("has " + shown(name) + ", expected UF, UT or CONFIG");
  }
}

// UF : 0 | UT : 1 | CONFIG : '...' | X = ... mm | RX = ... mm | J1= ... deg | E1= ... mm
void PositionReader::entry(ReadPosition& read) {
  ProgramPoint& position = read.position;
  std::string_view name = word(":=");
  if (take(":")) {
    skip_blanks();
    frame_or_configuration(position, name);
    return;
  }
  if (position.branch && name.size() == 2 && name.front() == 'R') {
    read.left = read.left.value_or(Left::remote_tool);
    name.remove_prefix(1);
  }
  const auto& names = position.branch ? kCartesian : kJoints;
  const auto place = static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
  const bool is_external = name.size() == 2 && name.front() == 'E' && name.back() >= '1' && name.back() <= '6';
  if (place == names.size() && !is_external) {
    fail("has " + shown(name) + ", expected " + (position.branch ? "X Y Z W P R" : "J1 to J6, or CONFIG"));
  }
  expect("=");
  NumberField field;
  if (text_.substr(after_blanks()).starts_with('*')) {
    read.left = Left::untaught;
    at_ = std::min(text_.find_first_not_of(" \t*", at_), text_.size());
  } else {
    field = number(name);
  }
  const std::string_view unit = word(",}");
  if (is_external) {
    external(position, {.axis = name.back() - '0', .value = field.value, .is_length = unit == "mm"}, unit);
    return;
  }
  const char* expected_unit = position.branch && place < 3 ? "mm" : "deg";
  if (unit != expected_unit) {
    fail(std::string(name) + " is in " + shown(unit) + ", expected " + expected_unit);
  }
  if ((read.found >> place & 1U) != 0U) {
    fail("has " + std::string(name) + " twice");
  }
  read.found |= 1U << place;
  position.fields[place] = field;
}

void PositionReader::external(ProgramPoint& position, const ExternalValue& value, std::string_view unit) const {
  if (unit != "mm" && unit != "deg") {
    fail(fmt::format("E{} is in {}, expected mm or deg", value.axis, shown(unit)));
  }
  if (std::any_of(position.external.begin(), position.external.end(),
                  [&](const ExternalValue& each) { return each.axis == value.axis; })) {
    fail(fmt::format("has E{} twice", value.axis));
  }
  position.external.push_back(value);
}

// 'N U T, 0, 0, 0': wrist, elbow, shoulder and the turns of J1, J4 and J6. Turn t covers -180 + 360 t < J <= 180 + 360
// t degrees.
ArmBranch PositionReader::configuration() {
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
  ArmBranch result;
  result.wrist_positive = next("FN") == 'F';
  result.elbow_up = next("UD") == 'U';
  result.front = next("TB") == 'T';
  for (const std::size_t joint : {0U, 3U, 5U}) {
    next(",");
    const bool is_negative = trimmed(rest).starts_with('-');
    if (is_negative) {
      next("-");
    }
    const int turn = (next("0123456789") - '0') * (is_negative ? -1 : 1);
    result.turns[joint] = {
        .lower = (2 * turn - 1) * std::numbers::pi, .upper = (2 * turn + 1) * std::numbers::pi, .closed_above = true};
  }
  if (!trimmed(rest).empty()) {
    next("");
  }
  expect("'");
  return result;
}

NumberField PositionReader::number(std::string_view name) {
  NumberField field{.begin = at_};
  at_ = after_blanks();
  const char* begin = text_.data() + at_;
  const auto result = std::from_chars(begin, text_.data() + text_.size(), field.value, std::chars_format::fixed);
  constexpr double kMost = 1e6;
  if (result.ec != std::errc() || !(std::abs(field.value) < kMost)) {
    fail(std::string(name) + " is " + shown(word(",}")) + ", expected a number");
  }
  at_ += static_cast<std::size_t>(result.ptr - begin);
  field.end = at_;
  return field;
}

}  // namespace

void read_ls_positions(const ProgramText& program_text, std::size_t at, std::size_t line, Program& program,
                       const std::vector<LsMotion>& motions) {
  PositionReader(program_text.text, program_text.source, at, line).read(program, motions);
}

}  // namespace kdl_calibration
