#include "programs/rapid_program.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>

#include "base/degree.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/number_fields.hpp"
#include "programs/rapid_modules.hpp"
#include "programs/rapid_points.hpp"

namespace kdl_calibration {
namespace rapid {
namespace {

bool is_module(std::string_view text) {
  try {
    Words words(text, "");
    if (!words.is_word("module")) {
      return false;
    }
    words.take();
    return words.peek().kind == TokenKind::word;
  } catch (const InputError&) {
    return false;
  }
}

ProgramFrames read_frames(std::string_view text, const std::string& source) {
  Modules modules;
  modules.read_declarations({.source = source, .text = std::string(text)});
  ProgramFrames frames;
  for (const Frame& frame : modules.frames) {
    if (frame.stands_still || frame.is_moved) {
      (frame.is_tool ? frames.standing_tools : frames.moving_user).insert(frame.key);
    } else if (frame.pose) {
      (frame.is_tool ? frames.tool : frames.user)[frame.key] = *frame.pose;
    }
  }
  return frames;
}

// Joint values from closed forms may be a rounding error below the edge of a quadrant.
std::vector<int> quadrants(const SixJoints& joint_values) {
  constexpr double kRounding = 1e-9;
  std::vector<int> turns;
  for (const std::size_t axis : kTurning) {
    turns.push_back(
        static_cast<int>(std::floor((joint_values[static_cast<Eigen::Index>(axis)] + kRounding) / kQuadrant)));
  }
  return turns;
}

// Speeds of the tool in mm/s and deg/s: slow also where the flange only turns. The prefix keeps the module's name from
// being a word of the language.
std::string drive(const std::string& name, const std::vector<MeasuringStop>& stops) {
  std::string text =
      fmt::format("MODULE Kdlcal_{}\n  CONST speeddata vSlow:=[100,20,100,20];\n\n  PROC main()\n", name);
  for (const MeasuringStop& stop : stops) {
    std::string label = stop.label;
    std::replace(label.begin(), label.end(), '\\', '_');  // begins the code of a character
    text += fmt::format("    MoveAbsJ [[{:.4f}],[9E9,9E9,9E9,9E9,9E9,9E9]],vSlow,fine,tool0;\n",
                        fmt::join(stop.joint_values, ","));
    text += fmt::format("    TPWrite \"configuration {}\";\n    Stop;\n", label);
  }
  return text + "  ENDPROC\nENDMODULE\n";
}

}  // namespace
}  // namespace rapid

const ProgramLanguage& abb_rapid() {
  static const ProgramLanguage language = {.name = "ABB RAPID",
                                           .files = ".mod, .sys, .prg",
                                           .is_written_in = rapid::is_module,
                                           .parse = rapid::program_of,
                                           .read_frames = rapid::read_frames,
                                           .companion = "",
                                           .joint_names = {"rax_1", "rax_2", "rax_3", "rax_4", "rax_5", "rax_6"},
                                           .length_unit = 1e-3,
                                           .angle_unit = kDegree,
                                           .reference = {},
                                           .user_frame = "wobjdata",
                                           .tool_frame = "tooldata",
                                           .turns = rapid::quadrants,
                                           .write = written_plainly,
                                           .drive = rapid::drive};
  return language;
}

}  // namespace kdl_calibration
