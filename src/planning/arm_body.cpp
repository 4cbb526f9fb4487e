#include "planning/arm_body.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <set>

#include "base/decompositions.hpp"
#include "base/preconditions.hpp"
#include "base/random.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/link_shapes.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr std::uint64_t kConfigurationsOfPairs = 500;

// A capsule along `axis` around everything within `half_length` of the origin along it and within `reach` across it.
// Moving the ends inwards by half the reach increases the radius by an eighth and reduces the overshoot by a third.
Capsule around(const Vector3d& axis, double half_length, double reach) {
  const double drawn_in = std::min(half_length, 0.5 * reach);
  const Vector3d end = axis * (half_length - drawn_in);
  return {.link = {}, .a = -end, .b = end, .radius = std::hypot(reach, drawn_in)};
}

Capsule around_box(const Vector3d& half) {
  Eigen::Index longest = 0;
  half.maxCoeff(&longest);
  const double reach = std::sqrt(half.squaredNorm() - half[longest] * half[longest]);
  return around(Vector3d::Unit(longest), half[longest], reach);
}

// The capsule around a shape; empty for a mesh.
std::optional<Capsule> capsule_around(const LinkShape& shape) {
  std::optional<Capsule> capsule;
  switch (shape.kind) {
    case LinkShape::Kind::box:
      capsule = around_box(0.5 * shape.size);
      capsule->box = LinkBox{.X_LB = shape.X_LS, .box = {.lower = -0.5 * shape.size, .upper = 0.5 * shape.size}};
      break;
    case LinkShape::Kind::cylinder:
      capsule = around(Vector3d::UnitZ(), 0.5 * shape.size.z(), shape.size.x());
      break;
    case LinkShape::Kind::sphere:
      capsule = Capsule{.link = {}, .radius = shape.size.x()};
      break;
    case LinkShape::Kind::mesh:
      return std::nullopt;
  }
  capsule->link = shape.link;
  capsule->a = shape.X_LS * capsule->a;
  capsule->b = shape.X_LS * capsule->b;
  return capsule;
}

// Number of moving joints before each link's frame.
std::vector<std::size_t> joints_in_front(const Robot& robot) {
  std::vector<std::size_t> counts = {0};
  for (unsigned s = 0; s < robot.chain.getNrOfSegments(); ++s) {
    const bool moves = robot.chain.getSegment(s).getJoint().getType() != KDL::Joint::Fixed;
    counts.push_back(counts.back() + (moves ? 1 : 0));
  }
  return counts;
}

struct Line {
  Vector3d point;
  Vector3d direction;
  bool turns = true;
};

// The joints' axes at zero, in the base frame.
std::vector<Line> axes_at_zero(const Robot& robot) {
  std::vector<Line> axes;
  Isometry3d X = Isometry3d::Identity();
  for (const MovingJoint& joint : robot.joints) {
    X = X * to_eigen(joint.origin);
    axes.push_back({.point = X.translation(),
                    .direction = X.linear() * to_eigen(joint.axis),
                    .turns = joint.type != JointType::prismatic});
  }
  return axes;
}

// Whether the axes are of revolute joints and meet in one point, and thus do so in every configuration.
bool meet_in_one_point(const std::vector<Line>& axes, std::size_t first, std::size_t end) {
  constexpr double kTolerance = 1e-6;
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();  // normal matrix of the point closest to all axes
  Vector3d right = Vector3d::Zero();
  for (std::size_t i = first; i < end; ++i) {
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - axes[i].direction * axes[i].direction.transpose();
    normal += across;
    right += across * axes[i].point;
  }
  const Vector3d point = pseudo_inverse(normal) * right;
  return std::all_of(
      axes.begin() + static_cast<std::ptrdiff_t>(first), axes.begin() + static_cast<std::ptrdiff_t>(end),
      [&](const Line& axis) { return axis.turns && (point - axis.point).cross(axis.direction).norm() < kTolerance; });
}

Eigen::VectorXd anywhere(const Robot& robot, std::uint64_t stream) {
  Random random(1, stream);
  Eigen::VectorXd q(static_cast<Eigen::Index>(robot.joints.size()));
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    const MovingJoint& joint = robot.joints[i];
    const double whole = joint.type == JointType::prismatic ? 1.0 : std::numbers::pi;
    q[static_cast<Eigen::Index>(i)] = random.uniform(joint.lower.value_or(-whole), joint.upper.value_or(whole));
  }
  follow(robot.joints, q);
  return q;
}

}  // namespace

ArmBody body_from_urdf(const Robot& robot) {
  const std::vector<std::string> names = link_names(robot);
  std::set<std::string> with_shape;
  std::set<std::string> without_shape;
  ArmBody body;
  for (const LinkShape& shape : link_shapes(robot)) {
    if (std::optional<Capsule> capsule = capsule_around(shape)) {
      capsule->frame = static_cast<std::size_t>(std::find(names.begin(), names.end(), shape.link) - names.begin());
      body.capsules.push_back(*capsule);
      with_shape.insert(shape.link);
    } else {
      without_shape.insert(shape.link);
    }
  }
  for (const std::string& name : names) {
    if (without_shape.count(name) > 0 || with_shape.count(name) == 0) {
      body.without_shape.push_back(name);
    }
  }
  return body;
}

ArmBody body_with_radius(const Robot& robot, double radius) {
  require_sigma("the radius of the body", radius);
  const std::vector<std::string> names = link_names(robot);
  ArmBody body;
  for (std::size_t frame = 0; frame + 1 < names.size(); ++frame) {
    // Position of the next link's joint in this link.
    const KDL::Segment& next = robot.chain.getSegment(static_cast<unsigned>(frame));
    const bool fixed = next.getJoint().getType() == KDL::Joint::Fixed;
    const Vector3d end = to_eigen(fixed ? next.getFrameToTip().p : next.getJoint().JointOrigin());
    body.capsules.push_back({.link = names[frame], .frame = frame, .b = end, .radius = radius});
  }
  return body;
}

std::vector<Capsule> tool_body(const Robot& robot, const std::vector<TargetFrame>& targets, double radius) {
  require_sigma("the radius of the tool", radius);
  std::vector<Capsule> capsules;
  capsules.reserve(targets.size());
  for (const TargetFrame& target : targets) {
    capsules.push_back({.link = "the tool to target " + target.name,
                        .frame = robot.chain.getNrOfSegments(),
                        .b = target.X_FT.translation(),
                        .radius = radius,
                        .tool = true});
  }
  return capsules;
}

// Does not use KDL's moving segments, which cache their last pose and so are not thread-safe.
std::vector<Isometry3d> link_frames(const Robot& robot, const Eigen::Ref<const Eigen::VectorXd>& q) {
  std::vector<Isometry3d> frames = {Isometry3d::Identity()};
  Isometry3d moving = Isometry3d::Identity();  // frame of the last moved link
  std::size_t j = 0;
  for (unsigned s = 0; s < robot.chain.getNrOfSegments(); ++s) {
    const KDL::Segment& segment = robot.chain.getSegment(s);
    if (segment.getJoint().getType() == KDL::Joint::Fixed) {
      frames.push_back(frames.back() * to_eigen(segment.getFrameToTip()));
      continue;
    }
    const MovingJoint& joint = robot.joints[j];
    const double value = q[static_cast<Eigen::Index>(j++)];
    moving = moving * to_eigen(joint.origin);
    if (joint.type == JointType::prismatic) {
      moving.translate(value * to_eigen(joint.axis));
    } else {
      moving.rotate(Eigen::AngleAxisd(value, to_eigen(joint.axis)));
    }
    frames.push_back(moving);
  }
  return frames;
}

double segment_distance(const Vector3d& a1, const Vector3d& b1, const Vector3d& a2, const Vector3d& b2) {
  const Vector3d u = b1 - a1;
  const Vector3d v = b2 - a2;
  const Vector3d w = a1 - a2;
  const double uu = u.squaredNorm();
  const double vv = v.squaredNorm();
  const double uv = u.dot(v);
  const double determinant = uu * vv - uv * uv;
  // If the lines' closest points are not inside both segments, an end point is closest.
  if (determinant > 1e-12 * uu * vv) {
    const double s = (uv * v.dot(w) - vv * u.dot(w)) / determinant;
    const double t = (uu * v.dot(w) - uv * u.dot(w)) / determinant;
    if (s >= 0.0 && s <= 1.0 && t >= 0.0 && t <= 1.0) {
      return (w + s * u - t * v).norm();
    }
  }
  return std::min({segment_distance(a1, b1, a2), segment_distance(a1, b1, b2), segment_distance(a2, b2, a1),
                   segment_distance(a2, b2, b1)});
}

double segment_distance(const Vector3d& a, const Vector3d& b, const Vector3d& point) {
  const Vector3d u = b - a;
  const double length = u.squaredNorm();
  const double t = length > 0.0 ? std::clamp((point - a).dot(u) / length, 0.0, 1.0) : 0.0;
  return (a + t * u - point).norm();
}

double segment_distance(const Vector3d& a, const Vector3d& b, const Box& box) {
  const Vector3d u = b - a;
  const auto outside = [&](double t) {
    const Vector3d p = a + t * u;
    return Vector3d(p - p.cwiseMax(box.lower).cwiseMin(box.upper));
  };
  // The squared distance is convex along the segment, so its derivative is bisected.
  double lower = 0.0;
  double upper = 1.0;
  for (int i = 0; i < 50; ++i) {
    const double t = 0.5 * (lower + upper);
    (outside(t).dot(u) > 0.0 ? upper : lower) = t;
  }
  // If the segment intersects the box, a point is inside to the last digit and the distance exactly 0.
  return std::min({outside(lower).norm(), outside(upper).norm(), outside(0.0).norm(), outside(1.0).norm()});
}

double distance(const Capsule& first, const Isometry3d& X_first, const Capsule& second, const Isometry3d& X_second,
                double enough) {
  const Vector3d a1 = X_first * first.a;
  const Vector3d b1 = X_first * first.b;
  const Vector3d a2 = X_second * second.a;
  const Vector3d b2 = X_second * second.b;
  double bound = segment_distance(a1, b1, a2, b2) - first.radius - second.radius;
  if (bound < enough && first.box) {
    const Isometry3d inverse = (X_first * first.box->X_LB).inverse();
    bound = std::max(bound, segment_distance(inverse * a2, inverse * b2, first.box->box) - second.radius);
  }
  if (bound < enough && second.box) {
    const Isometry3d inverse = (X_second * second.box->X_LB).inverse();
    bound = std::max(bound, segment_distance(inverse * a1, inverse * b1, second.box->box) - first.radius);
  }
  return bound;
}

std::vector<std::pair<std::size_t, std::size_t>> pairs_to_keep_apart(const Robot& robot,
                                                                     const std::vector<Capsule>& capsules,
                                                                     double clearance) {
  require_sigma("the clearance", clearance);
  const std::vector<std::size_t> joints = joints_in_front(robot);
  const std::vector<Line> axes = axes_at_zero(robot);
  std::vector<std::pair<std::size_t, std::size_t>> candidates;
  for (std::size_t i = 0; i < capsules.size(); ++i) {
    for (std::size_t j = i + 1; j < capsules.size(); ++j) {
      const auto [first, end] = std::minmax(joints[capsules[i].frame], joints[capsules[j].frame]);
      const bool tool = capsules[i].tool || capsules[j].tool;
      if (end - first >= 2 && (tool || !meet_in_one_point(axes, first, end))) {
        candidates.emplace_back(i, j);
      }
    }
  }
  std::vector<std::uint64_t> apart(candidates.size(), 0);  // configurations
  for (std::uint64_t k = 0; k < kConfigurationsOfPairs; ++k) {
    const std::vector<Isometry3d> frames = link_frames(robot, anywhere(robot, k));
    for (std::size_t p = 0; p < candidates.size(); ++p) {
      const Capsule& first = capsules[candidates[p].first];
      const Capsule& second = capsules[candidates[p].second];
      apart[p] += distance(first, frames[first.frame], second, frames[second.frame], clearance) >= clearance ? 1 : 0;
    }
  }
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t p = 0; p < candidates.size(); ++p) {
    if (10 * apart[p] >= kConfigurationsOfPairs) {
      pairs.push_back(candidates[p]);
    }
  }
  return pairs;
}

}  // namespace kdl_calibration
