#pragma once

// Several numbers side by side, one per lane, in GCC's and Clang's vector extension. Not installed.

namespace kdl_calibration {

constexpr int kLanes = 8;

using Lanes = double __attribute__((vector_size(64)));

/// For containers; aligned for every instruction set, which the vector type alone is not.
struct alignas(64) LaneRow {
  Lanes lanes = {};
};

/// The sum over the lanes, in an order that does not depend on the machine.
inline double sum_of(const Lanes& x) { return ((x[0] + x[1]) + (x[2] + x[3])) + ((x[4] + x[5]) + (x[6] + x[7])); }

}  // namespace kdl_calibration
