#pragma once

#include "estimation/identification.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/measurements_check.hpp"

namespace kdl_calibration {

/// Checks of arguments. Public functions call these once, before they use the arguments. All throw InputError that
/// names the value and the rule.

/// Parameters and effects refer to existing frames and joints; effects have a finite mean and scale.
void check(const ErrorModel& model);

/// As check(model) and check(measurements). The measurements have the model's number of joints, and its joint names if
/// stated.
void check(const Measurements& measurements, const ErrorModel& model);

/// One error for each parameter, one effect for each of the model's or none, all finite, and one target for each
/// measured one.
void check(const Estimate& estimate, const ErrorModel& model, const Measurements& measurements);
void check(const Estimate& estimate, const ErrorModel& model, std::size_t targets);

/// Indices of existing parameters and effects, and of coordinates of targets.
void check(const Unknowns& free, const ErrorModel& model, std::size_t targets);

/// Sigmas that are finite and not negative.
void check(const Priors& priors);
void check(const NoiseModel& noise);

/// The same for noise and priors; row weights not negative, one per row or none.
void check(const ResidualOptions& options, const Measurements& measurements);

/// Frames that are finite, a length of 0 or more.
void check(const RegistrationOptions& options);
/// The same, and of known targets at least one is measured: else a name is misspelt.
void check(const KnownFrames& known, const Measurements& measurements);

/// Whether it is a rotation and a translation, finite and up to 1e12 m.
bool is_rigid(const Eigen::Isometry3d& X);

}  // namespace kdl_calibration
