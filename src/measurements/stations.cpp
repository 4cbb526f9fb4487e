#include "measurements/stations.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/directions.hpp"

namespace kdl_calibration {

StationRows rows_of_station(const Measurements& measurements, std::size_t station) {
  StationRows result{.measurements = measurements, .rows = {}};
  Measurements& own = result.measurements;
  own.stations.clear();
  own.observations.clear();
  own.orientations.clear();
  own.coordinates.clear();
  own.order.clear();
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
    if (has_single_coordinates(measurements)) {
      own.coordinates.push_back(measurements.coordinates[row]);
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

LooseRotations loose_rotations(const Measurements& station) {
  constexpr double kShortest = 1e-4;  // [m] lever, the RMS distance of the points from the axis
  LooseRotations result;
  const bool oriented = std::any_of(station.orientations.begin(), station.orientations.end(),
                                    [](const Eigen::Quaterniond& turn) { return !is_point(turn); });
  if (station.observations.empty() || oriented || has_single_coordinates(station)) {
    return result;
  }
  const auto count = static_cast<double>(station.observations.size());
  for (const Observation& observation : station.observations) {
    result.centre += observation.position / count;
  }
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();  // of the levers
  for (const Observation& observation : station.observations) {
    const Eigen::Vector3d arm = observation.position - result.centre;
    squares += (arm.squaredNorm() * Eigen::Matrix3d::Identity() - arm * arm.transpose()) / count;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spectrum(squares);
  result.axes = spectrum.eigenvectors().leftCols((spectrum.eigenvalues().array() < kShortest * kShortest).count());
  return result;
}

void require_rows_of_each_station(const Measurements& measurements, const Measurements& fitted) {
  if (measurements.stations.size() < 2) {
    return;
  }
  std::vector<bool> has_rows(measurements.stations.size(), false);
  for (const Observation& observation : fitted.observations) {
    has_rows[station_of(observation)] = true;
  }
  for (const Observation& observation : measurements.observations) {
    if (!has_rows[station_of(observation)]) {
      throw InputError(fmt::format("{}: station {} has test rows alone, expected some to fit its base",
                                   measurements.source, shown(measurements.stations[station_of(observation)])));
    }
  }
}

void require_one_station(const Measurements& measurements, const std::string& what) {
  if (measurements.stations.size() > 1) {
    throw InputError(
        fmt::format("{}: {} stations, expected one for {}", measurements.source, measurements.stations.size(), what));
  }
}

}  // namespace kdl_calibration
