#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// Box parallel to the axes of its frame, the base unless stated. [m]
struct Box {
  Eigen::Vector3d lower = Eigen::Vector3d::Constant(-std::numeric_limits<double>::infinity());
  Eigen::Vector3d upper = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
};

/// A box of a link: X_LB is the pose of its frame in the link.
struct LinkBox {
  Eigen::Isometry3d X_LB = Eigen::Isometry3d::Identity();
  Box box;
};

/// All points within `radius` of the segment from a to b, in the frame of the link it belongs to. [m]
struct Capsule {
  std::string link;
  std::size_t frame = 0;  ///< index into link_frames
  Eigen::Vector3d a = Eigen::Vector3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  double radius = 0.0;
  bool tool = false;                          ///< part of the tool
  std::optional<LinkBox> box = std::nullopt;  ///< the shape inside, where it is a box
};

/// The arm's shape.
struct ArmBody {
  std::vector<Capsule> capsules;
  std::vector<std::string> without_shape;  ///< links with only a mesh or without any shape
};

/// Capsules around the boxes, cylinders and spheres of the chain's links: collision shapes, or visual shapes of links
/// without them. A capsule encloses its shape. Throws InputError for a size that is not positive.
ArmBody body_from_urdf(const Robot& robot);
/// Capsules of this radius from each link's frame to the next.
ArmBody body_with_radius(const Robot& robot, double radius);
/// Capsules from the flange's origin to each target.
std::vector<Capsule> tool_body(const Robot& robot, const std::vector<TargetFrame>& targets, double radius);

/// Frames in the base frame at joint values `q`: the base, then each link of the chain behind it, the tip last.
std::vector<Eigen::Isometry3d> link_frames(const Robot& robot, const Eigen::Ref<const Eigen::VectorXd>& q);

/// Sphere in the base frame. [m]
struct Sphere {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double radius = 0.0;
};

/// Distance between the segments a1 b1 and a2 b2 [m].
double segment_distance(const Eigen::Vector3d& a1, const Eigen::Vector3d& b1, const Eigen::Vector3d& a2,
                        const Eigen::Vector3d& b2);
/// Distance between the segment a b and a point.
double segment_distance(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& point);
/// Distance between the segment a b and a box, 0 where they meet.
double segment_distance(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Box& box);

/// A lower bound of the distance between the shapes in two capsules, with the poses of their links in one frame. The
/// distance of the capsules is enough where it reaches `enough`; closer boxes are taken as boxes.
double distance(const Capsule& first, const Eigen::Isometry3d& X_first, const Capsule& second,
                const Eigen::Isometry3d& X_second, double enough);

/// Pairs of capsules whose distance can be required to exceed `clearance` [m]. Their links are neither the same nor
/// neighbours, nor (the tool excepted) joined by axes through one point. They reach that distance in at least a tenth
/// of 500 seeded configurations within the joint limits: coarse capsules of close joints may overlap nearly everywhere.
std::vector<std::pair<std::size_t, std::size_t>> pairs_to_keep_apart(const Robot& robot,
                                                                     const std::vector<Capsule>& capsules,
                                                                     double clearance);

}  // namespace kdl_calibration
