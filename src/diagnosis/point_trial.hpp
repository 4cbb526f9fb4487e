#pragma once

// Other readings of the measured points.

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "estimation/registration.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// The points mirrored. A left-handed frame, a wrong sign and two exchanged coordinates are equivalent to it, up to a
/// rotation.
Measurements mirrored(Measurements measurements);

/// The positions of the inverse poses; empty if some row is no pose. A camera on the flange that looks at a board gives
/// poses of the world seen from the tool.
std::optional<Measurements> with_poses_inverted(Measurements measurements);

/// Scale of each coordinate relative to the nominal robot (above 1: too large), by linear least squares of
///   A z - c - X_BF t = 0
/// for any 3 x 3 matrix A, c and t: the inverse norms of the columns of A. Empty if the data do not determine it.
std::optional<Eigen::Vector3d> coordinate_scales(const std::vector<Eigen::Isometry3d>& X_BF,
                                                 const Measurements& measurements);

/// The points divided by these factors about the origin.
Measurements divided(Measurements measurements, const Eigen::Vector3d& factors);

/// A text such as "millimetres read as metres" if the factor converts two units; else empty.
std::string units_of_factor(double factor);

/// The largest of 0.1 mm, 0.01 mm and 1 um of which all coordinates are multiples [m]; 0 if none.
double rounding_of(const Measurements& measurements);

/// RMS distance [m] of a target's points from their mean, and the same for the flange.
struct Motion {
  double points = 0.0;
  double flange = 0.0;
  double share() const { return flange > 0.0 ? points / flange : 1.0; }
};
Motion motion(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements);

/// Two targets with exchanged names from some configuration on.
struct Exchange {
  int first = 0;
  int second = 0;
  int from = 0;  ///< index of that configuration
  Measurements repaired;
};

/// Two targets whose points lie at each other's predictions in a part of the file, given a registration of the first or
/// last third. Empty for fewer than twelve configurations.
std::optional<Exchange> exchanged_targets(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                                          const RegistrationOptions& options);

}  // namespace kdl_calibration
