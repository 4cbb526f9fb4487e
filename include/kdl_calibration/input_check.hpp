#pragma once

#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/measurements_check.hpp"
#include "kdl_calibration/registration.hpp"

namespace kdl_calibration {

/// Whether what a public function was given holds together; the functions call it once, before they use anything. All
/// throw InputError that names the value and the rule.

/// As check(measurements), and they are of this model's robot: as many joints, with its names where they are stated.
void check(const Measurements& measurements, const ErrorModel& model);

/// One error for each parameter, one effect for each of the model's or none, all finite, and a target for each that
/// was measured.
void check(const Estimate& estimate, const ErrorModel& model, const Measurements& measurements);

/// Indices of parameters and effects that the model has, and coordinates of targets that were measured.
void check(const Unknowns& free, const ErrorModel& model, const Measurements& measurements);

/// Sigmas of noise and priors that are finite and not negative, a weight of 0 or more for each row or none.
void check(const ResidualOptions& options, const Measurements& measurements);

/// Frames that are finite, a length above zero.
void check(const RegistrationOptions& options);

}  // namespace kdl_calibration
