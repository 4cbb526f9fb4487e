#pragma once

// Where the axes of a chain stand, by KDL alone.

#include <Eigen/Dense>
#include <algorithm>
#include <kdl/chain.hpp>
#include <vector>

#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration::testing {

struct AxisLine {
  Eigen::Vector3d point;
  Eigen::Vector3d direction;
};

/// Of each moving joint, in the base frame.
inline std::vector<AxisLine> axis_lines(const KDL::Chain& chain, const Eigen::VectorXd& q) {
  std::vector<AxisLine> lines;
  KDL::Frame before = KDL::Frame::Identity();
  for (const KDL::Segment& segment : chain.segments) {
    double value = 0.0;
    if (segment.getJoint().getType() != KDL::Joint::Fixed) {
      value = q[static_cast<Eigen::Index>(lines.size())];
      lines.push_back({.point = to_eigen(before * segment.getJoint().JointOrigin()),
                       .direction = to_eigen(before.M * segment.getJoint().JointAxis())});
    }
    before = before * segment.pose(value);
  }
  return lines;
}

/// Sine of the angle between them.
inline double tilt(const AxisLine& a, const AxisLine& b) { return a.direction.cross(b.direction).norm(); }

/// [m] largest distance of these lines from the point next to all.
inline double missed_point(const std::vector<AxisLine>& lines) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const AxisLine& line : lines) {
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - line.direction * line.direction.transpose();
    normal += across;
    right += across * line.point;
  }
  const Eigen::Vector3d point = normal.ldlt().solve(right);
  double largest = 0.0;
  for (const AxisLine& line : lines) {
    largest = std::max(largest, line.direction.cross(point - line.point).norm());
  }
  return largest;
}

}  // namespace kdl_calibration::testing
