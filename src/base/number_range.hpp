#pragma once

#include <limits>

namespace kdl_calibration {

/// Input limits: largest number (coordinates in metres, joint values, matrix elements) and smallest stated sigma.
/// Squares, products and weights then stay far within the range of a double.
constexpr double kLargestNumber = 1e12;
constexpr double kSmallestSigma = 1e-15;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace kdl_calibration
