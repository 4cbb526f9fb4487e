#pragma once

// Not installed.

#include <Eigen/Dense>

namespace kdl_calibration {

/// R of a QR decomposition; the matrix itself if it has few rows. Norms and inner products of the columns are
/// preserved.
inline Eigen::MatrixXd triangular_factor(const Eigen::MatrixXd& matrix) {
  if (matrix.rows() <= matrix.cols()) {
    return matrix;
  }
  return Eigen::HouseholderQR<Eigen::MatrixXd>(matrix).matrixQR().topRows(matrix.cols()).triangularView<Eigen::Upper>();
}

}  // namespace kdl_calibration
