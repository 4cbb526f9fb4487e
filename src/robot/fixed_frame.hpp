#pragma once

#include <kdl/frames.hpp>
#include <optional>
#include <string>

#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// The frame of link `link` in that of link `from`; none unless the URDF has both and only fixed joints between them.
std::optional<KDL::Frame> fixed_frame(const Robot& robot, const std::string& from, const std::string& link);

}  // namespace kdl_calibration
