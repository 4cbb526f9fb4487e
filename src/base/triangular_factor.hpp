#pragma once

// Not installed.

#include <Eigen/Dense>

namespace kdl_calibration {

/// R of the matrix; the matrix itself where it has few rows. Norms of the columns and whatever holds among them are the
/// same.
inline Eigen::MatrixXd triangular_factor(const Eigen::MatrixXd& matrix) {
  if (matrix.rows() <= matrix.cols()) {
    return matrix;
  }
  return Eigen::HouseholderQR<Eigen::MatrixXd>(matrix).matrixQR().topRows(matrix.cols()).triangularView<Eigen::Upper>();
}

}  // namespace kdl_calibration
