#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/kinematics.hpp"

namespace kdl_calibration {

/// X_BF as the product of the 4x4 matrices of its factors, the published route to the Jacobians.
struct MatrixProduct {
  Eigen::Matrix4d pose;
  /// Of each factor, per unit of its parameter or joint value: the product in which the factor is replaced by its
  /// derivative. Zero where it is fixed.
  std::vector<Eigen::Matrix4d> derivatives;
};

/// `factors` as by chain_factors, at the joint values `q` (rad or m).
MatrixProduct matrix_product(const std::vector<ChainFactor>& factors, const Eigen::VectorXd& errors,
                             const Eigen::VectorXd& q);

/// How a point of the flange frame moves in the base frame, per unit of each parameter of `which`: 3 x which.
Matrix3Xd point_columns(const std::vector<ChainFactor>& factors, const MatrixProduct& product,
                        const std::vector<std::size_t>& which, const Eigen::Vector3d& point);

}  // namespace kdl_calibration
