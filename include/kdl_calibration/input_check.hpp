#pragma once

#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/measurements_check.hpp"

namespace kdl_calibration {

/// Whether what a public function was given holds together. The functions that take it call these once, before they use
/// anything. All throw InputError that names the value and the rule.

/// Frames and joints that the model has, effects of a finite mean and scale.
void check(const ErrorModel& model);

/// As check(model) and check(measurements), and they are of this model's robot: as many joints, with its names where
/// they are stated.
void check(const Measurements& measurements, const ErrorModel& model);

/// One error for each parameter, one effect for each of the model's or none, all finite, and a target for each that
/// was measured.
void check(const Estimate& estimate, const ErrorModel& model, const Measurements& measurements);
void check(const Estimate& estimate, const ErrorModel& model, std::size_t targets);

/// Indices of parameters and effects that the model has, and coordinates of targets that were measured.
void check(const Unknowns& free, const ErrorModel& model, const Measurements& measurements);
void check(const Unknowns& free, const ErrorModel& model, std::size_t targets);

/// Indices of configurations that were measured.
void check(const std::vector<std::vector<Eigen::Index>>& folds, const Measurements& measurements);

/// Sigmas that are finite and not negative.
void check(const Priors& priors);
void check(const NoiseModel& noise);

/// The same of noise and priors, and a weight of 0 or more for each row or none.
void check(const ResidualOptions& options, const Measurements& measurements);

/// Measurements, start, unknowns and options of one model.
void check(const FitProblem& problem);

/// Frames that are finite, a length of 0 or more.
void check(const RegistrationOptions& options);

}  // namespace kdl_calibration
