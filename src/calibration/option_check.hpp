#pragma once

// Checks of a calibration's options.

#include "calibration/calibration_settings.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// All checks possible before the first fit; `training`: the rows of `measurements` to fit. Throws InputError, for
/// options OptionError.
void check_options(const ErrorModel& model, const Measurements& measurements, const Measurements& training,
                   const CalibrationSettings& options);

/// Throws without repeats, or if they do not vary along every axis.
void require_repeats(const Measurements& measurements);

/// Throws for a sigma of orientations [rad] without a sigma of positions [m], or without orientations.
void require_comparable_orientations(const Measurements& measurements, const NoiseOptions& options);

/// Throws if torque effects are requested and a measured or predicted configuration lacks a torque, or if the signals'
/// size differs from that of the joint values.
void require_signals(const Measurements& measurements, const CalibrationSettings& options);

/// Throws if the published two-step procedure is requested with unknowns, measurements or options that it does not
/// cover.
void require_two_step_data(const Unknowns& free, const Measurements& measurements, const CalibrationSettings& options);

}  // namespace kdl_calibration
