#pragma once

// Conversion of models, estimates and groups to the kernel's input.

#include <Eigen/Core>
#include <vector>

#include "estimation/chain_kernel.hpp"
#include "estimation/observed_data.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {

FrameNumbers numbers_of(const Eigen::Matrix3d& R, const Eigen::Vector3d& p);
/// `frame`: numbered as in ChainColumn.
ChainColumn numbers_of(const ParameterTwist& twist, int frame);

/// Motions of the joints by the effects `terms`, which are ordered as by terms_in_lanes().
std::vector<ChainMotion> motions_of(const ErrorModel& model, const Unknowns& unknowns,
                                    const std::vector<std::size_t>& terms);

/// Predicted position in the flange frame of the stored point `k` of a group that is not by axis.
Eigen::Vector3d kept_target(const LaneGroup& group, std::size_t k, const Estimate& estimate);

/// The frame P of the stored points.
struct KeptFrame {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< its origin in the flange frame
  double weight = 1.0;                               ///< sum of the points' weights
};
/// Writes the estimate's predictions of the group's points or rows to `input`.
KeptFrame set_kept(const LaneGroup& group, const Estimate& estimate, ChainKernelInput& input);

/// For a group by axis: a group with one row per axis, the sum of its rows along that axis.
LaneGroup sums_by_axis(const LaneGroup& group);

/// The weighted means of a group's points. The sum of sqrt(w_k) e_k over the points is W (z - t) for the mean z.
struct LaneMeans {
  double W = 0.0;                                    ///< sum sqrt(w_k), whose square is the weight of the mean
  Eigen::Vector3d target = Eigen::Vector3d::Zero();  ///< t
  LaneGroup group;                                   ///< one point per configuration: the mean
};
LaneMeans means_of(const LaneGroup& group, const Estimate& estimate);

}  // namespace kdl_calibration
