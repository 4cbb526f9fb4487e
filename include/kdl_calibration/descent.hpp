#pragma once

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

/// What the descent may do. `any`: everything; `plain`: it gives up as stalled where a plain step does not keep its
/// promise; `prior`: the prior in units of the misfit stays, so that the end is the most probable robot if the
/// residuals are noise, and the data alone only where the misfit vanishes.
enum class Steps { any, plain, prior };

/// Minimises the cost of `problem` from `start`; see identify_jointly.
Identification descend(const LeastSquaresProblem& problem, const Estimate& start, const JointOptions& options,
                       Steps steps = Steps::any);

/// Share of the cost by which the first step from `estimate` is predicted to reduce it, with the prior in units of the
/// misfit.
double predicted_share(const LeastSquaresProblem& problem, const Estimate& estimate);

}  // namespace kdl_calibration
