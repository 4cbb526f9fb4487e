#pragma once

// Not installed.

#include <limits>

namespace kdl_calibration {

/// Numbers larger than this (coordinates in metres, joint values, matrix elements) are refused as input, and stated
/// sigmas below the other: squares, products and weights of what remains are far within the range of a double.
constexpr double kLargestNumber = 1e12;
constexpr double kSmallestSigma = 1e-15;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace kdl_calibration
