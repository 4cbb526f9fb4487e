#include "programs/krl_frames.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <map>
#include <set>

#include "base/number_text.hpp"
#include "base/text.hpp"

namespace kdl_calibration::krl {
namespace {

using Kind = FrameInForce::Kind;

constexpr std::string_view kZeroFrame = "0";

// The value without what follows it in a motion: C_DIS.
bool ends_value(std::string_view rest) { return rest.empty() || in_upper_case(rest).starts_with("C_"); }

std::string_view argument_in(std::string_view call) {
  const std::optional<std::size_t> end = closing_bracket(call);
  return end ? stripped(call.substr(1, *end - 1)) : std::string_view();
}

// {X 1,Y 2,Z 3,A 4,B 5,C 6}
std::string name_of(const Position& frame) {
  std::string name = "{";
  for (std::size_t i = 0; i < frame.fields.size(); ++i) {
    name += fmt::format("{}{} {}", i == 0 ? "" : ",", "XYZABC"[i], shortest(frame.fields[i].value));
  }
  return name + "}";
}

bool is_zero(const Position& frame) {
  return std::all_of(frame.fields.begin(), frame.fields.end(),
                     [](const NumberField& field) { return field.value == 0.0; });
}

}  // namespace

FrameValues::FrameValues(const Symbols& symbols) : symbols_(symbols), are_frames_(symbols.all().size()) {
  stated_.user.emplace(kZeroFrame, Eigen::Isometry3d::Identity());
  stated_.tool = stated_.user;
}

FrameInForce FrameValues::of_name(const std::string& name) {
  const auto [entry, is_new] = keys_.emplace(name, names_.size());
  if (is_new) {
    names_.push_back(name);
  }
  return {.kind = Kind::known, .key = entry->second};
}

FrameInForce FrameValues::of_position(const Position& position, bool is_tool) {
  if (!position.is_complete() || position.is_joints) {
    return {.kind = Kind::computed};
  }
  if (is_zero(position)) {
    return of_name(std::string(kZeroFrame));
  }
  const std::string name = name_of(position);
  (is_tool ? stated_.tool : stated_.user).emplace(name, frame_of(position));
  return of_name(name);
}

FrameInForce FrameValues::of_number(std::optional<int> number, bool is_tool) {
  if (!number || *number < 0) {
    return {.kind = Kind::computed};
  }
  const std::string name = std::to_string(*number);
  const Reference data{.name = is_tool ? "TOOL_DATA" : "BASE_DATA", .index = name, .member = {}};
  if (const std::optional<std::size_t> stated = symbols_.find(data, 0)) {
    const Symbol& symbol = symbols_.all()[*stated];
    if (symbol.is_changed || !symbol.position || !symbol.position->is_complete() || symbol.position->is_joints) {
      return {.kind = Kind::computed};
    }
    (is_tool ? stated_.tool : stated_.user).emplace(name, frame_of(*symbol.position));
  }
  return of_name(name);
}

FrameInForce FrameValues::of_value(std::string_view value, bool is_tool, Routine routine, const Place& place) {
  if (const std::optional<Aggregate> aggregate = aggregate_at(value, place)) {
    const std::optional<Position> position = position_in(*aggregate, place, is_tool ? "$TOOL" : "$BASE", true);
    return ends_value(rest_after(value, aggregate->size)) ? of_position(*position, is_tool)
                                                          : FrameInForce{.kind = Kind::computed};
  }
  const Reference reference = reference_at(value);
  const std::string_view rest = rest_after(value, reference.size);
  if (rest.starts_with('(')) {
    const std::optional<std::size_t> end = closing_bracket(rest);
    const FrameInForce result = of_call(reference.name, argument_in(rest), is_tool, routine);
    return result.kind == Kind::moving || (end && ends_value(rest_after(rest, *end + 1)))
               ? result
               : FrameInForce{.kind = Kind::computed};
  }
  return ends_value(rest) ? of_variable(reference, is_tool, routine) : FrameInForce{.kind = Kind::computed};
}

// The functions of the spline motions, and those that couple a base.
FrameInForce FrameValues::of_call(const std::string& function, std::string_view argument, bool is_tool,
                                  Routine routine) {
  static const std::set<std::string, std::less<>> moving = {"EK", "EB", "EB_ABS", "LK"};
  if (moving.contains(function)) {
    return {.kind = Kind::moving};
  }
  if (function == (is_tool ? "STOOL" : "SBASE")) {
    return of_number(symbols_.whole(argument, routine), is_tool);
  }
  if (is_tool && function == "STOOL2") {
    return of_number(symbols_.whole(std::string(argument) + ".TOOL_NO", routine), true);
  }
  return {.kind = Kind::computed};
}

FrameInForce FrameValues::of_variable(const Reference& reference, bool is_tool, Routine routine) {
  if (reference.name == "$NULLFRAME" || (!is_tool && reference.name == "$WORLD")) {
    return of_name(std::string(kZeroFrame));
  }
  if (reference.name == (is_tool ? "TOOL_DATA" : "BASE_DATA") && reference.index && reference.member.empty()) {
    return of_number(symbols_.whole(*reference.index, routine), is_tool);
  }
  const std::optional<std::size_t> found = symbols_.find(reference, routine);
  if (!found || !symbols_.all()[*found].position || symbols_.all()[*found].is_changed) {
    return {.kind = Kind::computed};
  }
  are_frames_[*found] = true;
  return of_position(*symbols_.all()[*found].position, is_tool);
}

ToolPlace FrameValues::place_of(std::string_view value, Routine routine) const {
  if (value.starts_with('#')) {
    return tool_place_of(value.substr(0, 1 + word_at(value.substr(1)).size()));
  }
  const Reference function = reference_at(value);
  if (function.name != "SIPO_MODE") {
    return ToolPlace::computed;
  }
  const std::string_view call = rest_after(value, function.size);
  Reference data = reference_at(call.starts_with('(') ? argument_in(call) : std::string_view());
  data.member = {};
  const std::optional<std::size_t> found = symbols_.find(data, routine);
  const bool is_known = found && symbols_.all()[*found].frame_data && !symbols_.all()[*found].is_changed;
  return is_known ? symbols_.all()[*found].frame_data->place : ToolPlace::computed;
}

namespace {

// What $config.dat says of frames and of the systems that move bases.
struct ConfigReader {
  ProgramFrames frames;
  std::map<int, int> systems;  // of bases
  std::set<int> moving;        // systems that are no robot
  bool is_found = false;

  void add_frame(const Reference& left, std::string_view line, std::string_view value, int number, const Place& place) {
    const bool is_tool = left.name == "TOOL_DATA" || left.name == "$TOOL_DATA";
    const std::optional<Aggregate> aggregate = aggregate_at(value, place);
    const std::string name = printable(line.substr(0, left.size));
    const std::optional<Position> position = aggregate ? position_in(*aggregate, place, name, true) : std::nullopt;
    if (!position || position->is_joints || !position->is_complete()) {
      fail(place, name + " is " + shown(value) + ", expected {X ..,Y ..,Z ..,A ..,B ..,C ..}");
    }
    (is_tool ? frames.tool : frames.user)[std::to_string(number)] = frame_of(*position);
    is_found = true;
  }

  void add_system(std::string_view value, int number, const Place& place) {
    const std::optional<Aggregate> aggregate = aggregate_at(value, place);
    for (const Member& member : aggregate ? aggregate->members : std::vector<Member>()) {
      if (is_word(member.name, "MACH_DEF_INDEX")) {
        systems[number] = whole_number_in(member.value).value_or(0);
      } else if (is_word(member.name, "MECH_TYPE") && !is_word(member.value, "#ROBOT") &&
                 !is_word(member.value, "#NONE")) {
        moving.insert(number);
      }
    }
  }
};

}  // namespace

ProgramFrames frames_of_config(std::string_view text, const std::string& source) {
  static const std::set<std::string, std::less<>> of_frames = {"TOOL_DATA", "$TOOL_DATA", "BASE_DATA", "$BASE_DATA"};
  const ProgramText config{.source = source, .text = std::string(text)};
  ConfigReader reader;
  Lines lines(config);
  for (std::string_view line; lines.next(line);) {
    const Reference left = reference_at(line);
    const std::optional<std::string_view> value = assigned_value(line, left);
    const std::optional<int> number = left.index && left.member.empty() ? whole_number_in(*left.index) : std::nullopt;
    if (!value || !number) {
      continue;
    }
    if (of_frames.contains(left.name)) {
      reader.add_frame(left, line, *value, *number, lines.place());
    } else if (left.name == "MACHINE_FRAME_DAT" || left.name == "MACHINE_DEF") {
      reader.add_system(*value, *number, lines.place());
    }
  }
  if (!reader.is_found) {
    fail(lines.place(), "holds no TOOL_DATA and no BASE_DATA, expected $config.dat of a controller");
  }
  for (const auto& [base, system] : reader.systems) {
    if (reader.moving.contains(system)) {
      reader.frames.user.erase(std::to_string(base));
      reader.frames.moving_user.insert(std::to_string(base));
    }
  }
  return reader.frames;
}

}  // namespace kdl_calibration::krl
