#pragma once

// Not installed.

#include <functional>
#include <string>

#include "kdl_calibration/calibration.hpp"

namespace kdl_calibration {

/// To be called behind each fit of a stage with this many of them, from any thread: tells the options' progress, which
/// hears of the stage at once. Empty where these have none.
std::function<void()> counted_fits(const CalibrationOptions& options, const std::string& stage, std::size_t fits);

}  // namespace kdl_calibration
