#include "interface/compensated_line.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "base/degree.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Isometry3d;

Isometry3d between(const Isometry3d& from, const Isometry3d& to, double share) {
  Isometry3d X = Isometry3d::Identity();
  X.translation() = (1.0 - share) * from.translation() + share * to.translation();
  X.linear() =
      Eigen::Quaterniond(from.linear()).slerp(share, Eigen::Quaterniond(to.linear())).normalized().toRotationMatrix();
  return X;
}

double angle_between(const Isometry3d& a, const Isometry3d& b) {
  return Eigen::Quaterniond(a.linear()).angularDistance(Eigen::Quaterniond(b.linear()));
}

int pieces_of(const Isometry3d& from, const Isometry3d& to) {
  constexpr double kLength = 0.02;  // [m]
  constexpr double kAngle = 2.0 * kDegree;
  constexpr double kMost = 101.0;
  const double pieces =
      std::max((to.translation() - from.translation()).norm() / kLength, angle_between(from, to) / kAngle);
  return static_cast<int>(std::clamp(std::ceil(pieces), 2.0, kMost));
}

double distance_from_line(const Eigen::Vector3d& point, const Isometry3d& from, const Isometry3d& to) {
  const Eigen::Vector3d way = to.translation() - from.translation();
  const Eigen::Vector3d offset = point - from.translation();
  const double share = way.squaredNorm() > 0.0 ? std::clamp(offset.dot(way) / way.squaredNorm(), 0.0, 1.0) : 0.0;
  return (offset - share * way).norm();
}

}  // namespace

LineDeviation line_deviation(const Compensator& compensator, const Isometry3d& X_FT, const LineEnd& from,
                             const LineEnd& to) {
  const Isometry3d begin = compensator.nominal_pose(from.joint_values) * X_FT;
  const Isometry3d end = compensator.nominal_pose(to.joint_values) * X_FT;
  const Isometry3d X_TF = X_FT.inverse();
  const int pieces = pieces_of(begin, end);
  CompensatedJoints q = from.joint_values;
  LineDeviation largest;
  for (int i = 1; i < pieces; ++i) {
    const double share = static_cast<double>(i) / pieces;
    const CompensatedJoints seed = q + (to.joint_values - q) / (pieces - i + 1);  // external axes move evenly
    const std::optional<CompensatedJoints> set =
        compensator.nominal_joint_values(between(begin, end, share) * X_TF, seed);
    if (!set) {
      constexpr double kInfinite = std::numeric_limits<double>::infinity();
      return {.position = kInfinite, .orientation = kInfinite};
    }
    q = *set;
    const Isometry3d tool = compensator.calibrated_pose(q) * X_FT;
    largest.include({.position = distance_from_line(tool.translation(), from.X_BT, to.X_BT),
                     .orientation = angle_between(tool, between(from.X_BT, to.X_BT, share))});
  }
  return largest;
}

}  // namespace kdl_calibration
