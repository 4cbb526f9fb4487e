#include "effects/arm_kinematics.hpp"

#include <array>
#include <cstddef>
#include <memory_resource>
#include <string>

#include "base/preconditions.hpp"
#include "effects/joint_effects.hpp"
#include "model/manipulator_jacobian.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::Map;
using Eigen::MatrixXd;
using Eigen::Ref;
using Eigen::VectorXd;

constexpr double kStep = 1e-6;  // [rad or m]

// A vector on the stack if there are few joints.
class Scratch {
public:
  double* numbers(Index count) {
    return static_cast<double*>(memory_.allocate(static_cast<std::size_t>(count) * sizeof(double), kAlignment));
  }

private:
  static constexpr std::size_t kAlignment = 32;
  alignas(kAlignment) std::array<std::byte, (38 * kFewJoints + 8) * sizeof(double)> bytes_;
  std::pmr::monotonic_buffer_resource memory_{bytes_.data(), bytes_.size()};
};

// The joint values, then with each of them larger and smaller by kStep: n x (2 n + 1).
MatrixXd neighbours(const Ref<const VectorXd>& q) {
  const Index n = q.size();
  MatrixXd result = q.replicate(1, 2 * n + 1);
  for (Index k = 0; k < n; ++k) {
    result(k, 1 + 2 * k) += kStep;
    result(k, 2 + 2 * k) -= kStep;
  }
  return result;
}

}  // namespace

ArmKinematics::ArmKinematics(const ErrorModel& model, const VectorXd& errors, const VectorXd& effects)
    : model_(model), effects_(effects) {
  require_finite("a calibrated arm", errors.allFinite() && effects.allFinite());
  chain_ = folded(model, errors);
  if (effects_.isZero(0.0)) {
    effects_.resize(0);
  }
  if (effects_.size() > 0 && needs_torques(model)) {
    refuse_input("an arm with effects of measured torques", "effects of joint values alone");
  }
  has_own_functions_ = kdl_calibration::has_own_functions(model);
}

Isometry3d ArmKinematics::flange_pose(const Ref<const VectorXd>& q) const {
  if (effects_.size() == 0) {
    return kdl_calibration::flange_pose(chain_, q);
  }
  Scratch scratch;
  const Index entries = motion_size(model_);
  Map<VectorXd> moved(scratch.numbers(entries), entries);
  effect_motion(model_, effects_, q, moved);
  if (has_own_functions_) {
    moved += own_motions(model_, effects_, q);
  }
  moved.head(q.size()) += q;
  return kdl_calibration::flange_pose(chain_, moved);
}

Isometry3d ArmKinematics::flange_pose(const Ref<const VectorXd>& q, Matrix6Xd& jacobian) const {
  jacobian.resize(6, q.size());
  return flange_pose(q, Ref<Matrix6Xd>(jacobian));
}

Isometry3d ArmKinematics::flange_pose(const Ref<const VectorXd>& q, Ref<Matrix6Xd> jacobian) const {
  const Index n = q.size();
  if (effects_.size() == 0) {
    return manipulator_jacobian(chain_, q, jacobian);
  }
  Scratch scratch;
  const Index entries = motion_size(model_);
  Map<VectorXd> moved(scratch.numbers(entries), entries);
  const MatrixXd own = has_own_functions_ ? own_motions(model_, effects_, neighbours(q)) : MatrixXd();
  effect_motion(model_, effects_, q, moved);
  if (has_own_functions_) {
    moved += own.col(0);
  }
  moved.head(n) += q;
  Map<Matrix6Xd> rigid(scratch.numbers(6 * entries), 6, entries);
  Isometry3d pose = manipulator_jacobian(chain_, moved, rigid);
  jacobian = rigid.leftCols(n);
  Map<VectorXd> beside(scratch.numbers(n), n);
  Map<VectorXd> above(scratch.numbers(entries), entries);
  Map<VectorXd> below(scratch.numbers(entries), entries);
  beside = q;
  for (Index k = 0; k < n; ++k) {
    beside[k] = q[k] + kStep;
    effect_motion(model_, effects_, beside, above);
    beside[k] = q[k] - kStep;
    effect_motion(model_, effects_, beside, below);
    beside[k] = q[k];
    if (has_own_functions_) {
      above += own.col(1 + 2 * k);
      below += own.col(2 + 2 * k);
    }
    above = (above - below) / (2.0 * kStep);
    jacobian.col(k).noalias() += rigid * above;
  }
  return pose;
}

}  // namespace kdl_calibration
