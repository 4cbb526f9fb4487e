#include "measurements/stated_joints.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "base/csv.hpp"
#include "base/decompositions.hpp"
#include "base/number_range.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Ref;

// The leader of a follower or, if the joint follows a drive outside the chain, that drive.
Drive leader_of(const ExpectedJoints& joints, const MovingJoint& joint) {
  return joint.mimic ? Drive{.name = joints.joints[joint.mimic->leader].name,
                             .multiplier = joint.mimic->multiplier,
                             .offset = joint.mimic->offset}
                     : drive_of(joint);
}

// Throws if a follower's column contradicts its leader's. `read` has one row per follower in the file.
void check_followers(const StatedJoints& stated, const Ref<const MatrixXd>& read, const MatrixXd& joint_values) {
  Index row = 0;
  for (std::size_t i = 0; i < stated.joints.followers.size(); ++i) {
    const Column& column = stated.header.followers[i];
    if (!present(column)) continue;
    const std::size_t follower = stated.joints.followers[i];
    const auto expected = joint_values.row(static_cast<Index>(follower));
    const Drive leader = leader_of(stated.joints, stated.joints.joints[follower]);
    const double tolerance = follower_tolerance(leader.multiplier);
    for (Index c = 0; c < read.cols(); ++c) {
      if (std::abs(read(row, c) - expected[c]) <= tolerance) continue;
      fail(Place{stated.source, stated.line(c)},
           stated.header.names[column.index] + " " + shown(in_unit(read(row, c), column.unit)) +
               " contradicts the URDF, where the joint mimics " + shown(leader.name) + ": expected " +
               in_unit(expected[c], column.unit) + " (" + shortest(leader.multiplier) + " times that of " +
               shown(leader.name) + " plus " + in_unit(leader.offset, column.unit) + ")");
    }
    ++row;
  }
}

}  // namespace

std::vector<Column> joint_columns(const Header& header) {
  std::vector<Column> columns = header.joints;
  std::copy_if(header.followers.begin(), header.followers.end(), std::back_inserter(columns), present);
  return columns;
}

// Column by column, so that a configuration's values do not depend on its position.
void apply_convention(const StatedJoints& stated, Ref<MatrixXd> values) {
  if (stated.joints.convention == nullptr) return;
  const JointConvention& convention = *stated.joints.convention;
  const auto size = static_cast<Index>(stated.header.joints.size());
  for (Index c = 0; c < values.cols(); ++c) {
    auto column = values.col(c).head(size);
    column = (convention.matrix * column + convention.offset).eval();
    if (!(column.cwiseAbs().maxCoeff() <= kLargestNumber)) {
      fail(Place{stated.source, stated.line(c)},
           "joint values out of range behind the joint convention " + convention.name + ": expected at most 1e12");
    }
  }
}

MatrixXd with_followers(const StatedJoints& stated, const Ref<const MatrixXd>& values) {
  if (stated.joints.followers.empty()) return values;
  const auto independent = static_cast<Index>(stated.header.joints.size());
  const std::vector<std::size_t> rows_of = independent_joints(stated.joints.joints);
  MatrixXd leaders = values.topRows(independent);
  for (std::size_t i = 0; i < rows_of.size(); ++i) {
    if (stated.header.own_values[i]) {
      const Drive drive = drive_of(stated.joints.joints[rows_of[i]]);
      auto row = leaders.row(static_cast<Index>(i)).array();
      row = (row - drive.offset) / drive.multiplier;
    }
  }
  MatrixXd all = all_joint_values(stated.joints.joints, leaders);
  check_followers(stated, values.bottomRows(values.rows() - independent), all);
  return all;
}

MatrixXd column_values(const StatedJoints& stated, const MatrixXd& joint_values) {
  const ExpectedJoints& joints = stated.joints;
  MatrixXd values = independent_joint_values(joints.joints, joint_values);
  if (joints.convention != nullptr) {
    values = solution(joints.convention->matrix, values.colwise() - joints.convention->offset);
  }
  const std::vector<std::size_t> rows_of = independent_joints(joints.joints);
  for (std::size_t i = 0; i < rows_of.size(); ++i) {
    if (stated.header.own_values[i])
      values.row(static_cast<Index>(i)) = joint_values.row(static_cast<Index>(rows_of[i]));
  }
  for (std::size_t i = 0; i < joints.followers.size(); ++i) {
    if (!present(stated.header.followers[i])) continue;
    values.conservativeResize(values.rows() + 1, Eigen::NoChange);
    values.bottomRows<1>() = joint_values.row(static_cast<Index>(joints.followers[i]));
  }
  return values;
}

}  // namespace kdl_calibration
