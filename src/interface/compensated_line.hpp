#pragma once

// Straight lines between compensated points.

#include <Eigen/Geometry>

#include "kdl_calibration/compensation.hpp"

namespace kdl_calibration {

/// An end of a straight line.
struct LineEnd {
  Eigen::Isometry3d X_BT;          ///< the asked pose of the tool
  CompensatedJoints joint_values;  ///< that are commanded for it
};

/// [m] The largest distance, at seven points between two ends, of the tool from the asked line, if the controller moves
/// it straight between the commanded ends. Infinite if one of the points on the line is not reached.
/// `X_FT`: the tool on the flange. Orientations turn evenly about one axis.
double line_deviation(const Compensator& compensator, const Eigen::Isometry3d& X_FT, const LineEnd& from,
                      const LineEnd& to);

}  // namespace kdl_calibration
