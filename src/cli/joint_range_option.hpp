#pragma once

#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration::cli {

/// Parses --joint-ranges: limits, published, or lower:upper of every independent joint in degrees or millimetres.
/// Throws InputError.
JointRanges joint_ranges(const ErrorModel& model, const std::vector<std::string>& given);

}  // namespace kdl_calibration::cli
