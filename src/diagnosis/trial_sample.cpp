#include "diagnosis/trial_sample.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <set>
#include <utility>
#include <vector>

#include "measurements/readings.hpp"
#include "measurements/training_rows.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Vector3d;

// The position coordinates among target coordinates, see Unknown::index.
std::vector<std::size_t> coordinates(std::vector<std::size_t> of_targets) {
  std::erase_if(of_targets, [](std::size_t index) { return index % 6 >= 3; });
  return of_targets;
}

}  // namespace

TrialSample trial_sample(const ErrorModel& model, const Measurements& measurements, const Unknowns& free,
                         std::size_t most_configurations) {
  TrialSample sample{.measurements = without_orientations(training_sample(measurements, most_configurations)),
                     .free = free};
  for (Observation& observation : sample.measurements.observations) {
    observation.sigma = 0.0;
  }
  sample.free = free.with(model, UnknownGroup::targets, coordinates(free.of(UnknownGroup::targets)));
  std::set<std::pair<int, int>> points;
  for (const Observation& observation : sample.measurements.observations) {
    points.insert({observation.configuration, observation.target});
  }
  sample.freedom = 3.0 * static_cast<double>(points.size()) - static_cast<double>(sample.free.size());
  sample.points_of_a_configuration =
      static_cast<double>(points.size()) /
      static_cast<double>(std::max<Eigen::Index>(sample.measurements.joint_values.cols(), 1));
  return sample;
}

namespace {

struct Lever {
  const char* name;
  Vector3d p_T;  // [m]
};

const std::array<Lever, 4>& levers() {
  static const std::array<Lever, 4> all = {
      Lever{"", Vector3d::Zero()}, Lever{".x", kLeverOfOrientations * Vector3d::UnitX()},
      Lever{".y", kLeverOfOrientations * Vector3d::UnitY()}, Lever{".z", kLeverOfOrientations * Vector3d::UnitZ()}};
  return all;
}

std::vector<TargetFrame> with_levers(const std::vector<TargetFrame>& targets) {
  std::vector<TargetFrame> result;
  for (const TargetFrame& target : targets) {
    for (const Lever& lever : levers()) {
      TargetFrame frame{.name = target.name + lever.name};
      frame.X_FT.translation() = target.X_FT * lever.p_T;
      result.push_back(frame);
    }
  }
  return result;
}

}  // namespace

PosePoints pose_points(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                       const Unknowns& free, const RegistrationOptions& registration) {
  PosePoints result{.measurements = measurements, .fit = fit, .free = {}, .registration = registration};
  result.fit.frames.targets = with_levers(fit.frames.targets);
  result.registration.known.targets = with_levers(registration.known.targets);
  result.measurements.targets.clear();
  for (const TargetFrame& target : result.fit.frames.targets) {
    result.measurements.targets.push_back(target.name);
  }
  result.measurements.observations.clear();
  for (const Observation& observation : measurements.observations) {
    const Orientation* const orientation = observation.orientation();
    const std::size_t points = orientation == nullptr ? 1 : levers().size();
    for (std::size_t i = 0; i < points; ++i) {
      Observation point = observation;
      point.target = static_cast<std::int32_t>(levers().size()) * point.target + static_cast<std::int32_t>(i);
      point.order.reset();
      if (orientation != nullptr) {
        point.reading = Point{observation.position() + *orientation * levers()[i].p_T};
      }
      result.measurements.observations.push_back(point);
    }
  }
  std::vector<std::string> names = free.without(UnknownGroup::targets).without(UnknownGroup::effects).names();
  for (std::size_t k = 0; k < result.fit.frames.targets.size(); ++k) {
    if (free.column(UnknownGroup::targets, 6 * (k / levers().size()))) {
      const std::vector<std::string> own = target_parameter_names(result.fit.frames.targets[k]);
      names.insert(names.end(), own.begin(), own.end());
    }
  }
  result.free = Unknowns(model, result.fit.frames.targets, names)
                    .with(model, UnknownGroup::effects, free.of(UnknownGroup::effects));
  return result;
}

}  // namespace kdl_calibration
