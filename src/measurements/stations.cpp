#include "measurements/stations.hpp"

#include <fmt/core.h>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {

StationRows rows_of_station(const Measurements& measurements, std::size_t station) {
  StationRows result;
  Measurements& own = result.measurements;
  own.source = measurements.source;
  own.joints = measurements.joints;
  own.joint_values = measurements.joint_values;
  own.configurations = measurements.configurations;
  own.targets = measurements.targets;
  own.joint_units = measurements.joint_units;
  own.signals = measurements.signals;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    if (station_of(measurements.observations[row]) != station) {
      continue;
    }
    result.rows.push_back(row);
    own.observations.push_back(measurements.observations[row]);
    own.observations.back().station = 0;
    if (!measurements.orientations.empty()) {
      own.orientations.push_back(measurements.orientations[row]);
    }
    if (!measurements.order.empty()) {
      own.order.push_back(measurements.order[row]);
    }
  }
  return result;
}

std::vector<std::int16_t> stations_of_configurations(const Measurements& measurements) {
  std::vector<std::int16_t> result(measurements.configurations.size(), 0);
  for (const Observation& observation : measurements.observations) {
    result[static_cast<std::size_t>(observation.configuration)] = observation.station;
  }
  return result;
}

void require_one_station(const Measurements& measurements, const std::string& what) {
  if (measurements.stations.size() > 1) {
    throw InputError(
        fmt::format("{}: {} stations, expected one for {}", measurements.source, measurements.stations.size(), what));
  }
}

}  // namespace kdl_calibration
