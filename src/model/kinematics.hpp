#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <kdl/frames.hpp>
#include <vector>

#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

using Matrix3Xd = Eigen::Matrix<double, 3, Eigen::Dynamic>;
using Matrix6Xd = Eigen::Matrix<double, 6, Eigen::Dynamic>;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// [v]x, so that skew(v) * u = v x u.
Eigen::Matrix3d skew(const Eigen::Vector3d& v);
/// Rotation by |v| about v (Rodrigues).
Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& v);
/// Its inverse, for angles up to pi.
Eigen::Vector3d rotation_log(const Eigen::Matrix3d& R);

/// A rotation that turns z onto the unit vector `axis`, exact for the coordinate axes: that of smallest angle. If
/// axis.z is below -0.55, half a turn about x comes first. The images of x and y are the two axes across a joint's own.
Eigen::Matrix3d z_onto(const Eigen::Vector3d& axis);

/// The chain with its errors multiplied out into constant frames and every joint's axis turned onto z:
///   X_BF(q) = links[0] Z(q1) links[1] Z(q2) … links[n],  Z a rotation about or a translation along z.
/// Joint frame i is the frame before Z(q_i); frame n is the flange.
///
/// A compliant bearing tilts the links behind it. Joint values may therefore have 3 n entries: the n values, then two
/// tilts [rad] per joint. Z(q_i) then becomes Rx(q[n + 2 i]) Ry(q[n + 2 i + 1]) Z(q_i) with i from 0. A link that
/// expands moves the joint frame at its far end: with 4 n entries Trans(q[3 n + i] u_i) comes before links[i].
struct FoldedChain {
  std::vector<Eigen::Isometry3d> links;
  std::vector<bool> prismatic;
  std::vector<Eigen::Vector3d> stretches;  ///< u_i: along the nominal link before joint i, in the frame before links[i]
};
/// The nominal link before a joint, in the folded frame of the joint before it (the base frame for the first one) [m].
Eigen::Vector3d link_before(const ErrorModel& model, std::size_t joint);
FoldedChain folded(const ErrorModel& model, const Eigen::VectorXd& errors);

/// A column of the identification Jacobian before its transformation to the flange: the twist of the links behind joint
/// frame `frame` (-1: base frame) per unit of the parameter, in that frame. `tilted`: the frame after the joint's
/// tilts.
struct ParameterTwist {
  int frame = 0;
  Eigen::Vector3d linear = Eigen::Vector3d::Zero();
  Eigen::Vector3d angular = Eigen::Vector3d::Zero();
  bool tilted = false;
};

/// Twists of the model's parameters `which` at the given errors.
std::vector<ParameterTwist> parameter_twists(const ErrorModel& model, const Eigen::VectorXd& errors,
                                             const std::vector<std::size_t>& which);
/// folded() and parameter_twists() for many errors of one model: prepared once, after which `fold` allocates nothing.
class ChainFolder {
public:
  ChainFolder(const ErrorModel& model, const std::vector<std::size_t>& which);

  /// A chain of the right size, for `fold` to fill.
  const FoldedChain& shape() const { return shape_; }
  /// Writes the links of `chain` and the twists of the parameters `which` to twists[first], twists[first + 1], …
  void fold(const Eigen::VectorXd& errors, FoldedChain& chain, std::vector<ParameterTwist>& twists,
            std::size_t first) const;

private:
  struct Factor {
    Eigen::Index parameter = 0;
    Eigen::Vector3d axis = Eigen::Vector3d::Zero();
    bool translation = false;
    int column = -1;  // index into `which`
  };
  struct Frame {
    Eigen::Isometry3d origin = Eigen::Isometry3d::Identity();  // after the turn of the previous frame
    Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
    Eigen::Vector3d pivot = Eigen::Vector3d::Zero();  // about which the errors act
    std::vector<Factor> factors;                      // in the order of the product
  };
  FoldedChain shape_;
  std::vector<Frame> frames_;
};

/// Twists of base.Tx … base.Rz: X_WB is right-multiplied by a small motion in the base frame.
std::vector<ParameterTwist> base_twists();

/// X_BF at joint values `q` (rad or m).
Eigen::Isometry3d flange_pose(const FoldedChain& chain, const Eigen::Ref<const Eigen::VectorXd>& q);

/// X_BF for every column of `joint_values`.
std::vector<Eigen::Isometry3d> flange_poses(const FoldedChain& chain, const Eigen::MatrixXd& joint_values);

/// X_BF, and in `jacobian` (6 x twists, resized) the flange's body twist per unit of each parameter: linear velocity
/// of the flange's origin, then angular velocity, both in the flange frame. One backward pass over the chain.
Eigen::Isometry3d flange_jacobian(const FoldedChain& chain, const std::vector<ParameterTwist>& twists,
                                  const Eigen::Ref<const Eigen::VectorXd>& q, Matrix6Xd& jacobian);

}  // namespace kdl_calibration
