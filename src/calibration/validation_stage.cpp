#include "calibration/validation_stage.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cstddef>
#include <limits>

#include "base/counted_fits.hpp"
#include "base/degree.hpp"
#include "measurements/same_poses.hpp"
#include "measurements/training_rows.hpp"
#include "validation/fold_sums.hpp"

namespace kdl_calibration {
namespace {

bool has_effects(const ValidationTask& compared) { return !compared.fit.free.effects().empty(); }

// The fit that a URDF can represent: if effects were fitted, a fit without them.
Identification rigid_fit(const ValidationTask& compared) {
  if (!has_effects(compared)) {
    return compared.fit.identification;
  }
  FitProblem rigid = compared.problem;
  rigid.free = compared.fit.free.without(UnknownGroup::effects);
  rigid.options = compared.rigid_options;
  return fit(rigid);
}

using Folds = std::vector<std::vector<Eigen::Index>>;

FitOptions counting(FitOptions options, const ValidationTask& compared, const std::string& stage, std::size_t fits) {
  options.after_fit = counted_fits(compared.choice.progress, stage, fits);
  return options;
}

// Whether sums over large folds are faster than treating configurations one by one.
bool is_many(const Folds& folds) {
  std::size_t count = 0;
  for (const std::vector<Eigen::Index>& fold : folds) {
    count += fold.size();
  }
  return count > kMostLeftOutSingly;
}

// Errors [m] at left-out configurations, predicted from the linear system at the optimum, where the problem starts.
std::vector<double> folds_by_downdates(const FitProblem& problem, const Folds& folds, double noise, int threads) {
  if (is_many(folds)) {
    return cross_validate_by_sums(problem, folds, noise, threads).distances;
  }
  return fold_distances(problem, folds, noise, threads);
}

constexpr double kShareOfNominal = 1e-5;

// Errors [m] of the nominal robot at left-out configurations, with base and targets registered to the others.
// `nominal`: its RMS error over all rows.
std::vector<double> nominal_folds(const ValidationTask& compared, const Folds& folds, double nominal) {
  const FitProblem& task = compared.problem;
  const Unknowns frames = compared.fit.free.without(UnknownGroup::geometric).without(UnknownGroup::effects);
  if (frames.size() == 0) {  // base and targets are known
    const Measurements means = averaged(task.measurements);
    return position_errors(task.model, task.start, means);
  }
  // Nominal errors are large and need not be exact to a vanishing noise.
  const double noise = std::max(compared.noise, kShareOfNominal * nominal);
  FitOptions options;
  options.joint.residuals.orientation_length = task.options.joint.residuals.orientation_length;
  const FitProblem registered{
      .model = task.model, .measurements = task.measurements, .start = task.start, .free = frames, .options = options};
  return folds_by_downdates(registered, folds, noise, compared.choice.threads);
}

// Left-out configurations and their predictions.
struct PredictedFolds {
  BeforeAfter errors;
  std::vector<HeldOutPoint> points;  // empty if the folds were refitted
  std::vector<Remark> remarks;
};

// Whether the configurations beside its fold do not determine some direction of the point.
bool is_undetermined(const HeldOutPoint& point) { return !point.covariance.allFinite(); }

// The distances of the other points. Of all where the points are not known. If the noise of stations differs, those of
// the least noise, as the others show the noise of their instrument.
std::vector<double> determined(const std::vector<double>& distances, const std::vector<HeldOutPoint>& points) {
  if (points.size() != distances.size()) {
    return distances;
  }
  float least = std::numeric_limits<float>::infinity();
  for (const HeldOutPoint& point : points) {
    least = is_undetermined(point) ? least : std::min(least, point.noise.length);
  }
  std::vector<double> result;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!is_undetermined(points[i]) && points[i].noise.length == least) {
      result.push_back(distances[i]);
    }
  }
  return result;
}

// Each fold predicted by the nominal, the calibrated and the rigid robot. `rigid`: the fit of the latter.
PredictedFolds predicted_folds(const ValidationTask& compared, const Folds& folds, const std::string& name,
                               double nominal, const Identification& rigid) {
  const FitProblem& task = compared.problem;
  PredictedFolds result;
  HoldOut after;
  const FitProblem fitted{.model = task.model,
                          .measurements = task.measurements,
                          .start = compared.fit.identification.estimate,
                          .free = compared.fit.free,
                          .options = counting(task.options, compared, name, folds.size())};
  if (compared.root != nullptr && is_many(folds)) {
    after = cross_validate_by_sums(fitted, folds, compared.noise, compared.choice.threads);
  } else if (compared.root != nullptr) {
    FoldPrediction prediction =
        predict_folds({.problem = fitted, .sqrt_information = *compared.root, .noise = compared.noise}, folds,
                      compared.choice.threads);
    for (HeldOutPoint& point : prediction.points) {
      point.covariance *= compared.variance;
    }
    after = {.distances = distances_of(prediction),
             .refits = static_cast<int>(folds.size()),
             .not_converged = prediction.not_converged};
    result.points = std::move(prediction.points);
  } else {
    after = cross_validate(fitted, folds, compared.choice.threads);
  }
  result.errors.before = error_statistics(determined(nominal_folds(compared, folds, nominal), result.points));
  result.errors.after = error_statistics(determined(after.distances, result.points));
  if (const auto count = std::count_if(result.points.begin(), result.points.end(), is_undetermined); count > 0) {
    result.remarks.push_back(
        {.cause = Cause::points_not_counted,
         .figures = {{"count", static_cast<double>(count)}, {"out_of", static_cast<double>(result.points.size())}},
         .message =
             fmt::format("{} of {} left-out points are not counted: the other configurations do not determine them",
                         count, result.points.size())});
  }
  if (after.not_converged > 0) {
    result.remarks.push_back(
        {.cause = Cause::folds_not_converged,
         .figures = {{"count", static_cast<double>(after.not_converged)},
                     {"out_of", static_cast<double>(after.refits)}},
         .message = fmt::format("{} of {} {} fits did not converge", after.not_converged, after.refits, name)});
  }
  if (has_effects(compared)) {
    ErrorModel model = task.model;
    model.effects.clear();
    FitProblem problem{.model = model,
                       .measurements = task.measurements,
                       .start = rigid.estimate,
                       .free = compared.fit.free.without(UnknownGroup::effects),
                       .options = counting(compared.rigid_options, compared, name, folds.size())};
    problem.start.effects.resize(0);
    result.errors.rigid =
        error_statistics(determined(compared.root != nullptr && has_converged(rigid)
                                        ? folds_by_downdates(problem, folds, compared.noise, compared.choice.threads)
                                        : cross_validate(problem, folds, compared.choice.threads).distances,
                                    result.points));
  }
  return result;
}

// Test rows, split into those at fitted poses and those at new poses.
struct TestRows {
  std::optional<ErrorStatistics> at_fitted_poses;
  std::optional<ErrorStatistics> at_new_poses;
};
TestRows test_rows_apart(const ValidationTask& compared, const std::vector<Eigen::Isometry3d>& X_BF) {
  const Measurements& measurements = compared.measurements;
  const std::vector<bool> trained = trained_configurations(measurements);
  const std::vector<Eigen::Index> first = first_at_same_pose(measurements.joint_values);
  std::vector<bool> fitted(first.size(), false);  // indexed by the first configuration at each pose
  for (std::size_t c = 0; c < first.size(); ++c) {
    fitted[static_cast<std::size_t>(first[c])] = fitted[static_cast<std::size_t>(first[c])] || trained[c];
  }
  const std::vector<double> distances =
      position_errors(X_BF, compared.fit.identification.estimate, measurements, Rows::test);
  std::vector<double> at_fitted;
  std::vector<double> at_new;
  auto distance = distances.begin();
  for (const Observation& observation : measurements.observations) {
    if (observation.split == Split::test) {
      const Eigen::Index pose = first[static_cast<std::size_t>(observation.configuration)];
      (fitted[static_cast<std::size_t>(pose)] ? at_fitted : at_new).push_back(*distance++);
    }
  }
  if (at_fitted.empty()) {
    return {};
  }
  return {.at_fitted_poses = error_statistics(at_fitted),
          .at_new_poses = at_new.empty() ? std::nullopt : std::optional(error_statistics(at_new))};
}

// Errors at fitted and test rows. `rigid`: the robot that a URDF can represent.
Accuracy compare_rows(const ValidationTask& compared, const Estimate& rigid) {
  const FitProblem& task = compared.problem;
  const Measurements& measurements = compared.measurements;
  const Estimate& estimate = compared.fit.identification.estimate;
  Accuracy result;
  const std::vector<Eigen::Isometry3d> X_BF_before = flange_poses(task.model, task.start, measurements);
  const std::vector<Eigen::Isometry3d> X_BF_after = flange_poses(task.model, estimate, measurements);
  const auto statistics = [&](const Estimate& e, const std::vector<Eigen::Isometry3d>& X_BF, Rows rows) {
    return error_statistics(position_errors(X_BF, e, measurements, rows));
  };
  const auto pair_of = [&](Rows rows) {
    return BeforeAfter{.before = statistics(task.start, X_BF_before, rows),
                       .after = statistics(estimate, X_BF_after, rows),
                       .rigid = std::nullopt};
  };
  const auto means_of = [](const Iso9283& before, const Iso9283& after) {
    return after.repeatability.count > 0
               ? std::optional(BeforeAfter{.before = before.accuracy, .after = after.accuracy, .rigid = std::nullopt})
               : std::nullopt;
  };
  result.train = pair_of(Rows::train);
  result.iso_before = iso_9283(X_BF_before, task.start, measurements);
  result.iso_after = iso_9283(X_BF_after, estimate, measurements);
  result.train_means = means_of(result.iso_before, result.iso_after);
  const auto is_test = [](const Observation& o) { return o.split == Split::test; };
  const bool tested = std::any_of(measurements.observations.begin(), measurements.observations.end(), is_test);
  if (tested) {
    result.test = pair_of(Rows::test);
    const TestRows apart = test_rows_apart(compared, X_BF_after);
    result.test_at_fitted_poses = apart.at_fitted_poses;
    result.test_at_new_poses = apart.at_new_poses;
    result.iso_test_before = iso_9283(X_BF_before, task.start, measurements, Rows::test);
    result.iso_test_after = iso_9283(X_BF_after, estimate, measurements, Rows::test);
    result.test_means = means_of(*result.iso_test_before, *result.iso_test_after);
  }
  if (has_effects(compared)) {
    const std::vector<Eigen::Isometry3d> X_BF_rigid = flange_poses(task.model, rigid, measurements);
    result.train.rigid = statistics(rigid, X_BF_rigid, Rows::train);
    if (result.train_means) {
      result.train_means->rigid = iso_9283(X_BF_rigid, rigid, measurements).accuracy;
    }
    if (tested) {
      result.test->rigid = statistics(rigid, X_BF_rigid, Rows::test);
    }
    if (result.test_means) {
      result.test_means->rigid = iso_9283(X_BF_rigid, rigid, measurements, Rows::test).accuracy;
    }
  }
  return result;
}

std::vector<Remark> said_of_neighbours(const Folds& singly) {
  std::size_t together = 0;
  for (const std::vector<Eigen::Index>& fold : singly) {
    together += fold.size() - 1;
  }
  if (together == 0) {
    return {};
  }
  return {
      {.cause = Cause::neighbours_left_out,
       .figures = {{"count", static_cast<double>(together)}},
       .message = fmt::format(
           "configurations that are neighbours of others (no joint differs by more than {:.0f} degrees, {:.0f} mm or "
           "a twentieth of its range): {}, left out together with those",
           kNeighbourDistance / kDegree, kNeighbourDistance * 1e3, together)}};
}

// Adds the errors at left-out configurations to `rows`. `rigid`: the fit of the robot that a URDF can represent.
Validation hold_out(const ValidationTask& compared, Accuracy rows, const Identification& rigid) {
  const FitProblem& task = compared.problem;
  const ValidationOptions& options = compared.options;
  const Folds singly = make_folds(task.measurements, 0);
  Validation result{.accuracy = rows, .exported = {}, .remarks = said_of_neighbours(singly)};
  Accuracy& accuracy = result.accuracy;
  const bool asked_singly = options.leave_one_out || options.nested;
  const bool by_default = options.held_out && !asked_singly && options.k_fold < 2;
  const bool many = singly.size() > kMostLeftOutSingly;
  const Folds default_folds = by_default && many ? make_folds(task.measurements, kFoldsOfMany) : singly;
  if (by_default && !can_be_left_out(task.measurements, default_folds, compared.fit.free.size())) {
    result.remarks.push_back({.cause = Cause::nothing_left_out,
                              .message = "too few measurements to predict some of them from the others: nothing is "
                                         "known of unseen configurations"});
    return result;
  }
  const auto predict = [&](const Folds& folds, const std::string& name) {
    PredictedFolds predicted = predicted_folds(compared, folds, name, accuracy.train.before.rms, rigid);
    result.held_out_points = std::move(predicted.points);
    result.remarks.insert(result.remarks.end(), predicted.remarks.begin(), predicted.remarks.end());
    return predicted.errors.after.count > 0 ? std::optional(predicted.errors) : std::nullopt;
  };
  if (asked_singly || (by_default && !many)) {
    accuracy.leave_one_out = predict(singly, "leave-one-out");
  }
  if (options.nested && needs_selection(compared.choice.options)) {
    accuracy.nested_leave_one_out = error_statistics(nested_distances(
        compared.choice, counted_fits(compared.choice.progress, "nested leave-one-out", singly.size())));
  }
  if (options.k_fold > 1 || (by_default && many)) {
    const Folds folds = options.k_fold > 1 ? make_folds(task.measurements, options.k_fold) : default_folds;
    accuracy.folds = static_cast<int>(folds.size());
    accuracy.k_fold = predict(folds, fmt::format("{}-fold", folds.size()));
  }
  return result;
}

// `rigid`: the robot that a URDF can represent.
ExportedUrdf exported_urdf(const ValidationTask& compared, const Accuracy& accuracy, const Estimate& rigid) {
  const BeforeAfter* held_out = accuracy.held_out();
  const bool is_worse_alone = held_out != nullptr && is_no_better_without_effects(*held_out);
  // A few new measurements do not overrule an earlier result.
  const bool continues = compared.problem.options.joint.residuals.earlier != nullptr;
  const bool kept = is_no_better_than_nominal(accuracy) || (is_worse_alone && !continues);
  const auto own = [&](const BeforeAfter& errors) {
    return kept ? errors.before : errors.rigid.value_or(errors.after);
  };
  return {.estimate = kept ? compared.problem.start : rigid,
          .nominal_kept = kept,
          .train = own(accuracy.train),
          .test = accuracy.test ? std::optional(own(*accuracy.test)) : std::nullopt,
          .held_out = held_out != nullptr ? std::optional(own(*held_out)) : std::nullopt};
}

}  // namespace

bool is_no_better_than_nominal(const Accuracy& accuracy) {
  const BeforeAfter* errors = accuracy.held_out();
  return errors != nullptr && errors->after.count > 0 && !(errors->after.rms < errors->before.rms);
}

bool is_no_better_without_effects(const BeforeAfter& errors) {
  return errors.rigid && errors.rigid->count > 0 && !(errors.rigid->rms < errors.before.rms);
}

Accuracy with_nominal_exported(Accuracy accuracy) {
  accuracy.train.rigid = accuracy.train.before;
  for (std::optional<BeforeAfter>* each :
       {&accuracy.train_means, &accuracy.test, &accuracy.test_means, &accuracy.leave_one_out, &accuracy.k_fold}) {
    if (*each) {
      (*each)->rigid = (*each)->before;
    }
  }
  return accuracy;
}

Validation validate(const ValidationTask& compared) {
  const Identification rigid = rigid_fit(compared);
  Validation result = hold_out(compared, compare_rows(compared, rigid.estimate), rigid);
  result.exported = exported_urdf(compared, result.accuracy, rigid.estimate);
  return result;
}

}  // namespace kdl_calibration
