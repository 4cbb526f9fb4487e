#pragma once

// The zero of an instrument that measures distances: they are all too long, or too short, by the same length. Of
// several stations each instrument may have its own.

#include <optional>

#include "calibration/calibration_result.hpp"

namespace kdl_calibration {

/// The zeros beside base, targets and geometry, one of all unless those of the stations differ (p < 0.001); none if the
/// rows hold no measured distances, or do not tell it. A distance that stands in several configurations, as that of a
/// bar, is stated and has no zero. `rigid` is a fit at its start that knows no zero.
std::optional<DistanceZero> zero_of_distances(const FitProblem& rigid);

}  // namespace kdl_calibration
