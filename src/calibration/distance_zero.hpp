#pragma once

// The zero of an instrument that measures distances: they are all too long, or too short, by the same length.

#include <optional>

#include "calibration/calibration_result.hpp"

namespace kdl_calibration {

/// The zero beside base, targets and geometry; none if the rows hold no measured distances, or do not tell it. A
/// distance that stands in several configurations, as that of a bar, is stated and has no zero. `rigid` is a fit at its
/// start that knows no zero.
std::optional<DistanceZero> zero_of_distances(const FitProblem& rigid);

}  // namespace kdl_calibration
