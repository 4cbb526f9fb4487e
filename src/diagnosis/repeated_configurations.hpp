#pragma once

// Configurations that were measured twice.

#include <optional>
#include <vector>

#include "diagnosis/alternative_readings.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// A remark where two configurations have the same joint values, and one more where a test row copies a train row.
std::vector<AlternativeReading> repeated_configurations(const Measurements& measurements);

/// A doubt where whole points of a later repeat are displaced alike against the first one of their configuration, as in
/// two recordings of one program: by a rigid motion in W (the base or the measuring device moved), or each target by a
/// constant on the flange (it slipped). The displacement must leave less than a third of the differences, beyond chance
/// (F test). The means of the repeats, which are fitted, show nothing of it.
std::optional<AlternativeReading> moved_between_repeats(const ErrorModel& model, const Measurements& measurements,
                                                        const Estimate& fit);

}  // namespace kdl_calibration
