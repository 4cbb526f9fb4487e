#include "estimation/input_check.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>

#include "base/number_range.hpp"
#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {

void check(const ErrorModel& model) {
  require_at_least("stations of a model", static_cast<std::ptrdiff_t>(model.stations.size()), 1);
  const std::size_t joints = model.joints.size();
  if (!model.pivots.empty()) {
    require_count("pivots of a model", model.pivots.size(), joints + 1);
  }
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
  const bool are_told_apart = measurements.stations.size() > 1 || model.has_undetermined_bases;
  if (are_told_apart && model.stations != measurements.stations) {
    throw InputError(fmt::format("{}: {} stations, expected the model's {}", measurements.source,
                                 measurements.stations.size(), model.stations.size()));
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
  require_count("targets of an estimate", estimate.frames.targets.size(), targets);
  if (estimate.effects.size() != 0) {
    require_count("effects of an estimate", estimate.effects.size(), model.effects.size());
  }
  const bool finite_targets = std::all_of(estimate.frames.targets.begin(), estimate.frames.targets.end(),
                                          [](const TargetFrame& target) { return target.X_FT.matrix().allFinite(); });
  const std::vector<Eigen::Isometry3d>& bases = estimate.frames.bases;
  const bool finite_bases =
      std::all_of(bases.begin(), bases.end(), [](const Eigen::Isometry3d& X_WB) { return X_WB.matrix().allFinite(); });
  require_count("bases of an estimate", bases.size(), model.stations.size());
  require_finite("an estimate",
                 finite_bases && estimate.errors.allFinite() && estimate.effects.allFinite() && finite_targets);
}

void check(const Estimate& estimate, const ErrorModel& model, const Measurements& measurements) {
  check(estimate, model, measurements.targets.size());
}

void check(const Unknowns& free, const ErrorModel& model, std::size_t targets) {
  require_indices("the free coordinate of bases", free.of(UnknownGroup::base), 6 * model.stations.size());
  require_indices("the free geometric parameter", free.geometric(), model.parameters.size());
  require_indices("the free effect", free.effects(), model.effects.size());
  require_indices("the free coordinate of targets", free.of(UnknownGroup::targets), 6 * targets);
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
  return X.matrix().allFinite() && X.translation().cwiseAbs().maxCoeff() <= kLargestNumber &&
         X.linear().isUnitary(kRounding) && X.linear().determinant() > 0.0;
}

void check(const RegistrationOptions& options) {
  const auto require_pose = [](const Eigen::Isometry3d& X) {
    require_finite("a known frame", X.matrix().allFinite());
    if (!is_rigid(X)) {
      refuse_input("a known frame is scaled, skewed, mirrored or beyond 1e12 m", "a rotation and a translation");
    }
  };
  for (const StationBase& base : options.known.bases) {
    if (!base.station.empty() && !is_rigid(base.X_WB)) {
      refuse_input("the known base of station " + shown(base.station) + " is not a pose",
                   "a rotation and a translation");
    }
    require_pose(base.X_WB);
  }
  for (const TargetFrame& target : options.known.targets) {
    require_pose(target.X_FT);
  }
  require_sigma("the length for orientations", options.orientation_length);
}

void check(const KnownFrames& known, const Measurements& measurements) {
  check(RegistrationOptions{.known = known});
  const std::vector<std::string>& stations = measurements.stations;
  for (const StationBase& base : known.bases) {
    if (base.station.empty() && stations.size() > 1) {
      refuse_input("a known base without its station", "one for a station of " + comma_separated(stations));
    }
    if (!base.station.empty() && std::find(stations.begin(), stations.end(), base.station) == stations.end()) {
      refuse_input(
          "a known base of station " + shown(base.station) + ", which was not measured",
          names_stations(measurements) ? "one of " + comma_separated(stations) : "a known base without a station");
    }
  }
  for (const std::string& station : stations) {
    const auto is_its_own = [&](const StationBase& base) { return base.station.empty() || base.station == station; };
    if (std::count_if(known.bases.begin(), known.bases.end(), is_its_own) > 1) {
      refuse_input("two known bases of station " + shown(station), "one for each");
    }
  }
  const std::vector<std::string>& measured = measurements.targets;
  const bool any = std::any_of(measured.begin(), measured.end(),
                               [&](const std::string& name) { return find_target(known.targets, name) != nullptr; });
  if (!known.targets.empty() && !any) {
    refuse_input("none of the known targets was measured", "some of " + comma_separated(measured));
  }
}

}  // namespace kdl_calibration
