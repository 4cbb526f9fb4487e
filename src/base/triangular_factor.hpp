#pragma once

// Not installed.

#include <Eigen/Dense>

namespace kdl_calibration {

/// R of a QR decomposition; the matrix itself if it is such a triangle, or has fewer rows than columns. Norms and inner
/// products of the columns are preserved.
inline Eigen::MatrixXd triangular_factor(const Eigen::MatrixXd& matrix) {
  if (matrix.rows() < matrix.cols() || (matrix.rows() == matrix.cols() && matrix.isUpperTriangular(0.0))) {
    return matrix;
  }
  return Eigen::HouseholderQR<Eigen::MatrixXd>(matrix).matrixQR().topRows(matrix.cols()).triangularView<Eigen::Upper>();
}

}  // namespace kdl_calibration
