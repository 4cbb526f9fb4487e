#pragma once

// The library's version.
//
//     std::cout << "kdl_calibration " << kdl_calibration::version() << "\n";

/// Internal: marks the part of namespace kdl_calibration that a shared library exports. It hides all other symbols.
#define KDL_CALIBRATION_PUBLIC [[gnu::visibility("default")]]

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// Of the library that is linked, such as "0.2.0".
const char* version();

}  // namespace kdl_calibration
