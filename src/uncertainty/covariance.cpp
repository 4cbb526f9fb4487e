#include "uncertainty/covariance.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "base/decompositions.hpp"
#include "base/dense.hpp"
#include "base/singular_values.hpp"
#include "model/kinematics.hpp"
#include "uncertainty/unit_columns.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd covariance(const MatrixXd& whitened_jacobian, double factor) {
  const Index columns = whitened_jacobian.cols();
  if (columns == 0) {
    return {};
  }
  const VectorXd scale = unit_scale(whitened_jacobian);
  const MatrixXd sqrt_information = triangular_factor(whitened_jacobian * scale.asDiagonal());
  if (const std::optional<MatrixXd> inverse = regular_inverse(sqrt_information)) {
    const MatrixXd root = scale.asDiagonal() * *inverse;
    const Factor triangle = kdl_calibration::factor(root, Shape::upper);
    return factor * symmetric_product(triangle, triangle);
  }
  const SingularSystem system = singular_system(sqrt_information);
  VectorXd inverse_squares = VectorXd::Zero(columns);
  VectorXd undetermined = VectorXd::Zero(columns);
  for (Index i = 0; i < columns; ++i) {
    const double value = i < system.values.size() ? system.values[i] : 0.0;
    if (value > kSingular * system.values[0]) {
      inverse_squares[i] = 1.0 / (value * value);
    } else {
      undetermined += system.V.col(i).cwiseAbs2();
    }
  }
  const MatrixXd V = scale.asDiagonal() * system.V;
  MatrixXd result = factor * (V * inverse_squares.asDiagonal() * V.transpose());
  for (Index i = 0; i < columns; ++i) {
    if (undetermined[i] > 1e-6) {
      result(i, i) = std::numeric_limits<double>::infinity();
    }
  }
  return result;
}

MatrixXd sandwich(const MatrixXd& outer, const MatrixXd& middle) {
  MatrixXd finite = outer;
  for (Index i = 0; i < outer.cols(); ++i) {
    if (!std::isfinite(outer(i, i))) {
      finite.row(i).setZero();
      finite.col(i).setZero();
    }
  }
  const MatrixXd half = product(factor(finite), factor(middle).transposed());
  MatrixXd result = product(factor(half), factor(finite).transposed());
  for (Index i = 0; i < outer.cols(); ++i) {
    if (!std::isfinite(outer(i, i))) {
      result(i, i) = outer(i, i);
    }
  }
  return result;
}

MatrixXd undetermined_directions(const MatrixXd& whitened_jacobian) {
  const Index columns = whitened_jacobian.cols();
  if (columns == 0) {
    return {};
  }
  VectorXd scale = unit_scale(whitened_jacobian);
  const MatrixXd sqrt_information = triangular_factor(whitened_jacobian * scale.asDiagonal());
  if (regular_inverse(sqrt_information)) {
    return {columns, 0};
  }
  const SingularSystem system = singular_system(sqrt_information);
  const Index rank = (system.values.array() > kSingular * system.values[0]).count();
  scale = scale.unaryExpr([](double s) { return s > 0.0 ? s : 1.0; });
  return scale.asDiagonal() * system.V.rightCols(columns - rank);
}

MatrixXd covariance(const WhitenedSummary& summary, const ResidualNoise& noise, double unit_weight) {
  const MatrixXd inverse = covariance(summary.sqrt_information, 1.0);
  const double independent = noise.independent * noise.independent * unit_weight;
  const double common = noise.common * noise.common * unit_weight;
  const MatrixXd middle =
      independent * (summary.sqrt_information.transpose() * summary.sqrt_information - summary.priors) +
      common * summary.sums + summary.priors;
  return sandwich(inverse, middle);
}

}  // namespace kdl_calibration
