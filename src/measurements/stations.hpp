#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

inline std::size_t station_of(const Observation& observation) { return static_cast<std::size_t>(observation.station); }

/// The rows of one station as measurements of a single one. All configurations keep their numbers.
struct StationRows {
  Measurements measurements;
  std::vector<std::size_t> rows;  ///< their indices among all rows
};
StationRows rows_of_station(const Measurements& measurements, std::size_t station);

/// The station of each configuration; 0 for those without rows.
std::vector<std::int16_t> stations_of_configurations(const Measurements& measurements);

/// The measurements with these factors on the noise of their stations' rows, and the factors that they have.
Measurements with_noise_factors(Measurements measurements, const std::vector<NoiseFactors>& factors);
std::vector<NoiseFactors> noise_factors(const Measurements& measurements);

/// Rotations of a station that its points do not show: about the line that they are on, or all if they are one point.
/// None if single coordinates or distances show them, or if no row is a whole point: then their Jacobian does.
struct UndeterminedRotations {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< [m] of the points in W
  Eigen::Matrix3Xd axes = Eigen::Matrix3Xd(3, 0);    ///< unit vectors in W; none if orientations were measured
};
UndeterminedRotations undetermined_rotations(const Measurements& station);

/// Whether there are several stations, or one with a name of its own.
inline bool names_stations(const Measurements& measurements) {
  return measurements.stations != Measurements().stations;
}

/// Whether every row is a whole point, or a pose, and all were measured from one place.
bool are_points_of_one_station(const Measurements& measurements);

/// Whether directions of a base may not follow from its rows alone: there are several stations, rows that are no whole
/// points, or points that do not determine a rotation.
bool may_leave_bases_undetermined(const Measurements& measurements);

/// Throws InputError if a station of several has rows, but none of them is in `fitted`.
void require_rows_of_each_station(const Measurements& measurements, const Measurements& fitted);

}  // namespace kdl_calibration
