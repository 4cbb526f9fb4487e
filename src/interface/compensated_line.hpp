#pragma once

// Straight lines between compensated points.

#include <Eigen/Geometry>
#include <algorithm>

#include "kdl_calibration/compensation.hpp"

namespace kdl_calibration {

/// An end of a straight line.
struct LineEnd {
  Eigen::Isometry3d X_BT;          ///< the asked pose of the tool
  CompensatedJoints joint_values;  ///< that are commanded for it
};

/// How far the tool leaves a straight line between its ends at most; infinite where it cannot be followed.
struct LineDeviation {
  double position = 0.0;     ///< [m] from the line
  double orientation = 0.0;  ///< [rad] from the asked orientation, which turns evenly about one axis

  /// Takes what the other has more of.
  void include(const LineDeviation& other) {
    position = std::max(position, other.position);
    orientation = std::max(orientation, other.orientation);
  }
};

/// Of the calibrated arm, if the controller moves the tool of the nominal arm straight between the commanded ends. The
/// path is tried every 20 mm and 2 degrees, in at most 100 places. `X_FT`: the tool on the flange.
LineDeviation line_deviation(const Compensator& compensator, const Eigen::Isometry3d& X_FT, const LineEnd& from,
                             const LineEnd& to);

}  // namespace kdl_calibration
