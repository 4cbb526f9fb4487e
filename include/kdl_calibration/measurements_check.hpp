#pragma once

#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Whether measurements that did not come from a file hold together, as those of the reader do. Throws InputError
/// naming the row or the size and the rule: joint values, configurations, orientations, order and units that are not as
/// many as they should be, an observation of a configuration or target that is not there, a joint value or position
/// that is not finite, a sigma that is negative or not finite, an orientation that is no unit quaternion (or NaN in all
/// four).
void check(const Measurements& measurements);

}  // namespace kdl_calibration
