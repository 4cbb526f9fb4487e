#include "cli/robot_controller.hpp"

#include "cli/data_dir.hpp"
#include "cli/options.hpp"

namespace kdl_calibration::cli {

std::optional<Controller> bundled_controller(const Robot& robot) {
  const Robot bundled = load({});
  if (robot.urdf != bundled.urdf || robot.base != bundled.base || robot.tip != bundled.tip) {
    return std::nullopt;
  }
  return read_controller(urdf_dir() / "fanuc_r2000ic_165f_controller.json");
}

Controller controller_of_robot(const Robot& robot) {
  const std::optional<Controller> bundled = bundled_controller(robot);
  return bundled ? *bundled : controller_of_links(robot);
}

std::optional<Eigen::Isometry3d> world_of(const Robot& robot, const std::optional<JointConvention>& convention) {
  return convention ? std::optional(controller_of_robot(robot).X_BW) : std::nullopt;
}

}  // namespace kdl_calibration::cli
