#pragma once

// A sample of the measurements for trials of other readings.

#include <cstddef>

#include "estimation/least_squares.hpp"
#include "estimation/registration.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Positions of the train rows of configurations spread over the file, with their unknowns.
struct TrialSample {
  Measurements measurements;
  Unknowns free;
  double freedom = 0.0;  ///< distinct coordinates minus unknowns
  double points_of_a_configuration = 1.0;
};

TrialSample trial_sample(const ErrorModel& model, const Measurements& measurements, const Unknowns& free,
                         std::size_t most_configurations);

/// [m] distance from the measured point of the points that represent its orientation.
constexpr double kLeverOfOrientations = 0.1;

/// The measurements with every pose as four points: the measured one and one along each axis of the target's frame,
/// targets "A", "A.x", "A.y" and "A.z". Known targets stay known, free ones free.
struct PosePoints {
  Measurements measurements;
  Estimate fit;
  Unknowns free;
  RegistrationOptions registration;
};

PosePoints pose_points(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                       const Unknowns& free, const RegistrationOptions& registration);

}  // namespace kdl_calibration
