#include "calibration/noise_report.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/f_distribution.hpp"
#include "kdl_calibration/covariance.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/lack_of_fit.hpp"
#include "kdl_calibration/noise_components.hpp"
#include "kdl_calibration/pseudo_values.hpp"

namespace kdl_calibration {
namespace {

// Of the repeats' scatter, the least that is taken as the noise of single points along an axis.
constexpr double kLeastShareOfRepeats = 1e-3;

}  // namespace

void require_repeats(const Measurements& measurements) {
  const RepeatNoise repeats = noise_from_repeats(measurements);
  if (repeats.degrees_of_freedom == 0.0) {
    throw OptionError("weights", "noise by repeats needs configurations that were measured more than once, and " +
                                     measurements.source + " has none");
  }
  if (!(repeats.independent.minCoeff() > kLeastShareOfRepeats * repeats.total.maxCoeff())) {
    throw OptionError("weights",
                      "the repeats of single points in " + measurements.source +
                          " do not vary along every axis; state the noise of points by themselves",
                      {"noise.independent"});
  }
}

void require_comparable_orientations(const Measurements& measurements, const CalibrationOptions& options) {
  if (!(options.noise.orientation > 0.0)) {
    return;
  }
  if (measurements.orientations.empty()) {
    throw OptionError("noise.orientation", "no row of " + measurements.source + " has a quaternion");
  }
  const bool every_row = std::all_of(measurements.observations.begin(), measurements.observations.end(),
                                     [](const Observation& observation) { return observation.sigma > 0.0; });
  if (!options.noise.is_absolute() && options.weights != Weights::repeats && !every_row) {
    throw OptionError("noise.orientation",
                      "needs the noise of positions as well: of points by themselves, of the tracker, by repeats or a "
                      "sigma in every row",
                      {"noise.independent", "noise.tracker", "weights"});
  }
}

bool noise_is_stated(const Measurements& measurements, const CalibrationOptions& options) {
  return options.noise.is_absolute() ||
         std::any_of(measurements.observations.begin(), measurements.observations.end(),
                     [](const Observation& observation) { return observation.sigma > 0.0; });
}

void make_absolute(const FitTask& task, const Unknowns& free, FitOptions& options) {
  const LeastSquaresProblem problem(task.model, task.measurements, free, options.joint.residuals);
  const Identification plain = identify_jointly(task.model, task.measurements, task.start, free, options.joint);
  const double freedom = static_cast<double>(problem.equations() - problem.columns());
  const double variance = problem.linearise(plain.estimate).cost / std::max(freedom, 1.0);
  options.joint.residuals.noise.independent.setConstant(std::max(std::sqrt(variance), 1e-9));
}

namespace {

// How often this variance is the stated one; 1 where it may be just that.
double excess_over_stated(double variance, double degrees_of_freedom) {
  const bool worse = degrees_of_freedom > 0.0 && variance > 1.0 &&
                     reduced_chi_squared_tail(variance, degrees_of_freedom) < kMisfitCertain;
  return worse ? variance : 1.0;
}

void report_parts(const NoiseParts& parts, NoiseReport& noise) {
  noise.model = "parts";
  noise.sigma = std::sqrt(parts.point().trace() / 3.0);
  noise.misfit = std::sqrt(parts.misfit());
  noise.target_misfit = std::sqrt(parts.target_misfit());
  noise.common = parts.common().cwiseSqrt();
  noise.independent = parts.independent().cwiseSqrt();
  noise.degrees_of_freedom = parts.degrees_of_freedom;
  noise.parts = parts;
}

// Of a point along the axes of W, root of the mean square over the rows.
Eigen::Vector3d stated_sigma_of_points(const Measurements& measurements, const NoiseModel& noise) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double rows = 0.0;
  for (const Observation& o : measurements.observations) {
    sum += point_covariance(noise, o).diagonal();
    rows += 1.0;
  }
  return (sum / rows).cwiseSqrt();
}

// Of a system's residuals.
struct MeasuredScatter {
  double points = 0.0;    // with weight
  double variance = 0.0;  // of unit weight
  double factor = 1.0;    // of the covariance beside that
};

// The covariance and the report of noise that is stated, or else in the residuals of this system.
NoiseAssessment without_parts(const FitTask& task, const FittedSystem& fitted, const MeasuredScatter& scatter,
                              NoiseReport noise) {
  NoiseAssessment result;
  const auto [points, variance, factor] = scatter;
  const LeastSquaresProblem& problem = fitted.problem;
  if (noise_is_stated(task.measurements, task.options)) {
    noise.model = "stated";
    noise.independent = stated_sigma_of_points(task.measurements, task.options.noise);
    noise.common = task.options.noise.common;
    noise.sigma = std::sqrt(points / problem.total_weight());
    result.covariance = covariance(fitted.system.triangle, factor * noise.variance_factor);
  } else {
    noise.model = "residuals";
    noise.sigma = std::sqrt(variance * points / problem.total_weight());
    // Of the means: what repeats average out does not count, what a configuration has in common does.
    const double cells = static_cast<double>(fitted.system.measured_rows) / 3.0;
    const double unit_weight = problem.total_weight() / cells;
    const ResidualNoise components = noise_from_residuals(fitted.system, fitted.rank, unit_weight);
    noise.independent.setConstant(components.independent / std::sqrt(factor));
    noise.misfit = components.common / std::sqrt(factor);
    result.covariance = task.measurements.orientations.empty() ? covariance(fitted.system, components, unit_weight)
                                                               : covariance(fitted.system.triangle, factor * variance);
  }
  result.report = std::move(noise);
  return result;
}

// The robust fit as the plain one of its pseudo-values. The noise is that of the points that are not outlying: by the
// median, which an outlier hardly moves, with what the fit has taken from it.
NoiseAssessment assess_robust_noise(const FitTask& task, const FittedSystem& fitted, const RobustRows& robust,
                                    NoiseReport noise) {
  constexpr double kEfficiencyOfMedian = 0.53;  // of the scale of normal points in three dimensions
  const PseudoValues pseudo =
      pseudo_values(task.model, task.measurements, fitted.estimate, task.fit_options.loss, robust.weights);
  ResidualOptions residuals = task.fit_options.joint.residuals;
  residuals.row_weights = pseudo.row_weights;
  const LeastSquaresProblem problem(task.model, pseudo.measurements, fitted.free, residuals);
  const WhitenedSummary system = problem.whitened_summary(fitted.estimate);
  const double without_weight = static_cast<double>(problem.points()) - pseudo.rows;
  const double freedom = std::max(noise.degrees_of_freedom - 3.0 * without_weight, 1.0);
  const double left = freedom / (freedom + fitted.rank);
  const double variance = robust.scale * robust.scale / left;
  const double reduced = problem.linearise(fitted.estimate).cost / freedom;
  if (noise_is_stated(task.measurements, task.options)) {
    noise.variance_factor = excess_over_stated(variance, kEfficiencyOfMedian * freedom);
  }
  return without_parts(task,
                       {.problem = problem,
                        .estimate = fitted.estimate,
                        .free = fitted.free,
                        .system = system,
                        .row_weights = residuals.row_weights,
                        .rank = fitted.rank},
                       {.points = pseudo.rows, .variance = variance, .factor = reduced / variance}, std::move(noise));
}

}  // namespace

NoiseAssessment assess_noise(const FitTask& task, const FittedSystem& fitted, const RobustRows& robust,
                             const EstimatedNoise& estimated) {
  NoiseReport noise;
  noise.degrees_of_freedom = static_cast<double>(fitted.problem.equations() - fitted.rank);
  const RepeatNoise repeats = noise_from_repeats(task.measurements);
  if (repeats.degrees_of_freedom > 0.0) {
    noise.repeats = repeats;
  }
  const auto own_sigma = [](const Observation& o) { return o.sigma > 0.0; };
  const std::vector<Observation>& rows = task.measurements.observations;
  if (std::none_of(rows.begin(), rows.end(), own_sigma)) {
    noise.tracker = task.options.noise.tracker;
  }
  if (!robust.weights.empty()) {
    return assess_robust_noise(task, fitted, robust, std::move(noise));
  }
  const double freedom = std::max(noise.degrees_of_freedom, 1.0);
  if (noise_is_stated(task.measurements, task.options)) {
    ResidualOptions as_stated = estimated.as_stated;
    as_stated.row_weights = fitted.row_weights;
    const LeastSquaresProblem problem(task.model, task.measurements, fitted.free, as_stated);
    noise.variance_factor =
        excess_over_stated(problem.linearise(fitted.estimate).cost / freedom, noise.degrees_of_freedom);
  }
  if (estimated.parts) {
    report_parts(*estimated.parts, noise);
    const Eigen::MatrixXd promised = covariance(fitted.system.triangle, 1.0);
    for (const Eigen::MatrixXd& sensitivity : estimated.parts->sensitivity) {
      noise.slopes.push_back(sensitivity.size() > 0 ? sandwich(promised, sensitivity) : Eigen::MatrixXd());
    }
    const Eigen::MatrixXd& scatter = estimated.parts->scatter;
    return {.report = std::move(noise), .covariance = scatter.size() > 0 ? sandwich(promised, scatter) : promised};
  }
  const double variance =
      noise.degrees_of_freedom > 0.0 ? fitted.problem.linearise(fitted.estimate).cost / freedom : 0.0;
  return without_parts(task, fitted, {.points = static_cast<double>(fitted.problem.points()), .variance = variance},
                       std::move(noise));
}

double variance_of_unit_weight(const Eigen::MatrixXd& triangle, const Eigen::MatrixXd& covariance) {
  const bool determined = covariance.cols() > 0 && covariance.diagonal().allFinite();
  return determined ? (triangle * covariance).cwiseProduct(triangle).sum() / static_cast<double>(covariance.cols())
                    : 1.0;
}

double NoiseReport::freedom_of_covariance() const {
  return model == "stated" && variance_factor == 1.0 ? std::numeric_limits<double>::infinity() : degrees_of_freedom;
}

std::optional<LackOfFit> lack_of_fit(const FitTask& task, const Estimate& estimate, const Unknowns& free) {
  std::optional<LackOfFit> result = test_lack_of_fit(task.model, task.measurements, estimate, free);
  if (result) {
    result->explained_by_joint = explained_by_joints(task.model, estimate, task.measurements);
  }
  return result;
}

}  // namespace kdl_calibration
