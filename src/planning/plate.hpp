#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "base/random.hpp"
#include "kdl_calibration/measurements.hpp"
#include "planning/simulation.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration {

/// A plate with sockets that is put at several places. W is the plate's frame, and each place is a station.
struct Plate {
  std::vector<Eigen::Vector3d> sockets;  ///< [m] centres of a ball in them, in the plate's frame
  int places = 4;
  double sigma = 0.0;  ///< [m] of each coordinate of the ball's centre beside the socket's
  /// Which joint values the arm may take, besides those out of range; empty: all.
  std::function<bool(const Eigen::VectorXd&)> allowed = {};
};

/// Sets the ball of the tool, the robot's only target, into the sockets in turn, with different joint values each time.
/// The measured point of a row is the socket; the ball is off it by `sigma`. The places are
/// drawn where the arm reaches every socket within `ranges` as `allowed`; the robot's bases become those of the places.
/// Throws InputError if no such place is found, for another number of targets and for mimic joints.
Measurements touch(const Plate& plate, const JointRanges& ranges, Eigen::Index configurations, Random& random,
                   VirtualRobot& robot);

}  // namespace kdl_calibration
