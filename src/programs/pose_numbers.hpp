#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "programs/program.hpp"

namespace kdl_calibration {

/// The numbers of a point [m and rad].
using PointNumbers = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 7, 1>;

/// The frame that the numbers of a pose state; a quaternion may have any length but zero.
Eigen::Isometry3d pose_of(PointNotation notation, const PointNumbers& numbers);

/// The reverse. Of equivalent angles, rotation vectors and quaternions (of the old length) those nearest to `old`;
/// where the second of three angles is +-90 degrees, the angle about z stays as in `old`.
PointNumbers numbers_of(PointNotation notation, const Eigen::Isometry3d& pose, const PointNumbers& old);

/// X Y Z [m] and W P R [rad] as a frame: the rotation is Rz(R) Ry(P) Rx(W).
Eigen::Isometry3d frame_of_xyzwpr(const Eigen::Matrix<double, 6, 1>& xyzwpr);

/// The reverse, as numbers_of.
Eigen::Matrix<double, 6, 1> xyzwpr_of(const Eigen::Isometry3d& frame, const Eigen::Matrix<double, 6, 1>& old);

}  // namespace kdl_calibration
