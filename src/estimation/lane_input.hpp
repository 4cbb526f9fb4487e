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

/// Of a group by axis: the sum of the rows along each axis, one row.
LaneGroup sums_by_axis(const LaneGroup& group);

/// The weighted means of a group's points. The sum of sqrt(w_k) e_k over the points is W (z - t) for the mean z.
struct LaneMeans {
  double W = 0.0;                                    ///< sum sqrt(w_k), whose square is the weight of the mean
  Eigen::Vector3d target = Eigen::Vector3d::Zero();  ///< t
  LaneGroup group;                                   ///< of these means
};
LaneMeans means_of(const LaneGroup& group, const Estimate& estimate);

}  // namespace kdl_calibration
