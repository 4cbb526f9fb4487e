#include "programs/krl_program.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <numbers>
#include <utility>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "programs/krl_frames.hpp"
#include "programs/krl_motions.hpp"
#include "programs/krl_notes.hpp"
#include "programs/krl_symbols.hpp"

namespace kdl_calibration {
namespace {

using krl::FrameInForce;
using krl::Note;
using krl::PointUse;
using krl::Position;
using Kind = krl::FrameInForce::Kind;

// A position of the texts, and what is known of its frames.
struct Candidate {
  const std::string* name = nullptr;
  krl::Place place;
  const Position* position = nullptr;
  std::optional<PointUse> use;  // none: no motion here ends in it
  bool is_changed = false;
  bool is_inline = false;
  std::size_t source = 0;  // index of the symbol, or of the inline point
};

// Why a point stays as it is; none where it is compensated.
std::optional<Note> left_because(const Candidate& candidate) {
  const Position& position = *candidate.position;
  if (candidate.is_changed) {
    return Note::changed;
  }
  if (position.is_computed) {
    return Note::computed_component;
  }
  if (!position.is_complete()) {
    return Note::partial;
  }
  if (position.is_joints) {
    return std::nullopt;
  }
  if (!candidate.use) {
    return Note::unused;
  }
  const PointUse& use = *candidate.use;
  if (use.is_in_cell) {
    return Note::in_cell;
  }
  const auto is_unknown = [](const FrameInForce& frame) {
    return frame.kind == Kind::computed || frame.kind == Kind::moving;
  };
  if (is_unknown(use.tool) || is_unknown(use.base)) {
    return Note::run_time_frame;
  }
  return use.has_two_frames ? std::optional(Note::two_frames) : std::nullopt;
}

// Frames of a point that nothing here moves to: those in which it was taught.
std::optional<PointUse> taught_use(const krl::Symbols& symbols, const krl::Symbol& symbol, krl::FrameValues& frames) {
  const std::optional<krl::FrameData> data = own_frame_data(symbols, symbol, 0);
  if (!data) {
    return std::nullopt;
  }
  return PointUse{.tool = frames.of_number(data->tool, true),
                  .base = frames.of_number(data->base, false),
                  .is_in_cell = data->place == krl::ToolPlace::in_cell};
}

// In the order of the texts.
std::vector<Candidate> candidates_of(const krl::Symbols& symbols, const krl::ReadMotions& read,
                                     krl::FrameValues& frames) {
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < symbols.all().size(); ++i) {
    const krl::Symbol& symbol = symbols.all()[i];
    if (!symbol.position || (symbol.is_frame && !read.uses[i])) {
      continue;  // FRAME states frames and offsets as well
    }
    candidates.push_back({.name = &symbol.name,
                          .place = symbol.place,
                          .position = &*symbol.position,
                          .use = read.uses[i] ? read.uses[i] : taught_use(symbols, symbol, frames),
                          .is_changed = symbol.is_changed || frames.are_frames()[i],
                          .source = i});
  }
  for (std::size_t i = 0; i < read.inline_points.size(); ++i) {
    const krl::InlinePoint& point = read.inline_points[i];
    candidates.push_back({.name = &point.name,
                          .place = point.place,
                          .position = &point.position,
                          .use = point.use,
                          .is_inline = true,
                          .source = i});
  }
  const auto begin = [](const Candidate& candidate) {
    const std::vector<NumberField>& fields = candidate.position->fields;
    return std::tuple(candidate.place.file, candidate.place.line, fields.empty() ? 0 : fields.front().begin);
  };
  std::stable_sort(candidates.begin(), candidates.end(),
                   [&](const Candidate& a, const Candidate& b) { return begin(a) < begin(b); });
  return candidates;
}

std::optional<std::string> key_of(const FrameInForce& frame, const krl::FrameValues& frames) {
  return frame.kind == Kind::known ? std::optional(frames.name(frame.key)) : std::nullopt;
}

ProgramPoint point_of(const Candidate& candidate, const krl::FrameValues& frames) {
  const Position& position = *candidate.position;
  ProgramPoint point;
  point.name = *candidate.name;
  point.file = candidate.place.file;
  point.line = candidate.place.line;
  point.notation = position.is_joints ? PointNotation::joints : PointNotation::moving_zyx;
  point.fields = position.fields;
  point.external = position.external;
  if (candidate.use) {
    point.tool_frame = key_of(candidate.use->tool, frames);
    point.user_frame = key_of(candidate.use->base, frames);
  }
  if (!position.is_joints) {
    point.branch = branch_of(position);
    if (position.turn) {
      point.turn_fields.push_back(*position.turn);
    }
  }
  return point;
}

Program parse(const std::vector<ProgramText>& texts) {
  const krl::Symbols symbols(texts);
  krl::FrameValues frames(symbols);
  krl::Notes notes;
  const krl::ReadMotions read = read_motions(texts, symbols, frames, notes);
  Program program;
  std::vector<std::optional<std::size_t>> of_symbol(symbols.all().size());
  std::vector<std::optional<std::size_t>> of_inline(read.inline_points.size());
  for (const Candidate& candidate : candidates_of(symbols, read, frames)) {
    if (const std::optional<Note> reason = left_because(candidate)) {
      notes.add(*reason, candidate.place.file, candidate.place.line);
      continue;
    }
    (candidate.is_inline ? of_inline : of_symbol)[candidate.source] = program.points.size();
    program.points.push_back(point_of(candidate, frames));
    if (is_of_accurate_robot(*candidate.position)) {
      notes.add(Note::accurate_robot, candidate.place.file, candidate.place.line);
    }
  }
  for (const krl::ReadMotion& motion : read.motions) {
    const std::optional<std::size_t> point = motion.symbol         ? of_symbol[*motion.symbol]
                                             : motion.inline_point ? of_inline[*motion.inline_point]
                                                                   : std::nullopt;
    program.motions.push_back({.file = motion.place.file,
                               .line = motion.place.line,
                               .is_straight = motion.is_straight,
                               .is_curved = motion.is_curved,
                               .point = point,
                               .is_known = motion.is_known && point.has_value()});
  }
  program.remarks = notes.remarks();
  program.frames = frames.stated();
  return program;
}

// "DEF NAME (A :IN )" or "DEFDAT NAME PUBLIC". Python and URScript have "def name(a):".
bool is_written_in(std::string_view text) {
  const ProgramText program{.source = {}, .text = std::string(text)};
  krl::Lines lines(program);
  std::string_view line;
  if (!lines.next(line)) {
    return false;
  }
  using LineKind = krl::RoutineLine::Kind;
  const LineKind kind = krl::routine_line(line).kind;
  if (kind != LineKind::routine) {
    return kind == LineKind::data;
  }
  const std::size_t opening = std::min(line.find('('), line.size());
  const std::optional<std::size_t> closing =
      opening < line.size() ? krl::closing_bracket(line, opening) : std::optional(line.size() - 1);
  return closing && line.substr(*closing + 1).find(':') == std::string_view::npos;
}

std::vector<int> turns(const SixJoints& joint_values) { return {krl::turn_of(joint_values)}; }

// T may stand in binary or hexadecimal digits: 'B110010'
std::string write(std::string_view old, double value, int decimals) {
  if (!old.starts_with('\'') || old.size() < 4) {
    return fixed(value, decimals);
  }
  const int base = old[1] == 'B' || old[1] == 'b' ? 2 : 16;
  const auto whole = static_cast<unsigned>(value);
  if (krl::whole_number_in(old) == static_cast<int>(whole)) {
    return std::string(old);
  }
  const std::size_t width = old.size() - 3;
  return fmt::format("'{}{}'", old[1],
                     base == 2 ? fmt::format("{:0{}b}", whole, width) : fmt::format("{:0{}X}", whole, width));
}

// HALT waits until the operator starts the program again.
std::string drive(const std::string& name, const std::vector<MeasuringStop>& stops) {
  std::string text =
      "&ACCESS RVP\nDEF " + name + "( )\nEXT BAS (BAS_COMMAND :IN,REAL :IN )\nBAS (#INITMOV,0 )\nBAS (#VEL_PTP,10 )\n";
  for (const MeasuringStop& stop : stops) {
    text += "; configuration " + stop.label + "\nPTP {";
    for (std::size_t i = 0; i < stop.joint_values.size(); ++i) {
      text += fmt::format("{}A{} {}", i == 0 ? "" : ",", i + 1, fixed(stop.joint_values[i], 4));
    }
    text += "}\nHALT\n";
  }
  return text + "END\n";
}

}  // namespace

const ProgramLanguage& kuka_krl() {
  constexpr double kQuarter = std::numbers::pi / 2.0;
  static const ProgramLanguage language{
      .name = "KUKA KRL",
      .files = ".src, .dat",
      .is_written_in = is_written_in,
      .parse = parse,
      .read_frames = krl::frames_of_config,
      .companion = ".dat",
      .joint_names = {"A1", "A2", "A3", "A4", "A5", "A6"},
      .length_unit = 1e-3,
      .angle_unit = kDegree,
      .reference = {0.0, -kQuarter, kQuarter, 0.0, 0.0, 0.0},
      .user_frame = "$BASE",
      .tool_frame = "$TOOL",
      .turns = turns,
      .write = write,
      .drive = drive,
  };
  return language;
}

}  // namespace kdl_calibration
