#pragma once

// Not installed.

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Throws InputError where effects of measured torques are asked for and the measurements, or the configurations to
/// predict at, lack some, and where signals are not of the size of the joint values.
void require_signals(const Measurements& measurements, const CalibrationOptions& options);

}  // namespace kdl_calibration
