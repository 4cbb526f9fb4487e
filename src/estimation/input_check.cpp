#include "kdl_calibration/input_check.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

void require_count(const char* what, std::size_t count, std::size_t expected) {
  if (count != expected) {
    throw InputError(std::to_string(count) + " " + what + ", expected " + std::to_string(expected));
  }
}

void require_sigma(const char* what, double sigma) {
  if (!std::isfinite(sigma) || sigma < 0.0) {
    throw InputError(std::string(what) + " is negative or not finite, expected 0 or more");
  }
}

void require_indices(const char* what, const std::vector<std::size_t>& indices, std::size_t count) {
  if (std::any_of(indices.begin(), indices.end(), [&](std::size_t index) { return index >= count; })) {
    throw InputError(std::string(what) + " beyond the model's " + std::to_string(count));
  }
}

}  // namespace

void check(const Measurements& measurements, const ErrorModel& model) {
  check(measurements);
  const auto joints = static_cast<std::size_t>(measurements.joint_values.rows());
  if (joints != model.joints.size()) {
    throw InputError(measurements.source + ": joint values of " + std::to_string(joints) +
                     " joints, expected the robot's " + std::to_string(model.joints.size()));
  }
  for (std::size_t j = 0; j < measurements.joints.size(); ++j) {
    if (measurements.joints[j] != model.joints[j].name) {
      throw InputError(measurements.source + ": joint '" + measurements.joints[j] + "' where the robot has '" +
                       model.joints[j].name + "'; the measurements are of another robot");
    }
  }
}

void check(const Estimate& estimate, const ErrorModel& model, const Measurements& measurements) {
  require_count("errors of an estimate", static_cast<std::size_t>(estimate.errors.size()), model.parameters.size());
  require_count("targets of an estimate", estimate.targets.size(), measurements.targets.size());
  if (estimate.effects.size() != 0) {
    require_count("effects of an estimate", static_cast<std::size_t>(estimate.effects.size()), model.effects.size());
  }
  const bool finite_targets = std::all_of(estimate.targets.begin(), estimate.targets.end(),
                                          [](const TargetFrame& target) { return target.X_FT.matrix().allFinite(); });
  if (!estimate.errors.allFinite() || !estimate.effects.allFinite() || !estimate.X_WB.matrix().allFinite() ||
      !finite_targets) {
    throw InputError("the estimate has a value that is not finite");
  }
}

void check(const Unknowns& free, const ErrorModel& model, const Measurements& measurements) {
  require_indices("a free geometric parameter", free.geometric(), model.parameters.size());
  require_indices("a free effect", free.effects(), model.effects.size());
  if (!free.range(UnknownGroup::targets).empty() &&
      free.of(UnknownGroup::targets).back() >= 6 * measurements.targets.size()) {
    throw InputError("free coordinates of a target beyond the " + std::to_string(measurements.targets.size()) +
                     " measured");
  }
}

void check(const ResidualOptions& options, const Measurements& measurements) {
  require_sigma("the prior of lengths", options.priors.length);
  require_sigma("the prior of angles", options.priors.angle);
  for (int axis = 0; axis < 3; ++axis) {
    require_sigma("the noise of points by themselves", options.noise.independent[axis]);
    require_sigma("the noise common to a repeat", options.noise.common[axis]);
  }
  require_sigma("the noise of orientations", options.noise.orientation);
  require_sigma("the length for orientations", options.orientation_length);
  if (const auto& tracker = options.noise.tracker) {
    for (const double sigma :
         {tracker->range, tracker->range_per_metre, tracker->transverse, tracker->transverse_per_metre}) {
      require_sigma("the noise of the tracker", sigma);
    }
  }
  if (!options.row_weights.empty()) {
    require_count("weights of rows", options.row_weights.size(), measurements.observations.size());
    for (const double weight : options.row_weights) {
      require_sigma("the weight of a row", weight);
    }
  }
}

void check(const RegistrationOptions& options) {
  const bool finite = std::all_of(options.known_targets.begin(), options.known_targets.end(),
                                  [](const TargetFrame& target) { return target.X_FT.matrix().allFinite(); });
  if (!finite || (options.known_base && !options.known_base->matrix().allFinite())) {
    throw InputError("a known frame has a value that is not finite");
  }
  require_sigma("the length for orientations", options.orientation_length);
}

}  // namespace kdl_calibration
