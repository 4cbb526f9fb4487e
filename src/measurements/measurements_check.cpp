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
  const auto stations = static_cast<std::ptrdiff_t>(std::max<std::size_t>(measurements.stations.size(), 1));
  if (observation.station < 0 || observation.station >= stations) {
    refuse_row(fmt::format("station {} is not there, expected 0 to {}", observation.station, stations - 1));
  }
  if (!observation.position.allFinite()) {
    refuse_row("a coordinate is not finite");
  }
  if (!std::isfinite(observation.sigma) || observation.sigma < 0.0) {
    refuse_row("sigma is negative or not finite, expected 0 where none is stated");
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

bool is_orientation(const Eigen::Quaterniond& orientation) {
  constexpr double kTolerance = 1e-3;
  return is_point(orientation) || std::abs(orientation.norm() - 1.0) <= kTolerance;
}

bool is_projector(const MeasuredCoordinates& measured) {
  constexpr double kRounding = 1e-9;
  const Eigen::Matrix3d& P = measured.directions;
  return (P - P.transpose()).isZero(kRounding) && (P * P - P).isZero(kRounding) && P.trace() > 0.5;
}

// The distances of a configuration are from one anchor, and no other rows are with them.
void require_one_anchor_each(const Measurements& measurements) {
  std::vector<const Observation*> first(measurements.configurations.size(), nullptr);
  for (std::size_t row = 0; row < measurements.coordinates.size(); ++row) {
    const Observation& observation = measurements.observations[row];
    const Observation*& other = first[static_cast<std::size_t>(observation.configuration)];
    other = other == nullptr ? &observation : other;
    const double distance = measurements.coordinates[row].distance;
    const auto first_row = static_cast<std::size_t>(other - measurements.observations.data());
    const double before = measurements.coordinates[first_row].distance;
    if (!std::isfinite(distance) || distance < 0.0) {
      refuse(measurements, fmt::format("observation {}: a distance of {}, expected one above 0", row, distance));
    }
    if ((distance > 0.0) != (before > 0.0) || (distance > 0.0 && observation.position != other->position)) {
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
  require_size_if_any(measurements, "orientations", measurements.orientations.size(), rows);
  require_size_if_any(measurements, "measured coordinates", measurements.coordinates.size(), rows);
  require_size_if_any(measurements, "places in the order", measurements.order.size(), rows);
  require_size_if_any(measurements, "units of joints", measurements.joint_units.size(),
                      static_cast<std::size_t>(measurements.joint_values.rows()));
  if (const std::string fault = fault_of(measurements.signals, measurements.joint_values); !fault.empty()) {
    refuse(measurements, fault);
  }
  if (!measurements.joint_values.allFinite()) {
    refuse(measurements, "a joint value is not finite");
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
  const auto no_projector =
      std::find_if_not(measurements.coordinates.begin(), measurements.coordinates.end(), is_projector);
  if (no_projector != measurements.coordinates.end()) {
    refuse(measurements, fmt::format("observation {}: its directions are no projector onto 1, 2 or 3 directions",
                                     no_projector - measurements.coordinates.begin()));
  }
  const auto wrong =
      std::find_if_not(measurements.orientations.begin(), measurements.orientations.end(), is_orientation);
  if (wrong != measurements.orientations.end()) {
    refuse(measurements, fmt::format("observation {}: the orientation is no unit quaternion",
                                     wrong - measurements.orientations.begin()));
  }
}

}  // namespace kdl_calibration
