#include "calibration/doubts.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <numbers>
#include <utility>

#include "base/distributions.hpp"
#include "base/text.hpp"
#include "calibration/noise_report.hpp"
#include "calibration/parameter_estimates.hpp"
#include "calibration/predicted_accuracy.hpp"
#include "calibration/prior_check.hpp"
#include "calibration/validation_stage.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "model/parameters.hpp"
#include "robot/joint_ranges.hpp"
#include "selection/model_score.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {
namespace {

std::vector<Subject> parameters(const std::vector<std::string>& names) {
  return subjects_named(SubjectKind::parameter, names);
}

std::vector<Subject> joints(const std::vector<std::string>& names) { return subjects_named(SubjectKind::joint, names); }

std::vector<Subject> both(std::vector<Subject> first, const std::vector<Subject>& second) {
  first.insert(first.end(), second.begin(), second.end());
  return first;
}

std::string in_millimetres(double metres) { return fmt::format("{:.4g} mm", metres * 1e3); }

// "a, b, c and 5 more"
std::string some_of(const std::vector<std::string>& names) {
  constexpr std::size_t kShown = 6;
  if (names.size() <= kShown + 1) {
    return comma_separated(names);
  }
  return fmt::format("{} and {} more", comma_separated({names.begin(), names.begin() + kShown}), names.size() - kShown);
}

std::string held_out_name(const CalibrationResult& found) {
  return found.accuracy.leave_one_out ? "leave-one-out" : fmt::format("{}-fold", found.accuracy.folds);
}

const std::string kWrongInput =
    "check the robot, the joint values with their units, signs and order, and the names of the targets";

constexpr double kSmallest = 1e-6;  // [m] smaller errors are not worth a doubt, for an arm of up to ten metres

using Doubts = std::vector<Doubt>;
using Remarks = std::vector<Remark>;

Doubts of_convergence(const CalibrationResult& found) {
  const Identification& fit = found.fit.identification;
  const std::string misfit = in_millimetres(found.accuracy.train.after.rms);
  std::string message;
  switch (fit.termination) {
    case Termination::converged:
    case Termination::rank_deficient:
      return {};
    case Termination::iteration_limit:
      message = fmt::format(
          "the fit did not converge: the parameters were still changing at the limit of iterations ({} in all)",
          fit.iterations);
      break;
    case Termination::stalled:
      message = "the fit did not converge: it stands at a misfit of " + misfit +
                " and no arm near the nominal one explains the measurements better; " + kWrongInput;
      break;
    case Termination::diverged:
      message = "the fit did not converge: it diverged to errors beyond any robot's; " + kWrongInput;
      break;
  }
  return {{.cause = Cause::not_converged,
           .figures = {{"misfit", found.accuracy.train.after.rms}, {"iterations", static_cast<double>(fit.iterations)}},
           .message = message}};
}

// Joints that do not move in the fitted rows.
std::vector<std::string> joints_at_rest(const CalibrationResult& found, const Measurements& measurements) {
  constexpr double kStill = 1e-4;  // [rad] or [m]
  const JointRanges ranges = trained_ranges(measurements);
  std::vector<std::string> result;
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    if (ranges[i].second - ranges[i].first < kStill) {
      result.push_back(found.model.joints[i].name);
    }
  }
  return result;
}

// Parameters identifiable with the targets but not determined by the measurements. The complete model always has
// undetermined ones.
std::vector<std::string> missing_parameters(const CalibrationResult& found, ModelChoice model) {
  if (model != ModelChoice::complete) {
    return without_stations(found.uncertainty.fixed_by_gauge);
  }
  const std::vector<std::string>& kept = found.fit.reduction.kept;
  const std::vector<std::string> candidates = found.fit.candidates.names();
  const auto told_apart = std::count_if(candidates.begin(), candidates.end(), [&](const std::string& name) {
    return std::find(kept.begin(), kept.end(), name) != kept.end();
  });
  const auto estimated = static_cast<std::ptrdiff_t>(found.fit.free.names().size() - found.fit.free.effects().size());
  return estimated < told_apart ? without_stations(found.uncertainty.fixed_by_gauge) : std::vector<std::string>();
}

// Whether each station has but one point. An arm of any size reaches it: no length is known.
bool has_no_length(const Measurements& measurements) {
  for (std::size_t station = 0; station < measurements.stations.size(); ++station) {
    if (undetermined_rotations(rows_of_station(measurements, station).measurements).axes.cols() < 3) {
      return false;
    }
  }
  return true;
}

Doubts of_determination(const CalibrationResult& found, const Measurements& measurements, ModelChoice model) {
  if (found.noise.source != NoiseSource::stated && found.noise.degrees_of_freedom < 1.0) {
    return {{.cause = Cause::not_determined,
             .figures = {{"degrees_of_freedom", found.noise.degrees_of_freedom}},
             .message =
                 "there are as many unknowns as measured coordinates, so that nothing shows how good the fit is; "
                 "measure more configurations"}};
  }
  const std::vector<std::string> missing = missing_parameters(found, model);
  const bool open = found.fit.identification.termination == Termination::rank_deficient;
  if (missing.empty() && !open && found.uncertainty.predicted.measured.count > 0) {
    return {};
  }
  std::string message = missing.empty()
                            ? "the measurements do not determine all parameters"
                            : fmt::format("the measurements do not determine {}{} ({})", missing.size(),
                                          missing.size() == 1 ? " parameter" : " parameters", some_of(missing));
  const std::vector<std::string> still = joints_at_rest(found, measurements);
  if (!still.empty()) {
    message += ": " + comma_separated(still) + (still.size() == 1 ? " never moves" : " never move");
  } else if (found.model.has_undetermined_bases && has_no_length(measurements)) {
    return {{.cause = Cause::not_determined,
             .subjects = parameters(missing),
             .message = message +
                        ": each station has a single point, which an arm of any size reaches; measure a second "
                        "socket at a known distance as well, in more configurations"}};
  }
  return {{.cause = Cause::not_determined,
           .subjects = both(parameters(missing), joints(still)),
           .message = message + "; predictions hold where it was measured, single parameters do not; measure more "
                                "configurations, in which every joint turns and the tool points elsewhere"}};
}

// Whether the nominal robot is kept because it is exact: both robots predict what was left out but for rounding.
bool is_exact_as_read(const CalibrationResult& found) {
  return is_no_better_than_nominal(found.accuracy) && found.accuracy.held_out()->after.rms < kSmallest;
}

Doubts of_predictions(const CalibrationResult& found) {
  Doubts doubts;
  const auto worse = [&](const BeforeAfter& errors, const std::string& where) {
    return "the calibrated robot is no better than the nominal one " + where + ": " + in_millimetres(errors.after.rms) +
           " against " + in_millimetres(errors.before.rms);
  };
  if (found.accuracy.test && found.accuracy.test->after.rms > found.accuracy.test->before.rms &&
      !(found.accuracy.test->after.rms < kSmallest)) {
    doubts.push_back(
        {.cause = Cause::worse_than_nominal,
         .figures = {{"test_rms", found.accuracy.test->after.rms}, {"nominal", found.accuracy.test->before.rms}},
         .message = worse(*found.accuracy.test, "at the test rows") +
                    "; check that they were measured under the same conditions and in the same region"});
  }
  const ErrorStatistics& uncertain = found.uncertainty.predicted.measured;
  const double nominal = found.accuracy.train.before.rms;
  if (found.accuracy.held_out() == nullptr && !found.accuracy.test && uncertain.count > 0 && uncertain.rms > nominal) {
    doubts.push_back({.cause = Cause::worse_than_nominal,
                      .figures = {{"uncertainty", uncertain.rms}, {"nominal", nominal}},
                      .message = fmt::format("the calibrated robot is uncertain by {} (1 sigma) at the measured "
                                             "configurations, more than the {} by which the nominal one is off, and no "
                                             "test or left-out configuration says otherwise; measure more",
                                             in_millimetres(uncertain.rms), in_millimetres(nominal))});
  }
  if (is_no_better_than_nominal(found.accuracy) && !is_exact_as_read(found)) {
    const BeforeAfter& held_out = *found.accuracy.held_out();
    const std::vector<NamedFigure> figures = {{"held_out_rms", held_out.after.rms}, {"nominal", held_out.before.rms}};
    doubts.push_back(
        {.cause = Cause::worse_than_nominal,
         .figures = figures,
         .message = worse(held_out, "at configurations that were not fitted (" + held_out_name(found) + ")") +
                    "; the errors may be too small for these measurements, the measurements too few, or some "
                    "input wrong: " +
                    kWrongInput});
    doubts.push_back({.cause = Cause::nominal_kept,
                      .figures = figures,
                      .message = "the calibration does not help: the nominal robot is kept, and the URDF to write is "
                                 "the one that was read"});
  }
  return doubts;
}

// [m] RMS of the fitted rows; with a robust loss of the rows with weight.
double misfit_of(const CalibrationResult& found, const Measurements& measurements) {
  if (found.fit.robust.weights.empty()) {
    return found.accuracy.train.after.rms;
  }
  const std::vector<double> distances =
      position_errors(found.model, found.fit.identification.estimate, measurements, Rows::all);
  double squares = 0.0;
  double count = 0.0;
  for (std::size_t row = 0; row < distances.size(); ++row) {
    if (measurements.observations[row].split == Split::train && found.fit.robust.weights[row] > 0.0) {
      squares += distances[row] * distances[row];
      count += 1.0;
    }
  }
  return std::sqrt(squares / std::max(count, 1.0));
}

Doubts of_size(const CalibrationResult& found, const Measurements& measurements) {
  Doubts doubts;
  constexpr double kMostOfReach = 0.01;
  constexpr double kMostMisfit = 0.005;  // [m] of an arm with a reach of up to 3 m
  constexpr double kMostOfLongReach = kMostMisfit / 3.0;
  const double length = reach(found.model);
  const double rigid = std::max(kMostMisfit, kMostOfLongReach * length);
  const double misfit = misfit_of(found, measurements);
  if (length > 0.0 && misfit > std::min(kMostOfReach * length, rigid)) {
    doubts.push_back({.cause = Cause::large_misfit,
                      .figures = {{"misfit", misfit}, {"reach", length}},
                      .message = fmt::format("a misfit of {} is left, and an arm with a reach of {:.4g} m that is "
                                             "rigid and was measured well keeps at most 5 mm and 1 % of its reach; {}",
                                             in_millimetres(misfit), length, kWrongInput)});
  }
  std::vector<std::string> unknown;
  for (const ParameterEstimate& parameter : found.uncertainty.parameters) {
    if (std::isfinite(parameter.std) && is_unknown(found.model, parameter)) {
      unknown.push_back(parameter.name);
    }
  }
  if (!unknown.empty()) {
    doubts.push_back({.cause = Cause::unknown_length,
                      .subjects = parameters(unknown),
                      .message = "the uncertainty exceeds the link itself for " + some_of(unknown) +
                                 "; measure more configurations, or hold what is known"});
  }
  return doubts;
}

// What distances and single coordinates cannot show by their residuals.
Doubts of_lengths(const CalibrationResult& found, const Diagnosis& diagnosis, const Measurements& measurements) {
  constexpr double kMostUncertain = 10.0;  // of the noise
  constexpr double kMostExcess = 3.0;      // of the residuals over the stated noise
  Doubts doubts;
  if (!has_single_coordinates(measurements)) {
    return doubts;
  }
  const bool is_named = !diagnosis.gross_rows.rows.empty() || !diagnosis.findings.empty();
  const bool are_many = 2 * rows_of_single_coordinates(measurements) > measurements.observations.size();
  const PredictedAccuracy& predicted = found.uncertainty.predicted;
  const double open = std::sqrt(variance_of_fit(predicted));
  const bool is_known = predicted.measured.count > 0;
  if (!is_named && are_many && is_known && open > kMostUncertain * found.noise.sigma && open > kSmallest) {
    const double excess = std::sqrt(found.noise.variance_factor);
    if (excess > kMostExcess) {
      doubts.push_back(
          {.cause = Cause::large_misfit,
           .figures = {{"noise_ratio", excess}, {"uncertainty", open}},
           .message = fmt::format(
               "the coordinates or distances are off by {:.4g} times their stated noise, and the whole points "
               "are uncertain by {} (1 sigma) even at the measured configurations; check the places of anchors or "
               "planes, a constant error of all distances, and the joint values",
               excess, in_millimetres(open))});
      return doubts;
    }
    doubts.push_back({.cause = Cause::not_determined,
                      .figures = {{"uncertainty", open}},
                      .message = fmt::format(
                          "the coordinates or distances agree with the fit, but the whole points are uncertain by {} "
                          "(1 sigma) even at the measured configurations; measure along other directions, or from more "
                          "anchors beside the robot",
                          in_millimetres(open))});
  }
  return doubts;
}

// Limits of plausible errors: 2 % of the reach, 20 degrees. On 18 arms of twelve makers the largest errors were 6.3 mm
// and 3 degrees.
Doubts of_errors(const CalibrationResult& found) {
  constexpr double kMostOfReach = 0.02;
  constexpr double kMostAngle = 20.0 * std::numbers::pi / 180.0;
  constexpr double kSignificant = 3.0;  // sigma beyond the limit
  const double most_length = kMostOfReach * reach(found.model);
  for (const ParameterEstimate& parameter : found.uncertainty.parameters) {
    const bool offset = parameter.kind == ParameterKind::joint_offset;
    if (parameter.joint.empty() || parameter.kind == ParameterKind::effect || !std::isfinite(parameter.std) ||
        parameter.gauge) {
      continue;
    }
    const auto joint = std::find_if(found.model.joints.begin(), found.model.joints.end(),
                                    [&](const MovingJoint& j) { return j.name == parameter.joint; });
    const bool slides = joint != found.model.joints.end() && joint->type == JointType::prismatic;
    const bool length = offset ? slides : parameter.kind == ParameterKind::translation;
    const double size = std::abs(parameter.error);
    if (size - kSignificant * parameter.std > (length ? most_length : kMostAngle)) {
      const std::string amount =
          length ? in_millimetres(size) : fmt::format("{:.4g} degrees", size * 180.0 / std::numbers::pi);
      return {{.cause = Cause::large_error,
               .subjects = both(parameters({parameter.name}), joints({parameter.joint})),
               .figures = {{"error", parameter.error}, {"std", parameter.std}},
               .message = "an error of " + amount + " in " + parameter.name + " (" + parameter.joint +
                          ") is beyond what builders and mastering leave; check " +
                          (offset ? "the mastering of that joint and the joint values"
                                  : "the URDF (another arm's, or an origin missing) and a known base")}};
    }
  }
  return {};
}

// Test rows that are off by more than their radius, beyond chance. Where nothing was left out, the radius does not know
// by how much the choice of the model flatters it.
Doubts of_tests(const CalibrationResult& found) {
  constexpr double kFalseAlarm = 1e-3;
  constexpr double kLargeArm = 10.0;  // [m]
  const double smallest = kSmallest * std::max(1.0, reach(found.model) / kLargeArm);
  const TestedRadius& tested = found.uncertainty.predicted.tested;
  const BeforeAfter* held_out = found.accuracy.held_out();
  if (!found.accuracy.test || held_out == nullptr || !(tested.p_value < kFalseAlarm) ||
      found.accuracy.test->after.rms < smallest ||
      found.accuracy.test->after.rms > found.accuracy.test->before.rms) {  // said already
    return {};
  }
  return {{.cause = Cause::test_rows_differ,
           .figures = {{"test_rms", found.accuracy.test->after.rms},
                       {"held_out_rms", held_out->after.rms},
                       {"count", static_cast<double>(tested.outside)},
                       {"out_of", static_cast<double>(tested.configurations)},
                       {"p_value", tested.p_value}},
           .message = fmt::format("the test rows contradict the result: they are missed by {}, configurations left "
                                  "out of the fit by {}, and {} of {} are off by more than the radius that holds for "
                                  "95 %; check that all were measured in the same way, with the same payload and "
                                  "names of targets",
                                  in_millimetres(found.accuracy.test->after.rms), in_millimetres(held_out->after.rms),
                                  tested.outside, tested.configurations)}};
}

// Gross rows.
Doubts of_rows(const CalibrationResult& found, const GrossRows& gross) {
  const std::vector<GrossRow>& rows = gross.rows;
  if (rows.empty()) {
    return {};
  }
  std::vector<std::string> words;
  std::vector<Subject> subjects;
  double largest = 0.0;
  for (const GrossRow& row : rows) {
    subjects.push_back({SubjectKind::configuration, row.configuration});
    if (!row.target.empty()) {
      subjects.push_back({SubjectKind::target, row.target});
    }
    largest = std::max(largest, row.distance);
    words.push_back("configuration " + row.configuration + (row.target.empty() ? "" : ", target " + row.target) +
                    " by " + in_millimetres(row.distance));
  }
  return {{.cause = Cause::gross_rows,
           .subjects = std::move(subjects),
           .figures = {{"distance", largest},
                       {"misfit", found.accuracy.train.after.rms},
                       {"misfit_without", gross.rms_without}},
           .message = "not where all others put " + std::string(rows.size() == 1 ? "it" : "them") + ": " +
                      some_of(words) + "; without that the misfit is " + in_millimetres(gross.rms_without) +
                      ", with it " + in_millimetres(found.accuracy.train.after.rms) +
                      "; check joint values and coordinates, or leave it out"}};
}

Doubts of_readings(const std::vector<AlternativeReading>& readings) {
  Doubts doubts;
  for (const AlternativeReading& reading : readings) {
    if (reading.doubt) {
      doubts.push_back(reading.as_doubt());
    }
  }
  return doubts;
}

bool is_worse_elsewhere(const CalibrationResult& found) {
  return found.uncertainty.predicted.workspace.count > 0 &&
         found.uncertainty.predicted.workspace.rms > found.accuracy.train.before.rms;
}

// Whether the geometry alone predicts left-out configurations better than the model with effects.
bool has_harmful_effects(const CalibrationResult& found) {
  constexpr double kWorse = 1.0 / kClearlyBetter;
  const BeforeAfter* held_out = found.accuracy.held_out();
  return held_out != nullptr && held_out->rigid && held_out->rigid->count > 0 &&
         held_out->after.rms > kWorse * held_out->rigid->rms;
}

std::vector<std::string> names_of(const std::vector<EffectTerm>& terms) {
  std::vector<std::string> names;
  std::transform(terms.begin(), terms.end(), std::back_inserter(names),
                 [](const EffectTerm& term) { return term.name; });
  return names;
}

Remark said_of_harmful_effects(const CalibrationResult& found) {
  const BeforeAfter& held_out = *found.accuracy.held_out();
  return {.cause = Cause::harmful_effects,
          .subjects = subjects_named(SubjectKind::effect, names_of(found.model.effects)),
          .figures = {{"held_out_rms", held_out.after.rms}, {"geometry_alone", held_out.rigid->rms}},
          .message = "the effects make predictions worse: configurations left out of the fit are missed by " +
                     in_millimetres(held_out.after.rms) + " with the effects and by " +
                     in_millimetres(held_out.rigid->rms) + " by the geometry alone; leave the effects out"};
}

// None if the zero of the distances is not significant, or there are none.
Remarks said_of_zero(const CalibrationResult& found) {
  if (!found.distance_zero || found.distance_zero->length == 0.0) {
    return {};
  }
  const DistanceZero& zero = *found.distance_zero;
  return {
      {.cause = Cause::distances_corrected,
       .figures = {{"estimate", zero.length}, {"estimate_sigma", zero.sigma}},
       .message = fmt::format(
           "all distances are {} too {} (1 sigma {}), the zero of their instrument: they were corrected by it",
           in_millimetres(std::abs(zero.length)), zero.length > 0.0 ? "long" : "short", in_millimetres(zero.sigma))}};
}

std::vector<std::string> changed_parameters(const EarlierComparison& comparison) {
  std::vector<std::string> names;
  std::transform(comparison.changes.begin(), comparison.changes.end(), std::back_inserter(names),
                 [](const auto& change) { return change.first; });
  return names;
}

Doubts of_earlier_result(const CalibrationResult& found) {
  const auto& continued = found.selection.continued;
  if (!continued || !continued->comparison.contradicts()) {
    return {};
  }
  const EarlierComparison& comparison = continued->comparison;
  return {{.cause = Cause::another_robot,
           .subjects = parameters(changed_parameters(comparison)),
           .figures = {{"p_value", comparison.p_value},
                       {"count", static_cast<double>(comparison.changes.size())},
                       {"out_of", static_cast<double>(comparison.changeable)},
                       {"noise_ratio", comparison.noise_ratio}},
           .message = fmt::format("the measurements contradict the earlier result (p = {:.1e}): {} of {} geometric "
                                  "errors would have changed, and {:.3g} times its noise remains; a crash changes few: "
                                  "is this another robot of the type? Calibrate it without the earlier result",
                                  comparison.p_value, comparison.changes.size(), comparison.changeable,
                                  comparison.noise_ratio)}};
}

// None if the measurements agree with the earlier result, or if there is none.
Remarks said_of_change(const CalibrationResult& found) {
  const auto& continued = found.selection.continued;
  if (!continued || !continued->comparison.has_changed() || continued->comparison.contradicts()) {
    return {};
  }
  const EarlierComparison& comparison = continued->comparison;
  return {{.cause = Cause::robot_changed,
           .subjects = parameters(changed_parameters(comparison)),
           .figures = {{"p_value", comparison.p_value}},
           .message = fmt::format("the robot has changed since the earlier result (p = {:.1e}); estimated anew: {}",
                                  comparison.p_value, some_of(in_words(found.model, comparison)))}};
}

// None if the exported URDF, which has no effects, predicts better than the nominal robot, or nothing does.
Remarks said_of_urdf(const CalibrationResult& found) {
  const Accuracy& accuracy = found.accuracy;
  for (const BeforeAfter* errors : {accuracy.held_out(), accuracy.test ? &*accuracy.test : nullptr}) {
    if (errors != nullptr && errors->after.rms < errors->before.rms && is_no_better_without_effects(*errors)) {
      return {{.cause = Cause::urdf_without_effects,
               .figures = {{"geometry_alone", errors->rigid->rms}, {"nominal", errors->before.rms}},
               .message = fmt::format(
                   "without the effects, which no URDF holds, the geometry is no better than the nominal robot ({} "
                   "against {} {}){}; correct the commands instead",
                   in_millimetres(errors->rigid->rms), in_millimetres(errors->before.rms),
                   errors == accuracy.held_out() ? "at left-out configurations" : "at the test rows",
                   found.exported.nominal_kept ? ": the URDF to write is the one that was read" : "")}};
    }
  }
  return {};
}

// None if the noise of the stations is alike.
Remarks said_of_stations(const CalibrationResult& found) {
  const std::vector<NoiseFactors>& factors = found.noise.stations;
  if (factors.empty()) {
    return {};
  }
  std::vector<double> sigmas;
  for (std::size_t station = 0; station < factors.size(); ++station) {
    sigmas.push_back(found.noise.sigma_at(station));
  }
  const auto [least, most] = std::minmax_element(sigmas.begin(), sigmas.end());
  const auto name = [&](auto sigma) {
    return found.model.stations[static_cast<std::size_t>(std::distance(sigmas.begin(), sigma))];
  };
  return {
      {.cause = Cause::unlike_stations,
       .subjects = subjects_named(SubjectKind::station, {name(most), name(least)}),
       .figures = {{"noise_ratio", *most / *least}, {"sigma", *most}},
       .message = fmt::format("the stations measure unlike: {} per coordinate at {}, {} at {}; each row counts by "
                              "the noise of its station",
                              in_millimetres(*most), shown(name(most)), in_millimetres(*least), shown(name(least)))}};
}

// About parameters that the measurements cannot tell apart, and how they are resolved.
Remarks said_of_gauge(const CalibrationResult& found) {
  Remarks result;
  const auto add = [&](Cause cause, const std::vector<std::string>& names, const std::string& message) {
    result.push_back({.cause = cause, .subjects = parameters(names), .message = message});
  };
  const std::vector<std::string>& fixed = found.uncertainty.fixed_by_gauge;
  const bool open = found.fit.identification.termination == Termination::rank_deficient || !fixed.empty();
  for (const std::vector<std::string>& group : found.uncertainty.identifiability.tied) {
    if (!open || found.fit.minimum_norm) {  // resolved by priors, or named below
      break;
    }
    add(Cause::not_told_apart, group,
        group.size() == 1 ? "the measurements do not depend on " + group.front()
                          : "the measurements cannot tell apart: " + comma_separated(group));
  }
  if (found.fit.minimum_norm) {
    add(Cause::smallest_errors, fixed,
        "what the measurements cannot tell apart (" + some_of(fixed) +
            ") was set to the smallest errors that fit; predictions hold, single parameters do not");
    return result;
  }
  const std::vector<std::string> of_arm = without_stations(fixed);
  std::vector<std::string> of_stations = fixed;
  std::erase_if(of_stations, [](const std::string& name) { return !is_of_station(name); });
  if (!of_stations.empty()) {
    add(Cause::held_as_registered, of_stations,
        "held as registered: " + some_of(of_stations) +
            " (the points of a station do not determine them; predictions of the arm do not depend on them)");
  }
  if (!of_arm.empty()) {
    add(Cause::held_by_gauge, of_arm,
        "fixed by gauge: " + comma_separated(of_arm) +
            " (errors at zero, frames as registered); predictions hold where it was measured, single parameters do "
            "not");
  }
  return result;
}

Remark said_of_rows(const QualityFinding& finding) {
  std::vector<Subject> subjects = subjects_named(SubjectKind::target, finding.targets);
  subjects.insert(subjects.begin(), {SubjectKind::configuration, finding.configuration});
  if (finding.axis != ' ') {
    subjects.push_back({SubjectKind::coordinate, std::string(1, finding.axis)});
  }
  return {.cause = Cause::wrong_rows,
          .subjects = std::move(subjects),
          .figures = {{"estimate", finding.amount}},
          .message = "measurements: " + finding.message};
}

bool is_outside_limits(const MovingJoint& joint, double value) {
  constexpr double kSlack = 1e-9;
  return value < joint.lower.value_or(value) - kSlack || value > joint.upper.value_or(value) + kSlack;
}

Remarks said_of_limits(const CalibrationResult& found, const Measurements& measurements) {
  const int outside = configurations_outside_limits(found.model, measurements);
  if (outside == 0) {
    return {};
  }
  std::vector<std::string> names;
  for (std::size_t i = 0; i < found.model.joints.size(); ++i) {
    const MovingJoint& joint = found.model.joints[i];
    const auto values = measurements.joint_values.row(static_cast<Eigen::Index>(i));
    if (std::any_of(values.begin(), values.end(), [&](double value) { return is_outside_limits(joint, value); })) {
      names.push_back(joint.name);
    }
  }
  const auto all = measurements.joint_values.cols();
  return {{.cause = Cause::outside_joint_limits,
           .subjects = joints(names),
           .figures = {{"count", static_cast<double>(outside)}, {"out_of", static_cast<double>(all)}},
           .message =
               fmt::format("{} of {} configurations have joint values outside the limits of the URDF", outside, all)}};
}

// RMS of the residuals of a coordinate over what the noise leaves of it after the fit; 1 where too little is left.
double residuals_over_noise(const CalibrationResult& found, const Measurements& measurements) {
  constexpr double kFew = 10.0;
  double coordinates = 0.0;
  for (const Observation& o : measurements.observations) {
    coordinates += o.split == Split::train ? dimension(o.reading) : 0;
  }
  const double left = coordinates - static_cast<double>(found.fit.free.size());
  const ErrorStatistics& fitted = found.accuracy.train.after;
  const double squares = fitted.rms * fitted.rms * static_cast<double>(fitted.count);
  return left >= kFew && found.noise.sigma > 0.0 ? std::sqrt(squares / left) / found.noise.sigma : 1.0;
}

// About the noise and the priors.
Remarks said_of_noise(const CalibrationResult& found, const Measurements& measurements) {
  constexpr double kFew = 10.0;
  constexpr double kFarBelow = 1.0 / 3.0;
  Remarks result;
  if (found.noise.variance_factor > 1.0) {
    const double ratio = std::sqrt(found.noise.variance_factor);
    result.push_back({.cause = Cause::beyond_stated_noise,
                      .figures = {{"noise_ratio", ratio}},
                      .message = fmt::format("the residuals are {:.4g} times the stated noise; {}", ratio,
                                             found.noise.parts ? "what is beyond it counts as misfit of the model"
                                                               : "the uncertainties were scaled up by that")});
  }
  if (const double ratio = residuals_over_noise(found, measurements); ratio < kFarBelow) {
    result.push_back({.cause = Cause::beyond_stated_noise,
                      .figures = {{"noise_ratio", ratio}},
                      .message = fmt::format("the residuals are only {:.2g} times the noise of {}; is it stated in "
                                             "metres? All uncertainties follow from it",
                                             ratio, in_millimetres(found.noise.sigma))});
  }
  if (is_exact_as_read(found)) {
    const double nominal = found.accuracy.held_out()->before.rms;
    result.push_back({.cause = Cause::nominal_is_exact,
                      .figures = {{"nominal", nominal}},
                      .message = "the nominal robot is kept because it is exact: it predicts left-out configurations "
                                 "to " +
                                 in_millimetres(nominal) +
                                 "; positions that were computed from it instead of measured look like this"});
  }
  if (const double freedom = found.noise.degrees_of_freedom;
      found.noise.source != NoiseSource::stated && freedom < kFew) {
    result.push_back({.cause = Cause::few_data,
                      .figures = {{"degrees_of_freedom", freedom}},
                      .message = fmt::format("few data: all uncertainties rest on {:.4g} degrees of freedom; measure "
                                             "more configurations or state the noise",
                                             freedom)});
  }
  if (const double excess = excess_over_priors(found); excess > 1.0) {
    result.push_back({.cause = Cause::priors_too_narrow,
                      .figures = {{"prior_ratio", excess}},
                      .message = fmt::format("the estimated errors are {:.4g} times as large as the priors expect, so "
                                             "the priors hold them too close to nominal; state larger priors, or none",
                                             excess)});
  }
  return result;
}

// About the fit and its predictions.
Remarks said_of_model(const CalibrationResult& found, const Diagnosis& diagnosis) {
  Remarks result;
  if (const auto& test = found.noise.lack_of_fit; test && test->p_value < kMisfitCertain) {
    result.push_back({.cause = Cause::lack_of_fit,
                      .figures = {{"p_value", test->p_value}},
                      .message = "lack of fit: the residuals are larger than the scatter of the repeats explains"});
  }
  if (has_harmful_effects(found)) {
    result.push_back(said_of_harmful_effects(found));
  }
  if (diagnosis.doubts.empty() && is_worse_elsewhere(found)) {
    const double uncertainty = found.uncertainty.predicted.workspace.rms;
    const double nominal = found.accuracy.train.before.rms;
    result.push_back({.cause = Cause::uncertain_elsewhere,
                      .figures = {{"uncertainty", uncertainty}, {"nominal", nominal}},
                      .message = "beyond the measured configurations a point may be predicted worse than by the "
                                 "nominal robot: 1 sigma of " +
                                 in_millimetres(uncertainty) + " over the whole workspace, nominal error " +
                                 in_millimetres(nominal) + "; use the calibrated robot where it was measured"});
  }
  return result;
}

}  // namespace

std::vector<Doubt> doubts(const CalibrationResult& found, const Diagnosis& diagnosis, const Measurements& measurements,
                          ModelChoice model) {
  Doubts result;
  // First what would explain the misfit, last that the fit did not end.
  for (const Doubts& some : {of_readings(diagnosis.alternative_readings), of_rows(found, diagnosis.gross_rows),
                             of_earlier_result(found), of_determination(found, measurements, model),
                             of_predictions(found), of_tests(found), of_size(found, measurements), of_errors(found),
                             of_lengths(found, diagnosis, measurements), of_convergence(found)}) {
    result.insert(result.end(), some.begin(), some.end());
  }
  return result;
}

bool holds_where_measured(const CalibrationResult& found, const std::vector<Doubt>& doubts,
                          const std::string& ambiguity) {
  constexpr double kOfNominal = 0.5;
  const BeforeAfter* held_out = found.accuracy.held_out();
  const std::vector<std::string> fixed = without_stations(found.uncertainty.fixed_by_gauge);
  const auto is_of_frame = [](const std::string& name) { return name.find('.') != std::string::npos; };
  return doubts.size() == 1 && doubts.front().cause == Cause::not_determined && !fixed.empty() &&
         std::none_of(fixed.begin(), fixed.end(), is_of_frame) && ambiguity.empty() &&
         found.uncertainty.predicted.measured.count > 0 && held_out != nullptr && held_out->after.count > 0 &&
         held_out->after.rms < kOfNominal * held_out->before.rms;
}

std::vector<Remark> remarks(const CalibrationResult& found, const Diagnosis& diagnosis,
                            const Measurements& measurements, const std::string& ambiguity) {
  Remarks of_data;
  for (const QualityFinding& finding : diagnosis.findings) {
    of_data.push_back(said_of_rows(finding));
  }
  for (const AlternativeReading& reading : diagnosis.alternative_readings) {
    if (!reading.doubt) {
      of_data.push_back(reading.as_doubt());
    }
  }
  if (!ambiguity.empty()) {
    of_data.push_back({.cause = Cause::ambiguous_registration, .message = "registration: " + ambiguity});
  }
  Remarks result;
  for (const Remarks& some : {said_of_gauge(found), of_data, said_of_limits(found, measurements),
                              said_of_noise(found, measurements), said_of_zero(found), said_of_change(found),
                              said_of_urdf(found), said_of_stations(found), said_of_model(found, diagnosis)}) {
    result.insert(result.end(), some.begin(), some.end());
  }
  return result;
}

bool is_uncertain_elsewhere(const CalibrationResult& calibration) {
  return calibration.trusted() && is_worse_elsewhere(calibration);
}

int configurations_outside_limits(const ErrorModel& model, const Measurements& measurements) {
  int outside = 0;
  for (Eigen::Index c = 0; c < measurements.joint_values.cols(); ++c) {
    bool is_outside = false;
    for (std::size_t i = 0; i < model.joints.size(); ++i) {
      const double value = measurements.joint_values(static_cast<Eigen::Index>(i), c);
      is_outside = is_outside || is_outside_limits(model.joints[i], value);
    }
    outside += is_outside ? 1 : 0;
  }
  return outside;
}

}  // namespace kdl_calibration
