#pragma once

// Normal equations of columns in different units. Not installed.

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "base/dense.hpp"

namespace kdl_calibration {

/// Solves (H + diag(added)) x = g, with H symmetric and positive semi-definite, in columns scaled to unit norm. Keeps
/// its memory from one call to the next.
class ScaledSolver {
public:
  /// `added` may be empty. Of `H` the lower triangle is read. A damping of 1e-12 of each column keeps a singular H
  /// soluble.
  void solve(const Eigen::MatrixXd& H, const Eigen::VectorXd& added, const Eigen::VectorXd& g) {
    scale_ = H.diagonal();
    if (added.size() > 0) {
      scale_ += added;
    }
    scale_ = scale_.unaryExpr([](double d) { return d > 0.0 ? 1.0 / std::sqrt(d) : 0.0; });
    scale_lower(H);
    solution_ = scale_.cwiseProduct(g);
    // Without pivoting each pivot is the squared distance of a column from the span of those before it. Pivoting is
    // needed only where one is small.
    factorise();
    if (smallest_pivot_ > kPivotInDoubt) {
      scaled().triangularView<Eigen::Lower>().solveInPlace(solution_);
      scaled().triangularView<Eigen::Lower>().adjoint().solveInPlace(solution_);
    } else {
      scale_lower(H);
      const Eigen::LDLT<Eigen::MatrixXd> pivoted(scaled());
      solution_ = pivoted.solve(solution_);
      smallest_pivot_ = pivoted.vectorD().minCoeff();
    }
    solution_.array() *= scale_.array();
  }

  const Eigen::VectorXd& solution() const { return solution_; }
  /// Of the scaled matrix: near zero where H is rank deficient.
  double smallest_pivot() const { return smallest_pivot_; }

private:
  static constexpr double kPivotInDoubt = 1e-9;
  static constexpr double kSmallestDamping = 1e-12;

  void scale_lower(const Eigen::MatrixXd& H) {
    const Eigen::Index n = scale_.size();
    padded_.setZero((n + kPaddedRows - 1) / kPaddedRows * kPaddedRows, n);
    for (Eigen::Index c = 0; c < n; ++c) {
      padded_.col(c).segment(c, n - c) = scale_[c] * scale_.tail(n - c).cwiseProduct(H.col(c).tail(n - c));
      padded_(c, c) = 1.0 + kSmallestDamping;
    }
  }

  Eigen::Block<Eigen::MatrixXd> scaled() { return padded_.topRows(padded_.cols()); }

  // scaled() = L L^T in place; smallest_pivot_ is zero where a pivot is in doubt.
  void factorise() {
    constexpr Eigen::Index kLarge = 128;  // size from which the divided algorithm is faster
    if (padded_.cols() < kLarge) {
      smallest_pivot_ = factorise_small(kPivotInDoubt, padded_);
      return;
    }
    const bool regular = kdl_calibration::factorise(scaled());
    const double pivot = scaled().diagonal().cwiseAbs2().minCoeff();
    smallest_pivot_ = regular && pivot > kPivotInDoubt ? std::min(pivot, 1.0) : 0.0;
  }

  Eigen::VectorXd scale_;
  Eigen::VectorXd solution_;
  Eigen::MatrixXd padded_;  // the scaled matrix with rows of zeros below, see factorise_small()
  double smallest_pivot_ = 0.0;
};

}  // namespace kdl_calibration
