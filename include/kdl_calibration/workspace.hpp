#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/arm_body.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/simulation.hpp"

namespace kdl_calibration {

/// A weighted sum of joint values between two bounds [rad] or [m].
struct JointSum {
  std::string name;         ///< for messages
  Eigen::VectorXd weights;  ///< one per joint
  double offset = 0.0;
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
};

/// A tracker that must see every target.
struct Tracker {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< [m] in the base frame
  double least_distance = 0.0;                         ///< [m]
  double greatest_distance = std::numeric_limits<double>::infinity();
  /// [rad] largest angle between a reflector's facing direction and the beam.
  double acceptance = std::numbers::pi;
};

/// What a person can state about where the robot may go. All of it holds at every target in every configuration.
struct Cell {
  JointRanges ranges;               ///< of each joint
  std::vector<JointSum> sums;       ///< ranges of sums of joints
  Box box;                          ///< that holds the targets
  std::optional<double> height;     ///< [m] least z of the targets
  std::optional<double> radius;     ///< [m] least distance of the targets from the first joint's axis
  std::vector<Sphere> out_spheres;  ///< that neither a target nor the body may touch
  std::vector<Box> out_boxes;
  std::vector<Capsule> body;  ///< the arm and the tool
  /// [m] least distance between parts of the body, see pairs_to_keep_apart.
  std::optional<double> clearance;
  /// Its beams are stopped by the body (the tool excepted, see `facing`) and by the keep-out zones that it does not
  /// stand in.
  std::optional<Tracker> tracker;
  std::vector<Eigen::Vector3d> facing;  ///< one per target, in the flange frame; zero: any direction. May be empty.
};

/// How many samples a constraint refuses.
struct Refusals {
  std::string constraint;
  long samples = 0;  ///< refused by it
  long alone = 0;    ///< refused by it and by nothing else
};

struct CandidateOptions {
  int count = 5000;
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: one per core
  /// Joint values are whole multiples of these [rad], [m], as far as the range allows; 0: any number.
  double angle_step = 0.0;
  double length_step = 0.0;
  long most_samples = 0;  ///< give up after this many; 0: 100,000 and 200 per candidate
};

struct Candidates {
  Eigen::MatrixXd joint_values;  ///< joints x count [rad] or [m]
  long samples = 0;              ///< drawn for them
  std::vector<Refusals> refusals;
};

/// Configurations uniform in the ranges that satisfy all constraints. Sample k is drawn from stream k of the seed, so
/// that the answer depends on neither the threads nor the constraints' order.
/// Throws InputError: too few of the samples satisfy the constraints (the message says how many each one refuses), a
/// range that is empty, sizes that do not fit the robot.
Candidates candidates(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell,
                      const CandidateOptions& options = {});

/// Names of the constraints that joint values `q` violate.
std::vector<std::string> violated(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell,
                                  const Eigen::VectorXd& q);

}  // namespace kdl_calibration
