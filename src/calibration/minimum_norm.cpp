#include "calibration/minimum_norm.hpp"

#include <Eigen/Dense>
#include <utility>

#include "base/decompositions.hpp"
#include "estimation/residual_options.hpp"
#include "model/parameters.hpp"
#include "uncertainty/covariance.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// For every column 1 / (usual error); zero for base, targets and effects.
VectorXd weights(const ErrorModel& model, const Unknowns& candidates) {
  VectorXd result = VectorXd::Zero(candidates.size());
  const ColumnRange geometric = candidates.range(UnknownGroup::geometric);
  for (Index c = geometric.first; c < geometric.end(); ++c) {
    const Unknown& unknown = candidates.columns()[static_cast<std::size_t>(c)];
    result[c] = 1.0 / usual_error(model, model.parameters[unknown.index]);
  }
  return result;
}

}  // namespace

std::optional<Identification> smallest_errors(const FitProblem& task, const DeterminedFit& fit) {
  constexpr int kMostRounds = 10;
  constexpr double kSettled = 1e-9;  // of a usual error
  constexpr double kWorse = 1e-9;    // of the misfit
  if (fit.free == fit.candidates || !has_converged(fit.identification)) {
    return std::nullopt;
  }
  const ResidualOptions& residuals = task.options.joint.residuals;
  const LeastSquaresProblem problem(task.model, task.measurements, fit.candidates, residuals);
  const VectorXd S = weights(task.model, fit.candidates);
  Identification found = fit.identification;
  for (int round = 0; round < kMostRounds; ++round) {
    const MatrixXd undetermined = undetermined_directions(problem.whitened_summary(found.estimate).sqrt_information);
    VectorXd errors(S.size());
    for (Index c = 0; c < S.size(); ++c) {
      errors[c] = S[c] * Unknowns::value(found.estimate, fit.candidates.columns()[static_cast<std::size_t>(c)]);
    }
    const MatrixXd along = S.asDiagonal() * undetermined;
    const VectorXd move = -undetermined * shortest_solution(along, errors);
    const Identification next = identify_jointly(
        task.model, task.measurements, fit.candidates.moved(found.estimate, move), fit.free, {.residuals = residuals});
    if (!has_converged(next) || next.rms > (1.0 + kWorse) * fit.identification.rms + 1e-10) {
      return std::nullopt;
    }
    found.estimate = next.estimate;
    found.rms = next.rms;
    if (!(S.cwiseProduct(move).norm() > kSettled)) {
      break;
    }
  }
  return found;
}

}  // namespace kdl_calibration
