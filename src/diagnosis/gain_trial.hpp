#pragma once

// Trial of joint gains: motion proportional to the joint values with a factor other than 1.

#include <optional>

#include "estimation/identification.hpp"
#include "estimation/least_squares.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// A larger gain means a wrong unit, gear ratio or encoder setting: compliance and eccentric encoders stay far below.
constexpr double kLeastWrongGain = 0.01;

struct GainTrial {
  std::size_t joint = 0;   ///< with the largest gain
  double factor = 1.0;     ///< by which its values would have to be multiplied
  int others = 0;          ///< number of other joints with a gain beyond kLeastWrongGain
  double rms = 0.0;        ///< [m] 3D misfit with the gains of all joints
  double rms_rigid = 0.0;  ///< [m] 3D misfit without gains
};

/// Fits the training rows from the rigid `start`, without and with the gains of all joints beside the free base,
/// targets and geometry. Empty if the errors are implausible.
std::optional<GainTrial> try_gains(const ErrorModel& model, const Measurements& measurements, const Estimate& start,
                                   const Unknowns& free);

}  // namespace kdl_calibration
