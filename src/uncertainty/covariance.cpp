#include "uncertainty/covariance.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "base/decompositions.hpp"
#include "base/dense.hpp"
#include "base/preconditions.hpp"
#include "base/singular_values.hpp"
#include "model/kinematics.hpp"
#include "uncertainty/unit_columns.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
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

// For x = C^(1/2) z with z = rho v, P(|x| < r) is the mean over the directions v of P(rho < r / |C^(1/2) v|).
double radius_of_probability(const Matrix3d& covariance, double probability) {
  const Vector3d variances = eigenvalues(covariance).cwiseMax(0.0);
  constexpr int kSteps = 40;  // midpoint rule over an octant
  std::vector<double> lengths;
  for (int i = 0; i < kSteps; ++i) {
    const double z = (i + 0.5) / kSteps;
    for (int j = 0; j < kSteps; ++j) {
      const double angle = (j + 0.5) / kSteps * std::numbers::pi / 2.0;
      const Vector3d v2((1.0 - z * z) * std::pow(std::cos(angle), 2), (1.0 - z * z) * std::pow(std::sin(angle), 2),
                        z * z);
      lengths.push_back(std::sqrt(v2.dot(variances)));
    }
  }
  double below = 0.0;
  double above = 40.0 * std::sqrt(variances.maxCoeff());
  double r = 2.0 * std::sqrt(variances.sum());
  for (int step = 0; step < 60 && above - below > 1e-15 * above; ++step) {
    double inside = 0.0;
    double density = 0.0;  // derivative of the probability by r
    for (const double length : lengths) {
      const double t = length > 0.0 ? std::min(r / length, 40.0) : 40.0;
      const double bell = std::sqrt(2.0 / std::numbers::pi) * t * std::exp(-0.5 * t * t);
      inside += std::erf(t / std::numbers::sqrt2) - bell;
      density += length > 0.0 ? t * bell / length : 0.0;
    }
    const double missing = probability * static_cast<double>(lengths.size()) - inside;
    (missing > 0.0 ? below : above) = r;
    const double next = r + missing / density;
    if (std::abs(next - r) <= 1e-12 * r) {
      return next;
    }
    r = next > below && next < above ? next : 0.5 * (below + above);
  }
  return r;
}

Matrix3d predicted_covariance(const PositionPredictor& predictor, const MatrixXd& column_covariance, const VectorXd& q,
                              std::size_t target) {
  const std::vector<Matrix3Xd> jacobians = predictor.jacobians(q);
  require_index("the target", target, jacobians.size());
  const Matrix3Xd& jacobian = jacobians[target];
  require_count("columns of a covariance", column_covariance.cols(), jacobian.cols());
  require_count("rows of a covariance", column_covariance.rows(), jacobian.cols());
  return jacobian * column_covariance * jacobian.transpose();
}

MatrixXd covariance(const WhitenedSystem& system, const ResidualNoise& noise, double unit_weight) {
  return covariance(summarised(system), noise, unit_weight);
}

MatrixXd covariance(const WhitenedSummary& summary, const ResidualNoise& noise, double unit_weight) {
  const Index columns = summary.sqrt_information.cols();
  require_count("priors of a summary", summary.priors.cols(), columns);
  require_count("columns of a summary's sums", summary.sums.cols(), columns);
  const MatrixXd inverse = covariance(summary.sqrt_information, 1.0);
  const double independent = noise.independent * noise.independent * unit_weight;
  const double common = noise.common * noise.common * unit_weight;
  const MatrixXd middle =
      independent * (summary.sqrt_information.transpose() * summary.sqrt_information - summary.priors) +
      common * summary.sums + summary.priors;
  return sandwich(inverse, middle);
}

}  // namespace kdl_calibration
