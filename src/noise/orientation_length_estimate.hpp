#pragma once

#include "kdl_calibration/identification.hpp"

namespace kdl_calibration {

/// [m] by which orientations are weighed against positions, ResidualOptions::orientation_length, so that both have
/// residuals as large as their weights say: the ratio of their sigmas, estimated from the residuals themselves by
/// variance components (Förstner 1979; Koch, Parameter Estimation and Hypothesis Testing, 3.6). With e_i the whitened
/// residuals of a kind, N_i its normal matrix and N the sum, the variance of unit weight of the kind is
///   u_i = e_i^T e_i / (n_i - tr(N^-1 N_i)),
/// and the weights are corrected by u_i until these are equal. The present length where there is nothing to tell it:
/// no orientations, residuals that are rounding, or as many unknowns as equations.
double orientation_length_of_residuals(const FitProblem& problem);

}  // namespace kdl_calibration
