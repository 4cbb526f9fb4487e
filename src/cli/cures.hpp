#pragma once

#include <map>
#include <string>

#include "kdl_calibration/doubt.hpp"

namespace kdl_calibration::cli {

/// Options of kdlcal that help against a doubt, by its cause. The result, which other programs read, does not state
/// them. `stations`: whether bases may be undetermined, as of several stations or single coordinates.
std::map<Cause, std::string> cures(bool stations);

/// The command that chooses more configurations for the same experiment.
std::string plan_to_add(bool stations);

}  // namespace kdl_calibration::cli
