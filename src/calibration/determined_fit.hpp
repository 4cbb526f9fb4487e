#pragma once

// Not installed.

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/unknowns.hpp"
#include "selection/parameter_selection.hpp"

namespace kdl_calibration {

/// How the set of parameters and their estimate may be found. Keeps references.
struct FitRules {
  const EstimatorOptions& estimator;
  const ParameterOptions& parameters;
};

/// Fits what the measurements determine of `problem.free`, the candidates of `choice`. Where that set of parameters
/// does not lead to the noise, the complete set with the errors that are usual of an arm goes on, and a set chosen at
/// its end finishes: two parameters that are the same at the nominal geometry may differ at the true one.
/// Parameters that only a measurement without noise could tell are held where the residuals show that there is noise.
DeterminedFit fit_determined_parameters(const FitProblem& problem, const ParameterSelection& choice,
                                        const FitRules& rules);

}  // namespace kdl_calibration
