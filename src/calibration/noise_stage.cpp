#include "calibration/noise_stage.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <set>
#include <utility>

#include "calibration/noise_report.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"
#include "model/kinematics.hpp"
#include "validation/fold_prediction.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// d rotation_log(R exp([delta])) / d delta at delta = 0, for r = rotation_log(R).
Matrix3d log_derivative(const Vector3d& r) {
  const double angle = r.norm();
  const Matrix3d S = skew(r);
  constexpr double kSmall = 1e-4;
  const double factor = angle < kSmall ? 1.0 / 12.0 + angle * angle / 720.0
                                       : (1.0 - 0.5 * angle / std::tan(0.5 * angle)) / (angle * angle);
  return Matrix3d::Identity() + 0.5 * S + factor * S * S;
}

constexpr double kChanceRatio = 1.1;  // ratio of held-out errors

// Derivatives of a frame's six printed values by its columns.
Eigen::Matrix<double, 6, 6> printed_frame(const Matrix3d& position, const Matrix3d& rotation) {
  Eigen::Matrix<double, 6, 6> result = Eigen::Matrix<double, 6, 6>::Zero();
  result.topLeftCorner<3, 3>() = position;
  result.bottomRightCorner<3, 3>() = log_derivative(rotation_log(rotation));
  return result;
}

// Writes a frame's block into `all`; columns that are not free are -1.
void place(const std::array<int, 6>& columns, const Eigen::Matrix<double, 6, 6>& printed, MatrixXd& all) {
  for (std::size_t i = 0; i < 6; ++i) {
    for (std::size_t j = 0; j < 6; ++j) {
      if (columns[i] >= 0 && columns[j] >= 0) {
        all(columns[i], columns[j]) = printed(static_cast<Index>(i), static_cast<Index>(j));
      }
    }
  }
}

// RMS distance [m] of left-out configurations, at most 500 evenly spaced ones, from their prediction by all others;
// infinite if these are too few. `noise`: [m] 1 sigma of a coordinate.
double held_out_rms(const FitProblem& problem, double noise) {
  constexpr std::size_t kMost = 500;
  const std::vector<std::vector<Index>> all = make_folds(problem.measurements, 0);
  const std::size_t count = std::min(all.size(), kMost);
  std::vector<std::vector<Index>> folds;
  for (std::size_t i = 0; i < count; ++i) {
    folds.push_back(all[i * all.size() / count]);
  }
  if (!can_be_left_out(problem.measurements, folds, problem.free.size())) {
    return std::numeric_limits<double>::infinity();
  }
  return error_statistics(fold_distances(problem, folds, noise, 1)).rms;
}

// Whether the parts' weights predict left-out configurations worse than `plain` by a factor above `allowed`, because
// the misfit has another structure than the parts. Both problems start at their optimum.
bool weights_predict_worse(const FitProblem& weighed, const FitProblem& plain, const NoiseParts& parts,
                           double allowed) {
  const double sigma = std::sqrt(parts.point().trace() / 3.0);
  return !weighed.options.joint.residuals.noise.is_isotropic() &&
         held_out_rms(weighed, sigma) > allowed * held_out_rms(plain, sigma);
}

// The problem with this noise at its optimum; empty if the fit does not converge.
std::optional<FitProblem> weighed_by(const NoiseModel& noise, const FitProblem& plain) {
  FitProblem weighed = plain;
  weighed.options.joint.residuals.noise = noise;
  Identification found = kdl_calibration::fit(weighed);
  if (!has_converged(found)) {
    return std::nullopt;
  }
  weighed.start = std::move(found.estimate);
  return weighed;
}

}  // namespace

std::optional<NoiseModel> weights_by_estimated_noise(const FitProblem& problem, const NoiseBeforehand& noise) {
  if (!noise.estimated) {
    return std::nullopt;
  }
  FitProblem plain = problem;
  plain.options = {.joint = {.residuals = problem.options.joint.residuals}};
  const Identification found = kdl_calibration::fit(plain);
  if (!has_converged(found)) {
    return std::nullopt;
  }
  plain.start = found.estimate;
  const NoiseParts parts =
      estimate_noise(plain.model, plain.measurements, plain.start, plain.free, plain.options.joint.residuals);
  if (!parts.converged) {
    return std::nullopt;
  }
  NoiseModel weights = parts.model(noise.stated);
  if (!weights.is_isotropic()) {
    const std::optional<FitProblem> weighed = weighed_by(weights, plain);
    if (!weighed || weights_predict_worse(*weighed, plain, parts, 1.0)) {
      return std::nullopt;
    }
  }
  return weights;
}

FitOptions absolute_weights(const FitProblem& problem, const NoiseBeforehand& noise) {
  FitOptions options = problem.options;
  NoiseModel& weights = options.joint.residuals.noise;
  if (const std::optional<NoiseModel> estimated = weights_by_estimated_noise(problem, noise)) {
    weights = *estimated;
  } else if (!noise_is_stated(problem.measurements, noise.stated)) {
    weights.independent.setConstant(sigma_of_residuals(problem));
  }
  return options;
}

EstimatedNoise fit_with_estimated_noise(const FitProblem& problem, const NoiseBeforehand& noise, double rms) {
  constexpr double kRounding = 1e-10;  // [m] smaller residuals are rounding
  const ResidualOptions& residuals = problem.options.joint.residuals;
  EstimatedNoise result{
      .parts = std::nullopt, .as_stated = residuals, .weights = residuals.noise, .estimate = problem.start};
  result.as_stated.noise = noise.stated;
  if (!noise.estimated || rms < kRounding) {
    return result;
  }
  FitProblem plain = problem;
  plain.options.after_fit = nullptr;
  NoiseParts parts = estimate_noise(plain.model, plain.measurements, plain.start, plain.free, result.as_stated);
  if (!parts.converged && noise_is_stated(plain.measurements, noise.stated)) {
    return result;
  }
  // With priors, the plain fit already uses weights from an earlier estimate of the noise. The two fits then differ by
  // chance only, so a ratio of 1.1 is tolerated.
  const bool with_priors = prior_rows(plain.free, residuals).rows.rows() > 0;
  const std::optional<FitProblem> weighed =
      parts.converged ? weighed_by(parts.model(noise.stated), plain) : std::nullopt;
  if (!weighed || weights_predict_worse(*weighed, plain, parts, with_priors ? kChanceRatio : 1.0)) {
    const bool misfits = !parts.converged || parts.estimates_misfit();
    parts = noise_beside_weights(plain, noise.stated, misfits);
  } else {
    result.weights = weighed->options.joint.residuals.noise;
    result.estimate = weighed->start;
  }
  if (parts.converged) {
    result.parts = std::move(parts);
  }
  return result;
}

NoiseModel noise_of_means(const Measurements& measurements, const NoiseBeforehand& beforehand, double sigma) {
  constexpr double kBeyond = 0.5;  // of the stated variance; smaller excesses are not significant
  NoiseModel noise = beforehand.stated;
  double variance = 0.0;
  double rows = 0.0;
  for (const Observation& observation : measurements.observations) {
    const double factor = observation.noise.length;
    variance += (point_covariance(noise, observation).trace() / (factor * factor) + noise.common.squaredNorm()) / 3.0;
    rows += 1.0;
  }
  const int means = dimension(averaged(measurements));
  const double repeats = static_cast<double>(dimension(measurements)) / std::max(means, 1);
  if (!noise_is_stated(measurements, noise)) {
    noise.independent.setConstant(sigma * std::sqrt(repeats));
    return noise;
  }
  const double stated = variance / std::max(rows, 1.0) / repeats;
  const double excess = sigma * sigma - stated;
  if (beforehand.estimated && excess > kBeyond * stated) {
    noise.target_misfit = std::hypot(noise.target_misfit, std::sqrt(excess));
  }
  return noise;
}

std::vector<ValueUncertainty> uncertainties(const Estimate& estimate, const Unknowns& free, const MatrixXd& covariance,
                                            const NoiseReport& noise) {
  const Index columns = covariance.cols();
  MatrixXd printed = MatrixXd::Identity(columns, columns);
  for (std::size_t station = 0; station < estimate.frames.bases.size(); ++station) {
    const Matrix3d R_WB = estimate.frames.base(station).linear();
    place(free.base_columns(station), printed_frame(R_WB, R_WB), printed);
  }
  for (std::size_t k = 0; k < estimate.frames.targets.size(); ++k) {
    place(free.target_columns(k), printed_frame(Matrix3d::Identity(), estimate.frames.targets[k].X_FT.linear()),
          printed);
  }
  std::vector<ValueUncertainty> result;
  for (Index c = 0; c < columns; ++c) {
    ValueUncertainty& value = result.emplace_back();
    value.degrees_of_freedom = noise.freedom_of_covariance();
    // Without zero coefficients, so that an infinite variance affects only values that depend on it.
    std::vector<Index> used;
    double variance = 0.0;
    for (Index i = 0; i < columns; ++i) {
      if (printed(c, i) != 0.0) {
        used.push_back(i);
        variance = std::isfinite(covariance(i, i)) ? variance : covariance(i, i);
      }
    }
    const VectorXd row = printed.row(c).transpose()(used);
    const VectorXd along = covariance(used, used) * row;
    variance += row.dot(along.unaryExpr([](double a) { return std::isfinite(a) ? a : 0.0; }));
    value.std = std::sqrt(variance);
    if (noise.parts && std::isfinite(variance)) {
      NoiseParts::Variances gradient = NoiseParts::Variances::Zero();
      for (Index k = 0; k < NoiseParts::kCount; ++k) {
        const MatrixXd& slope = noise.covariance_derivatives[static_cast<std::size_t>(k)];
        gradient[k] = slope.size() > 0 ? row.dot(slope(used, used) * row) : 0.0;
      }
      value.degrees_of_freedom = noise.parts->freedom(variance, gradient);
    }
  }
  return result;
}

}  // namespace kdl_calibration
