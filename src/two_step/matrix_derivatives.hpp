#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "model/error_chains.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {

/// X_BF as a product of 4x4 matrices, from which the publication derives the Jacobians.
struct MatrixProduct {
  Eigen::Matrix4d pose;
  /// For each factor the product in which its derivative replaces it, per unit of its parameter or joint value. Zero
  /// for fixed factors.
  std::vector<Eigen::Matrix4d> derivatives;
};

/// `factors` as by chain_factors, at the joint values `q` (rad or m).
MatrixProduct matrix_product(const std::vector<ChainFactor>& factors, const Eigen::VectorXd& errors,
                             const Eigen::VectorXd& q);

/// Motion in the base frame of a point of the flange frame, per unit of each parameter of `which`: 3 x which.
Matrix3Xd point_columns(const std::vector<ChainFactor>& factors, const MatrixProduct& product,
                        const std::vector<std::size_t>& which, const Eigen::Vector3d& point);

/// The manipulator Jacobian (6 x joints, twist of the tip in the base frame, linear first) by three routes.
struct ManipulatorJacobians {
  Matrix6Xd kdl;                ///< KDL::ChainJntToJacSolver
  Matrix6Xd matrix_derivative;  ///< products of 4x4 matrices with one factor's derivative
  Matrix6Xd cross_product;      ///< axis x lever arm
  double largest_difference = 0.0;
};
ManipulatorJacobians manipulator_jacobians(const ErrorModel& model, const Eigen::VectorXd& errors,
                                           const Eigen::VectorXd& q);

}  // namespace kdl_calibration
