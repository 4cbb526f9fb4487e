#pragma once

// Decompositions of matrices of any size. Eigen's templates take seconds to compile in each source that names them.
// Here they are compiled once.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

namespace kdl_calibration {

/// R of a QR decomposition; the matrix itself if it is such a triangle, or has fewer rows than columns. Norms and inner
/// products of the columns are preserved.
Eigen::MatrixXd triangular_factor(const Eigen::MatrixXd& matrix);

/// Q_2^T A with the QR decomposition [Q_1 Q_2] R of B: the parts of the columns of A that B does not span.
Eigen::MatrixXd outside_span(const Eigen::MatrixXd& B, const Eigen::MatrixXd& A);

/// An orthonormal basis of the columns' range. In a QR decomposition with column pivots, pivots not above `least` times
/// the largest count as zero; without `least`, those within rounding.
Eigen::MatrixXd range_basis(const Eigen::MatrixXd& columns, double least = 0.0);
/// Indices of the columns whose pivots count as zero.
std::vector<Eigen::Index> dependent_columns(const Eigen::MatrixXd& columns, double least);

/// A^-1 B of an invertible A.
Eigen::MatrixXd solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

/// The shortest x of those with the least |A x - b|. For a matrix B one column of x for each of B.
Eigen::VectorXd shortest_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
Eigen::MatrixXd shortest_solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& A);

/// x with the least |A x - b| for A of full rank, by QR with column pivots.
Eigen::VectorXd least_squares_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);

/// Eigenvalues of a symmetric matrix in rising order, and its unit eigenvectors as columns.
struct Spectrum {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
Spectrum spectrum(const Eigen::MatrixXd& symmetric);
Eigen::VectorXd eigenvalues(const Eigen::MatrixXd& symmetric);

/// X with the least sum of |X from_i - to_i|^2 (Umeyama 1991).
Eigen::Isometry3d rigid_motion(const Eigen::Matrix3Xd& from, const Eigen::Matrix3Xd& to);

}  // namespace kdl_calibration
