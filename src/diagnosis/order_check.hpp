#pragma once

// What the residuals tell in the order in which the points were measured. Not installed.

#include <optional>
#include <string>

#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// A change of the base against the measuring device, or of one target against the flange.
struct OrderFinding {
  enum class Kind { step_of_base, drift_of_base, step_of_target };
  Kind kind = Kind::step_of_base;
  int target = -1;              ///< of a step of a target
  int last_before = -1;         ///< configuration in front of a step
  Eigen::Vector3d translation;  ///< [m] of the base in its own frame (of the target in the flange frame)
  Eigen::Vector3d rotation;     ///< [rad] of the base
  double moved = 0.0;           ///< [m] root mean square of what it moves the points behind it (at the end of a drift)
  double share = 0.0;           ///< of the misfit's squares that it takes away
  double left = 0.0;            ///< [m] 3D misfit without it
};

/// The best single explanation of the residuals by a step of the base between two visits of the arm (base.Tx … base.Rz
/// from there on), by a drift of it in proportion to the visits, or by a step of one target, to first order and beside
/// all free parameters and the joints' effects under gravity and gains, as far as the data leave freedom for those.
/// A visit is a configuration's repeat; visits stand in the order of Measurements::order, else of their first rows.
/// Nothing unless the gain is beyond chance: F test with a false alarm of 1e-5 over all places, as if all points of a
/// configuration had the same misfit, unless it takes away `least_share` of the squares, and unless leaving out a
/// single visit takes away less. A step of the base also needs points on both sides that determine a pose: they must
/// spread across a line. A ball that sits in one socket after the other does not. The measurements are training rows
/// alone.
std::optional<OrderFinding> check_order(const ErrorModel& model, const Measurements& measurements,
                                        const Estimate& estimate, const Unknowns& free, double least_share = 0.4);

}  // namespace kdl_calibration
