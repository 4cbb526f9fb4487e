#include <Eigen/LU>
#include <array>
#include <charconv>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "base/csv.hpp"
#include "base/decompositions.hpp"
#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/measurement_columns.hpp"
#include "measurements/measurements_check.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

template <typename Number>
void append_number(std::string& text, Number value) {
  std::array<char, 32> digits{};
  const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), value);
  text.append(digits.data(), end);
}

std::vector<std::string> csv_labels(const std::vector<std::string>& labels, const char* what,
                                    const std::string& source) {
  std::vector<std::string> fields;
  std::set<std::string> names;
  for (const std::string& label : labels) {
    if (!names.insert(label).second) {
      fail(source, std::string(what) + " " + shown(label) + " is there twice, expected each name once");
    }
    if (const std::string fault = label_fault(label); !fault.empty()) {
      fail(source, std::string(what) + " " + shown(label) + " " + fault);
    }
    fields.push_back(csv_field(label));
  }
  return fields;
}

/// The optional columns that the measurements use.
struct UsedColumns {
  bool split = false;
  bool repeat = false;
  bool sigma = false;
  bool quaternion = false;
  bool order = false;
  bool station = false;
  bool along = false;
  bool distance = false;
  std::vector<Eigen::Index> torques;             ///< joints with a known torque
  std::vector<Circumstance> circumstances = {};  ///< those that some configuration states
  std::vector<Eigen::Index> links = {};          ///< rows of link temperatures that are stated
};

/// Whether the measured coordinates are along axes of W.
bool is_by_axis(const Reading& reading) {
  const auto* const some = std::get_if<Coordinates>(&reading);
  return some == nullptr || (some->normal.array() != 0.0).count() == 1;
}

UsedColumns used_columns(const Measurements& measurements) {
  UsedColumns used;
  for (Eigen::Index j = 0; j < measurements.signals.torques.rows(); ++j) {
    if (has_torques(measurements.signals, j)) used.torques.push_back(j);
  }
  for (const Circumstance circumstance : {Circumstance::temperature, Circumstance::payload}) {
    if (is_stated(measurements.signals, circumstance)) used.circumstances.push_back(circumstance);
  }
  for (Eigen::Index link = 0; link < measurements.signals.link_temperatures.rows(); ++link) {
    if (!measurements.signals.link_temperatures.row(link).array().isNaN().all()) used.links.push_back(link);
  }
  for (const Observation& o : measurements.observations) {
    used.split = used.split || o.split == Split::test;
    used.repeat = used.repeat || o.repeat != 1;
    used.sigma = used.sigma || o.sigma > 0.0;
    used.order = used.order || o.order.has_value();
    used.quaternion = used.quaternion || has_orientation(o);
    used.along = used.along || !is_by_axis(o.reading);
    used.distance = used.distance || is_distance(o);
  }
  used.station = names_stations(measurements) || has_single_coordinates(measurements);
  return used;
}

JointUnit unit_of(const Measurements& measurements, std::size_t joint) {
  return measurements.joint_units.empty() ? JointUnit::unstated : measurements.joint_units[joint];
}

std::string joint_columns(const Measurements& measurements) {
  std::string text;
  const std::vector<std::string> names = csv_labels(measurements.joints, "joint", measurements.source);
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (is_fixed_column(measurements.joints[i])) {
      fail(measurements.source, "joint " + shown(names[i]) + " is named like a column of the measurements");
    }
    const JointUnit unit = unit_of(measurements, i);
    const char* in = unit == JointUnit::radian ? "[rad]" : unit == JointUnit::metre ? "[m]" : "";
    text += "," + csv_field(measurements.joints[i] + in);
  }
  return text;
}

std::string csv_header(const Measurements& measurements, const UsedColumns& used) {
  std::string text = "configuration";
  if (used.split) text += ",split";
  if (used.repeat) text += ",repeat";
  if (used.station) text += ",station";
  text += ",target" + joint_columns(measurements) + ",x[m],y[m],z[m]";
  if (used.along) text += ",n_x,n_y,n_z,along[m]";
  if (used.distance) text += ",distance[m]";
  if (used.quaternion) text += ",qw,qx,qy,qz";
  if (used.sigma) text += ",sigma[m]";
  if (used.order) text += ",order";
  for (const Eigen::Index j : used.torques) {
    const auto joint = static_cast<std::size_t>(j);
    const JointUnit unit = unit_of(measurements, joint);
    const char* in = unit == JointUnit::radian ? "[Nm]" : unit == JointUnit::metre ? "[N]" : "";
    text += "," + csv_field("tau_" + measurements.joints[joint] + in);
  }
  for (const Circumstance circumstance : used.circumstances) {
    text += circumstance == Circumstance::temperature ? ",temperature[degC]" : ",payload[kg]";
  }
  for (const Eigen::Index link : used.links) {
    text += "," + csv_field("temperature_" + measurements.signals.links[static_cast<std::size_t>(link)] + "[degC]");
  }
  return text + "\n";
}

/// Appends cells to a row, empty ones for unknown values.
class Cells {
public:
  explicit Cells(std::string& text) : text_(text) {}

  template <typename Number>
  void add(Number value, bool known = true) {
    text_ += ',';
    if (known) append_number(text_, value);
  }

  template <typename Numbers>
  void add_each(const Numbers& values, bool known = true) {
    for (const double value : values) add(value, known);
  }

private:
  std::string& text_;
};

void add_reading(const Measurements& measurements, std::size_t row, const UsedColumns& used, Cells& cells) {
  const Reading& reading = measurements.observations[row].reading;
  const Eigen::Vector3d& z = measurements.observations[row].position();
  const auto* const some = std::get_if<Coordinates>(&reading);
  const bool by_axis = is_by_axis(reading);
  const Eigen::Matrix3d P = some == nullptr ? Eigen::Matrix3d::Identity() : directions(*some);
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    cells.add(z[axis], by_axis && P(axis, axis) > 0.5);
  }
  if (!by_axis && some->count > 1) {
    fail(measurements.source, "observation " + std::to_string(row) +
                                  " has two coordinates that are not along x, y and z, expected one along a direction");
  }
  if (used.along) {
    const Eigen::Vector3d n = by_axis ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : some->normal;
    cells.add_each(n, !by_axis);
    cells.add(n.dot(z), !by_axis);
  }
  if (used.distance) {
    const auto* const distance = std::get_if<Distance>(&reading);
    cells.add(distance == nullptr ? 0.0 : distance->length, distance != nullptr);
  }
}

}  // namespace

std::string measurements_csv(const Measurements& measurements) {
  check(measurements);
  require_count("names of joints", measurements.joints.size(), measurements.joint_values.rows());
  const UsedColumns used = used_columns(measurements);
  std::string text = csv_header(measurements, used);
  const auto configurations = csv_labels(measurements.configurations, "configuration", measurements.source);
  const auto targets = csv_labels(measurements.targets, "target", measurements.source);
  const auto stations = csv_labels(measurements.stations, "station", measurements.source);
  csv_labels(measurements.signals.links, "link", measurements.source);
  Cells cells(text);
  for (std::size_t i = 0; i < measurements.observations.size(); ++i) {
    const Observation& o = measurements.observations[i];
    text += configurations[static_cast<std::size_t>(o.configuration)];
    if (used.split) text += o.split == Split::test ? ",test" : ",train";
    if (used.repeat) cells.add(o.repeat);
    if (used.station) text += "," + stations[station_of(o)];
    text += "," + targets[static_cast<std::size_t>(o.target)];
    cells.add_each(measurements.joint_values.col(o.configuration));
    add_reading(measurements, i, used, cells);
    if (used.quaternion) {
      const Orientation q = has_orientation(o) ? *o.orientation() : Orientation(1.0, 0.0, 0.0, 0.0);
      cells.add_each(std::array{q.w(), q.x(), q.y(), q.z()}, has_orientation(o));
    }
    if (used.sigma) cells.add(o.sigma, o.sigma > 0.0);
    if (used.order) cells.add(*o.order);
    for (const Eigen::Index j : used.torques) {
      const double torque = measurements.signals.torques(j, o.configuration);
      cells.add(torque, !std::isnan(torque));
    }
    for (const Circumstance circumstance : used.circumstances) {
      const double value = measurements.signals.circumstances(static_cast<Eigen::Index>(circumstance), o.configuration);
      cells.add(value, !std::isnan(value));
    }
    for (const Eigen::Index link : used.links) {
      const double value = measurements.signals.link_temperatures(link, o.configuration);
      cells.add(value, !std::isnan(value));
    }
    text += '\n';
  }
  return text;
}

std::string measurements_csv(const Robot& robot, const Measurements& measurements, const JointConvention& convention) {
  check(measurements);
  if (measurements.signals.torques.size() > 0) {
    fail(measurements.source, "torques belong to the URDF's joints, expected none beside a joint convention");
  }
  const JointConvention matched = matched_convention(convention, independent_joint_names(robot.joints));
  const std::vector<std::size_t> independent = independent_joints(robot.joints);
  Measurements counted = measurements;
  counted.joints = matched.controller_joints;
  counted.joint_values = solution(
      matched.matrix, independent_joint_values(robot.joints, measurements.joint_values).colwise() - matched.offset);
  counted.joint_units.assign(counted.joints.size(), JointUnit::radian);
  for (std::size_t j = 0; j < counted.joints.size(); ++j) {
    for (std::size_t i = 0; i < independent.size(); ++i) {
      const bool slides = robot.joints[independent[i]].type == JointType::prismatic;
      if (slides && matched.matrix(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) != 0.0) {
        counted.joint_units[j] = JointUnit::metre;
      }
    }
  }
  counted.signals = {};
  return measurements_csv(counted);
}

}  // namespace kdl_calibration
