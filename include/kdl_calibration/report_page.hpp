#pragma once

// The page for people: one HTML file that any browser opens without a network.
//
//     write_report("report.html", robot, measurements, found);

#include <filesystem>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// Writes the page of `kdlcal calibrate --report`. Throws InputError as write_result does.
void write_report(const std::filesystem::path& file, const Robot& robot, const Measurements& measurements,
                  const Calibration& calibration);

}  // namespace kdl_calibration
