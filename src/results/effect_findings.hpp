#pragma once

// Not installed.

#include <Eigen/Core>
#include <string>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// What a group of effects does to one joint about one of its axes at the measured configurations.
struct EffectMotion {
  MovedBy by;
  std::vector<Eigen::Index> terms;  ///< of the model
  double lowest = 0.0;              ///< [rad] or [m]
  double highest = 0.0;

  double largest() const;  ///< in either direction
  /// Whether it is a length rather than an angle.
  bool is_length(const ErrorModel& model) const;
};
/// In the order of the groups, then of the joints and their axes.
std::vector<EffectMotion> effect_motions(const Calibration& calibration, const Measurements& measurements);

/// One sentence a group about the joint that it moves most, with what it explains of the squared errors that geometry
/// leaves at configurations held out, where cross-validation has compared both.
std::vector<std::string> effect_findings(const Calibration& calibration, const std::vector<EffectMotion>& motions);

}  // namespace kdl_calibration
