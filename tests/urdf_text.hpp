#pragma once

#include <string>
#include <vector>

/// A URDF from its parts.
namespace kdl_calibration::testing::urdf {

inline std::string robot_of(const std::string& content) { return "<robot name='r'>" + content + "</robot>"; }

inline std::string links(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) {
    text += "<link name='" + name + "'/>";
  }
  return text;
}

inline std::string joint(const std::string& name, const std::string& type, const std::string& parent,
                         const std::string& child, const std::string& content = "") {
  return "<joint name='" + name + "' type='" + type + "'><parent link='" + parent + "'/><child link='" + child + "'/>" +
         content + "</joint>";
}

/// "lower:upper"
inline std::string limit(const std::string& range) {
  const std::size_t colon = range.find(':');
  return "<limit lower='" + range.substr(0, colon) + "' upper='" + range.substr(colon + 1) +
         "' velocity='1' effort='1'/>";
}

/// Where this joint of it follows another one: joint="elbow" multiplier="2".
inline std::string with_mimic(std::string urdf, const std::string& joint, const std::string& mimic) {
  return urdf.insert(urdf.find("</joint>", urdf.find("<joint name=\"" + joint + "\"")), "<mimic " + mimic + "/>");
}

struct Part {
  std::string type;
  std::string content;
};

/// Links l0, l1, ... of which each bears the next one by a joint j1, j2, ...
inline std::string serial(const std::vector<Part>& joints) {
  std::string text = links({"l0"});
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const std::string below = std::to_string(i);
    const std::string number = std::to_string(i + 1);
    text += links({"l" + number}) + joint("j" + number, joints[i].type, "l" + below, "l" + number, joints[i].content);
  }
  return robot_of(text);
}

/// A joint's origin and axis, and its type where it is not that of the others.
struct JointAt {
  std::string xyz, rpy = "0 0 0", axis = "0 0 1", type = "";
};

/// The same, of joints with these limits that are of this type unless they state another.
inline std::string serial_of(const std::vector<JointAt>& joints, const std::string& type, const std::string& range) {
  std::vector<Part> parts;
  for (const JointAt& j : joints) {
    parts.push_back({j.type.empty() ? type : j.type,
                     "<origin xyz='" + j.xyz + "' rpy='" + j.rpy + "'/><axis xyz='" + j.axis + "'/>" + limit(range)});
  }
  return serial(parts);
}

}  // namespace kdl_calibration::testing::urdf
