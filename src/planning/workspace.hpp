#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/robot.hpp"
#include "planning/arm_body.hpp"
#include "planning/simulation.hpp"

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

/// Constraints on the robot's motion. They apply to every target in every configuration.
struct Cell {
  JointRanges ranges;               ///< one per joint
  std::vector<JointSum> sums;       ///< ranges of sums of joints
  Box box;                          ///< must contain the targets
  std::optional<double> height;     ///< [m] least z of the targets
  std::optional<double> radius;     ///< [m] least distance of the targets from the first joint's axis
  std::vector<Sphere> out_spheres;  ///< keep-out zones for targets and body
  std::vector<Box> out_boxes;
  std::vector<Capsule> body;  ///< the arm and the tool
  /// [m] least distance between parts of the body, see pairs_to_keep_apart.
  std::optional<double> clearance;
  /// The body (without the tool, see `facing`) and keep-out zones that do not contain it block its beams.
  std::optional<Tracker> tracker;
  std::vector<Eigen::Vector3d> facing;  ///< one per target, in the flange frame; zero: any direction. May be empty.
};

/// Number of samples that a constraint rejects.
struct Refusals {
  std::string constraint;
  long samples = 0;  ///< rejected by it
  long alone = 0;    ///< rejected by it only
  /// Of a clearance: "base_link and link_3", the two links that are most often the closest in rejected samples.
  std::string links = {};
};

struct CandidateOptions {
  int count = 5000;
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: one per core
  /// Joint values are rounded to multiples of these [rad], [m] if the range allows; 0: not rounded.
  double angle_step = 0.0;
  double length_step = 0.0;
  long most_samples = 0;  ///< give up after this many; 0: 100,000 and 200 per candidate
};

struct Candidates {
  Eigen::MatrixXd joint_values;  ///< joints x count [rad] or [m]
  long samples = 0;              ///< samples drawn
  std::vector<Refusals> refusals;
};

/// Configurations uniform in the ranges that satisfy all constraints. Sample k is drawn from stream k of the seed, so
/// that the answer depends on neither the threads nor the constraints' order.
/// Throws InputError: too few of the samples satisfy the constraints (the message states the rejections per
/// constraint), an empty range, sizes that do not fit the robot.
Candidates candidates(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell,
                      const CandidateOptions& options = {});

/// A joint that the constraints keep from more than half of its range.
struct NarrowedRange {
  std::size_t joint = 0;
  double share = 0.0;                               ///< of the range, in twentieths, that candidates use
  std::vector<std::pair<double, double>> left_out;  ///< [rad] or [m] parts of the range with hardly any candidate
  Refusals cause;                                   ///< the constraint that rejects most samples there
};

/// The narrowed ranges of independent joints. `drawn` has candidates of this cell, which were drawn with `seed`.
std::vector<NarrowedRange> narrowed_ranges(const Robot& robot, const std::vector<TargetFrame>& targets,
                                           const Cell& cell, const Candidates& drawn, std::uint64_t seed);

/// Names of the constraints that joint values `q` violate.
std::vector<std::string> violated(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell,
                                  const Eigen::VectorXd& q);

}  // namespace kdl_calibration
