#include "programs/ls_program.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <utility>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/add_remark.hpp"
#include "programs/ls_positions.hpp"
#include "programs/system_frames.hpp"

namespace kdl_calibration {
namespace {

// Where a program has a word on which the controller decides at run time.
enum class WordPlace : std::uint8_t {
  target,    // of a motion; a word begins with it
  option,    // of a motion
  step,      // option of a motion to P[R[...]]
  assigned,  // left of =, if another value than a number is right of it; a word begins with it
  copied,    // a whole kind of assignment
  head       // before the statements, with another value than 0
};

struct RunTimeWord {
  WordPlace place;
  std::string_view word;
  std::string_view name;  // in messages
  std::string_view meaning;
};

constexpr std::string_view kUnknownPlace = "holds a place that is known at run time only: not compensated here";
constexpr std::string_view kShift = "moves positions at run time: compensated where they are without that";
constexpr std::string_view kFrame = "is set at run time: poses are compensated with the frame of --frames";
constexpr std::string_view kFrameNumber = "is chosen at run time: poses are compensated in their own UF and UT";

constexpr std::array kRunTimeWords = std::to_array<RunTimeWord>({
    {WordPlace::target, "PR[", "PR[...]", kUnknownPlace},
    {WordPlace::target, "P[R[", "P[R[...]]", kUnknownPlace},
    {WordPlace::target, "P[AR[", "P[AR[...]]", kUnknownPlace},
    {WordPlace::target, "PAL_", "PAL_n[...]", kUnknownPlace},
    {WordPlace::option, "Offset", "Offset", kShift},
    {WordPlace::option, "Tool_Offset", "Tool_Offset", kShift},
    {WordPlace::option, "VOFFSET", "VOFFSET", kShift},
    {WordPlace::option, "INC", "INC", "makes a position an increment: left as it is"},
    {WordPlace::step, "INC", "INC",
     "makes a position that is known at run time only an increment: positions that no motion names as a place are left "
     "as they are"},
    {WordPlace::option, "COORD", "COORD",
     "moves relative to another motion group: positions are compensated, the path between them is not checked"},
    {WordPlace::option, "RTCP", "RTCP",
     "moves relative to a tool that stands in the cell: positions are compensated, the path between them is not "
     "checked"},
    {WordPlace::assigned, "UFRAME[", "UFRAME[...]", kFrame},
    {WordPlace::assigned, "UTOOL[", "UTOOL[...]", kFrame},
    {WordPlace::assigned, "UFRAME_NUM", "UFRAME_NUM", kFrameNumber},
    {WordPlace::assigned, "UTOOL_NUM", "UTOOL_NUM", kFrameNumber},
    {WordPlace::assigned, "BENUTZER_NUM", "BENUTZER_NUM", kFrameNumber},  // on controllers in German
    {WordPlace::assigned, "WKZ_NUM", "WKZ_NUM", kFrameNumber},
    {WordPlace::copied, "PR[", "PR[...]=P[...]",
     "puts a compensated position into a register: motions to it, and what is computed from it, use that"},
    {WordPlace::head, "LINE_TRACK_SCHEDULE_NUMBER", "LINE_TRACK_SCHEDULE_NUMBER",
     "lets positions travel with a conveyor: compensated where they are while it stands"},
});

const RunTimeWord* run_time_word(WordPlace place, std::string_view word) {
  const bool is_whole = place == WordPlace::option || place == WordPlace::head;
  const auto row = std::find_if(kRunTimeWords.begin(), kRunTimeWords.end(), [&](const RunTimeWord& each) {
    const std::string_view name = is_whole ? word.substr(0, word.find('[')) : word;  // "COORD[2]"
    return each.place == place && (is_whole ? name == each.word : word.starts_with(each.word));
  });
  return row == kRunTimeWords.end() ? nullptr : &*row;
}

// A line of a program: "   7:L P[1] 100mm/sec FINE ;". A number begins a statement, and a colon without a number
// continues one that has no semicolon yet:
//     7:C P[1]
//      :  P[2] 100mm/sec FINE Offset,PR[1] ;
// The text behind the colon; none for another line.
struct NumberedLine {
  std::string_view content;
  bool has_number = false;
};

std::optional<NumberedLine> numbered_line(std::string_view line) {
  const std::size_t colon = line.find_first_not_of(" \t0123456789");
  if (colon == std::string_view::npos || line[colon] != ':') {
    return std::nullopt;
  }
  return NumberedLine{.content = line.substr(colon + 1),
                      .has_number = line.substr(0, colon).find_first_of("0123456789") != std::string_view::npos};
}

// The words of a statement up to its semicolon, over the lines that continue it. A register's bracket, whose comment
// may hold anything, belongs to its word.
class Words {
public:
  Words(std::string_view text, std::size_t line) : text_(text), line_(line) {}

  // An empty word at the end of the statement.
  std::string_view next() {
    while (at_ < text_.size() && is_separator(text_[at_]) && begin_next_line()) {
      ++at_;
    }
    const std::size_t begin = at_;
    for (int depth = 0; at_ < text_.size() && text_[at_] != '\n'; ++at_) {
      if (depth == 0 && (is_separator(text_[at_]) || text_[at_] == ';')) {
        break;
      }
      depth += text_[at_] == '[' ? 1 : text_[at_] == ']' && depth > 0 ? -1 : 0;
    }
    return text_.substr(begin, at_ - begin);
  }

  std::size_t line() const { return line_; }  // of the last word

private:
  static bool is_separator(char c) { return is_ls_blank(c) || c == ','; }

  // At a line's end goes on to the colon of the next line. False if that continues nothing. A semicolon at a line's end
  // ends every statement, even behind a bracket that does not close.
  bool begin_next_line() {
    if (text_[at_] != '\n') {
      return true;
    }
    const std::size_t last = text_.substr(0, at_).find_last_not_of(" \t\r");
    if (last != std::string_view::npos && text_[last] == ';') {
      return false;
    }
    const std::string_view rest = text_.substr(at_ + 1);
    const std::optional<NumberedLine> next = numbered_line(rest.substr(0, rest.find('\n')));
    if (!next || next->has_number) {
      return false;
    }
    at_ = static_cast<std::size_t>(next->content.data() - text_.data()) - 1;
    ++line_;
    return true;
  }

  std::string_view text_;
  std::size_t at_ = 0;
  std::size_t line_;
};

// Reads what stands before the positions of a program.
class StatementReader {
public:
  explicit StatementReader(Program& program) : program_(program) {}

  // The statement at the beginning of `text`, which reaches to the end of the program. Returns its last line.
  std::size_t read(std::string_view text, std::size_t line) {
    Words words(text, line);
    std::string_view word = words.next();
    const char kind = word.empty() ? ' ' : word.front();
    if (std::string_view("JLCAS").find(kind) != std::string_view::npos) {
      word = word.size() > 1 ? word.substr(1) : words.next();
      if (is_place(word)) {
        motion(kind, word, words);
      }
    }
    while (!words.next().empty()) {
    }
    assignment(text.substr(0, text.find_first_of(";\n")), line);
    return words.line();
  }

  // A line that is no statement: "  LINE_TRACK_SCHEDULE_NUMBER      : 1;"
  void head(std::string_view content, std::size_t line) {
    const std::size_t colon = std::min(content.find(':'), content.size());
    if (trimmed(content.substr(colon)).find_first_of("123456789") != std::string_view::npos) {
      note(run_time_word(WordPlace::head, trimmed(content.substr(0, colon))), line);
    }
  }

  const std::vector<LsMotion>& motions() const { return motions_; }

  void add_remarks() {
    for (std::size_t i = 0; i < kRunTimeWords.size(); ++i) {
      add_remark(program_.remarks, fmt::format("{} {}", kRunTimeWords[i].name, kRunTimeWords[i].meaning),
                 std::move(lines_[i]));
    }
  }

private:
  // A controller marks the position at which it stands: "@P[2]".
  static std::string_view without_mark(std::string_view word) { return word.substr(word.starts_with('@') ? 1 : 0); }

  static bool is_place(std::string_view word) {
    word = without_mark(word);
    return word.starts_with("P[") || run_time_word(WordPlace::target, word) != nullptr;
  }

  void note(const RunTimeWord* word, std::size_t line) {
    if (word != nullptr) {
      lines_[static_cast<std::size_t>(word - kRunTimeWords.data())].push_back(line);
    }
  }

  // A motion of this kind to this place, the rest of whose words come next.
  void motion(char kind, std::string_view place, Words& words) {
    const std::size_t first = motions_.size();
    add_motion(kind, place, words.line());
    for (std::string_view word = words.next(); !word.empty(); word = words.next()) {
      if (kind == 'C' && is_place(word) && motions_.size() == first + 1) {
        add_motion(kind, word, words.line());
      } else if (const RunTimeWord* option = run_time_word(WordPlace::option, word)) {
        bool is_step = false;
        for (std::size_t i = first; i < motions_.size(); ++i) {
          LsMotion& each = motions_[i];
          each.motion.is_known = false;
          each.is_increment = each.is_increment || word == "INC";
          is_step = is_step || (word == "INC" && each.is_indirect);
        }
        note(is_step ? run_time_word(WordPlace::step, word) : option, words.line());
      }
    }
  }

  void add_motion(char kind, std::string_view place, std::size_t line) {
    place = without_mark(place);
    const RunTimeWord* unknown = run_time_word(WordPlace::target, place);
    LsMotion motion{.motion = {.line = line,
                               .is_straight = kind != 'J',
                               .is_curved = kind != 'J' && kind != 'L',
                               .is_known = unknown == nullptr}};
    int number = 0;
    const char* digits = place.data() + 2;
    if (place.starts_with("P[") && std::from_chars(digits, place.data() + place.size(), number).ptr != digits) {
      motion.position = number;
    }
    motion.is_indirect = place.starts_with("P[") && !motion.position;
    note(unknown, line);
    motions_.push_back(motion);
  }

  // "UFRAME_NUM=R[3]", also behind a condition: "IF (R[1]=1),UFRAME_NUM=R[3]".
  void assignment(std::string_view statement, std::size_t line) {
    if (const std::size_t condition = statement.find("),"); condition != std::string_view::npos) {
      statement = statement.substr(condition + 2);
    }
    const std::size_t equals = std::min(statement.find('='), statement.size());
    const std::string_view name = trimmed(statement.substr(0, equals));
    const std::string_view value = trimmed(statement.substr(equals));
    if (value.find("P[") != std::string_view::npos) {
      note(run_time_word(WordPlace::copied, name), line);
    }
    if (value.find_first_not_of("=0123456789 \t\r") != std::string_view::npos) {
      note(run_time_word(WordPlace::assigned, name), line);
    }
  }

  Program& program_;
  std::vector<LsMotion> motions_;
  std::array<std::vector<std::size_t>, kRunTimeWords.size()> lines_;
};

// The line of this text that begins at `at`, without its end.
std::string_view line_at(std::string_view text, std::size_t at) {
  return text.substr(at, std::min(text.find('\n', at), text.size()) - at);
}

bool is_ls_program(std::string_view text) { return text.starts_with("/PROG"); }

Program parse_ls_program(const std::vector<ProgramText>& texts) {
  const std::string_view text = texts.front().text;
  const std::string& source = texts.front().source;
  Program program;
  for (auto* zero : {&program.frames.user, &program.frames.tool}) {  // the world, and the faceplate
    (*zero)["0"] = Eigen::Isometry3d::Identity();
  }
  StatementReader statements(program);
  std::size_t line = 0;
  std::size_t last_read = 0;  // line of a statement
  for (std::size_t at = 0; at < text.size();) {
    const std::string_view content = line_at(text, at);
    at = std::min(at + content.size() + 1, text.size());
    ++line;
    if (content.starts_with("/POS")) {
      statements.add_remarks();
      read_ls_positions(texts.front(), at, line + 1, program, statements.motions());
      return program;
    }
    if (line > 1 && (content.starts_with("/PROG") || content.starts_with("/END"))) {
      throw InputError(
          fmt::format("{}:{}: has {} before /POS, expected one whole program in a file", source, line, shown(content)));
    }
    if (line <= last_read) {
      continue;
    }
    if (const std::optional<NumberedLine> numbered = numbered_line(content)) {
      last_read = statements.read(text.substr(static_cast<std::size_t>(numbered->content.data() - text.data())), line);
    } else {
      statements.head(content, line);
    }
  }
  throw InputError(fmt::format("{}:{}: ends here without /POS, expected the whole program", source, line));
}

// The controller writes -.250, right-aligned.
std::string write_ls_number(std::string_view old, double value, int decimals) {
  std::string number = fixed(value, decimals);
  if (const std::size_t zero = number.find("0."); zero == 0 || (zero == 1 && number.front() == '-')) {
    number.erase(zero, 1);
  }
  return fmt::format("{:>{}}", number, std::max(old.size(), number.size() + 1));
}

// Frames of joint values are of no importance: F. PAUSE waits for the operator.
std::string drive_ls(const std::string& name, const std::vector<MeasuringStop>& stops) {
  std::string upper = name;
  std::transform(upper.begin(), upper.end(), upper.begin(), [](unsigned char c) { return std::toupper(c); });
  std::string text = fmt::format(
      "/PROG  {}\n/ATTR\nCOMMENT\t\t= \"kdlcal plan\";\nPROTECT\t\t= READ_WRITE;\nDEFAULT_GROUP\t= 1,*,*,*,*;\n/MN\n",
      upper);
  std::string positions;
  int line = 0;
  for (std::size_t i = 0; i < stops.size(); ++i) {
    const std::array<double, 6>& j = stops[i].joint_values;
    text += fmt::format("{:>4}:  !configuration {} ;\n", line + 1, stops[i].label);
    text += fmt::format("{:>4}:J P[{}] 10% FINE    ;\n{:>4}:  PAUSE ;\n", line + 2, i + 1, line + 3);
    line += 3;
    positions += fmt::format(
        "P[{}]{{\n   GP1:\n\tUF : F, UT : F,\t\n\tJ1={} deg,\tJ2={} deg,\tJ3={} deg,\n\tJ4={} deg,\tJ5={} "
        "deg,\tJ6={} deg\n}};\n",
        i + 1, write_ls_number("         ", j[0], 3), write_ls_number("         ", j[1], 3),
        write_ls_number("         ", j[2], 3), write_ls_number("         ", j[3], 3),
        write_ls_number("         ", j[4], 3), write_ls_number("         ", j[5], 3));
  }
  return text + "/POS\n" + positions + "/END\n";
}

}  // namespace

const ProgramLanguage& fanuc_ls() {
  static const ProgramLanguage language = {.name = "FANUC LS",
                                           .files = ".LS",
                                           .is_written_in = is_ls_program,
                                           .parse = parse_ls_program,
                                           .read_frames = parse_system_frames,
                                           .companion = "",
                                           .needs_description = true,
                                           .joint_names = {"J1", "J2", "J3", "J4", "J5", "J6"},
                                           .length_unit = 1e-3,
                                           .angle_unit = kDegree,
                                           .reference = {},
                                           .user_frame = "UF",
                                           .tool_frame = "UT",
                                           .turns = nullptr,
                                           .write = write_ls_number,
                                           .drive = drive_ls};
  return language;
}

}  // namespace kdl_calibration
