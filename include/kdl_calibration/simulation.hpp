#pragma once

// A virtual robot with known errors, measured with noise.
//
//     const SimulatedExperiment experiment = simulate(robot, {.configurations = 30, .noise = 3e-5});
//     const Calibration found = calibrate(robot, experiment.measurements);
//     const PredictionFrame W = PredictionFrame::measuring;  // the base itself is known up to the gauge only
//     const Eigen::Vector3d miss =
//         found.arm().predict(q, "A", W).position - experiment.truth.predict(q, "A", W).position;

#include <cstdint>
#include <vector>

#include "kdl_calibration/calibrated_arm.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// The defaults are those of the published experiment.
struct SimulationOptions {
  int configurations = 30;
  int test_configurations = 0;            ///< rows marked `test`
  std::vector<TargetFrame> targets = {};  ///< on the flange; empty: the three published ones
  JointRanges ranges = {};                ///< where configurations are drawn; empty: the joints' limits
  double noise = 0.0;                     ///< [m] 1 sigma of every measured coordinate
  int repeats = 1;
  double length_error = 0.0025;              ///< [m] 1 sigma of the true length errors
  double angle_error = 0.05235987755982988;  ///< [rad] of the true angle errors: 3 degrees
  std::uint64_t seed = 1;
};

struct SimulatedExperiment {
  Measurements measurements;
  CalibratedArm truth;  ///< its covariance is zero
};

/// Draws true errors, configurations and noise. The same seed gives the same experiment. Throws InputError for counts
/// below 1, sizes that are negative or not finite, empty ranges and targets of the same name.
SimulatedExperiment simulate(const Robot& robot, const SimulationOptions& options = {});

}  // namespace kdl_calibration
