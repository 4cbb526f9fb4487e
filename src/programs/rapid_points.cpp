#include "programs/rapid_points.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/rapid_assignments.hpp"
#include "programs/rapid_modules.hpp"
#include "programs/rapid_remarks.hpp"
#include "programs/rapid_use.hpp"

namespace kdl_calibration::rapid {
namespace {

// Puts together what the modules say.
class ProgramBuilder {
public:
  explicit ProgramBuilder(const std::vector<ProgramText>& texts)
      : texts_(texts), modules_(run_time_instructions()), uses_(), joint_check_("confj", {}), line_check_("confl", {}) {
    for (std::size_t file = 0; file < texts.size(); ++file) {
      modules_.read(texts[file], file);
    }
    joint_check_ = BranchCheck("confj", modules_.instructions);
    line_check_ = BranchCheck("confl", modules_.instructions);
    uses_.resize(modules_.places.size());
  }

  Program program() {
    is_assigned_ = mark_assigned(texts_, modules_, remarks_);
    add_frames();
    for (const Instruction& instruction : modules_.instructions) {
      read(instruction);
    }
    for (const auto& [datum, use] : array_uses_) {
      for (const std::size_t place : datum->items) {
        uses_[place].add(use);
      }
    }
    add_points();
    program_.remarks = remarks_.all();
    return std::move(program_);
  }

private:
  [[noreturn]] void fail(const Instruction& at, const std::string& what) const {
    throw InputError(fmt::format("{}:{}: {}", texts_[at.file].source, at.line, what));
  }

  void add_frames();
  std::optional<std::size_t> frame(const Instruction& at, const Value& value, Type type);
  std::size_t frame_outside(const std::string& key, bool is_tool);

  void read(const Instruction& instruction);
  void motion(const Instruction& at, const MotionKind& kind);
  Use use_of(const Instruction& at, const MotionKind& kind, const Value& tool);
  std::optional<std::size_t> target(const Instruction& at, const Argument& argument, const MotionKind& kind,
                                    const Use& use);
  std::optional<std::size_t> named_target(const Instruction& at, const Value& value, const MotionKind& kind,
                                          const Use& use);
  std::optional<std::size_t> element(const Instruction& at, const Datum& datum, const Value& value, const Use& use);

  void complete(Place& place);
  std::optional<Left> left(std::size_t index) const;
  bool states_branch(const Place& place, const Use& use) const;
  static ArmBranch branch(const Configuration& configuration);
  void add_points();

  const std::vector<ProgramText>& texts_;
  Modules modules_;
  Program program_;
  Remarks remarks_;
  std::vector<Use> uses_;                   // of each place
  std::vector<bool> is_assigned_;           // each place, at run time
  std::map<const Datum*, Use> array_uses_;  // of elements whose index is computed
  bool has_one_configuration_ = true;       // all robtargets whose motions do not check it
  std::vector<std::size_t> same_frame_;     // of each frame the first one with the same pose
  std::map<std::pair<bool, std::string>, std::size_t> frames_outside_;
  BranchCheck joint_check_;
  BranchCheck line_check_;
};

// ---- Data ----------------------------------------------------------------------------------------------------------

// Tools that differ in nothing but their load are the same to a place.
void ProgramBuilder::add_frames() {
  std::map<std::pair<bool, std::array<double, 12>>, std::size_t> by_pose;
  for (std::size_t i = 0; i < modules_.frames.size(); ++i) {
    const Frame& frame = modules_.frames[i];
    same_frame_.push_back(i);
    if (frame.stands_still || frame.is_moved || !frame.pose) {
      continue;
    }
    (frame.is_tool ? program_.frames.tool : program_.frames.user)[frame.key] = *frame.pose;
    if (frame.is_assigned) {
      continue;
    }
    std::array<double, 12> numbers{};
    Eigen::Map<Eigen::Matrix<double, 3, 4>>(numbers.data()) = frame.pose->matrix().topRows<3>();
    same_frame_.back() = by_pose.try_emplace({frame.is_tool, numbers}, i).first->second;
  }
}

// A tool or work object that the text does not state.
std::size_t ProgramBuilder::frame_outside(const std::string& key, bool is_tool) {
  const auto [found, is_new] = frames_outside_.try_emplace({is_tool, key}, modules_.frames.size());
  if (is_new) {
    same_frame_.push_back(modules_.frames.size());
    modules_.frames.push_back({.key = key, .pose = std::nullopt, .is_tool = is_tool});
  }
  return found->second;
}

// None where it is known at run time only.
std::optional<std::size_t> ProgramBuilder::frame(const Instruction& at, const Value& value, Type type) {
  const bool is_tool = type == Type::tooldata;
  const bool is_element = value.kind == ValueKind::element;
  if (value.kind != ValueKind::name && !(is_element && !value.index.empty())) {
    return std::nullopt;
  }
  const Datum* datum = modules_.find(at.scope, value.name);
  const std::string key = value.name + (is_element ? "{" + value.index + "}" : "");
  if (datum == nullptr) {
    return frame_outside(key, is_tool);
  }
  if (datum->type != type) {
    fail(at, fmt::format("{} is no {}, expected one", shown(value.text), is_tool ? "tooldata" : "wobjdata"));
  }
  if (datum->is_parameter) {
    return std::nullopt;
  }
  const std::optional<std::size_t> found = datum->item(value.index);
  return found ? same_frame_[*found] : frame_outside(key, is_tool);
}

// Values of the named data that stand for a part of the place.
void ProgramBuilder::complete(Place& place) {
  if (!place.confdata.empty()) {
    const Datum* datum = modules_.find(place.scope, place.confdata);
    place.configuration = datum != nullptr && !datum->is_assigned ? datum->configuration : std::nullopt;
    place.is_computed = place.is_computed || !place.configuration;
  }
  if (!place.extjoint.empty()) {
    const Datum* datum = modules_.find(place.scope, place.extjoint);
    const bool is_known = datum != nullptr && !datum->is_assigned && datum->external;
    place.is_computed = place.is_computed || !is_known;
    place.point.external = is_known ? *datum->external : std::vector<ExternalValue>();
  }
}

// ---- Motions -------------------------------------------------------------------------------------------------------

void ProgramBuilder::read(const Instruction& instruction) {
  if (modules_.has_routine(instruction.name)) {
    return;  // a routine of the program under this name
  }
  if (const std::optional<MotionKind> kind = motion_kind(instruction.name)) {
    motion(instruction, *kind);
    return;
  }
  const bool is_off = joint_check_.read(instruction);
  if (line_check_.read(instruction) || is_off) {
    remarks_.add(fmt::format("{} \\Off lets the controller choose joint values next to where the arm is: confdata that "
                             "is zero, or the same for all robtargets, is not used",
                             is_off ? "ConfJ" : "ConfL"),
                 instruction.file, instruction.line);
  }
  remarks_.add_instruction(instruction.name, instruction.file, instruction.line);
}

void ProgramBuilder::motion(const Instruction& at, const MotionKind& kind) {
  std::vector<const Argument*> arguments;  // without options
  bool is_known = !kind.stops_on_signal && !remarks_.add_instruction(at.name, at.file, at.line);
  for (const Argument& argument : at.arguments) {
    if (argument.option.empty()) {
      arguments.push_back(&argument);
    } else if (remarks_.add_option(argument.option, at.file, at.line)) {
      is_known = false;
    }
  }
  const std::size_t least = kind.before + kind.targets + kind.behind + (kind.moves_arm ? 2 : 1);
  if (arguments.size() < least) {
    fail(at, fmt::format("{} has {} arguments, expected {} or more: {}", shown(at.spelling), arguments.size(), least,
                         kind.moves_arm ? "targets, speed and tool" : "a target and a speed"));
  }
  if (kind.stops_on_signal && kind.moves_arm) {
    remarks_.add("a search stops where its signal comes: its end is compensated, not the place that it finds", at.file,
                 at.line);
  }
  const Use use = use_of(at, kind, arguments[arguments.size() - 1 - kind.behind]->value);
  for (std::size_t i = kind.before; i < kind.before + kind.targets; ++i) {
    const std::optional<std::size_t> place = target(at, *arguments[i], kind, use);
    if (kind.moves_arm) {
      program_.motions.push_back({.file = at.file,
                                  .line = at.line,
                                  .is_straight = kind.is_straight,
                                  .is_curved = kind.targets == 2,
                                  .point = place,  // its place until add_points
                                  .is_known = is_known && place});
    }
  }
}

Use ProgramBuilder::use_of(const Instruction& at, const MotionKind& kind, const Value& tool) {
  Use use{.moves_arm = kind.moves_arm,
          .moves_external = !kind.moves_arm,
          .checks_branch = kind.is_straight ? line_check_.is_on() : joint_check_.is_on()};
  if (!kind.moves_arm) {
    return use;
  }
  Value object{.kind = ValueKind::name, .name = "wobj0", .text = "wobj0"};
  for (const Argument& argument : at.arguments) {
    object = argument.option == "wobj" ? argument.value : object;
  }
  use.tool = frame(at, tool, Type::tooldata);
  use.object = frame(at, object, Type::wobjdata);
  use.has_unknown = !use.tool || !use.object;
  return use;
}

// The place at which the motion ends; none where that is known at run time only.
std::optional<std::size_t> ProgramBuilder::target(const Instruction& at, const Argument& argument,
                                                  const MotionKind& kind, const Use& use) {
  const Value* value = &argument.value;
  if (argument.place) {
    uses_[*argument.place].add(use);
    return argument.place;
  }
  bool is_moved = false;
  while (value->kind == ValueKind::call && !value->members.empty() &&
         remarks_.add_offset(value->name, at.file, at.line)) {
    value = &value->members.front();
    is_moved = true;
  }
  if (value->kind == ValueKind::name || value->kind == ValueKind::element) {
    const std::optional<std::size_t> place = named_target(at, *value, kind, use);
    return is_moved ? std::nullopt : place;
  }
  remarks_.add_unknown(value->kind == ValueKind::call ? "the result of a function" : "a computed target", at.file,
                       at.line);
  return std::nullopt;
}

std::optional<std::size_t> ProgramBuilder::named_target(const Instruction& at, const Value& value,
                                                        const MotionKind& kind, const Use& use) {
  const Datum* datum = modules_.find(at.scope, value.name);
  if (datum == nullptr) {
    remarks_.add_unknown("a target that the text does not declare", at.file, at.line);
    return std::nullopt;
  }
  const Type type = kind.has_joints ? Type::jointtarget : Type::robtarget;
  if (datum->type != type) {
    fail(at, fmt::format("{} moves to {}, expected a {}", shown(at.spelling), shown(value.text),
                         kind.has_joints ? "jointtarget" : "robtarget"));
  }
  if (datum->is_parameter) {
    remarks_.add_unknown("a parameter of a routine", at.file, at.line);
    return std::nullopt;
  }
  if (datum->is_assigned || datum->items.empty()) {
    remarks_.add_unknown("a target that is set at run time", at.file, at.line);
    return std::nullopt;
  }
  return element(at, *datum, value, use);
}

std::optional<std::size_t> ProgramBuilder::element(const Instruction& at, const Datum& datum, const Value& value,
                                                   const Use& use) {
  if (const std::optional<std::size_t> place = datum.item(value.index)) {
    uses_[*place].add(use);
    return place;
  }
  if (value.kind == ValueKind::name || !value.index.empty()) {
    fail(at, fmt::format("{} is no element of {}, expected one of its {}", shown(value.text), datum.name,
                         datum.items.size()));
  }
  array_uses_[&datum].add(use);
  return std::nullopt;
}

// ---- Points --------------------------------------------------------------------------------------------------------

std::optional<Left> ProgramBuilder::left(std::size_t index) const {
  const Place& place = modules_.places[index];
  const Use& use = uses_[index];
  if (is_assigned_[index]) {
    return Left::assigned;
  }
  if (place.point.notation == PointNotation::joints && use.moves_external && !use.moves_arm) {
    return Left::external;
  }
  if (place.is_computed) {
    return Left::computed;
  }
  if (!place.is_taught) {
    return Left::untaught;
  }
  if (place.point.notation == PointNotation::joints) {
    return std::nullopt;
  }
  if (!use.moves_arm) {
    return Left::unused;
  }
  if (use.has_several) {
    return Left::several_frames;
  }
  if (use.has_unknown) {
    return Left::unknown_frame;
  }
  const Frame& tool = modules_.frames[*use.tool];
  const Frame& object = modules_.frames[*use.object];
  if (tool.stands_still || object.stands_still) {
    return Left::stationary;
  }
  if (object.is_moved) {
    return Left::moved;
  }
  return place.has_orientation ? std::nullopt : std::optional(Left::no_orientation);
}

// Without the check the controller ignores confdata. Offline systems then write zeros, or the same for all targets.
bool ProgramBuilder::states_branch(const Place& place, const Use& use) const {
  constexpr Configuration kZeros{};
  return use.checks_branch || (*place.configuration != kZeros && !has_one_configuration_);
}

// The quadrants tell both solutions of the shoulder and of the wrist apart, which are half a turn of axis 1, or of axes
// 4 and 6, from each other. An IRB 1400, 2400, 3400, 4400 or 6400 has no cfx and writes 0 whatever they are: a 0 says
// no more than that the elbow is as usual. An IRB 5400 writes the quadrant of axis 5, which may be negative.
ArmBranch ProgramBuilder::branch(const Configuration& configuration) {
  constexpr int kMost = 7;
  constexpr unsigned kNegativeWrist = 1;
  constexpr unsigned kBehindLowerArm = 2;
  constexpr unsigned kBehindAxis1 = 4;
  ArmBranch result;
  for (std::size_t i = 0; i < kTurning.size(); ++i) {
    result.turns[kTurning[i]] =
        JointInterval{.lower = kQuadrant * configuration[i], .upper = kQuadrant * (configuration[i] + 1)};
  }
  const int cfx = configuration.back();
  if (cfx == 0) {
    result.elbow_up = true;
  } else if (cfx > 0 && cfx <= kMost) {
    const auto bits = static_cast<unsigned>(cfx);
    result.front = (bits & kBehindAxis1) == 0;
    result.elbow_up = (bits & kBehindLowerArm) == 0;
    result.wrist_positive = (bits & kNegativeWrist) == 0;
  }
  return result;
}

void ProgramBuilder::add_points() {
  const Configuration* first = nullptr;
  for (std::size_t i = 0; i < modules_.places.size(); ++i) {
    Place& place = modules_.places[i];
    complete(place);
    if (place.configuration && uses_[i].moves_arm && !uses_[i].checks_branch) {
      first = first == nullptr ? &*place.configuration : first;
      has_one_configuration_ = has_one_configuration_ && *place.configuration == *first;
    }
  }
  std::vector<std::optional<std::size_t>> points(modules_.places.size());
  for (std::size_t i = 0; i < modules_.places.size(); ++i) {
    Place& place = modules_.places[i];
    const Use& use = uses_[i];
    if (const std::optional<Left> because = left(i)) {
      remarks_.add(*because, place.point.file, place.point.line);
      continue;
    }
    points[i] = program_.points.size();
    ProgramPoint& point = program_.points.emplace_back(std::move(place.point));
    if (point.notation != PointNotation::joints) {
      point.tool_frame = modules_.frames[*use.tool].key;
      point.user_frame = modules_.frames[*use.object].key;
      point.branch = states_branch(place, use) ? std::optional(branch(*place.configuration)) : std::nullopt;
    } else if (use.tool && !use.has_several && !use.has_unknown &&
               program_.frames.tool.contains(modules_.frames[*use.tool].key)) {
      point.tool_frame = modules_.frames[*use.tool].key;
    }
  }
  for (ProgramMotion& motion : program_.motions) {
    motion.point = motion.point ? points[*motion.point] : std::nullopt;
    motion.is_known = motion.is_known && motion.point;
  }
}

}  // namespace

Program program_of(const std::vector<ProgramText>& texts) { return ProgramBuilder(texts).program(); }

}  // namespace kdl_calibration::rapid
