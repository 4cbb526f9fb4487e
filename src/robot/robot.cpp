#include "kdl_calibration/robot.hpp"

#include <fmt/core.h>
#include <urdf_model/model.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "base/number_range.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/mimic.hpp"
#include "robot/urdf_model.hpp"
#include "robot/urdf_reading.hpp"

namespace kdl_calibration {
namespace {

constexpr std::size_t kMostMovingJoints = 100;

std::string listed(const std::vector<std::string>& names) {
  constexpr std::size_t kMostShown = 50;
  std::string list;
  for (std::size_t i = 0; i < std::min(names.size(), kMostShown); ++i) {
    list += (list.empty() ? "" : ", ") + one_line(names[i]);
  }
  return names.size() > kMostShown ? fmt::format("{}, ... ({} in all)", list, names.size()) : list;
}

void collect_leaves(const urdf::ModelInterface& model, const std::string& base, std::vector<std::string>& leaves,
                    std::set<std::string>& links) {
  std::vector<urdf::LinkConstSharedPtr> open{model.getLink(base)};
  while (!open.empty()) {
    const urdf::LinkConstSharedPtr link = open.back();
    open.pop_back();
    links.insert(link->name);
    if (link->child_links.empty()) {
      leaves.push_back(link->name);
    }
    open.insert(open.end(), link->child_links.rbegin(), link->child_links.rend());
  }
}

std::string default_tip(const urdf::ModelInterface& model, const std::string& base, const std::string& source) {
  std::vector<std::string> leaves;
  std::set<std::string> links;
  collect_leaves(model, base, leaves, links);
  if (leaves.size() == 1) {
    return leaves.front();
  }
  for (const char* name : {"tool0", "flange"}) {
    if (links.contains(name)) {
      return name;
    }
  }
  throw InputError(source + ": the tip is ambiguous, expected one of the links at the ends: " + listed(leaves));
}

void require_link(const urdf::ModelInterface& model, const std::string& name, const std::string& role,
                  const std::string& source) {
  if (model.getLink(name)) {
    return;
  }
  std::vector<std::string> links;
  for (const auto& link : model.links_) {
    links.push_back(link.first);
  }
  throw InputError(source + ": no " + role + " link " + in_quotes(name) + ", the links are: " + listed(links));
}

/// URDF joints from base to tip.
std::vector<urdf::JointConstSharedPtr> path_joints(const urdf::ModelInterface& model, const Robot& robot) {
  std::vector<urdf::JointConstSharedPtr> path;
  for (urdf::LinkConstSharedPtr link = model.getLink(robot.tip); link->name != robot.base;) {
    if (!link->parent_joint) {
      throw InputError(robot.source + ": base link " + in_quotes(robot.base) + " and tip link " + in_quotes(robot.tip) +
                       " are not connected, expected the tip below the base in the tree");
    }
    path.push_back(link->parent_joint);
    link = model.getLink(link->parent_joint->parent_link_name);
  }
  return {path.rbegin(), path.rend()};
}

KDL::RigidBodyInertia link_inertia(const urdf::LinkConstSharedPtr& link) {
  if (!link->inertial) {
    return KDL::RigidBodyInertia::Zero();
  }
  const urdf::Inertial& i = *link->inertial;
  const KDL::RotationalInertia about_cog(i.ixx, i.iyy, i.izz, i.ixy, i.ixz, i.iyz);
  return to_kdl(i.origin) * KDL::RigidBodyInertia(i.mass, KDL::Vector::Zero(), about_cog);
}

bool in_range(const KDL::Vector& v) {
  return std::abs(v.x()) <= kLargestNumber && std::abs(v.y()) <= kLargestNumber && std::abs(v.z()) <= kLargestNumber;
}

void read_limits(const urdf::Joint& joint, MovingJoint& moving, const std::string& where) {
  if (!joint.limits) {
    return;
  }
  const urdf::JointLimits& limits = *joint.limits;
  if (limits.velocity > 0.0) {
    moving.velocity = limits.velocity;
  }
  // urdfdom returns zero for a missing lower or upper limit; both zero means that neither is stated.
  if (moving.type == JointType::continuous || (limits.lower == 0.0 && limits.upper == 0.0)) {
    return;
  }
  if (!(limits.lower <= limits.upper)) {
    throw InputError(where + ": lower limit " + shortest(limits.lower) + " is above upper limit " +
                     shortest(limits.upper) + ", expected lower <= upper");
  }
  moving.lower = limits.lower;
  moving.upper = limits.upper;
}

MovingJoint moving_joint(const urdf::Joint& joint, const std::string& where) {
  MovingJoint moving;
  moving.name = joint.name;
  switch (joint.type) {
    case urdf::Joint::REVOLUTE:
      moving.type = JointType::revolute;
      break;
    case urdf::Joint::CONTINUOUS:
      moving.type = JointType::continuous;
      break;
    case urdf::Joint::PRISMATIC:
      moving.type = JointType::prismatic;
      break;
    default: {
      const std::string type = joint.type == urdf::Joint::FLOATING ? "floating"
                               : joint.type == urdf::Joint::PLANAR ? "planar"
                                                                   : "of unknown type";
      throw InputError(where + " is " + type + ", expected fixed, revolute, continuous or prismatic in the chain");
    }
  }
  const double norm = std::hypot(joint.axis.x, joint.axis.y, joint.axis.z);
  if (!(norm > 0.0) || !std::isfinite(norm)) {
    throw InputError(where + ": axis of length " + shortest(norm) + ", expected a direction");
  }
  moving.axis = KDL::Vector(joint.axis.x / norm, joint.axis.y / norm, joint.axis.z / norm);
  read_limits(joint, moving, where);
  return moving;
}

bool is_moving(const urdf::ModelInterface& model, const std::string& name) {
  const urdf::JointConstSharedPtr joint = model.getJoint(name);
  return joint && (joint->type == urdf::Joint::REVOLUTE || joint->type == urdf::Joint::CONTINUOUS ||
                   joint->type == urdf::Joint::PRISMATIC);
}

/// The drive of `follower` at the end of its mimic chain; the joint itself if it mimics none.
Drive resolved_drive(const urdf::ModelInterface& model, const std::string& source, const std::string& follower) {
  const std::string where = source + ": joint " + in_quotes(follower);
  const auto is_in_range = [](double value) { return std::abs(value) <= kLargestNumber; };
  Drive drive{.name = follower};
  for (std::size_t step = 0; step <= model.joints_.size(); ++step) {
    if (!is_moving(model, drive.name)) {
      throw InputError(where + " mimics joint " + in_quotes(drive.name) + ", expected a moving joint of the URDF");
    }
    const urdf::JointMimicSharedPtr& next = model.getJoint(drive.name)->mimic;
    if (!next) {
      return drive;
    }
    drive.offset += drive.multiplier * next->offset;
    drive.multiplier *= next->multiplier;
    if (!is_in_range(drive.multiplier) || !is_in_range(drive.offset)) {
      throw InputError(where + ": multiplier or offset of its mimic is not finite or out of range, expected numbers " +
                       "up to 1e12");
    }
    drive.name = next->joint_name;
  }
  throw InputError(where + ": what it mimics forms a loop through joint " + in_quotes(drive.name) +
                   ", expected a leader that follows none");
}

/// Narrows the leader's limits to those of its follower, which urdfdom does not do.
void narrow_limits(const MovingJoint& follower, MovingJoint& leader, const std::string& source) {
  const double multiplier = follower.mimic->multiplier;
  const double offset = follower.mimic->offset;
  const std::string where = source + ": joint " + in_quotes(follower.name);
  if (multiplier == 0.0) {
    if (offset < follower.lower.value_or(offset) || offset > follower.upper.value_or(offset)) {
      throw InputError(where + ": the value " + shortest(offset) + " that its mimic gives is outside its limits");
    }
    return;
  }
  const std::optional<double>& lower = multiplier < 0.0 ? follower.upper : follower.lower;
  const std::optional<double>& upper = multiplier < 0.0 ? follower.lower : follower.upper;
  if (lower && (*lower - offset) / multiplier > -kLargestNumber) {
    leader.lower = std::max(leader.lower.value_or(-kLargestNumber), (*lower - offset) / multiplier);
  }
  if (upper && (*upper - offset) / multiplier < kLargestNumber) {
    leader.upper = std::min(leader.upper.value_or(kLargestNumber), (*upper - offset) / multiplier);
  }
  if (!(leader.lower.value_or(-kLargestNumber) <= leader.upper.value_or(kLargestNumber))) {
    throw InputError(where + ": no value of joint " + in_quotes(leader.name) + ", which it mimics, keeps both within " +
                     "their limits");
  }
}

/// The first joint of a drive outside the chain represents it; the drive's other joints follow that joint.
void set_drive(const urdf::ModelInterface& model, const Robot& robot, const Drive& drive, MovingJoint& joint) {
  const std::string where = robot.source + ": joint " + in_quotes(joint.name);
  MovingJoint outside = moving_joint(*model.getJoint(drive.name), robot.source + ": joint " + in_quotes(drive.name));
  if ((outside.type == JointType::prismatic) != (joint.type == JointType::prismatic)) {
    throw InputError(where + " mimics joint " + in_quotes(drive.name) + ", and only one of them turns: expected two " +
                     "joints that turn or two that slide");
  }
  if (drive.multiplier == 0.0) {
    throw InputError(where + " mimics joint " + in_quotes(drive.name) +
                     " with a multiplier of 0, expected another one");
  }
  joint.drive = drive;
  outside.mimic = Mimic{.multiplier = 1.0 / drive.multiplier, .offset = -drive.offset / drive.multiplier};
  narrow_limits(outside, joint, robot.source);
}

void resolve_mimics(const urdf::ModelInterface& model, Robot& robot) {
  std::map<std::string, std::size_t> leaders;  // index of the chain's joint that is or represents each drive
  std::vector<Drive> drives;
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    leaders.emplace(robot.joints[i].name, i);
    drives.push_back(resolved_drive(model, robot.source, robot.joints[i].name));
  }
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    MovingJoint& joint = robot.joints[i];
    const Drive& own = drives[i];
    if (own.name == joint.name) {
      continue;
    }
    const auto [leader, stands_for_it] = leaders.emplace(own.name, i);
    if (stands_for_it) {
      set_drive(model, robot, own, joint);
      continue;
    }
    const Drive of_leader = drive_of(robot.joints[leader->second]);
    const double multiplier = own.multiplier / of_leader.multiplier;
    joint.mimic =
        Mimic{.leader = leader->second, .multiplier = multiplier, .offset = own.offset - multiplier * of_leader.offset};
  }
  for (const MovingJoint& joint : robot.joints) {
    if (joint.mimic) {
      narrow_limits(joint, robot.joints[joint.mimic->leader], robot.source);
    }
  }
}

/// Names of the links behind the last moving joint of the chain, or from its base if there is none.
std::vector<std::string> links_at_end(const Robot& robot) {
  const std::vector<KDL::Segment>& segments = robot.chain.segments;
  const auto moves = [](const KDL::Segment& segment) { return segment.getJoint().getType() != KDL::Joint::Fixed; };
  const auto last = std::find_if(segments.rbegin(), segments.rend(), moves);
  std::vector<std::string> names;
  if (last == segments.rend()) {
    names.push_back(robot.base);
  }
  for (auto segment = last == segments.rend() ? segments.begin() : last.base() - 1; segment != segments.end();
       ++segment) {
    names.push_back(segment->getName());
  }
  return names;
}

/// Appends the URDF joint to the chain, and to the moving joints or the fixed part after them.
void append_joint(const urdf::Joint& joint, const urdf::ModelInterface& model, Robot& robot) {
  const std::string where = robot.source + ": joint " + in_quotes(joint.name);
  const KDL::Frame origin = to_kdl(joint.parent_to_joint_origin_transform);
  const KDL::Frame behind_last = robot.tip_origin * origin;
  if (!in_range(origin.p) || !in_range(behind_last.p) || !in_range(origin.M.UnitX())) {
    throw InputError(where + ": origin is not finite or out of range, expected numbers up to 1e12");
  }
  const urdf::LinkConstSharedPtr link = model.getLink(joint.child_link_name);
  const KDL::RigidBodyInertia inertia = link_inertia(link);
  if (!(std::abs(inertia.getMass()) <= kLargestNumber) || !in_range(inertia.getCOG())) {
    throw InputError(robot.source + ": link " + in_quotes(link->name) +
                     ": mass or its centre is not finite or out of range, expected numbers up to 1e12");
  }
  if (joint.type == urdf::Joint::FIXED) {
    const KDL::Joint fixed(joint.name, KDL::Joint::Fixed);
    robot.chain.addSegment(KDL::Segment(joint.child_link_name, fixed, origin, inertia));
    robot.tip_origin = behind_last;
    robot.tip_joint = joint.name;
    return;
  }
  MovingJoint moving = moving_joint(joint, where);
  moving.origin = behind_last;
  moving.links = links_at_end(robot);
  const auto type = moving.type == JointType::prismatic ? KDL::Joint::TransAxis : KDL::Joint::RotAxis;
  const KDL::Joint kdl_joint(joint.name, origin.p, origin.M * moving.axis, type);
  robot.chain.addSegment(KDL::Segment(joint.child_link_name, kdl_joint, origin, inertia));
  robot.joints.push_back(std::move(moving));
  robot.tip_origin = KDL::Frame::Identity();
  robot.tip_joint.clear();
}

}  // namespace

std::vector<std::string> joint_names(const Robot& robot) {
  std::vector<std::string> names;
  for (const MovingJoint& joint : robot.joints) {
    names.push_back(joint.name);
  }
  return names;
}

std::vector<std::string> link_names(const Robot& robot) {
  std::vector<std::string> names = {robot.base};
  for (const KDL::Segment& segment : robot.chain.segments) {
    names.push_back(segment.getName());
  }
  return names;
}

Robot parse_robot(std::string_view urdf, const RobotOptions& options, const std::string& source) {
  const urdf::ModelInterfaceSharedPtr model = parse_model(urdf, source);
  Robot robot;
  robot.name = model->getName();
  robot.source = source;
  robot.urdf = urdf;
  robot.base = options.base.empty() ? model->getRoot()->name : options.base;
  require_link(*model, robot.base, "base", source);
  robot.tip = options.tip.empty() ? default_tip(*model, robot.base, source) : options.tip;
  require_link(*model, robot.tip, "tip", source);
  for (const urdf::JointConstSharedPtr& joint : path_joints(*model, robot)) {
    append_joint(*joint, *model, robot);
  }
  if (robot.joints.size() > kMostMovingJoints) {
    throw InputError(fmt::format("{}: {} moving joints between base link {} and tip link {}, expected at most {}",
                                 source, robot.joints.size(), in_quotes(robot.base), in_quotes(robot.tip),
                                 kMostMovingJoints));
  }
  if (robot.joints.empty()) {
    throw InputError(source + ": no moving joint between base link " + in_quotes(robot.base) + " and tip link " +
                     in_quotes(robot.tip) + ", expected at least one");
  }
  resolve_mimics(*model, robot);
  return robot;
}

Robot load_robot(const std::filesystem::path& file, const RobotOptions& options) {
  return parse_robot(read_text_file(file), options, one_line(file.string()));
}

}  // namespace kdl_calibration
