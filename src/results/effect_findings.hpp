#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/measurements.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {

/// Motion of one joint about one of its axes by a group of effects, at the measured configurations.
struct EffectMotion {
  EffectMotionKey by;
  std::vector<Eigen::Index> terms;  ///< indices into the model's effects
  double lowest = 0.0;              ///< [rad] or [m]
  double highest = 0.0;

  double largest() const;  ///< largest absolute value
  /// Whether the motion is a length rather than an angle.
  bool is_length(const ErrorModel& model) const;
};
/// Motions ordered by group, joint and axis.
std::vector<EffectMotion> effect_motions(const CalibrationResult& calibration, const Measurements& measurements);

/// One sentence per group about the joint that it moves most. If cross-validation compared both, also the share of the
/// geometry's squared held-out errors that it explains.
std::vector<std::string> effect_findings(const CalibrationResult& calibration,
                                         const std::vector<EffectMotion>& motions);

}  // namespace kdl_calibration
