#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "model/kinematics.hpp"

namespace kdl_calibration {

/// X_BF, and in `jacobian` (6 x entries of q) the flange's twist in the base frame per unit of each entry, linear
/// velocity of its origin first: axis x lever arm. Allocates nothing.
inline Eigen::Isometry3d manipulator_jacobian(const FoldedChain& chain, const Eigen::Ref<const Eigen::VectorXd>& q,
                                              Eigen::Ref<Matrix6Xd> jacobian) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  const auto joints = static_cast<Eigen::Index>(chain.prismatic.size());
  for (Eigen::Index i = 0; i < joints; ++i) {
    const auto joint = static_cast<std::size_t>(i);
    if (const Eigen::Index entry = 3 * joints + i; q.size() > entry) {
      jacobian.col(entry) << Eigen::Vector3d::Zero(), pose.linear() * chain.stretches[joint];
      pose.translation() += jacobian.col(entry).tail<3>() * q[entry];
    }
    pose = pose * chain.links[joint];
    for (Eigen::Index across = 0; across < 2 && q.size() > joints; ++across) {
      const Eigen::Index entry = joints + 2 * i + across;
      jacobian.col(entry) << pose.translation(), pose.linear().col(across);
      pose.linear() = pose.linear() * Eigen::AngleAxisd(q[entry], Eigen::Vector3d::Unit(across)).toRotationMatrix();
    }
    jacobian.col(i) << pose.translation(), pose.linear().col(2);
    if (chain.prismatic[joint]) {
      pose.translation() += pose.linear().col(2) * q[i];
    } else {
      pose.linear() = pose.linear() * Eigen::AngleAxisd(q[i], Eigen::Vector3d::UnitZ()).toRotationMatrix();
    }
  }
  pose = pose * chain.links.back();
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const Eigen::Vector3d origin = jacobian.col(i).head<3>();
    const Eigen::Vector3d axis = jacobian.col(i).tail<3>();
    if (i >= 3 * joints || (i < joints && chain.prismatic[static_cast<std::size_t>(i)])) {
      jacobian.col(i) << axis, Eigen::Vector3d::Zero();
    } else {
      jacobian.col(i) << axis.cross(pose.translation() - origin), axis;
    }
  }
  return pose;
}

}  // namespace kdl_calibration
