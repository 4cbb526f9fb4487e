#include "robot/link_shapes.hpp"

#include <tinyxml2.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>
#include <system_error>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/urdf_reading.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

// Parses numbers separated by blanks, in any locale.
template <int kSize>
Eigen::Matrix<double, kSize, 1> numbers(const char* text, const std::string& where) {
  std::string_view rest = text == nullptr ? "" : text;
  Eigen::Matrix<double, kSize, 1> values;
  for (int i = 0; i < kSize; ++i) {
    rest.remove_prefix(std::min(rest.find_first_not_of(" \t\r\n+"), rest.size()));
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), values[i]);
    if (error != std::errc() || !std::isfinite(values[i])) {
      throw InputError(where + ": expected " + std::to_string(kSize) + " finite numbers");
    }
    rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
  }
  return values;
}

Isometry3d origin_of(const tinyxml2::XMLElement& shape, const std::string& where) {
  Isometry3d X = Isometry3d::Identity();
  if (const tinyxml2::XMLElement* origin = shape.FirstChildElement("origin")) {
    if (const char* xyz = origin->Attribute("xyz")) {
      X.translation() = numbers<3>(xyz, where + ": xyz");
    }
    if (const char* rpy = origin->Attribute("rpy")) {
      const Vector3d angles = numbers<3>(rpy, where + ": rpy");
      X.linear() = (Eigen::AngleAxisd(angles.z(), Vector3d::UnitZ()) *
                    Eigen::AngleAxisd(angles.y(), Vector3d::UnitY()) * Eigen::AngleAxisd(angles.x(), Vector3d::UnitX()))
                       .toRotationMatrix();
    }
  }
  return X;
}

LinkShape shape_of(const tinyxml2::XMLElement& element, const std::string& where) {
  LinkShape shape;
  const tinyxml2::XMLElement* geometry = element.FirstChildElement("geometry");
  if (geometry == nullptr) {
    return shape;
  }
  const auto positive = [&](const auto& values) {
    if (!(values.array() > 0.0).all()) {
      throw InputError(where + ": expected a shape with positive sizes");
    }
    return values;
  };
  if (const auto* box = geometry->FirstChildElement("box")) {
    shape.kind = LinkShape::Kind::box;
    shape.size = positive(numbers<3>(box->Attribute("size"), where + ": box size"));
  } else if (const auto* cylinder = geometry->FirstChildElement("cylinder")) {
    shape.kind = LinkShape::Kind::cylinder;
    shape.size.x() = positive(numbers<1>(cylinder->Attribute("radius"), where + ": cylinder radius"))[0];
    shape.size.z() = positive(numbers<1>(cylinder->Attribute("length"), where + ": cylinder length"))[0];
  } else if (const auto* sphere = geometry->FirstChildElement("sphere")) {
    shape.kind = LinkShape::Kind::sphere;
    shape.size.x() = positive(numbers<1>(sphere->Attribute("radius"), where + ": sphere radius"))[0];
  }
  if (shape.kind != LinkShape::Kind::mesh) {
    shape.X_LS = origin_of(element, where);
  }
  return shape;
}

}  // namespace

std::vector<LinkShape> link_shapes(const Robot& robot) {
  tinyxml2::XMLDocument document;
  parse_xml(document, robot.urdf, robot.source);
  const std::vector<std::string> names = link_names(robot);
  std::vector<LinkShape> shapes;
  for (const auto* link = document.FirstChildElement("robot")->FirstChildElement("link"); link != nullptr;
       link = link->NextSiblingElement("link")) {
    const std::string name = link->Attribute("name") == nullptr ? "" : link->Attribute("name");
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      continue;
    }
    const char* kind = link->FirstChildElement("collision") != nullptr ? "collision" : "visual";
    std::string where = robot.source;
    where.append(": ").append(kind).append(" of link ").append(in_quotes(name));
    for (const auto* shape = link->FirstChildElement(kind); shape != nullptr; shape = shape->NextSiblingElement(kind)) {
      shapes.push_back(shape_of(*shape, where));
      shapes.back().link = name;
    }
  }
  return shapes;
}

}  // namespace kdl_calibration
