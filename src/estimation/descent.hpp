#pragma once

#include "estimation/identification.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

/// Steps that the descent may use. `any`: all of them. `plain`: Gauss-Newton only; ends as stalled if the cost falls
/// much less than predicted. `prior`: the prior, scaled by the misfit, stays to the end. The end is then the most
/// probable robot if the residuals are noise.
enum class Steps { any, plain, prior };

/// Lengths of errors, and rounding, are those of an arm up to ten metres; with a longer one they grow by this factor.
double size_of_arm(const ErrorModel& model);

/// Minimises the cost of `problem` from `start`; see identify_jointly.
Identification descend(const LeastSquaresProblem& problem, const Estimate& start, const JointOptions& options,
                       Steps steps = Steps::any);

/// Share of the cost by which the first step from `estimate` is predicted to reduce it, with the prior scaled by the
/// misfit.
double predicted_share(const LeastSquaresProblem& problem, const Estimate& estimate);

}  // namespace kdl_calibration
