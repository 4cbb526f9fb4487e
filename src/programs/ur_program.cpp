#include "programs/ur_program.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <utility>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/add_remark.hpp"
#include "programs/left_points.hpp"
#include "programs/number_fields.hpp"
#include "programs/pose_numbers.hpp"
#include "programs/ur_text.hpp"

namespace kdl_calibration {
namespace ur {
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
enum class Remark : std::uint8_t { computed, feature, tool, order_of_tools, moved, unused };
constexpr std::array kRemarks = {
    "a target is computed at run time: not compensated here",
    "pose_trans states a target in a feature: not compensated here, expected targets in the base",
    "set_tcp sets a tool that is known at run time only: poses after it are left as they are",
    "set_tcp sets another tool than before: poses have the tool that is set above them in the text",
    "conveyors, forces and path offsets move the arm at run time: targets are compensated where they are without that",
    "a pose is no target of a motion that is read here: left as it is"};

// Instructions that move the arm beside its targets.
constexpr std::array kMovingWords = std::to_array<std::string_view>(
    {"track_conveyor_linear", "track_conveyor_circular", "force_mode", "path_offset_enable", "path_offset_set"});

// What an assignment puts into a variable.
struct Assignment {
  std::size_t at = 0;
  std::optional<Literal> literal;
};

class UrReader {
public:
  explicit UrReader(const ProgramText& text) : text_(text), bytes_(text_.all()) { text_.require_whole(); }

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
    for (std::size_t i = 0; i < kRemarks.size(); ++i) {
      add_remark(program_.remarks, kRemarks[i], std::move(lines_of_[i]));
    }
    leave_out_points(program_, "a pose is used with two tools: left as it is",
                     [&](const ProgramPoint& point) { return of_two_tools_.contains(point.fields.front().begin); });
    return std::move(program_);
  }

private:
  // Calls work(word, arguments, at) for each call of a function of interest, in the order of the text.
  template <typename Work>
  void for_each_call(const Work& work) const {
    text_.for_each_word([&](Span word) {
      const std::string_view name = text_.in(word);
      const std::size_t open = std::min(bytes_.find_first_not_of(" \t", word.end), bytes_.size());
      const bool is_known = name == "set_tcp" || is_moving_word(name) || motion_word(name) != nullptr;
      if (is_known && open < bytes_.size() && bytes_[open] == '(') {
        work(name, text_.arguments(open).value_or(std::vector<Span>()), word.begin);
      }
    });
  }

  static bool is_moving_word(std::string_view word) {
    return std::find(kMovingWords.begin(), kMovingWords.end(), word) != kMovingWords.end();
  }

  // ---- Literals and variables --------------------------------------------------------------------------------------

  // Of "def go(A, B = p[...]):": inside they hide variables of these names.
  void find_parameters() {
    text_.for_each_word([&](Span word) {
      if (text_.in(word) != "def" && text_.in(word) != "thread") {
        return;
      }
      const std::size_t open = std::min(bytes_.find_first_of("(\n", word.end), bytes_.size());
      const std::optional<std::vector<Span>> found =
          open < bytes_.size() && bytes_[open] == '(' ? text_.arguments(open) : std::nullopt;
      for (const Span parameter : found.value_or(std::vector<Span>())) {
        const std::string_view words = text_.in(parameter);
        parameters_.insert(std::string(trimmed(words.substr(0, words.find('=')))));
      }
    });
  }

  // Poses in numbers that are neither points nor tools nor in a line that another remark names.
  void find_unused_poses() {
    std::set<std::size_t> named;
    for (const std::vector<std::size_t>& lines : lines_of_) {
      named.insert(lines.begin(), lines.end());
    }
    text_.for_each_byte([&](std::size_t at) {
      const bool begins = bytes_.substr(at, 2) == "p[" && (at == 0 || !is_letter(bytes_[at - 1]));
      const std::size_t end = begins ? bytes_.find(']', at) : std::string_view::npos;
      if (end != std::string_view::npos && !point_at_.contains(at) && !tool_at_.contains(at) &&
          !named.contains(text_.line(at)) && text_.literal({.begin = at, .end = end + 1})) {
        note(Remark::unused, at);
      }
    });
  }

  // "global Waypoint_1_p = p[...]" at the beginning of a line.
  void find_assignments() {
    for (std::size_t i = 0; i < text_.line_begins().size(); ++i) {
      const std::size_t end = i + 1 < text_.line_begins().size() ? text_.line_begins()[i + 1] - 1 : bytes_.size();
      Span statement = text_.stripped({.begin = text_.line_begins()[i], .end = end});
      for (const std::string_view scope : {"global ", "local "}) {
        statement.begin += text_.in(statement).starts_with(scope) ? scope.size() : 0;
      }
      statement = text_.stripped(statement);
      std::size_t at = statement.begin;
      while (at < statement.end && is_letter(bytes_[at])) {
        ++at;
      }
      const std::string name(bytes_.substr(statement.begin, at - statement.begin));
      const std::string_view rest = bytes_.substr(at, statement.end - at);
      const std::size_t equals = rest.find_first_not_of(" \t");
      const bool is_member = equals != std::string_view::npos && rest[equals] == '[';
      if (name.empty() || equals == std::string_view::npos || (rest[equals] != '=' && !is_member) ||
          rest.substr(equals).starts_with("==")) {
        continue;
      }
      Assignment assignment{.at = statement.begin, .literal = {}};
      if (!is_member) {
        const Span value = text_.stripped({.begin = at + equals + 1, .end = end_of_value(at + equals + 1)});
        assignment.literal = text_.literal(value);
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
    for (; at < bytes_.size(); ++at) {
      depth += bytes_[at] == '[' ? 1 : bytes_[at] == ']' ? -1 : 0;
      if (bytes_[at] == '#' || (depth <= 0 && bytes_[at] == '\n')) {
        break;
      }
    }
    return at;
  }

  // ---- Motions -----------------------------------------------------------------------------------------------------

  void note(Remark remark, std::size_t at) { lines_of_[static_cast<std::size_t>(remark)].push_back(text_.line(at)); }

  void set_tool(const std::vector<Span>& arguments, std::size_t at) {
    const std::optional<Literal> found = arguments.empty() ? std::nullopt : text_.literal(arguments.front());
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
    tool_ = same == tools.end() ? fmt::format("set_tcp in line {}", text_.line(at)) : same->first;
    tools[*tool_] = frame;
  }

  void add_motion(const MotionWord& word, Span target, std::size_t at) {
    ProgramMotion motion{.line = text_.line(at), .is_straight = word.is_straight, .is_curved = word.targets == 2};
    Span near;
    if (text_.in(target).starts_with("get_inverse_kin")) {
      const std::optional<std::vector<Span>> inside =
          text_.arguments(std::min(bytes_.find('(', target.begin), target.end));
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
      note(text_.in(target).starts_with("pose_trans") ? Remark::feature : Remark::computed, at);
    }
    motion.point = point;
    motion.is_known = point.has_value();
    program_.motions.push_back(motion);
  }

  // get_inverse_kin(pose, qnear, position error, orientation error, tool)
  bool states_tool(const std::vector<Span>& arguments) const {
    constexpr std::size_t kBeforeTool = 4;
    return arguments.size() > kBeforeTool || std::any_of(arguments.begin(), arguments.end(), [&](const Span& argument) {
             return text_.in(argument).starts_with("tcp");
           });
  }

  // The point of a literal or of a variable that has literals; all of these become points.
  std::optional<std::size_t> point_of(Span target, Span near, std::size_t at) {
    if (const std::optional<Literal> found = text_.literal(target)) {
      return add_point(*found, fmt::format("line {}", text_.line(found->span.begin)), near, at);
    }
    const auto variable = variables_.find(std::string(text_.in(target)));
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
      point.line = text_.line(literal.span.begin);
      point.fields = literal.fields;
      if (literal.is_pose) {
        point.notation = PointNotation::rotation_vector;
        point.user_frame = kBase;
        point.tool_frame = *tool_;
        point.near = joint_values_of(near, at);
      }
      program_.points.push_back(std::move(point));
    } else if (literal.is_pose && program_.points[place->second].tool_frame != tool_) {
      of_two_tools_.insert(literal.fields.front().begin);
    }
    return place->second;
  }

  // "qnear=Waypoint_1_q", "[0, -1.57, ...]"; none for what is computed.
  std::optional<SixJoints> joint_values_of(Span near, std::size_t at) const {
    constexpr std::string_view kName = "qnear";
    if (text_.in(near).starts_with(kName)) {
      near = text_.stripped({.begin = near.begin + kName.size(), .end = near.end});
      near.begin += text_.in(near).starts_with('=') ? 1 : 0;
      near = text_.stripped(near);
    }
    std::optional<Literal> found = text_.literal(near);
    if (const auto variable = variables_.find(std::string(text_.in(near))); variable != variables_.end()) {
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

  Text text_;
  std::string_view bytes_;
  std::map<std::string, std::vector<Assignment>> variables_;
  std::optional<std::string> tool_{kInstalledTool};  // none: known at run time only
  std::map<std::size_t, std::size_t> point_at_;      // by the place of its literal
  std::set<std::size_t> of_two_tools_;               // by the place of its first number
  std::set<std::size_t> tool_at_;                    // places of tools' literals
  std::set<std::string> parameters_;                 // of functions
  bool uses_installed_tool_ = false;
  std::array<std::vector<std::size_t>, kRemarks.size()> lines_of_;
  Program program_;
};

// A call of a motion, whose names no other language writes so.
bool is_ur_script(std::string_view text) {
  return std::any_of(kMotionWords.begin(), kMotionWords.end(), [&](const MotionWord& motion) {
    const std::string call = std::string(motion.word) + "(";
    for (std::size_t at = text.find(call); at != std::string_view::npos; at = text.find(call, at + 1)) {
      if (at == 0 || !is_letter(text[at - 1])) {
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
}  // namespace ur

const ProgramLanguage& ur_script() {
  static const ProgramLanguage language = {
      .name = "URScript",
      .files = ".script",
      .is_written_in = ur::is_ur_script,
      .parse = [](const std::vector<ProgramText>& texts) { return ur::UrReader(texts.front()).read(); },
      .read_frames = ur::no_frames,
      .companion = "",
      .joint_names = {"Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"},
      .length_unit = 1.0,
      .angle_unit = 1.0,
      .reference = {},
      .user_frame = "feature",
      .tool_frame = "tool frame (set_tcp)",
      .turns = nullptr,
      .write = written_plainly,
      .drive = ur::drive_ur};
  return language;
}

}  // namespace kdl_calibration
