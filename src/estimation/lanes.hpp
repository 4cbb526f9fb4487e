#pragma once

// SIMD vectors, one number per lane, in the vector extension of GCC and Clang.

namespace kdl_calibration {

constexpr int kLanes = 8;

using Lanes = double __attribute__((vector_size(64)));

/// For containers; unlike the vector type it is aligned for every instruction set.
struct alignas(64) LaneRow {
  Lanes lanes = {};
};

}  // namespace kdl_calibration
