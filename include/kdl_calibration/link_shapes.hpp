#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// What a URDF says of the form of a link.
struct LinkShape {
  enum class Kind { box, cylinder, sphere, mesh };
  std::string link;
  Kind kind = Kind::mesh;
  Eigen::Isometry3d X_LS = Eigen::Isometry3d::Identity();  ///< the shape's frame in the link's
  /// [m] box: the edges along x, y, z; cylinder about z: radius, -, length; sphere: radius. Mesh: zero.
  Eigen::Vector3d size = Eigen::Vector3d::Zero();
};

/// The collision shapes of the chain's links, or where a link has none the visual ones, in the order of the URDF.
/// Throws InputError for a size that is no positive number and an origin that is no number.
std::vector<LinkShape> link_shapes(const Robot& robot);

/// The base link, then the link behind each joint of the chain, fixed ones included; the tip last.
std::vector<std::string> link_names(const Robot& robot);

}  // namespace kdl_calibration
