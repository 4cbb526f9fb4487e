#include "planning/workspace.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>

#include "base/number_text.hpp"
#include "base/parallel.hpp"
#include "base/preconditions.hpp"
#include "base/random.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/joint_ranges.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr std::size_t kSampleBlock = 4096;  // samples per block, after which the passed ones are counted
constexpr std::size_t kMostConstraints = 64;

std::string whole_micrometres(double metres) { return shortest(std::round(metres * 1e6) / 1e3) + " mm"; }
std::string degrees(double radians) {
  return shortest(std::round(radians * 180.0 / std::numbers::pi * 1e6) / 1e6) + " deg";
}

// Positions at one sample, in the base frame.
struct Posture {
  const VectorXd& q;
  std::vector<Isometry3d> frames;
  std::vector<Vector3d> targets;
  std::vector<std::pair<Vector3d, Vector3d>> body;  // ends of the capsules
};

struct Constraint {
  std::string name;
  std::function<bool(const Posture&)> holds;
};

bool contains(const Box& box, const Vector3d& p) {
  return (p.array() >= box.lower.array()).all() && (p.array() <= box.upper.array()).all();
}

// The constraints of a cell, prepared for many samples.
class Constraints {
public:
  Constraints(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell)
      : robot_(robot), targets_(targets), cell_(cell) {
    require_fit();
    add_sums();
    add_room();
    add_zones();
    add_clearance();
    add_tracker();
    if (constraints_.size() > kMostConstraints) {
      throw InputError(
          fmt::format("the cell has {} constraints, expected at most {}", constraints_.size(), kMostConstraints));
    }
  }

  const std::vector<Constraint>& all() const { return constraints_; }

  // Bit k: constraint k is violated.
  std::uint64_t violations(const VectorXd& q) const {
    Posture posture{.q = q, .frames = link_frames(robot_, q), .targets = {}, .body = {}};
    for (const TargetFrame& target : targets_) {
      posture.targets.emplace_back(posture.frames.back() * target.X_FT.translation());
    }
    for (const Capsule& capsule : cell_.body) {
      const Isometry3d& X = posture.frames[capsule.frame];
      posture.body.emplace_back(X * capsule.a, X * capsule.b);
    }
    std::uint64_t bits = 0;
    for (std::size_t k = 0; k < constraints_.size(); ++k) {
      bits |= constraints_[k].holds(posture) ? 0 : std::uint64_t{1} << k;
    }
    return bits;
  }

private:
  void require_fit() const {
    const auto joints = robot_.joints.size();
    const auto is_wrong = [&](const JointSum& sum) { return static_cast<std::size_t>(sum.weights.size()) != joints; };
    if (cell_.ranges.size() != joints || std::any_of(cell_.sums.begin(), cell_.sums.end(), is_wrong)) {
      throw InputError(fmt::format("the cell's joint ranges do not fit the robot, expected {} joints", joints));
    }
    for (std::size_t i = 0; i < joints; ++i) {
      if (!(cell_.ranges[i].first <= cell_.ranges[i].second)) {
        throw InputError("joint " + in_quotes(robot_.joints[i].name) +
                         ": its range is empty, expected one within the joint's limits");
      }
    }
    if (!cell_.facing.empty() && cell_.facing.size() != targets_.size()) {
      throw InputError(fmt::format("the cell has {} facing directions, expected one for each of {} targets",
                                   cell_.facing.size(), targets_.size()));
    }
    require_finite("a cell", are_numbers());
    for (const Capsule& capsule : cell_.body) {
      if (capsule.frame > robot_.chain.getNrOfSegments()) {
        throw InputError("the body of link " + in_quotes(capsule.link) + " belongs to no frame of the robot");
      }
    }
  }

  // Whether all numbers are finite; bounds may be infinite.
  bool are_numbers() const {
    const auto all_of = [](const auto& parts, const auto& are) { return std::all_of(parts.begin(), parts.end(), are); };
    const auto is_bound = [](double value) { return !std::isnan(value); };
    const auto is_box = [](const Box& box) { return !box.lower.hasNaN() && !box.upper.hasNaN(); };
    const std::optional<Tracker>& tracker = cell_.tracker;
    return all_of(cell_.sums,
                  [&](const JointSum& sum) {
                    return sum.weights.allFinite() && std::isfinite(sum.offset) && is_bound(sum.lower) &&
                           is_bound(sum.upper);
                  }) &&
           is_box(cell_.box) && all_of(cell_.out_boxes, is_box) && is_bound(cell_.height.value_or(0.0)) &&
           is_bound(cell_.radius.value_or(0.0)) && is_bound(cell_.clearance.value_or(0.0)) &&
           all_of(cell_.out_spheres,
                  [](const Sphere& sphere) { return sphere.center.allFinite() && std::isfinite(sphere.radius); }) &&
           all_of(cell_.body,
                  [](const Capsule& part) {
                    return part.a.allFinite() && part.b.allFinite() && std::isfinite(part.radius);
                  }) &&
           all_of(cell_.facing, [](const Vector3d& direction) { return direction.allFinite(); }) &&
           (!tracker || (tracker->position.allFinite() && is_bound(tracker->least_distance) &&
                         is_bound(tracker->greatest_distance) && is_bound(tracker->acceptance)));
  }

  void add(std::string name, std::function<bool(const Posture&)> holds) {
    constraints_.push_back({std::move(name), std::move(holds)});
  }

  void add_for_targets(std::string name, std::function<bool(const Vector3d&)> holds) {
    add(std::move(name), [holds = std::move(holds)](const Posture& posture) {
      return std::all_of(posture.targets.begin(), posture.targets.end(), holds);
    });
  }

  void add_sums() {
    for (const JointSum& sum : cell_.sums) {
      add("range of " + sum.name, [&sum](const Posture& posture) {
        const double value = sum.weights.dot(posture.q) + sum.offset;
        return value >= sum.lower && value <= sum.upper;
      });
    }
  }

  void add_room() {
    if (cell_.box.lower.maxCoeff() > -std::numeric_limits<double>::infinity() ||
        cell_.box.upper.minCoeff() < std::numeric_limits<double>::infinity()) {
      add_for_targets("workspace box", [this](const Vector3d& p) { return contains(cell_.box, p); });
    }
    if (cell_.height) {
      add_for_targets("least height " + whole_micrometres(*cell_.height),
                      [this](const Vector3d& p) { return p.z() >= *cell_.height; });
    }
    if (cell_.radius) {
      const Vector3d point = to_eigen(robot_.joints.front().origin.p);
      const Vector3d axis = to_eigen(robot_.joints.front().origin.M * robot_.joints.front().axis);
      add_for_targets("least radius " + whole_micrometres(*cell_.radius), [this, point, axis](const Vector3d& p) {
        return (p - point).cross(axis).norm() >= *cell_.radius;
      });
    }
  }

  // Adds a zone that targets and body must not touch; `distance` is that of a segment from the zone.
  template <class Distance>
  void add_zone(const std::string& name, Distance distance) {
    add(name, [this, distance](const Posture& posture) {
      for (const Vector3d& target : posture.targets) {
        if (distance(target, target) <= 0.0) {
          return false;
        }
      }
      for (std::size_t i = 0; i < posture.body.size(); ++i) {
        if (distance(posture.body[i].first, posture.body[i].second) <= cell_.body[i].radius) {
          return false;
        }
      }
      return true;
    });
  }

  void add_zones() {
    for (std::size_t k = 0; k < cell_.out_spheres.size(); ++k) {
      const Sphere& sphere = cell_.out_spheres[k];
      add_zone(fmt::format("keep-out sphere {}", k + 1), [&sphere](const Vector3d& a, const Vector3d& b) {
        return segment_distance(a, b, sphere.center) - sphere.radius;
      });
    }
    for (std::size_t k = 0; k < cell_.out_boxes.size(); ++k) {
      const Box& box = cell_.out_boxes[k];
      add_zone(fmt::format("keep-out box {}", k + 1),
               [&box](const Vector3d& a, const Vector3d& b) { return segment_distance(a, b, box); });
    }
  }

  void add_clearance() {
    if (!cell_.clearance) {
      return;
    }
    auto wanted = pairs_to_keep_apart(robot_, cell_.body, *cell_.clearance);
    if (wanted.empty() && !pairs_to_keep_apart(robot_, cell_.body, 0.0).empty()) {
      throw InputError("clearance " + whole_micrometres(*cell_.clearance) +
                       ": no two parts of the arm are ever so far apart, expected less");
    }
    add("clearance " + whole_micrometres(*cell_.clearance), [this, pairs = std::move(wanted)](const Posture& posture) {
      return std::all_of(pairs.begin(), pairs.end(), [&](const auto& pair) {
        const auto& first = posture.body[pair.first];
        const auto& second = posture.body[pair.second];
        const double distance = segment_distance(first.first, first.second, second.first, second.second);
        return distance - cell_.body[pair.first].radius - cell_.body[pair.second].radius >= *cell_.clearance;
      });
    });
  }

  void add_tracker() {
    if (!cell_.tracker) {
      return;
    }
    const Tracker& tracker = *cell_.tracker;
    if (tracker.least_distance > 0.0 || tracker.greatest_distance < std::numeric_limits<double>::infinity()) {
      add_for_targets("distance from the tracker", [&tracker](const Vector3d& p) {
        const double distance = (p - tracker.position).norm();
        return distance >= tracker.least_distance && distance <= tracker.greatest_distance;
      });
    }
    if (!cell_.facing.empty() && tracker.acceptance < std::numbers::pi) {
      add("acceptance angle " + degrees(tracker.acceptance),
          [this](const Posture& posture) { return faces_tracker(posture); });
    }
    add("line of sight", [this](const Posture& posture) {
      for (std::size_t t = 0; t < targets_.size(); ++t) {
        if (!is_visible(posture, t)) {
          return false;
        }
      }
      return true;
    });
  }

  bool faces_tracker(const Posture& posture) const {
    for (std::size_t t = 0; t < targets_.size(); ++t) {
      const Vector3d facing = posture.frames.back().linear() * cell_.facing[t];
      const Vector3d beam = cell_.tracker->position - posture.targets[t];
      if (facing.norm() > 0.0 && facing.dot(beam) < std::cos(cell_.tracker->acceptance) * facing.norm() * beam.norm()) {
        return false;
      }
    }
    return true;
  }

  bool is_visible(const Posture& posture, std::size_t t) const {
    const Vector3d& from = cell_.tracker->position;
    const Vector3d& to = posture.targets[t];
    for (std::size_t i = 0; i < cell_.body.size(); ++i) {
      const Capsule& capsule = cell_.body[i];
      const auto& [a, b] = posture.body[i];
      // The parts that carry the target may enclose it.
      const bool carries = capsule.frame == robot_.chain.getNrOfSegments() || !moves_against_flange(capsule.frame);
      if (capsule.tool || (carries && segment_distance(a, b, to) <= capsule.radius)) {
        continue;
      }
      if (segment_distance(a, b, from, to) < capsule.radius) {
        return false;
      }
    }
    const auto sphere_blocks = [&](const Sphere& sphere) {
      return (from - sphere.center).norm() > sphere.radius && segment_distance(from, to, sphere.center) < sphere.radius;
    };
    const auto box_blocks = [&](const Box& box) {
      return !contains(box, from) && segment_distance(from, to, box) <= 0.0;
    };
    return std::none_of(cell_.out_spheres.begin(), cell_.out_spheres.end(), sphere_blocks) &&
           std::none_of(cell_.out_boxes.begin(), cell_.out_boxes.end(), box_blocks);
  }

  bool moves_against_flange(std::size_t frame) const {
    for (auto s = static_cast<unsigned>(frame); s < robot_.chain.getNrOfSegments(); ++s) {
      if (robot_.chain.getSegment(s).getJoint().getType() != KDL::Joint::Fixed) {
        return true;
      }
    }
    return false;
  }

  const Robot& robot_;
  const std::vector<TargetFrame>& targets_;
  const Cell& cell_;
  std::vector<Constraint> constraints_;
};

VectorXd sample(const Robot& robot, const JointRanges& ranges, const CandidateOptions& options, std::uint64_t stream) {
  Random random(options.seed, stream);
  VectorXd q(static_cast<Eigen::Index>(ranges.size()));
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const auto [lower, upper] = ranges[i];
    double value = random.uniform(lower, upper);
    const double step = robot.joints[i].type == JointType::prismatic ? options.length_step : options.angle_step;
    if (step > 0.0) {
      value = std::clamp(std::round(value / step) * step, lower, upper);
    }
    q[static_cast<Eigen::Index>(i)] = value;
  }
  follow(robot.joints, q);
  return q;
}

void count_refusals(std::uint64_t bits, std::vector<Refusals>& refusals) {
  for (std::size_t k = 0; k < refusals.size(); ++k) {
    if ((bits >> k & 1U) != 0) {
      ++refusals[k].samples;
      refusals[k].alone += bits == std::uint64_t{1} << k ? 1 : 0;
    }
  }
}

[[noreturn]] void fail_for_too_few(const Candidates& found, std::size_t passed, int wanted) {
  std::string message =
      fmt::format("the constraints leave {} of {} sampled configurations, expected {}", passed, found.samples, wanted);
  for (std::size_t k = 0; k < found.refusals.size(); ++k) {
    const Refusals& refusals = found.refusals[k];
    message += fmt::format("{}{} removes {} ({} alone)", k == 0 ? "; " : ", ", refusals.constraint, refusals.samples,
                           refusals.alone);
  }
  throw InputError(message);
}

}  // namespace

Candidates candidates(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell,
                      const CandidateOptions& options) {
  require_at_least("candidates", options.count, 0);
  const Constraints constraints(robot, targets, cell);
  Candidates found;
  for (const Constraint& constraint : constraints.all()) {
    found.refusals.push_back({.constraint = constraint.name});
  }
  const long most = options.most_samples > 0 ? options.most_samples : 100'000 + 200L * options.count;
  found.joint_values.resize(static_cast<Eigen::Index>(cell.ranges.size()), options.count);
  std::vector<std::uint64_t> bits(kSampleBlock);
  Eigen::Index passed = 0;
  while (passed < options.count && found.samples < most) {
    const auto block = std::min(kSampleBlock, static_cast<std::size_t>(most - found.samples));
    const auto start = static_cast<std::uint64_t>(found.samples);
    parallel_blocks(block, 256, options.threads, [&](std::size_t first, std::size_t end) {
      for (std::size_t k = first; k < end; ++k) {
        bits[k] = constraints.violations(sample(robot, cell.ranges, options, start + k));
      }
    });
    for (std::size_t k = 0; k < block && passed < options.count; ++k) {
      ++found.samples;
      count_refusals(bits[k], found.refusals);
      if (bits[k] == 0) {
        found.joint_values.col(passed++) = sample(robot, cell.ranges, options, start + k);
      }
    }
  }
  if (passed < options.count) {
    fail_for_too_few(found, static_cast<std::size_t>(passed), options.count);
  }
  return found;
}

std::vector<std::string> violated(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell,
                                  const VectorXd& q) {
  const Constraints constraints(robot, targets, cell);
  const std::uint64_t bits = constraints.violations(q);
  std::vector<std::string> names;
  for (std::size_t k = 0; k < constraints.all().size(); ++k) {
    if ((bits >> k & 1U) != 0) {
      names.push_back(constraints.all()[k].name);
    }
  }
  return names;
}

}  // namespace kdl_calibration
