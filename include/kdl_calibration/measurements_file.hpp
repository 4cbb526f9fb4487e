#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Reads measurements (CSV, see the README). `urdf_joints` are the moving joints of the chain, base to tip. Joint
/// columns bear either those names or, where a convention is given, the controller's and nothing else.
///
/// UTF-8 with or without byte order mark, commas, semicolons or tabs (the header tells), LF or CRLF, quoted fields
/// within one line; decimal commas where no commas separate. Lines that start with # and lines without any value are
/// skipped. Units stand in the header, in [] or (), or in a row of their own below it: rad, deg, °, degrees, m, mm.
/// Columns and joints are found in upper and lower case where one name alone fits; name and point are read as target,
/// pose and config as configuration. `remark` says how the file differs from one of measurements_csv.
///
/// Orientations of targets, R = Rz(yaw) Ry(pitch) Rx(roll), come in one of five forms: qw, qx, qy, qz (normalised);
/// rx, ry, rz (angle times axis); roll, pitch, yaw; A, B, C (KUKA: yaw, pitch, roll) and W, P, R (FANUC: roll, pitch,
/// yaw), both of these with units. An empty cell is allowed in the optional columns: split (train), repeat (1), sigma
/// (none stated) and an orientation (all of it empty: a point). Limits: 16 GiB, lines of 1 MiB, 10,000 columns, 100
/// targets; read piece by piece, never held whole.
///
/// Throws InputError naming file, line, column, value and rule: an unreadable file, text that is not UTF-8, a missing,
/// unknown or repeated column, an unknown unit, a ragged row, a value that is no finite number or beyond 1e12, decimal
/// points beside decimal commas, a sigma below 1e-15 m, a quaternion whose norm is off 1 by more than 1e-3, angles
/// without a unit beyond a turn, two forms of orientation or part of one, two rows for the same configuration, repeat
/// and target, joint values or a split that differ within one configuration, no row at all.
Measurements read_measurements(const std::filesystem::path& file, const std::vector<std::string>& urdf_joints,
                               const JointConvention* convention = nullptr);
Measurements parse_measurements(std::string_view csv, const std::vector<std::string>& urdf_joints,
                                const JointConvention* convention = nullptr,
                                const std::string& source = "measurements");

/// The same for a robot some of whose joints mimic others: the columns of followers (see Mimic), under the URDF's names
/// even behind a convention, are optional, and the convention is one of the independent joints alone. A follower's
/// column that differs from what its leader says by more than 1e-5 (1 + |multiplier|) rad or m (two values rounded to
/// the third decimal of a degree or the fifth of a metre) is refused, too.
Measurements read_measurements(const Robot& robot, const std::filesystem::path& file,
                               const JointConvention* convention = nullptr);
Measurements parse_measurements(const Robot& robot, std::string_view csv, const JointConvention* convention = nullptr,
                                const std::string& source = "measurements");

/// Reads configurations from a plan or from measurements. Coordinates may be empty here, and the columns
/// `configuration` (then counted), `target`, x, y and z may be absent.
/// Throws InputError as read_measurements does.
Measurements read_configurations(const std::filesystem::path& file, const std::vector<std::string>& urdf_joints,
                                 const JointConvention* convention = nullptr);
Measurements parse_configurations(std::string_view csv, const std::vector<std::string>& urdf_joints,
                                  const JointConvention* convention = nullptr, const std::string& source = "plan");
/// The same for a robot some of whose joints may mimic others, see read_measurements.
Measurements read_configurations(const Robot& robot, const std::filesystem::path& file,
                                 const JointConvention* convention = nullptr);

/// The CSV that read_measurements reads back to the same doubles; joint values in the URDF's convention. Columns
/// split, repeat, quaternion and sigma appear only where the measurements use them, and a joint's unit only where
/// `joint_units` knows it (the others are SI by default). Rows are in the order of the observations; configurations
/// and targets without observations are lost. All values must be finite.
/// Throws InputError for what the format cannot hold: an empty label, one with control characters or not in UTF-8,
/// a joint named like another column (x, target, ...).
std::string measurements_csv(const Measurements& measurements);

}  // namespace kdl_calibration
