#pragma once

// The whole calibration in one call.
//
//     const Robot robot = load_robot("robot.urdf");
//     const Calibration found = calibrate(robot, read_measurements(robot, "measurements.csv"));
//     if (found.trusted()) write_urdf("calibrated.urdf", robot, found);

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// Registration, choice of the parameters that the targets can identify, of priors and of effects, identification,
/// uncertainty, validation and diagnosis, as `kdlcal calibrate` does. No starting values are needed.
/// Throws InputError: inconsistent measurements or those of another robot, a sigma or prior that is negative or not
/// finite, a pattern that matches nothing, a fixed base or target coordinate that is not known, two-step with known
/// frames, measured orientations, priors, effects or a loss, fewer equations than unknowns, no training rows, noise
/// from repeats without repeats, a sigma of orientations without one of positions or without orientations, a direction
/// of gravity without length.
Calibration calibrate(const Robot& robot, const Measurements& measurements, const CalibrationOptions& options = {});

}  // namespace kdl_calibration
