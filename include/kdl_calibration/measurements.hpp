#pragma once

// Measured points of targets on the tool, and the file that holds them.
//
//     const Measurements measurements = read_measurements(robot, "measurements.csv");

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

enum class Split : std::uint8_t { train, test };

/// The stated unit of a joint's values; without one they are in rad or m, depending on the joint's type.
enum class JointUnit : std::uint8_t { unstated, radian, metre };

/// A measured point: three equations.
struct Point {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< [m] in the measuring device's frame W
};

/// A unit quaternion, unaligned so that a row has the same size for all instruction sets.
using Orientation = Eigen::Quaternion<double, Eigen::DontAlign>;

/// A measured frame of a target: six equations.
struct Pose {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< [m] in W
  Orientation orientation = Orientation::Identity();   ///< of the target's frame in W
};

/// One or two coordinates of a point p in W. P is the projector onto the measured directions.
/// One (count 1): the coordinate along n, P = n n^T. Two (count 2): those perpendicular to n, P = I - n n^T.
/// If only x was measured: position (x, 0, 0), normal (1, 0, 0), count 1. Only x and y: (x, y, 0), (0, 0, 1), 2.
struct Coordinates {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< [m] P p: zero along directions that were not measured
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();   ///< unit vector n in W
  std::int8_t count = 1;                               ///< number of equations
};

/// The distance of a point from an anchor: one equation.
struct Distance {
  double length = 0.0;                               ///< [m] above 0
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();  ///< [m] in W
};

/// The quantity that a row measures of a target: 3, 6, 1 or 2, and 1 equations. All errors of a position are lengths
/// along the measured directions.
using Reading = std::variant<Point, Pose, Coordinates, Distance>;

/// [m] in W: the position of a point, a pose or coordinates. Of a distance it is the anchor, not the point.
/// `AnyReading` is Reading or const Reading.
template <class AnyReading>
auto& position_of(AnyReading& reading) {
  const auto of_kind = [](auto& kind) -> auto& {
    if constexpr (requires { kind.anchor; }) {
      return kind.anchor;
    } else {
      return kind.position;
    }
  };
  return std::visit(of_kind, reading);
}

/// Factors on the 1 sigma of a row, of its lengths and of its orientation. `calibrate` estimates them, one pair for
/// each station, if instruments of several stations differ. No file states them.
struct NoiseFactors {
  float length = 1.0F;
  float orientation = 1.0F;
  bool operator==(const NoiseFactors&) const = default;
};

/// One row of the file: all that is known of it.
struct Observation {
  Reading reading;
  double sigma = 0.0;                 ///< [m] 1 sigma of each measured length; 0 if the file states none
  std::optional<std::int64_t> order;  ///< its place in the order of driving
  std::int32_t configuration = 0;     ///< column of Measurements::joint_values
  std::int32_t target = 0;            ///< index into Measurements::targets
  std::int32_t repeat = 1;            ///< observations of one configuration with the same repeat were taken together
  Split split = Split::train;
  std::int16_t station = 0;  ///< index into Measurements::stations, the same for all rows of a configuration
  NoiseFactors noise = {};

  /// See position_of.
  const Eigen::Vector3d& position() const { return position_of(reading); }
  Eigen::Vector3d& position() { return position_of(reading); }
  /// The measured orientation; null if the row is no pose.
  const Orientation* orientation() const {
    const Pose* const pose = std::get_if<Pose>(&reading);
    return pose == nullptr ? nullptr : &pose->orientation;
  }
};

/// Signals that the drives reported beside the joint values: joints x configurations each, or empty if unknown.
struct DriveSignals {
  /// Sign of the joint's last motion before it was measured: -1 or 1, the mean if repeats were approached from both
  /// sides, NaN if unknown.
  Eigen::MatrixXd approach;
  /// [Nm], or [N] for a prismatic joint; NaN if not measured.
  Eigen::MatrixXd torques;
  /// 2 x configurations, or empty: Circumstances::temperature and payload.
  Eigen::MatrixXd circumstances;
  /// URDF links that have a temperature of their own, each once; none: all have that of `circumstances`.
  std::vector<std::string> links = {};
  /// links x configurations [degC]; in a row all values are known, or all are NaN as for a link without an own one.
  Eigen::MatrixXd link_temperatures = {};
};

/// A set of measurements. Configurations and targets are numbered in their order of first appearance.
struct Measurements {
  std::string source;                       ///< file name, for messages
  std::vector<std::string> joints;          ///< URDF names of the moving joints, base to tip
  Eigen::MatrixXd joint_values;             ///< joints x configurations, in the URDF's convention [rad] or [m]
  std::vector<std::string> configurations;  ///< labels
  std::vector<std::string> targets;         ///< names of the points on the tool
  /// Names of the places of the measuring device (or of a plate), each with a frame W of its own; at least one.
  std::vector<std::string> stations = {"W"};
  /// In the order of the file. The distances of a configuration have the same anchor. Either all rows have an order or
  /// none.
  std::vector<Observation> observations;
  /// One per joint, or empty if unknown. The reader fills it from the header's units, unless a joint convention is
  /// used.
  std::vector<JointUnit> joint_units;
  std::string remark;  ///< how the reader interpreted the file, in one line; empty if as usual
  /// Of the configurations; from tau_<joint>, order, temperature, temperature_<link> and payload.
  DriveSignals signals;
};

/// The observations that satisfy `keep`. Joints and targets stay as they are, even targets without observations, so
/// that their indices stay valid. Configurations without observations are dropped; the others keep their order.
Measurements subset(const Measurements& measurements, const std::function<bool(const Observation&)>& keep);

/// The measurements without some configurations ("12") or points of them ("12:A"), which `remark` names. Throws
/// InputError if a name matches nothing or nothing is left.
Measurements without_rows(const Measurements& measurements, const std::vector<std::string>& names);

/// One observation per configuration and target, ordered so: the mean over the repeats, with repeat 1. Its sigma is
/// that of a mean of independent values, sqrt(sum sigma^2) / n, and 0 if one of the rows states none; its order is that
/// of the first row. The mean of the measured orientations is the eigenvector of the largest eigenvalue of sum q q^T
/// (Markley, Cheng, Crassidis and Oshman 2007, eq. 13), with the sign nearest to the first. Single coordinates of one
/// target are joined to the point, line or plane that they determine.
Measurements averaged(const Measurements& measurements);

/// The measurements of `first`, then those of `second`; joints, targets and stations must be the same. Order and
/// signals are kept only if both have them, a link's temperature only if both state it.
Measurements joined(const Measurements& first, const Measurements& second);

/// Reads measurements (CSV, see src/cli/README.md). `urdf_joints` are the moving joints of the chain, base to tip.
/// Joint columns are named by these or, with a convention, by the controller's joints only.
///
/// UTF-8 with or without byte order mark, comma, semicolon or tab as in the header, LF or CRLF, quoted fields within
/// one line; decimal commas if the separator is no comma. Lines that start with # and lines without any value are
/// skipped. Units are in the header, in [] or (), or in a separate row below it: rad, deg, °, degrees, m, mm. Names of
/// columns and joints ignore case if the match is unique. `name` and `point` mean target, `pose` and `config`
/// configuration. The optional column `station` names the place of the measuring device. `remark` says how the file
/// differs from one of measurements_csv. Of x, y and z a coordinate that was not measured is left empty; n_x, n_y, n_z
/// and along instead of them are a unit vector and the coordinate along it, `distance` is that from the anchor x, y, z
/// or the origin (see Reading). Without a column of stations all rows are of one, W. A distance from another anchor
/// than that of the configuration's first row is a configuration of its own.
///
/// Orientations of targets, R = Rz(yaw) Ry(pitch) Rx(roll), come in one of five forms: qw, qx, qy, qz (normalised); rx,
/// ry, rz (angle times axis); roll, pitch, yaw; A, B, C (KUKA: yaw, pitch, roll) and W, P, R (FANUC: roll, pitch, yaw),
/// the last two with units. An empty cell is allowed in the optional columns: split (train), repeat (1), sigma (none
/// stated) and an orientation (if all its cells are empty). Columns temperature_<link> name links of the robot's chain;
/// without a robot any name is accepted. Limits: 16 GiB, lines of 1 MiB, 10,000 columns, 100 targets; the file is read
/// in pieces.
///
/// Throws InputError naming file, line, column, value and rule: an unreadable file, text that is not UTF-8, a missing,
/// unknown or repeated column, temperatures of unknown links or of two that are fixed to each other, an unknown unit, a
/// ragged row, a value that is not a finite number or beyond 1e12, decimal points beside decimal commas, a sigma below
/// 1e-15 m, a quaternion norm off 1 by more than 1e-3, angles without unit beyond one turn, two forms of orientation or
/// an incomplete one, a norm of n_x, n_y, n_z off 1 by more than 1e-3, two rows for the same configuration, repeat,
/// target and direction, joint values, a split or a station that differ within one configuration, more than 100
/// stations, no rows.
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

/// The CSV that read_measurements reads back to the same doubles (directions n to rounding); joint values in the URDF's
/// convention. Columns split, repeat, quaternion and sigma appear only where the measurements use them, and a joint's
/// unit only if stated in `joint_units` (default SI). Rows are in the order of the observations; configurations and
/// targets without observations are omitted. All values must be finite. Throws InputError for two coordinates that are
/// not along x, y and z, and names that the format cannot represent: an empty label, one with control characters or not
/// in UTF-8, a joint named like another column (x, target,...).
std::string measurements_csv(const Measurements& measurements);

/// The same with the controller's joints, in rad and m. Also throws InputError for a convention that is not the
/// robot's, and for torques, which belong to the URDF's joints.
std::string measurements_csv(const Robot& robot, const Measurements& measurements, const JointConvention& convention);

}  // namespace kdl_calibration
