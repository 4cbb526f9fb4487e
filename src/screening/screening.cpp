#include "screening/screening.hpp"

#include <algorithm>
#include <set>
#include <utility>

#include "effects/effect_terms.hpp"
#include "estimation/least_squares.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {
namespace {

constexpr std::size_t kMostRowsScreened = 20000;  // above it only distances between targets are checked

ErrorModel with_load_and_gain(ErrorModel model) {
  model.effects = load_and_gain_terms(model);
  return model;
}

// The same problem with the effects of `wide`, to which it keeps a reference. The effects start at zero.
FitProblem with_effects_of(const ErrorModel& wide, const FitProblem& plain) {
  FitProblem problem{.model = wide,
                     .measurements = plain.measurements,
                     .start = plain.start,
                     .free = plain.free.without(UnknownGroup::effects).with_group(wide, UnknownGroup::effects),
                     .options = plain.options};
  problem.start.effects = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(wide.effects.size()));
  return problem;
}

// Whether there are at least `times` as many distinct coordinates as unknowns.
bool is_determined(const FitProblem& problem, double times) {
  std::set<std::pair<int, int>> points;
  for (const Observation& o : problem.measurements.observations) {
    points.emplace(o.configuration, o.target);
  }
  return 3.0 * static_cast<double>(points.size()) >= times * static_cast<double>(problem.free.size());
}

bool has_enough_equations(const FitProblem& problem) {
  const LeastSquaresProblem equations(problem.model, problem.measurements, problem.free);
  return equations.equations() >= equations.columns();
}

std::vector<QualityFinding> beside_effects(const FitProblem& plain, std::vector<QualityFinding> found) {
  const ErrorModel wide = with_load_and_gain(plain.model);
  const FitProblem problem = with_effects_of(wide, plain);
  if (!is_determined(problem, 2.0)) {
    return found;
  }
  const RobustIdentification fit = identify_robustly(problem);
  if (fit.fit.termination != Termination::converged) {
    return found;
  }
  const std::vector<QualityFinding> again = check_measurements(wide, problem.measurements, fit.fit.estimate);
  std::erase_if(found, [&](const QualityFinding& finding) {
    return std::none_of(again.begin(), again.end(), [&](const QualityFinding& other) {
      return other.kind == finding.kind && other.targets == finding.targets;
    });
  });
  return found;
}

}  // namespace

std::vector<QualityFinding> screen(const FitProblem& problem) {
  if (problem.measurements.observations.size() > kMostRowsScreened || !has_enough_equations(problem)) {
    return check_distances(problem.measurements);
  }
  FitProblem preliminary = problem;
  preliminary.options = {.loss = Loss::tukey};
  Identification fit = identify_robustly(preliminary).fit;
  if (fit.termination != Termination::converged) {
    return check_distances(problem.measurements);
  }
  std::vector<QualityFinding> found = check_measurements(problem.model, problem.measurements, fit.estimate);
  if (found.empty()) {
    return found;
  }
  preliminary.start = std::move(fit.estimate);
  return beside_effects(preliminary, std::move(found));
}

GrossRows find_gross_rows_beside_effects(const FitProblem& problem) {
  constexpr Eigen::Index kMostConfigurations = 2000;
  constexpr Eigen::Index kMostUnknowns = 200;
  if (problem.measurements.joint_values.cols() > kMostConfigurations || problem.free.size() > kMostUnknowns ||
      !has_enough_equations(problem)) {
    return {};
  }
  GrossRows found = find_gross_rows(problem);
  if (!found.rows.empty() || !found.beyond_chance) {
    return found;
  }
  const ErrorModel wide = with_load_and_gain(problem.model);
  const FitProblem again = with_effects_of(wide, problem);
  return is_determined(again, 1.2) ? find_gross_rows(again) : found;
}

}  // namespace kdl_calibration
