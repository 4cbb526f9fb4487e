#include "measurements/measurements_check.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>
#include <string>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"

namespace kdl_calibration {
namespace {

[[noreturn]] void refuse(const Measurements& measurements, const std::string& what) {
  throw InputError((measurements.source.empty() ? "measurements" : measurements.source) + ": " + what);
}

void require_size(const Measurements& measurements, const char* what, std::size_t size, std::size_t expected) {
  if (size != expected) {
    refuse(measurements, fmt::format("{} {}, expected {}, one for each", size, what, expected));
  }
}

// Checks the size of an optional member.
void require_size_if_any(const Measurements& measurements, const char* what, std::size_t size, std::size_t expected) {
  if (size != 0) {
    require_size(measurements, what, size, expected);
  }
}

// What is wrong with a reading whose position is finite; empty if nothing is.
std::string fault_of(const Reading& reading) {
  constexpr double kUnitQuaternion = 1e-3;
  constexpr double kUnitVector = 1e-9;
  if (const auto* const pose = std::get_if<Pose>(&reading)) {
    const bool is_unit = std::abs(pose->orientation.norm() - 1.0) <= kUnitQuaternion;
    return is_unit ? "" : "the orientation is no unit quaternion";
  }
  if (const auto* const some = std::get_if<Coordinates>(&reading)) {
    const bool is_unit = std::abs(some->normal.norm() - 1.0) <= kUnitVector;
    return is_unit && (some->count == 1 || some->count == 2)
               ? ""
               : "its directions are none, expected 1 or 2 coordinates and a unit vector";
  }
  if (const auto* const distance = std::get_if<Distance>(&reading)) {
    const bool is_length = std::isfinite(distance->length) && distance->length > 0.0;
    return is_length ? "" : fmt::format("a distance of {}, expected one above 0", distance->length);
  }
  return "";
}

void require_sound(const Measurements& measurements, std::size_t row) {
  const Observation& observation = measurements.observations[row];
  const auto refuse_row = [&](const std::string& fault) {
    refuse(measurements, fmt::format("observation {}: {}", row, fault));
  };
  const auto configurations = static_cast<std::ptrdiff_t>(measurements.configurations.size());
  const auto targets = static_cast<std::ptrdiff_t>(measurements.targets.size());
  if (observation.configuration < 0 || observation.configuration >= configurations) {
    refuse_row(
        fmt::format("configuration {} is not there, expected 0 to {}", observation.configuration, configurations - 1));
  }
  if (observation.target < 0 || observation.target >= targets) {
    refuse_row(fmt::format("target {} is not there, expected 0 to {}", observation.target, targets - 1));
  }
  const auto stations = static_cast<std::ptrdiff_t>(measurements.stations.size());
  if (observation.station < 0 || observation.station >= stations) {
    refuse_row(fmt::format("station {} is not there, expected 0 to {}", observation.station, stations - 1));
  }
  if (!observation.position().allFinite()) {
    refuse_row("a coordinate is not finite");
  }
  if (!std::isfinite(observation.sigma) || observation.sigma < 0.0) {
    refuse_row("sigma is negative or not finite, expected 0 where none is stated");
  }
  if (observation.order.has_value() != measurements.observations.front().order.has_value()) {
    refuse_row("some rows have a place in the order and others have none, expected it in all or in none");
  }
  if (const std::string fault = fault_of(observation.reading); !fault.empty()) {
    refuse_row(fault);
  }
}

// Each configuration has rows of one station only.
void require_one_station_each(const Measurements& measurements) {
  const std::vector<std::int16_t> stations = stations_of_configurations(measurements);
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    const Observation& observation = measurements.observations[row];
    if (observation.station != stations[static_cast<std::size_t>(observation.configuration)]) {
      refuse(measurements,
             fmt::format("observation {}: its configuration has rows of several stations, expected one", row));
    }
  }
}

// The distances of a configuration are from one anchor, and no other rows are with them.
void require_one_anchor_each(const Measurements& measurements) {
  std::vector<std::size_t> first(measurements.configurations.size(), measurements.observations.size());
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    const Observation& observation = measurements.observations[row];
    std::size_t& first_row = first[static_cast<std::size_t>(observation.configuration)];
    first_row = std::min(first_row, row);
    const Observation& other = measurements.observations[first_row];
    if (is_distance(observation) != is_distance(other) ||
        (is_distance(observation) && observation.position() != other.position())) {
      refuse(measurements,
             fmt::format("observation {}: its configuration has rows of several anchors, expected one", row));
    }
  }
}

}  // namespace

void check(const Measurements& measurements) {
  const std::size_t rows = measurements.observations.size();
  require_size(measurements, "configurations", measurements.configurations.size(),
               static_cast<std::size_t>(measurements.joint_values.cols()));
  require_size_if_any(measurements, "names of joints", measurements.joints.size(),
                      static_cast<std::size_t>(measurements.joint_values.rows()));
  require_size_if_any(measurements, "units of joints", measurements.joint_units.size(),
                      static_cast<std::size_t>(measurements.joint_values.rows()));
  if (const std::string fault = fault_of(measurements.signals, measurements.joint_values); !fault.empty()) {
    refuse(measurements, fault);
  }
  if (!measurements.joint_values.allFinite()) {
    refuse(measurements, "a joint value is not finite");
  }
  if (measurements.stations.empty()) {
    refuse(measurements, "no station, expected the name of one or more");
  }
  std::set<std::string> targets;
  for (const std::string& target : measurements.targets) {
    if (target.empty()) {
      refuse(measurements, "target '' is empty, expected a name");
    }
    if (!targets.insert(target).second) {
      refuse(measurements, "target " + shown(target) + " is there twice, expected names that differ");
    }
  }
  for (std::size_t row = 0; row < rows; ++row) {
    require_sound(measurements, row);
  }
  if (measurements.stations.size() > 1) {
    require_one_station_each(measurements);
  }
  require_one_anchor_each(measurements);
}

}  // namespace kdl_calibration
