#include "calibration/distance_zero.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/decompositions.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/scaled_solver.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kLargest = 0.05;  // [m] more is another unit

bool has_measured_distances(const Measurements& measurements) {
  const std::vector<Observation>& rows = measurements.observations;
  return std::any_of(rows.begin(), rows.end(), is_distance) && rows_of_stated_distances(measurements).empty();
}

// The zeros that are found: stations x unknown zeros.
using Zeros = MatrixXd;

Zeros one_of_all(const Measurements& measurements) {
  return MatrixXd::Ones(static_cast<Index>(measurements.stations.size()), 1);
}

std::vector<double> listed(const VectorXd& zeros) { return {zeros.begin(), zeros.end()}; }

// The step of the zeros beside a step of all unknowns, at the optimum of the unknowns alone.
struct ZeroStep {
  VectorXd lengths;
  MatrixXd covariance;
  double freedom = 0.0;
};

std::optional<ZeroStep> step_at(const FitProblem& fit, const Estimate& optimum, const Zeros& zeros) {
  constexpr double kStep = 1e-4;              // [m]
  constexpr double kLeastInformation = 1e-6;  // share of the information without other unknowns
  const auto with_zeros = [&](const VectorXd& lengths) {
    const Measurements rows = from_zero(fit.measurements, listed(-lengths));
    return LeastSquaresProblem(fit.model, rows, fit.free, fit.options.joint.residuals).linearise(optimum);
  };
  const NormalEquations here = with_zeros(VectorXd::Zero(zeros.rows()));
  const Index count = zeros.cols();
  MatrixXd cross(fit.free.size(), count);
  MatrixXd information = MatrixXd::Zero(count, count);
  VectorXd whole(count);
  VectorXd slope(count);
  for (Index i = 0; i < count; ++i) {
    const NormalEquations longer = with_zeros(kStep * zeros.col(i));
    const NormalEquations shorter = with_zeros(-kStep * zeros.col(i));
    cross.col(i) = (longer.gradient - shorter.gradient) / (2.0 * kStep);
    whole[i] = (longer.cost - 2.0 * here.cost + shorter.cost) / (2.0 * kStep * kStep);
    slope[i] = (longer.cost - shorter.cost) / (4.0 * kStep);
    ScaledSolver solver;
    solver.solve(here.hessian, {}, cross.col(i));
    for (Index j = 0; j <= i; ++j) {
      information(i, j) = (i == j ? whole[i] : 0.0) - cross.col(j).dot(solver.solution());
    }
  }
  information.triangularView<Eigen::StrictlyUpper>() = information.transpose();
  const VectorXd scale = whole.cwiseSqrt().cwiseInverse();
  const MatrixXd shares = scale.asDiagonal() * information * scale.asDiagonal();
  if (!shares.allFinite() || !(eigenvalues(shares).minCoeff() > kLeastInformation)) {
    return std::nullopt;
  }
  const double freedom = std::max(static_cast<double>(dimension(fit.measurements) - fit.free.size() - count), 1.0);
  const Eigen::LDLT<MatrixXd> root(information);
  return ZeroStep{.lengths = root.solve(slope),
                  .covariance = root.solve(MatrixXd(here.cost / freedom * MatrixXd::Identity(count, count))),
                  .freedom = freedom};
}

// The zeros at their optimum, beside which the unknowns are at theirs.
std::optional<ZeroStep> found_zeros(const FitProblem& rigid, const Zeros& zeros) {
  constexpr int kMostSteps = 10;
  constexpr double kNear = 1e-3;  // sigma
  ZeroStep result{.lengths = VectorXd::Zero(zeros.cols()), .covariance = {}};
  FitProblem problem = rigid;
  for (int step = 0; step < kMostSteps; ++step) {
    const Measurements rows = from_zero(rigid.measurements, listed(zeros * result.lengths));
    const FitProblem fit_there = with_measurements(problem, rows);
    const Identification found = fit(fit_there);
    std::optional<ZeroStep> next = has_converged(found) ? step_at(fit_there, found.estimate, zeros) : std::nullopt;
    if (!next || !((result.lengths + next->lengths).cwiseAbs().maxCoeff() <= kLargest)) {
      return std::nullopt;
    }
    problem.start = found.estimate;
    const bool settled = (next->lengths.array().abs() < kNear * next->covariance.diagonal().array().sqrt()).all();
    next->lengths += result.lengths;
    result = std::move(*next);
    if (settled) {
      break;
    }
  }
  return result;
}

}  // namespace

std::vector<double> DistanceZero::at_stations(std::size_t count) const {
  return of_stations.empty() ? std::vector<double>(count, length) : of_stations;
}

std::optional<DistanceZero> zero_of_distances(const FitProblem& rigid) {
  constexpr double kCertain = 3.0;
  if (!has_measured_distances(rigid.measurements)) {
    return std::nullopt;
  }
  const std::optional<ZeroStep> found = found_zeros(rigid, one_of_all(rigid.measurements));
  if (!found) {
    return std::nullopt;
  }
  DistanceZero result{.length = found->lengths[0], .sigma = std::sqrt(found->covariance(0, 0))};
  if (std::abs(result.length) < kCertain * result.sigma) {
    result = {.length = 0.0, .sigma = std::hypot(result.sigma, result.length)};
  }
  return result;
}

}  // namespace kdl_calibration
