#pragma once

// What a calibration demands of its options. Not installed.

#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

/// All that can be checked before the first fit; `training`: the rows of `measurements` to fit. Throws InputError, for
/// options OptionError.
void check_options(const ErrorModel& model, const Measurements& measurements, const Measurements& training,
                   const CalibrationOptions& options);

/// Throws where there are no repeats, or none that vary along every axis.
void require_repeats(const Measurements& measurements);

/// Throws for a sigma of orientations [rad] that has no sigma of positions [m] beside it, or no orientation.
void require_comparable_orientations(const Measurements& measurements, const NoiseOptions& options);

/// Throws where effects of measured torques are asked for and the measurements, or the configurations to predict at,
/// lack some, and where signals are not of the size of the joint values.
void require_signals(const Measurements& measurements, const CalibrationOptions& options);

/// Throws where the published two-step procedure is asked for and the unknowns, the measurements or other options are
/// not what it was published for.
void require_two_step_data(const Unknowns& free, const Measurements& measurements, const CalibrationOptions& options);

}  // namespace kdl_calibration
