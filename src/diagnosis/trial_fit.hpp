#pragma once

// A fit to another reading of the measurements, for comparison only.

#include "estimation/identification.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/registration.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

struct TrialFit {
  const ErrorModel& model;
  const Unknowns& free;
  const RegistrationOptions& registration;
  const JointOptions& joint;
};

/// A hypothesis is fitted only if its misfit after registration is below this multiple of that of the data as read.
constexpr double kWorthAFit = 2.0;
/// The same relative to the hypothesis that leaves the least after registration: geometric errors do not make a right
/// reading look that much worse than a wrong one.
constexpr double kWorthAFitBesideTheNearest = 5.0;

/// Ends the message of every other reading.
constexpr const char* kUsedAsRead = "the input was used as read";

/// Whether a robot's errors can be as large: 50 mm (0.5 % of an arm beyond ten metres), 0.35 rad. With larger ones a
/// wrong reading may fit, e.g. the fifth joint's opposite sign as half a turn of the fourth and the sixth.
bool plausible(const ErrorModel& model, const Eigen::VectorXd& errors);

/// [m] 3D RMS of the training rows; infinite if not finite.
double rms_of(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate);

/// The same after a fit of the free unknowns except effects, from `start`. Returns the start's RMS if the errors are
/// implausible or the fit is worse. Effects keep their values: without absolute noise, their priors would hold them
/// there anyway.
double fitted_rms(const TrialFit& fit, const Measurements& measurements, const Estimate& start);

}  // namespace kdl_calibration
