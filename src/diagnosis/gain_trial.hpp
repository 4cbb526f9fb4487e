#pragma once

// Whether a joint turns by another share of what its values say. Not installed.

#include <optional>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// A gain beyond this is a unit, a gear ratio or an encoder set wrong: compliance and eccentric rings stay far below.
constexpr double kLeastWrongGain = 0.01;

struct GainTrial {
  std::size_t joint = 0;   ///< with the largest gain
  double factor = 1.0;     ///< that its values were to be multiplied by
  int others = 0;          ///< joints with a gain beyond kLeastWrongGain, too
  double rms = 0.0;        ///< [m] 3D misfit with the gains of all joints
  double rms_rigid = 0.0;  ///< [m] without
};

/// Fits from `start`, which is rigid, without effects and with the gains of all joints beside what is free of base,
/// targets and geometry. Nothing where those errors are beyond any robot's. Of training rows.
std::optional<GainTrial> try_gains(const ErrorModel& model, const Measurements& measurements, const Estimate& start,
                                   const Unknowns& free);

}  // namespace kdl_calibration
