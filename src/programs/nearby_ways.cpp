#include "programs/nearby_ways.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Isometry3d;

NearbyWays::NearbyWays(const Robot& arm)
    : joints_(arm.joints), wrist_(WristArm::of(arm)), parallel_(ParallelArm::of(arm)) {}

bool NearbyWays::is_within_limits(const SixJoints& q) const {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  for (Index i = 0; i < q.size(); ++i) {
    const MovingJoint& joint = joints_[static_cast<std::size_t>(i)];
    if (q[i] < joint.lower.value_or(-kInfinite) || q[i] > joint.upper.value_or(kInfinite)) {
      return false;
    }
  }
  return true;
}

std::vector<SixJoints> NearbyWays::all(const Isometry3d& X_BF, const SixJoints& near) const {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  const ArmSolutions solutions = wrist_ ? wrist_->solve(X_BF) : parallel_ ? parallel_->solve(X_BF) : ArmSolutions();
  std::vector<SixJoints> ways;
  const auto add = [&](const SixJoints& q) {
    if (is_within_limits(q)) {
      ways.push_back(q);
    }
  };
  for (const SixJoints& solution : solutions.joint_values) {
    const SixJoints nearest =
        near + (solution - near).unaryExpr([](double change) { return std::remainder(change, kTurn); });
    add(nearest);
    for (Index i = 0; i < nearest.size(); ++i) {
      SixJoints further = nearest;
      further[i] -= std::copysign(kTurn, nearest[i] - near[i]);
      add(further);
    }
  }
  std::sort(ways.begin(), ways.end(),
            [&](const SixJoints& a, const SixJoints& b) { return (a - near).norm() < (b - near).norm(); });
  return ways;
}

std::vector<SixJoints> other_ways(std::vector<SixJoints> ways, const SixJoints& near, const SixJoints& taken,
                                  double share) {
  constexpr double kSame = 0.05;  // [rad] closed forms leave out small tilts of the axes
  std::erase_if(ways, [&](const SixJoints& q) {
    return (q - taken).norm() < kSame || (q - near).norm() > share * (taken - near).norm();
  });
  return ways;
}

double spread_of_commands(const Compensator& compensator, const Isometry3d& X_BF, const CompensatedPoint& taken,
                          const std::vector<CompensatedJoints>& others) {
  const Eigen::Vector3d commanded = compensator.nominal_pose(taken.joint_values).translation();
  double spread = 0.0;
  for (const CompensatedJoints& other : others) {
    const CompensatedPoint point = compensator.solve(X_BF, other);
    if (point.status == CompensationStatus::exact) {
      spread = std::max(spread, (compensator.nominal_pose(point.joint_values).translation() - commanded).norm());
    }
  }
  return spread;
}

}  // namespace kdl_calibration
