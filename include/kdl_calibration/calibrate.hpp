#pragma once

// The whole calibration in one call.
//
//     const Robot robot = load_robot("robot.urdf");
//     const Calibration found = calibrate(complete_model(robot), read_measurements(robot, "measurements.csv"));
//     std::cout << found.accuracy.train.after.rms << " m\n";

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// The whole calibration: registration, reduction of the model to what the measured targets can show, choice of priors
/// and effects, identification, covariance, validation. No starting values are needed.
/// Throws InputError: measurements that do not hold together or are another robot's, a sigma or prior that is negative
/// or not finite, a pattern that matches nothing, a fixed base or target coordinate that is not known, two-step
/// with known frames, measured orientations, priors, effects or a loss, fewer equations than unknowns, no training
/// rows, noise from repeats without repeats, a sigma of orientations without one of positions or without orientations.
/// Candidates that the measurements at hand cannot tell apart are fixed by the order of the reduction (base, targets,
/// joint offsets, links): each is kept only where its column raises the rank at the data. What is dropped stays exactly
/// at zero, and the answer counts as rank deficient. For the joint estimator.
Calibration calibrate(const ErrorModel& model, const Measurements& measurements,
                      const CalibrationOptions& options = {});

}  // namespace kdl_calibration
