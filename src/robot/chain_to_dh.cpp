#include "robot/chain_to_dh.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/jntarray.hpp>
#include <numbers>

#include "base/random.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration {
namespace {

// Rounding of lengths [m] and angles [rad], so that a zero is printed as one.
constexpr double kNothing = 1e-15;

/// A joint's axis at zero joint values, or the z axis of the tip.
struct AxisLine {
  KDL::Vector point;
  KDL::Vector direction;
  bool slides = false;  ///< only its direction counts
  bool is_tip = false;
};

std::vector<AxisLine> axis_lines(const Robot& robot) {
  std::vector<AxisLine> lines;
  KDL::Frame pose;
  for (const MovingJoint& joint : robot.joints) {
    pose = pose * joint.origin;
    lines.push_back({.point = pose.p, .direction = pose.M * joint.axis, .slides = joint.type == JointType::prismatic});
  }
  pose = pose * robot.tip_origin;
  lines.push_back({.point = pose.p, .direction = pose.M.UnitZ(), .is_tip = true});
  return lines;
}

double rounded_angle(double angle) {
  const double quarter = std::round(angle / (0.5 * std::numbers::pi)) * 0.5 * std::numbers::pi;
  return std::abs(angle - quarter) < kNothing ? quarter : angle;
}

double rounded_length(double length) { return std::abs(length) < kNothing ? 0.0 : length; }

/// The angle or its opposite, whichever points towards x.
double towards_x(double angle) {
  constexpr double kTie = 1e-9;
  return std::cos(angle) < -kTie ? angle - std::copysign(std::numbers::pi, angle) : angle;
}

/// theta and d along the z axis of frame X_BC, then a, alpha and beta across to the line, which becomes the next z.
DhRow step_to(const AxisLine& line, const KDL::Frame& X_BC) {
  constexpr double kNearlyParallel = 0.1;  // sine of the angle
  KDL::Vector u = X_BC.M.Inverse(line.direction);
  KDL::Vector p = line.slides ? KDL::Vector::Zero() : X_BC.Inverse(line.point);
  const double across = std::hypot(u.x(), u.y());
  DhRow step;
  if (across < kNearlyParallel) {  // Hayati: where the line meets the plane through this origin; the tip's own origin
    step.d = line.is_tip ? rounded_length(p.z()) : 0.0;
    p = p - ((p.z() - step.d) / u.z()) * u;
    const bool apart = std::hypot(p.x(), p.y()) > 10.0 * kNothing;
    step.theta = apart ? towards_x(std::atan2(p.y(), p.x())) : 0.0;
  } else {  // along the common normal
    step.theta = towards_x(std::atan2(u.x(), -u.y()));
    p = p - ((p.x() * u.x() + p.y() * u.y()) / (across * across)) * u;
    step.d = rounded_length(p.z());
  }
  step.theta = rounded_angle(step.theta);
  const KDL::Rotation turn = KDL::Rotation::RotZ(-step.theta);
  p = turn * p;
  u = turn * u;
  step.a = rounded_length(p.x());
  step.alpha = rounded_angle(std::atan2(-u.y(), u.z()));
  step.beta = across < kNearlyParallel ? rounded_angle(std::atan2(u.x(), std::hypot(u.y(), u.z()))) : 0.0;
  return step;
}

}  // namespace

DhTable dh_table_of(const Robot& robot, DhConvention convention) {
  for (const MovingJoint& joint : robot.joints) {
    if (joint.mimic || joint.drive) {
      throw InputError(robot.source + ": joint " + in_quotes(joint.name) +
                       " mimics another one, which a DH table cannot state: expected another format");
    }
  }
  const bool standard = convention == DhConvention::standard;
  DhTable table{.convention = convention, .base = {}, .rows = {}, .tip = {}};
  const std::vector<AxisLine> lines = axis_lines(robot);
  // Each step starts from the product of the rounded steps before it, so that rounding does not add up.
  KDL::Frame X_BC;
  DhRow before;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const DhRow step = step_to(lines[i], X_BC);
    if (i == 0) {
      table.base = standard ? dh_along(step) * dh_across(step) : dh_along(step);
    } else {
      const MovingJoint& joint = robot.joints[i - 1];
      const DhRow& link = standard ? step : before;
      table.rows.push_back({.joint = joint.name,
                            .type = joint.type == JointType::prismatic ? JointType::prismatic : JointType::revolute,
                            .a = link.a,
                            .alpha = link.alpha,
                            .beta = link.beta,
                            .d = step.d,
                            .theta = step.theta,
                            .lower = joint.upper ? joint.lower : std::nullopt,
                            .upper = joint.lower ? joint.upper : std::nullopt});
    }
    X_BC = X_BC * dh_along(step) * dh_across(step);
    before = step;
  }
  KDL::Frame X_BF;
  for (const MovingJoint& joint : robot.joints) {
    X_BF = X_BF * joint.origin;
  }
  const KDL::Frame rest = X_BC.Inverse() * (X_BF * robot.tip_origin);
  table.tip = standard ? rest : dh_across(before) * rest;
  return table;
}

PoseDifference largest_difference(const Robot& a, const Robot& b) {
  KDL::ChainFkSolverPos_recursive solver(b.chain);
  return largest_difference(a, [&](const KDL::JntArray& joints) {
    KDL::Frame pose;
    solver.JntToCart(joints, pose);
    return pose;
  });
}

PoseDifference largest_difference(const Robot& robot, const std::function<KDL::Frame(const KDL::JntArray&)>& other) {
  Random random(1);
  const Eigen::MatrixXd q = random_configurations(robot.joints, limits_of(robot.joints), 1000, random);
  KDL::ChainFkSolverPos_recursive solver(robot.chain);
  PoseDifference largest;
  KDL::JntArray joints(static_cast<unsigned>(q.rows()));
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    joints.data = q.col(c);
    KDL::Frame pose_a;
    solver.JntToCart(joints, pose_a);
    const KDL::Frame pose_b = other(joints);
    largest.position = std::max(largest.position, (pose_a.p - pose_b.p).Norm());
    // KDL's own angle of a rotation takes angles below 1e-6 for zero.
    const KDL::Rotation turn = pose_a.M.Inverse() * pose_b.M;
    const KDL::Vector axis(turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1));
    const double angle = std::atan2(axis.Norm(), turn(0, 0) + turn(1, 1) + turn(2, 2) - 1.0);
    largest.rotation = std::max(largest.rotation, angle);
  }
  return largest;
}

}  // namespace kdl_calibration
