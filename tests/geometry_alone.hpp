#pragma once

// The bundled robot, read once, and the options of a fit of its geometry alone.

#include "kdl_calibration/calibration_options.hpp"
#include "support.hpp"

namespace kdl_calibration::testing {

inline const Robot& bundled_robot() {
  static const Robot robot = fanuc();
  return robot;
}

/// Equal weights: the covariance is exact for noise that is equal and independent.
inline CalibrationOptions geometry_alone() {
  return {.priors = {.automatic = false},
          .effects = {.groups = {}, .automatic = false},
          .noise = {.weights = Weights::equal},
          .validation = {.held_out = false},
          .diagnosis = {.try_readings = false},
          .threads = 1};
}

}  // namespace kdl_calibration::testing
