#pragma once

#include <optional>

#include "kdl_calibration/robot.hpp"
#include "programs/controller.hpp"

namespace kdl_calibration::cli {

/// The controller that comes with kdlcal, if the robot is the bundled one.
std::optional<Controller> bundled_controller(const Robot& robot);

/// That one, else the controller of the URDF's links (see controller_of_links).
Controller controller_of_robot(const Robot& robot);

/// Its world frame in the base, where its joints are known as well.
std::optional<Eigen::Isometry3d> world_of(const Robot& robot, const std::optional<JointConvention>& convention);

}  // namespace kdl_calibration::cli
