#include "base/decompositions.hpp"

#include <Eigen/Dense>

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

Eigen::ColPivHouseholderQR<MatrixXd> pivoted(const MatrixXd& columns, double least) {
  Eigen::ColPivHouseholderQR<MatrixXd> result(columns);
  if (least > 0.0) {
    result.setThreshold(least);
  }
  return result;
}

}  // namespace

MatrixXd triangular_factor(const MatrixXd& matrix) {
  if (matrix.rows() < matrix.cols() || (matrix.rows() == matrix.cols() && matrix.isUpperTriangular(0.0))) {
    return matrix;
  }
  return Eigen::HouseholderQR<MatrixXd>(matrix).matrixQR().topRows(matrix.cols()).triangularView<Eigen::Upper>();
}

MatrixXd outside_span(const MatrixXd& B, const MatrixXd& A) {
  MatrixXd turned = A;
  turned.applyOnTheLeft(Eigen::HouseholderQR<MatrixXd>(B).householderQ().adjoint());
  return turned.bottomRows(A.rows() - B.cols());
}

MatrixXd range_basis(const MatrixXd& columns, double least) {
  const Eigen::ColPivHouseholderQR<MatrixXd> factors = pivoted(columns, least);
  MatrixXd basis = MatrixXd::Identity(columns.rows(), factors.rank());
  basis.applyOnTheLeft(factors.householderQ());
  return basis;
}

std::vector<Index> dependent_columns(const MatrixXd& columns, double least) {
  const Eigen::ColPivHouseholderQR<MatrixXd> factors = pivoted(columns, least);
  const auto& order = factors.colsPermutation().indices();
  return {order.begin() + factors.rank(), order.end()};
}

MatrixXd solution(const MatrixXd& A, const MatrixXd& B) { return A.partialPivLu().solve(B); }

VectorXd shortest_solution(const MatrixXd& A, const VectorXd& b) {
  return A.completeOrthogonalDecomposition().solve(b);
}

MatrixXd shortest_solution(const MatrixXd& A, const MatrixXd& B) {
  return A.completeOrthogonalDecomposition().solve(B);
}

MatrixXd pseudo_inverse(const MatrixXd& A) { return A.completeOrthogonalDecomposition().pseudoInverse(); }

VectorXd least_squares_solution(const MatrixXd& A, const VectorXd& b) { return A.colPivHouseholderQr().solve(b); }

Spectrum spectrum(const MatrixXd& symmetric) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(symmetric);
  return {.values = solver.eigenvalues(), .vectors = solver.eigenvectors()};
}

VectorXd eigenvalues(const MatrixXd& symmetric) {
  return Eigen::SelfAdjointEigenSolver<MatrixXd>(symmetric, Eigen::EigenvaluesOnly).eigenvalues();
}

Eigen::Isometry3d rigid_motion(const Eigen::Matrix3Xd& from, const Eigen::Matrix3Xd& to) {
  return Eigen::Isometry3d(Eigen::umeyama(from, to, false));
}

}  // namespace kdl_calibration
