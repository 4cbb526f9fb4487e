#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "estimation/registration.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// As register_base_and_targets, for measurements of several stations: a base for each, and targets that they share.
///
/// A station is registered by itself and determines its targets; the others follow in the order of their rows, with the
/// targets known. From there all bases and targets are fitted together by Levenberg-Marquardt steps. If the first
/// station does not determine its base and targets, further ones are tried as the first, and the best fit is taken.
/// Directions that no row determines stay as they were registered.
///
/// Also for single coordinates, of one station or several: a station is then registered by Levenberg-Marquardt steps
/// from the rotations of the cube.
Registration register_stations(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                               const RegistrationOptions& options);

}  // namespace kdl_calibration
