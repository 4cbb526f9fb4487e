#pragma once

#include <Eigen/Core>

#include "estimation/least_squares.hpp"
#include "estimation/unknowns.hpp"
#include "noise/noise_components.hpp"

namespace kdl_calibration {

/// Covariance of the columns (in their order) for a whitened Jacobian J: factor · (J^T J)^-1 by singular values of the
/// scaled triangular factor. Undetermined columns get infinite variance; the variance of the others does not depend on
/// them. `factor`: variance of unit weight, 1 if the noise is absolute.
Eigen::MatrixXd covariance(const Eigen::MatrixXd& whitened_jacobian, double factor);

/// The product outer · middle · outer. Columns with infinite variance in `outer` keep it and do not enter the others.
Eigen::MatrixXd sandwich(const Eigen::MatrixXd& outer, const Eigen::MatrixXd& middle);

/// Directions of the columns that the measurements do not determine: columns x k. A prediction is determined where its
/// Jacobian has no part along them.
Eigen::MatrixXd undetermined_directions(const Eigen::MatrixXd& whitened_jacobian);

/// Covariance of the columns for an equal-weight fit whose errors are correlated within each configuration:
///   A^-1 (sum J_c^T S_c J_c + priors) A^-1,  A = sum J_c^T J_c + priors,  S_c = independent^2 I + common^2 (ones ⊗ I).
/// The system must have been whitened by one sigma for all, `unit_weight` = 1 / sigma^2.
Eigen::MatrixXd covariance(const WhitenedSummary& summary, const ResidualNoise& noise, double unit_weight);

}  // namespace kdl_calibration
