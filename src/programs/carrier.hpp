#pragma once

#include <Eigen/Geometry>
#include <map>
#include <string>
#include <vector>

#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/robot.hpp"
#include "programs/controller.hpp"
#include "programs/program.hpp"

namespace kdl_calibration {

/// The joints of the chain before the six of the arm: rails and turntables, which are external axes of the controller.
class Carrier {
public:
  /// `axes`: joints of the URDF by number of the axis. Throws InputError unless they are just the joints before the
  /// arm.
  Carrier(const Robot& robot, const std::map<int, ExternalAxis>& axes);

  /// The arm that stands on them.
  Robot arm(Robot robot) const;

  /// Whether it is known what the axis does.
  bool has(int axis) const { return axes_.contains(axis); }

  /// Their values [m or rad] at the point, before those of the arm. Throws InputError, with `where` before its words,
  /// for a point without the value of one.
  CompensatedJoints with(const ProgramPoint& point, const SixJoints& arm, const std::string& where) const;

  /// X_BC: where the arm stands.
  Eigen::Isometry3d pose(const CompensatedJoints& q) const;

private:
  struct Joint {
    int axis = 0;
    double sign = 1.0;
    MovingJoint joint;
  };
  std::vector<Joint> joints_;
  std::map<int, ExternalAxis> axes_;
};

}  // namespace kdl_calibration
