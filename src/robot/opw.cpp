#include "robot/opw.hpp"

#include <fmt/core.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <kdl/jntarray.hpp>
#include <numbers>
#include <utility>

#include "kdl_calibration/input_error.hpp"
#include "robot/chain_to_dh.hpp"

namespace kdl_calibration {
namespace {

using KDL::dot;
using KDL::Vector;

constexpr double kNoLength = 1e-9;     // [m], or relative
constexpr double kTipRounding = 1e-9;  // [m], [rad] of a tip

struct ArmAxis {
  Vector point;
  Vector direction;
};

// The axes in the base frame, all joints at zero, and the tip.
struct Arm {
  std::array<ArmAxis, 6> axes;
  KDL::Frame tip;
};

Arm arm_of(const Robot& robot) {
  const bool usual =
      robot.joints.size() == 6 && std::none_of(robot.joints.begin(), robot.joints.end(), [](const auto& joint) {
        return joint.type == JointType::prismatic || joint.mimic || joint.drive;
      });
  if (!usual) {
    throw InputError(robot.source + ": OPW kinematics are of arms with six revolute joints: expected another format");
  }
  Arm arm;
  for (std::size_t i = 0; i < arm.axes.size(); ++i) {
    arm.tip = arm.tip * robot.joints[i].origin;
    arm.axes[i] = {.point = arm.tip.p, .direction = arm.tip.M * robot.joints[i].axis};
  }
  arm.tip = arm.tip * robot.tip_origin;
  return arm;
}

// The point of the first line next to the second, which is not parallel to it.
Vector next_point(const ArmAxis& first, const ArmAxis& second) {
  const double cosine = dot(first.direction, second.direction);
  const Vector apart = second.point - first.point;
  const double along = dot(apart, first.direction) - cosine * dot(apart, second.direction);
  return first.point + first.direction * (along / std::max(1.0 - cosine * cosine, kNoLength));
}

double sign_of(double value) { return value < 0.0 ? -1.0 : 1.0; }

// What would be zero in the family, with words for it.
struct Departure {
  double size = 0.0;
  std::string words;
};

std::string largest_deviation(const Robot& robot, const Arm& arm, const Vector& wrist) {
  std::vector<Departure> all;
  for (std::size_t i = 0; i + 1 < arm.axes.size(); ++i) {
    const Vector& first = arm.axes[i].direction;
    const Vector& second = arm.axes[i + 1].direction;
    const bool parallel = i == 1;
    const double size = parallel ? (first * second).Norm() : std::abs(dot(first, second));
    all.push_back({size, fmt::format("the axes of {} and {} are {:.2g} rad from {}", robot.joints[i].name,
                                     robot.joints[i + 1].name, size, parallel ? "parallel" : "a right angle")});
  }
  for (std::size_t i = 3; i < arm.axes.size(); ++i) {
    const double size = ((wrist - arm.axes[i].point) * arm.axes[i].direction).Norm();
    all.push_back(
        {size, fmt::format("the axis of {} misses the wrist's point by {:.2g} mm", robot.joints[i].name, size * 1e3)});
  }
  return std::max_element(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.size < b.size; })->words;
}

// Basis: axes 1 to 3. Its angles at joint values of zero go to t[0] and t[1]. Returns the axes x and y of link 1.
std::pair<Vector, Vector> add_basis(const Arm& arm, const Vector& wrist, OpwParameters& found,
                                    std::array<double, 6>& t) {
  const ArmAxis& first = arm.axes[0];
  const ArmAxis& second = arm.axes[1];
  found.signs[0] = static_cast<int>(sign_of(first.direction.z()));
  const Vector z = first.direction * found.signs[0];
  const Vector origin = first.point + z * -dot(first.point, z);
  Vector y = second.direction;
  const double forward = dot(y * z, second.point - origin);
  found.signs[1] = static_cast<int>(sign_of(std::abs(forward) > kNoLength ? forward : dot(y * z, wrist - origin)));
  y = y * found.signs[1];
  found.signs[2] = static_cast<int>(sign_of(dot(arm.axes[2].direction, y)));
  Vector x = y * z;
  x.Normalize();

  // The base's own x where its z is the axis, else one across it.
  Vector x0 = Vector(1, 0, 0) - z * z.x();
  x0.Normalize();
  found.base = KDL::Frame(KDL::Rotation(x0, z * x0, z), origin);
  t[0] = std::atan2(dot(x, z * x0), dot(x, x0));
  found.a1 = dot(x, second.point - origin);
  found.b = dot(y, wrist - origin);
  found.c1 = dot(z, second.point - origin);
  const Vector upper = arm.axes[2].point - second.point;
  t[1] = std::atan2(dot(upper, x), dot(upper, z));
  found.c2 = std::hypot(dot(upper, x), dot(upper, z));
  return {x, y};
}

void add_wrist(const Arm& arm, const Vector& wrist, const std::pair<Vector, Vector>& basis, OpwParameters& found,
               std::array<double, 6>& t) {
  const auto& [x, y] = basis;
  const Vector z = x * y;
  const Vector fore = wrist - arm.axes[2].point;
  found.signs[3] = static_cast<int>(sign_of(dot(arm.axes[3].direction, fore)));
  const Vector d4 = arm.axes[3].direction * found.signs[3];
  t[2] = std::atan2(dot(d4, x), dot(d4, z)) - t[1];
  const Vector x3 = y * d4;
  found.a2 = dot(x3, fore);
  found.c3 = dot(d4, fore);

  found.signs[4] = static_cast<int>(sign_of(dot(arm.axes[4].direction, y)));
  const Vector y5 = arm.axes[4].direction * found.signs[4];
  t[3] = std::atan2(-dot(y5, x3), dot(y5, y));
  const Vector hand = arm.tip.p - wrist;
  const double along = dot(arm.axes[5].direction, hand);
  found.signs[5] =
      static_cast<int>(sign_of(std::abs(along) > kNoLength ? along : dot(arm.axes[5].direction, arm.tip.M.UnitZ())));
  const Vector d6 = arm.axes[5].direction * found.signs[5];
  t[4] = std::atan2(dot(d6, y5 * d4), dot(d6, d4));
  found.c4 = dot(d6, hand);
  // A tip whose z is the axis has an angle about it, no frame of its own.
  const Vector x5 = y5 * d6;
  const bool along_z = (d6 - arm.tip.M.UnitZ()).Norm() < kNoLength;
  t[5] = along_z ? std::atan2(dot(arm.tip.M.UnitX(), y5), dot(arm.tip.M.UnitX(), x5)) : 0.0;
}

}  // namespace

KDL::Frame opw_pose(const OpwParameters& parameters, const std::vector<double>& q) {
  using KDL::Frame;
  using KDL::Rotation;
  std::array<double, 6> t{};
  for (std::size_t i = 0; i < t.size(); ++i) {
    t[i] = parameters.signs[i] * q[i] - parameters.offsets[i];
  }
  return parameters.base * Frame(Vector(0, 0, parameters.c1)) * Frame(Rotation::RotZ(t[0])) *
         Frame(Vector(parameters.a1, parameters.b, 0)) * Frame(Rotation::RotY(t[1])) *
         Frame(Vector(0, 0, parameters.c2)) * Frame(Rotation::RotY(t[2])) *
         Frame(Vector(parameters.a2, 0, parameters.c3)) *
         Frame(Rotation::RotZ(t[3]) * Rotation::RotY(t[4]) * Rotation::RotZ(t[5])) *
         Frame(Vector(0, 0, parameters.c4)) * parameters.tip;
}

OpwParameters opw_parameters_of(const Robot& robot) {
  const Arm arm = arm_of(robot);
  const Vector wrist = next_point(arm.axes[4], arm.axes[3]);
  OpwParameters found;
  std::array<double, 6> at_zero{};
  const auto basis = add_basis(arm, wrist, found, at_zero);
  add_wrist(arm, wrist, basis, found, at_zero);
  for (std::size_t i = 0; i < at_zero.size(); ++i) {
    found.offsets[i] = std::abs(at_zero[i]) < 1e-15 ? 0.0 : -std::remainder(at_zero[i], 2.0 * std::numbers::pi);
  }
  found.tip = opw_pose(found, std::vector<double>(6, 0.0)).Inverse() * arm.tip;
  const PoseDifference difference = largest_difference(robot, [&](const KDL::JntArray& q) {
    return opw_pose(found, {q.data.begin(), q.data.end()});
  });
  if (std::max(difference.position, difference.rotation) > kTipRounding) {
    throw InputError(fmt::format(
        "{}: no arm of OPW kinematics, which would miss its tip by up to {:.2g} mm and {:.2g} "
        "rad: {}; expected a calibration that keeps the angles of the axes (keep_axes)",
        robot.source, difference.position * 1e3, difference.rotation, largest_deviation(robot, arm, wrist)));
  }
  return found;
}

}  // namespace kdl_calibration
