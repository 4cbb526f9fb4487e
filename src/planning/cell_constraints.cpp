#include "planning/cell_constraints.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "base/number_text.hpp"
#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr std::size_t kMostConstraints = 64;

std::string whole_micrometres(double metres) { return shortest(std::round(metres * 1e6) / 1e3) + " mm"; }
std::string degrees(double radians) {
  return shortest(std::round(radians * 180.0 / std::numbers::pi * 1e6) / 1e6) + " deg";
}

bool contains(const Box& box, const Vector3d& p) {
  return (p.array() >= box.lower.array()).all() && (p.array() <= box.upper.array()).all();
}

}  // namespace

// Positions at one sample, in the base frame.
struct CellConstraints::Posture {
  const VectorXd& q;
  std::vector<Isometry3d> frames;
  std::vector<Vector3d> targets;
  std::vector<std::pair<Vector3d, Vector3d>> body;  // ends of the capsules
};

CellConstraints::CellConstraints(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell)
    : robot_(robot), targets_(targets), cell_(cell) {
  require_fit();
  add_sums();
  add_room();
  add_zones();
  add_clearance();
  add_tracker();
  if (names_.size() > kMostConstraints) {
    throw InputError(fmt::format("the cell has {} constraints, expected at most {}", names_.size(), kMostConstraints));
  }
}

CellConstraints::Posture CellConstraints::posture(const VectorXd& q) const {
  Posture posture{.q = q, .frames = link_frames(robot_, q), .targets = {}, .body = {}};
  for (const TargetFrame& target : targets_) {
    posture.targets.emplace_back(posture.frames.back() * target.X_FT.translation());
  }
  for (const Capsule& capsule : cell_.body) {
    const Isometry3d& X = posture.frames[capsule.frame];
    posture.body.emplace_back(X * capsule.a, X * capsule.b);
  }
  return posture;
}

std::uint64_t CellConstraints::violations(const VectorXd& q) const {
  const Posture here = posture(q);
  std::uint64_t bits = 0;
  for (std::size_t k = 0; k < conditions_.size(); ++k) {
    bits |= conditions_[k](here) ? 0 : std::uint64_t{1} << k;
  }
  return bits;
}

std::string CellConstraints::closest_links(const VectorXd& q) const {
  const std::vector<Isometry3d> frames = link_frames(robot_, q);
  std::string links;
  double least = std::numeric_limits<double>::infinity();
  for (const auto& [i, j] : kept_apart_) {
    const Capsule& first = cell_.body[i];
    const Capsule& second = cell_.body[j];
    const double between = distance(first, frames[first.frame], second, frames[second.frame], least);
    if (between < least) {
      least = between;
      links = first.link + " and " + second.link;
    }
  }
  return links;
}

void CellConstraints::require_fit() const {
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
bool CellConstraints::are_numbers() const {
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

void CellConstraints::add(std::string name, Condition holds) {
  names_.push_back(std::move(name));
  conditions_.push_back(std::move(holds));
}

void CellConstraints::add_for_targets(std::string name, std::function<bool(const Vector3d&)> holds) {
  add(std::move(name), [holds = std::move(holds)](const Posture& posture) {
    return std::all_of(posture.targets.begin(), posture.targets.end(), holds);
  });
}

void CellConstraints::add_sums() {
  for (const JointSum& sum : cell_.sums) {
    add("range of " + sum.name, [&sum](const Posture& posture) {
      const double value = sum.weights.dot(posture.q) + sum.offset;
      return value >= sum.lower && value <= sum.upper;
    });
  }
}

void CellConstraints::add_room() {
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
    add_for_targets("least radius " + whole_micrometres(*cell_.radius),
                    [this, point, axis](const Vector3d& p) { return (p - point).cross(axis).norm() >= *cell_.radius; });
  }
}

// Adds a zone that targets and body must not touch; `distance` is that of a segment from the zone.
template <class Distance>
void CellConstraints::add_zone(const std::string& name, Distance distance) {
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

void CellConstraints::add_zones() {
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

void CellConstraints::add_clearance() {
  if (!cell_.clearance) {
    return;
  }
  kept_apart_ = pairs_to_keep_apart(robot_, cell_.body, *cell_.clearance);
  if (kept_apart_.empty() && !pairs_to_keep_apart(robot_, cell_.body, 0.0).empty()) {
    throw InputError("clearance " + whole_micrometres(*cell_.clearance) +
                     ": hardly any two parts of the arm are ever so far apart, expected less");
  }
  clearance_ = names_.size();
  add("clearance " + whole_micrometres(*cell_.clearance), [this](const Posture& posture) {
    return std::all_of(kept_apart_.begin(), kept_apart_.end(), [&](const auto& pair) {
      const Capsule& first = cell_.body[pair.first];
      const Capsule& second = cell_.body[pair.second];
      return distance(first, posture.frames[first.frame], second, posture.frames[second.frame], *cell_.clearance) >=
             *cell_.clearance;
    });
  });
}

void CellConstraints::add_tracker() {
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

bool CellConstraints::faces_tracker(const Posture& posture) const {
  for (std::size_t t = 0; t < targets_.size(); ++t) {
    const Vector3d facing = posture.frames.back().linear() * cell_.facing[t];
    const Vector3d beam = cell_.tracker->position - posture.targets[t];
    if (facing.norm() > 0.0 && facing.dot(beam) < std::cos(cell_.tracker->acceptance) * facing.norm() * beam.norm()) {
      return false;
    }
  }
  return true;
}

bool CellConstraints::is_visible(const Posture& posture, std::size_t t) const {
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
    if (segment_distance(a, b, from, to) < capsule.radius && !passes_box(capsule, posture, from, to)) {
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

// Whether the shape in the capsule is a box that the beam does not meet.
bool CellConstraints::passes_box(const Capsule& capsule, const Posture& posture, const Vector3d& from,
                                 const Vector3d& to) {
  if (!capsule.box) {
    return false;
  }
  const Isometry3d inverse = (posture.frames[capsule.frame] * capsule.box->X_LB).inverse();
  return segment_distance(inverse * from, inverse * to, capsule.box->box) > 0.0;
}

bool CellConstraints::moves_against_flange(std::size_t frame) const {
  for (auto s = static_cast<unsigned>(frame); s < robot_.chain.getNrOfSegments(); ++s) {
    if (robot_.chain.getSegment(s).getJoint().getType() != KDL::Joint::Fixed) {
      return true;
    }
  }
  return false;
}

}  // namespace kdl_calibration
