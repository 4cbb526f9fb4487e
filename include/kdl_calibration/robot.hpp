#pragma once

// The nominal robot: one serial chain of a URDF.
//
//     const Robot robot = load_robot("robot.urdf", {.base = "base_link", .tip = "tool0"});
//     KDL::ChainFkSolverPos_recursive solver(robot.chain);

#include <cstddef>
#include <filesystem>
#include <kdl/chain.hpp>
#include <kdl/frames.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

enum class JointType { revolute, continuous, prismatic };

/// How a joint follows another one of the chain (URDF <mimic>): its value is multiplier * the leader's + offset.
struct Mimic {
  std::size_t leader = 0;  ///< index of an independent joint of the chain
  double multiplier = 1.0;
  double offset = 0.0;  ///< [rad] or [m]
};

/// A joint outside the chain that moves one of the chain (a URDF <mimic> of a joint on another branch, such as the
/// drive of a lift). Users and files state the drive's value; the joint's own value is multiplier * the drive's +
/// offset.
struct Drive {
  std::string name;
  double multiplier = 1.0;
  double offset = 0.0;  ///< [rad] or [m]
};

/// A moving joint of the chain. Units: metres and radians (per second).
struct MovingJoint {
  std::string name;
  JointType type = JointType::revolute;
  /// Frame of this joint at q = 0 in the frame of the previous moving joint (of the base link for the first): product
  /// of the origins of the fixed joints in between and its own.
  KDL::Frame origin;
  /// Unit axis in the joint's own frame.
  KDL::Vector axis;
  /// Empty if the URDF states no limits (or zero for both) or the joint is continuous. A leader's limits are narrowed
  /// by those of its followers.
  std::optional<double> lower;
  std::optional<double> upper;
  std::optional<double> velocity;
  std::optional<Mimic> mimic;  ///< none for an independent joint
  std::optional<Drive> drive;  ///< of an independent joint; other joints of the same drive follow this one
  /// URDF links of the rigid body before it, towards the tip: the last is the joint's parent, the others are fixed to
  /// it.
  std::vector<std::string> links = {};
};

/// The nominal robot: one serial chain of a URDF, from `base` to `tip`.
struct Robot {
  std::string name;
  std::string source;               ///< file name, for messages
  std::string urdf;                 ///< the original text, byte for byte
  std::string base;                 ///< link
  std::string tip;                  ///< link
  std::vector<MovingJoint> joints;  ///< from base to tip
  KDL::Frame tip_origin;  ///< frame of the tip in the frame of the last moving joint: the fixed joints behind it
  std::string tip_joint;  ///< the last fixed joint before the tip; empty if the tip is the last moving joint's link
  KDL::Chain chain;       ///< one segment per URDF joint, fixed joints included, named after their child links
};

struct RobotOptions {
  std::string base = {};  ///< link; empty: the root link
  std::string tip = {};   ///< link; empty: the only leaf, else `tool0`, else `flange`
};

/// Lower and upper bound of every joint [rad or m].
using JointRanges = std::vector<std::pair<double, double>>;

/// Names of the moving joints, base to tip, followers included (see mimic.hpp).
std::vector<std::string> joint_names(const Robot& robot);

/// Names of the chain's links, base to tip.
std::vector<std::string> link_names(const Robot& robot);

/// Builds the nominal chain from URDF text. `source` names the text in messages.
/// Throws InputError: malformed XML (with its line), unknown base or tip (the message lists the links), base and tip
/// not connected, no moving joint, a floating or planar joint in the chain, a zero axis, an ambiguous tip, a lower
/// limit above the upper, a joint that mimics itself or a joint not moving in the chain, limits of a leader and its
/// follower that exclude each other, links that form no tree, and whatever urdfdom rejects (such as a revolute joint
/// with no <limit>), with urdfdom's words. Limits: 64 MiB, 100 nested levels, 2,000 joints, 100 moving ones in the
/// chain.
Robot parse_robot(std::string_view urdf, const RobotOptions& options = {}, const std::string& source = "URDF");

/// Reads the file and builds the nominal chain. Throws InputError as parse_robot does, and for an unreadable file.
Robot load_robot(const std::filesystem::path& file, const RobotOptions& options = {});

}  // namespace kdl_calibration
