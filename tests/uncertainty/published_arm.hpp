#pragma once

// The published experiment, and its errors in the coordinates of the columns.

#include <Eigen/Geometry>

#include "robot/joint_ranges.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing {

/// With errors of the irreducible model.
inline VirtualExperiment published(const Random& random = Random(1)) {
  return VirtualExperiment({.ranges = published_ranges, .random = random});
}

/// Difference of an estimate from the truth in the coordinates of the columns: base, geometric, targets.
inline Eigen::VectorXd column_errors(const VirtualExperiment& experiment, const Estimate& estimate,
                                     const Estimate& truth) {
  Eigen::VectorXd d(33);
  const Eigen::Isometry3d off = truth.frames.base().inverse() * estimate.frames.base();
  const Eigen::AngleAxisd turn(off.linear());
  d.head<3>() = off.translation();
  d.segment<3>(3) = turn.angle() * turn.axis();
  for (std::size_t i = 0; i < experiment.free.geometric().size(); ++i) {
    const auto p = static_cast<Eigen::Index>(experiment.free.geometric()[i]);
    d[6 + static_cast<Eigen::Index>(i)] = estimate.errors[p] - truth.errors[p];
  }
  for (int k = 0; k < 3; ++k) {
    const auto target = static_cast<std::size_t>(k);
    d.segment<3>(24 + 3 * k) =
        estimate.frames.targets[target].X_FT.translation() - truth.frames.targets[target].X_FT.translation();
  }
  return d;
}

}  // namespace kdl_calibration::testing
