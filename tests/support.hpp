#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <map>
#include <numbers>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration::testing {

inline Robot fanuc() { return load_robot(std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf"); }

/// A revolute joint with a rotated frame and a skewed axis, a prismatic joint, a fixed joint in between, a parallel
/// pair and a rotated tip: what a general chain may hold.
inline constexpr const char* kOddArm = R"(<robot name="odd">
  <link name="world"/><link name="a"/><link name="b"/><link name="bracket"/><link name="c"/><link name="d"/>
  <link name="e"/><link name="tool"/>
  <joint name="turn" type="revolute"><parent link="world"/><child link="a"/>
    <origin xyz="0.1 -0.2 0.4" rpy="0.3 -0.2 0.5"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/>
    <origin xyz="0.2 0 0.3" rpy="0 1.2 0"/><axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.5" velocity="1" effort="1"/></joint>
  <joint name="plate" type="fixed"><parent link="b"/><child link="bracket"/>
    <origin xyz="0.05 0.1 0" rpy="0.7 0 0"/></joint>
  <joint name="skew" type="continuous"><parent link="bracket"/><child link="c"/>
    <origin xyz="0 0.6 0.1" rpy="0 0 0.4"/><axis xyz="1 2 -0.5"/></joint>
  <joint name="elbow" type="revolute"><parent link="c"/><child link="d"/>
    <origin xyz="0.5 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="wrist" type="revolute"><parent link="d"/><child link="e"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 -1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="mount" type="fixed"><parent link="e"/><child link="tool"/>
    <origin xyz="0.1 0 0.05" rpy="1.5707963267948966 0 0"/></joint>
</robot>)";

/// Targets A, B, ... at these places in the flange frame [m].
inline std::vector<TargetFrame> targets_at(const std::vector<Eigen::Vector3d>& positions) {
  std::vector<TargetFrame> targets(positions.size());
  for (std::size_t t = 0; t < targets.size(); ++t) {
    targets[t].name = std::string(1, static_cast<char>('A' + t));
    targets[t].X_FT.translation() = positions[t];
  }
  return targets;
}

constexpr double kDegree = std::numbers::pi / 180.0;

/// Three of them, 120 degrees apart on a circle of radius 0.1 m about the flange axis, 0.2 m beyond the flange.
inline std::vector<TargetFrame> circle_of_targets() {
  std::vector<Eigen::Vector3d> positions;
  for (const double angle : {0.0, 120.0 * kDegree, 240.0 * kDegree}) {
    positions.emplace_back(0.1 * std::cos(angle), 0.2, 0.1 * std::sin(angle));
  }
  return targets_at(positions);
}

/// Errors for every parameter of the model: lengths and angles normal with these sigmas [m], [rad].
inline Eigen::VectorXd random_errors(const ErrorModel& model, Random& random, double length, double angle) {
  Eigen::VectorXd errors(static_cast<Eigen::Index>(model.parameters.size()));
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    errors[static_cast<Eigen::Index>(p)] = random.normal() * (is_length(model, model.parameters[p]) ? length : angle);
  }
  return errors;
}

/// No errors but those of these names [m], [rad].
inline Eigen::VectorXd errors_of(const ErrorModel& model, const std::map<std::string, double>& named = {}) {
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  for (const auto& [name, error] : named) {
    errors[static_cast<Eigen::Index>(parameter_index(model, name))] = error;
  }
  return errors;
}

inline Eigen::VectorXd random_joints(const ErrorModel& model, Random& random) {
  Eigen::VectorXd q(static_cast<Eigen::Index>(model.joints.size()));
  for (std::size_t i = 0; i < model.joints.size(); ++i) {
    const double range = model.joints[i].type == JointType::prismatic ? 1.0 : std::numbers::pi;
    q[static_cast<Eigen::Index>(i)] = random.uniform(-range, range);
  }
  return q;
}

/// Of independent standard normal numbers, column by column.
inline Eigen::MatrixXd random_matrix(Eigen::Index rows, Eigen::Index columns, Random& random) {
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return random.normal(); });
}

/// The names of parameters, effects or other things that have one.
template <class Named>
std::vector<std::string> names_of(const std::vector<Named>& all) {
  std::vector<std::string> names;
  for (const Named& one : all) {
    names.push_back(one.name);
  }
  return names;
}

/// The derivative of a vector f(step) at no step, by central differences: one column for each of the step's
/// coordinates.
template <class Function>
Eigen::MatrixXd central_differences(Eigen::Index coordinates, double size, const Function& f) {
  Eigen::MatrixXd J;
  for (Eigen::Index c = 0; c < coordinates; ++c) {
    const Eigen::VectorXd step = size * Eigen::VectorXd::Unit(coordinates, c);
    const Eigen::VectorXd above = f(step);
    const Eigen::VectorXd below = f(Eigen::VectorXd(-step));
    J.conservativeResize(above.size(), coordinates);
    J.col(c) = (above - below) / (2.0 * size);
  }
  return J;
}

/// Makes the row a pose, or a point without orientation.
inline void set_orientation(Observation& row, const Orientation& orientation) {
  row.reading = Pose{.position = row.position(), .orientation = orientation};
}
inline void remove_orientation(Observation& row) { row.reading = Point{row.position()}; }

/// Makes every row a pose with this orientation.
inline void set_orientations(Measurements& measurements, const Orientation& orientation) {
  for (Observation& row : measurements.observations) {
    set_orientation(row, orientation);
  }
}

/// The orientation of a row that must have one, and the length of one that must be a distance [m].
inline Eigen::Quaterniond orientation_of(const Observation& row) { return std::get<Pose>(row.reading).orientation; }
inline double length_of(const Observation& row) { return std::get<Distance>(row.reading).length; }

/// The coordinate along the unit vector n of a row that measured a whole point.
inline void keep_coordinate_along(Observation& row, const Eigen::Vector3d& n) {
  row.reading = Coordinates{.position = n * n.dot(row.position()), .normal = n, .count = 1};
}

/// The row of a tracker that lost the coordinate along this axis: 0 for x, 1 for y, 2 for z.
inline void lose_coordinate(Observation& row, Eigen::Index axis) {
  Eigen::Vector3d position = row.position();
  position[axis] = 0.0;
  row.reading = Coordinates{.position = position, .normal = Eigen::Vector3d::Unit(axis), .count = 2};
}

/// The distance of the row's point from the anchor [m], with an error.
inline void keep_distance(Observation& row, const Eigen::Vector3d& anchor, double error = 0.0) {
  row.reading = Distance{.length = (row.position() - anchor).norm() + error, .anchor = anchor};
}

/// Multiplies all lengths of the row by the factor.
inline void scale_lengths(Observation& row, double factor) {
  row.position() *= factor;
  if (auto* const distance = std::get_if<Distance>(&row.reading)) {
    distance->length *= factor;
  }
}

/// The places in the order of driving, of the rows that have one.
inline std::vector<std::int64_t> order_of(const Measurements& measurements) {
  std::vector<std::int64_t> order;
  for (const Observation& row : measurements.observations) {
    if (row.order) {
      order.push_back(*row.order);
    }
  }
  return order;
}

/// A row of each kind, with other values in each field: two at the right station, the others at the left one.
inline Measurements one_of_each() {
  const Eigen::Vector3d n = Eigen::Vector3d(2, -3, 6) / 7.0;
  Measurements m;
  m.source = "m.csv";
  m.joints = {"q1"};
  m.joint_values = Eigen::RowVector3d(0.3, -0.7, 1.1);
  m.configurations = {"p", "q", "r"};
  m.targets = {"A", "B", "C", "D"};
  m.stations = {"left", "right"};
  m.observations = {
      {.reading = Pose{.position = {1, 2, 3}, .orientation = Orientation(0.5, -0.5, 0.1, 0.7).normalized()},
       .sigma = 1e-5,
       .order = 70,
       .configuration = 0,
       .target = 1,
       .repeat = 4,
       .split = Split::test,
       .station = 1},
      {.reading = Point{{4, 5, 6}},
       .sigma = 2e-5,
       .order = -3,
       .configuration = 0,
       .target = 3,
       .repeat = 6,
       .split = Split::test,
       .station = 1},
      {.reading = Coordinates{.position = -0.5 * n, .normal = n, .count = 1},
       .sigma = 3e-5,
       .order = 12,
       .configuration = 1,
       .target = 0,
       .repeat = 2},
      {.reading = Coordinates{.position = {7, 0, 9}, .normal = Eigen::Vector3d::UnitY(), .count = 2},
       .sigma = 4e-5,
       .order = 5,
       .configuration = 1,
       .target = 2,
       .repeat = 3},
      {.reading = Distance{.length = 1.5, .anchor = {0.1, 0.2, 0.3}},
       .sigma = 5e-5,
       .order = 90,
       .configuration = 2,
       .target = 1,
       .repeat = 9}};
  return m;
}

/// KDL's own answer.
inline KDL::Frame kdl_pose(const KDL::Chain& chain, const Eigen::VectorXd& q) {
  KDL::JntArray joints(static_cast<unsigned>(q.size()));
  joints.data = q;
  KDL::Frame pose;
  KDL::ChainFkSolverPos_recursive(chain).JntToCart(joints, pose);
  return pose;
}

/// The robot's chain with other origins of its joints, by the segment that has one: origin and motion apart.
template <class Origin>
KDL::Chain chain_with(const Robot& robot, const Origin& origin_of) {
  KDL::Chain chain;
  std::size_t moving = 0;
  for (const KDL::Segment& segment : robot.chain.segments) {
    chain.addSegment(KDL::Segment(KDL::Joint(KDL::Joint::Fixed), origin_of(segment)));
    if (segment.getJoint().getType() != KDL::Joint::Fixed) {
      const MovingJoint& joint = robot.joints[moving++];
      const auto type = joint.type == JointType::prismatic ? KDL::Joint::TransAxis : KDL::Joint::RotAxis;
      chain.addSegment(KDL::Segment(KDL::Joint(KDL::Vector::Zero(), joint.axis, type), KDL::Frame::Identity()));
    }
  }
  return chain;
}

/// Largest difference of two poses over the coordinates of position and the elements of the rotation matrix.
inline double difference(const KDL::Frame& a, const KDL::Frame& b) {
  double largest = 0.0;
  for (int i = 0; i < 3; ++i) {
    largest = std::max(largest, std::abs(a.p[i] - b.p[i]));
    for (int j = 0; j < 3; ++j) {
      largest = std::max(largest, std::abs(a.M(i, j) - b.M(i, j)));
    }
  }
  return largest;
}

}  // namespace kdl_calibration::testing
