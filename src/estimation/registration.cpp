#include "estimation/registration.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "estimation/input_check.hpp"
#include "estimation/joint_registration.hpp"
#include "estimation/point_registration.hpp"
#include "estimation/prediction.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Isometry3d;

Registration register_station(const std::vector<Isometry3d>& X_BF, const Measurements& training,
                              const RegistrationOptions& options) {
  return has_single_coordinates(training) ? register_readings(X_BF, training, options)
                                          : register_points(X_BF, training, options);
}

// A start of the joint fit, and whether its first station determines its base and targets.
struct Start {
  Frames frames;
  bool is_firm = false;
};

Start register_one_by_one(const std::vector<Isometry3d>& X_BF, const Measurements& training,
                          const RegistrationOptions& options, const std::vector<std::size_t>& order) {
  Start result;
  std::vector<Isometry3d>& bases = result.frames.bases;
  std::vector<TargetFrame>& targets = result.frames.targets;
  bases.assign(training.stations.size(), Isometry3d::Identity());
  RegistrationOptions own = options;
  for (const std::string& name : training.targets) {
    const TargetFrame* const known = find_target(options.known.targets, name);
    targets.push_back({.name = name, .X_FT = known == nullptr ? Isometry3d::Identity() : known->X_FT});
  }
  for (const std::size_t station : order) {
    const Measurements rows = rows_of_station(training, station).measurements;
    const Isometry3d* known = find_base(options.known.bases, training.stations[station]);
    own.known.bases.clear();
    if (known != nullptr) {
      own.known.bases.push_back({.station = {}, .X_WB = *known});
      bases[station] = *known;
    }
    if (rows.observations.empty()) {
      continue;
    }
    const Registration registration = register_station(X_BF, rows, own);
    bases[station] = registration.frames.base();
    result.is_firm = result.is_firm || (station == order.front() && registration.undetermined == 0);
    for (const Observation& observation : rows.observations) {
      const auto k = static_cast<std::size_t>(observation.target);
      const TargetFrame& found = registration.frames.targets[k];
      if (find_target(own.known.targets, found.name) == nullptr) {
        own.known.targets.push_back(found);
        targets[k] = found;
      }
      targets[k].with_orientation = targets[k].with_orientation || found.with_orientation;
    }
  }
  return result;
}

Registration register_together(const std::vector<Isometry3d>& X_BF, const Measurements& training,
                               const RegistrationOptions& options) {
  constexpr std::size_t kMostStarts = 4;
  std::vector<std::size_t> count(training.stations.size(), 0);
  for (const Observation& observation : training.observations) {
    count[station_of(observation)] += static_cast<std::size_t>(dimension(observation.reading));
  }
  std::vector<std::size_t> by_rows(count.size());
  std::iota(by_rows.begin(), by_rows.end(), std::size_t{0});
  std::stable_sort(by_rows.begin(), by_rows.end(), [&](std::size_t a, std::size_t b) { return count[a] > count[b]; });
  const JointRegistration joint(X_BF, training, options);
  std::optional<Frames> best;
  double least = 0.0;
  for (std::size_t first = 0; first < std::min(by_rows.size(), kMostStarts) && count[by_rows[first]] > 0; ++first) {
    std::vector<std::size_t> order = by_rows;
    std::rotate(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(first),
                order.begin() + static_cast<std::ptrdiff_t>(first + 1));
    Start start = register_one_by_one(X_BF, training, options, order);
    const double cost = joint.fit(start.frames);
    if (!best || cost < least) {
      best = std::move(start.frames);
      least = cost;
    }
    if (start.is_firm) {
      break;
    }
  }
  Registration result;
  result.frames = best ? *std::move(best) : register_one_by_one(X_BF, training, options, by_rows).frames;
  result.undetermined = joint.count_undetermined_directions(result.frames);
  return result;
}

double rms_of(const Frames& frames, const std::vector<Isometry3d>& X_BF, const Measurements& training) {
  const Estimate estimate{.errors = {}, .frames = frames, .effects = {}};
  double squares = 0.0;
  for (const Observation& observation : training.observations) {
    squares += measured_minus_predicted(observation, estimate, X_BF).squaredNorm();
  }
  return std::sqrt(squares / std::max(static_cast<double>(training.observations.size()), 1.0));
}

}  // namespace

Registration register_base_and_targets(const std::vector<Isometry3d>& X_BF, const Measurements& measurements,
                                       const RegistrationOptions& options) {
  check(measurements);
  check(options);
  if (X_BF.size() != measurements.configurations.size()) {
    throw InputError(fmt::format("{}: {} poses of the flange, expected {}, one for each configuration",
                                 measurements.source, X_BF.size(), measurements.configurations.size()));
  }
  const TrainingRows training(measurements);
  const auto register_all = measurements.stations.size() == 1 ? register_station : register_together;
  Registration result = register_all(X_BF, *training, options);
  result.rms = rms_of(result.frames, X_BF, *training);
  return result;
}

}  // namespace kdl_calibration
