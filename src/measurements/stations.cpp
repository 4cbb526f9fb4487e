#include "measurements/stations.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>

#include "base/decompositions.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {

StationRows rows_of_station(const Measurements& measurements, std::size_t station) {
  StationRows result{.measurements = without_observations(measurements), .rows = {}};
  Measurements& own = result.measurements;
  own.stations = Measurements().stations;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    if (station_of(measurements.observations[row]) != station) {
      continue;
    }
    result.rows.push_back(row);
    own.observations.push_back(measurements.observations[row]);
    own.observations.back().station = 0;
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

Measurements with_noise_factors(Measurements measurements, const std::vector<NoiseFactors>& factors) {
  for (Observation& observation : measurements.observations) {
    observation.noise = factors[station_of(observation)];
  }
  return measurements;
}

std::vector<NoiseFactors> noise_factors(const Measurements& measurements) {
  std::vector<NoiseFactors> result(measurements.stations.size());
  for (const Observation& observation : measurements.observations) {
    result[station_of(observation)] = observation.noise;
  }
  return result;
}

namespace {

constexpr double kShortest = 1e-4;  // [m] lever, the RMS distance of the points from the axis

// Whether the measured coordinates of each row may be those of a point on the axis, or at the centre if there are
// three.
bool may_lie_there(const UndeterminedRotations& undetermined, const Measurements& station) {
  for (const Observation& observation : station.observations) {
    const Eigen::Matrix3d P = directions(observation.reading, undetermined.centre);
    Eigen::Vector3d off = P * (observation.position() - undetermined.centre);
    if (undetermined.axes.cols() == 1) {
      const Eigen::Vector3d along = P * undetermined.axes.col(0);
      off -= along * (along.dot(off) / std::max(along.squaredNorm(), 1e-12));
    }
    if (is_distance(observation) || off.norm() > kShortest) {
      return false;
    }
  }
  return true;
}

}  // namespace

UndeterminedRotations undetermined_rotations(const Measurements& station) {
  const auto& rows = station.observations;
  const auto count = static_cast<double>(std::count_if(rows.begin(), rows.end(), is_whole));
  if (count == 0.0 || has_orientations(station)) {
    return {};
  }
  UndeterminedRotations result;
  for (const Observation& row : rows) {
    result.centre += is_whole(row) ? Eigen::Vector3d(row.position() / count) : Eigen::Vector3d::Zero();
  }
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();  // of the levers
  for (const Observation& row : rows) {
    if (is_whole(row)) {
      const Eigen::Vector3d arm = row.position() - result.centre;
      squares += (arm.squaredNorm() * Eigen::Matrix3d::Identity() - arm * arm.transpose()) / count;
    }
  }
  const auto [values, vectors] = spectrum(squares);
  result.axes = vectors.leftCols((values.array() < kShortest * kShortest).count());
  return has_single_coordinates(station) && !may_lie_there(result, station) ? UndeterminedRotations() : result;
}

bool are_points_of_one_station(const Measurements& measurements) {
  return measurements.stations.size() == 1 && !has_single_coordinates(measurements);
}

bool may_leave_bases_undetermined(const Measurements& measurements) {
  return !are_points_of_one_station(measurements) || undetermined_rotations(measurements).axes.cols() > 0;
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

}  // namespace kdl_calibration
