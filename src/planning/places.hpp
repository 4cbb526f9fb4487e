#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "planning/plate.hpp"
#include "planning/simulation.hpp"
#include "robot/joint_ranges.hpp"
#include "uncertainty/identifiability.hpp"

namespace kdl_calibration {

/// Where an arm is measured from, and what of its points.
struct Places {
  int stations = 1;                           ///< of the measuring device, or places of the plate
  std::vector<Eigen::Vector3d> sockets = {};  ///< [m] of a plate, see Plate; none: no plate
  bool horizontal = false;                    ///< of the plate, see Plate
  double lowest = -std::numeric_limits<double>::infinity();
  double highest = std::numeric_limits<double>::infinity();
  std::string directions = "xyz";  ///< coordinates that are measured; "r": the distance from the origin of W
};

/// The plate with these sockets at these places.
Plate plate_of(const Places& places);

/// Whether these are more than whole points from one station.
bool are_special(const Places& places);

/// Some of the coordinates of whole points, or their distances from the origin of W, see Places::directions.
Measurements along_directions(Measurements points, const std::string& directions);

/// Where an arm may be: within ranges, and as `allowed`, see Plate.
struct Reach {
  JointRanges ranges;
  std::function<bool(const Eigen::VectorXd&)> allowed = {};
};

/// What is measured of an arm, without noise.
struct PlacedRows {
  VirtualRobot robot;
  Measurements measurements;
};

/// An arm without errors, and its targets.
VirtualRobot nominal_robot(const ErrorModel& model, const std::vector<TargetFrame>& targets);

/// The arm at random places, and what is measured there: at joint values `q` (joints x N), or with sockets in N touches
/// within reach. Throws InputError as touch() does.
PlacedRows rows_at(const Places& places, VirtualRobot robot, const Reach& reach, const Eigen::MatrixXd& q,
                   Random& random);

/// What rows determine, to first order at the robot's truth.
struct DeterminedByRows {
  std::vector<std::string> arm_names;  ///< parameters of the arm in the irreducible model: geometry and targets
  Identifiability arm;                 ///< of these, whatever the bases are
  std::vector<int> bases;              ///< number of the six directions of the base at each station
};
DeterminedByRows determined_by(const PlacedRows& rows);

}  // namespace kdl_calibration
