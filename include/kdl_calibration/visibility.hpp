#pragma once

// Internal: marks the part of namespace kdl_calibration that a shared library exports. It hides all other symbols.

#define KDL_CALIBRATION_PUBLIC [[gnu::visibility("default")]]
