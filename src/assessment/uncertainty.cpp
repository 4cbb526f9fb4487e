#include "kdl_calibration/uncertainty.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <utility>

#include "kdl_calibration/kinematics.hpp"

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

constexpr double kSingular = 1e-9;  // of the largest singular value of columns scaled to unit norm

// One over the columns' norms.
VectorXd unit_scale(const MatrixXd& jacobian) {
  return jacobian.colwise().norm().transpose().unaryExpr([](double norm) { return norm > 0.0 ? 1.0 / norm : 0.0; });
}

}  // namespace

MatrixXd covariance(const MatrixXd& whitened_jacobian, double factor) {
  const Index columns = whitened_jacobian.cols();
  if (columns == 0) {
    return {};
  }
  const VectorXd scale = unit_scale(whitened_jacobian);
  const Eigen::JacobiSVD<MatrixXd> svd(triangular_factor(whitened_jacobian * scale.asDiagonal()), Eigen::ComputeFullV);
  VectorXd inverse_squares = VectorXd::Zero(columns);
  VectorXd undetermined = VectorXd::Zero(columns);
  for (Index i = 0; i < columns; ++i) {
    const double value = i < svd.singularValues().size() ? svd.singularValues()[i] : 0.0;
    if (value > kSingular * svd.singularValues()[0]) {
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

MatrixXd undetermined_directions(const MatrixXd& whitened_jacobian) {
  const Index columns = whitened_jacobian.cols();
  if (columns == 0) {
    return {};
  }
  VectorXd scale = unit_scale(whitened_jacobian);
  const Eigen::JacobiSVD<MatrixXd> svd(triangular_factor(whitened_jacobian * scale.asDiagonal()), Eigen::ComputeFullV);
  const Index rank = (svd.singularValues().array() > kSingular * svd.singularValues()[0]).count();
  scale = scale.unaryExpr([](double s) { return s > 0.0 ? s : 1.0; });
  return scale.asDiagonal() * svd.matrixV().rightCols(columns - rank);
}

// |x| of x = C^(1/2) z, with z = rho v, is below r with the mean over the directions v of P(rho < r / |C^(1/2) v|).
double radius_of_probability(const Matrix3d& covariance, double probability) {
  const Vector3d variances =
      Eigen::SelfAdjointEigenSolver<Matrix3d>(covariance, Eigen::EigenvaluesOnly).eigenvalues().cwiseMax(0.0);
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
  const auto inside = [&](double r) {
    double sum = 0.0;
    for (const double length : lengths) {
      const double t = length > 0.0 ? std::min(r / length, 40.0) : 40.0;
      sum += std::erf(t / std::numbers::sqrt2) - std::sqrt(2.0 / std::numbers::pi) * t * std::exp(-0.5 * t * t);
    }
    return sum / static_cast<double>(lengths.size());
  };
  double below = 0.0;
  double above = 40.0 * std::sqrt(variances.maxCoeff());
  for (int halving = 0; halving < 50; ++halving) {
    const double middle = 0.5 * (below + above);
    (inside(middle) < probability ? below : above) = middle;
  }
  return above;
}

Matrix3d predicted_covariance(const ErrorModel& model, const Estimate& estimate, const FreeParameters& free,
                              const MatrixXd& column_covariance, const VectorXd& q, std::size_t target) {
  const Matrix3Xd jacobian = PositionPredictor(model, estimate, free).jacobians(q)[target];
  return jacobian * column_covariance * jacobian.transpose();
}

namespace {

// Scatter of the measured orientations about their mean.
void add_orientation_scatter(const Measurements& measurements, RepeatNoise& noise) {
  const auto has_orientation = [](const Eigen::Quaterniond& q) { return !std::isnan(q.w()); };
  const Measurements means = averaged(measurements);
  std::map<std::pair<std::int32_t, std::int32_t>, std::pair<Eigen::Quaterniond, int>> cells;
  for (std::size_t row = 0; row < means.orientations.size(); ++row) {
    const Observation& o = means.observations[row];
    cells[{o.configuration, o.target}] = {means.orientations[row], 0};
  }
  double squares = 0.0;
  for (std::size_t row = 0; row < measurements.orientations.size(); ++row) {
    const Observation& o = measurements.observations[row];
    const Eigen::Quaterniond& measured = measurements.orientations[row];
    if (o.split == Split::train && has_orientation(measured)) {
      auto& [mean, count] = cells[{o.configuration, o.target}];
      squares += rotation_log((mean.conjugate() * measured).toRotationMatrix()).squaredNorm();
      noise.orientation_degrees_of_freedom += ++count > 1 ? 1.0 : 0.0;
    }
  }
  if (noise.orientation_degrees_of_freedom > 0.0) {
    noise.orientation = std::sqrt(squares / (3.0 * noise.orientation_degrees_of_freedom));
  }
}

}  // namespace

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
  add_orientation_scatter(measurements, noise);
  return noise;
}

namespace {

// std::lgamma writes the sign to a variable that all threads share.
double log_gamma(double x) {
  int sign = 0;
  return ::lgamma_r(x, &sign);
}

}  // namespace

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
  const double log_front = log_gamma(p + q) - log_gamma(p) - log_gamma(q) + p * std::log(x) + q * std::log1p(-x);
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

// ---- influence -----------------------------------------------------------------------------------------------------

namespace {

// The training rows of each configuration by themselves.
std::vector<std::pair<std::int32_t, std::vector<std::size_t>>> rows_by_configuration(const Measurements& measurements) {
  std::map<std::int32_t, std::vector<std::size_t>> rows;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    if (measurements.observations[row].split == Split::train) {
      rows[measurements.observations[row].configuration].push_back(row);
    }
  }
  return {rows.begin(), rows.end()};
}

// One configuration of the whitened system: J_c R^-1, e_c, and U of its information U^T U, whose columns are those of
// its points' coordinates.
struct ConfigurationSystem {
  MatrixXd B;
  VectorXd e;
  MatrixXd U;
  std::vector<std::int32_t> targets;
  std::vector<std::vector<Index>> rows;  // of each point
};

ConfigurationSystem configuration_system(const ErrorModel& model, const Measurements& measurements,
                                         const std::vector<std::size_t>& rows, const Estimate& estimate,
                                         const FreeParameters& free, const ResidualOptions& residuals,
                                         const MatrixXd& R) {
  Measurements single{.source = measurements.source, .joints = measurements.joints, .targets = measurements.targets};
  single.joint_values = measurements.joint_values.col(measurements.observations[rows.front()].configuration);
  single.configurations = {""};
  ResidualOptions single_residuals = residuals;
  single_residuals.row_weights.clear();
  std::map<std::int32_t, bool> oriented;  // of each target
  for (const std::size_t row : rows) {
    single.observations.push_back(measurements.observations[row]);
    single.observations.back().configuration = 0;
    bool& with_orientation = oriented[measurements.observations[row].target];
    if (!measurements.orientations.empty()) {
      single.orientations.push_back(measurements.orientations[row]);
      with_orientation = with_orientation || !std::isnan(measurements.orientations[row].w());
    }
    if (!residuals.row_weights.empty()) {
      single_residuals.row_weights.push_back(residuals.row_weights[row]);
    }
  }
  // With every target free its columns are those of U.
  FreeParameters all = free;
  const Index chain = R.cols() - [&] {
    Index count = 0;
    for (const auto& target : free.targets) {
      count += std::count(target.begin(), target.end(), true);
    }
    return count;
  }();
  std::vector<Index> estimated(static_cast<std::size_t>(chain));
  for (Index c = 0; c < chain; ++c) {
    estimated[static_cast<std::size_t>(c)] = c;
  }
  std::vector<Index> positions;
  std::vector<Index> orientations;
  ConfigurationSystem result;
  for (std::size_t k = 0; k < free.targets.size(); ++k) {
    const auto seen = oriented.find(static_cast<std::int32_t>(k));
    if (seen != oriented.end()) {
      result.targets.push_back(seen->first);
    }
    for (std::size_t i = 0; i < 6; ++i) {
      all.targets[k][i] = true;
      const auto column = chain + static_cast<Index>(6 * k + i);
      if (free.targets[k][i]) {
        estimated.push_back(column);
      }
      if (seen != oriented.end() && (i < 3 || seen->second)) {
        (i < 3 ? positions : orientations).push_back(column);
      }
    }
  }
  Index orientation_row = 3 * static_cast<Index>(result.targets.size());
  for (std::size_t i = 0; i < result.targets.size(); ++i) {
    const auto first = static_cast<Index>(3 * i);
    std::vector<Index>& own = result.rows.emplace_back(std::vector<Index>{first, first + 1, first + 2});
    if (oriented[result.targets[i]]) {
      own.insert(own.end(), {orientation_row, orientation_row + 1, orientation_row + 2});
      orientation_row += 3;
    }
  }
  const WhitenedSystem system = LeastSquaresProblem(model, single, all, single_residuals).whitened(estimate);
  const Index measured = system.blocks.back();
  positions.insert(positions.end(), orientations.begin(), orientations.end());
  result.U = system.jacobian.topRows(measured)(Eigen::all, positions);
  result.e = system.residual.head(measured);
  const MatrixXd jacobian = system.jacobian.topRows(measured)(Eigen::all, estimated);
  const MatrixXd transposed = R.triangularView<Eigen::Upper>().transpose().solve(MatrixXd(jacobian.transpose()));
  result.B = transposed.transpose();
  return result;
}

// Cook's distance times p s^2 of leaving out the coordinates whose whitened unit vectors are the columns of G.
double change_without(const ConfigurationSystem& system, const MatrixXd& rest, const MatrixXd& G) {
  const Eigen::LDLT<MatrixXd> left(G.transpose() * rest * G);
  const VectorXd own = (G.transpose() * G).diagonal();
  if (!(left.vectorD().minCoeff() > kSingular * own.maxCoeff())) {
    return std::numeric_limits<double>::infinity();
  }
  return (system.B.transpose() * (G * left.solve(G.transpose() * system.e))).squaredNorm();
}

}  // namespace

Influence influence(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                    const FreeParameters& free, const ResidualOptions& residuals, const MatrixXd& triangle) {
  Influence result;
  const Index columns = triangle.cols();
  if (triangle.rows() < columns || columns == 0) {
    return result;
  }
  const MatrixXd R =
      Eigen::HouseholderQR<MatrixXd>(triangle).matrixQR().topRows(columns).triangularView<Eigen::Upper>();
  if (!(R.diagonal().cwiseAbs().cwiseProduct(unit_scale(triangle)).minCoeff() > kSingular)) {
    return result;
  }
  double squares = 0.0;
  double decided = 0.0;  // by the measurements, not by priors
  double coordinates = 0.0;
  double points = 0.0;
  for (const auto& [configuration, rows] : rows_by_configuration(measurements)) {
    const ConfigurationSystem system = configuration_system(model, measurements, rows, estimate, free, residuals, R);
    const Index m = system.e.size();
    const MatrixXd H = system.B * system.B.transpose();
    const MatrixXd rest = MatrixXd::Identity(m, m) - H;
    const VectorXd leverages = system.U.partialPivLu().solve(MatrixXd(H * system.U)).diagonal();
    ConfigurationInfluence& entry = result.configurations.emplace_back();
    entry.configuration = configuration;
    entry.leverage = H.trace();
    entry.cook = change_without(system, rest, MatrixXd::Identity(m, m));
    entry.coordinates = static_cast<int>(m);
    for (std::size_t i = 0; i < system.targets.size(); ++i) {
      entry.points.push_back({.target = system.targets[i],
                              .coordinates = static_cast<int>(system.rows[i].size()),
                              .leverage = leverages(system.rows[i]).sum(),
                              .cook = change_without(system, rest, system.U(Eigen::all, system.rows[i]))});
    }
    squares += system.e.squaredNorm();
    decided += entry.leverage;
    coordinates += static_cast<double>(m);
    points += static_cast<double>(system.targets.size());
  }
  const double freedom = coordinates - decided;
  const double unit = freedom > 0.0 ? decided * squares / freedom : 0.0;
  result.leverage_limit = 2.0 * decided / coordinates;
  result.cook_limit = 4.0 / static_cast<double>(result.configurations.size());
  result.point_cook_limit = 4.0 / points;
  const auto judge = [&](auto& entry, double cook_limit) {
    entry.cook = unit > 0.0 ? entry.cook / unit : 0.0;
    entry.high_leverage = entry.leverage > entry.coordinates * result.leverage_limit;
    entry.influential = entry.cook > cook_limit;
  };
  for (ConfigurationInfluence& entry : result.configurations) {
    judge(entry, result.cook_limit);
    for (PointInfluence& point : entry.points) {
      judge(point, result.point_cook_limit);
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
