#include "calibration/comparison.hpp"

#include <algorithm>
#include <cstddef>

#include "calibration/counted_fits.hpp"
#include "kdl_calibration/fold_sums.hpp"
#include "kdl_calibration/same_poses.hpp"

namespace kdl_calibration {
namespace {

bool has_effects(const Compared& compared) { return !compared.fit.free.effects().empty(); }

// The best that a URDF can carry: where effects were fitted, a fit without them.
Estimate rigid_fit(const Compared& compared) {
  const FitTask& task = compared.task;
  return has_effects(compared) ? fit({.model = task.model,
                                      .measurements = task.measurements,
                                      .start = task.start,
                                      .free = compared.fit.free.without(UnknownGroup::effects),
                                      .options = compared.rigid_options})
                                     .estimate
                               : compared.fit.identification.estimate;
}

using Folds = std::vector<std::vector<Eigen::Index>>;

FitOptions counting(FitOptions options, const Compared& compared, const std::string& stage, std::size_t fits) {
  options.after_fit = counted_fits(compared.task.options, stage, fits);
  return options;
}

// Whether sums over large folds are faster than looking at their configurations one by one.
bool is_many(const Folds& folds) {
  std::size_t count = 0;
  for (const std::vector<Eigen::Index>& fold : folds) {
    count += fold.size();
  }
  return count > kMostLeftOutSingly;
}

constexpr double kShareOfNominal = 1e-5;

// The nominal robot, which leaves that much of all [m], with base and targets registered to the others.
std::vector<double> nominal_folds(const Compared& compared, const Folds& folds, double nominal) {
  const FitTask& task = compared.task;
  const Unknowns frames = compared.fit.free.without(UnknownGroup::geometric).without(UnknownGroup::effects);
  if (frames.size() == 0) {  // nothing is registered
    const Measurements means = averaged(task.measurements);
    return position_errors(task.model, task.start, means);
  }
  // Nominal errors are large: where the noise is none they need not be as exact as it.
  const double noise = std::max(compared.noise, kShareOfNominal * nominal);
  FitOptions options;
  options.joint.residuals.orientation_length = task.fit_options.joint.residuals.orientation_length;
  const FitProblem registered{
      .model = task.model, .measurements = task.measurements, .start = task.start, .free = frames, .options = options};
  if (is_many(folds)) {
    return cross_validate_by_sums(registered, folds, noise, task.options.threads).distances;
  }
  const LeastSquaresProblem problem(task.model, task.measurements, frames, options.joint.residuals);
  const Eigen::MatrixXd triangle = problem.whitened_summary(task.start).triangle;
  return distances_of(
      predict_folds({.problem = registered, .triangle = triangle, .noise = noise}, folds, task.options.threads));
}

// Each fold predicted by the nominal robot, by the calibrated one and by what a URDF can carry of it.
BeforeAfter predicted_folds(const Compared& compared, const Folds& folds, const std::string& name, double nominal,
                            HeldOutErrors& errors) {
  const FitTask& task = compared.task;
  const Estimate& estimate = compared.fit.identification.estimate;
  const auto left_out = [&](const ErrorModel& model, const Unknowns& free, const Estimate& start,
                            const FitOptions& options) {
    return cross_validate({.model = model,
                           .measurements = task.measurements,
                           .start = start,
                           .free = free,
                           .options = counting(options, compared, name, folds.size())},
                          folds, task.options.threads);
  };
  HoldOut after;
  const FitProblem fitted{.model = task.model,
                          .measurements = task.measurements,
                          .start = estimate,
                          .free = compared.fit.free,
                          .options = counting(task.fit_options, compared, name, folds.size())};
  if (compared.triangle != nullptr && is_many(folds)) {
    after = cross_validate_by_sums(fitted, folds, compared.noise, task.options.threads);
  } else if (compared.triangle != nullptr) {
    errors.prediction = predict_folds({.problem = fitted, .triangle = *compared.triangle, .noise = compared.noise},
                                      folds, task.options.threads);
    for (HeldOutPoint& point : errors.prediction.points) {
      point.covariance *= compared.variance;
    }
    after = {.distances = distances_of(errors.prediction),
             .refits = static_cast<int>(folds.size()),
             .not_converged = errors.prediction.not_converged};
  } else {
    after = left_out(task.model, compared.fit.free, estimate, task.fit_options);
  }
  if (after.not_converged > 0) {
    errors.warnings.push_back(std::to_string(after.not_converged) + " of " + std::to_string(after.refits) + " " + name +
                              " fits did not converge");
  }
  BeforeAfter result;
  result.before = error_statistics(nominal_folds(compared, folds, nominal));
  result.after = error_statistics(after.distances);
  if (has_effects(compared)) {
    ErrorModel model = task.model;
    model.effects.clear();
    Estimate rigid = estimate;  // what is not free stays where it is
    rigid.effects.resize(0);
    const Unknowns free = compared.fit.free.without(UnknownGroup::effects);
    result.rigid = error_statistics(left_out(model, free, rigid, compared.rigid_options).distances);
  }
  return result;
}

// Test rows at fitted poses test the fit at what it has seen: their errors are kept apart.
void tell_test_rows_apart(const Compared& compared, const std::vector<Eigen::Isometry3d>& X_BF, Comparison& result) {
  const Measurements& measurements = compared.measurements;
  const std::vector<bool> trained = trained_configurations(measurements);
  const std::vector<Eigen::Index> first = first_at_same_pose(measurements.joint_values);
  std::vector<bool> fitted(first.size(), false);  // of the first configuration at each pose
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
  if (!at_fitted.empty()) {
    result.test_at_fitted_poses = error_statistics(at_fitted);
    result.test_at_new_poses = at_new.empty() ? std::nullopt : std::optional(error_statistics(at_new));
  }
}

}  // namespace

Comparison compare(const Compared& compared) {
  const FitTask& task = compared.task;
  const Measurements& measurements = compared.measurements;
  const Estimate& estimate = compared.fit.identification.estimate;
  Comparison result;
  result.exported.estimate = rigid_fit(compared);
  const Estimate& rigid = result.exported.estimate;
  const auto poses_of = [&](const Estimate& e) { return flange_poses(task.model, e, measurements); };
  const std::vector<Eigen::Isometry3d> X_BF_before = poses_of(task.start);
  const std::vector<Eigen::Isometry3d> X_BF_after = poses_of(estimate);
  const auto statistics = [&](const Estimate& e, const std::vector<Eigen::Isometry3d>& X_BF, Rows rows) {
    return error_statistics(position_errors(X_BF, e, measurements, rows));
  };
  const auto pair_of = [&](Rows rows) {
    return BeforeAfter{.before = statistics(task.start, X_BF_before, rows),
                       .after = statistics(estimate, X_BF_after, rows),
                       .rigid = std::nullopt};
  };
  result.train = pair_of(Rows::train);
  result.iso_before = iso_9283(X_BF_before, task.start, measurements);
  result.iso_after = iso_9283(X_BF_after, estimate, measurements);
  if (compared.tested) {
    result.test = pair_of(Rows::test);
    tell_test_rows_apart(compared, X_BF_after, result);
    result.iso_test_before = iso_9283(X_BF_before, task.start, measurements, Rows::test);
    result.iso_test_after = iso_9283(X_BF_after, estimate, measurements, Rows::test);
  }
  if (has_effects(compared)) {
    const std::vector<Eigen::Isometry3d> X_BF_rigid = poses_of(rigid);
    result.train.rigid = statistics(rigid, X_BF_rigid, Rows::train);
    result.exported.iso = iso_9283(X_BF_rigid, rigid, measurements);
    if (compared.tested) {
      result.test->rigid = statistics(rigid, X_BF_rigid, Rows::test);
    }
  } else {
    result.exported.iso = result.iso_after;
  }
  return result;
}

HeldOutErrors hold_out(const Compared& compared, const Comparison& fitted) {
  const FitTask& task = compared.task;
  const CalibrationOptions& options = task.options;
  const double nominal = fitted.train.before.rms;
  HeldOutErrors result;
  const Folds singly = make_folds(task.measurements, 0);
  const std::vector<bool> trained = trained_configurations(task.measurements);
  const auto together = std::count(trained.begin(), trained.end(), true) - static_cast<std::ptrdiff_t>(singly.size());
  if (together > 0) {
    result.warnings.push_back(
        std::to_string(together) +
        " configurations are neighbours of others (no joint differs by more than 3 degrees, 50 mm "
        "or a twentieth of its range): they are left out together");
  }
  const bool asked_singly = options.leave_one_out || options.nested;
  const bool by_default = options.held_out && !asked_singly && options.k_fold < 2;
  const bool many = singly.size() > kMostLeftOutSingly;
  const Folds default_folds = by_default && many ? make_folds(task.measurements, kFoldsOfMany) : singly;
  if (by_default && !can_be_left_out(task.measurements, default_folds, compared.fit.free.size())) {
    result.warnings.emplace_back(
        "too few measurements to predict some of them from the others: nothing is known of unseen configurations");
    return result;
  }
  if (asked_singly || (by_default && !many)) {
    result.leave_one_out = predicted_folds(compared, singly, "leave-one-out", nominal, result);
  }
  if (options.nested && choice_is_open(options)) {
    result.nested_leave_one_out = error_statistics(
        nested_distances(compared.choice, counted_fits(options, "nested leave-one-out", singly.size())));
  }
  if (options.k_fold > 1 || (by_default && many)) {
    const Folds folds = options.k_fold > 1 ? make_folds(task.measurements, options.k_fold) : default_folds;
    result.folds = static_cast<int>(folds.size());
    result.k_fold = predicted_folds(compared, folds, std::to_string(folds.size()) + "-fold", nominal, result);
  }
  return result;
}

}  // namespace kdl_calibration
