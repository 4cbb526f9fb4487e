#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "estimation/least_squares.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

/// d(position of every target in W) / d(free parameters) in one configuration, by products of 4 x 4 matrices with one
/// factor's derivative: 3 targets' coordinates (x y z of the first, then of the next) x the columns of `free`, [m] per
/// m or rad. `q` has one value per joint. Throws InputError for a free effect, which no URDF represents.
Eigen::MatrixXd identification_jacobian(const ErrorModel& model, const Estimate& estimate, const Unknowns& free,
                                        const Eigen::VectorXd& q);

/// A of the published linear least squares problem for base and tools, along the axes of the base (see
/// base_and_tool_rows): 9 x 15 for three targets, its rows in the order of the identification Jacobian.
Eigen::MatrixXd base_and_tool_matrix(const ErrorModel& model, const Estimate& estimate, const Eigen::VectorXd& q);

/// Names of its columns: p_base.x y z, phi_base.x y z, then u_A.x y z for target A …
std::vector<std::string> base_and_tool_names(const std::vector<TargetFrame>& targets);

}  // namespace kdl_calibration
