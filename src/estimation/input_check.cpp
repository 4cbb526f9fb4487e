#include "estimation/input_check.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {

void check(const ErrorModel& model) {
  const std::size_t joints = model.joints.size();
  for (const ErrorParameter& parameter : model.parameters) {
    const std::size_t frames = parameter.kind == ParameterKind::joint_offset ? joints : joints + 1;
    require_index("the frame of a parameter", parameter.frame, frames);
  }
  for (const EffectTerm& term : model.effects) {
    require_index("the joint of an effect", term.index, joints);
    require_sigma("the prior of an effect", term.sigma);
    require_finite("an effect", std::isfinite(term.mean) && std::isnormal(term.scale));
  }
}

void check(const Measurements& measurements, const ErrorModel& model) {
  check(model);
  check(measurements);
  const bool apart = measurements.stations.size() > 1 || !model.stations.empty();
  if (apart && model.stations != measurements.stations) {
    throw InputError(fmt::format("{}: {} stations, expected the model's {}", measurements.source,
                                 std::max<std::size_t>(measurements.stations.size(), 1),
                                 std::max<std::size_t>(model.stations.size(), 1)));
  }
  const auto joints = static_cast<std::size_t>(measurements.joint_values.rows());
  if (joints != model.joints.size()) {
    throw InputError(fmt::format("{}: joint values of {} joints, expected the robot's {}", measurements.source, joints,
                                 model.joints.size()));
  }
  for (std::size_t j = 0; j < measurements.joints.size(); ++j) {
    if (measurements.joints[j] != model.joints[j].name) {
      throw InputError(measurements.source + ": joint '" + measurements.joints[j] + "' where the robot has '" +
                       model.joints[j].name + "'; the measurements are of another robot");
    }
  }
}

void check(const Estimate& estimate, const ErrorModel& model, std::size_t targets) {
  require_count("errors of an estimate", estimate.errors.size(), model.parameters.size());
  require_count("targets of an estimate", estimate.targets.size(), targets);
  if (estimate.effects.size() != 0) {
    require_count("effects of an estimate", estimate.effects.size(), model.effects.size());
  }
  const bool finite_targets = std::all_of(estimate.targets.begin(), estimate.targets.end(),
                                          [](const TargetFrame& target) { return target.X_FT.matrix().allFinite(); });
  const bool finite_bases = std::all_of(estimate.other_bases.begin(), estimate.other_bases.end(),
                                        [](const Eigen::Isometry3d& X_WB) { return X_WB.matrix().allFinite(); });
  require_count("bases of an estimate", estimate.other_bases.size() + 1,
                std::max<std::size_t>(model.stations.size(), 1));
  require_finite("an estimate", finite_bases && estimate.errors.allFinite() && estimate.effects.allFinite() &&
                                    estimate.X_WB.matrix().allFinite() && finite_targets);
}

void check(const Estimate& estimate, const ErrorModel& model, const Measurements& measurements) {
  check(estimate, model, measurements.targets.size());
}

void check(const Unknowns& free, const ErrorModel& model, std::size_t targets) {
  require_indices("the free coordinate of bases", free.of(UnknownGroup::base),
                  6 * std::max<std::size_t>(model.stations.size(), 1));
  require_indices("the free geometric parameter", free.geometric(), model.parameters.size());
  require_indices("the free effect", free.effects(), model.effects.size());
  require_indices("the free coordinate of targets", free.of(UnknownGroup::targets), 6 * targets);
}

void check(const Unknowns& free, const ErrorModel& model, const Measurements& measurements) {
  check(free, model, measurements.targets.size());
}

void check(const std::vector<std::vector<Eigen::Index>>& folds, const Measurements& measurements) {
  for (const std::vector<Eigen::Index>& fold : folds) {
    require_at_least("configurations of a fold", fold.size(), 1);
    require_indices("the configuration of a fold", fold, measurements.configurations.size());
  }
}

void check(const FitProblem& problem) {
  check(problem.measurements, problem.model);
  check(problem.start, problem.model, problem.measurements);
  check(problem.free, problem.model, problem.measurements);
  check(problem.options.joint.residuals, problem.measurements);
}

void check(const Priors& priors) {
  require_sigma("the prior of lengths", priors.length);
  require_sigma("the prior of angles", priors.angle);
}

void check(const NoiseModel& noise) {
  for (int axis = 0; axis < 3; ++axis) {
    require_sigma("the noise of points by themselves", noise.independent[axis]);
    require_sigma("the noise common to a repeat", noise.common[axis]);
  }
  require_sigma("the misfit of configurations", noise.misfit);
  require_sigma("the misfit of targets", noise.target_misfit);
  require_sigma("the noise of orientations", noise.orientation);
  if (const auto& tracker = noise.tracker) {
    for (const double sigma :
         {tracker->range, tracker->range_per_metre, tracker->transverse, tracker->transverse_per_metre}) {
      require_sigma("the noise of the tracker", sigma);
    }
  }
}

void check(const ResidualOptions& options, const Measurements& measurements) {
  check(options.priors);
  check(options.noise);
  require_sigma("the length for orientations", options.orientation_length);
  if (has_single_coordinates(measurements) && !options.noise.is_isotropic()) {
    throw InputError(measurements.source +
                     ": single coordinates with a noise by axis, of the tracker or common to points: expected one "
                     "sigma for all coordinates");
  }
  if (has_single_coordinates(measurements) && has_orientations(measurements)) {
    throw InputError(measurements.source + ": orientations beside single coordinates, expected one of the two");
  }
  if (!options.row_weights.empty()) {
    require_count("weights of rows", options.row_weights.size(), measurements.observations.size());
    for (const double weight : options.row_weights) {
      require_sigma("the weight of a row", weight);
    }
  }
}

bool is_rigid(const Eigen::Isometry3d& X) {
  constexpr double kRounding = 1e-6;
  return X.matrix().allFinite() && X.linear().isUnitary(kRounding) && X.linear().determinant() > 0.0;
}

void check(const RegistrationOptions& options) {
  const bool finite = std::all_of(options.known_targets.begin(), options.known_targets.end(),
                                  [](const TargetFrame& target) { return target.X_FT.matrix().allFinite(); });
  require_finite("a known frame", finite && (!options.known_base || options.known_base->matrix().allFinite()));
  if ((options.known_base && !is_rigid(*options.known_base)) ||
      !std::all_of(options.known_targets.begin(), options.known_targets.end(),
                   [](const TargetFrame& target) { return is_rigid(target.X_FT); })) {
    refuse_input("a known frame is scaled, skewed or mirrored", "a rotation and a translation");
  }
  for (const StationBase& base : options.known_stations) {
    if (!is_rigid(base.X_WB)) {
      refuse_input("the known base of station " + shown(base.station) + " is not a pose",
                   "a rotation and a translation");
    }
  }
  require_sigma("the length for orientations", options.orientation_length);
}

void check(const RegistrationOptions& options, const Measurements& measurements) {
  check(options);
  const std::vector<std::string>& stations = measurements.stations;
  if (options.known_base && stations.size() > 1) {
    refuse_input("a known base without its station", "one for a station of " + comma_separated(stations));
  }
  for (const StationBase& base : options.known_stations) {
    if (stations.size() < 2 || std::find(stations.begin(), stations.end(), base.station) == stations.end()) {
      refuse_input("a known base of station " + shown(base.station) + ", which was not measured",
                   stations.size() < 2 ? "a known base without a station" : "one of " + comma_separated(stations));
    }
  }
  const std::vector<std::string>& measured = measurements.targets;
  const bool any = std::any_of(measured.begin(), measured.end(), [&](const std::string& name) {
    return find_target(options.known_targets, name) != nullptr;
  });
  if (!options.known_targets.empty() && !any) {
    refuse_input("none of the known targets was measured", "some of " + comma_separated(measured));
  }
}

}  // namespace kdl_calibration
