#include "calibration/calibrate.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <utility>

#include "base/counted_fits.hpp"
#include "calibration/assessment.hpp"
#include "calibration/calibration_settings.hpp"
#include "calibration/determined_fit.hpp"
#include "calibration/diagnosis.hpp"
#include "calibration/distance_zero.hpp"
#include "calibration/minimum_norm.hpp"
#include "calibration/noise_report.hpp"
#include "calibration/noise_stage.hpp"
#include "calibration/option_check.hpp"
#include "calibration/parameter_estimates.hpp"
#include "calibration/predicted_accuracy.hpp"
#include "calibration/validation_stage.hpp"
#include "estimation/prediction.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "noise/noise_parts.hpp"
#include "noise/orientation_length_estimate.hpp"
#include "screening/screening.hpp"
#include "selection/effect_selection.hpp"
#include "selection/parameter_selection.hpp"
#include "uncertainty/considered.hpp"
#include "uncertainty/covariance.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {
namespace {

ErrorModel with_effects(ErrorModel model, std::vector<EffectTerm> effects) {
  model.effects = std::move(effects);
  return model;
}

// The registered rigid robot, and the parameters identifiable with its targets.
struct RegisteredRobot {
  ErrorModel model;
  Estimate nominal;
  std::string ambiguity;
  ParameterSelection parameters;
};

// Frames by the new targets, geometric errors and their reduction by the earlier result.
ParameterSelection earlier_parameters(const ErrorModel& model, ParameterSelection chosen, const EarlierResult& earlier,
                                      const ParameterOptions& options) {
  const auto is_geometric = [](const std::string& name) { return name.find('.') == std::string::npos; };
  std::erase_if(chosen.free, is_geometric);
  std::copy_if(earlier.prior.names.begin(), earlier.prior.names.end(), std::back_inserter(chosen.free), is_geometric);
  chosen.complete = chosen.free;
  chosen.reduction = select_parameters(model, earlier.targets, options).reduction;
  chosen.reduction.replaceable.clear();
  return chosen;
}

RegisteredRobot register_robot(const ErrorModel& model, const Measurements& training, const ParameterOptions& options,
                               const EarlierResult* earlier) {
  RegisteredRobot robot{.model = with_effects(model, {})};
  const Eigen::VectorXd nominal = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  Registration registration = register_base_and_targets(
      flange_poses(folded(robot.model, nominal), training.joint_values), training, {.known = options.known});
  robot.nominal = {.errors = nominal, .frames = std::move(registration.frames), .effects = {}};
  robot.ambiguity = std::move(registration.message);
  robot.parameters = select_parameters(robot.model, robot.nominal.frames.targets, options);
  if (earlier != nullptr) {
    robot.parameters = earlier_parameters(robot.model, std::move(robot.parameters), *earlier, options);
  }
  if (robot.parameters.free.empty()) {
    throw OptionError("fix",
                      "leaves nothing to estimate of base, targets and geometric errors; validation predicts without a "
                      "fit");
  }
  return robot;
}

// The fit of the geometry from nominal, weighted by the stated noise.
FitProblem rigid_problem(const RegisteredRobot& robot, const Measurements& training,
                         const CalibrationSettings& options) {
  FitProblem problem{.model = robot.model,
                     .measurements = training,
                     .start = robot.nominal,
                     .free = Unknowns(robot.model, robot.nominal.frames.targets, robot.parameters.free),
                     .options = {.loss = options.estimator.loss}};
  JointOptions& joint = problem.options.joint;
  joint.residuals.noise = options.noise.stated;
  joint.residuals.threads = options.threads;
  joint.max_iterations = options.estimator.iterations > 0 ? options.estimator.iterations : joint.max_iterations;
  return problem;
}

// Single coordinates have one sigma. It is stated, or follows from the residuals.
NoiseBeforehand noise_beforehand(const Measurements& training, const CalibrationSettings& options) {
  return {.stated = options.noise.stated,
          .estimated = is_plain(options.estimator) && options.noise.weights != Weights::equal &&
                       !has_single_coordinates(training)};
}

bool weighs_orientations(const Measurements& training, const CalibrationSettings& options) {
  return options.estimator.method == Method::joint && has_orientations(training) &&
         !(options.noise.stated.orientation > 0.0);
}

// The same problem, weighted for the selection of priors and effects: first the weight of orientations, then the noise
// from a first fit.
FitProblem weighed_for_selection(FitProblem problem, const CalibrationSettings& options) {
  const ModelSelectionOptions& selection = options.selection;
  ResidualOptions& residuals = problem.options.joint.residuals;
  if (weighs_orientations(problem.measurements, options)) {
    residuals.orientation_length = orientation_length_of_residuals(problem);
  }
  const bool selects = selection.priors.length > 0.0 || selection.priors.angle > 0.0 || needs_selection(selection);
  if (options.estimator.method == Method::joint && selects) {
    problem.options =
        absolute_weights(with_determined_unknowns(problem), noise_beforehand(problem.measurements, options));
  }
  residuals.priors = selection.priors;
  return problem;
}

// With an earlier result, gives the rigid problem its prior and the noise.
std::optional<ContinuedResult> continued(FitProblem& rigid, const CalibrationSettings& options) {
  if (!options.selection.earlier) {
    return std::nullopt;
  }
  ResidualOptions& residuals = rigid.options.joint.residuals;
  if (!noise_is_stated(rigid.measurements, options.noise.stated)) {
    residuals.noise = options.selection.earlier->noise;
  }
  ContinuedResult result = continue_result(rigid.model, rigid.measurements, *options.selection.earlier, residuals);
  residuals.earlier = result.rigid;
  residuals.noise = result.noise;
  return result;
}

// The problem with the selected effects (in `model`) and priors. Weights from the residuals of geometry alone would
// hold effects near zero.
FitProblem selected_problem(const FitProblem& rigid, const ErrorModel& model, const ModelSelection& selection,
                            const NoiseBeforehand& noise) {
  FitProblem problem{.model = model,
                     .measurements = rigid.measurements,
                     .start = rigid.start,
                     .free = rigid.free.with_group(model, UnknownGroup::effects),
                     .options = rigid.options};
  problem.start.effects = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.effects.size()));
  ResidualOptions& residuals = problem.options.joint.residuals;
  residuals.priors = selection.priors;
  if (selection.continued) {
    residuals.earlier = selection.continued->prior;
  } else if (!model.effects.empty()) {
    residuals.noise = noise_of_means(rigid.measurements, noise, selection.noise);
  }
  return problem;
}

bool is_as_stated(const ModelSelection& selection, const Priors& stated) {
  return selection.terms.empty() && selection.priors.length == stated.length && selection.priors.angle == stated.angle;
}

ModelSelectionTask selection_task(const FitProblem& rigid, const DeterminedFit& fit,
                                  const CalibrationSettings& options) {
  return {.model = rigid.model,
          .measurements = rigid.measurements,
          .optimum = fit.identification.estimate,
          .free = fit.free,
          .options = options.selection,
          .fix = options.parameters.fix,
          .orientation_length = rigid.options.joint.residuals.orientation_length,
          .threads = options.threads,
          .progress = options.progress};
}

// A fit weighted by its estimated noise.
struct WeighedFit {
  FitProblem problem;  // with the final weights
  DeterminedFit fit;
  EstimatedNoise noise;
  FitOptions without_effects = {};  // of the rigid robot, for comparison
};

WeighedFit weigh_by_residuals(FitProblem problem, DeterminedFit fit, NoiseBeforehand noise) {
  noise.estimated = noise.estimated && has_converged(fit.identification);
  FitProblem at_optimum = problem;
  at_optimum.start = fit.identification.estimate;
  at_optimum.free = fit.free;
  EstimatedNoise estimated = fit_with_estimated_noise(at_optimum, noise, fit.identification.rms);
  problem.options.joint.residuals.noise = estimated.weights;
  fit.identification.estimate = estimated.estimate;
  return {.problem = std::move(problem), .fit = std::move(fit), .noise = std::move(estimated)};
}

// Options of the comparison fit without effects. Its noise includes the misfit that effects would explain.
FitOptions rigid_options(const FitProblem& rigid, const DeterminedFit& rigid_fit, const WeighedFit& selected,
                         const ModelSelection& selection, const NoiseBeforehand& noise) {
  FitOptions options = rigid.options;
  options.joint.residuals.priors = selection.rigid_priors;
  NoiseModel& weights = options.joint.residuals.noise;
  if (selected.fit.free.effects().empty()) {
    weights = selected.noise.parts ? selected.noise.weights : weights;
    return options;
  }
  FitProblem own{.model = rigid.model,
                 .measurements = rigid.measurements,
                 .start = rigid_fit.identification.estimate,
                 .free = rigid_fit.free,
                 .options = options};
  DeterminedFit again = rigid_fit;
  again.identification = fit(own);
  weights = weigh_by_residuals(std::move(own), std::move(again), noise).noise.weights;
  return options;
}

WeighedFit with_smallest_errors(WeighedFit fitted, const CalibrationSettings& options) {
  if (is_plain(options.estimator) && options.parameters.model == ModelChoice::complete) {
    if (std::optional<Identification> smallest = smallest_errors(fitted.problem, fitted.fit)) {
      fitted.fit.identification = std::move(*smallest);
      fitted.fit.minimum_norm = true;
    }
  }
  return fitted;
}

// Fits the selected model with its own noise. If the selection changes nothing, that is the rigid robot's fit.
WeighedFit fit_selected(const FitProblem& problem, const DeterminedFit& rigid_fit, const ModelSelection& selection,
                        const ParameterSelection& parameters, const CalibrationSettings& options) {
  const FitRules rules{.estimator = options.estimator, .parameters = options.parameters};
  const DeterminedFit fit = is_as_stated(selection, options.selection.priors)
                                ? rigid_fit
                                : fit_determined_parameters(problem, parameters, rules);
  const NoiseBeforehand noise = noise_beforehand(problem.measurements, options);
  return with_smallest_errors(weigh_by_residuals(problem, fit, noise), options);
}

// The validation's input. The folds of a fit without a loss are predicted from its linear system.
ValidationTask validation_task(const WeighedFit& fitted, const Assessment& assessed, const Measurements& measurements,
                               const ModelSelectionTask& choice, const CalibrationSettings& options) {
  const bool linear = is_plain(options.estimator) && has_converged(fitted.fit.identification);
  return {.problem = fitted.problem,
          .measurements = measurements,
          .fit = fitted.fit,
          .rigid_options = fitted.without_effects,
          .root = linear ? &assessed.root : nullptr,
          .noise = assessed.noise.sigma,
          .variance = variance_of_unit_weight(assessed.root, assessed.covariance),
          .choice = choice,
          .options = options.validation};
}

// The fit that starts at its end.
FitProblem at_optimum(const WeighedFit& fitted) {
  FitProblem problem = fitted.problem;
  problem.start = fitted.fit.identification.estimate;
  problem.free = fitted.fit.free;
  return problem;
}

GrossRows gross_rows(const WeighedFit& fitted, const CalibrationSettings& options) {
  if (!is_plain(options.estimator) || fitted.fit.identification.termination == Termination::diverged) {
    return {};
  }
  FitProblem problem = at_optimum(fitted);
  problem.options.after_fit = counted_fits(options.progress, "looking for gross rows", kMostGrossGroups + 1);
  return find_gross_rows_beside_effects(problem);
}

NoiseReport noise_report(NoiseReport assessed, const FitProblem& problem, const Measurements& measurements,
                         const CalibrationSettings& options) {
  if (weighs_orientations(problem.measurements, options)) {
    assessed.orientation_length = problem.options.joint.residuals.orientation_length;
  }
  std::vector<NoiseFactors> factors = noise_factors(measurements);
  if (std::any_of(factors.begin(), factors.end(), [](const NoiseFactors& f) { return f != NoiseFactors(); })) {
    assessed.stations = std::move(factors);
  }
  return assessed;
}

// Configurations that were left out of the fit, and how much better they look because the model was chosen by them.
struct LeftOut {
  const std::vector<HeldOutPoint>& points;
  double optimism = 1.0;
  const Eigen::MatrixXd& assumed;  // steps of the estimate, see considered_steps(): no left-out row shows them
  const std::vector<PlausibleModel>& plausible;
};

// What the errors of scale, of stated lengths and of the zero of distances do to the estimate.
Eigen::MatrixXd assumed_steps(const WeighedFit& fitted, const Assessment& assessed, const NoiseOptions& noise,
                              const std::optional<DistanceZero>& zero) {
  return considered_steps(at_optimum(fitted), covariance(assessed.root, 1.0),
                          {.scale = noise.scale_sigma, .length = noise.length_sigma, .zero = zero ? zero->sigma : 0.0});
}

// Base, targets and errors with their uncertainty, and the predicted accuracy.
Uncertainty uncertainty(const WeighedFit& fitted, Assessment assessed, const TrainingRows& rows,
                        const LeftOut& left_out, const Configurations& asked) {
  const FitProblem& problem = fitted.problem;
  const DeterminedFit& fit = fitted.fit;
  assessed.covariance += left_out.assumed * left_out.assumed.transpose();
  Uncertainty result;
  result.predicted = predicted_accuracy({.model = problem.model,
                                         .fit = fit,
                                         .covariance = assessed.covariance,
                                         .candidate_sqrt_information = assessed.candidate_sqrt_information,
                                         .noise = assessed.noise,
                                         .held_out = left_out.points,
                                         .optimism = left_out.optimism,
                                         .assumed = left_out.assumed,
                                         .plausible = left_out.plausible},
                                        rows, asked);
  result.parameters = parameter_estimates(problem.model, problem.start, fit,
                                          {.fixed_by_gauge = assessed.fixed_by_gauge,
                                           .tied = assessed.identifiability.tied,
                                           .covariance = assessed.covariance,
                                           .noise = assessed.noise});
  result.identifiability = std::move(assessed.identifiability);
  result.fixed_by_gauge = std::move(assessed.fixed_by_gauge);
  result.observability = assessed.observability;
  result.covariance = std::move(assessed.covariance);
  result.influence = std::move(assessed.influence);
  result.shifts = std::move(assessed.shifts);
  return result;
}

DeterminedFit with_weights_of_all(DeterminedFit fit, const TrainingRows& rows) {
  fit.robust.weights = rows.values_among_all(std::move(fit.robust.weights), 1.0);
  return fit;
}

// Of the determined errors only the joints' zero offsets are corrected; none without such an offset.
std::optional<OffsetsAlone> fitted_offsets_alone(FitProblem rigid, const Unknowns& determined) {
  std::vector<std::size_t> offsets;
  for (const std::size_t index : determined.geometric()) {
    if (rigid.model.parameters[index].kind == ParameterKind::joint_offset) {
      offsets.push_back(index);
    }
  }
  if (offsets.empty()) {
    return std::nullopt;
  }
  rigid.free = determined.with(rigid.model, UnknownGroup::geometric, offsets);
  rigid.options.joint.residuals.priors = {};
  rigid.options.joint.residuals.earlier = nullptr;
  const Estimate estimate = fit(rigid).estimate;
  return OffsetsAlone{.errors = estimate.errors,
                      .accuracy = iso_9283(rigid.model, estimate, rigid.measurements).accuracy};
}

std::vector<QualityFinding> screened(const FitProblem& problem, const Measurements& measurements,
                                     const ProgressFunction& progress) {
  return with_progress(progress, "screening the measurements", [&] {
    if (!has_single_coordinates(measurements)) {
      return screen(with_measurements(problem, measurements));
    }
    const Measurements whole = whole_points(measurements);
    return whole.observations.empty() ? std::vector<QualityFinding>() : screen(with_measurements(problem, whole));
  });
}

// The model by its selection or by the earlier result, and what is not tried on these rows.
ModelSelection chosen_model(const ModelSelectionTask& choice, const DeterminedFit& rigid,
                            const Measurements& measurements, const CalibrationSettings& options,
                            const std::optional<ContinuedResult>& earlier) {
  ModelSelection selection =
      select_model(choice, rigid.identification, determines_arm(rigid), options.estimator.method);
  if (!are_points_of_one_station(measurements)) {
    selection.not_tried.push_back(
        has_single_coordinates(measurements)
            ? NotTried{"checks of repeats and of typing errors in rows that are no whole points, parts of the noise, "
                       "other readings of the joints",
                       "single coordinates"}
            : NotTried{"other readings of the joints", "several stations"});
  }
  if (earlier) {
    selection.terms = options.selection.earlier->terms;
    selection.continued = earlier;
  }
  return selection;
}

// A calibration before it is doubted.
struct Calibrated {
  CalibrationResult result;
  std::vector<QualityFinding> findings;
  GrossRows gross_rows;
  std::string ambiguity;        // of the registration
  std::vector<Remark> remarks;  // of the validation
};

enum class GrossRowSearch { yes, no };

// Found of the instruments in earlier passes, and applied to the measurements.
struct Instruments {
  std::optional<DistanceZero> zero;
  const Measurements* from_no_zero = nullptr;  // before the zero was taken off
  int passes = 0;                              // that found other noise of the stations
  int zeros = 0;                               // that were found beside chosen effects

  const Measurements& stated(const Measurements& measurements) const {
    return from_no_zero != nullptr ? *from_no_zero : measurements;
  }
  bool may_find_another() const { return zeros < 4; }
  // For a pass with other noise, which finds the zero anew.
  Instruments again() const { return {.zero = std::nullopt, .passes = passes + 1}; }
  Instruments with(const DistanceZero& other, const Measurements& without) const {
    Instruments result = *this;
    result.zero = other;
    result.from_no_zero = &without;
    return result;
  }
};

// The zero beside the chosen model. True if it is another one than `zero`, from which the lengths were fitted.
bool find_again(DistanceZero& zero, const FitProblem& chosen, const Measurements& without) {
  constexpr double kSame = 0.2;  // sigma
  const TrainingRows rows(without);
  const std::optional<DistanceZero> found = zero_of_distances(with_measurements(chosen, *rows), zero.length);
  const double before = zero.length;
  zero = found.value_or(zero);
  return std::abs(zero.length - before) > kSame * zero.sigma;
}

// The factors of the stations' noise by this fit, if they differ clearly from those of its rows. Stations of distances
// alone are anchors of one instrument.
std::optional<std::vector<NoiseFactors>> other_noise_of_stations(const WeighedFit& fitted,
                                                                 const CalibrationSettings& options, int passes) {
  constexpr int kMostPasses = 4;
  constexpr float kSettled = 1.1F;
  constexpr double kRounding = 1e-9;  // [m]
  const bool weighs = is_plain(options.estimator) && options.noise.weights != Weights::equal;
  const std::vector<NoiseFactors> now = noise_factors(fitted.problem.measurements);
  const std::vector<Observation>& rows = fitted.problem.measurements.observations;
  if (passes == kMostPasses || now.size() < 2 || !weighs || std::all_of(rows.begin(), rows.end(), is_distance) ||
      !has_converged(fitted.fit.identification) || fitted.fit.identification.rms < kRounding) {
    return std::nullopt;
  }
  std::vector<NoiseFactors> found = noise_by_station(at_optimum(fitted), options.noise.stated);
  found.resize(now.size());
  const auto differ = [](float a, float b) { return std::max(a, b) > kSettled * std::min(a, b); };
  const bool settled = std::equal(now.begin(), now.end(), found.begin(), [&](const auto& a, const auto& b) {
    return !differ(a.length, b.length) && !differ(a.orientation, b.orientation);
  });
  return settled ? std::nullopt : std::optional(std::move(found));
}

// The calibration `from` the zero that predicts best what was left out of the fit, else what was fitted.
template <class From>
Calibrated best_from(const std::vector<DistanceZero>& zeros, const From& from) {
  const auto error = [](const Calibrated& one) {
    const BeforeAfter* left_out = one.result.accuracy.held_out();
    return left_out != nullptr ? left_out->after.rms : one.result.accuracy.train.after.rms;
  };
  Calibrated best = from(zeros.front());
  for (std::size_t i = 1; i < zeros.size(); ++i) {
    Calibrated other = from(zeros[i]);
    if (error(other) < error(best)) {
      best = std::move(other);
    }
  }
  return best;
}

Calibrated calibrated(const ErrorModel& arm, const Measurements& measurements, const CalibrationSettings& options,
                      GrossRowSearch search, Instruments found = {}) {
  std::optional<DistanceZero>& zero = found.zero;
  const TrainingRows rows(measurements);
  const ErrorModel model = model_at_stations(*rows, arm);
  require_rows_of_each_station(measurements, *rows);
  check_options(model, measurements, *rows, options);
  const RegisteredRobot robot = register_robot(model, *rows, options.parameters, options.selection.earlier.get());
  const FitProblem stated = rigid_problem(robot, *rows, options);
  require_two_step_data(stated.free, *rows, options);
  if (const auto zeros = zero ? std::vector<DistanceZero>() : possible_zeros(stated); !zeros.empty()) {
    return best_from(zeros, [&](const DistanceZero& start) {
      return calibrated(arm, from_zero(measurements, start.length), options, search, found.with(start, measurements));
    });
  }
  std::vector<QualityFinding> findings = screened(stated, measurements, options.progress);

  // The geometry alone, then which effects and priors predict better.
  FitProblem rigid = weighed_for_selection(stated, options);
  const std::optional<ContinuedResult> with_earlier = continued(rigid, options);
  const DeterminedFit rigid_fit =
      fit_determined_parameters(rigid, robot.parameters, {options.estimator, options.parameters});
  const ModelSelectionTask choice = selection_task(rigid, rigid_fit, options);
  const ModelSelection selection = chosen_model(choice, rigid_fit, measurements, options, with_earlier);

  // The chosen model, weighted by the noise that it leaves.
  const NoiseBeforehand noise = noise_beforehand(*rows, options);
  CalibrationResult result{
      .settings = options, .model = with_effects(robot.model, selection.terms), .selection = selection};
  const FitProblem selected = selected_problem(rigid, result.model, selection, noise);
  WeighedFit fitted = fit_selected(selected, rigid_fit, selection, robot.parameters, options);
  if (const auto factors = other_noise_of_stations(fitted, options, found.passes)) {
    return calibrated(arm, with_noise_factors(found.stated(measurements), *factors), options, search, found.again());
  }
  if (zero && found.may_find_another() && find_again(*zero, at_optimum(fitted), found.stated(measurements))) {
    ++found.zeros;
    return calibrated(arm, from_zero(found.stated(measurements), zero->length), options, search, found);
  }
  fitted.without_effects = rigid_options(rigid, rigid_fit, fitted, selection, noise);
  Assessment assessed = assess(fitted.problem, fitted.fit, options.noise.stated, fitted.noise);
  fitted.fit.identification =
      with_undetermined_directions(fitted.fit.identification, assessed, options.parameters.model);

  // Against the fitted, the test and the left-out rows, and what no row can show.
  Validation validated = validate(validation_task(fitted, assessed, measurements, choice, options));
  const Eigen::MatrixXd assumed = assumed_steps(fitted, assessed, options.noise, zero);
  GrossRows gross = search == GrossRowSearch::yes ? gross_rows(fitted, options) : GrossRows();

  result.distance_zero = zero;
  result.noise = noise_report(assessed.noise, fitted.problem, measurements, options);
  result.uncertainty =
      uncertainty(fitted, std::move(assessed), rows,
                  {validated.held_out_points, selection.optimism, assumed, selection.plausible}, options.predict_at);
  result.difference_to_kdl =
      difference_to_kdl(model, fitted.fit.identification.estimate.errors, measurements.joint_values);
  result.fit = with_weights_of_all(std::move(fitted.fit), rows);
  result.accuracy = validated.accuracy;
  result.held_out_points = std::move(validated.held_out_points);
  result.exported = std::move(validated.exported);
  result.offsets_alone = options.diagnosis.convention ? fitted_offsets_alone(rigid, rigid_fit.free) : std::nullopt;
  return {std::move(result), std::move(findings), std::move(gross), robot.ambiguity, std::move(validated.remarks)};
}

// Gross rows with the figures of a calibration without them. Those of the search are of its own models and priors.
GrossRows with_figures_of_calibration(GrossRows gross, const ErrorModel& arm, Measurements measurements,
                                      CalibrationSettings options) {
  if (gross.rows.empty()) {
    return gross;
  }
  std::vector<std::vector<std::size_t>> indices;
  for (const GrossRow& row : gross.rows) {
    std::vector<std::size_t>& of_row = indices.emplace_back();
    for (std::size_t i = 0; i < measurements.observations.size(); ++i) {
      Observation& o = measurements.observations[i];
      const bool named = measurements.configurations[static_cast<std::size_t>(o.configuration)] == row.configuration &&
                         (row.target.empty() || measurements.targets[static_cast<std::size_t>(o.target)] == row.target);
      if (named && o.split == Split::train) {
        o.split = Split::test;
        of_row.push_back(i);
      }
    }
  }
  options.validation = {.held_out = false};
  options.predict_at = {};
  const CalibrationResult without = calibrated(arm, measurements, options, GrossRowSearch::no).result;
  const Estimate& estimate = without.fit.identification.estimate;
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(without.model, estimate, measurements);
  for (std::size_t r = 0; r < indices.size(); ++r) {
    gross.rows[r].distance = 0.0;
    for (const std::size_t i : indices[r]) {
      gross.rows[r].distance = std::max(gross.rows[r].distance,
                                        measured_minus_predicted(measurements.observations[i], estimate, X_BF).norm());
    }
  }
  gross.rms_without = without.accuracy.train.after.rms;
  return gross;
}

}  // namespace

CalibrationResult calibrate(const ErrorModel& arm, const Measurements& measurements,
                            const CalibrationSettings& options) {
  Calibrated found = calibrated(arm, measurements, options, GrossRowSearch::yes);
  CalibrationResult& result = found.result;
  const FromZero from_zero(measurements, result.distance_zero ? result.distance_zero->length : 0.0);
  std::optional<Measurements> weighed;
  if (!result.noise.stations.empty()) {
    weighed = with_noise_factors(*from_zero, result.noise.stations);
  }
  const Measurements& fitted = weighed ? *weighed : *from_zero;
  GrossRows gross = with_figures_of_calibration(std::move(found.gross_rows), arm, fitted, options);
  result.diagnosis = diagnose(
      result, fitted, std::move(found.findings), std::move(gross),
      {options.diagnosis, options.parameters, found.ambiguity, found.remarks, options.threads, options.progress});
  if (result.exported.nominal_kept) {  // doubts are of what was fitted
    result.accuracy = with_nominal_exported(result.accuracy);
  }
  return std::move(found.result);
}

}  // namespace kdl_calibration
