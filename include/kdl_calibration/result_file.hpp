#pragma once

// The result as a file (JSON), for other programs and for later.
//
//     write_result("result.json", robot, measurements, found);
//     const Calibration again = load_calibration("result.json", robot);

#include <filesystem>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// Writes the result that `kdlcal calibrate --result` writes; an existing file is replaced as a whole. `measurements`
/// are those of the calibration. Throws InputError for another robot, other measurements, a calibration that was read
/// from a file, and where the file cannot be written.
void write_result(const std::filesystem::path& file, const Robot& robot, const Measurements& measurements,
                  const Calibration& calibration);

/// Reads a result. Errors must not be applied twice, so that it wants the URDF that was calibrated. Throws InputError:
/// unreadable file, malformed JSON, a missing key, a value of the wrong type, a parameter unknown to the robot, another
/// robot, a part that does not match its hash, an effect of a program's own that is not among `own`.
Calibration load_calibration(const std::filesystem::path& file, const Robot& robot,
                             const std::vector<OwnEffect>& own = {});

}  // namespace kdl_calibration
