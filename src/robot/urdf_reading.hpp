#pragma once

// Shared by reading and rewriting a URDF.

#include <fmt/core.h>
#include <tinyxml2.h>
#include <urdf_model/pose.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <kdl/frames.hpp>
#include <string>
#include <string_view>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {

/// Throws InputError with the line if the text is not UTF-8, by its bytes or by its stated encoding.
void require_utf8(std::string_view text, const std::string& source);

/// Parses into `document`; tinyxml2 bounds the depth. Throws InputError with the line of the first error.
inline void parse_xml(tinyxml2::XMLDocument& document, std::string_view text, const std::string& source) {
  require_utf8(text, source);
  if (document.Parse(text.data(), text.size()) == tinyxml2::XML_SUCCESS) {
    return;
  }
  if (document.ErrorID() == tinyxml2::XML_ERROR_EMPTY_DOCUMENT) {
    throw InputError(source + ": empty, expected a URDF");
  }
  const char* rule = document.ErrorID() == tinyxml2::XML_ELEMENT_DEPTH_EXCEEDED
                         ? "elements are nested too deeply, expected at most 100 levels"
                         : "malformed XML";
  const std::string name = document.ErrorName();
  throw InputError(fmt::format("{}:{}: {} ({})", source, document.ErrorLineNum(), rule, name));
}

/// Throws InputError, with the line and the remedy, for unexpanded xacro macros in links and joints. Shapes and masses
/// of links and extensions (gazebo) that contain macros are removed, as the geometry does not depend on them.
void refuse_xacro(tinyxml2::XMLElement& robot, const std::string& source);

inline KDL::Vector to_kdl(const urdf::Vector3& v) { return {v.x, v.y, v.z}; }

/// Keeps exact zeros and ones of rotations about x, y or z. One Newton step towards the nearest orthogonal matrix
/// removes the quaternion's rounding error, so that the result is orthonormal to 1e-15.
inline KDL::Rotation to_kdl(const urdf::Rotation& q) {
  Eigen::Matrix3d m = Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
  const Eigen::Matrix3d error = Eigen::Matrix3d::Identity() - m.transpose() * m;
  m += (0.5 * m * error).eval();
  return {m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2)};
}

inline KDL::Frame to_kdl(const urdf::Pose& pose) { return {to_kdl(pose.rotation), to_kdl(pose.position)}; }

}  // namespace kdl_calibration
