#pragma once

// The calibrated geometry for other programs, and robots that are stated in another form than URDF.
//
//     write_urdf("calibrated.urdf", robot, found);
//     const Robot another = load_dh_robot("table.csv");

#include <filesystem>
#include <string>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/visibility.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// The URDF's text with corrected joint origins and every other byte unchanged. If effects were found it is that of the
/// rigid arm fitted without them; the robot's own if the calibration does not improve on it. Throws InputError for
/// another robot, and for errors behind the last joint that no fixed joint can carry.
std::string calibrated_urdf(const Robot& robot, const Calibration& calibration);

/// Writes it; an existing file is replaced as a whole, the robot's own URDF is refused. Throws InputError as above, and
/// where the file cannot be written.
void write_urdf(const std::filesystem::path& file, const Robot& robot, const Calibration& calibration);

/// The robot of a file with a DH table, CSV or JSON; src/cli/README.md describes it. Its links are base, link_1 ...,
/// tool0. Throws InputError for a bad table, and as parse_robot does.
Robot load_dh_robot(const std::filesystem::path& file, const RobotOptions& options = {});

}  // namespace kdl_calibration
