#include "programs/ur_program.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/add_remark.hpp"
#include "programs/number_fields.hpp"
#include "programs/pose_numbers.hpp"

namespace kdl_calibration {
namespace {

constexpr std::size_t kNumbers = 6;
constexpr std::string_view kInstalledTool = "tcp";  // that of the installation, which no program states
constexpr std::string_view kBase = "base";

// Instructions that move to their first argument; movec and servoc also to their second.
struct MotionWord {
  std::string_view word;
  bool is_straight;
  std::size_t targets;
};
constexpr std::array kMotionWords = std::to_array<MotionWord>({{"movej", false, 1},
                                                               {"movel", true, 1},
                                                               {"movep", true, 1},
                                                               {"movec", true, 2},
                                                               {"optimovej", false, 1},
                                                               {"optimovel", true, 1},
                                                               {"servoj", false, 1},
                                                               {"servoc", true, 2}});

const MotionWord* motion_word(std::string_view word) {
  const auto found =
      std::find_if(kMotionWords.begin(), kMotionWords.end(), [&](const MotionWord& each) { return each.word == word; });
  return found == kMotionWords.end() ? nullptr : &*found;
}

// Why a place is known at run time only, by the function that computes it.
enum class Remark : std::uint8_t { computed, feature, tool, two_tools, order_of_tools, moved, unused };
constexpr std::array kRemarks = {
    "a target is computed at run time: not compensated here",
    "pose_trans states a target in a feature: not compensated here, expected targets in the base",
    "set_tcp sets a tool that is known at run time only: poses after it are left as they are",
    "a pose is used with two tools: left as it is",
    "set_tcp sets another tool than before: poses have the tool that is set above them in the text",
    "conveyors, forces and path offsets move the arm at run time: targets are compensated where they are without that",
    "a pose is no target of a motion that is read here: left as it is"};

// Instructions that move the arm beside its targets.
constexpr std::array kMovingWords = std::to_array<std::string_view>(
    {"track_conveyor_linear", "track_conveyor_circular", "force_mode", "path_offset_enable", "path_offset_set"});

bool is_word(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_'; }

// A part of the text.
struct Span {
  std::size_t begin = 0;
  std::size_t end = 0;
};

// A pose or a list of joint values that the text states in numbers.
struct Literal {
  bool is_pose = false;
  Span span;
  std::vector<NumberField> fields;
};

// What an assignment puts into a variable.
struct Assignment {
  std::size_t at = 0;
  std::optional<Literal> literal;
};

class UrReader {
public:
  explicit UrReader(const ProgramText& text) : text_(text.text), source_(text.source) { begin_lines(); }

  Program read() {
    program_.frames.user[std::string(kBase)] = Eigen::Isometry3d::Identity();
    find_parameters();
    find_assignments();
    for_each_call([&](std::string_view word, const std::vector<Span>& arguments, std::size_t at) {
      if (word == "set_tcp") {
        set_tool(arguments, at);
      } else if (is_moving_word(word)) {
        note(Remark::moved, at);
      } else if (const MotionWord* motion = motion_word(word)) {
        for (std::size_t i = 0; i < std::min(motion->targets, arguments.size()); ++i) {
          add_motion(*motion, arguments[i], at);
        }
      }
    });
    find_unused_poses();
    leave_out_points_of_two_tools();
    for (std::size_t i = 0; i < kRemarks.size(); ++i) {
      add_remark(program_.remarks, kRemarks[i], std::move(lines_of_[i]));
    }
    return std::move(program_);
  }

private:
  // ---- The text ----------------------------------------------------------------------------------------------------

  void begin_lines() {
    line_begins_ = {0};
    for (std::size_t at = text_.find('\n'); at != std::string_view::npos; at = text_.find('\n', at + 1)) {
      line_begins_.push_back(at + 1);
    }
  }

  std::size_t line(std::size_t at) const {
    return static_cast<std::size_t>(std::upper_bound(line_begins_.begin(), line_begins_.end(), at) -
                                    line_begins_.begin());
  }

  // Behind a comment or a string that begins here; the same place if none does.
  std::size_t behind_comment_or_string(std::size_t at) const {
    if (text_[at] == '#') {
      return std::min(text_.find('\n', at), text_.size());
    }
    if (text_[at] == '"') {
      const std::size_t end = text_.find_first_of("\"\n", at + 1);
      return end == std::string_view::npos ? text_.size() : end + 1;
    }
    return at;
  }

  // The arguments of a call whose parenthesis opens at `open`, up to its end; none if that does not close.
  std::optional<std::vector<Span>> arguments(std::size_t open) const {
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

  Span stripped(Span span) const {
    constexpr std::string_view kBlanks = " \t\r\n";
    while (span.begin < span.end && kBlanks.find(text_[span.begin]) != std::string_view::npos) {
      ++span.begin;
    }
    while (span.end > span.begin && kBlanks.find(text_[span.end - 1]) != std::string_view::npos) {
      --span.end;
    }
    return span;
  }

  std::string_view in(Span span) const { return text_.substr(span.begin, span.end - span.begin); }

  // Calls work(word, arguments, at) for each call of a function of interest, in the order of the text.
  template <typename Work>
  void for_each_call(const Work& work) const {
    for (std::size_t at = 0; at < text_.size();) {
      if (const std::size_t behind = behind_comment_or_string(at); behind != at) {
        at = behind;
        continue;
      }
      if (!is_word(text_[at])) {
        ++at;
        continue;
      }
      const std::size_t begin = at;
      while (at < text_.size() && is_word(text_[at])) {
        ++at;
      }
      const std::string_view word = text_.substr(begin, at - begin);
      const std::size_t open = std::min(text_.find_first_not_of(" \t", at), text_.size());
      const bool is_known = word == "set_tcp" || is_moving_word(word) || motion_word(word) != nullptr;
      if (is_known && open < text_.size() && text_[open] == '(') {
        const std::optional<std::vector<Span>> found = arguments(open);
        if (!found) {
          throw InputError(fmt::format("{}:{}: {} has no closing parenthesis, expected the whole program", source_,
                                       line(begin), word));
        }
        work(word, *found, begin);
      }
    }
  }

  static bool is_moving_word(std::string_view word) {
    return std::find(kMovingWords.begin(), kMovingWords.end(), word) != kMovingWords.end();
  }

  // ---- Literals and variables --------------------------------------------------------------------------------------

  // "p[0.1, -0.2, 0.3, 0, 3.14, 0]" or "[0, -1.57, 1.57, 0, 1.57, 0]".
  std::optional<Literal> literal(Span span) const {
    Literal result{.is_pose = text_[span.begin] == 'p', .span = span};
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
    return result.fields.size() == kNumbers ? std::optional(result) : std::nullopt;
  }

  // Of "def go(A, B = p[...]):": inside they hide variables of these names.
  void find_parameters() {
    for (const std::string_view begin : {"def ", "thread "}) {
      for (std::size_t at = text_.find(begin); at != std::string_view::npos; at = text_.find(begin, at + 1)) {
        const std::size_t open = std::min(text_.find_first_of("(\n", at), text_.size());
        const std::optional<std::vector<Span>> found =
            open < text_.size() && text_[open] == '(' ? arguments(open) : std::nullopt;
        for (const Span parameter : found.value_or(std::vector<Span>())) {
          const std::string_view words = in(parameter);
          parameters_.insert(std::string(trimmed(words.substr(0, words.find('=')))));
        }
      }
    }
  }

  // Poses in numbers that are neither points nor tools nor in a line that another remark names.
  void find_unused_poses() {
    std::set<std::size_t> named;
    for (const std::vector<std::size_t>& lines : lines_of_) {
      named.insert(lines.begin(), lines.end());
    }
    for (std::size_t at = 0; at < text_.size();) {
      if (const std::size_t behind = behind_comment_or_string(at); behind != at) {
        at = behind;
        continue;
      }
      const bool begins = text_[at] == 'p' && text_.substr(at + 1, 1) == "[" && (at == 0 || !is_word(text_[at - 1]));
      const std::size_t end = begins ? text_.find(']', at) : std::string_view::npos;
      if (end != std::string_view::npos && !point_at_.contains(at) && !tool_at_.contains(at) &&
          !named.contains(line(at)) && literal({.begin = at, .end = end + 1})) {
        note(Remark::unused, at);
      }
      ++at;
    }
  }

  // "global Waypoint_1_p = p[...]" at the beginning of a line.
  void find_assignments() {
    for (std::size_t i = 0; i < line_begins_.size(); ++i) {
      const std::size_t end = i + 1 < line_begins_.size() ? line_begins_[i + 1] - 1 : text_.size();
      Span statement = stripped({.begin = line_begins_[i], .end = end});
      for (const std::string_view scope : {"global ", "local "}) {
        statement.begin += in(statement).starts_with(scope) ? scope.size() : 0;
      }
      statement = stripped(statement);
      std::size_t at = statement.begin;
      while (at < statement.end && is_word(text_[at])) {
        ++at;
      }
      const std::string name(text_.substr(statement.begin, at - statement.begin));
      const std::string_view rest = text_.substr(at, statement.end - at);
      const std::size_t equals = rest.find_first_not_of(" \t");
      const bool is_member = equals != std::string_view::npos && rest[equals] == '[';
      if (name.empty() || equals == std::string_view::npos || (rest[equals] != '=' && !is_member) ||
          rest.substr(equals).starts_with("==")) {
        continue;
      }
      Assignment assignment{.at = statement.begin, .literal = {}};
      if (!is_member) {
        const Span value = stripped({.begin = at + equals + 1, .end = end_of_value(at + equals + 1)});
        assignment.literal = value.begin < value.end ? literal(value) : std::nullopt;
      } else if (rest.find('=') == std::string_view::npos) {
        continue;
      }
      variables_[name].push_back(assignment);
    }
  }

  // A list may go on over lines; another value ends with its line or a comment.
  std::size_t end_of_value(std::size_t begin) const {
    int depth = 0;
    std::size_t at = begin;
    for (; at < text_.size(); ++at) {
      depth += text_[at] == '[' ? 1 : text_[at] == ']' ? -1 : 0;
      if (text_[at] == '#' || (depth <= 0 && text_[at] == '\n')) {
        break;
      }
    }
    return at;
  }

  // ---- Motions -----------------------------------------------------------------------------------------------------

  void note(Remark remark, std::size_t at) { lines_of_[static_cast<std::size_t>(remark)].push_back(line(at)); }

  void set_tool(const std::vector<Span>& arguments, std::size_t at) {
    const std::optional<Literal> found = arguments.empty() || arguments.front().begin == arguments.front().end
                                             ? std::nullopt
                                             : literal(arguments.front());
    if (!found || !found->is_pose) {
      tool_.reset();
      note(Remark::tool, at);
      return;
    }
    PointNumbers numbers(static_cast<Eigen::Index>(kNumbers));
    for (std::size_t i = 0; i < kNumbers; ++i) {
      numbers[static_cast<Eigen::Index>(i)] = found->fields[i].value;
    }
    const Eigen::Isometry3d frame = pose_of(PointNotation::rotation_vector, numbers);
    auto& tools = program_.frames.tool;
    const auto same = std::find_if(tools.begin(), tools.end(),
                                   [&](const auto& each) { return each.second.matrix() == frame.matrix(); });
    tool_at_.insert(found->span.begin);
    if (same == tools.end() && (!tools.empty() || uses_installed_tool_)) {
      note(Remark::order_of_tools, at);
    }
    tool_ = same == tools.end() ? fmt::format("set_tcp in line {}", line(at)) : same->first;
    tools[*tool_] = frame;
  }

  void add_motion(const MotionWord& word, Span target, std::size_t at) {
    ProgramMotion motion{.line = line(at), .is_straight = word.is_straight};
    Span near;
    if (in(target).starts_with("get_inverse_kin")) {
      const std::optional<std::vector<Span>> inside = arguments(std::min(text_.find('(', target.begin), target.end));
      if (inside && !inside->empty()) {
        target = inside->front();
        near = inside->size() > 1 ? (*inside)[1] : near;
      }
      if (inside && states_tool(*inside)) {
        note(Remark::computed, at);
        motion.is_known = false;
        program_.motions.push_back(motion);
        return;
      }
    }
    const std::optional<std::size_t> point = point_of(target, near, at);
    if (!point) {
      note(in(target).starts_with("pose_trans") ? Remark::feature : Remark::computed, at);
    }
    motion.point = point;
    motion.is_known = point.has_value();
    program_.motions.push_back(motion);
  }

  // get_inverse_kin(pose, qnear, position error, orientation error, tool)
  bool states_tool(const std::vector<Span>& arguments) const {
    constexpr std::size_t kBeforeTool = 4;
    return arguments.size() > kBeforeTool || std::any_of(arguments.begin(), arguments.end(), [&](const Span& argument) {
             return in(argument).starts_with("tcp");
           });
  }

  // The point of a literal or of a variable that has literals; all of these become points.
  std::optional<std::size_t> point_of(Span target, Span near, std::size_t at) {
    if (target.begin == target.end) {
      return std::nullopt;
    }
    if (const std::optional<Literal> found = literal(target)) {
      return add_point(*found, fmt::format("line {}", line(found->span.begin)), near, at);
    }
    const auto variable = variables_.find(std::string(in(target)));
    if (variable == variables_.end() || parameters_.contains(variable->first)) {
      return std::nullopt;
    }
    std::optional<std::size_t> last;
    for (const Assignment& assignment : variable->second) {
      if (!assignment.literal) {
        note(Remark::computed, assignment.at);
        last = assignment.at < at ? std::nullopt : last;
        continue;
      }
      const std::optional<std::size_t> point = add_point(*assignment.literal, variable->first, near, at);
      last = assignment.at < at || !last ? point : last;
    }
    return last;
  }

  std::optional<std::size_t> add_point(const Literal& literal, const std::string& name, Span near, std::size_t at) {
    if (literal.is_pose && !tool_) {
      return std::nullopt;
    }
    uses_installed_tool_ = uses_installed_tool_ || (literal.is_pose && *tool_ == kInstalledTool);
    const auto [place, is_new] = point_at_.try_emplace(literal.span.begin, program_.points.size());
    if (is_new) {
      ProgramPoint point;
      point.name = name;
      point.line = line(literal.span.begin);
      point.fields = literal.fields;
      if (literal.is_pose) {
        point.notation = PointNotation::rotation_vector;
        point.user_frame = kBase;
        point.tool_frame = *tool_;
        point.near = joint_values_of(near, at);
      }
      program_.points.push_back(std::move(point));
    } else if (literal.is_pose && program_.points[place->second].tool_frame != tool_) {
      of_two_tools_.insert(place->second);
    }
    return place->second;
  }

  // "qnear=Waypoint_1_q", "[0, -1.57, ...]"; none for what is computed.
  std::optional<SixJoints> joint_values_of(Span near, std::size_t at) const {
    constexpr std::string_view kName = "qnear";
    if (in(near).starts_with(kName)) {
      near = stripped({.begin = near.begin + kName.size(), .end = near.end});
      near.begin += in(near).starts_with('=') ? 1 : 0;
      near = stripped(near);
    }
    if (near.begin == near.end) {
      return std::nullopt;
    }
    std::optional<Literal> found = literal(near);
    if (const auto variable = variables_.find(std::string(in(near))); variable != variables_.end()) {
      for (const Assignment& assignment : variable->second) {
        found = assignment.at < at || !found ? assignment.literal : found;
      }
    }
    if (!found || found->is_pose) {
      return std::nullopt;
    }
    SixJoints values;
    for (std::size_t i = 0; i < kNumbers; ++i) {
      values[static_cast<Eigen::Index>(i)] = found->fields[i].value;
    }
    return values;
  }

  void leave_out_points_of_two_tools() {
    std::vector<std::optional<std::size_t>> moved_to(program_.points.size());
    std::vector<ProgramPoint> kept;
    for (std::size_t i = 0; i < program_.points.size(); ++i) {
      if (of_two_tools_.contains(i)) {
        note(Remark::two_tools, line_begins_[program_.points[i].line - 1]);
        continue;
      }
      moved_to[i] = kept.size();
      kept.push_back(std::move(program_.points[i]));
    }
    program_.points = std::move(kept);
    for (ProgramMotion& motion : program_.motions) {
      motion.point = motion.point ? moved_to[*motion.point] : std::nullopt;
    }
  }

  std::string_view text_;
  std::string source_;
  std::vector<std::size_t> line_begins_;
  std::map<std::string, std::vector<Assignment>> variables_;
  std::optional<std::string> tool_{kInstalledTool};  // none: known at run time only
  std::map<std::size_t, std::size_t> point_at_;      // by the place of its literal
  std::set<std::size_t> of_two_tools_;
  std::set<std::size_t> tool_at_;     // places of tools' literals
  std::set<std::string> parameters_;  // of functions
  bool uses_installed_tool_ = false;
  std::array<std::vector<std::size_t>, kRemarks.size()> lines_of_;
  Program program_;
};

// A call of a motion, whose names no other language writes so.
bool is_ur_script(std::string_view text) {
  return std::any_of(kMotionWords.begin(), kMotionWords.end(), [&](const MotionWord& motion) {
    const std::string call = std::string(motion.word) + "(";
    for (std::size_t at = text.find(call); at != std::string_view::npos; at = text.find(call, at + 1)) {
      if (at == 0 || !is_word(text[at - 1])) {
        return true;
      }
    }
    return false;
  });
}

ProgramFrames no_frames(std::string_view /*text*/, const std::string& source) {
  throw InputError(source +
                   ": is no JSON, expected {\"tool_frames\": {\"tcp\": {\"position\": [...], "
                   "\"quaternion_wxyz\": [...]}}}");
}

// A pop-up waits for the operator. 0.3 rad/s are about a tenth of full speed.
std::string drive_ur(const std::string& name, const std::vector<MeasuringStop>& stops) {
  std::string text = "def " + name + "():\n";
  for (const MeasuringStop& stop : stops) {
    text += fmt::format("  # configuration {}\n  movej([{:.6f}], a=0.5, v=0.3)\n", stop.label,
                        fmt::join(stop.joint_values, ", "));
    text += fmt::format("  popup(\"configuration {}\", blocking=True)\n", stop.label);
  }
  return text + "end\n";
}

}  // namespace

const ProgramLanguage& ur_script() {
  static const ProgramLanguage language = {
      .name = "URScript",
      .files = ".script",
      .is_written_in = is_ur_script,
      .parse = [](const std::vector<ProgramText>& texts) { return UrReader(texts.front()).read(); },
      .read_frames = no_frames,
      .companion = "",
      .joint_names = {"Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"},
      .length_unit = 1.0,
      .angle_unit = 1.0,
      .reference = {},
      .user_frame = "feature",
      .tool_frame = "tool frame (set_tcp)",
      .turns = nullptr,
      .write = written_plainly,
      .drive = drive_ur};
  return language;
}

}  // namespace kdl_calibration
