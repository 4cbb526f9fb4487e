#pragma once

// Other readings of the measured points. Not installed.

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/registration.hpp"

namespace kdl_calibration {

/// The points mirrored: a left-handed frame, a wrong sign and two exchanged coordinates are that, up to a rotation.
Measurements mirrored(Measurements measurements);

/// How many times too large each coordinate is for the nominal robot, from the linear least squares solution of
///   A z - c - X_BF t = 0
/// for any 3 x 3 matrix A, c and t: the inverse norms of the columns of A. Nothing where the data do not determine it.
std::optional<Eigen::Vector3d> coordinate_scales(const std::vector<Eigen::Isometry3d>& X_BF,
                                                 const Measurements& measurements);

/// The points divided by these factors about the origin.
Measurements divided(Measurements measurements, const Eigen::Vector3d& factors);

/// "millimetres read as metres" and the like where a factor between two units is meant; else empty.
std::string units_of_factor(double factor);

/// How far the points of a target move, and the flange with them [m] (root mean square about their mean).
struct Motion {
  double points = 0.0;
  double flange = 0.0;
  double share() const { return flange > 0.0 ? points / flange : 1.0; }
};
Motion motion(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements);

/// Two targets that bear each other's names from some configuration on.
struct Exchange {
  int first = 0;
  int second = 0;
  int from = 0;  ///< configuration, of the measurements given
  Measurements repaired;
};

/// Where the targets of the second part of the file, seen from a registration of the first third (or the other way
/// round), lie at each other's places. Nothing for less than twelve configurations.
std::optional<Exchange> exchanged_targets(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                                          const RegistrationOptions& options);

}  // namespace kdl_calibration
