#pragma once

#include <numbers>

namespace kdl_calibration {

constexpr double kDegree = std::numbers::pi / 180.0;  ///< [rad]

}  // namespace kdl_calibration
