#include "interface/compensated_line.hpp"

#include <algorithm>
#include <limits>

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

}  // namespace

// At a point between, the distance of the commanded line from the command that would reach the asked line. It differs
// from that of the tool by a relative error as small as the errors of the arm.
double line_deviation(const Compensator& compensator, const Isometry3d& X_FT, const LineEnd& from, const LineEnd& to) {
  constexpr int kPieces = 8;
  const auto commanded = [&](const CompensatedJoints& q) -> Isometry3d { return compensator.nominal_pose(q) * X_FT; };
  const Isometry3d begin = commanded(from.joint_values);
  const Isometry3d end = commanded(to.joint_values);
  const Isometry3d X_TF = X_FT.inverse();
  double largest = 0.0;
  for (int i = 1; i < kPieces; ++i) {
    const double share = static_cast<double>(i) / kPieces;
    const CompensatedJoints seed = (1.0 - share) * from.joint_values + share * to.joint_values;
    const CompensatedPoint point = compensator.solve(between(from.X_BT, to.X_BT, share) * X_TF, seed);
    if (point.status != CompensationStatus::exact && point.status != CompensationStatus::position_only) {
      return std::numeric_limits<double>::infinity();
    }
    const Eigen::Vector3d offset =
        commanded(point.joint_values).translation() - between(begin, end, share).translation();
    largest = std::max(largest, offset.norm());
  }
  return largest;
}

}  // namespace kdl_calibration
