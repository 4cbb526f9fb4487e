#pragma once

#include <string>

#include "kdl_calibration/calibration.hpp"

namespace kdl_calibration {

/// The result as a short table for a terminal: millimetres and degrees, gains in percent.
std::string result_table(const Measurements& measurements, const Calibration& calibration);

}  // namespace kdl_calibration
