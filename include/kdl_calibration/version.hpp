#pragma once

#include "kdl_calibration/visibility.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// "0.2.0": of the library that is linked.
const char* version();

}  // namespace kdl_calibration
