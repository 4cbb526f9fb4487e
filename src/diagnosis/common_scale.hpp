#pragma once

// One factor on all lengths. Not installed.

#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

struct CommonScale {
  double factor = 1.0;   ///< fitted over nominal length
  double p_value = 1.0;  ///< that independent errors agree with one factor as well
};

/// The factor on all lengths of the arm that explains the fitted geometric errors best. A fit behind a wrong unit or a
/// wrong refractive index finds such errors. No factor (1, p-value 1) where the base is known or fewer than six errors
/// are free.
CommonScale common_scale(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                         const Unknowns& free);

/// [m] RMS of the measured coordinates and distances, `factor` times as long as they were read, from those of the
/// nominal arm with registered bases and targets.
double nominal_misfit(const ErrorModel& model, const Measurements& measurements, double factor);

}  // namespace kdl_calibration
