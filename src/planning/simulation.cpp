#include "planning/simulation.hpp"

#include <algorithm>
#include <set>

#include "base/preconditions.hpp"
#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/input_check.hpp"
#include "measurements/drive_signals.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"

namespace kdl_calibration {

std::vector<TargetFrame> published_targets(int count) {
  const double diagonal = 0.0707;
  const std::vector<Eigen::Vector3d> points = {{0.1, 0.0, 0.0}, {0.0, 0.0, 0.1}, {diagonal, 0.0, diagonal}};
  std::vector<TargetFrame> targets = generic_targets(count);
  for (std::size_t k = 0; k < targets.size(); ++k) {
    if (k < points.size()) {
      targets[k].X_FT.translation() = points[k];
    } else {
      targets[k].X_FT.translation() *= 0.1 / targets[k].X_FT.translation().norm();
    }
  }
  return targets;
}

std::vector<std::size_t> with_true_errors(const ErrorModel& model, const Reduction& reduction, bool complete) {
  std::set<std::string> names(reduction.kept.begin(), reduction.kept.end());
  for (const GaugeParameter& gauge : reduction.gauge) {
    names.insert(gauge.name);
  }
  std::vector<std::size_t> result;
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const ErrorParameter& parameter = model.parameters[p];
    const bool of_base_link = parameter.kind != ParameterKind::joint_offset && parameter.frame == 0;
    if (complete ? !of_base_link : names.count(parameter.name) > 0) {
      result.push_back(p);
    }
  }
  return result;
}

VirtualRobot virtual_robot(const ErrorModel& model, const std::vector<std::size_t>& with_errors,
                           const std::vector<TargetFrame>& targets, const ErrorSizes& sizes, Random& random) {
  for (const double sigma : {sizes.length, sizes.angle, sizes.base_position, sizes.target_length}) {
    require_sigma("the size of true errors", sigma);
  }
  VirtualRobot robot{.model = model, .truth = {}};
  robot.truth.errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  for (const std::size_t p : with_errors) {
    const double sigma = is_length(model, model.parameters[p]) ? sizes.length : sizes.angle;
    robot.truth.errors[static_cast<Eigen::Index>(p)] = sigma * random.normal();
  }
  for (int axis = 0; axis < 3; ++axis) {
    robot.truth.frames.base().translation()[axis] += sizes.base_position * random.normal();
  }
  robot.truth.frames.targets = targets;
  for (TargetFrame& target : robot.truth.frames.targets) {
    const double length = target.X_FT.translation().norm();
    const double error = sizes.target_length * random.normal();
    if (length > 0.0) {
      target.X_FT.translation() *= (length + error) / length;
    }
  }
  return robot;
}

VirtualRobot placed(VirtualRobot robot, const Eigen::Isometry3d& X_WB) {
  robot.truth.frames.base() = robot.truth.frames.base() * X_WB;
  return robot;
}

VirtualRobot robot_at_stations(VirtualRobot robot, int stations, Random& random) {
  constexpr double kDistance = 2.0;  // [m] 1 sigma of a coordinate
  require_at_least("stations", stations, 2);
  robot.model.stations = {"S1"};
  robot.model.has_undetermined_bases = true;
  robot.truth.frames.bases.resize(1);
  for (int station = 2; station <= stations; ++station) {
    robot.model.stations.push_back("S" + std::to_string(station));
    Eigen::Isometry3d& X_WB = robot.truth.frames.bases.emplace_back(Eigen::Isometry3d::Identity());
    Eigen::Vector3d turn;
    for (int axis = 0; axis < 3; ++axis) {
      X_WB.translation()[axis] = kDistance * random.normal();
      turn[axis] = random.normal();
    }
    X_WB.linear() = rotation_exp(turn);
  }
  return robot;
}

void add_effects(VirtualRobot& robot, const std::vector<EffectGroup>& groups, const DrivenConfigurations& driven,
                 double sigma, Random& random) {
  require_sigma("the size of true effects", sigma);
  std::vector<double> coefficients(robot.truth.effects.begin(), robot.truth.effects.end());
  for (const EffectGroup group : groups) {
    for (EffectTerm& term : effect_terms(robot.model, group, driven.joint_values, driven.signals)) {
      term.sigma = sigma;
      robot.model.effects.push_back(std::move(term));
      coefficients.push_back(sigma * random.normal());
    }
  }
  robot.truth.effects =
      Eigen::Map<const Eigen::VectorXd>(coefficients.data(), static_cast<Eigen::Index>(coefficients.size()));
}

namespace {

Eigen::MatrixXd virtual_torques(const ErrorModel& model, const Eigen::MatrixXd& joint_values, Random& random) {
  constexpr double kMass = 10.0;     // [kg]
  constexpr double kGravity = 9.81;  // [m/s^2]
  constexpr double kShare = 0.1;
  constexpr double kLeast = 1.0;  // [Nm or N]
  Eigen::MatrixXd torques = kMass * kGravity * gravity_torques(model, joint_values);
  for (Eigen::Index j = 0; j < torques.rows(); ++j) {
    const double scatter = std::max(kShare * torques.row(j).cwiseAbs().mean(), kLeast);
    for (Eigen::Index c = 0; c < torques.cols(); ++c) {
      torques(j, c) += scatter * random.normal();
    }
  }
  return torques;
}

}  // namespace

DrivenConfigurations simulated_signals(const ErrorModel& model, const Eigen::MatrixXd& stops,
                                       const Eigen::MatrixXd& before, const SimulatedSignals& wanted) {
  constexpr std::uint64_t kStream = 2;
  DrivenConfigurations result{.joint_values = stops, .signals = {}};
  if (wanted.approach) {
    Eigen::MatrixXd all(stops.rows(), before.cols() + stops.cols());
    if (before.size() > 0) {
      all.leftCols(before.cols()) = before;
    }
    all.rightCols(stops.cols()) = stops;
    result.signals.approach = directions_of_motion(all).rightCols(stops.cols());
  }
  if (wanted.torques) {
    Random random(wanted.seed + static_cast<std::uint64_t>(before.cols()), kStream);
    result.signals.torques = virtual_torques(model, stops, random);
  }
  if (wanted.circumstances) {
    constexpr std::uint64_t kOther = 3;
    Random random(wanted.seed + static_cast<std::uint64_t>(before.cols()), kOther);
    result.signals.circumstances.resize(kCircumstances, stops.cols());
    for (Eigen::Index c = 0; c < stops.cols(); ++c) {
      const double share = static_cast<double>(c) / static_cast<double>(std::max<Eigen::Index>(stops.cols() - 1, 1));
      const double step = std::min(std::floor(random.uniform(0.0, 3.0)), 2.0);
      result.signals.circumstances.col(c) << 20.0 + 12.0 * share + 0.3 * random.normal(), 5.0 * step;
    }
  }
  return result;
}

Eigen::Vector3d normal_vector(Random& random) {
  Eigen::Vector3d v;
  for (int axis = 0; axis < 3; ++axis) {
    v[axis] = random.normal();
  }
  return v;
}

namespace {

// Noise of a point at `position` in W, from three standard normal numbers.
Eigen::Vector3d point_noise(const MeasuringNoise& noise, const Eigen::Vector3d& position,
                            const Eigen::Vector3d& normal) {
  if (!noise.tracker) {
    return noise.sigma * normal;
  }
  const double distance = position.norm();
  const Eigen::Vector3d line = position / distance;
  const Eigen::Vector3d along = normal.dot(line) * line;
  return (noise.tracker->range + noise.tracker->range_per_metre * distance) * along +
         (noise.tracker->transverse + noise.tracker->transverse_per_metre * distance) * (normal - along);
}

// The reading of a target at X_WT, a pose or a point. `common` is the noise of its repeat [m].
Reading noisy_reading(const Eigen::Isometry3d& X_WT, const Eigen::Vector3d& common, const MeasuringNoise& noise,
                      bool is_pose, Random& random) {
  const Eigen::Vector3d own = point_noise(noise, X_WT.translation(), normal_vector(random));
  const Eigen::Vector3d position = X_WT.translation() + common + own;
  if (!is_pose) {
    return Point{position};
  }
  const Eigen::Vector3d turn = noise.orientation_sigma * normal_vector(random);
  return Pose{position, Eigen::Quaterniond(Eigen::Matrix3d(X_WT.linear() * rotation_exp(turn)))};
}

}  // namespace

Measurements measure(const VirtualRobot& robot, const Eigen::MatrixXd& joint_values, const MeasuringNoise& noise,
                     Random& random, Split split) {
  return measure(robot, DrivenConfigurations{.joint_values = joint_values, .signals = {}}, noise, random, split);
}

Measurements measure(const VirtualRobot& robot, const DrivenConfigurations& driven, const MeasuringNoise& noise,
                     Random& random, Split split) {
  const Eigen::MatrixXd& joint_values = driven.joint_values;
  check(robot.truth, robot.model, robot.truth.frames.targets.size());
  check({.independent = Eigen::Vector3d::Constant(noise.sigma),
         .tracker = noise.tracker,
         .common = noise.common,
         .orientation = noise.orientation_sigma});
  Measurements result;
  result.source = "simulation";
  for (const MovingJoint& joint : robot.model.joints) {
    result.joints.push_back(joint.name);
    result.joint_units.push_back(joint.type == JointType::prismatic ? JointUnit::metre : JointUnit::radian);
  }
  result.joint_values = joint_values;
  result.signals = driven.signals;
  result.stations = robot.model.stations;
  const auto stations = static_cast<Eigen::Index>(robot.truth.frames.bases.size());
  bool poses = false;
  for (const TargetFrame& target : robot.truth.frames.targets) {
    result.targets.push_back(target.name);
    poses = poses || target.with_orientation;
  }
  const FoldedChain chain = folded(robot.model, robot.truth.errors);
  result.configurations.reserve(static_cast<std::size_t>(joint_values.cols()));
  result.observations.reserve(static_cast<std::size_t>(joint_values.cols() * std::max(noise.repeats, 0)) *
                              result.targets.size());
  for (Eigen::Index c = 0; c < joint_values.cols(); ++c) {
    result.configurations.push_back(std::to_string(c + 1));
    const auto station = static_cast<std::size_t>(
        driven.stations.empty() ? c * stations / joint_values.cols() : driven.stations[static_cast<std::size_t>(c)]);
    const Eigen::Isometry3d X_WF =
        robot.truth.frames.base(station) *
        flange_pose(chain, effective_joint_values(robot.model, robot.truth.effects, joint_values.col(c),
                                                  column(driven.signals, c))
                               .col(0));
    for (int repeat = 1; repeat <= noise.repeats; ++repeat) {
      const Eigen::Vector3d drift = noise.common.isZero(0.0)
                                        ? Eigen::Vector3d(Eigen::Vector3d::Zero())
                                        : Eigen::Vector3d(noise.common.cwiseProduct(normal_vector(random)));
      for (std::size_t k = 0; k < robot.truth.frames.targets.size(); ++k) {
        const TargetFrame& target = robot.truth.frames.targets[k];
        result.observations.push_back({.reading = noisy_reading(X_WF * target.X_FT, drift, noise, poses, random),
                                       .sigma = noise.tracker ? 0.0 : noise.sigma,
                                       .configuration = static_cast<std::int32_t>(c),
                                       .target = static_cast<std::int32_t>(k),
                                       .repeat = repeat,
                                       .split = split,
                                       .station = static_cast<std::int16_t>(station)});
      }
    }
  }
  return result;
}

}  // namespace kdl_calibration
