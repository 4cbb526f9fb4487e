#include "diagnosis/alternative_readings.hpp"

#include <fmt/core.h>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <utility>

#include "base/distributions.hpp"
#include "base/number_range.hpp"
#include "base/text.hpp"
#include "diagnosis/convention_trial.hpp"
#include "diagnosis/likely_mistake.hpp"
#include "diagnosis/orientation_trial.hpp"
#include "diagnosis/point_trial.hpp"
#include "diagnosis/repeated_configurations.hpp"
#include "diagnosis/trial_fit.hpp"
#include "diagnosis/trial_sample.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"
#include "noise/lack_of_fit.hpp"
#include "screening/gross_rows.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Vector3d;

constexpr std::size_t kMostSampled = 300;
constexpr std::size_t kMostPoses = 75;    // four points each
constexpr int kSteps = 20;                // iterations of a trial fit
constexpr double kFalseAlarmRate = 1e-4;  // of all readings together
constexpr double kNoMisfit = 1e-7;        // [m]
constexpr double kLeastFactor = 0.02;     // least deviation from 1 of the points' scale for the nominal robot
constexpr const char* kLengthsSetWrong = "unit, temperature or instrument set wrong";
constexpr double kLeastCommonLength = 0.005;  // least common relative error of fitted lengths
constexpr double kLeastMisfitOfAUnit = 0.05;  // [m] that a unit leaves of the nominal arm
constexpr double kStandsStill = 0.05;         // share of the flange's motion

std::string in_mm(double metres) {
  const double value = metres * 1e3;
  const int decimals = value >= 99.95 ? 0 : value >= 0.995 ? 1 : 3;
  return fmt::format("{:.{}f} mm", value, decimals);
}

// Whether there is a misfit for another reading to explain.
bool is_misfit(double present, double freedom) { return present > kNoMisfit && freedom >= 1.0; }

// Whether another reading reduces the misfit to less than a third, significantly among `readings` trials.
bool explains(double other, double present, double freedom, double readings) {
  if (!is_misfit(present, freedom) || !(other < kMostMisfitLeft * present)) {
    return false;
  }
  const double ratio = present / std::max(other, kNoMisfit * 1e-3);
  return readings * f_upper_tail(ratio * ratio, freedom, freedom) < kFalseAlarmRate;
}

// Options of a trial fit without a goal.
JointOptions trial_fits() { return {.max_iterations = kSteps, .residuals = {}}; }

// Tries the readings one after the other.
class ReadingTrials {
public:
  ReadingTrials(const ErrorModel& model, const Measurements& measurements, const Estimate& fit, TrialSample sample,
                const ReadingOptions& options)
      : model_(model),
        measurements_(measurements),
        fit_(fit),
        options_(options),
        sample_(std::move(sample)),
        nominal_(nominal_start(model, sample_.measurements, options.registration)),
        X_BF_(flange_poses(model, nominal_, sample_.measurements)),
        registered_(rms_of(model, sample_.measurements, nominal_)),
        remark_(options.remark),
        fitted_(std::min(plausible(model, fit.errors) ? rms_of(model, sample_.measurements, fit) : registered_,
                         trial(sample_.measurements, trial_fits()))) {}

  ReadingSearch verdict() {
    // Coarse mistakes first: if one explains the data, finer ones are meaningless.
    std::vector<DetectableMistake> detectable;
    std::vector<AlternativeReading> own;
    try_displayed();
    if (readings_.empty()) {
      try_scale();
    }
    const bool tried = !(fitted_ < options_.least_misfit);
    if (tried && readings_.empty()) {
      try_joint_values_and_points();
    }
    if (tried && readings_.empty()) {
      const TrainingRows training(measurements_);
      MistakeSearch found = likely_mistake({.model = model_,
                                            .measurements = *training,
                                            .estimate = fit_,
                                            .known = options_.registration.known,
                                            .fix = options_.fix,
                                            .uncertainty = options_.uncertainty,
                                            .stated = options_.stated,
                                            .scale_sigma = options_.scale_sigma,
                                            .unknowns = sample_.free.size(),
                                            .alternatives = options_.alternatives,
                                            .threads = options_.threads});
      detectable = std::move(found.detectable);
      own = std::move(found.own);
      if (found.mistake) {
        readings_.push_back(std::move(*found.mistake));
      }
    }
    try_joint_functions();
    readings_.insert(readings_.end(), own.begin(), own.end());
    const std::vector<AlternativeReading> repeated = repeated_configurations(measurements_);
    readings_.insert(readings_.end(), repeated.begin(), repeated.end());
    return {.readings = std::move(readings_), .detectable = std::move(detectable)};
  }

  // Readings of the joint values only, for points derived from poses.
  std::vector<AlternativeReading> trials_of_poses() {
    remark_ += " (orientations as points " + in_mm(kLeverOfOrientations) + " away)";
    if (!(fitted_ < options_.least_misfit)) {
      try_joint_values_and_points();
    }
    return std::move(readings_);
  }

private:
  bool enough_equations() const { return sample_.freedom >= 0.0; }

  double trial(const Measurements& reading, const JointOptions& joint) const {
    const TrialFit fit{.model = model_, .free = sample_.free, .registration = options_.registration, .joint = joint};
    const Estimate start = nominal_start(model_, reading, options_.registration);
    return rms_of(model_, reading, start) < kWorthAFit * registered_ && enough_equations()
               ? fitted_rms(fit, reading, start)
               : rms_of(model_, reading, start);
  }

  // What the data may be read as.
  struct OtherReading {
    Cause cause;
    std::string words;
    std::vector<Subject> subjects = {};
    std::vector<NamedFigure> figures = {};
  };

  void add_reading(const OtherReading& reading, double left, double instead) {
    std::vector<NamedFigure> figures = reading.figures;
    figures.insert(figures.end(), {{"misfit", instead}, {"misfit_without", left}});
    readings_.push_back({.cause = reading.cause,
                         .subjects = reading.subjects,
                         .figures = std::move(figures),
                         .message = "as they were read the measurements leave a misfit of " + in_mm(instead) + remark_ +
                                    "; with " + reading.words + " it is " + in_mm(left) + "; " + kUsedAsRead});
  }

  // No arm is as its drawing says, to the last digit of the file.
  void try_displayed() {
    constexpr double kOfRounding = 0.75;  // 0.5 is the RMS distance from three rounded coordinates
    if (const double step = rounding_of(sample_.measurements); registered_ < kOfRounding * step) {
      readings_.push_back(
          {.cause = Cause::displayed_positions,
           .figures = {{"misfit", registered_}},
           .message =
               fmt::format("the nominal robot fits the points to {:.2g} mm, the rounding of their coordinates: they "
                           "seem to be computed by the controller, as it displays them, and not measured",
                           registered_ * 1e3)});
    }
  }

  // Tries points whose distances are too large or too small for the nominal robot, or that hardly move.
  void try_scale() {
    if (!options_.registration.known.bases.empty() || !options_.registration.known.targets.empty()) {
      return;
    }
    // Lengths that are not fitted cannot absorb a scale, see try_lengths.
    const double least = sample_.free.geometric().empty() ? kLeastCommonLength : kLeastFactor;
    const std::optional<Vector3d> scales = coordinate_scales(X_BF_, sample_.measurements);
    if (scales) {
      const double common = std::cbrt(scales->prod());
      const bool alike = scales->maxCoeff() < 2.0 * scales->minCoeff();
      if (!alike || std::abs(common - 1.0) > least) {
        try_scale(alike ? Vector3d::Constant(common) : *scales, alike);
      }
    }
    // If the tip always touches one place, the points hardly move either, but fit the nominal robot.
    const Motion moved = motion(X_BF_, sample_.measurements);
    if (readings_.empty() && moved.share() < kStandsStill && registered_ > kStandsStill * moved.flange) {
      readings_.push_back({.cause = Cause::tool_frame,
                           .figures = {{"moved_points", moved.points}, {"moved_flange", moved.flange}},
                           .message = "the measured points hardly move while the flange does: they seem to be "
                                      "coordinates in the frame of the tool"});
    }
  }

  void try_scale(const Vector3d& factors, bool alike) {
    const Measurements reading = divided(sample_.measurements, factors);
    const double left = rms_of(model_, reading, nominal_start(model_, reading));
    const double freedom = 3.0 * static_cast<double>(X_BF_.size()) - 9.0;
    // In the robot's unit, so that a large scale does not increase the misfit.
    const double present = registered_ / std::max(1.0, factors.maxCoeff());
    if (motion(X_BF_, reading).share() < kStandsStill || !explains(left, present, freedom, 1.0)) {
      return;
    }
    if (!alike) {
      Index axis = 0;
      (factors / std::cbrt(factors.prod())).array().log().abs().maxCoeff(&axis);
      const std::string name(1, static_cast<char>('x' + axis));
      add_reading({.cause = Cause::length_unit,
                   .words = fmt::format("{} in another unit than the other coordinates (x, y and z are {:.3g}, {:.3g} "
                                        "and {:.3g} times too large)",
                                        name, factors[0], factors[1], factors[2]),
                   .subjects = {{SubjectKind::coordinate, name}},
                   .figures = {{"factor_x", factors[0]}, {"factor_y", factors[1]}, {"factor_z", factors[2]}}},
                  left, registered_);
      return;
    }
    const std::string units = units_of_factor(factors[0]);
    add_reading(
        {.cause = units.empty() ? Cause::scale : Cause::length_unit,
         .words = fmt::format("points that are {:.4g} times too far apart ({})", factors[0],
                              units.empty() ? kLengthsSetWrong : units),
         .figures = {units.empty() ? NamedFigure{"estimate", factors[0] - 1.0} : NamedFigure{"factor", factors[0]}}},
        left, registered_);
  }

  void try_joint_values_and_points() {
    if (!is_misfit(fitted_, sample_.freedom)) {
      return;
    }
    JointOptions other = trial_fits();
    other.goal = kMostMisfitLeft * fitted_;
    const std::vector<ConventionTrial> trials = try_conventions(model_, sample_.measurements, sample_.free,
                                                                {.used = options_.used,
                                                                 .others = options_.others,
                                                                 .registration = options_.registration,
                                                                 .joint = other,
                                                                 .threads = options_.threads,
                                                                 .progress = options_.progress});
    const double readings = 3.0 + static_cast<double>(trials.size());
    double best = fitted_;
    const auto consider = [&](const OtherReading& reading, double left) {
      if (left < best && explains(left, fitted_, sample_.freedom, readings)) {
        best = left;
        readings_.clear();
        add_reading(reading, left, fitted_);
      }
    };
    const auto joints = std::find_if(trials.begin(), trials.end(), [](const auto& trial) { return !trial.present; });
    if (joints != trials.end()) {
      consider({.cause = *joints->cause, .words = joints->description, .subjects = joints->joints}, joints->rms);
    }
    if (!options_.registration.known.bases.empty()) {
      RegistrationOptions anywhere = options_.registration;
      anywhere.known.bases.clear();
      const Unknowns free = sample_.free.with_group(model_, UnknownGroup::base);
      const TrialFit fit{.model = model_, .free = free, .registration = anywhere, .joint = other};
      consider({.cause = Cause::known_base, .words = "the base fitted instead of taken as known"},
               sample_.freedom < 6.0
                   ? kInfinity
                   : fitted_rms(fit, sample_.measurements, nominal_start(model_, sample_.measurements, anywhere)));
    }
    consider({.cause = Cause::mirrored,
              .words = "the points mirrored (a left-handed frame, a wrong sign or two coordinates exchanged)"},
             trial(mirrored(sample_.measurements), other));
    if (const auto inverted = with_poses_inverted(measurements_)) {
      consider({.cause = Cause::tool_frame,
                .words = "every pose inverted (they are poses of the world seen from the tool; invert them)"},
               trial(trial_sample(model_, *inverted, sample_.free, kMostSampled).measurements, other));
    }
    if (const auto exchange = exchanged_targets(X_BF_, sample_.measurements, options_.registration)) {
      consider(reading_of(*exchange), trial(exchange->repaired, other));
    }
  }

  OtherReading reading_of(const Exchange& exchange) const {
    const std::string& first = sample_.measurements.targets[static_cast<std::size_t>(exchange.first)];
    const std::string& second = sample_.measurements.targets[static_cast<std::size_t>(exchange.second)];
    const std::string& from = sample_.measurements.configurations[static_cast<std::size_t>(exchange.from)];
    return {
        .cause = Cause::exchanged_targets,
        .words = "targets " + first + " and " + second + " exchanged from configuration " + from + " on",
        .subjects = {{SubjectKind::target, first}, {SubjectKind::target, second}, {SubjectKind::configuration, from}}};
  }

  void try_joint_functions() {
    const double visits = static_cast<double>(X_BF_.size());
    const double rest = sample_.freedom / std::max(sample_.points_of_a_configuration, 1.0) - 6.0;
    if (!readings_.empty() || !(fitted_ > kNoMisfit) || !(rest > 0.0) || visits < 10.0) {
      return;
    }
    const std::vector<double> shares = explained_by_joints(model_, fit_, sample_.measurements);
    for (std::size_t j = 0; j < shares.size(); ++j) {
      const double p_value = f_upper_tail(shares[j] / 6.0 / std::max(1.0 - shares[j], 1e-12) * rest, 6.0, rest);
      if (shares[j] > 0.5 && p_value < 1e-3) {
        readings_.push_back(
            {.cause = Cause::joint_function,
             .subjects = {{SubjectKind::joint, model_.joints[j].name}},
             .figures = {{"explained", shares[j]}, {"p_value", p_value}},
             .message = fmt::format("a function of {} alone explains {:.2g} % of the residuals' squares (p = {:.1g})",
                                    model_.joints[j].name, 100.0 * shares[j], p_value),
             .doubt = false});
      }
    }
  }

  const ErrorModel& model_;
  const Measurements& measurements_;
  const Estimate& fit_;
  const ReadingOptions& options_;
  TrialSample sample_;
  Estimate nominal_;
  std::vector<Eigen::Isometry3d> X_BF_;  // of the nominal robot
  double registered_ = 0.0;
  std::string remark_;  // text after the misfit
  double fitted_ = 0.0;
  std::vector<AlternativeReading> readings_;
};

}  // namespace

namespace {

// [m] RMS of the measured coordinates and distances, `factor` times as long, from those of the nominal arm with
// registered bases and targets.
double nominal_misfit(const ErrorModel& model, Measurements rows, double factor) {
  for (Observation& observation : rows.observations) {
    observation.sigma = 0.0;
    observation.position() *= factor;
    if (auto* const distance = std::get_if<Distance>(&observation.reading)) {
      distance->length *= factor;
    }
  }
  const Estimate nominal = nominal_start(model, rows);
  const double cost = LeastSquaresProblem(model, rows, Unknowns(model, nominal.frames.targets, {})).cost(nominal);
  return std::sqrt(cost / dimension(rows));
}

}  // namespace

std::vector<AlternativeReading> readings_of_unit(const ErrorModel& model, const Measurements& measurements) {
  const double as_read = nominal_misfit(model, measurements, 1.0);
  if (!(as_read > kLeastMisfitOfAUnit)) {
    return {};
  }
  for (const double factor : {1e3, 1e-3}) {
    if (const double instead = nominal_misfit(model, measurements, factor); instead < kMostMisfitLeft * as_read) {
      return {
          {.cause = Cause::length_unit,
           .figures = {{"factor", 1.0 / factor}, {"misfit", as_read}, {"misfit_without", instead}},
           .message = fmt::format("as they were read the measurements leave a misfit of {} of the nominal arm; with "
                                  "all lengths times {:.4g} ({}) it is {}; {}",
                                  in_mm(as_read), factor, units_of_factor(1.0 / factor), in_mm(instead), kUsedAsRead)}};
    }
  }
  return {};
}

ReadingSearch search_readings(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                              const Unknowns& free, const ReadingOptions& options) {
  const auto sample = [&](const Measurements& all, const Unknowns& unknowns, std::size_t most) {
    return trial_sample(model, all, unknowns, most);
  };
  ReadingSearch search =
      ReadingTrials(model, measurements, fit, sample(measurements, free, kMostSampled), options).verdict();
  std::vector<AlternativeReading>& found = search.readings;
  const bool doubted = std::any_of(found.begin(), found.end(), [](const AlternativeReading& one) { return one.doubt; });
  if (has_orientations(measurements)) {
    const std::optional<OrientationTrial> turned = try_orientations(model, measurements, fit);
    if (turned && turned->explained && (!doubted || turned->of_most_rows)) {
      // What else was found in a fit to orientations that were misread is a consequence.
      std::erase_if(found, [](const AlternativeReading& other) { return other.doubt; });
      found.insert(found.begin(), turned->said);
      return search;
    }
    if (doubted) {
      return search;
    }
    PosePoints points = pose_points(model, measurements, fit, free, options.registration);
    ReadingOptions of_points = options;
    of_points.registration = std::move(points.registration);
    ReadingTrials trials(model, points.measurements, points.fit, sample(points.measurements, points.free, kMostPoses),
                         of_points);
    std::vector<AlternativeReading> more = trials.trials_of_poses();
    if (more.empty() && turned) {
      more.push_back(turned->said);
    }
    found.insert(found.begin(), more.begin(), more.end());
  }
  return search;
}

std::vector<AlternativeReading> alternative_readings(const ErrorModel& model, const Measurements& measurements,
                                                     const Estimate& fit, const Unknowns& free,
                                                     const ReadingOptions& options) {
  return search_readings(model, measurements, fit, free, options).readings;
}

namespace {

// All parameters of the reduced model except known frames.
Unknowns unknowns_of_reduced_model(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                                   const KnownFrames& known) {
  ReductionOptions options;
  const auto hold = [&](const std::vector<std::string>& names) {
    options.fixed.insert(options.fixed.end(), names.begin(), names.end());
  };
  if (!known.bases.empty()) {
    hold(base_parameter_names());
  }
  for (const TargetFrame& target : targets) {
    if (find_target(known.targets, target.name) != nullptr) {
      hold(target_parameter_names(target));
    }
  }
  return Unknowns(model, targets, reduced_model(model, targets, options).kept);
}

}  // namespace

std::vector<AlternativeReading> alternative_readings_of_nominal(const ErrorModel& model,
                                                                const Measurements& measurements,
                                                                const Estimate& registered, ReadingOptions options) {
  constexpr double kBeyondErrors = 0.01;  // of the arm
  const TrainingRows training(measurements);
  const Unknowns all = unknowns_of_reduced_model(model, registered.frames.targets, options.registration.known);
  if (trial_sample(model, *training, all, kMostSampled).freedom < 1.0) {
    options.least_misfit = kBeyondErrors * arm_length(model);
    return alternative_readings(model, measurements, registered, all.without(UnknownGroup::geometric), options);
  }
  options.remark += " with its geometry fitted";
  const Identification found = identify_jointly(model, *training, registered, all, trial_fits());
  return alternative_readings(model, measurements,
                              plausible(model, found.estimate.errors) ? found.estimate : registered, all, options);
}

}  // namespace kdl_calibration
