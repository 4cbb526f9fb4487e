#pragma once

// The calibrated geometry for other programs: URDF, DH tables, YAML for xacro and Universal Robots, CSV.
//
//     write_urdf("calibrated.urdf", robot, found);
//     std::cout << kinematic_export(robot, found, KinematicFormat::mdh);
//     const Robot again = load_dh_robot("table.json");

#include <filesystem>
#include <string>
#include <string_view>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// The URDF's text with corrected joint origins and every other byte unchanged. If effects were found it is that of the
/// rigid arm fitted without them; the robot's own if the calibration does not improve on it. Throws InputError for
/// another robot, and for errors behind the last joint that no fixed joint can carry.
std::string calibrated_urdf(const Robot& robot, const Calibration& calibration);

/// Writes it; an existing file is replaced as a whole, the robot's own URDF is refused. Throws InputError as above, and
/// where the file cannot be written.
void write_urdf(const std::filesystem::path& file, const Robot& robot, const Calibration& calibration);

enum class KinematicFormat {
  urdf,            ///< as calibrated_urdf
  dh,              ///< table of standard Denavit-Hartenberg parameters, JSON that load_dh_robot reads
  mdh,             ///< of modified ones (Craig)
  ur_yaml,         ///< kinematics of the Universal Robots description
  opw,             ///< parameters of OPW kinematics (Brandstoetter, Angerer, Hofbaur 2014), YAML for MoveIt
  xacro_yaml,      ///< origin of every joint of the chain by name
  parameters_csv,  ///< the error parameters with units
};

/// The geometry of calibrated_urdf as text of this format. Throws InputError as calibrated_urdf does, for a DH table of
/// an arm whose joints mimic others, for opw of an arm of another family, and for ur_yaml of another maker's robot or
/// with errors behind the last joint.
std::string kinematic_export(const Robot& robot, const Calibration& calibration, KinematicFormat format);

/// The robot of a file with a DH table, CSV or JSON; src/cli/README.md describes it. Its links are base, link_1 ...,
/// tool0. Throws InputError for a bad table, and as parse_robot does.
Robot load_dh_robot(const std::filesystem::path& file, const RobotOptions& options = {});

/// The nominal URDF of a Universal Robot, corrected by the text of the calibration.conf that its maker stored on the
/// controller, or of the YAML that ur_calibration of the ROS driver writes from it, as KinematicFormat::ur_yaml is.
/// Throws InputError for another robot, a URDF that is not nominal, and a text that is no finished calibration.
std::string ur_calibrated_urdf(const Robot& robot, std::string_view calibration,
                               const std::string& source = "calibration.conf");

}  // namespace kdl_calibration
