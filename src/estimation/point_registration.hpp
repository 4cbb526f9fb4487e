#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "estimation/registration.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// The registration of whole points of one station, in closed form but for three angles; `rms` is not set.
///
/// With A = R_WB^T and c = A p_WB the residual A z - c - X_BF t is linear in (A, c, t). Eliminating c and all t leaves
/// a quadratic form in the nine elements of A, exact and independent of the number of observations, which is minimised
/// over the rotations from 25 starts (a rotation search as in Olsson et al. 2009, without its bounds). Measured
/// orientations add the terms A Z - R_BF R_FT with R_FT unconstrained, an approximation whose result lies within noise
/// of the optimum.
Registration register_points(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& points,
                             const RegistrationOptions& options);

/// The 24 rotations of the cube: no rotation is farther than 62.8 degrees from one of them.
std::vector<Eigen::Matrix3d> cube_rotations();

/// [m] lower bound of the 3D RMS over all bases and targets, for points of one station: the minimum of that quadratic
/// form over all matrices A instead of rotations, at a tenth of the cost of a registration. Ignores sigmas and
/// orientations.
double least_misfit(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements);

}  // namespace kdl_calibration
