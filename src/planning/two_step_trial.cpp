#include "planning/two_step_trial.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "kdl_calibration/input_error.hpp"
#include "model/reduction.hpp"

namespace kdl_calibration {
namespace {

// [m] Far below the motion of a point due to a parameter error of 1e-10 m or rad.
constexpr double kStepTolerance = 1e-13;

// If the residuals are noise only, the step x = (J^T J)^-1 J^T e moves the points by the projection of e onto the
// columns of J: as many of the 3N coordinates of variance sigma^2 as there are columns. Over N points this is an RMS of
// sigma · sqrt(columns / N).
double change_by_noise_alone(const Measurements& measurements, double sigma, std::size_t columns) {
  return sigma * std::sqrt(static_cast<double>(columns) / static_cast<double>(measurements.observations.size()));
}

// Throws if one of a round's two linear problems has fewer equations than unknowns.
void require_enough_equations(const Measurements& measurements, std::size_t geometric) {
  const std::size_t equations = 3 * measurements.observations.size();
  const std::size_t unknowns = std::max(geometric, 6 + 3 * measurements.targets.size());
  if (equations < unknowns) {
    throw InputError("too few measurements: " + std::to_string(equations) + " measured coordinates in a round for " +
                     std::to_string(unknowns) + " unknowns, expected more configurations or targets");
  }
}

std::vector<double> changes_of(const std::vector<TwoStepTrialRound>& rounds) {
  std::vector<double> changes;
  changes.reserve(rounds.size());
  for (const TwoStepTrialRound& round : rounds) {
    changes.push_back(round.round.change);
  }
  return changes;
}

}  // namespace

TwoStepTrialResult run_two_step_trial(const TwoStepTrial& trial, Random& random) {
  const ErrorModel& model = trial.robot.model;
  const auto fresh = [&] { return measure(trial.robot, trial.configurations(random), trial.noise, random); };
  const Measurements first = fresh();
  const Estimate start = nominal_start(model, first);
  const Reduction reduction = reduced_model(model, start.frames.targets);
  const Unknowns free = Unknowns(model, start.frames.targets, reduction.kept);
  require_enough_equations(first, free.geometric().size());

  TwoStepTrialResult result;
  result.identification = identify_in_two_steps(
      model, [&](int round) { return round == 0 || trial.recorded ? first : fresh(); }, start, free.geometric(),
      {.rounds = trial.rounds,
       .step_tolerance = kStepTolerance,
       .after_round = [&](const TwoStepRound& round, const Estimate& estimate) {
         const ErrorStatistics held_out =
             error_statistics(distances_from_truth(model, estimate, trial.robot.truth, trial.held_out));
         result.rounds.push_back({.round = round, .held_out = held_out});
         if (trial.progress) {
           trial.progress(static_cast<double>(round.number) / static_cast<double>(trial.rounds));
         }
       }});
  result.floor = trial.recorded ? 0.0 : change_by_noise_alone(first, trial.noise.sigma, free.geometric().size());
  const std::vector<double> changes = changes_of(result.rounds);
  result.settled = result.identification.termination == Termination::converged ||
                   (!changes.empty() && result.floor > 0.0 && changes.back() <= 2.0 * result.floor);
  result.factor = convergence_factor(changes, std::max(1e-12, 5.0 * result.floor));
  result.truth = compare_with_truth(model, result.identification.estimate, trial.robot.truth, trial.held_out);
  return result;
}

}  // namespace kdl_calibration
