#include "estimation/linear_system.hpp"

#include <Eigen/Dense>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/decompositions.hpp"
#include "base/dense.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr Index kRowsAtOnce = 512;
constexpr Index kSumsAtOnce = 64;  // configurations

}  // namespace

VectorXd unit_scale_of_information(const Eigen::Ref<const MatrixXd>& information) {
  return information.diagonal().unaryExpr([](double d) { return d > 0.0 ? 1.0 / std::sqrt(d) : 0.0; });
}

std::optional<MatrixXd> well_conditioned_root(const MatrixXd& information) {
  constexpr double kSmallestPivot = 1e-3;
  const VectorXd norms = information.diagonal().cwiseSqrt();
  if (!(norms.minCoeff() > 0.0)) {
    return std::nullopt;
  }
  const VectorXd inverse = norms.cwiseInverse();
  MatrixXd root = inverse.asDiagonal() * information * inverse.asDiagonal();
  if (!factorise(root) || !(root.diagonal().minCoeff() > kSmallestPivot)) {
    return std::nullopt;
  }
  return MatrixXd(root.triangularView<Eigen::Lower>().transpose()) * norms.asDiagonal();
}

RowSummary::RowSummary(Index columns, std::optional<MatrixXd> sqrt_information)
    : columns_(columns),
      known_(std::move(sqrt_information)),
      rows_(known_ ? 0 : columns + kRowsAtOnce, columns),
      sums_(3 * kSumsAtOnce, columns) {
  summary_.priors = MatrixXd::Zero(columns, columns);
  summary_.sums = MatrixXd::Zero(columns, columns);
}

void RowSummary::add_configuration(const Eigen::Ref<const MatrixXd>& jacobian,
                                   const Eigen::Ref<const VectorXd>& residual) {
  append(jacobian);
  const Index points = residual.size() / 3;
  if (summed_ == sums_.rows()) {
    add_sums();
  }
  auto sum = sums_.middleRows<3>(summed_);
  sum.setZero();
  for (Index i = 0; i < points; ++i) {
    sum += jacobian.middleRows<3>(3 * i);
  }
  summed_ += 3;
  const Eigen::Map<const Matrix3Xd> e(residual.data(), 3, points);
  summary_.squares += e.squaredNorm();
  summary_.squares_of_sums += e.rowwise().sum().squaredNorm();
  summary_.pairs += 3.0 * static_cast<double>(points * (points - 1)) / 2.0;
  summary_.measured_rows += residual.size();
}

void RowSummary::add_priors(const Eigen::Ref<const MatrixXd>& rows) {
  append(rows);
  const Eigen::SparseMatrix<double> entries = rows.sparseView();
  summary_.priors += Eigen::SparseMatrix<double>(entries.transpose() * entries);
}

WhitenedSummary RowSummary::finish() {
  add_sums();
  summary_.sums.triangularView<Eigen::StrictlyUpper>() = summary_.sums.transpose();
  make_triangle();
  summary_.sqrt_information = known_ ? std::move(*known_) : MatrixXd(rows_.topRows(filled_));
  return std::move(summary_);
}

void RowSummary::append(const Eigen::Ref<const MatrixXd>& rows) {
  summary_.rows += rows.rows();
  if (known_) {
    return;
  }
  if (filled_ + rows.rows() > rows_.rows()) {
    make_triangle();
    rows_.conservativeResize(std::max(rows_.rows(), filled_ + rows.rows()), Eigen::NoChange);
  }
  rows_.middleRows(filled_, rows.rows()) = rows;
  filled_ += rows.rows();
}

void RowSummary::add_sums() {
  const Factor transposed = factor(sums_.topRows(summed_)).transposed();
  add_symmetric_product(1.0, transposed, transposed, summary_.sums);
  summed_ = 0;
}

void RowSummary::make_triangle() {
  if (filled_ > columns_) {
    rows_.topRows(columns_) = triangular_factor(rows_.topRows(filled_));
    filled_ = columns_;
  }
}

}  // namespace kdl_calibration
