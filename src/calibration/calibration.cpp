#include "kdl_calibration/calibration.hpp"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <set>
#include <utility>

#include "base/preconditions.hpp"
#include "calibration/comparison.hpp"
#include "calibration/doubts.hpp"
#include "calibration/effect_choice.hpp"
#include "calibration/minimum_norm.hpp"
#include "calibration/noise_report.hpp"
#include "calibration/noise_stage.hpp"
#include "calibration/parameter_choice.hpp"
#include "calibration/parameter_estimates.hpp"
#include "calibration/predicted_accuracy.hpp"
#include "calibration/signal_check.hpp"
#include "calibration/variance_components.hpp"
#include "calibration/whole_fit.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/input_check.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/kinematics.hpp"

namespace kdl_calibration {
namespace {

constexpr double kLeastRobustWeight = 1e-9;  // as identify_robustly, so that nothing becomes undetermined by a weight
constexpr Eigen::Index kMostConfigurationsJudged = 5000;  // one by one
constexpr std::size_t kMostRowsScreened = 20000;          // beyond that only the distances between targets are checked

void require_rows(const Measurements& training) {
  if (training.observations.empty()) {
    throw InputError(training.source + ": no rows to fit; expected rows whose split is 'train'");
  }
}

// What every stage knows: the robot, where the fit starts, what it may change.
struct Setting {
  RegistrationOptions known;  // frames
  ErrorModel model;           // with the effects that were chosen
  Estimate start;             // the nominal robot, registered
  std::string ambiguity;      // of the registration
  ParameterChoice choice;
  Unknowns free;  // without effects
};

Setting set_up(const ErrorModel& model, const Measurements& measurements, const Measurements& training,
               const CalibrationOptions& options) {
  Setting setting;
  setting.known = {.known_base = options.known_base, .known_targets = options.known_targets};
  check(measurements, model);
  check(setting.known);
  check({.priors = options.priors, .noise = options.noise, .row_weights = {}}, measurements);
  if (!options.predict_at.names.empty() || options.predict_at.joint_values.size() != 0) {
    require_count("joint values to predict at", options.predict_at.joint_values.rows(), model.joints.size());
    require_count("names of configurations to predict at", options.predict_at.names.size(),
                  options.predict_at.joint_values.cols());
    require_finite("where to predict", options.predict_at.joint_values.allFinite());
  }
  require_rows(training);
  require_comparable_orientations(measurements, options);
  require_signals(measurements, options);
  setting.model = model;
  setting.model.effects.clear();
  const Eigen::VectorXd nominal = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  Registration registration = register_base_and_targets(flange_poses(folded(model, nominal), measurements.joint_values),
                                                        training, setting.known);
  setting.ambiguity = std::move(registration.message);
  setting.start = {
      .errors = nominal, .X_WB = registration.X_WB, .targets = std::move(registration.targets), .effects = {}};
  setting.choice = choose_parameters(model, setting.start.targets, options);
  if (setting.choice.free.empty()) {
    throw OptionError("fix",
                      "leaves nothing to estimate of base, targets and geometric errors; validation predicts without a "
                      "fit");
  }
  setting.free = Unknowns(model, setting.start.targets, setting.choice.free);
  return setting;
}

// The same problem with gravity and joint gains added to the model.
class Beside {
public:
  Beside(const ErrorModel& model, const FitProblem& plain) : wide_(model), plain_(plain) {
    wide_.effects = load_and_gain_terms(model);
  }
  FitProblem problem() const {
    FitProblem problem{.model = wide_,
                       .measurements = plain_.measurements,
                       .start = plain_.start,
                       .free = plain_.free.without(UnknownGroup::effects).with_all(wide_, UnknownGroup::effects),
                       .options = plain_.options};
    problem.start.effects = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(wide_.effects.size()));
    return problem;
  }
  // Whether there are at least `times` as many distinct coordinates as unknowns.
  bool determined(double times) const {
    std::set<std::pair<int, int>> points;
    for (const Observation& o : plain_.measurements.observations) {
      points.emplace(o.configuration, o.target);
    }
    return 3.0 * static_cast<double>(points.size()) >= times * static_cast<double>(problem().free.size());
  }

private:
  ErrorModel wide_;
  const FitProblem& plain_;
};

// Keeps only the findings that remain when gravity and joint gains are in the model.
void keep_beside_effects(const Setting& setting, const Measurements& measurements, const Estimate& estimate,
                         std::vector<QualityFinding>& found) {
  const FitProblem plain{.model = setting.model,
                         .measurements = measurements,
                         .start = estimate,
                         .free = setting.free,
                         .options = {.loss = Loss::tukey}};
  const Beside beside_effects(setting.model, plain);
  if (!beside_effects.determined(2.0)) {
    return;
  }
  const FitProblem problem = beside_effects.problem();
  const RobustIdentification fit = identify_robustly(problem);
  if (fit.fit.termination != Termination::converged) {
    return;
  }
  const std::vector<QualityFinding> again = check_measurements(problem.model, measurements, fit.fit.estimate);
  std::erase_if(found, [&](const QualityFinding& finding) {
    return std::none_of(again.begin(), again.end(), [&](const QualityFinding& other) {
      return other.kind == finding.kind && other.targets == finding.targets;
    });
  });
}

// What is wrong with the measurements themselves, by the distances between targets and by a preliminary fit that
// survives it.
std::vector<QualityFinding> find_defects(const Setting& setting, const Measurements& measurements) {
  const auto enough_equations = [&] {
    const LeastSquaresProblem problem(setting.model, measurements, setting.free);
    return problem.equations() >= problem.columns();
  };
  if (measurements.observations.size() > kMostRowsScreened || !enough_equations()) {
    return check_distances(measurements);
  }
  const RobustIdentification preliminary = identify_robustly({.model = setting.model,
                                                              .measurements = measurements,
                                                              .start = setting.start,
                                                              .free = setting.free,
                                                              .options = {.loss = Loss::tukey}});
  if (preliminary.fit.termination != Termination::converged) {
    return check_distances(measurements);
  }
  std::vector<QualityFinding> found = check_measurements(setting.model, measurements, preliminary.fit.estimate);
  if (!found.empty()) {
    keep_beside_effects(setting, measurements, preliminary.fit.estimate, found);
  }
  return found;
}

// How the rows are weighed.
struct Weighing {
  FitOptions fit;
  std::optional<double> orientation_length;
};

Weighing weigh(const Setting& setting, const Measurements& measurements, const CalibrationOptions& options) {
  Weighing result;
  result.fit.loss = options.loss;
  JointOptions& joint = result.fit.joint;
  if (options.weights == Weights::repeats) {
    require_repeats(measurements);
  }
  joint.residuals.noise = options.noise;
  joint.residuals.threads = options.threads;
  joint.max_iterations = options.iterations > 0 ? options.iterations : joint.max_iterations;
  const FitTask task{.model = setting.model,
                     .measurements = measurements,
                     .start = setting.start,
                     .options = options,
                     .fit_options = result.fit};
  const bool jointly = options.method == Method::joint;
  if (jointly && !measurements.orientations.empty() && !(joint.residuals.noise.orientation > 0.0)) {
    result.orientation_length = orientation_length_of_residuals(task, setting.free);
    joint.residuals.orientation_length = *result.orientation_length;
  }
  const bool priors = options.priors.length > 0.0 || options.priors.angle > 0.0 || choice_is_open(options);
  if (jointly && priors && !weigh_by_estimated_noise(task, setting.free, joint.residuals) &&
      !noise_is_stated(measurements, options)) {
    make_absolute(task, setting.free, result.fit);
  }
  joint.residuals.priors = options.priors;
  return result;
}

// The rigid robot, and what was chosen beside it from its fit.
struct Chosen {
  ErrorModel rigid;
  WholeFit fit;  // of the rigid robot
  Choice choice;
  FitOptions rigid_options;  // with the priors that are best without effects
};

constexpr double kNothingToLearn = 1e-10;  // [m] what leaves that little has nothing to learn

ChoiceTask choice_task(const Chosen& chosen, const Measurements& measurements, const CalibrationOptions& options,
                       double orientation_length) {
  return {.model = chosen.rigid,
          .measurements = measurements,
          .optimum = chosen.fit.identification.estimate,
          .free = chosen.fit.free,
          .options = options,
          .orientation_length = orientation_length};
}

// Puts the chosen effects into the model and the chosen priors into the fit.
void choose(const FitTask& rigid, Chosen& chosen, Setting& setting, Weighing& weighing) {
  chosen.rigid = setting.model;
  chosen.choice.priors = rigid.options.priors;
  chosen.choice.rigid_priors = rigid.options.priors;
  const Identification& found = chosen.fit.identification;
  if (choice_is_open(rigid.options) && rigid.options.method == Method::joint && found.rms > kNothingToLearn) {
    // Priors would hide that the measurements leave something open.
    const bool automatic = rigid.options.automatic_priors || rigid.options.effects.automatic;
    const bool open = automatic && chosen.fit.free != chosen.fit.candidates;
    if (!arrived(found)) {
      chosen.choice.not_tried = "priors and effects (the fit of the geometry alone did not converge)";
    } else if (open) {
      chosen.choice.not_tried = "priors and effects (the measurements do not determine all geometric errors)";
    } else {
      chosen.choice = choose_effects(
          choice_task(chosen, rigid.measurements, rigid.options, weighing.fit.joint.residuals.orientation_length));
    }
  }
  chosen.rigid_options = weighing.fit;
  chosen.rigid_options.joint.residuals.priors = chosen.choice.rigid_priors;
  weighing.fit.joint.residuals.priors = chosen.choice.priors;
  if (!chosen.choice.terms.empty()) {  // weights by what geometry alone leaves would hold everything near nominal
    weighing.fit.joint.residuals.noise = noise_of_means(rigid.measurements, rigid.options, chosen.choice.noise);
  }
  setting.model.effects = chosen.choice.terms;
  setting.start.effects = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(setting.model.effects.size()));
}

// Whether what was chosen is what was fitted already.
bool is_plain(const Choice& choice, const CalibrationOptions& options) {
  return choice.terms.empty() && choice.priors.length == options.priors.length &&
         choice.priors.angle == options.priors.angle;
}

// The rigid robot, then what was chosen beside it.
WholeFit fit_what_is_chosen(const FitTask& task, Setting& setting, Weighing& weighing, Chosen& chosen) {
  chosen.fit = fit_whole(task, setting.choice, setting.free);
  choose(task, chosen, setting, weighing);
  return is_plain(chosen.choice, task.options)
             ? chosen.fit
             : fit_whole(task, setting.choice, setting.free.with_all(setting.model, UnknownGroup::effects));
}

// What the measurements determine, and how well.
struct Judgement {
  int rank = 0;                     // of the candidates, with what the priors say of them
  Identifiability identifiability;  // of base, targets and geometry among them, by the measurements alone
  std::vector<std::string> fixed_by_gauge;
  Eigen::MatrixXd triangle;  // of what was estimated
  bool determined = true;    // all candidates
  Eigen::MatrixXd triangle_of_candidates;
  ObservabilityIndices observability;
  NoiseAssessment noise;
  Influence influence;
};

// Of base, targets and geometry without priors, where the fit had those or effects.
std::optional<Identifiability> rigid_identifiability(const FitTask& task, const WholeFit& fitted,
                                                     ResidualOptions residuals) {
  const Priors& priors = residuals.priors;
  const bool with_priors = priors.length > 0.0 || priors.angle > 0.0;
  if (!with_priors && fitted.candidates.effects().empty()) {
    return std::nullopt;
  }
  residuals.priors = {};
  const Unknowns rigid = fitted.candidates.without(UnknownGroup::effects);
  const Estimate& estimate = fitted.identification.estimate;
  const LeastSquaresProblem problem(task.model, task.measurements, rigid, residuals);
  return identifiability(problem.whitened_summary(estimate).triangle, rigid.names());
}

Judgement assess_fit(const FitTask& task, const WholeFit& fitted, const EstimatedNoise& estimated) {
  const Estimate& estimate = fitted.identification.estimate;
  ResidualOptions residuals = task.fit_options.joint.residuals;
  residuals.row_weights = fitted.robust.weights;
  for (double& weight : residuals.row_weights) {
    weight = std::max(weight, kLeastRobustWeight);
  }
  const LeastSquaresProblem problem(task.model, task.measurements, fitted.free, residuals);
  const WhitenedSummary system = problem.whitened_summary(estimate);
  const std::vector<std::string> candidates = fitted.candidates.names();
  Judgement result;
  result.triangle = system.triangle;
  result.triangle_of_candidates = system.triangle;
  if (fitted.free != fitted.candidates) {
    const std::vector<std::string> kept = fitted.free.names();
    std::copy_if(candidates.begin(), candidates.end(), std::back_inserter(result.fixed_by_gauge),
                 [&](const std::string& name) { return std::find(kept.begin(), kept.end(), name) == kept.end(); });
    result.triangle_of_candidates = LeastSquaresProblem(task.model, task.measurements, fitted.candidates, residuals)
                                        .whitened_summary(estimate)
                                        .triangle;
  }
  result.identifiability = identifiability(result.triangle_of_candidates, candidates);
  result.rank = result.identifiability.rank;
  const int open_columns = result.identifiability.columns - result.rank;
  if (const std::optional<Identifiability> rigid = rigid_identifiability(task, fitted, residuals)) {
    result.identifiability = *rigid;
  }
  result.determined = open_columns == 0;
  result.observability =
      observability_indices(system.triangle, static_cast<Eigen::Index>(make_folds(task.measurements, 0).size()));
  result.noise = assess_noise(task,
                              {.problem = problem,
                               .estimate = estimate,
                               .free = fitted.free,
                               .system = system,
                               .row_weights = residuals.row_weights,
                               .rank = result.rank},
                              fitted.robust, estimated);
  if (task.measurements.joint_values.cols() <= kMostConfigurationsJudged) {
    result.influence = influence(problem, task.measurements, residuals, estimate, system.triangle);
  }
  return result;
}

// The fit says what it knows; that it was not enough is known only now.
void note_what_is_open(const Judgement& judged, const CalibrationOptions& options, Identification& found) {
  const bool gauge = !judged.fixed_by_gauge.empty() && options.model == ModelChoice::irreducible;
  const bool open = judged.fixed_by_gauge.empty() && !judged.determined;
  if (found.termination == Termination::converged && (gauge || open)) {
    found.termination = Termination::rank_deficient;
    found.message = "converged, but the measurements do not determine all parameters";
    if (gauge) {
      found.message += ": " + std::to_string(judged.fixed_by_gauge.size()) + " were fixed by gauge";
    }
  }
}

// Each stage's part of the result; what the choice knows of the noise goes behind what the judgement does.
void put(Chosen chosen, const Weighing& weighing, Calibration& result) {
  result.tried = std::move(chosen.choice.tried);
  result.not_tried = std::move(chosen.choice.not_tried);
  result.priors = chosen.choice.priors;
  result.noise.orientation_length = weighing.orientation_length;
  if (const std::size_t points = chosen.choice.not_compared; points > 0) {
    result.warnings.push_back("models were compared without " + std::to_string(points) +
                              (points == 1 ? " point, whose target" : " points, whose targets") +
                              " no other fold of the cross-validation has");
  }
}

void put(WholeFit fitted, Calibration& result) {
  result.identification = std::move(fitted.identification);
  result.weights = std::move(fitted.robust.weights);
  result.reduction = std::move(fitted.reduction);
  result.candidates = std::move(fitted.candidates);
  result.free = std::move(fitted.free);
}

void put(Judgement judged, Calibration& result) {
  result.identifiability = std::move(judged.identifiability);
  result.fixed_by_gauge = std::move(judged.fixed_by_gauge);
  result.observability = judged.observability;
  result.noise = std::move(judged.noise.report);
  result.covariance = std::move(judged.noise.covariance);
  result.influence = std::move(judged.influence);
}

void put(Comparison comparison, Calibration& result) {
  result.train = comparison.train;
  result.test = comparison.test;
  result.test_at_fitted_poses = comparison.test_at_fitted_poses;
  result.test_at_new_poses = comparison.test_at_new_poses;
  result.iso_before = comparison.iso_before;
  result.iso_after = comparison.iso_after;
  result.iso_test_before = comparison.iso_test_before;
  result.iso_test_after = comparison.iso_test_after;
  result.exported = std::move(comparison.exported);
}

void put(HeldOutErrors held_out, Calibration& result) {
  result.leave_one_out = held_out.leave_one_out;
  result.nested_leave_one_out = held_out.nested_leave_one_out;
  result.k_fold = held_out.k_fold;
  result.folds = held_out.folds;
  result.held_out_points = std::move(held_out.prediction.points);
  result.warnings.insert(result.warnings.end(), held_out.warnings.begin(), held_out.warnings.end());
}

// What the exported URDF is worth. Where the calibration does not help, it is the robot as it was read.
void judge_exported_urdf(const Setting& setting, Calibration& result) {
  ExportedUrdf& exported = result.exported;
  exported.nominal_kept = is_no_help(result);
  if (exported.nominal_kept) {
    exported.estimate = setting.start;
    exported.iso = result.iso_before;
  }
  const auto own = [&](const BeforeAfter& errors) {
    return exported.nominal_kept ? errors.before : errors.rigid.value_or(errors.after);
  };
  exported.train = own(result.train);
  if (result.test) {
    exported.test = own(*result.test);
  }
  if (const BeforeAfter* held_out = result.held_out()) {
    exported.held_out = own(*held_out);
  }
}

// What is left of the findings beside what the whole of the data may be taken for: where the base moved no target is
// accused of it, and residuals of data that were read wrongly say nothing of single rows.
void keep_beside_suspicions(const Measurements& measurements, const std::vector<Suspicion>& suspicions,
                            std::vector<QualityFinding>& findings) {
  const auto any = [&](const auto& matches) {
    return std::any_of(suspicions.begin(), suspicions.end(),
                       [&](const Suspicion& suspicion) { return suspicion.doubt && matches(suspicion.cause); });
  };
  const auto of_base = [](const std::string& cause) { return cause == "moved_base" || cause == "drift"; };
  if (any([](const std::string& cause) { return cause == "exchanged_targets"; })) {
    findings.clear();
  } else if (any(of_base)) {
    std::erase_if(findings, [](const QualityFinding& finding) { return finding.kind == QualityKind::slipped_target; });
  } else if (any([](const std::string&) { return true; })) {
    findings = check_distances(measurements);
  }
}

// What the whole of the data may be taken for.
void suspect(const Setting& setting, const Measurements& measurements, const CalibrationOptions& options,
             Calibration& result) {
  if (!options.try_readings) {
    return;
  }
  result.suspicions = suspicions(result.model, measurements, result.identification.estimate, result.free,
                                 {.registration = setting.known,
                                  .used = options.convention ? &*options.convention : nullptr,
                                  .others = options.other_conventions,
                                  .threads = options.threads});
  keep_beside_suspicions(measurements, result.suspicions, result.findings);
}

// What can be said once all is known.
void judge_as_a_whole(const Setting& setting, const Measurements& measurements, const CalibrationOptions& options,
                      Calibration& result) {
  judge_exported_urdf(setting, result);
  suspect(setting, measurements, options, result);
  result.doubts = doubts(result, measurements, options);
  if (holds_where_measured(result, setting.ambiguity)) {
    result.reservation = std::move(result.doubts.front());
    result.doubts.clear();
  }
  if (!measurements.remark.empty()) {
    result.warnings.push_back("measurements: " + measurements.remark);
  }
  const std::vector<std::string> more = warnings(result, measurements, setting.ambiguity);
  result.warnings.insert(result.warnings.end(), more.begin(), more.end());
}

// Estimates noise weights for the fit without effects. The misfit that the effects would explain is part of its noise.
void weigh_rigid_arm(const FitTask& task, Chosen& chosen) {
  const FitOptions before = chosen.rigid_options;
  const FitTask own{.model = chosen.rigid,
                    .measurements = task.measurements,
                    .start = chosen.fit.identification.estimate,
                    .options = task.options,
                    .fit_options = before};
  WholeFit rigid = chosen.fit;
  rigid.identification = fit({.model = own.model,
                              .measurements = own.measurements,
                              .start = own.start,
                              .free = rigid.free,
                              .options = before});
  fit_with_estimated_noise(own, rigid, chosen.rigid_options.joint.residuals);
}

// Fits once more with the parts of the noise, where the residuals tell them, and lets rigid arms be compared with them.
EstimatedNoise weigh_by_what_is_left(const FitTask& task, WholeFit& fitted, Weighing& weighing, Chosen& chosen) {
  ResidualOptions& residuals = weighing.fit.joint.residuals;
  EstimatedNoise estimated = fit_with_estimated_noise(task, fitted, residuals);
  if (!fitted.free.effects().empty()) {
    weigh_rigid_arm(task, chosen);
  } else if (estimated.parts) {
    chosen.rigid_options.joint.residuals.noise = residuals.noise;
  }
  return estimated;
}

// One by one, in what is small enough for that.
Calibration with_gross_rows(const FitTask& task, const WholeFit& fitted) {
  constexpr Eigen::Index kMostConfigurations = 2000;
  constexpr Eigen::Index kMostUnknowns = 200;
  const bool plain = task.options.method == Method::joint && task.options.loss == Loss::none;
  if (!plain || fitted.identification.termination == Termination::diverged ||
      task.measurements.joint_values.cols() > kMostConfigurations || fitted.free.size() > kMostUnknowns) {
    return {};
  }
  const FitProblem problem{.model = task.model,
                           .measurements = task.measurements,
                           .start = fitted.identification.estimate,
                           .free = fitted.free,
                           .options = task.fit_options};
  GrossRows found = find_gross_rows(problem);
  if (found.rows.empty() && found.beyond_chance) {
    // A gross row can keep effects from being chosen, and their misfit then hides it: search again with effects.
    const Beside beside_effects(task.model, problem);
    found = beside_effects.determined(1.2) ? find_gross_rows(beside_effects.problem()) : found;
  }
  Calibration result;
  result.gross_rows = std::move(found.rows);
  result.misfit_without_gross_rows = found.rms_without;
  return result;
}

}  // namespace

Calibration calibrate(const ErrorModel& model, const Measurements& measurements, const CalibrationOptions& options) {
  const TrainingRows rows(measurements);
  const Measurements& training = *rows;
  Setting setting = set_up(model, measurements, training, options);
  std::vector<QualityFinding> findings = find_defects(setting, measurements);
  Weighing weighing = weigh(setting, training, options);
  const FitTask task{.model = setting.model,
                     .measurements = training,
                     .start = setting.start,
                     .options = options,
                     .fit_options = weighing.fit};
  Chosen chosen;
  WholeFit fitted = fit_what_is_chosen(task, setting, weighing, chosen);
  const EstimatedNoise estimated = weigh_by_what_is_left(task, fitted, weighing, chosen);
  const bool plain = options.method == Method::joint && options.loss == Loss::none;
  const bool smallest = plain && options.model == ModelChoice::complete &&
                        take_smallest_errors(task, weighing.fit.joint.residuals, fitted);
  Judgement judged = assess_fit(task, fitted, estimated);
  note_what_is_open(judged, options, fitted.identification);
  const ChoiceTask choices = choice_task(chosen, training, options, weighing.fit.joint.residuals.orientation_length);
  const Compared compared{.task = task,
                          .measurements = measurements,
                          .tested = rows.has_others(),
                          .fit = fitted,
                          .known = setting.known,
                          .rigid_options = chosen.rigid_options,
                          .triangle = plain && arrived(fitted.identification) ? &judged.triangle : nullptr,
                          .noise = judged.noise.report.sigma,
                          .variance = variance_of_unit_weight(judged.triangle, judged.noise.covariance),
                          .choice = choices};
  Comparison comparison = compare(compared);
  HeldOutErrors held_out = hold_out(compared, comparison);

  Calibration result = with_gross_rows(task, fitted);
  result.model = setting.model;
  result.minimum_norm = smallest;
  result.findings = std::move(findings);
  result.lack_of_fit = lack_of_fit(task, fitted.identification.estimate, fitted.free);
  result.predicted = predicted_accuracy({.model = setting.model,
                                         .fit = fitted,
                                         .covariance = judged.noise.covariance,
                                         .triangle_of_candidates = judged.triangle_of_candidates,
                                         .noise = judged.noise.report,
                                         .held_out = held_out.prediction,
                                         .price_of_choosing = chosen.choice.price},
                                        training, options.predict_at);
  result.difference_to_kdl = difference_to_kdl(model, fitted.identification.estimate.errors, measurements.joint_values);
  result.parameters = parameter_estimates(task, fitted,
                                          {.fixed_by_gauge = judged.fixed_by_gauge,
                                           .tied = judged.identifiability.tied,
                                           .covariance = judged.noise.covariance,
                                           .noise = judged.noise.report});
  fitted.robust.weights = rows.among_all(std::move(fitted.robust.weights), 1.0);
  put(std::move(fitted), result);
  put(std::move(judged), result);
  put(std::move(chosen), weighing, result);
  put(std::move(comparison), result);
  put(std::move(held_out), result);
  judge_as_a_whole(setting, measurements, options, result);
  return result;
}

const BeforeAfter* Calibration::held_out() const {
  return leave_one_out ? &*leave_one_out : k_fold ? &*k_fold : nullptr;
}

}  // namespace kdl_calibration
