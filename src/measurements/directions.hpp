#pragma once

// Rows that hold single coordinates or a distance instead of a whole point. Not installed.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Whether some row is no whole point.
inline bool has_single_coordinates(const Measurements& measurements) { return !measurements.coordinates.empty(); }

inline MeasuredCoordinates coordinates_at(const Measurements& measurements, std::size_t row) {
  return has_single_coordinates(measurements) ? measurements.coordinates[row] : MeasuredCoordinates();
}

/// The unit vector from an anchor to a point; any if they are the same.
inline Eigen::Vector3d from_anchor(const Eigen::Vector3d& anchor, const Eigen::Vector3d& point) {
  const double distance = (point - anchor).norm();
  return distance > 0.0 ? Eigen::Vector3d((point - anchor) / distance) : Eigen::Vector3d::UnitX();
}

/// The projector P onto the measured directions of a row whose point is predicted at f in W.
Eigen::Matrix3d directions_at(const Measurements& measurements, std::size_t row, const Eigen::Vector3d& f);

/// Measured minus predicted [m]: P (z - f), or n (d - |f - a|) for the distance d of f from the anchor a.
inline Eigen::Vector3d difference_at(const Measurements& measurements, std::size_t row, const Eigen::Vector3d& f) {
  const Eigen::Vector3d& z = measurements.observations[row].position;
  if (!has_single_coordinates(measurements)) {
    return z - f;
  }
  const MeasuredCoordinates& measured = measurements.coordinates[row];
  return measured.distance > 0.0 ? Eigen::Vector3d((measured.distance - (f - z).norm()) * from_anchor(z, f))
                                 : Eigen::Vector3d(measured.directions * (z - f));
}

/// Number of measured coordinates of a row: 1, 2 or 3.
inline int coordinates_of(const MeasuredCoordinates& measured) {
  return measured.distance > 0.0 ? 1 : static_cast<int>(std::lround(measured.directions.trace()));
}
inline int coordinates_of(const Measurements& measurements, std::size_t row) {
  return coordinates_of(coordinates_at(measurements, row));
}
inline int coordinates_of(const Measurements& measurements) {
  int sum = 0;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    sum += coordinates_of(measurements, row);
  }
  return sum;
}

inline std::size_t rows_of_single_coordinates(const Measurements& measurements) {
  return static_cast<std::size_t>(
      std::count_if(measurements.coordinates.begin(), measurements.coordinates.end(),
                    [](const MeasuredCoordinates& measured) { return coordinates_of(measured) < 3; }));
}

/// The rows that are whole points, as measurements without single coordinates; none if there are no such rows.
Measurements whole_points(const Measurements& measurements);

/// R of information = R R^T, a sum of weighted projectors: one column for each direction that it determines.
Eigen::Matrix3Xd root_of_directions(const Eigen::Matrix3d& information);
/// The projector onto these directions, and the pseudo-inverse of R R^T.
Eigen::Matrix3d projector(const Eigen::Matrix3Xd& R);
Eigen::Matrix3d inverse_on_directions(const Eigen::Matrix3Xd& R);

}  // namespace kdl_calibration
