#pragma once

// What models, estimates and groups are to the kernel. Not installed.

#include <Eigen/Core>
#include <vector>

#include "estimation/chain_kernel.hpp"
#include "estimation/observed_data.hpp"
#include "kdl_calibration/kinematics.hpp"

namespace kdl_calibration {

FrameNumbers numbers_of(const Eigen::Matrix3d& R, const Eigen::Vector3d& p);
/// `frame`: as ChainColumn counts them.
ChainColumn numbers_of(const ParameterTwist& twist, int frame);

/// What moves the joints: the effects `terms`, in the order of terms_in_lanes().
std::vector<ChainMotion> motions_of(const ErrorModel& model, const Unknowns& unknowns,
                                    const std::vector<std::size_t>& terms);

/// Where the kept point `k` of a group that is not by axis is expected in the flange frame.
Eigen::Vector3d kept_target(const LaneGroup& group, std::size_t k, const Estimate& estimate);

/// The frame P of what is kept of a configuration.
struct KeptFrame {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< its origin in the flange frame
  double weight = 1.0;                               ///< of the points together
};
/// Writes what an estimate expects of the group's points or rows.
KeptFrame set_kept(const LaneGroup& group, const Estimate& estimate, ChainKernelInput& input);

}  // namespace kdl_calibration
