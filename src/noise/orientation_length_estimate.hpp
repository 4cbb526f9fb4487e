#pragma once

#include "estimation/identification.hpp"

namespace kdl_calibration {

/// [m] weight of orientations relative to positions (ResidualOptions::orientation_length) that agrees with the
/// residuals: the ratio of their sigmas, estimated by variance components (Förstner 1979; Koch, Parameter Estimation
/// and Hypothesis Testing, 3.6). With e_i the whitened residuals of a kind, N_i its normal matrix and N the sum, the
/// variance of unit weight of the kind is
///   u_i = e_i^T e_i / (n_i - tr(N^-1 N_i)),
/// and the weights are corrected by u_i until these are equal. Returns the present length without orientations, with
/// residuals of rounding size, or without degrees of freedom.
double orientation_length_of_residuals(const FitProblem& problem);

}  // namespace kdl_calibration
