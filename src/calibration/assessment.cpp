#include "calibration/assessment.hpp"

#include <algorithm>
#include <iterator>
#include <map>
#include <optional>

#include "base/decompositions.hpp"
#include "calibration/noise_report.hpp"
#include "estimation/identification.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/parameters.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {
namespace {

constexpr Eigen::Index kMostConfigurationsAssessed = 5000;  // for the influence of each

// The candidates without the rotations of stations that stay as registered.
const Unknowns& told_apart(const DeterminedFit& fitted) {
  return determines_arm(fitted) ? fitted.free : fitted.candidates;
}

// Identifiability of base, targets and geometry without priors, if the fit had priors or effects.
std::optional<Identifiability> rigid_identifiability(const FitProblem& task, const DeterminedFit& fitted,
                                                     ResidualOptions residuals) {
  const Priors& priors = residuals.priors;
  const bool with_priors = priors.length > 0.0 || priors.angle > 0.0 || residuals.earlier;
  if (!with_priors && fitted.candidates.effects().empty()) {
    return std::nullopt;
  }
  residuals.priors = {};
  residuals.earlier = nullptr;
  const Unknowns rigid = told_apart(fitted).without(UnknownGroup::effects);
  const Estimate& estimate = fitted.identification.estimate;
  const LeastSquaresProblem problem(task.model, task.measurements, rigid, residuals);
  return identifiability(problem.whitened_summary(estimate).sqrt_information, rigid.names());
}

// See Uncertainty::shifts. Neighbouring configurations have the same misfit, so they are in one group.
Eigen::MatrixXd grouped_shifts(const Influence& influence, const Measurements& measurements, const Eigen::MatrixXd& R,
                               const Eigen::MatrixXd& priors) {
  constexpr int kMostGroups = 50;
  if (influence.configurations.empty()) {
    return {};
  }
  std::map<Eigen::Index, const Eigen::VectorXd*> shift_of;
  for (const ConfigurationInfluence& entry : influence.configurations) {
    shift_of.emplace(entry.configuration, &entry.shift);
  }
  const auto groups = folds_with_rest(make_folds(measurements, kMostGroups), measurements);
  const auto count = static_cast<Eigen::Index>(groups.size());
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(R.cols(), count + priors.rows());
  for (Eigen::Index g = 0; g < count; ++g) {
    for (const Eigen::Index c : groups[static_cast<std::size_t>(g)]) {
      result.col(g) += *shift_of.at(c);
    }
  }
  result.rightCols(priors.rows()) = solution(R, solution(R.transpose(), priors.transpose()));
  return result;
}

}  // namespace

Assessment assess(const FitProblem& fit, const DeterminedFit& fitted, const NoiseModel& stated,
                  const EstimatedNoise& estimated) {
  const Estimate& estimate = fitted.identification.estimate;
  ResidualOptions residuals = fit.options.joint.residuals;
  residuals.row_weights = fitted.robust.weights;
  for (double& weight : residuals.row_weights) {
    weight = std::max(weight, kLeastRobustWeight);
  }
  const LeastSquaresProblem problem(fit.model, fit.measurements, fitted.free, residuals);
  const WhitenedSummary system = problem.whitened_summary(estimate);
  const std::vector<std::string> candidates = fitted.candidates.names();
  Assessment result;
  result.root = system.sqrt_information;
  result.candidate_sqrt_information = system.sqrt_information;
  if (fitted.free != fitted.candidates) {
    const std::vector<std::string> kept = fitted.free.names();
    std::copy_if(candidates.begin(), candidates.end(), std::back_inserter(result.fixed_by_gauge),
                 [&](const std::string& name) { return std::find(kept.begin(), kept.end(), name) == kept.end(); });
    result.candidate_sqrt_information = LeastSquaresProblem(fit.model, fit.measurements, fitted.candidates, residuals)
                                            .whitened_summary(estimate)
                                            .sqrt_information;
  }
  const Eigen::MatrixXd& told = determines_arm(fitted) ? result.root : result.candidate_sqrt_information;
  const int rank = rank_of(told);
  result.determined = told_apart(fitted).size() == rank;
  const std::optional<Identifiability> rigid = rigid_identifiability(fit, fitted, residuals);
  result.identifiability = rigid ? *rigid : identifiability(told, told_apart(fitted).names());
  result.observability =
      observability_indices(system.sqrt_information, static_cast<Eigen::Index>(make_folds(fit.measurements, 0).size()));
  NoiseAssessment noise = assess_noise({.problem = problem,
                                        .estimate = estimate,
                                        .free = fitted.free,
                                        .system = system,
                                        .row_weights = residuals.row_weights,
                                        .rank = rank},
                                       fit, stated, fitted.robust, estimated);
  result.noise = std::move(noise.report);
  result.covariance = std::move(noise.covariance);
  result.noise.lack_of_fit = lack_of_fit(fit.model, fit.measurements, estimate, fitted.free);
  if (fit.measurements.joint_values.cols() <= kMostConfigurationsAssessed) {
    result.influence = influence(problem, fit.measurements, residuals, estimate, system.sqrt_information);
    result.shifts = grouped_shifts(result.influence, fit.measurements, triangular_factor(system.sqrt_information),
                                   prior_rows(fitted.free, residuals).rows);
  }
  return result;
}

Identification with_undetermined_directions(const Identification& found, const Assessment& assessed,
                                            ModelChoice model) {
  Identification result = found;
  // Directions that a station does not determine stay as registered: no prediction of the arm depends on them.
  const std::vector<std::string> fixed = without_stations(assessed.fixed_by_gauge);
  const bool gauge = !fixed.empty() && model == ModelChoice::irreducible;
  const bool undetermined = assessed.fixed_by_gauge.empty() && !assessed.determined;
  if (found.termination == Termination::converged && (gauge || undetermined)) {
    result.termination = Termination::rank_deficient;
    result.message = "converged, but the measurements do not determine all parameters";
    if (gauge) {
      result.message += ": " + std::to_string(fixed.size()) + " were fixed by gauge";
    }
  }
  return result;
}

}  // namespace kdl_calibration
