#pragma once

// A fit to measurements that were read in another way, for comparison alone. Not installed.

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/registration.hpp"

namespace kdl_calibration {

struct TrialFit {
  const ErrorModel& model;
  const Unknowns& free;
  const RegistrationOptions& registration;
  const JointOptions& joint;
};

/// A hypothesis is fitted only if its misfit after registration is below this multiple of that of the data as read.
constexpr double kWorthAFit = 2.0;
/// The same relative to the hypothesis that leaves the least after registration: the errors of an arm, in their
/// directions, do not make a right reading look that much worse than a wrong one.
constexpr double kWorthAFitBesideTheNearest = 5.0;

/// [m] of the links one behind the other, that of the base included.
double arm_length(const ErrorModel& model);

/// Whether a robot may have these errors: 50 mm (0.5 % of an arm beyond ten metres), 0.35 rad. With larger ones a wrong
/// reading may fit, e.g. the fifth joint's opposite sign as half a turn of the fourth and the sixth.
bool plausible(const ErrorModel& model, const Eigen::VectorXd& errors);

/// [m] 3D, of training rows; infinite where it is not finite.
double rms_of(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate);

/// The same after a fit of all that is free but effects, from `start`; that of the start where the errors found are
/// beyond any robot's or the fit is worse. Effects stay as in the start: their priors, in metres and radians, would
/// hold them there beside residuals that no noise weighs.
double fitted_rms(const TrialFit& fit, const Measurements& measurements, const Estimate& start);

}  // namespace kdl_calibration
