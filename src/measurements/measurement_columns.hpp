#pragma once

// The header of a measurements file: which column holds what, in which unit.

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "base/csv.hpp"
#include "base/units.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/orientation_reading.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// Position and unit of a quantity in a row.
struct Column {
  static constexpr std::size_t kAbsent = std::numeric_limits<std::size_t>::max();
  std::size_t index = kAbsent;
  Unit unit = Unit::none;
};

inline bool present(const Column& column) { return column.index != Column::kAbsent; }

/// A set of columns that state an orientation.
struct OrientationForm {
  std::array<std::string_view, 4> names;  ///< the last one is empty for three columns
  std::string_view what;
  std::string_view degrees_by;  ///< maker whose pendants show degrees: the unit is required; else empty
  OrientationReading usual;     ///< of three columns, if none is stated

  std::size_t count() const { return names.back().empty() ? 3 : 4; }
  std::string words() const;  ///< "rx, ry, rz"
};
inline constexpr std::size_t kQuaternion = 0;
inline constexpr std::size_t kRotationVector = 1;
inline constexpr std::size_t kKuka = 3;
inline constexpr std::array<OrientationForm, 5> kOrientationForms = {
    {{.names = {"qw", "qx", "qy", "qz"}, .what = "quaternion", .degrees_by = {}, .usual = OrientationReading::usual},
     {.names = {"rx", "ry", "rz", {}},
      .what = "orientation",
      .degrees_by = {},
      .usual = OrientationReading::rotation_vector},
     {.names = {"roll", "pitch", "yaw", {}},
      .what = "orientation",
      .degrees_by = {},
      .usual = OrientationReading::fixed_xyz},
     {.names = {"A", "B", "C", {}},
      .what = "orientation",
      .degrees_by = "KUKA",
      .usual = OrientationReading::moving_zyx},
     {.names = {"W", "P", "R", {}},
      .what = "orientation",
      .degrees_by = "FANUC",
      .usual = OrientationReading::fixed_xyz}}};

/// A row below the header with units only.
struct UnitRow {
  const Fields& cells;
  std::size_t line;
};

struct Header {
  char separator = ',';
  std::size_t line = 0;
  std::vector<std::string> names;  ///< as in the file, with units, without trailing empty ones; for messages
  std::size_t fields = 0;          ///< number of fields, trailing empty ones included
  Column configuration, split, repeat, target, sigma, order, station;
  std::array<Column, 2> passed_over;  ///< collection and group of SpatialAnalyzer
  std::array<Column, 3> position;
  std::array<Column, 3> normal;  ///< n_x, n_y, n_z: the direction of the coordinate `along`
  Column along;
  Column distance;  ///< from the point x, y, z (or the origin) of the station's frame
  /// Index of the file's orientation form in kOrientationForms; their number if it has none.
  std::size_t orientation = kOrientationForms.size();
  OrientationReading reading = OrientationReading::usual;  ///< of three columns; `usual` for a quaternion
  std::array<std::array<Column, 4>, kOrientationForms.size()> orientations;  ///< of each form
  std::vector<Column> joints;                                                ///< in the order of the expected names
  std::vector<Column> followers;        ///< in the order of ExpectedJoints::followers, absent ones included
  std::vector<bool> own_values;         ///< whether each of `joints` is the joint's own column, not its drive's
  std::vector<Column> torques;          ///< of the expected joints, absent ones included
  std::array<Column, 2> circumstances;  ///< temperature and payload
  std::vector<std::string> links;       ///< with a column of their own temperature
  std::vector<Column> link_temperatures;
  std::vector<std::string> notes;  ///< differences from the format of measurements_csv
};

inline bool states_orientation(const Header& header) { return header.orientation < kOrientationForms.size(); }

/// "orientations from rx, ry, rz as rotation-vector"; empty for quaternions, and if there are none.
std::string orientation_note(const Header& header);

/// What each row of a file must state.
enum class FileContent : std::uint8_t {
  measurements,    ///< a configuration, its joint values and a point of a target
  configurations,  ///< joint values
  poses            ///< coordinates and an orientation
};

/// The joint names expected in the header.
struct ExpectedJoints {
  const std::vector<std::string>& names;       ///< the controller's with a convention, else the URDF's
  const std::vector<std::string>& urdf_names;  ///< of the independent joints, base to tip
  const JointConvention* convention;
  const std::vector<MovingJoint>& joints;  ///< of the chain, base to tip
  std::vector<std::size_t> followers;      ///< those that mimic another joint or have a drive outside the chain
  bool kinds_known = true;                 ///< whether the types in `joints` are valid
  FileContent content = FileContent::measurements;
  OrientationReading orientation = OrientationReading::usual;  ///< as the user stated it
  std::vector<std::string> links = {};                         ///< of the chain, base to tip; empty: any names
};

enum class ValueKind : std::uint8_t { unknown, angle, length };

/// Kind of value `i` of the expected joints (or followers): with a convention, the kind of all joints that depend on
/// it.
ValueKind kind_of_value(const ExpectedJoints& joints, std::size_t i);
ValueKind kind_of_joint(const ExpectedJoints& joints, std::size_t i);

/// The meaning of a column's name: target for name and point, configuration for pose and config, else the name.
std::string_view column_meaning(std::string_view name);

/// Whether this name is reserved for a column that is not a joint.
bool is_fixed_column(std::string_view name);

/// "expected configuration, target, …" for messages.
std::string expected_columns(const ExpectedJoints& joints);

/// Parses the header line. Throws InputError: a missing, unknown or repeated column, an unknown unit or one that
/// contradicts the row of units, two forms of orientation, a joint named like another column.
Header parse_header(std::string_view line, const ExpectedJoints& joints, const Place& place,
                    const UnitRow* units = nullptr);

/// Whether every cell is empty, "-" or a unit, and at least one is a unit.
bool is_unit_row(const Fields& cells);

/// Throws InputError for an orientation without unit whose form requires it, for poses whose rx, ry, rz in degrees
/// nobody said how to read, and for a stated reading of a file without three numbers of an orientation.
void require_clear_orientations(const Header& header, const ExpectedJoints& joints, const std::string& source);

}  // namespace kdl_calibration
