#pragma once

// Decompositions of matrices of any size. Eigen's templates for them take seconds in each source that names them, here
// they are compiled once. Not installed.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

namespace kdl_calibration {

/// R of a QR decomposition; the matrix itself if it is such a triangle, or has fewer rows than columns. Norms and inner
/// products of the columns are preserved.
Eigen::MatrixXd triangular_factor(const Eigen::MatrixXd& matrix);

/// Q_2^T of, with [Q_1 Q_2] R = span a QR decomposition: what of each column lies outside the span.
Eigen::MatrixXd outside_span(const Eigen::MatrixXd& span, const Eigen::MatrixXd& of);

/// An orthonormal basis of the columns' range. In a QR decomposition with column pivots, pivots not above `least` times
/// the largest count as zero; without `least`, those within rounding.
Eigen::MatrixXd range_basis(const Eigen::MatrixXd& columns, double least = 0.0);
/// The columns of those zero pivots.
std::vector<Eigen::Index> dependent_columns(const Eigen::MatrixXd& columns, double least);

/// A^-1 B of an invertible A.
Eigen::MatrixXd solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

/// x with the least |A x - b|, and of these the shortest. Columns of B are solved for one by one.
Eigen::VectorXd shortest_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
Eigen::MatrixXd shortest_solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& A);

/// The same x by QR with column pivots, if A has full rank.
Eigen::VectorXd least_squares_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);

/// Of a symmetric matrix, in rising order, with unit eigenvectors as columns.
struct Spectrum {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
Spectrum spectrum(const Eigen::MatrixXd& symmetric);
Eigen::VectorXd eigenvalues(const Eigen::MatrixXd& symmetric);

/// X with the least sum of |X from_i - to_i|^2 (Umeyama 1991).
Eigen::Isometry3d rigid_motion(const Eigen::Matrix3Xd& from, const Eigen::Matrix3Xd& to);

}  // namespace kdl_calibration
