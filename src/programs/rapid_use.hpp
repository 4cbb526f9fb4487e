#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string_view>
#include <vector>

#include "programs/rapid_modules.hpp"

namespace kdl_calibration::rapid {

/// What the motions to a place say of it.
struct Use {
  std::optional<std::size_t> tool;    // index of a frame
  std::optional<std::size_t> object;  // work object
  bool has_several = false;
  bool has_unknown = false;  // a tool or work object that is known at run time only
  bool moves_arm = false;
  bool moves_external = false;  // external axes only
  bool checks_branch = false;   // ConfL \On or ConfJ \On

  void add(const Use& other) {
    const auto differ = [](const auto& a, const auto& b) { return a && b && *a != *b; };
    has_several = has_several || other.has_several || differ(tool, other.tool) || differ(object, other.object);
    tool = tool ? tool : other.tool;
    object = object ? object : other.object;
    has_unknown = has_unknown || other.has_unknown;
    moves_arm = moves_arm || other.moves_arm;
    moves_external = moves_external || other.moves_external;
    checks_branch = checks_branch || other.checks_branch;
  }
};

/// ConfJ or ConfL, in the order of the text. A program that only turns the check off does so before its motions.
class BranchCheck {
public:
  BranchCheck(std::string_view name, const std::vector<Instruction>& instructions) : name_(name) {
    bool is_turned_off = false;
    bool is_turned_on = false;
    for (const Instruction& each : instructions) {
      is_turned_off = is_turned_off || turns(each, "off");
      is_turned_on = is_turned_on || turns(each, "on");
    }
    is_on_ = is_turned_on || !is_turned_off;
  }

  /// True if the instruction turns the check off.
  bool read(const Instruction& instruction) {
    is_on_ = (is_on_ && !turns(instruction, "off")) || turns(instruction, "on");
    return turns(instruction, "off");
  }
  bool is_on() const { return is_on_; }

private:
  bool turns(const Instruction& instruction, std::string_view option) const {
    return instruction.name == name_ && std::any_of(instruction.arguments.begin(), instruction.arguments.end(),
                                                    [&](const Argument& each) { return each.option == option; });
  }

  std::string_view name_;
  bool is_on_ = true;
};

}  // namespace kdl_calibration::rapid
