#pragma once

// Normal equations of columns in different units.

#include <Eigen/Core>

namespace kdl_calibration {

/// Solves (H + diag(added)) x = g, with H symmetric and positive semi-definite, in columns scaled to unit norm. Keeps
/// its memory from one call to the next.
class ScaledSolver {
public:
  /// `added` may be empty. Of `H` the lower triangle is read. A damping of 1e-12 of each column keeps a singular H
  /// soluble.
  void solve(const Eigen::MatrixXd& H, const Eigen::VectorXd& added, const Eigen::VectorXd& g);

  const Eigen::VectorXd& solution() const { return solution_; }

private:
  void scale_lower(const Eigen::MatrixXd& H);
  Eigen::Block<Eigen::MatrixXd> scaled() { return padded_.topRows(padded_.cols()); }

  // scaled() = L L^T in place; smallest_pivot_ is zero where a pivot is in doubt.
  void factorise();

  Eigen::VectorXd scale_;
  Eigen::VectorXd solution_;
  Eigen::MatrixXd padded_;  // the scaled matrix with rows of zeros below, see factorise_small()
  double smallest_pivot_ = 0.0;
};

}  // namespace kdl_calibration
