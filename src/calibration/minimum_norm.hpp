#pragma once

// Not installed.

#include "calibration/whole_fit.hpp"

namespace kdl_calibration {

/// Where the measurements leave directions of the candidates open, all errors along them explain the measurements as
/// well. Moves the fit to the one of these answers whose geometric errors are smallest, in units of the errors that are
/// usual of an arm; base and targets follow. False, and nothing is changed, where no direction is open, where the fit
/// did not arrive, and where the way there does not arrive. `residuals`: as at the end of the fit.
bool take_smallest_errors(const FitTask& task, const ResidualOptions& residuals, WholeFit& fit);

}  // namespace kdl_calibration
