#include "estimation/scaled_solver.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "base/dense.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kPivotInDoubt = 1e-9;
constexpr double kSmallestDamping = 1e-12;

}  // namespace

void ScaledSolver::solve(const MatrixXd& H, const VectorXd& added, const VectorXd& g) {
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
    const Eigen::LDLT<MatrixXd> pivoted(scaled());
    solution_ = pivoted.solve(solution_);
  }
  solution_.array() *= scale_.array();
}

void ScaledSolver::scale_lower(const MatrixXd& H) {
  const Index n = scale_.size();
  padded_.setZero((n + kPaddedRows - 1) / kPaddedRows * kPaddedRows, n);
  for (Index c = 0; c < n; ++c) {
    padded_.col(c).segment(c, n - c) = scale_[c] * scale_.tail(n - c).cwiseProduct(H.col(c).tail(n - c));
    padded_(c, c) = 1.0 + kSmallestDamping;
  }
}

void ScaledSolver::factorise() {
  constexpr Index kLarge = 128;  // size from which the divided algorithm is faster
  if (padded_.cols() < kLarge) {
    smallest_pivot_ = factorise_small(kPivotInDoubt, padded_);
    return;
  }
  const bool regular = kdl_calibration::factorise(scaled());
  const double pivot = scaled().diagonal().cwiseAbs2().minCoeff();
  smallest_pivot_ = regular && pivot > kPivotInDoubt ? std::min(pivot, 1.0) : 0.0;
}

}  // namespace kdl_calibration
