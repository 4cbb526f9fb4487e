#pragma once

// Values of $TOOL and $BASE in the KUKA Robot Language.

#include <cstddef>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "programs/krl_flow.hpp"
#include "programs/krl_symbols.hpp"
#include "programs/program.hpp"

namespace kdl_calibration::krl {

/// Evaluates frames, and collects those that a program states.
class FrameValues {
public:
  explicit FrameValues(const Symbols& symbols);

  /// TOOL_DATA[number] or BASE_DATA[number], which --frames states if the program does not; 0: the identity.
  FrameInForce of_number(std::optional<int> number, bool is_tool);
  /// The right side of "$TOOL=" or "$BASE=".
  FrameInForce of_value(std::string_view value, bool is_tool, Routine routine, const Place& place);
  /// The right side of "$IPO_MODE=".
  ToolPlace place_of(std::string_view value, Routine routine) const;

  const std::string& name(std::size_t key) const { return names_[key]; }
  const ProgramFrames& stated() const { return stated_; }
  /// Symbols that are used as frames.
  const std::vector<bool>& are_frames() const { return are_frames_; }

private:
  FrameInForce of_name(const std::string& name);
  FrameInForce of_position(const Position& position, bool is_tool);
  FrameInForce of_call(const std::string& function, std::string_view argument, bool is_tool, Routine routine);
  FrameInForce of_variable(const Reference& reference, bool is_tool, Routine routine);

  const Symbols& symbols_;
  std::vector<std::string> names_;
  std::unordered_map<std::string, std::size_t> keys_;
  ProgramFrames stated_;
  std::vector<bool> are_frames_;
};

/// Reads TOOL_DATA and BASE_DATA of a controller's $config.dat, without bases that an external kinematic system or a
/// conveyor moves. Throws InputError.
ProgramFrames frames_of_config(std::string_view text, const std::string& source);

}  // namespace kdl_calibration::krl
