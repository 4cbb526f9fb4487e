#include "calibration/option_check.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "calibration/calibration_settings.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/input_check.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"
#include "noise/noise_components.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;

// Requires torques of every joint that has one in some measured configuration.
void require_torques(const Measurements& measurements, const DriveSignals& signals,
                     const std::vector<std::string>& configurations) {
  for (Index j = 0; j < measurements.joint_values.rows(); ++j) {
    if (!has_torques(measurements.signals, j)) {
      continue;
    }
    for (std::size_t c = 0; c < configurations.size(); ++c) {
      if (signals.torques.size() > 0 && !std::isnan(signals.torques(j, static_cast<Index>(c)))) {
        continue;
      }
      const std::string joint = measurements.joints.empty() ? "joint number " + std::to_string(j + 1)
                                                            : measurements.joints[static_cast<std::size_t>(j)];
      throw InputError(measurements.source + ": configuration " + shown(configurations[c]) + " has no torque of " +
                       joint + ", expected one in each that is measured or predicted for the effect torque");
    }
  }
}

// Least share of the repeats' scatter that counts as independent noise along an axis.
constexpr double kLeastShareOfRepeats = 1e-3;

void require_predictable(const Configurations& asked, const ErrorModel& model) {
  if (!asked.names.empty() || asked.joint_values.size() != 0) {
    require_count("joint values to predict at", asked.joint_values.rows(), model.joints.size());
    require_count("names of configurations to predict at", asked.names.size(), asked.joint_values.cols());
    require_finite("where to predict", asked.joint_values.allFinite());
  }
}

}  // namespace

void require_repeats(const Measurements& measurements) {
  const RepeatNoise repeats = noise_from_repeats(measurements);
  if (repeats.degrees_of_freedom == 0.0) {
    throw OptionError("weights", "noise by repeats needs configurations that were measured more than once, and " +
                                     measurements.source + " has none");
  }
  if (!(repeats.independent.minCoeff() > kLeastShareOfRepeats * repeats.total.maxCoeff())) {
    throw OptionError("weights",
                      "the repeats of single points in " + measurements.source +
                          " do not vary along every axis; state the noise of points by themselves",
                      {"noise.independent"});
  }
}

void require_comparable_orientations(const Measurements& measurements, const NoiseOptions& options) {
  if (!(options.stated.orientation > 0.0)) {
    return;
  }
  if (!has_orientations(measurements)) {
    throw OptionError("noise.orientation", "no row of " + measurements.source + " has a quaternion");
  }
  const bool every_row = std::all_of(measurements.observations.begin(), measurements.observations.end(),
                                     [](const Observation& observation) { return observation.sigma > 0.0; });
  if (!options.stated.is_absolute() && options.weights != Weights::repeats && !every_row) {
    throw OptionError("noise.orientation",
                      "needs the noise of positions as well: of points by themselves, of the tracker, by repeats or a "
                      "sigma in every row",
                      {"noise.independent", "noise.tracker", "weights"});
  }
}

void require_two_step_data(const Unknowns& free, const Measurements& measurements, const CalibrationSettings& options) {
  if (options.estimator.method != Method::two_step) {
    return;
  }
  if (measurements.stations.size() > 1) {
    throw OptionError("method", "the two-step procedure finds one base, and " + measurements.source +
                                    " has several stations, which need the joint estimate");
  }
  const std::size_t targets = measurements.targets.size();
  const bool free_base = free.range(UnknownGroup::base).count == 6;
  const bool free_targets = free.range(UnknownGroup::targets).count >= static_cast<Eigen::Index>(3 * targets);
  if (!free_base || !free_targets) {
    throw OptionError("method", "the two-step procedure finds base and targets, which cannot be known or fixed");
  }
  if (has_orientations(measurements)) {
    throw OptionError("method", "the two-step procedure fits points; the measured orientations of " +
                                    measurements.source + " need the joint estimate");
  }
  const bool priors = options.selection.priors.length > 0.0 || options.selection.priors.angle > 0.0;
  if (priors || needs_selection(options.selection) || options.estimator.loss != Loss::none ||
      options.noise.weights == Weights::repeats) {
    throw OptionError("method", "the published two-step procedure has no priors, effects, losses or noise model");
  }
}

void require_whole_points(const Measurements& measurements, const CalibrationSettings& options) {
  if (!has_single_coordinates(measurements)) {
    return;
  }
  const auto refuse = [&](const char* option, const std::string& what) {
    throw OptionError(option, what + " whole points, and " + measurements.source + " has single coordinates");
  };
  if (options.estimator.method == Method::two_step) {
    refuse("method", "the two-step procedure fits");
  }
  if (options.estimator.loss != Loss::none) {
    refuse("loss", "robust losses judge");
  }
  if (options.noise.weights == Weights::repeats) {
    refuse("weights", "noise by repeats needs");
  }
  if (options.validation.nested) {
    refuse("nested", "nested folds compare");
  }
  if (options.selection.earlier) {
    refuse("prior_result", "an earlier result is compared with");
  }
}

void require_signals(const Measurements& measurements, const CalibrationSettings& options) {
  const Configurations& asked = options.predict_at;
  if (const std::string fault = fault_of(asked.signals, asked.joint_values, " to predict at"); !fault.empty()) {
    throw InputError(fault);
  }
  const std::vector<EffectGroup>& groups = options.selection.effects.groups;
  for (const EffectGroup group : groups) {
    const std::optional<Circumstance> needed = needed_circumstance(group);
    if (needed && !is_stated_of_any_link(measurements.signals, *needed)) {
      throw OptionError(
          "effects", fmt::format("{} needs the column {} in the measurements", to_string(group), to_string(*needed)));
    }
  }
  if (std::find(groups.begin(), groups.end(), EffectGroup::torque) == groups.end()) {
    return;
  }
  if (measurements.signals.torques.array().isNaN().all()) {  // also true for an empty matrix
    throw OptionError("effects", "torque needs measured torques, expected columns tau_<joint> in the measurements");
  }
  require_torques(measurements, measurements.signals, measurements.configurations);
  require_torques(measurements, asked.signals, asked.names);
}

void check_options(const ErrorModel& model, const Measurements& measurements, const Measurements& training,
                   const CalibrationSettings& options) {
  check(measurements, model);
  check(options.parameters.known, measurements);
  check({.priors = options.selection.priors, .noise = options.noise.stated, .row_weights = {}}, measurements);
  require_predictable(options.predict_at, model);
  if (training.observations.empty()) {
    throw InputError(training.source + ": no rows to fit; expected rows whose split is 'train'");
  }
  require_whole_points(measurements, options);
  require_comparable_orientations(measurements, options.noise);
  require_signals(measurements, options);
  if (options.noise.weights == Weights::repeats) {
    require_repeats(training);
  }
}

}  // namespace kdl_calibration
