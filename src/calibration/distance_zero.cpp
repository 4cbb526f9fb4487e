#include "calibration/distance_zero.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "estimation/least_squares.hpp"
#include "estimation/scaled_solver.hpp"
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

}  // namespace

std::optional<DistanceZero> zero_of_distances(const FitProblem& rigid) {
  constexpr int kMostSteps = 10;
  constexpr double kNear = 1e-3;     // sigma
  constexpr double kLargest = 0.05;  // [m] more is another unit
  constexpr double kCertain = 3.0;
  if (!has_measured_distances(rigid.measurements)) {
    return std::nullopt;
  }
  DistanceZero result;
  FitProblem problem = rigid;
  for (int step = 0; step < kMostSteps; ++step) {
    const Measurements rows = from_zero(rigid.measurements, result.length);
    const FitProblem fit_there = with_measurements(problem, rows);
    const Identification found = fit(fit_there);
    const std::optional<ZeroStep> next = has_converged(found) ? step_at(fit_there, found.estimate) : std::nullopt;
    if (!next) {
      return std::nullopt;
    }
    problem.start = found.estimate;
    if (std::abs(result.length + next->length) > kLargest) {
      return std::nullopt;
    }
    result = {.length = result.length + next->length, .sigma = next->sigma};
    if (std::abs(next->length) < kNear * next->sigma) {
      break;
    }
  }
  if (std::abs(result.length) < kCertain * result.sigma) {
    result = {.length = 0.0, .sigma = std::hypot(result.sigma, result.length)};
  }
  return result;
}

}  // namespace kdl_calibration
