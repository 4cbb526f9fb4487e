#include "programs/pose_numbers.hpp"

#include <array>
#include <numbers>

#include "kdl_calibration/error_model.hpp"
#include "robot/urdf_correction.hpp"

namespace kdl_calibration {
namespace {

using Eigen::AngleAxisd;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

Matrix3d rotation_of(PointNotation notation, const PointNumbers& numbers) {
  const auto rest = numbers.tail(numbers.size() - 3);
  const auto about_zyx = [](double z, double y, double x) {
    return (AngleAxisd(z, Vector3d::UnitZ()) * AngleAxisd(y, Vector3d::UnitY()) * AngleAxisd(x, Vector3d::UnitX()))
        .toRotationMatrix();
  };
  switch (notation) {
    case PointNotation::fixed_xyz:
      return about_zyx(rest[2], rest[1], rest[0]);
    case PointNotation::moving_zyx:
      return about_zyx(rest[0], rest[1], rest[2]);
    case PointNotation::quaternion:
      return Quaterniond(rest[0], rest[1], rest[2], rest[3]).normalized().toRotationMatrix();
    case PointNotation::rotation_vector: {
      const double angle = rest.norm();
      return angle > 0.0 ? AngleAxisd(angle, rest / angle).toRotationMatrix() : Matrix3d::Identity();
    }
    case PointNotation::joints:
      break;
  }
  return Matrix3d::Identity();
}

// Of the vectors of this rotation, which differ by full turns about its axis, the one nearest to `old`.
Vector3d rotation_vector(const Matrix3d& rotation, const Vector3d& old) {
  const AngleAxisd turn(rotation);
  Vector3d nearest = turn.angle() * turn.axis();
  for (const double turns : {-1.0, 1.0}) {
    const Vector3d other = (turn.angle() + 2.0 * std::numbers::pi * turns) * turn.axis();
    nearest = (other - old).norm() < (nearest - old).norm() ? other : nearest;
  }
  return nearest;
}

}  // namespace

Isometry3d pose_of(PointNotation notation, const PointNumbers& numbers) {
  Isometry3d pose = Isometry3d::Identity();
  pose.translation() = numbers.head<3>();
  pose.linear() = rotation_of(notation, numbers);
  return pose;
}

PointNumbers numbers_of(PointNotation notation, const Isometry3d& pose, const PointNumbers& old) {
  constexpr double kLocked = 1e-5;  // half of what 0.001 degrees are
  const auto rest = old.tail(old.size() - 3);
  PointNumbers result(old.size());
  result.head<3>() = pose.translation();
  auto written = result.tail(old.size() - 3);
  switch (notation) {
    case PointNotation::fixed_xyz: {
      const std::array<double, 3> angles = rpy_of(to_kdl(pose).M, {rest[0], rest[1], rest[2]}, kLocked);
      written << angles[0], angles[1], angles[2];
      break;
    }
    case PointNotation::moving_zyx: {
      const std::array<double, 3> angles = rpy_of(to_kdl(pose).M, {rest[2], rest[1], rest[0]}, kLocked);
      written << angles[2], angles[1], angles[0];
      break;
    }
    case PointNotation::quaternion: {
      const Quaterniond q(pose.linear());
      written << q.w(), q.x(), q.y(), q.z();
      written *= rest.norm() * (written.dot(rest) < 0.0 ? -1.0 : 1.0);
      break;
    }
    case PointNotation::rotation_vector:
      written = rotation_vector(pose.linear(), rest);
      break;
    case PointNotation::joints:
      break;
  }
  return result;
}

Isometry3d frame_of_xyzwpr(const Eigen::Matrix<double, 6, 1>& xyzwpr) {
  return pose_of(PointNotation::fixed_xyz, xyzwpr);
}

Eigen::Matrix<double, 6, 1> xyzwpr_of(const Isometry3d& frame, const Eigen::Matrix<double, 6, 1>& old) {
  return numbers_of(PointNotation::fixed_xyz, frame, old);
}

}  // namespace kdl_calibration
