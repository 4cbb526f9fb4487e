#pragma once

// Virtual experiments with several stations, single coordinates and distances.

#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

#include "geometry_alone.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "measurements/readings.hpp"
#include "planning/plate.hpp"
#include "support.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing {

constexpr double kNoise = 3e-5;  // [m]
inline const Eigen::Matrix3d kHeight = Eigen::Vector3d::UnitZ().asDiagonal();

// The coordinates along these directions only.
inline Measurements along(Measurements measurements, const Eigen::Matrix3d& P) {
  for (Observation& observation : measurements.observations) {
    observation.reading = reading_along(P, P * observation.position());
  }
  return measurements;
}

// The largest distance of points of the found arm from those of the true one, at new configurations and up to the
// gauge.
inline double distance_from_truth(const Calibration& found, VirtualExperiment& experiment) {
  const Eigen::MatrixXd q = experiment.configurations(50);
  const CalibrationParts& parts = found.parts();
  return distance_up_to_gauge(points(parts.model, parts.estimate, q),
                              points(experiment.robot.model, experiment.robot.truth, q));
}

// A tracker that stands at several places.
struct Tracker : VirtualExperiment {
  explicit Tracker(std::uint64_t seed = 1, int places = 3)
      : VirtualExperiment({.random = Random(seed)}), stations(places) {
    move();
  }

  int stations;
  void move() { robot = robot_at_stations(robot, stations, random); }
  Measurements measured(int count, double noise = 0.0) { return without_sigmas(measure(count, {.sigma = noise})); }
};

// A ball that is set into the sockets of a plate at several places.
struct Ball : VirtualExperiment {
  explicit Ball(std::uint64_t seed = 1)
      : VirtualExperiment({.targets = targets_at({{0.05, 0.2, 0.1}}), .random = Random(seed)}) {}

  Measurements touched(int places, int count, double noise = 0.0,
                       const std::vector<Eigen::Vector3d>& sockets = {{0.0, 0.0, 0.0}, {0.4, 0.0, 0.0}}) {
    return without_sigmas(touch({.sockets = sockets, .places = places, .sigma = noise}, ranges, count, random, robot));
  }
};

// The length from target A in one configuration to target B in the next is a station with two points. Of a length five
// directions of its base are free, so that it adds one equation.
struct Lengths : VirtualExperiment {
  explicit Lengths(std::uint64_t seed = 1)
      : VirtualExperiment({.targets = targets_at({{0.05, 0.2, 0.1}, {-0.1, 0.05, 0.2}}), .random = Random(seed)}) {}

  // One from every two of the configurations.
  Measurements measured(int configurations, double noise = 0.0) {
    const Measurements points = without_sigmas(measure(configurations, {.sigma = noise}));
    Measurements result = points;
    result.observations.clear();
    result.stations.clear();
    for (std::size_t first = 0; first + 3 < points.observations.size(); first += 4) {
      Observation from = points.observations[first];
      Observation to = points.observations[first + 3];
      to.position() = {(to.position() - from.position()).norm(), 0.0, 0.0};
      from.position().setZero();
      from.station = to.station = static_cast<std::int16_t>(result.stations.size());
      result.stations.push_back("L" + std::to_string(result.stations.size() + 1));
      result.observations.push_back(from);
      result.observations.push_back(to);
    }
    return result;
  }
};

// Heights of three targets above four planes that are tilted against each other.
struct Heights : VirtualExperiment {
  explicit Heights(std::uint64_t seed = 1) : VirtualExperiment({.random = Random(seed)}) { move(); }

  void move() { robot = robot_at_stations(robot, 4, random); }
  Measurements measured(int count, double noise = 0.0) {
    return along(without_sigmas(measure(count, {.sigma = noise})), kHeight);
  }
};

// A ball that touches the planes of a plate at several places.
struct Touches : VirtualExperiment {
  explicit Touches(std::uint64_t seed = 1)
      : VirtualExperiment({.targets = targets_at({{0.05, 0.2, 0.1}}), .random = Random(seed)}) {}

  Measurements touched(int places, int count, double noise = 0.0) {
    std::vector<Eigen::Vector3d> spots;
    for (int i = 0; i < 20; ++i) {
      spots.emplace_back(0.3 * random.normal(), 0.3 * random.normal(), 0.0);
    }
    const Plate plate{.sockets = spots, .places = places, .sigma = noise};
    return along(without_sigmas(touch(plate, ranges, count, random, robot)), kHeight);
  }
};

// Distances from anchors that stand around the robot, one in each configuration.
struct Distances : VirtualExperiment {
  explicit Distances(std::uint64_t seed = 1) : VirtualExperiment({.random = Random(seed)}) {}

  // Anchors at known places in W, or at unknown ones: then the first `anchors` are stations.
  Measurements measured(int anchors, bool known, int count, double noise = 0.0) {
    const std::vector<Eigen::Vector3d> places = {{2.1, 1.4, 0.3}, {-1.2, 2.3, 1.1}, {1.0, -2.2, 0.6}};
    Measurements result = without_sigmas(measure(count));
    result.stations.clear();
    for (int i = 0; i < (known ? 1 : anchors); ++i) {
      result.stations.push_back("A" + std::to_string(i + 1));
    }
    for (Observation& observation : result.observations) {
      const int anchor = observation.configuration % anchors;
      const Eigen::Vector3d& place = places[static_cast<std::size_t>(anchor)];
      keep_distance(observation, place, noise * random.normal());
      observation.station = static_cast<std::int16_t>(known ? 0 : anchor);
      if (!known) {
        observation.position().setZero();
      }
    }
    return result;
  }
  // Whole points in the first configurations, and distances from an unknown anchor in others.
  Measurements beside_points(int whole, int count, double noise = 0.0) {
    Measurements points = without_sigmas(measure(whole, {.sigma = noise}));
    Measurements distances = measured(1, false, count, noise);
    points.stations = distances.stations = {"tracker", "A1"};
    for (std::string& label : points.configurations) {
      label = "whole " + label;
    }
    for (Observation& observation : distances.observations) {
      observation.station = 1;
    }
    return joined(points, distances);
  }
};

}  // namespace kdl_calibration::testing
