#include "calibration/distance_zero.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "calibration/noise_report.hpp"
#include "effects/effect_terms.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/residual_options.hpp"
#include "estimation/scaled_solver.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {
namespace {

bool has_measured_distances(const Measurements& measurements) {
  const std::vector<Observation>& rows = measurements.observations;
  return std::any_of(rows.begin(), rows.end(), is_distance) && rows_of_stated_distances(measurements).empty();
}

// The step of the zero beside a step of all unknowns, at the optimum of the unknowns alone.
struct ZeroStep {
  double length = 0.0;
  double sigma = 0.0;
};

std::optional<ZeroStep> step_at(const FitProblem& fit, const Estimate& optimum) {
  constexpr double kStep = 1e-4;              // [m]
  constexpr double kLeastInformation = 1e-6;  // share of the information without other unknowns
  const auto with_zero = [&](double zero) {
    const Measurements rows = from_zero(fit.measurements, -zero);
    return LeastSquaresProblem(fit.model, rows, fit.free, fit.options.joint.residuals).linearise(optimum);
  };
  const NormalEquations here = with_zero(0.0);
  const NormalEquations longer = with_zero(kStep);
  const NormalEquations shorter = with_zero(-kStep);
  const Eigen::VectorXd cross = (longer.gradient - shorter.gradient) / (2.0 * kStep);
  const double whole = (longer.cost - 2.0 * here.cost + shorter.cost) / (2.0 * kStep * kStep);
  ScaledSolver solver;
  solver.solve(here.hessian, {}, cross);
  const double information = whole - cross.dot(solver.solution());
  if (!(information > kLeastInformation * whole)) {
    return std::nullopt;
  }
  const double freedom = static_cast<double>(dimension(fit.measurements) - fit.free.size() - 1);
  return ZeroStep{.length = (longer.cost - shorter.cost) / (4.0 * kStep) / information,
                  .sigma = std::sqrt(here.cost / std::max(freedom, 1.0) / information)};
}

// From lengths that are too long by `start`; none if the rows do not tell it.
std::optional<DistanceZero> converged_zero(const FitProblem& fitted, double start) {
  constexpr int kMostSteps = 10;
  constexpr double kNear = 1e-3;     // sigma
  constexpr double kLargest = 0.05;  // [m] more is another unit
  DistanceZero result{.length = start};
  FitProblem problem = fitted;
  for (int step = 0; step < kMostSteps; ++step) {
    const Measurements rows = from_zero(fitted.measurements, result.length);
    const FitProblem fit_there = with_measurements(problem, rows);
    const Identification found = fit(fit_there);
    const std::optional<ZeroStep> next = has_converged(found) ? step_at(fit_there, found.estimate) : std::nullopt;
    if (!next || std::abs(result.length + next->length) > kLargest) {
      return std::nullopt;
    }
    problem.start = found.estimate;
    result = {.length = result.length + next->length, .sigma = next->sigma};
    if (std::abs(next->length) < kNear * next->sigma) {
      break;
    }
  }
  return result;
}

// Below three sigma there is none, and what was found adds to its uncertainty.
DistanceZero if_certain(const DistanceZero& zero) {
  constexpr double kCertain = 3.0;
  return std::abs(zero.length) < kCertain * zero.sigma
             ? DistanceZero{.length = 0.0, .sigma = std::hypot(zero.sigma, zero.length)}
             : zero;
}

// Beside the sag and gain that joints ordinarily have, weighed by what the geometry alone leaves.
std::optional<DistanceZero> zero_beside_usual_effects(const FitProblem& rigid, const DistanceZero& without) {
  const Measurements rows = from_zero(rigid.measurements, without.length);
  const Identification geometry = fit(with_measurements(rigid, rows));
  if (!has_converged(geometry) || !(geometry.rms > 0.0)) {
    return std::nullopt;
  }
  ErrorModel model = rigid.model;
  model.effects = load_and_gain_terms(model);
  for (EffectTerm& term : model.effects) {
    term.sigma = ordinary_size(term);
  }
  FitProblem problem{.model = model,
                     .measurements = rigid.measurements,
                     .start = geometry.estimate,
                     .free = rigid.free.with_group(model, UnknownGroup::effects),
                     .options = rigid.options};
  problem.start.effects = Eigen::VectorXd::Zero(std::ssize(model.effects));
  ResidualOptions& residuals = problem.options.joint.residuals;
  residuals.priors = kOrdinaryErrors;
  if (!noise_is_stated(rigid.measurements, residuals.noise)) {
    const auto points = static_cast<double>(rows.observations.size());
    residuals.noise.independent.setConstant(geometry.rms * std::sqrt(points / static_cast<double>(dimension(rows))));
  }
  return converged_zero(problem, without.length);
}

}  // namespace

std::optional<DistanceZero> zero_of_distances(const FitProblem& fitted, double start) {
  if (!has_measured_distances(fitted.measurements)) {
    return std::nullopt;
  }
  const std::optional<DistanceZero> zero = converged_zero(fitted, start);
  return zero ? std::optional(if_certain(*zero)) : std::nullopt;
}

std::vector<DistanceZero> possible_zeros(const FitProblem& rigid) {
  if (!has_measured_distances(rigid.measurements)) {
    return {};
  }
  const std::optional<DistanceZero> alone = converged_zero(rigid, 0.0);
  if (!alone) {
    return {};
  }
  std::vector<DistanceZero> zeros = {if_certain(*alone)};
  if (const auto beside = zero_beside_usual_effects(rigid, *alone)) {
    const DistanceZero other = if_certain(*beside);
    if (std::abs(other.length - zeros.front().length) > alone->sigma) {
      zeros.push_back(other);
    }
  }
  return zeros;
}

}  // namespace kdl_calibration
