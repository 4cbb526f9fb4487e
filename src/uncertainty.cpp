#include "kdl_calibration/uncertainty.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

MatrixXd triangular_factor(const MatrixXd& matrix) {
  if (matrix.rows() <= matrix.cols()) {
    return matrix;
  }
  return Eigen::HouseholderQR<MatrixXd>(matrix).matrixQR().topRows(matrix.cols()).triangularView<Eigen::Upper>();
}

}  // namespace

MatrixXd covariance(const MatrixXd& whitened_jacobian, double factor) {
  const Index columns = whitened_jacobian.cols();
  if (columns == 0) {
    return {};
  }
  const VectorXd scale = whitened_jacobian.colwise().norm().transpose().unaryExpr(
      [](double norm) { return norm > 0.0 ? 1.0 / norm : 0.0; });
  const Eigen::JacobiSVD<MatrixXd> svd(triangular_factor(whitened_jacobian * scale.asDiagonal()), Eigen::ComputeFullV);
  VectorXd inverse_squares = VectorXd::Zero(columns);
  VectorXd undetermined = VectorXd::Zero(columns);
  for (Index i = 0; i < columns; ++i) {
    const double value = i < svd.singularValues().size() ? svd.singularValues()[i] : 0.0;
    if (value > 1e-9 * svd.singularValues()[0]) {
      inverse_squares[i] = 1.0 / (value * value);
    } else {
      undetermined += svd.matrixV().col(i).cwiseAbs2();
    }
  }
  const MatrixXd V = scale.asDiagonal() * svd.matrixV();
  MatrixXd result = factor * (V * inverse_squares.asDiagonal() * V.transpose());
  for (Index i = 0; i < columns; ++i) {
    if (undetermined[i] > 1e-6) {
      result(i, i) = std::numeric_limits<double>::infinity();
    }
  }
  return result;
}

Matrix3d predicted_covariance(const ErrorModel& model, const Estimate& estimate, const FreeParameters& free,
                              const MatrixXd& column_covariance, const VectorXd& q, std::size_t target) {
  const Matrix3Xd jacobian = PositionPredictor(model, estimate, free).jacobians(q)[target];
  return jacobian * column_covariance * jacobian.transpose();
}

MatrixXd predicted_sigmas(const ErrorModel& model, const Estimate& estimate, const FreeParameters& free,
                          const MatrixXd& column_covariance, const MatrixXd& joint_values) {
  const PositionPredictor predictor(model, estimate, free);
  MatrixXd sigmas(static_cast<Index>(estimate.targets.size()), joint_values.cols());
  for (Index c = 0; c < joint_values.cols(); ++c) {
    Index k = 0;
    for (const Matrix3Xd& jacobian : predictor.jacobians(joint_values.col(c))) {
      const double variance = (jacobian * column_covariance).cwiseProduct(jacobian).sum();
      sigmas(k++, c) = std::sqrt(variance);
    }
  }
  return sigmas;
}

RepeatNoise noise_from_repeats(const Measurements& measurements) {
  const auto& rows = measurements.observations;
  const auto other_repeat = [&](const Observation& o) { return o.repeat != rows.front().repeat; };
  if (std::none_of(rows.begin(), rows.end(), other_repeat)) {
    return {};
  }
  // Deviations of each repeat from the mean over the repeats, per configuration and target.
  using Repeats = std::map<std::int32_t, Vector3d>;  // repeat -> position
  std::map<std::int32_t, std::map<std::int32_t, Repeats>> cells;
  for (const Observation& o : measurements.observations) {
    if (o.split == Split::train) {
      cells[o.configuration][o.target][o.repeat] = o.position;
    }
  }
  RepeatNoise noise;
  Vector3d squares = Vector3d::Zero();
  Vector3d products = Vector3d::Zero();
  double pairs = 0.0;
  for (auto& [configuration, targets] : cells) {
    for (auto& [target, repeats] : targets) {
      Vector3d mean = Vector3d::Zero();
      for (const auto& [repeat, position] : repeats) {
        mean += position / static_cast<double>(repeats.size());
      }
      for (auto& [repeat, position] : repeats) {
        position -= mean;
        squares += position.cwiseAbs2();
      }
      noise.degrees_of_freedom += static_cast<double>(repeats.size()) - 1.0;
    }
    for (auto first = targets.begin(); first != targets.end(); ++first) {
      for (auto second = std::next(first); second != targets.end(); ++second) {
        double common = 0.0;
        for (const auto& [repeat, deviation] : first->second) {
          if (const auto other = second->second.find(repeat); other != second->second.end()) {
            products += deviation.cwiseProduct(other->second);
            common += 1.0;
          }
        }
        pairs += std::max(common - 1.0, 0.0);
      }
    }
  }
  if (noise.degrees_of_freedom == 0.0) {
    return noise;
  }
  const Vector3d variance = squares / noise.degrees_of_freedom;
  noise.total = variance.cwiseSqrt();
  noise.separable = pairs > 0.0;
  const Vector3d shared =
      noise.separable ? Vector3d((products / pairs).cwiseMax(0.0).cwiseMin(variance)) : Vector3d(Vector3d::Zero());
  noise.common = shared.cwiseSqrt();
  noise.independent = (variance - shared).cwiseSqrt();
  return noise;
}

double f_upper_tail(double f, double a, double b) {
  if (!(f > 0.0)) {
    return 1.0;
  }
  // P(F > f) = I_x(b/2, a/2) with x = b / (b + a f).
  double p = b / 2.0;
  double q = a / 2.0;
  double x = b / (b + a * f);
  const bool swap = x > (p + 1.0) / (p + q + 2.0);
  if (swap) {
    std::swap(p, q);
    x = 1.0 - x;
  }
  // Lentz's method.
  const double tiny = 1e-300;
  double c = 1.0;
  double d = 1.0 / std::max(std::abs(1.0 - (p + q) * x / (p + 1.0)), tiny);
  double value = d;
  for (int m = 1; m < 10000; ++m) {
    const double even = m * (q - m) * x / ((p + 2.0 * m - 1.0) * (p + 2.0 * m));
    const double odd = -(p + m) * (p + q + m) * x / ((p + 2.0 * m) * (p + 2.0 * m + 1.0));
    double change = 1.0;
    for (const double term : {even, odd}) {
      d = 1.0 + term * d;
      d = 1.0 / (std::abs(d) < tiny ? tiny : d);
      c = 1.0 + term / c;
      c = std::abs(c) < tiny ? tiny : c;
      change = c * d;
      value *= change;
    }
    if (std::abs(change - 1.0) < 1e-15) {
      break;
    }
  }
  const double log_front = std::lgamma(p + q) - std::lgamma(p) - std::lgamma(q) + p * std::log(x) + q * std::log1p(-x);
  const double tail = std::exp(log_front) * value / p;
  return swap ? 1.0 - tail : tail;
}

std::vector<double> explained_by_joints(const ErrorModel& model, const Estimate& estimate,
                                        const Measurements& measurements) {
  const Measurements means = averaged(measurements);
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, means.joint_values);
  std::vector<const Observation*> rows;
  for (const Observation& o : means.observations) {
    if (o.split == Split::train) {
      rows.push_back(&o);
    }
  }
  const auto n = static_cast<Index>(rows.size());
  Eigen::MatrixX3d residuals(n, 3);
  for (Index r = 0; r < n; ++r) {
    const Observation& o = *rows[static_cast<std::size_t>(r)];
    residuals.row(r) =
        o.position - estimate.X_WB * (X_BF[static_cast<std::size_t>(o.configuration)] *
                                      estimate.targets[static_cast<std::size_t>(o.target)].X_FT.translation());
  }
  const double total = residuals.squaredNorm();
  std::vector<double> explained;
  for (Index j = 0; j < means.joint_values.rows(); ++j) {
    MatrixXd terms(n, 3);
    for (Index r = 0; r < n; ++r) {
      const double q = means.joint_values(j, rows[static_cast<std::size_t>(r)]->configuration);
      terms.row(r) << 1.0, std::sin(q), std::cos(q);
    }
    const MatrixXd fitted = terms * terms.completeOrthogonalDecomposition().solve(residuals);
    explained.push_back(total > 0.0 ? 1.0 - (residuals - fitted).squaredNorm() / total : 0.0);
  }
  return explained;
}

double ResidualNoise::total() const { return std::hypot(independent, common); }

ResidualNoise noise_from_residuals(const WhitenedSystem& system, int rank, double unit_weight) {
  return noise_from_residuals(summarised(system), rank, unit_weight);
}

ResidualNoise noise_from_residuals(const WhitenedSummary& summary, int rank, double unit_weight) {
  const double squares = summary.squares;
  const double products = (summary.squares_of_sums - squares) / 2.0;
  const double pairs = summary.pairs;
  const auto coordinates = static_cast<double>(summary.measured_rows);
  ResidualNoise noise;
  noise.degrees_of_freedom = coordinates - rank;
  if (noise.degrees_of_freedom <= 0.0) {
    return noise;
  }
  const double lost = coordinates / noise.degrees_of_freedom / unit_weight;
  const double variance = squares / coordinates * lost;
  const double shared = pairs > 0.0 ? std::clamp(products / pairs * lost, 0.0, variance) : 0.0;
  noise.common = std::sqrt(shared);
  noise.independent = std::sqrt(variance - shared);
  return noise;
}

MatrixXd covariance(const WhitenedSystem& system, const ResidualNoise& noise, double unit_weight) {
  return covariance(summarised(system), noise, unit_weight);
}

MatrixXd covariance(const WhitenedSummary& summary, const ResidualNoise& noise, double unit_weight) {
  const MatrixXd inverse = covariance(summary.triangle, 1.0);
  const Index columns = summary.triangle.cols();
  const double independent = noise.independent * noise.independent * unit_weight;
  const double common = noise.common * noise.common * unit_weight;
  const MatrixXd priors = summary.priors.asDiagonal();
  MatrixXd middle =
      independent * (summary.triangle.transpose() * summary.triangle - priors) + common * summary.sums + priors;
  // Undetermined columns carry an infinite variance that must not spread.
  MatrixXd finite = inverse;
  for (Index i = 0; i < columns; ++i) {
    if (!std::isfinite(finite(i, i))) {
      finite.row(i).setZero();
      finite.col(i).setZero();
    }
  }
  MatrixXd result = finite * middle * finite;
  for (Index i = 0; i < columns; ++i) {
    if (!std::isfinite(inverse(i, i))) {
      result(i, i) = inverse(i, i);
    }
  }
  return result;
}

ObservabilityIndices observability_indices(const MatrixXd& jacobian, Index configurations) {
  ObservabilityIndices indices;
  if (jacobian.size() == 0) {
    return indices;
  }
  const VectorXd s = triangular_factor(jacobian).jacobiSvd().singularValues();
  const double smallest = s.size() < jacobian.cols() ? 0.0 : s[s.size() - 1];
  if (!(smallest > 0.0)) {
    return indices;
  }
  indices.O1 = std::exp(s.array().log().mean()) / std::sqrt(static_cast<double>(configurations));
  indices.O2 = smallest / s[0];
  indices.O3 = smallest;
  indices.O4 = smallest * smallest / s[0];
  indices.O5 = 1.0 / s.cwiseInverse().sum();
  return indices;
}

}  // namespace kdl_calibration
