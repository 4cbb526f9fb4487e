#include "results/kinematic_formats.hpp"

#include <fmt/core.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <type_traits>
#include <utility>

#include "base/csv.hpp"
#include "base/number_text.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/parameters.hpp"
#include "robot/chain_to_dh.hpp"
#include "robot/opw.hpp"
#include "robot/ur_calibration.hpp"
#include "robot/urdf_correction.hpp"

namespace kdl_calibration {
namespace {

std::string comment_line(const std::string& note) { return note.empty() ? "" : "# " + note + "\n"; }

/// YAML takes 1e-05 for text, 1.0e-05 for a number.
std::string yaml_number(double value) {
  std::string text = shortest(value);
  const std::size_t exponent = text.find('e');
  return exponent == std::string::npos || text.find('.') < exponent ? text : text.insert(exponent, ".0");
}

/// ROS 2 does not take 0 for a number with a fraction.
std::string yaml_double(double value) {
  const std::string text = yaml_number(value);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

template <class Values>
std::string yaml_list(const Values& values) {
  std::string text;
  for (const auto value : values) {
    text +=
        (text.empty() ? "[" : ", ") + (std::is_integral_v<decltype(value)> ? yaml_number(value) : yaml_double(value));
  }
  return text + "]";
}

/// x, y, z, roll, pitch, yaw of a joint's origin in its parent link.
std::array<double, 6> origin_numbers(const KDL::Segment& segment) {
  const KDL::Frame origin = segment.pose(0.0);
  const auto [roll, pitch, yaw] = rpy_of(origin.M);
  return {origin.p.x(), origin.p.y(), origin.p.z(), roll, pitch, yaw};
}

}  // namespace

std::string dh_export(const Robot& robot, DhConvention convention, const std::string& note) {
  const DhTable table = dh_table_of(robot, convention);
  const Robot again = parse_robot(dh_urdf(parse_dh_table(dh_json(table))));
  return dh_json(table, note, largest_difference(robot, again));
}

std::string xacro_yaml(const Robot& robot, const std::string& note) {
  std::string text = comment_line(note);
  for (const KDL::Segment& segment : robot.chain.segments) {
    const auto [x, y, z, roll, pitch, yaw] = origin_numbers(segment);
    text += fmt::format("{}: {{xyz: \"{} {} {}\", rpy: \"{} {} {}\"}}\n",
                        nlohmann::json(segment.getJoint().getName()).dump(), shortest(x), shortest(y), shortest(z),
                        shortest(roll), shortest(pitch), shortest(yaw));
  }
  return text;
}

std::string opw_yaml(const Robot& robot, const std::string& note) {
  const OpwParameters opw = opw_parameters_of(robot);
  std::string text = comment_line(note) + "opw_kinematics_geometric_parameters:\n";
  const std::vector<std::pair<const char*, double>> lengths = {
      {"a1", opw.a1}, {"a2", opw.a2}, {"b", opw.b}, {"c1", opw.c1}, {"c2", opw.c2}, {"c3", opw.c3}, {"c4", opw.c4}};
  for (const auto& [name, length] : lengths) {
    text += fmt::format("  {}: {}\n", name, yaml_double(length));
  }
  text += "opw_kinematics_joint_offsets: " + yaml_list(opw.offsets) +
          "\nopw_kinematics_joint_sign_corrections: " + yaml_list(opw.signs) + "\n";
  text += "# The plugin knows neither frame: pose of the tip = base * (OPW kinematics) * tip.\n";
  for (const auto& [name, frame] : {std::pair{"base", opw.base}, std::pair{"tip", opw.tip}}) {
    const Eigen::Isometry3d X = to_eigen(frame);
    const Eigen::Quaterniond turn(X.linear());
    text += fmt::format("{}: {{position: {}, quaternion_wxyz: {}}}\n", name, yaml_list(X.translation()),
                        yaml_list(Eigen::Vector4d(turn.w(), turn.x(), turn.y(), turn.z())));
  }
  return text;
}

std::string ur_yaml(const Robot& nominal, const Robot& calibrated, const std::string& note) {
  constexpr double kRounding = 1e-12;
  require_ur_description(calibrated);
  if (!KDL::Equal(nominal.tip_origin, calibrated.tip_origin, kRounding)) {
    throw InputError(
        calibrated.source +
        ": errors stand behind the last joint, where these kinematics have no place: " + "expected another format");
  }
  std::string text = comment_line(note) + "kinematics:\n";
  std::size_t link = 0;
  for (const KDL::Segment& segment : calibrated.chain.segments) {
    if (segment.getJoint().getType() == KDL::Joint::Fixed) {
      continue;
    }
    text += fmt::format("  {}:\n", kUrLinks[link++]);
    const std::array<double, 6> numbers = origin_numbers(segment);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      text += fmt::format("    {}: {}\n", kUrNumbers[i], yaml_number(numbers[i]));
    }
  }
  // The driver compares it with that of the robot, and says that this is another one, which is true.
  return text + "  hash: kdl_calibration_" + sha256(calibrated.urdf).substr(0, 16) + "\n";
}

std::string parameters_csv(const ErrorModel& model, const Eigen::VectorXd& errors,
                           const std::vector<ParameterEstimate>& estimates, const std::string& note) {
  std::string csv = comment_line(note) + "parameter,joint,kind,axis,unit,nominal,value,error,std\n";
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const ErrorParameter& parameter = model.parameters[p];
    const double error = errors[static_cast<Eigen::Index>(p)];
    const auto estimate = std::find_if(estimates.begin(), estimates.end(),
                                       [&](const ParameterEstimate& e) { return e.name == parameter.name; });
    if (estimate == estimates.end() && error == 0.0) {
      continue;
    }
    const bool known = estimate != estimates.end() && estimate->error == error && std::isfinite(estimate->std);
    csv += fmt::format("{},{},{},{},{},{},{},{},{}\n", parameter.name, csv_field(parameter.joint),
                       to_string(parameter.kind), parameter.axis == 'q' ? "" : std::string(1, parameter.axis),
                       is_length(model, parameter) ? "m" : "rad", shortest(parameter.nominal),
                       shortest(parameter.nominal + error), shortest(error), known ? shortest(estimate->std) : "");
  }
  return csv;
}

}  // namespace kdl_calibration
