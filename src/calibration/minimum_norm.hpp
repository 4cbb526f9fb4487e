#pragma once

// Not installed.

#include <optional>

#include "calibration/determined_fit.hpp"

namespace kdl_calibration {

/// Where the measurements leave directions of the candidates open, all errors along them explain the measurements as
/// well. Of these answers the one whose geometric errors are smallest, in units of the errors that are usual of an arm;
/// base and targets follow. None where no direction is open, where the fit did not arrive, and where the way there does
/// not arrive. `task`: that of the fit, weighed as at its end.
std::optional<Identification> smallest_errors(const FitProblem& task, const DeterminedFit& fit);

}  // namespace kdl_calibration
