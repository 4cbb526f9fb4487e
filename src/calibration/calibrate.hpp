#pragma once

// The whole calibration in one call.
//
//     const Robot robot = load_robot("robot.urdf");
//     const CalibrationResult found = calibrate(complete_model(robot), read_measurements(robot, "measurements.csv"));
//     std::cout << found.accuracy.train.after.rms << " m\n";

#include "calibration/calibration_result.hpp"
#include "calibration/calibration_settings.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// The whole calibration: registration, reduction to the parameters that the targets can identify, choice of priors and
/// effects, identification, covariance, validation. No starting values are needed.
/// Throws InputError: inconsistent measurements or those of another robot, a sigma or prior that is negative or not
/// finite, a pattern that matches nothing, a fixed base or target coordinate that is not known, two-step with known
/// frames, measured orientations, priors, effects or a loss, fewer equations than unknowns, no training rows, noise
/// from repeats without repeats, a sigma of orientations without one of positions or without orientations. The joint
/// estimator resolves candidates that the data cannot tell apart in the reduction's order: base, targets, joint
/// offsets, links. A candidate is kept only if its column raises the rank. Dropped ones stay exactly at zero, and the
/// result counts as rank deficient.
CalibrationResult calibrate(const ErrorModel& arm, const Measurements& measurements,
                            const CalibrationSettings& options = {});

}  // namespace kdl_calibration
