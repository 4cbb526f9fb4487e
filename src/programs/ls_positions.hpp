#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "programs/program.hpp"

namespace kdl_calibration {

inline bool is_ls_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

// A motion to P[position], or to P[...] of a number that is known at run time only.
struct LsMotion {
  ProgramMotion motion;
  std::optional<int> position;
  bool is_indirect = false;   // P[R[...]]
  bool is_increment = false;  // INC: the position is a step, no place
};

/// Adds the positions of a FANUC program, which begin at `at` in this line behind /POS, and its motions to them, with
/// remarks on positions that stay as they are. Throws InputError for a motion to a position that was not taught, and
/// for bad text.
void read_ls_positions(const ProgramText& program_text, std::size_t at, std::size_t line, Program& program,
                       const std::vector<LsMotion>& motions);

}  // namespace kdl_calibration
