#include "kdl_calibration/kinematic_export.hpp"

#include "base/text.hpp"
#include "base/text_file.hpp"
#include "interface/calibration_parts.hpp"
#include "results/calibrated_urdf.hpp"
#include "robot/dh_table.hpp"

namespace kdl_calibration {

std::string calibrated_urdf(const Robot& robot, const Calibration& calibration) {
  require_same_robot(robot, calibration);
  return calibrated_urdf(robot, calibration.parts().model, calibration.parts().urdf_errors);
}

Robot load_dh_robot(const std::filesystem::path& file, const RobotOptions& options) {
  const std::string source = one_line(file.string());
  return parse_robot(dh_urdf(parse_dh_table(read_text_file(file), source)), options, source);
}

}  // namespace kdl_calibration
