#pragma once

// Jacobians with their columns scaled to unit norm, which makes their singular values independent of units.
#include <Eigen/Core>
#include <optional>
#include <utility>

#include "base/dense.hpp"

namespace kdl_calibration {

/// For columns of unit norm: a singular value below this times the largest counts as zero.
constexpr double kSingular = 1e-9;

/// 1 / norm of each column; 0 for a zero column.
inline Eigen::VectorXd unit_scale(const Eigen::MatrixXd& jacobian) {
  return jacobian.colwise().norm().transpose().unaryExpr([](double norm) { return norm > 0.0 ? 1.0 / norm : 0.0; });
}

/// The inverse of an upper triangular matrix with a condition number below a million, else empty. The product of both
/// Frobenius norms bounds that number, at a tenth of the cost of singular values.
inline std::optional<Eigen::MatrixXd> regular_inverse(const Eigen::MatrixXd& sqrt_information) {
  constexpr double kRegular = 1e6;
  if (sqrt_information.rows() != sqrt_information.cols() || !sqrt_information.isUpperTriangular(0.0) ||
      !(sqrt_information.diagonal().cwiseAbs().minCoeff() > 0.0)) {
    return std::nullopt;
  }
  Eigen::MatrixXd inverse = sqrt_information.transpose();
  invert_lower(inverse);
  inverse.transposeInPlace();
  return sqrt_information.norm() * inverse.norm() < kRegular ? std::optional(std::move(inverse)) : std::nullopt;
}

}  // namespace kdl_calibration
