#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
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
  double sigma = 0.0;       ///< [m] of each coordinate of the ball's centre beside the socket's
  bool horizontal = false;  ///< whether its z axis is the base's
  /// [m] z in the base frame of the origin of the plate's frame
  double lowest = -std::numeric_limits<double>::infinity();
  double highest = std::numeric_limits<double>::infinity();
  /// Which joint values the arm may take, besides those out of range; empty: all.
  std::function<bool(const Eigen::VectorXd&)> allowed = {};
};

/// Sets the ball of the tool, the robot's only target, into the sockets in turn, with different joint values each time.
/// The measured point of a row is the socket; the ball is off it by `sigma`. The places are
/// drawn where the plate may be and the arm reaches every socket within `ranges` as `allowed`; the robot's bases become
/// those of the places.
/// Throws InputError if no such place is found, for another number of targets and for mimic joints.
Measurements touch(const Plate& plate, const JointRanges& ranges, Eigen::Index configurations, Random& random,
                   VirtualRobot& robot);

/// The touches of a plan, its rows with the sockets, by this robot: the plate stands where the nominal arm has the ball
/// in the sockets at the planned joint values, and the robot's joint values differ from them so that its own ball is
/// in the socket, off it by `sigma` [m]. The robot's bases become those of the places. Throws InputError as touch()
/// does, and for a row that the robot does not reach. `ball`: the target of the nominal robot.
Measurements touch_as_planned(const Measurements& plan, const TargetFrame& ball, double sigma, Random& random,
                              VirtualRobot& robot);

}  // namespace kdl_calibration
