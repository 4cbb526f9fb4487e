#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// The rows of DriveSignals::circumstances.
enum class Circumstance : std::uint8_t { temperature, payload };
constexpr Eigen::Index kCircumstances = 2;
/// "temperature", "payload".
const char* to_string(Circumstance circumstance);

/// Mean over the configurations `which` are true for, and its least and largest value; NaN if none states it.
struct CircumstanceRange {
  double mean = std::numeric_limits<double>::quiet_NaN();
  double lower = std::numeric_limits<double>::quiet_NaN();
  double upper = std::numeric_limits<double>::quiet_NaN();
};
CircumstanceRange range_of(const DriveSignals& signals, Circumstance circumstance, const std::vector<bool>& which);
/// The same of a row of DriveSignals::link_temperatures.
CircumstanceRange range_of_link(const DriveSignals& signals, Eigen::Index link, const std::vector<bool>& which);

/// Whether some configuration states it.
bool is_stated(const DriveSignals& signals, Circumstance circumstance);
/// The same, where a temperature of one link is enough.
bool is_stated_of_any_link(const DriveSignals& signals, Circumstance circumstance);

/// The row of DriveSignals::link_temperatures that states the temperature of a rigid body, given the names of its
/// links; none: it has no temperature of its own.
std::optional<Eigen::Index> row_of_link(const DriveSignals& signals, const std::vector<std::string>& links);
/// Whether the body has a temperature of its own or the arm has one.
bool has_temperature(const DriveSignals& signals, const std::vector<std::string>& links);

/// Error message if `named` are no links of the chain (`known`, base to tip), or two are of one rigid body; empty if
/// they are. Without `known` any names are accepted.
std::string fault_of_links(const std::vector<std::string>& named, const std::vector<std::string>& known,
                           const std::vector<MovingJoint>& joints);

/// Whether the joint's torque was measured in some configuration.
bool has_torques(const DriveSignals& signals, Eigen::Index joint);

/// Least and largest possible value [degC or kg].
std::pair<double, double> possible_range(Circumstance circumstance);

/// Error message if the signals do not fit the joint values (joints x N), naming `what` they belong to; empty if they
/// fit.
std::string fault_of(const DriveSignals& signals, const Eigen::MatrixXd& joint_values, const std::string& what = "");

/// The signals of these configurations, in this order.
DriveSignals columns(const DriveSignals& signals, const std::vector<Eigen::Index>& which);
/// The signals of one configuration.
DriveSignals column(const DriveSignals& signals, Eigen::Index which);

/// The signals of `first`, then those of `second`. A signal that only one of them has is dropped, and so is the
/// temperature of a link.
DriveSignals side_by_side(const DriveSignals& first, const DriveSignals& second);

/// Joint values (joints x N) and their signals.
struct DrivenConfigurations {
  Eigen::MatrixXd joint_values;
  DriveSignals signals;
  std::vector<std::int16_t> stations = {};  ///< of each configuration; none: each station measures its share
};

/// The sign of each joint's last motion of more than 1e-6 rad or m on the way from stop to stop (`stops`: joints x N):
/// joints x N, NaN before the joint has moved for the first time.
Eigen::MatrixXd directions_of_motion(const Eigen::MatrixXd& stops);

}  // namespace kdl_calibration
