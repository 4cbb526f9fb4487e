#pragma once

#include <optional>

#include "calibration/determined_fit.hpp"

namespace kdl_calibration {

/// The minimum-norm solution: if some directions of the candidates are undetermined, the equally good fit with the
/// smallest geometric errors in units of usual errors. Base and targets follow. Empty if all directions are determined,
/// or if the fit or this search does not converge. `task`: the fit with the weights at its end.
std::optional<Identification> smallest_errors(const FitProblem& task, const DeterminedFit& fit);

}  // namespace kdl_calibration
