#pragma once

#include <cstddef>

#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Largest numbers of targets and stations.
constexpr std::size_t kMostTargets = 100;
constexpr std::size_t kMostStations = 100;

/// Checks measurements for consistency. Throws InputError naming the row or size and the rule, for: a wrong number of
/// joint values, configurations or units; an index out of range; a joint value, position, distance or sigma that
/// is not finite or beyond 1e12; a sigma that is negative or below 1e-15 m without being 0; a negative repeat; an
/// orientation or a direction that is not of unit length; a distance that is not above 0; rows of a configuration with
/// other stations or anchors; a place in the order in some rows only; too many targets or stations.
void check(const Measurements& measurements);

}  // namespace kdl_calibration
