// Robots and joint conventions.

#include "kdl_calibration/robot.hpp"

#include <pybind11/stl.h>

#include <limits>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/kinematic_export.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/file_names.hpp"

namespace kdl_calibration::python {

using namespace pybind11::literals;

namespace {

// (n, 2), infinite where the URDF states no limit.
py::array limits(const Robot& robot) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  Doubles result({robot.joints.size(), std::size_t{2}});
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    const auto row = static_cast<py::ssize_t>(i);
    result.mutable_at(row, 0) = robot.joints[i].lower.value_or(-kNone);
    result.mutable_at(row, 1) = robot.joints[i].upper.value_or(kNone);
  }
  return result;
}

std::vector<std::string> joint_types(const Robot& robot) {
  std::vector<std::string> types;
  for (const MovingJoint& joint : robot.joints) {
    types.emplace_back(joint.type == JointType::prismatic    ? "prismatic"
                       : joint.type == JointType::continuous ? "continuous"
                                                             : "revolute");
  }
  return types;
}

std::string robot_text(const Robot& robot) {
  return "<Robot '" + robot.name + "', " + std::to_string(robot.joints.size()) + " moving joints, " + robot.base +
         " to " + robot.tip + ">";
}

using RobotPointer = std::shared_ptr<Robot>;

RobotPointer shared(Robot robot) { return std::make_shared<Robot>(std::move(robot)); }

void bind_convention(py::module_& module) {
  py::class_<JointConvention>(module, "JointConvention",
                              "How a controller counts its joints: q_urdf = matrix @ q_controller + offset.")
      .def_readonly("name", &JointConvention::name)
      .def_readonly("controller_joints", &JointConvention::controller_joints)
      .def_readonly("urdf_joints", &JointConvention::urdf_joints)
      .def_property_readonly(
          "matrix",
          [](const JointConvention& convention) -> py::object {
            return transposed_view(convention.matrix, py::none()).attr("T").attr("copy")();
          },
          "(m, m)")
      .def_property_readonly(
          "offset",
          [](const JointConvention& convention) {
            return Doubles({convention.offset.size()}, convention.offset.data());
          },
          "(m,) [rad or m]");
  module.def("read_joint_convention", &read_joint_convention, "file"_a,
             "Reads a joint convention (JSON). Raises InputError for a bad file.");
}

}  // namespace

void bind_robot(py::module_& module) {
  py::class_<Robot, RobotPointer>(module, "Robot", "The nominal robot: one serial chain of a URDF.")
      .def_readonly("name", &Robot::name)
      .def_property_readonly(
          "source", [](const Robot& robot) { return file_name(robot.source); }, "File name, for messages.")
      .def_readonly("urdf", &Robot::urdf, "The text of the URDF.")
      .def_readonly("base", &Robot::base, "Link.")
      .def_readonly("tip", &Robot::tip, "Link: the flange.")
      .def_property_readonly("joints", &joint_names, "Names of the n moving joints, base to tip.")
      .def_property_readonly("joint_types", &joint_types, "'revolute', 'continuous' or 'prismatic'.")
      .def_property_readonly("limits", &limits, "(n, 2) lower and upper limit [rad or m]; infinite if there is none.")
      .def("__repr__", &robot_text)
      .def(py::pickle(
          [](const Robot& robot) { return py::make_tuple(robot.urdf, robot.base, robot.tip, file_name(robot.source)); },
          [](const py::tuple& state) {
            return shared(parse_robot(state[0].cast<std::string>(),
                                      {.base = state[1].cast<std::string>(), .tip = state[2].cast<std::string>()},
                                      bytes_of_name(state[3])));
          }));
  module.def(
      "load_robot",
      [](const std::filesystem::path& file, std::string base, std::string tip) {
        return shared(load_robot(std::filesystem::absolute(file), {.base = std::move(base), .tip = std::move(tip)}));
      },
      "file"_a, "base"_a = "", "tip"_a = "",
      "Reads a URDF. base, tip: links; without them the root link, and the only leaf, else tool0, else flange.\n\n"
      "Raises InputError for an unreadable file and a URDF without such a chain.");
  module.def(
      "parse_robot",
      [](const std::string& urdf, std::string base, std::string tip, const py::str& source) {
        return shared(parse_robot(urdf, {.base = std::move(base), .tip = std::move(tip)}, bytes_of_name(source)));
      },
      "urdf"_a, "base"_a = "", "tip"_a = "", "source"_a = "URDF", "The same from the text of a URDF.");
  module.def(
      "load_dh_robot",
      [](const std::filesystem::path& file, std::string base, std::string tip) {
        return shared(load_dh_robot(std::filesystem::absolute(file), {.base = std::move(base), .tip = std::move(tip)}));
      },
      "file"_a, "base"_a = "", "tip"_a = "",
      "Reads a table of Denavit-Hartenberg parameters, CSV or JSON. Raises InputError for a bad table.");
  bind_convention(module);
}

}  // namespace kdl_calibration::python
