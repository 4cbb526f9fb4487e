#pragma once

// Several numbers side by side, one per lane, in GCC's and Clang's vector extension. Not installed.

namespace kdl_calibration {

constexpr int kLanes = 8;

using Lanes = double __attribute__((vector_size(64)));

/// For containers; aligned for every instruction set, which the vector type alone is not.
struct alignas(64) LaneRow {
  Lanes lanes = {};
};

}  // namespace kdl_calibration
