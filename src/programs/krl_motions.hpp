#pragma once

// The motions of a program in the KUKA Robot Language, with the frames in which each reaches its end.

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "programs/krl_flow.hpp"
#include "programs/krl_frames.hpp"
#include "programs/krl_notes.hpp"
#include "programs/krl_symbols.hpp"

namespace kdl_calibration::krl {

/// In which frames motions reach a point.
struct PointUse {
  FrameInForce tool;
  FrameInForce base;
  bool is_in_cell = false;  ///< the tool
  bool has_two_frames = false;
};

/// A position that stands in a motion: PTP {...}
struct InlinePoint {
  std::string name;
  Place place;
  Position position;
  PointUse use;
};

struct ReadMotion {
  Place place;
  bool is_straight = false;
  bool is_curved = false;
  bool is_known = true;
  std::optional<std::size_t> symbol;        ///< of its end
  std::optional<std::size_t> inline_point;  ///< of its end
};

struct ReadMotions {
  std::vector<ReadMotion> motions;
  std::vector<InlinePoint> inline_points;
  std::vector<std::optional<PointUse>> uses;  ///< of symbols
};

/// The frames that the FDAT of the same name states: FP1 of XP1. None without one.
std::optional<FrameData> own_frame_data(const Symbols& symbols, const Symbol& symbol, Routine routine);

/// Reads the motions of all routines. Throws InputError.
ReadMotions read_motions(const std::vector<ProgramText>& texts, const Symbols& symbols, FrameValues& frames,
                         Notes& notes);

}  // namespace kdl_calibration::krl
