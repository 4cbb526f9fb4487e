#include "calibration/noise_report.hpp"

#include <algorithm>
#include <cmath>

#include "base/f_distribution.hpp"
#include "kdl_calibration/covariance.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/lack_of_fit.hpp"
#include "kdl_calibration/noise_components.hpp"

namespace kdl_calibration {
namespace {

// Of the repeats' scatter, the least that is taken as the noise of single points along an axis.
constexpr double kLeastShareOfRepeats = 1e-3;

}  // namespace

void require_repeats(const Measurements& measurements) {
  const RepeatNoise repeats = noise_from_repeats(measurements);
  if (repeats.degrees_of_freedom == 0.0) {
    throw InputError(measurements.source + ": --noise repeats needs configurations that were measured more than once");
  }
  if (!(repeats.independent.minCoeff() > kLeastShareOfRepeats * repeats.total.maxCoeff())) {
    throw InputError(measurements.source +
                     ": --noise repeats: the repeats of single points do not vary along every axis; state the noise by "
                     "--noise-independent");
  }
}

void require_comparable_orientations(const Measurements& measurements, const CalibrationOptions& options) {
  if (!(options.noise.orientation > 0.0)) {
    return;
  }
  if (measurements.orientations.empty()) {
    throw InputError(measurements.source + ": no row has a quaternion, which --orientation-sigma is about");
  }
  const bool every_row = std::all_of(measurements.observations.begin(), measurements.observations.end(),
                                     [](const Observation& observation) { return observation.sigma > 0.0; });
  if (!options.noise.is_absolute() && options.weights != Weights::repeats && !every_row) {
    throw InputError(
        "--orientation-sigma: needs the positions' as well: --noise-independent, --noise-tracker, "
        "--noise repeats or a sigma in every row");
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

// How often the residuals of the means and repeats are the stated noise; 1 where they may be just that.
double excess_over_stated(const LeastSquaresProblem& problem, const Estimate& estimate, double degrees_of_freedom) {
  if (!(degrees_of_freedom > 0.0)) {
    return 1.0;
  }
  const double reduced = problem.linearise(estimate).cost / degrees_of_freedom;
  const bool worse = reduced > 1.0 && f_upper_tail(reduced, degrees_of_freedom, 1e9) < kMisfitCertain;
  return worse ? reduced : 1.0;
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

}  // namespace

NoiseAssessment assess_noise(const FitTask& task, const FittedSystem& fitted, const EstimatedNoise& estimated) {
  NoiseAssessment result;
  NoiseReport& noise = result.report;
  noise.degrees_of_freedom = static_cast<double>(fitted.problem.equations() - fitted.rank);
  const RepeatNoise repeats = noise_from_repeats(task.measurements);
  if (repeats.degrees_of_freedom > 0.0) {
    noise.repeats = repeats;
  }
  const bool stated = noise_is_stated(task.measurements, task.options);
  if (stated) {
    ResidualOptions as_stated = estimated.as_stated;
    as_stated.row_weights = fitted.row_weights;
    noise.variance_factor =
        excess_over_stated(LeastSquaresProblem(task.model, task.measurements, fitted.free, as_stated), fitted.estimate,
                           noise.degrees_of_freedom);
  }
  if (estimated.parts) {
    report_parts(*estimated.parts, noise);
    result.covariance = covariance(fitted.system.triangle, 1.0);
    return result;
  }
  const double mean_weight = fitted.problem.total_weight() / static_cast<double>(fitted.problem.points());
  const double cost = fitted.problem.linearise(fitted.estimate).cost;
  const double reduced = noise.degrees_of_freedom > 0.0 ? cost / noise.degrees_of_freedom : 0.0;
  if (stated) {
    noise.model = "stated";
    noise.independent = task.options.noise.independent;
    noise.common = task.options.noise.common;
    noise.sigma = std::sqrt(1.0 / mean_weight);
    result.covariance = covariance(fitted.system.triangle, noise.variance_factor);
    return result;
  }
  noise.model = "residuals";
  noise.sigma = std::sqrt(reduced / mean_weight);
  // Of the means: what repeats average out does not count, what a configuration has in common does.
  const double cells = static_cast<double>(fitted.system.measured_rows) / 3.0;
  const double unit_weight = fitted.problem.total_weight() / cells;
  const ResidualNoise components = noise_from_residuals(fitted.system, fitted.rank, unit_weight);
  noise.independent.setConstant(components.independent);
  noise.misfit = components.common;
  result.covariance = task.measurements.orientations.empty() ? covariance(fitted.system, components, unit_weight)
                                                             : covariance(fitted.system.triangle, reduced);
  return result;
}

std::optional<LackOfFit> lack_of_fit(const FitTask& task, const Estimate& estimate, const Unknowns& free) {
  std::optional<LackOfFit> result = test_lack_of_fit(task.model, task.measurements, estimate, free);
  if (result) {
    result->explained_by_joint = explained_by_joints(task.model, estimate, task.measurements);
  }
  return result;
}

}  // namespace kdl_calibration
