#include "planning/planner.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <set>
#include <string>

#include "base/decompositions.hpp"
#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/input_check.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/training_rows.hpp"
#include "uncertainty/observability.hpp"

namespace kdl_calibration {
namespace {

using Eigen::MatrixXd;

constexpr int kRandomDraws = 200;
// Resolution of joint values: thousandths of a degree and micrometres, as on pendants.
constexpr double kAngleStep = 1e-3 * std::numbers::pi / 180.0;
constexpr double kLengthStep = 1e-6;

constexpr double kUsualTerm = 3e-4;  // [rad or m] 1 sigma of a term

// A group's terms found by the calibration, or else those that the candidates can tell apart; no terms of signals.
// Prior sigmas of terms in the calibration's covariance are zero, because known_information covers them.
std::vector<EffectTerm> planned_terms(const PlanRequest& request, const ErrorModel& model, EffectGroup group,
                                      const MatrixXd& candidates) {
  std::vector<EffectTerm> terms;
  if (request.calibrated) {
    const std::vector<EffectTerm>& found = request.calibrated->model.effects;
    std::copy_if(found.begin(), found.end(), std::back_inserter(terms), [&](const EffectTerm& term) {
      return term.group() == group && !std::holds_alternative<ApproachSide>(term.function);
    });
    for (EffectTerm& term : terms) {
      const std::optional<Eigen::Index> column = request.calibrated->free.column(term.name);
      term.sigma = column && *column < request.calibrated->covariance.cols() ? 0.0 : term.sigma;
    }
  }
  if (!terms.empty()) {
    return terms;
  }
  if (group == EffectGroup::ripple) {
    throw OptionError("effects",
                      "how often a turn a joint ripples is not known, expected a calibration that has found it");
  }
  terms = effect_terms(model, group, candidates);
  for (EffectTerm& term : terms) {
    term.sigma = kUsualTerm;
  }
  return terms;
}

void add_effects(const PlanRequest& request, const MatrixXd& candidates, Experiment& experiment) {
  constexpr double kMostNumbers = 5e8;  // limit for the candidates' information matrices
  for (const EffectGroup group : request.effects) {
    const std::vector<EffectTerm> terms = planned_terms(request, experiment.model, group, candidates);
    experiment.model.effects.insert(experiment.model.effects.end(), terms.begin(), terms.end());
  }
  experiment.free = experiment.free.with_group(experiment.model, UnknownGroup::effects);
  const auto columns = static_cast<double>(experiment.free.size());
  if (0.5 * columns * columns * static_cast<double>(candidates.cols()) > kMostNumbers) {
    throw OptionError("effects", fmt::format("{} terms at {} candidates, expected fewer of either",
                                             experiment.model.effects.size(), candidates.cols()));
  }
}

void require_suspects(const Robot& robot, const std::vector<std::string>& suspects) {
  const std::vector<std::string> joints = joint_names(robot);
  for (const std::string& suspect : suspects) {
    if (std::find(joints.begin(), joints.end(), suspect) == joints.end()) {
      throw OptionError("suspect", fmt::format("{} has no joint {}, expected some of {}", robot.source, shown(suspect),
                                               comma_separated(joints)));
    }
  }
}

// The new base takes up the zero of the first joint, and the new targets that of the last.
std::vector<std::string> unseen_zeros(const Experiment& experiment, const std::vector<std::string>& suspects) {
  std::vector<std::string> warnings;
  for (const ErrorParameter& parameter : experiment.model.parameters) {
    const bool is_named = std::find(suspects.begin(), suspects.end(), parameter.joint) != suspects.end();
    if (is_named && parameter.kind == ParameterKind::joint_offset && !experiment.free.column(parameter.name)) {
      warnings.push_back("a change of the zero of " + parameter.joint +
                         " cannot show, as base and targets are new; of its other errors the plan tells");
    }
  }
  return warnings;
}

// Adds the variances of what may have changed to those of the errors with these names.
void add_changes(const Experiment& experiment, const std::vector<std::string>& suspects,
                 const std::vector<std::string>& names, MatrixXd& covariance) {
  for (const ErrorParameter& parameter : experiment.model.parameters) {
    const auto found = std::find(names.begin(), names.end(), parameter.name);
    const bool is_suspect =
        suspects.empty() || std::find(suspects.begin(), suspects.end(), parameter.joint) != suspects.end();
    if (is_suspect && found != names.end()) {
      const auto column = static_cast<Eigen::Index>(found - names.begin());
      covariance(column, column) += kOrdinaryChange * kOrdinaryChange;
    }
  }
}

// The calibration's information about the experiment's columns, marginalised over others; zero for undetermined
// columns.
MatrixXd known_information(const PlanRequest& request, const Experiment& experiment) {
  const CalibrationParts& calibrated = *request.calibrated;
  require_count("columns of a calibration's covariance", calibrated.covariance.cols(), calibrated.covariance.rows());
  const Unknowns same =
      request.suspects ? calibrated.free.without(UnknownGroup::base).without(UnknownGroup::targets) : calibrated.free;
  std::vector<Eigen::Index> here;
  std::vector<Eigen::Index> there;
  std::vector<std::string> known_names;
  const std::vector<std::string> names = experiment.free.names();
  for (std::size_t c = 0; c < names.size(); ++c) {
    const std::optional<Eigen::Index> column = same.column(names[c]) ? calibrated.free.column(names[c]) : std::nullopt;
    if (column && *column < calibrated.covariance.rows() && std::isfinite(calibrated.covariance(*column, *column))) {
      here.push_back(static_cast<Eigen::Index>(c));
      there.push_back(*column);
      known_names.push_back(names[c]);
    }
  }
  MatrixXd result = MatrixXd::Zero(experiment.free.size(), experiment.free.size());
  MatrixXd known = calibrated.covariance(there, there);
  if (request.suspects) {
    add_changes(experiment, *request.suspects, known_names, known);
  }
  const MatrixXd inverse = known.ldlt().solve(MatrixXd::Identity(known.rows(), known.cols()));
  result(here, here) = inverse;
  return result;
}

SelectionTask selection_task(const PlanRequest& request, const Plan& plan) {
  SelectionTask result{.candidates = {}, .given = prior_information(plan.experiment), .tasks = request.tasks};
  if (request.calibrated) {
    result.given += known_information(request, plan.experiment);
  }
  if (request.measured) {
    result.given += information(plan.experiment, *request.measured);
  }
  result.candidates = plan.drawn.joint_values.leftCols(request.candidates);
  if (request.tasks.size() == 0) {
    result.tasks = plan.drawn.joint_values.rightCols(request.workspace);
  }
  return result;
}

Selection select(const PlanRequest& request, const Experiment& experiment, const SelectionTask& among) {
  const SelectionOptions options{.criterion = request.criterion,
                                 .count = request.count,
                                 .starts = request.starts,
                                 .seed = request.seed,
                                 .threads = request.threads,
                                 .progress = request.choosing};
  if (!request.accuracy) {
    return select_configurations(experiment, among, options);
  }
  return select_for_accuracy(experiment, among, *request.accuracy, request.accuracy_of, options);
}

// Labels (numbers) that no measured configuration has.
std::vector<std::string> free_labels(Eigen::Index count, const std::optional<Measurements>& measured) {
  std::set<std::string> taken;
  if (measured) {
    taken.insert(measured->configurations.begin(), measured->configurations.end());
  }
  std::vector<std::string> result;
  for (int number = 1; static_cast<Eigen::Index>(result.size()) < count; ++number) {
    if (taken.count(std::to_string(number)) == 0) {
      result.push_back(std::to_string(number));
    }
  }
  return result;
}

MeasuringPlan sheet(const PlanRequest& request, const MatrixXd& in_order) {
  MeasuringPlan result{.configurations = free_labels(in_order.cols(), request.measured),
                       .joint_values = in_order,
                       .targets = {},
                       .notes = {"Measure every target in every configuration and fill in x, y and z: the point in "
                                 "the tracker's frame, in metres.",
                                 "Not checked: the way from one configuration to the next and the home pose. Drive it "
                                 "slowly the first time."}};
  for (const TargetFrame& target : request.targets) {
    result.targets.push_back(target.name);
  }
  return result;
}

void add_promises(const PlanRequest& request, const SelectionTask& among, Plan& plan) {
  const Experiment& experiment = plan.experiment;
  const MatrixXd& information = plan.selection.information;
  const auto count = static_cast<int>(plan.selection.chosen.size());
  plan.planned = predicted(experiment, information, among.tasks, request.threads);
  plan.worst_configuration =
      std::max(plan.planned.worst_configuration,
               predicted(experiment, information, plan.sheet.joint_values, request.threads).worst_configuration);
  plan.random = mean_of(predicted(
      experiment,
      random_designs(experiment, among,
                     {.count = count, .draws = kRandomDraws, .seed = request.seed, .threads = request.threads}),
      among.tasks, request.threads));
  if (among.given.isZero() && experiment.noise.configuration_sigma == 0.0 && !experiment.noise.tracker) {
    plan.floor = floor_of_worst_configuration(experiment, count);
  }
  plan.efficiency = d_efficiency(experiment, among, information, count, request.threads);
}

// The fitted configurations, then those of the plan.
MatrixXd with_measured(const PlanRequest& request, const MatrixXd& chosen) {
  if (!request.measured) {
    return chosen;
  }
  const MatrixXd before = training_sample(*request.measured, request.measured->configurations.size()).joint_values;
  MatrixXd all(chosen.rows(), before.cols() + chosen.cols());
  all << before, chosen;
  return all;
}

MonteCarloResult try_out(const PlanRequest& request, const Experiment& experiment, const MatrixXd& joint_values,
                         const MatrixXd& tasks) {
  const PointNoise& noise = experiment.noise;
  const NoiseModel model = noise_model(noise);
  const MonteCarlo runs{.model = experiment.model,
                        .with_errors = experiment.free.geometric(),
                        .targets = experiment.targets,
                        .sizes = {.length = 1e-3, .angle = 1e-3},
                        .noise = {.sigma = noise.sigma, .common = model.common, .tracker = noise.tracker},
                        .X_WB = Eigen::Isometry3d(Eigen::Translation3d(-noise.tracker_position)),
                        .train = [&](Random&) { return joint_values; },
                        .test = [&](Random&) { return tasks; },
                        .calibration = {.noise = {.stated = model}, .selection = {.priors = request.priors}},
                        .runs = request.monte_carlo,
                        .seed = request.seed,
                        .threads = request.threads,
                        .progress = request.trying};
  return run_monte_carlo(runs);
}

void require_possible(const PlanRequest& request) {
  if (request.calibrated && request.monte_carlo > 0) {
    throw InputError("the runs that try a plan repeat the measurements before it: a calibration does not have them");
  }
  if (request.calibrated && request.calibrated->model.has_undetermined_bases) {
    throw OptionError(request.suspects ? "after" : "result",
                      "has bases of stations, which a plan does not know; expected a calibration by whole points "
                      "that are not all on one line, without a column station");
  }
  if (!request.effects.empty() && request.monte_carlo > 0) {
    throw InputError("the runs that try a plan are of rigid arms, expected no effects beside them");
  }
  const auto is_measured = [](EffectGroup group) {
    return group == EffectGroup::torque || needed_circumstance(group).has_value();
  };
  if (const auto found = std::find_if(request.effects.begin(), request.effects.end(), is_measured);
      found != request.effects.end()) {
    throw OptionError("effects", fmt::format("{} is of what is measured with the arm, expected groups of joint values",
                                             to_string(*found)));
  }
  require_suspects(request.robot, request.suspects.value_or(std::vector<std::string>()));
  require_at_least("candidates", request.candidates, 1);
  require_at_least("configurations of the workspace", request.workspace, 0);
  if (request.measured) {
    check(*request.measured, complete_model(request.robot));
  }
}

}  // namespace

Plan make_plan(const PlanRequest& request) {
  require_possible(request);
  Plan plan;
  const KeptAxes kept = request.calibrated ? request.calibrated->model.kept_axes : KeptAxes::none;
  plan.experiment =
      nominal_experiment(complete_model(request.robot, kept), request.targets, request.noise, request.priors);
  if (request.calibrated) {
    plan.experiment.errors = request.calibrated->estimate.errors;
  }
  plan.drawn = candidates(request.robot, request.targets, request.cell,
                          {.count = request.candidates + request.workspace,
                           .seed = request.seed,
                           .threads = request.threads,
                           .angle_step = kAngleStep,
                           .length_step = kLengthStep});
  plan.narrowed = narrowed_ranges(request.robot, request.targets, request.cell, plan.drawn, request.seed);
  if (!request.effects.empty()) {
    add_effects(request, plan.drawn.joint_values.leftCols(request.candidates), plan.experiment);
  }
  const SelectionTask among = selection_task(request, plan);
  plan.selection = select(request, plan.experiment, among);

  const std::vector<MovingJoint>& joints = request.robot.joints;
  const Eigen::VectorXd home =
      request.home.size() > 0 ? request.home : Eigen::VectorXd::Zero(static_cast<Eigen::Index>(joints.size()));
  const MatrixXd chosen = among.candidates(Eigen::all, plan.selection.chosen);
  plan.sheet = sheet(request, chosen(Eigen::all, short_way(joints, home, chosen)));
  plan.sheet.warnings = unseen_zeros(plan.experiment, request.suspects.value_or(std::vector<std::string>()));
  plan.seconds = way_time(joints, home, plan.sheet.joint_values);

  add_promises(request, among, plan);
  const MatrixXd all = with_measured(request, plan.sheet.joint_values);
  plan.observability = observability_indices(plan.experiment, all);
  if (request.monte_carlo > 0) {
    plan.monte_carlo = try_out(request, plan.experiment, all, among.tasks);
  }
  return plan;
}

namespace {

// Counts from the least number that could determine the model up to all configurations, denser for small ones.
std::vector<int> counts_to_show(const Experiment& experiment, int all, bool given) {
  constexpr double kStep = 1.15;
  const auto coordinates = static_cast<Eigen::Index>(3 * experiment.targets.size());
  const auto least = static_cast<int>((columns(experiment) + coordinates - 1) / coordinates);
  std::vector<int> counts;
  for (int count = given ? 1 : std::min(all, least); count < all;
       count = std::max(count + 1, static_cast<int>(kStep * count))) {
    counts.push_back(count);
  }
  counts.push_back(all);
  return counts;
}

// Information of the plan without its least useful configurations, for each of the counts (ascending).
std::vector<MatrixXd> reduced_designs(const Experiment& experiment, const MatrixXd& candidates,
                                      const Selection& selection, const std::vector<int>& counts) {
  std::vector<MatrixXd> own;
  for (const Eigen::Index c : selection.chosen) {
    own.push_back(information(experiment, candidates.col(c)));
  }
  MatrixXd left = selection.information;
  std::vector<MatrixXd> result(counts.size());
  for (std::size_t k = counts.size(); k-- > 0;) {
    while (own.size() > static_cast<std::size_t>(counts[k])) {
      const MatrixXd covariance = pseudo_inverse(left);
      const auto least = std::min_element(own.begin(), own.end(), [&](const MatrixXd& a, const MatrixXd& b) {
        return covariance.cwiseProduct(a).sum() < covariance.cwiseProduct(b).sum();
      });
      left -= *least;
      own.erase(least);
    }
    result[k] = left;
  }
  return result;
}

}  // namespace

std::vector<CountedAccuracy> accuracy_by_count(const PlanRequest& request, const Plan& plan) {
  constexpr int kDraws = 20;
  constexpr Eigen::Index kMostTasks = 500;
  const Experiment& experiment = plan.experiment;
  SelectionTask among = selection_task(request, plan);
  among.tasks = MatrixXd(among.tasks.leftCols(std::min(kMostTasks, among.tasks.cols())));
  const std::vector<int> counts =
      counts_to_show(experiment, static_cast<int>(plan.selection.chosen.size()), !among.given.isZero());
  const std::vector<MatrixXd> designs = reduced_designs(experiment, among.candidates, plan.selection, counts);
  const std::vector<Prediction> planned = predicted(experiment, designs, among.tasks, request.threads);
  std::vector<CountedAccuracy> result;
  for (std::size_t k = 0; k < counts.size(); ++k) {
    const Prediction random = mean_of(predicted(
        experiment,
        random_designs(experiment, among,
                       {.count = counts[k], .draws = kDraws, .seed = request.seed, .threads = request.threads}),
        among.tasks, request.threads));
    result.push_back({.count = counts[k], .plan = planned[k].sigma.mean, .random = random.sigma.mean});
  }
  return result;
}

}  // namespace kdl_calibration
