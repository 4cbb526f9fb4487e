#pragma once

// Checks the residuals in the order of measurement.

#include <optional>
#include <string>

#include "estimation/least_squares.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// A change of the base against the measuring device, or of one target against the flange.
struct OrderFinding {
  enum class Kind { step_of_base, drift_of_base, step_of_target };
  Kind kind = Kind::step_of_base;
  int target = -1;              ///< for a step of a target, else -1
  int last_before = -1;         ///< configuration before a step
  Eigen::Vector3d translation;  ///< [m] of the base in its own frame (of the target in the flange frame)
  Eigen::Vector3d rotation;     ///< [rad] of the base
  double moved = 0.0;           ///< [m] RMS motion of the points after the step (at the end of a drift)
  double share = 0.0;           ///< of the residual squares that it explains
  double left = 0.0;            ///< [m] 3D misfit without it
};

/// The best single explanation of the residuals: a step of the base between two visits, a drift of the base
/// proportional to the visits, or a step of one target. It is first-order, beside all free parameters and, if the data
/// leave enough freedom, effects of gravity and gains.
/// A visit is a configuration's repeat. Visits are ordered by Measurements::order, else by their first rows. A finding
/// must be significant (F test, false alarm 1e-5 over all places, as if a configuration's points had the same misfit).
/// It must explain 40 % of the squares, and more than leaving out a single visit. A step of the base also
/// needs points on both sides that determine a pose, i.e. not all on a line. The measurements must be training rows
/// only.
std::optional<OrderFinding> check_order(const ErrorModel& model, const Measurements& measurements,
                                        const Estimate& estimate, const Unknowns& free);

}  // namespace kdl_calibration
