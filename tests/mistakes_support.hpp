#pragma once

// Simulated measurements of known robots, and the mistakes that people make with theirs.

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "effects/effect_terms.hpp"
#include "kdl_calibration/measurements.hpp"
#include "model/kinematics.hpp"
#include "planning/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing {

/// An arm with the axes of a common light six-axis robot: three parallel ones, and an offset wrist.
inline constexpr const char* kLightArm = R"(<robot name="light">
  <link name="base"/><link name="l1"/><link name="l2"/><link name="l3"/><link name="l4"/><link name="l5"/>
  <link name="l6"/><link name="tool0"/>
  <joint name="shoulder_pan" type="revolute"><parent link="base"/><child link="l1"/>
    <origin xyz="0 0 0.13"/><axis xyz="0 0 1"/><limit lower="-6.28" upper="6.28" velocity="2" effort="1"/></joint>
  <joint name="shoulder_lift" type="revolute"><parent link="l1"/><child link="l2"/>
    <origin xyz="0 0.22 0" rpy="0 1.5707963267948966 0"/><axis xyz="0 1 0"/>
    <limit lower="-6.28" upper="6.28" velocity="2" effort="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="l2"/><child link="l3"/>
    <origin xyz="0 -0.17 0.61"/><axis xyz="0 1 0"/><limit lower="-3.14" upper="3.14" velocity="2" effort="1"/></joint>
  <joint name="wrist_1" type="revolute"><parent link="l3"/><child link="l4"/>
    <origin xyz="0 0 0.57" rpy="0 1.5707963267948966 0"/><axis xyz="0 1 0"/>
    <limit lower="-6.28" upper="6.28" velocity="2" effort="1"/></joint>
  <joint name="wrist_2" type="revolute"><parent link="l4"/><child link="l5"/>
    <origin xyz="0 0.11 0"/><axis xyz="0 0 1"/><limit lower="-6.28" upper="6.28" velocity="2" effort="1"/></joint>
  <joint name="wrist_3" type="revolute"><parent link="l5"/><child link="l6"/>
    <origin xyz="0 0 0.12"/><axis xyz="0 1 0"/><limit lower="-6.28" upper="6.28" velocity="2" effort="1"/></joint>
  <joint name="flange" type="fixed"><parent link="l6"/><child link="tool0"/>
    <origin xyz="0 0.09 0" rpy="-1.5707963267948966 0 0"/></joint>
</robot>)";

/// An arm of six turning joints whose axes are those of a random frame, links 0.1 to 0.7 m long.
inline ErrorModel random_arm(Random& random) {
  Robot robot;
  for (int j = 0; j < 6; ++j) {
    MovingJoint joint;
    joint.name = "joint_" + std::to_string(j + 1);
    joint.axis = KDL::Vector(0.0, 0.0, 1.0);
    const Eigen::Vector3d direction{random.normal(), random.normal(), random.normal()};
    const Eigen::Vector3d along = random.uniform(0.1, 0.7) * direction.normalized();
    // Turned by quarters of a turn as a rule, in between now and then.
    const double quarter = std::numbers::pi / 2.0;
    const bool odd = random.uniform(0.0, 1.0) < 0.2;
    const double roll = odd ? random.uniform(-quarter, quarter) : quarter * std::round(random.uniform(-1.0, 1.0));
    const double pitch = j % 2 == 1 || odd ? random.uniform(-quarter, quarter) : 0.0;
    joint.origin = KDL::Frame(KDL::Rotation::RPY(roll == 0.0 && j % 2 == 0 ? quarter : roll, pitch, 0.0),
                              KDL::Vector(along.x(), along.y(), along.z()));
    joint.lower = -std::numbers::pi;
    joint.upper = std::numbers::pi;
    robot.joints.push_back(joint);
  }
  robot.tip_origin = KDL::Frame(KDL::Vector(0.05, 0.02, 0.15));
  robot.tip_joint = "tip";
  return complete_model(robot);
}

/// How measurements are drawn.
struct Draw {
  int configurations = 30;
  int targets = 3;
  double lever = 0.1;      ///< [m] of the targets from the flange's axis
  double length = 0.001;   ///< [m] 1 sigma of the arm's length errors
  double angle = 0.005;    ///< [rad] 1 sigma of its angle errors
  double noise = 0.00003;  ///< [m]
  double effect = 0.0;     ///< [rad] 1 sigma of the joints' compliance under gravity
  double gain = 0.0;       ///< 1 sigma of the joints' gains
  int repeats = 1;
  bool poses = false;                     ///< whether orientations are measured, too, to a tenth of a milliradian
  std::vector<std::size_t> at_rest = {};  ///< joints that never move
};

/// A robot that was measured: what the files would say.
struct Measured {
  ErrorModel model;
  Estimate truth;
  Unknowns free;
  Measurements data;
};

inline std::vector<TargetFrame> drawn_targets(const Draw& draw, Random& random) {
  std::vector<Eigen::Vector3d> positions;
  for (int k = 0; k < draw.targets; ++k) {
    const double angle = 2.0 * std::numbers::pi * (k + random.uniform(0.0, 0.5)) / draw.targets;
    positions.emplace_back(draw.lever * std::cos(angle), draw.lever * std::sin(angle), random.uniform(0.05, 0.2));
  }
  return targets_at(positions);
}

inline Measured measured(const ErrorModel& model, std::uint64_t seed, const Draw& draw = {}) {
  Random random(seed);
  std::vector<TargetFrame> targets = drawn_targets(draw, random);
  if (draw.poses) {
    targets = as_frames(std::move(targets));
  }
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
  X_WB.linear() = rotation_exp({random.normal(), random.normal(), random.normal()});
  X_WB.translation() = Eigen::Vector3d{random.uniform(1.0, 4.0), random.uniform(-2.0, 2.0), random.uniform(-1.0, 1.0)};
  VirtualExperiment experiment({.model = model,
                                .targets = targets,
                                .sizes = {.length = draw.length, .angle = draw.angle},
                                .X_WB = X_WB,
                                .random = random});
  VirtualRobot& robot = experiment.robot;
  robot.model.effects = load_and_gain_terms(model);
  robot.truth.effects.resize(static_cast<Eigen::Index>(robot.model.effects.size()));
  for (std::size_t d = 0; d < robot.model.effects.size(); ++d) {
    robot.truth.effects[static_cast<Eigen::Index>(d)] =
        experiment.random.normal() * (robot.model.effects[d].group() == EffectGroup::gravity ? draw.effect : draw.gain);
  }
  for (auto& [lower, upper] : experiment.ranges) {
    lower = std::max(lower, -2.5);
    upper = std::min(upper, 2.5);
  }
  for (const std::size_t joint : draw.at_rest) {
    experiment.ranges[joint] = {0.3, 0.3};
  }
  Measurements data = experiment.measure(draw.configurations,
                                         {.sigma = draw.noise, .orientation_sigma = 1e-4, .repeats = draw.repeats});
  return {.model = model, .truth = robot.truth, .free = experiment.free, .data = without_sigmas(std::move(data))};
}

/// What an arm of any kind may leave: errors of 0 to 3 degrees and 3 mm, compliance, gains, 1 to 5 targets, repeats.
inline Measured correct_data(std::uint64_t seed) {
  Random random(seed);
  const ErrorModel model = random_arm(random);
  Draw draw{.configurations = 12 + static_cast<int>(random.uniform(0.0, 40.0)),
            .targets = 1 + static_cast<int>(seed % 5)};
  draw.lever = random.uniform(0.005, 0.2);
  draw.length = random.uniform(0.0, 0.003);
  draw.angle = random.uniform(0.0, 3.0 * kDegree);
  draw.noise = seed % 7 == 0 ? 0.0 : random.uniform(1e-5, 1e-4);
  draw.effect = seed % 3 == 0 ? 0.0 : random.uniform(0.0, 0.002);
  draw.gain = seed % 4 == 0 ? random.uniform(0.0, 0.001) : 0.0;
  draw.repeats = seed % 6 == 0 ? 3 : 1;
  return measured(model, seed, draw);
}

/// X_WF in a configuration as it truly was.
inline Eigen::Isometry3d true_flange(const Measured& m, int configuration) {
  Estimate rigid = m.truth;
  rigid.effects.resize(0);
  return m.truth.frames.base() * flange_poses(m.model, rigid, m.data.joint_values.col(configuration)).front();
}

}  // namespace kdl_calibration::testing
