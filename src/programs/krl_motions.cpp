#include "programs/krl_motions.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "base/text.hpp"
#include "programs/krl_statements.hpp"

namespace kdl_calibration::krl {
namespace {

using Kind = FrameInForce::Kind;

struct MotionWord {
  bool is_straight = false;
  bool is_circle = false;
  bool is_spline = false;
  bool is_increment = false;
};

const MotionWord* motion_word(const std::string& word) {
  static const std::unordered_map<std::string, MotionWord> all = {
      {"PTP", {}},
      {"SPTP", {}},
      {"LIN", {.is_straight = true}},
      {"SLIN", {.is_straight = true}},
      {"SPL", {.is_straight = true, .is_spline = true}},
      {"CIRC", {.is_straight = true, .is_circle = true}},
      {"SCIRC", {.is_straight = true, .is_circle = true}},
      {"PTP_REL", {.is_increment = true}},
      {"SPTP_REL", {.is_increment = true}},
      {"LIN_REL", {.is_straight = true, .is_increment = true}},
      {"SLIN_REL", {.is_straight = true, .is_increment = true}},
      {"SPL_REL", {.is_straight = true, .is_increment = true}},
      {"CIRC_REL", {.is_straight = true, .is_circle = true, .is_increment = true}},
      {"SCIRC_REL", {.is_straight = true, .is_circle = true, .is_increment = true}}};
  const auto found = all.find(word);
  return found == all.end() ? nullptr : &found->second;
}

constexpr std::array<std::string_view, 5> kOwnPlaces = {"$AXIS_ACT", "$POS_ACT", "$AXIS_ACT_MEAS", "$POS_ACT_MES",
                                                        "$AXIS_FOR"};

// One walk through all routines. Only the last one records motions and notes.
class MotionReader {
public:
  MotionReader(const Symbols& symbols, FrameValues& frames, const FlowSummary& previous, Notes* notes)
      : symbols_(symbols), frames_(frames), statements_(symbols, frames, previous, notes), notes_(notes) {
    result_.uses.resize(symbols.all().size());
  }

  void read(const ProgramText& text, std::size_t file, Routine& count) {
    Lines lines(text, file);
    for (std::string_view line; lines.next(line);) {
      place_ = lines.place();
      const RoutineLine bound = routine_line(line);
      if (bound.kind == RoutineLine::Kind::routine) {
        statements_.begin_routine(++count);
        // From where its first motion comes, the text does not say.
        if (is_recording() && !result_.motions.empty()) {
          result_.motions.push_back({.place = place_, .is_known = false, .symbol = {}, .inline_point = {}});
        }
      } else if (bound.kind == RoutineLine::Kind::end_of_routine && statements_.routine() > 0) {
        statements_.end_routine();
      } else if (statements_.routine() > 0) {
        statement(line);
      }
    }
  }

  const FlowSummary& summary() const { return statements_.summary(); }
  ReadMotions take_result() { return std::move(result_); }

private:
  bool is_recording() const { return notes_ != nullptr; }

  void note(Note note) {
    if (is_recording()) {
      notes_->add(note, place_.file, place_.line);
    }
  }

  void statement(std::string_view line);
  void motion(std::string_view word, const MotionWord& kind, std::string_view rest);
  void end(std::string_view word, std::string_view target, const FramesInForce& frames, ReadMotion motion);
  bool ends_inline(std::string_view word, std::string_view target, const FramesInForce& frames, ReadMotion& motion);
  bool ends_in_variable(std::string_view target, const FramesInForce& frames, ReadMotion& motion);
  void use(std::size_t index, const FramesInForce& frames);
  PointUse use_of(const FramesInForce& frames, const std::optional<FrameData>& own);
  FrameInForce chosen(const FrameInForce& in_force, std::optional<int> own, bool is_tool);

  const Symbols& symbols_;
  FrameValues& frames_;
  StatementReader statements_;
  Notes* notes_;
  ReadMotions result_;
  Place place_;
  std::unordered_map<std::size_t, std::optional<FramesInForce>> used_arrays_;  // by their first element
};

void MotionReader::statement(std::string_view line) {
  const std::string_view written = word_at(line);
  const std::string word = in_upper_case(written);
  if (const MotionWord* kind = motion_word(word)) {
    motion(written, *kind, rest_after(line, written.size()));
  } else if (!word.empty()) {
    statements_.read(word, line, place_);
  }
}

// XP1 C_DIS WITH $TOOL=...; {A1 0,...}; XP1,XP2,CA 360
void MotionReader::motion(std::string_view word, const MotionWord& kind, std::string_view rest) {
  if (!is_recording()) {
    return;
  }
  FramesInForce frames = statements_.now();
  if (const std::optional<std::size_t> begin = find_word(rest, "WITH")) {
    frames = statements_.with(frames, rest.substr(*begin + 4), place_);
    rest = stripped(rest.substr(0, *begin));
  }
  const std::vector<std::string_view> parts = list_parts(rest);
  const std::size_t count = kind.is_circle ? 2 : 1;
  if (parts.size() < count || parts[0].empty() || parts[count - 1].empty()) {
    fail(place_, "has " + shown(word) +
                     (kind.is_circle ? " without two points, expected both"
                                     : " without its end, "
                                       "expected a point"));
  }
  const bool has_angle = kind.is_circle && std::any_of(parts.begin() + 2, parts.end(), [](std::string_view part) {
                           return is_word(word_at(part), "CA");
                         });
  if (kind.is_increment) {
    note(Note::increment);
  }
  if (has_angle) {
    note(Note::circle_angle);
  }
  for (std::size_t i = 0; i < count; ++i) {
    ReadMotion motion{.place = place_,
                      .is_straight = kind.is_straight,
                      .is_curved = kind.is_circle || kind.is_spline,
                      .symbol = {},
                      .inline_point = {}};
    if (kind.is_increment) {
      motion.is_known = false;
      result_.motions.push_back(motion);
      continue;
    }
    motion.is_known = !has_angle || i == 0;
    end(word, parts[i], frames, motion);
  }
}

void MotionReader::end(std::string_view word, std::string_view target, const FramesInForce& frames, ReadMotion motion) {
  if (!(target.starts_with('{') ? ends_inline(word, target, frames, motion)
                                : ends_in_variable(target, frames, motion))) {
    motion.is_known = false;
  }
  result_.motions.push_back(motion);
}

bool MotionReader::ends_inline(std::string_view word, std::string_view target, const FramesInForce& frames,
                               ReadMotion& motion) {
  const std::optional<Aggregate> aggregate = aggregate_at(target, place_);
  const std::string name = std::string(word) + " {...}";
  std::optional<Position> position = position_in(*aggregate, place_, name, true);
  if (rest_after(target, aggregate->size).starts_with(':')) {
    note(Note::computed_place);
    return false;
  }
  const bool is_complete = position->is_complete();
  motion.inline_point = result_.inline_points.size();
  const PointUse in_frames = is_complete && !position->is_joints ? use_of(frames, std::nullopt)
                                                                 : PointUse{.tool = frames.tool, .base = frames.base};
  result_.inline_points.push_back({.name = fmt::format("{} in line {}", name, place_.line),
                                   .place = place_,
                                   .position = std::move(*position),
                                   .use = in_frames});
  return is_complete;
}

bool MotionReader::ends_in_variable(std::string_view target, const FramesInForce& frames, ReadMotion& motion) {
  const Reference reference = reference_at(target);
  if (reference.name.empty()) {
    fail(place_, "has " + shown(target) + " as the end of a motion, expected a point");
  }
  const std::string_view rest = rest_after(target, reference.size);
  if (rest.starts_with(':') || rest.starts_with('(')) {
    note(Note::computed_place);
    return false;
  }
  if (std::find(kOwnPlaces.begin(), kOwnPlaces.end(), reference.name) != kOwnPlaces.end()) {
    return false;
  }
  const std::optional<std::size_t> found = symbols_.find(reference, statements_.routine());
  if (found && symbols_.all()[*found].position) {
    use(*found, frames);
    motion.symbol = found;
    return !symbols_.all()[*found].is_changed;
  }
  const std::vector<std::size_t> elements = reference.index && reference.member.empty()
                                                ? symbols_.elements(reference, statements_.routine())
                                                : std::vector<std::size_t>();
  // A loop over an array uses it in few frames.
  if (!elements.empty() && used_arrays_[elements.front()] != frames) {
    used_arrays_[elements.front()] = frames;
    for (const std::size_t element : elements) {
      if (symbols_.all()[element].position) {
        use(element, frames);
      }
    }
  }
  const bool is_here =
      !elements.empty() || symbols_.is_declared(reference, statements_.routine()) || reference.name.starts_with('$');
  note(is_here ? Note::computed_place : Note::other_file);
  return false;
}

void MotionReader::use(std::size_t index, const FramesInForce& frames) {
  const Symbol& symbol = symbols_.all()[index];
  const bool is_pose = !symbol.position->is_joints && symbol.position->is_complete() && !symbol.is_changed;
  const PointUse now = is_pose ? use_of(frames, own_frame_data(symbols_, symbol, statements_.routine()))
                               : PointUse{.tool = frames.tool, .base = frames.base};
  std::optional<PointUse>& before = result_.uses[index];
  if (!before) {
    before = now;
    return;
  }
  before->is_in_cell = before->is_in_cell || now.is_in_cell;
  for (const auto frame : {&PointUse::tool, &PointUse::base}) {
    FrameInForce& first = (*before).*frame;
    const FrameInForce& other = now.*frame;
    const bool are_known = first.kind == Kind::known && other.kind == Kind::known;
    before->has_two_frames = before->has_two_frames || (are_known && first.key != other.key);
    first = first.kind == Kind::known ? other : first;  // one use in an unknown frame is enough
  }
}

PointUse MotionReader::use_of(const FramesInForce& frames, const std::optional<FrameData>& own) {
  const FrameData data = own.value_or(FrameData());
  const bool is_unsure = frames.place == ToolPlace::computed || frames.place == ToolPlace::unstated;
  return {.tool = chosen(frames.tool, data.tool, true),
          .base = chosen(frames.base, data.base, false),
          .is_in_cell = (is_unsure ? data.place : frames.place) == ToolPlace::in_cell};
}

// The frame in force, or that of the point's own FDAT where the text does not say it for certain.
FrameInForce MotionReader::chosen(const FrameInForce& in_force, std::optional<int> own, bool is_tool) {
  if ((in_force.kind == Kind::known && in_force.is_certain) || in_force.kind == Kind::moving) {
    return in_force;
  }
  const FrameInForce taught = own && *own >= 0 ? frames_.of_number(own, is_tool) : FrameInForce();
  if (taught.kind == Kind::known) {
    if (in_force.kind != Kind::known || in_force.key != taught.key) {
      note(Note::own_frame_data);
    }
    return taught;
  }
  if (in_force.kind == Kind::known) {
    note(Note::uncertain_frame);
  }
  return in_force;
}

}  // namespace

std::optional<FrameData> own_frame_data(const Symbols& symbols, const Symbol& symbol, Routine routine) {
  const std::string name = in_upper_case(symbol.name);
  if (!name.starts_with('X')) {
    return std::nullopt;
  }
  const std::optional<std::size_t> found =
      symbols.find({.name = "F" + name.substr(1), .index = {}, .member = {}}, routine);
  const bool is_known = found && symbols.all()[*found].frame_data && !symbols.all()[*found].is_changed;
  return is_known ? symbols.all()[*found].frame_data : std::nullopt;
}

ReadMotions read_motions(const std::vector<ProgramText>& texts, const Symbols& symbols, FrameValues& frames,
                         Notes& notes) {
  FlowSummary summary;
  const auto walk = [&](MotionReader& reader) {
    Routine count = 0;
    for (std::size_t file = 0; file < texts.size(); ++file) {
      reader.read(texts[file], file, count);
    }
  };
  // Loops, jumps and calls lead to other places of the text, where what they bring is known after a walk.
  constexpr int kMostWalks = 5;
  for (int i = 0; i < kMostWalks; ++i) {
    MotionReader reader(symbols, frames, summary, nullptr);
    walk(reader);
    FlowSummary next = reader.summary();
    const bool is_final = next == summary || (next.loop_ends.empty() && next.labels.empty() && next.entries.empty());
    summary = std::move(next);
    if (is_final) {
      break;
    }
  }
  MotionReader reader(symbols, frames, summary, &notes);
  walk(reader);
  return reader.take_result();
}

}  // namespace kdl_calibration::krl
