#pragma once

// The zero of an instrument that measures distances: they are all too long, or too short, by the same length.

#include <optional>
#include <vector>

#include "calibration/calibration_result.hpp"

namespace kdl_calibration {

/// The zero beside all that is fitted, whose measurements know no zero; sought from lengths that are too long by
/// `start` [m]. None if the rows hold no measured distances, or do not tell it. A distance that stands in several
/// configurations, as that of a bar, is stated and has no zero.
std::optional<DistanceZero> zero_of_distances(const FitProblem& fitted, double start = 0.0);

/// The zeros from which a calibration begins whose effects are still to be chosen: beside the geometry alone and, if it
/// differs, beside the sag and the gains that joints ordinarily have. Sag that nothing explains looks like a zero, and
/// a zero that nothing explains like sag. None as above. `rigid` is a fit at its start.
std::vector<DistanceZero> possible_zeros(const FitProblem& rigid);

}  // namespace kdl_calibration
