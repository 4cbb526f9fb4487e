#pragma once

#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Checks measurements for consistency. Throws InputError naming the row or size and the rule, for: a wrong number of
/// joint values, configurations or units; an index out of range; a joint value, position or sigma that is not finite; a
/// negative sigma; an orientation or a direction that is not of unit length; a distance that is not above 0; rows of a
/// configuration with other stations or anchors; a place in the order in some rows only.
void check(const Measurements& measurements);

}  // namespace kdl_calibration
