#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

enum class Split : std::uint8_t { train, test };

/// The unit that a joint's values are known to have; unstated values are taken as rad or m, as the joint's type says.
enum class JointUnit : std::uint8_t { unstated, radian, metre };

/// One measured point (or pose, see Measurements::orientations) of one target in one configuration.
struct Observation {
  Eigen::Vector3d position;        ///< [m] in the measuring device's frame W
  double sigma = 0.0;              ///< [m] 1 sigma per coordinate; 0 where the file states none
  std::int32_t configuration = 0;  ///< column of Measurements::joint_values
  std::int32_t target = 0;         ///< index into Measurements::targets
  std::int32_t repeat = 1;         ///< observations of one configuration with the same repeat were taken together
  Split split = Split::train;
};

/// What was measured. Configurations and targets are numbered in their order of first appearance.
struct Measurements {
  std::string source;                       ///< file name, for messages
  std::vector<std::string> joints;          ///< URDF names of the moving joints, base to tip
  Eigen::MatrixXd joint_values;             ///< joints x configurations, in the URDF's convention [rad] or [m]
  std::vector<std::string> configurations;  ///< labels
  std::vector<std::string> targets;         ///< names of the points on the tool
  std::vector<Observation> observations;    ///< in the order of the file
  /// Empty where only points were measured, else one per observation: orientation of the target's frame in W.
  /// An observation that measured a point alone holds NaN in all four coefficients.
  std::vector<Eigen::Quaterniond> orientations;
  /// Empty where nothing is known, else one per joint. The reader fills it from the header's units where the columns
  /// bear the URDF's joint names, and leaves it empty behind a joint convention.
  std::vector<JointUnit> joint_units;
};

/// How a controller's joint values become the URDF's: q_urdf = matrix * q_controller + offset [rad or m].
struct JointConvention {
  std::string name;                            ///< file name, for messages
  std::vector<std::string> controller_joints;  ///< m names
  std::vector<std::string> urdf_joints;        ///< m names
  Eigen::MatrixXd matrix;                      ///< m x m, invertible
  Eigen::VectorXd offset;                      ///< m
};

/// Reads a convention (JSON, see the README). Throws InputError: unreadable file, malformed JSON, missing or unknown
/// key, wrong size, a name twice, a number that is not finite, a singular matrix.
JointConvention read_joint_convention(const std::filesystem::path& file);
JointConvention parse_joint_convention(std::string_view json, const std::string& source = "joint convention");

/// The convention with its rows ordered as `urdf_joints`. Throws InputError where the names do not match.
JointConvention matched_convention(const JointConvention& convention, const std::vector<std::string>& urdf_joints);

/// Reads measurements (CSV, see the README). `urdf_joints` are the moving joints of the chain, base to tip. Joint
/// columns bear either those names or, where a convention is given, the controller's and nothing else.
///
/// UTF-8 with or without byte order mark, commas or semicolons (the header tells), LF or CRLF, quoted fields within one
/// line. Lines that start with # and lines without any value are skipped. An empty cell is allowed in the optional
/// columns: split (train), repeat (1), sigma (none stated) and the quaternion (all four empty: a point). Quaternions
/// are normalised. Limits: 16 GiB, lines of 1 MiB, 10,000 columns, 100 targets; read piece by piece, never held whole.
///
/// Throws InputError naming file, line, column, value and rule: an unreadable file, text that is not UTF-8, a missing,
/// unknown or repeated column, an unknown unit, a ragged row, a value that is no finite number (decimal commas are
/// refused) or beyond 1e12, a sigma below 1e-15 m, a quaternion whose norm is off 1 by more than 1e-3, two rows for the
/// same configuration, repeat and target, joint values or a split that differ within one configuration, no row at all.
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

/// The CSV that read_measurements reads back to the same doubles; joint values in the URDF's convention. Columns
/// split, repeat, quaternion and sigma appear only where the measurements use them, and a joint's unit only where
/// `joint_units` knows it (the others are SI by default). Rows are in the order of the observations; configurations
/// and targets without observations are lost. All values must be finite.
/// Throws InputError for what the format cannot hold: an empty label, one with control characters or not in UTF-8,
/// a joint named like another column (x, target, ...).
std::string measurements_csv(const Measurements& measurements);

/// The observations that satisfy `keep`. Joints and targets stay as they are, even targets without observations, so
/// that their numbers mean the same; configurations left without observations are dropped and the others keep their
/// order.
Measurements subset(const Measurements& measurements, const std::function<bool(const Observation&)>& keep);

/// One observation per configuration and target, ordered so: the mean over the repeats, with repeat 1. Its sigma is
/// that of a mean of independent values, sqrt(sum sigma^2) / n, and 0 where one of the rows states none. Orientations
/// are averaged over the rows that have one: the mean is the eigenvector of the largest eigenvalue of sum q q^T
/// (Markley, Cheng, Crassidis and Oshman 2007, eq. 13), on the side of the first.
Measurements averaged(const Measurements& measurements);

/// The measurements of `second` behind those of `first`; same joints and targets.
Measurements joined(const Measurements& first, const Measurements& second);

}  // namespace kdl_calibration
