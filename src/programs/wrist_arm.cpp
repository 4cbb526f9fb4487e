#include "programs/wrist_arm.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

using Eigen::AngleAxisd;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kParallel = 1e-3;  // [rad]
constexpr double kMeet = 1e-3;      // [m]
constexpr double kSingular = 1e-5;  // [rad], or relative

struct TwoAngles {
  std::array<double, 2> values{};
  std::size_t count = 0;  // 0: no solution; 1: both are one
  bool any = false;       // every angle is a solution
};

// The angles x with a cos x + b sin x = c.
TwoAngles angles_of(double a, double b, double c) {
  constexpr double kRounding = 1e-9;
  const double length = std::hypot(a, b);
  if (length < kSingular) {
    return {.any = std::abs(c) < kSingular};
  }
  if (std::abs(c) > length * (1.0 + kRounding)) {
    return {};
  }
  const double middle = std::atan2(b, a);
  const double half = std::acos(std::clamp(c / length, -1.0, 1.0));
  return {.values = {middle + half, middle - half}, .count = 2};
}

double in_one_turn(double angle) { return std::remainder(angle, 2.0 * std::numbers::pi); }

// The angle of the rotation about `axis` that takes `from` to `to`; none where they lie on the axis.
std::optional<double> angle_about(const Vector3d& axis, const Vector3d& from, const Vector3d& to) {
  const Vector3d a = from - axis * axis.dot(from);
  const Vector3d b = to - axis * axis.dot(to);
  if (std::min(a.norm(), b.norm()) < kSingular) {
    return std::nullopt;
  }
  return std::atan2(axis.dot(a.cross(b)), a.dot(b));
}

Vector3d across(const Vector3d& vector, const Vector3d& direction) {
  return vector - direction * direction.dot(vector);
}

}  // namespace

WristArm::WristArm(const Robot& robot, const SixJoints& zero) {
  const auto require = [&](bool holds) {
    if (!holds) {
      throw InputError(robot.source +
                       ": the arm is of another build, expected six revolute joints, axes 2 and 3 parallel, and the "
                       "last three axes through one point");
    }
  };
  require(robot.joints.size() == axes_.size());
  flange_.setIdentity();
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    const MovingJoint& joint = robot.joints[i];
    require(joint.type != JointType::prismatic && !joint.mimic);
    flange_ = flange_ * to_eigen(joint.origin);
    axes_[i] = {.point = flange_.translation(), .direction = flange_.linear() * to_eigen(joint.axis)};
  }
  flange_ = flange_ * to_eigen(robot.tip_origin);
  require(axes_[1].direction.cross(axes_[2].direction).norm() < kParallel);
  // The point nearest to the last three axes, by least squares.
  Matrix3d normal = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (std::size_t i = 3; i < axes_.size(); ++i) {
    const Matrix3d projection = Matrix3d::Identity() - axes_[i].direction * axes_[i].direction.transpose();
    normal += projection;
    right += projection * axes_[i].point;
  }
  wrist_ = normal.ldlt().solve(right);
  for (std::size_t i = 3; i < axes_.size(); ++i) {
    require(across(wrist_ - axes_[i].point, axes_[i].direction).norm() < kMeet);
  }
  require(axes_[3].direction.cross(axes_[4].direction).norm() > kParallel);
  zero_ = sides(zero);
  require(std::abs(zero_.shoulder) > kMeet && std::abs(zero_.elbow) > kMeet);
}

Matrix3d WristArm::turn(std::size_t joint, double angle) const {
  return AngleAxisd(angle, axes_[joint].direction).toRotationMatrix();
}

WristArm::Sides WristArm::sides(const SixJoints& q) const {
  const Vector3d& a2 = axes_[1].direction;
  const Vector3d upper = axes_[2].point - axes_[1].point;
  const Vector3d fore = turn(2, q[2]) * (wrist_ - axes_[2].point);
  const Vector3d wrist = axes_[1].point + turn(1, q[1]) * (upper + fore);
  return {.shoulder = a2.dot(axes_[0].direction.cross(wrist - axes_[0].point)), .elbow = a2.dot(upper.cross(fore))};
}

ArmPosture WristArm::posture(const SixJoints& q) const {
  const Sides now = sides(q);
  return {.front = now.shoulder * zero_.shoulder > 0.0, .elbow_up = now.elbow * zero_.elbow > 0.0};
}

// Adds both solutions of the last three joints, whose rotations multiply to `wrist`.
void WristArm::add_wrists(const Matrix3d& wrist, SixJoints q, Solutions& solutions) const {
  const Vector3d& a4 = axes_[3].direction;
  const Vector3d& a5 = axes_[4].direction;
  const Vector3d& a6 = axes_[5].direction;
  const TwoAngles fifth =
      angles_of(a4.dot(across(a6, a5)), a4.dot(a5.cross(a6)), a4.dot(wrist * a6) - a5.dot(a6) * a5.dot(a4));
  solutions.singular = solutions.singular || fifth.any;
  for (std::size_t i = 0; i < fifth.count; ++i) {
    q[4] = in_one_turn(fifth.values[i]);
    const std::optional<double> fourth = angle_about(a4, turn(4, q[4]) * a6, wrist * a6);
    const std::optional<double> sixth = angle_about(a6, wrist.transpose() * a4, turn(4, -q[4]) * a4);
    if (!fourth || !sixth) {
      solutions.singular = true;
      return;
    }
    q[3] = *fourth;
    q[5] = *sixth;
    solutions.joint_values.push_back(q);
  }
}

WristArm::Solutions WristArm::solve(const Eigen::Isometry3d& X_BF) const {
  const Vector3d& a1 = axes_[0].direction;
  const Vector3d& a2 = axes_[1].direction;
  const Vector3d wrist = X_BF * (flange_.inverse() * wrist_);
  const Vector3d from_first = wrist - axes_[0].point;
  const Vector3d upper = across(axes_[2].point - axes_[1].point, a2);
  const Vector3d fore = across(wrist_ - axes_[2].point, a2);
  const double side = axes_[2].direction.dot(a2);  // 1, or -1 where joint 3 counts the other way
  Solutions solutions;
  // Turned back about axis 1, the wrist lies in the plane in which axes 2 and 3 move it.
  const TwoAngles first = angles_of(a2.dot(across(from_first, a1)), -a2.dot(a1.cross(from_first)),
                                    a2.dot(wrist_ - axes_[0].point) - a1.dot(from_first) * a1.dot(a2));
  solutions.singular = first.any;
  for (std::size_t i = 0; i < first.count; ++i) {
    SixJoints q = SixJoints::Zero();
    q[0] = in_one_turn(first.values[i]);
    const Vector3d reach = across(axes_[0].point + turn(0, -q[0]) * from_first - axes_[1].point, a2);
    const TwoAngles third = angles_of(upper.dot(fore), side * upper.dot(a2.cross(fore)),
                                      0.5 * (reach.squaredNorm() - upper.squaredNorm() - fore.squaredNorm()));
    for (std::size_t k = 0; k < third.count; ++k) {
      q[2] = in_one_turn(third.values[k]);
      const std::optional<double> second = angle_about(a2, upper + turn(2, q[2]) * fore, reach);
      if (!second) {
        solutions.singular = true;
        continue;
      }
      q[1] = *second;
      const Matrix3d arm = turn(0, q[0]) * turn(1, q[1]) * turn(2, q[2]);
      add_wrists(arm.transpose() * X_BF.linear() * flange_.linear().transpose(), q, solutions);
    }
  }
  return solutions;
}

}  // namespace kdl_calibration
