#include "calibration/noise_report.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/dense.hpp"
#include "base/distributions.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"
#include "noise/lack_of_fit.hpp"
#include "noise/noise_components.hpp"
#include "noise/pseudo_values.hpp"
#include "uncertainty/covariance.hpp"

namespace kdl_calibration {
bool noise_is_stated(const Measurements& measurements, const NoiseModel& stated) {
  return stated.is_absolute() || std::any_of(measurements.observations.begin(), measurements.observations.end(),
                                             [](const Observation& observation) { return observation.sigma > 0.0; });
}

double sigma_of_residuals(const FitProblem& fit) {
  const JointOptions& joint = fit.options.joint;
  const LeastSquaresProblem problem(fit.model, fit.measurements, fit.free, joint.residuals);
  const Identification plain = identify_jointly(fit.model, fit.measurements, fit.start, fit.free, joint);
  const double freedom = static_cast<double>(problem.equations() - problem.columns());
  const double variance = problem.linearise(plain.estimate).cost / std::max(freedom, 1.0);
  return std::max(std::sqrt(variance), 1e-9);
}

namespace {

// Ratio of this variance to the stated one; 1 if the excess is not significant.
double excess_over_stated(double variance, double degrees_of_freedom) {
  const bool worse = degrees_of_freedom > 0.0 && variance > 1.0 &&
                     reduced_chi_squared_tail(variance, degrees_of_freedom) < kMisfitCertain;
  return worse ? variance : 1.0;
}

void report_parts(const NoiseParts& parts, NoiseReport& noise) {
  noise.source = NoiseSource::parts;
  noise.sigma = std::sqrt(parts.point().trace() / 3.0);
  noise.misfit = std::sqrt(parts.misfit());
  noise.target_misfit = std::sqrt(parts.target_misfit());
  noise.common = parts.common().cwiseSqrt();
  noise.independent = parts.independent().cwiseSqrt();
  noise.degrees_of_freedom = parts.degrees_of_freedom;
  noise.parts = parts;
}

// An observation with the factors 1.
Observation without_factors(Observation observation) {
  observation.noise = {};
  return observation;
}

// Stated sigma of a point along the axes of W, root mean square over the rows, without the factors of stations.
Eigen::Vector3d stated_sigma_of_points(const Measurements& measurements, const NoiseModel& noise) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double rows = 0.0;
  for (const Observation& o : measurements.observations) {
    sum += point_covariance(noise, without_factors(o)).diagonal();
    rows += 1.0;
  }
  return (sum / rows).cwiseSqrt();
}

// Mean over the rows of 1 / factor^2.
double mean_information(const Measurements& measurements) {
  double sum = 0.0;
  for (const Observation& o : measurements.observations) {
    sum += 1.0 / (o.noise.length * o.noise.length);
  }
  return sum / static_cast<double>(measurements.observations.size());
}

// What the priors contribute: their part of the cost, and the number of unknowns that they determine instead of the
// measurements, the trace of their share of the information.
struct PriorShare {
  double cost = 0.0;
  double unknowns = 0.0;
};

PriorShare prior_share(const FittedSystem& fitted, const ResidualOptions& options,
                       const Eigen::MatrixXd& unit_covariance) {
  const Eigen::VectorXd information = fitted.free.prior_information(options.priors);
  if (options.earlier || information.isZero(0.0)) {
    return {};
  }
  const Eigen::VectorXd shares = information.cwiseProduct(unit_covariance.diagonal());
  return {.cost = information.dot(fitted.free.values(fitted.estimate).cwiseAbs2()),
          .unknowns = (information.array() > 0.0).select(shares, 0.0).sum()};
}

// Scatter of a system's residuals.
struct MeasuredScatter {
  double points = 0.0;    // with weight
  double variance = 0.0;  // of unit weight
  double factor = 1.0;    // additional factor on the covariance
};

// Covariance and report for stated noise, or else for the noise of this system's residuals.
NoiseAssessment without_parts(const Measurements& measurements, const NoiseModel& stated, const FittedSystem& fitted,
                              const MeasuredScatter& scatter, NoiseReport noise) {
  NoiseAssessment result;
  const auto [points, variance, factor] = scatter;
  const LeastSquaresProblem& problem = fitted.problem;
  if (noise_is_stated(measurements, stated)) {
    noise.source = NoiseSource::stated;
    noise.independent = stated_sigma_of_points(measurements, stated);
    noise.common = stated.common;
    noise.sigma = std::sqrt(points / problem.total_weight());
    result.covariance = covariance(fitted.system.sqrt_information, factor * noise.variance_factor);
  } else {
    noise.source = NoiseSource::residuals;
    noise.sigma = std::sqrt(variance * points * mean_information(measurements) / problem.total_weight());
    if (has_single_coordinates(measurements)) {
      noise.independent.setConstant(noise.sigma);
      result.covariance = covariance(fitted.system.sqrt_information, factor * variance);
      result.report = std::move(noise);
      return result;
    }
    // Noise of the means, which includes the part common to a configuration.
    const double cells = static_cast<double>(fitted.system.measured_rows) / 3.0;
    const double unit_weight = problem.total_weight() / cells;
    const ResidualNoise components = noise_from_residuals(fitted.system, fitted.rank, unit_weight);
    noise.independent.setConstant(components.independent / std::sqrt(factor));
    noise.misfit = components.common / std::sqrt(factor);
    result.covariance = has_orientations(measurements) ? covariance(fitted.system.sqrt_information, factor * variance)
                                                       : covariance(fitted.system, components, unit_weight);
  }
  result.report = std::move(noise);
  return result;
}

// The robust fit as a least squares fit of its pseudo-values. The noise is that of the inliers: from the median,
// corrected for the degrees of freedom of the fit.
NoiseAssessment assess_robust_noise(const FittedSystem& fitted, const FitProblem& fit, const NoiseModel& stated,
                                    const RobustRows& robust, NoiseReport noise) {
  constexpr double kEfficiencyOfMedian = 0.53;  // of the scale, for normal errors in three dimensions
  const PseudoValues pseudo =
      pseudo_values(fit.model, fit.measurements, fitted.estimate, fit.options.loss, robust.weights);
  ResidualOptions residuals = fit.options.joint.residuals;
  residuals.row_weights = pseudo.row_weights;
  const LeastSquaresProblem problem(fit.model, pseudo.measurements, fitted.free, residuals);
  const WhitenedSummary system = problem.whitened_summary(fitted.estimate);
  const double without_weight = static_cast<double>(problem.points()) - pseudo.rows;
  const double freedom = std::max(noise.degrees_of_freedom - 3.0 * without_weight, 1.0);
  const double left = freedom / (freedom + fitted.rank);
  const double variance = robust.scale * robust.scale / left;
  const double reduced = problem.linearise(fitted.estimate).cost / freedom;
  if (noise_is_stated(fit.measurements, stated)) {
    noise.variance_factor = excess_over_stated(variance, kEfficiencyOfMedian * freedom);
  }
  return without_parts(fit.measurements, stated,
                       {.problem = problem,
                        .estimate = fitted.estimate,
                        .free = fitted.free,
                        .system = system,
                        .row_weights = residuals.row_weights,
                        .rank = fitted.rank},
                       {.points = pseudo.rows, .variance = variance, .factor = reduced / variance}, std::move(noise));
}

}  // namespace

NoiseAssessment assess_noise(const FittedSystem& fitted, const FitProblem& fit, const NoiseModel& stated,
                             const RobustRows& robust, const EstimatedNoise& estimated) {
  NoiseReport noise;
  noise.degrees_of_freedom = static_cast<double>(fitted.problem.equations() - fitted.rank);
  const RepeatNoise repeats = noise_from_repeats(fit.measurements);
  if (repeats.degrees_of_freedom > 0.0) {
    noise.repeats = repeats;
  }
  const auto own_sigma = [](const Observation& o) { return o.sigma > 0.0; };
  const std::vector<Observation>& rows = fit.measurements.observations;
  if (std::none_of(rows.begin(), rows.end(), own_sigma)) {
    noise.tracker = stated.tracker;
  }
  if (!robust.weights.empty()) {
    return assess_robust_noise(fitted, fit, stated, robust, std::move(noise));
  }
  const Eigen::MatrixXd unit_covariance = covariance(fitted.system.sqrt_information, 1.0);
  const PriorShare priors = prior_share(fitted, fit.options.joint.residuals, unit_covariance);
  noise.degrees_of_freedom += priors.unknowns;
  const double freedom = std::max(noise.degrees_of_freedom, 1.0);
  if (noise_is_stated(fit.measurements, stated)) {
    ResidualOptions as_stated = estimated.as_stated;
    as_stated.row_weights = fitted.row_weights;
    const LeastSquaresProblem problem(fit.model, fit.measurements, fitted.free, as_stated);
    noise.variance_factor =
        excess_over_stated((problem.linearise(fitted.estimate).cost - priors.cost) / freedom, noise.degrees_of_freedom);
  }
  if (estimated.parts) {
    report_parts(*estimated.parts, noise);
    for (const Eigen::MatrixXd& sensitivity : estimated.parts->sensitivity) {
      noise.covariance_derivatives.push_back(sensitivity.size() > 0 ? sandwich(unit_covariance, sensitivity)
                                                                    : Eigen::MatrixXd());
    }
    const Eigen::MatrixXd& scatter = estimated.parts->scatter;
    return {.report = std::move(noise),
            .covariance = scatter.size() > 0 ? sandwich(unit_covariance, scatter) : unit_covariance};
  }
  const double variance =
      noise.degrees_of_freedom > 0.0 ? (fitted.problem.linearise(fitted.estimate).cost - priors.cost) / freedom : 0.0;
  return without_parts(fit.measurements, stated, fitted,
                       {.points = static_cast<double>(fitted.problem.points()), .variance = variance},
                       std::move(noise));
}

double variance_of_unit_weight(const Eigen::MatrixXd& sqrt_information, const Eigen::MatrixXd& covariance) {
  const bool determined = covariance.cols() > 0 && covariance.diagonal().allFinite();
  return determined ? product(factor(sqrt_information), factor(covariance)).cwiseProduct(sqrt_information).sum() /
                          static_cast<double>(covariance.cols())
                    : 1.0;
}

double NoiseReport::freedom_of_covariance() const {
  return source == NoiseSource::stated && variance_factor == 1.0 ? std::numeric_limits<double>::infinity()
                                                                 : degrees_of_freedom;
}

double NoiseReport::sigma_at(std::size_t station) const {
  const double factor = stations.empty() ? 1.0 : stations[station].length;
  const double shared = misfit * misfit + target_misfit * target_misfit + common.squaredNorm() / 3.0;
  return std::sqrt(factor * factor * independent.squaredNorm() / 3.0 + shared);
}

const char* to_string(NoiseSource source) {
  return source == NoiseSource::parts ? "parts" : source == NoiseSource::stated ? "stated" : "residuals";
}

std::optional<LackOfFit> lack_of_fit(const ErrorModel& model, const Measurements& measurements,
                                     const Estimate& estimate, const Unknowns& free) {
  if (has_single_coordinates(measurements)) {
    return std::nullopt;
  }
  std::optional<LackOfFit> result = test_lack_of_fit(model, measurements, estimate, free);
  if (result) {
    result->explained_by_joint = explained_by_joints(model, estimate, measurements);
  }
  return result;
}

}  // namespace kdl_calibration
