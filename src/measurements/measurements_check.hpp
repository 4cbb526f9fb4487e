#pragma once

#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Checks measurements for consistency. Throws InputError naming the row or size and the rule, for: a wrong number of
/// joint values, configurations, orientations, order entries or units; an index out of range; a joint value, position
/// or sigma that is not finite; a negative sigma; an orientation that is neither a unit quaternion nor NaN in all four
/// coefficients.
void check(const Measurements& measurements);

}  // namespace kdl_calibration
