#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Reads measurements (CSV, see the README). `urdf_joints` are the moving joints of the chain, base to tip. Joint
/// columns are named by these or, with a convention, by the controller's joints only.
///
/// UTF-8 with or without byte order mark, comma, semicolon or tab as in the header, LF or CRLF, quoted fields within
/// one line; decimal commas if the separator is no comma. Lines that start with # and lines without any value are
/// skipped. Units are in the header, in [] or (), or in a separate row below it: rad, deg, °, degrees, m, mm. Names of
/// columns and joints ignore case if the match is unique. `name` and `point` mean target, `pose` and `config`
/// configuration. `remark` says how the file differs from one of measurements_csv.
///
/// Orientations of targets, R = Rz(yaw) Ry(pitch) Rx(roll), come in one of five forms: qw, qx, qy, qz (normalised); rx,
/// ry, rz (angle times axis); roll, pitch, yaw; A, B, C (KUKA: yaw, pitch, roll) and W, P, R (FANUC: roll, pitch, yaw),
/// the last two with units. An empty cell is allowed in the optional columns: split (train), repeat (1), sigma (none
/// stated) and an orientation (if all its cells are empty). Limits: 16 GiB, lines of 1 MiB, 10,000 columns, 100
/// targets; the file is read in pieces.
///
/// Throws InputError naming file, line, column, value and rule: an unreadable file, text that is not UTF-8, a missing,
/// unknown or repeated column, an unknown unit, a ragged row, a value that is not a finite number or beyond 1e12,
/// decimal points beside decimal commas, a sigma below 1e-15 m, a quaternion norm off 1 by more than 1e-3, angles
/// without unit beyond one turn, two forms of orientation or an incomplete one, two rows for the same configuration,
/// repeat and target, joint values or a split that differ within one configuration, no rows.
Measurements read_measurements(const std::filesystem::path& file, const std::vector<std::string>& urdf_joints,
                               const JointConvention* convention = nullptr);
Measurements parse_measurements(std::string_view csv, const std::vector<std::string>& urdf_joints,
                                const JointConvention* convention = nullptr,
                                const std::string& source = "measurements");

/// The same for a robot with mimic joints. Columns of followers (see Mimic) are optional and have the URDF's names; a
/// convention covers only independent joints. Also refused: a follower's value that differs from its leader's by more
/// than 1e-5 (1 + |multiplier|) rad or m (values rounded to 0.001 degrees or 0.01 mm).
Measurements read_measurements(const Robot& robot, const std::filesystem::path& file,
                               const JointConvention* convention = nullptr);
Measurements parse_measurements(const Robot& robot, std::string_view csv, const JointConvention* convention = nullptr,
                                const std::string& source = "measurements");

/// Reads configurations from a plan or from measurements. Coordinates may be empty. The columns `configuration` (then
/// numbered), `target`, x, y and z may be absent.
/// Throws InputError as read_measurements does.
Measurements read_configurations(const std::filesystem::path& file, const std::vector<std::string>& urdf_joints,
                                 const JointConvention* convention = nullptr);
Measurements parse_configurations(std::string_view csv, const std::vector<std::string>& urdf_joints,
                                  const JointConvention* convention = nullptr, const std::string& source = "plan");
/// The same for a robot with mimic joints, see read_measurements.
Measurements read_configurations(const Robot& robot, const std::filesystem::path& file,
                                 const JointConvention* convention = nullptr);

/// The CSV that read_measurements reads back to the same doubles; joint values in the URDF's convention. Columns split,
/// repeat, quaternion and sigma appear only where the measurements use them, and a joint's unit only if stated in
/// `joint_units` (default SI). Rows are in the order of the observations; configurations and targets without
/// observations are omitted. All values must be finite.
/// Throws InputError for names that the format cannot represent: an empty label, one with control characters or not in
/// UTF-8, a joint named like another column (x, target,...).
std::string measurements_csv(const Measurements& measurements);

}  // namespace kdl_calibration
