#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// A link's shape from the URDF.
struct LinkShape {
  enum class Kind { box, cylinder, sphere, mesh };
  std::string link;
  Kind kind = Kind::mesh;
  Eigen::Isometry3d X_LS = Eigen::Isometry3d::Identity();  ///< the shape's frame in the link frame
  /// [m] box: the edges along x, y, z; cylinder about z: radius, -, length; sphere: radius. Mesh: zero.
  Eigen::Vector3d size = Eigen::Vector3d::Zero();
};

/// The collision shapes of the chain's links, or the visual shapes of a link without them, in the order of the URDF.
/// Throws InputError for a size that is not positive or an origin that is not numeric.
std::vector<LinkShape> link_shapes(const Robot& robot);

}  // namespace kdl_calibration
