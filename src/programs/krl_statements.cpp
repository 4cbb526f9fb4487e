#include "programs/krl_statements.hpp"

#include <algorithm>
#include <array>
#include <vector>

namespace kdl_calibration::krl {
namespace {

using Kind = FrameInForce::Kind;

bool starts_with_one_of(const std::string& name, const auto& beginnings) {
  return std::any_of(beginnings.begin(), beginnings.end(),
                     [&](std::string_view each) { return name.starts_with(each); });
}

// Functions of the controller and of its technology packages that set no frames.
constexpr std::array<std::string_view, 17> kHarmless = {
    "PULSE", "SWRITE", "SREAD", "CWRITE", "CREAD",    "COPEN",    "CCLOSE",        "CIOCTL", "ERR_",
    "MSG",   "RSI_",   "ST_",   "EKI_",   "USERSPOT", "USER_GRP", "SET_CD_PARAMS", "H50"};
constexpr std::array<std::string_view, 4> kSensor = {"RSI_ON", "RSI_MOVECORR", "ST_ON", "ST_MOVESENS"};
constexpr std::array<std::string_view, 4> kCorrections = {"TOOL_CORR_ON", "TOOL_CORR_W_ON", "BASE_CORR_ON",
                                                          "M_BAS_COR_ON"};
}  // namespace

std::optional<std::size_t> find_word(std::string_view text, std::string_view word) {
  for (std::size_t at = 0; at < text.size();) {
    const char c = text[at];
    if (c == '{' || c == '(' || c == '[') {
      at = closing_bracket(text, at).value_or(text.size() - 1) + 1;
      continue;
    }
    const std::string_view found = word_at(text.substr(at));
    if (is_word(found, word)) {
      return at;
    }
    at += std::max<std::size_t>(found.size(), 1);
  }
  return std::nullopt;
}

void StatementReader::read(const std::string& word, std::string_view line, const Place& place) {
  place_ = place;
  const std::string_view rest = rest_after(line, word.size());
  if (flow_.statement(word, line)) {
    return;
  }
  if (word == "SPLINE" || word == "PTP_SPLINE") {
    flow_.begin_spline();
    if (const std::optional<std::size_t> begin = find_word(rest, "WITH")) {
      flow_.replace(with(flow_.now(), rest.substr(*begin + 4), place));
    }
  } else if (word == "ENDSPLINE") {
    flow_.end_spline();
  } else if (word == "INTERRUPT" || word == "GLOBAL") {
    interrupt(rest);
  } else if (rest.starts_with('(')) {
    call(word, rest);
  } else if (rest == ":") {
    flow_.label(word);
  } else {
    const Reference left = reference_at(line);
    if (const std::optional<std::string_view> value = assigned_value(line, left)) {
      assignment(left, *value);
    }
  }
}

// INTERRUPT DECL 3 WHEN $IN[1]==TRUE DO STOPPED()
void StatementReader::interrupt(std::string_view line) {
  if (const std::optional<std::size_t> begin = find_word(line, "DO")) {
    const std::string name = in_upper_case(word_at(rest_after(line, *begin + 2)));
    if (const std::optional<Routine> routine = symbols_.routine(name)) {
      flow_.interrupted_by(*routine);
    }
  }
}

void StatementReader::call(const std::string& name, std::string_view rest) {
  if (name == "BAS") {
    const std::optional<std::size_t> end = closing_bracket(rest);
    bas(rest.substr(1, end.value_or(rest.size()) - 1));
    return;
  }
  if (starts_with_one_of(name, kSensor)) {
    note(Note::sensor);
  }
  const std::optional<Routine> routine = symbols_.routine(name);
  if (routine || !(starts_with_one_of(name, kHarmless) || name == "WAIT" || name == "IF")) {
    flow_.call(routine);
  }
  if (!routine && notes_ != nullptr) {
    const std::optional<std::size_t> end = closing_bracket(rest);
    for (const std::string_view part : list_parts(rest.substr(1, end.value_or(rest.size()) - 1))) {
      const Reference argument = reference_at(part);
      const std::optional<std::size_t> point =
          argument.size == part.size() ? symbols_.find(argument, flow_.routine()) : std::nullopt;
      if (point && symbols_.all()[*point].position && !symbols_.all()[*point].is_frame) {
        note(Note::handed_on);
      }
    }
  }
}

// The routine BAS of the controller. With #INITMOV it puts $WORLD and TOOL_DATA[1] in force.
void StatementReader::bas(std::string_view arguments) {
  const std::vector<std::string_view> parts = list_parts(arguments);
  const std::string command = in_upper_case(parts.front());
  const auto number = [&] { return parts.size() > 1 ? symbols_.whole(parts[1], flow_.routine()) : std::nullopt; };
  if (command == "#INITMOV") {
    flow_.set_base(frames_.of_number(0, false));
    flow_.set_tool(frames_.of_number(1, true));
    flow_.set_place(ToolPlace::on_arm);
  } else if (command == "#TOOL" || command == "#BASE") {
    const bool is_tool = command == "#TOOL";
    set_frame(frames_.of_number(number(), is_tool), is_tool);
  } else if (command == "#EX_BASE") {
    set_frame({.kind = Kind::moving}, false);
  } else if (command == "#FRAMES" || command == "#PTP_PARAMS" || command == "#CP_PARAMS") {
    put_next_in_force();
  }
}

void StatementReader::put_next_in_force() {
  const FrameData next = flow_.now().next;
  flow_.set_tool(frames_.of_number(next.tool, true));
  flow_.set_base(frames_.of_number(next.base, false));
  if (next.place != ToolPlace::unstated) {
    flow_.set_place(next.place);
  }
}

void StatementReader::set_frame(const FrameInForce& value, bool is_tool) {
  if (value.kind == Kind::computed || value.kind == Kind::moving) {
    note(value.kind == Kind::moving ? Note::moving_base : Note::computed_frame);
  }
  is_tool ? flow_.set_tool(value) : flow_.set_base(value);
}

void StatementReader::assignment(const Reference& left, std::string_view value) {
  if (left.name == "$ROBROOT") {
    note(Note::root_set);
  }
  if (left.name == "$TOOL" || left.name == "$BASE") {
    const bool is_tool = left.name == "$TOOL";
    set_frame(left.member.empty() ? frames_.of_value(value, is_tool, flow_.routine(), place_)
                                  : FrameInForce{.kind = Kind::computed},
              is_tool);
  } else if (left.name == "$IPO_MODE") {
    flow_.set_place(frames_.place_of(value, flow_.routine()));
  } else if (left.name == "FDAT_ACT") {
    next_frames(left, value);
  } else if (left.name == "TOOL_DATA" || left.name == "BASE_DATA") {
    if (!symbols_.find(left, flow_.routine())) {
      note(Note::computed_data);
    }
  } else if (starts_with_one_of(left.name, kCorrections)) {
    if (!is_word(value, "FALSE")) {
      note(Note::correction);
    }
  } else if (!left.name.starts_with('$') && notes_ != nullptr) {
    copies(value);
  }
}

// FDAT_ACT=FP1, FDAT_ACT={TOOL_NO 1,BASE_NO 2}, FDAT_ACT.TOOL_NO=3
void StatementReader::next_frames(const Reference& left, std::string_view value) {
  FrameData next = flow_.now().next;
  if (is_word(left.member, "TOOL_NO")) {
    next.tool = symbols_.whole(value, flow_.routine());
  } else if (is_word(left.member, "BASE_NO")) {
    next.base = symbols_.whole(value, flow_.routine());
  } else if (is_word(left.member, "IPO_FRAME")) {
    next.place = frames_.place_of(value, flow_.routine());
  } else if (left.member.empty()) {
    next = {.tool = {}, .base = {}, .place = ToolPlace::unstated};
    const Reference right = reference_at(value);
    if (const std::optional<Aggregate> aggregate = aggregate_at(value, place_)) {
      next = frame_data_of(*aggregate);
    } else if (const auto found = symbols_.find(right, flow_.routine());
               found && right.size == value.size() && !symbols_.all()[*found].is_changed) {
      next = symbols_.all()[*found].frame_data.value_or(next);
    }
  }
  flow_.set_next(next);
}

void StatementReader::copies(std::string_view value) {
  for (std::size_t at = 0; at < value.size();) {
    Reference right = reference_at(value.substr(at));
    at += std::max<std::size_t>(right.size, 1);
    right.member = {};
    const std::optional<std::size_t> found = symbols_.find(right, flow_.routine());
    if (found && symbols_.all()[*found].position && !symbols_.all()[*found].is_frame) {
      note(Note::copied);
    }
  }
}

// $TOOL, $BASE and $IPO_MODE of one motion.
FramesInForce StatementReader::with(FramesInForce frames, std::string_view assignments, const Place& place) {
  place_ = place;
  for (const std::string_view part : list_parts(assignments)) {
    const Reference left = reference_at(part);
    const std::optional<std::string_view> value = assigned_value(part, left);
    if (value && (left.name == "$TOOL" || left.name == "$BASE")) {
      const bool is_tool = left.name == "$TOOL";
      const FrameInForce frame = frames_.of_value(*value, is_tool, flow_.routine(), place_);
      if (frame.kind == Kind::moving) {
        note(Note::moving_base);
      }
      (is_tool ? frames.tool : frames.base) = frame;
    } else if (value && left.name == "$IPO_MODE") {
      frames.place = frames_.place_of(*value, flow_.routine());
    }
  }
  return frames;
}

}  // namespace kdl_calibration::krl
