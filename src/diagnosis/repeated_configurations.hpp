#pragma once

// Configurations that were measured twice.

#include <vector>

#include "diagnosis/alternative_readings.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// A remark where two configurations have the same joint values, and one more where a test row copies a train row.
std::vector<AlternativeReading> repeated_configurations(const Measurements& measurements);

}  // namespace kdl_calibration
