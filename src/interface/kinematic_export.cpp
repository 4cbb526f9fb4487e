#include "kdl_calibration/kinematic_export.hpp"

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "interface/calibration_parts.hpp"
#include "results/calibrated_urdf.hpp"
#include "results/kinematic_formats.hpp"
#include "robot/dh_table.hpp"
#include "robot/ur_calibration.hpp"
#include "robot/urdf_correction.hpp"

namespace kdl_calibration {

std::string calibrated_urdf(const Robot& robot, const Calibration& calibration) {
  require_same_robot(robot, calibration);
  return calibrated_urdf(robot, calibration.parts().model, calibration.parts().urdf_errors);
}

std::string kinematic_export(const Robot& robot, const Calibration& calibration, KinematicFormat format) {
  std::string urdf = calibrated_urdf(robot, calibration);
  const CalibrationParts& parts = calibration.parts();
  const Robot calibrated = parse_robot(urdf, {.base = robot.base, .tip = robot.tip}, robot.source);
  const std::string note = parts.model.effects.empty()
                               ? ""
                               : "Effects were found. This is the geometry of a rigid arm, fitted without them.";
  switch (format) {
    case KinematicFormat::urdf:
      return urdf;
    case KinematicFormat::dh:
      return dh_export(calibrated, DhConvention::standard, note);
    case KinematicFormat::mdh:
      return dh_export(calibrated, DhConvention::modified, note);
    case KinematicFormat::opw:
      return opw_yaml(calibrated, note);
    case KinematicFormat::ur_yaml:
      return ur_yaml(robot, calibrated, note);
    case KinematicFormat::xacro_yaml:
      return xacro_yaml(calibrated, note);
    case KinematicFormat::parameters_csv:
      return parameters_csv(parts.model, parts.urdf_errors, parts.parameters, note);
  }
  refuse_input("a format that is none", "one of KinematicFormat");
}

Robot load_dh_robot(const std::filesystem::path& file, const RobotOptions& options) {
  const std::string source = one_line(file.string());
  return parse_robot(dh_urdf(parse_dh_table(read_text_file(file), source)), options, source);
}

std::string ur_calibrated_urdf(const Robot& robot, std::string_view calibration, const std::string& source) {
  return is_ur_yaml(calibration) ? urdf_with_origins(robot.urdf, ur_origins(robot, calibration, source))
                                 : corrected_urdf(robot.urdf, ur_corrections(robot, calibration, source));
}

}  // namespace kdl_calibration
