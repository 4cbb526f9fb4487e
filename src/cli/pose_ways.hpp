#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/robot.hpp"
#include "programs/nearby_ways.hpp"

namespace kdl_calibration::cli {

/// Poses without joint values, each reached from the joint values before: where another way is about as near. Keeps
/// references.
class PoseWays {
public:
  PoseWays(const Robot& robot, const Compensator& compensator) : compensator_(compensator), ways_(robot) {}

  /// The point for a pose next to nominal joint values. `label` names it for people.
  CompensatedPoint solve(const Eigen::Isometry3d& X_BF, const CompensatedJoints& near,
                         const std::function<std::string()>& label);

  std::vector<std::string> warnings() const;

private:
  const Compensator& compensator_;
  NearbyWays ways_;
  std::size_t points_ = 0;
  std::size_t close_ = 0;
  std::string first_;
  double most_ = 0.0;  // [m] between commands
};

}  // namespace kdl_calibration::cli
