#include "noise/orientation_length_estimate.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "base/decompositions.hpp"
#include "estimation/residual_options.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {
namespace {

constexpr int kLengthRounds = 10;
constexpr double kSettledLength = 1e-2;           // relative change of the length
constexpr double kExactFit = 1e-10;               // [m] smaller residuals are rounding
constexpr double kLeastFreedomOfVariance = 10.0;  // below it a variance is too uncertain
constexpr double kLongest = 100.0;                // [m]
constexpr double kShortest = 1e-3;

// u of the orientations over u of the positions, at one fit.
std::optional<double> ratio_of_variances(const FitProblem& problem, const ResidualOptions& both,
                                         const Estimate& estimate) {
  ResidualOptions positions_only = both;
  positions_only.orientation_length = 0.0;
  const LeastSquaresProblem all(problem.model, problem.measurements, problem.free, both);
  const LeastSquaresProblem positions(problem.model, problem.measurements, problem.free, positions_only);
  const NormalEquations N = all.linearise(estimate);
  const NormalEquations N_p = positions.linearise(estimate);
  const auto rows = static_cast<double>(all.whitened_summary(estimate).measured_rows);
  const auto rows_p = static_cast<double>(positions.whitened_summary(estimate).measured_rows);
  const Eigen::VectorXd scale = unit_scale_of_information(N.hessian);
  const Eigen::MatrixXd scaled = scale.asDiagonal() * N.hessian * scale.asDiagonal();
  const Eigen::MatrixXd scaled_p = scale.asDiagonal() * N_p.hessian * scale.asDiagonal();
  const double trace_p =
      std::clamp(shortest_solution(scaled, scaled_p).trace(), 0.0, static_cast<double>(scaled.cols()));
  const double trace_o = std::max(static_cast<double>(scaled.cols()) - trace_p, 0.0);
  const double freedom_p = rows_p - trace_p;
  const double freedom_o = rows - rows_p - trace_o;
  const double cost_p = N_p.cost - positions.cost_of_repeats();
  const double cost_o = N.cost - N_p.cost;
  if (!(freedom_p > kLeastFreedomOfVariance) || !(freedom_o > kLeastFreedomOfVariance) || !(cost_p > 0.0) ||
      !(cost_o > 0.0)) {
    return std::nullopt;
  }
  return (cost_o / freedom_o) / (cost_p / freedom_p);
}

}  // namespace

double orientation_length_of_residuals(const FitProblem& problem) {
  const double present = problem.options.joint.residuals.orientation_length;
  JointOptions joint = problem.options.joint;
  double& length = joint.residuals.orientation_length;
  Estimate estimate = problem.start;
  for (int round = 0; round < kLengthRounds && has_orientations(problem.measurements); ++round) {
    const Identification found = identify_jointly(problem.model, problem.measurements, estimate, problem.free, joint);
    if (found.rms < kExactFit || found.termination == Termination::diverged) {
      return present;
    }
    estimate = found.estimate;
    const std::optional<double> ratio = ratio_of_variances(problem, joint.residuals, estimate);
    if (!ratio) {
      return present;
    }
    const double next = std::clamp(length / std::sqrt(*ratio), kShortest, kLongest);
    const bool settled = std::abs(next - length) < kSettledLength * length;
    length = next;
    if (settled) {
      break;
    }
  }
  return length;
}

}  // namespace kdl_calibration
