#pragma once

#include "calibration/calibration_result.hpp"
#include "estimation/unknowns.hpp"
#include "selection/parameter_selection.hpp"

namespace kdl_calibration {

/// Options for the choice of parameters and their fit. Keeps references.
struct FitRules {
  const EstimatorOptions& estimator;
  const ParameterOptions& parameters;
};

/// The problem without the unknowns of bases that its measurements do not determine at the start. One length between
/// two points leaves five directions of its base undetermined.
FitProblem with_determined_unknowns(const FitProblem& problem);

/// Fits the parameters of `problem.free`, the candidates of `choice`, that the measurements determine. If the fit fails
/// or the complete set would explain most of the misfit, that set with a prior of usual errors continues. A set chosen
/// at its end finishes: parameters equivalent at the nominal geometry may differ at the true one. Parameters hidden by
/// the noise of the residuals are fixed.
DeterminedFit fit_determined_parameters(const FitProblem& problem, const ParameterSelection& choice,
                                        const FitRules& rules);

/// Whether all candidates are estimated, but for rotations of stations that their points do not show.
bool determines_arm(const DeterminedFit& fit);

}  // namespace kdl_calibration
