#pragma once

// The header of a measurements file: which column holds what, in which unit. Not installed.

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "base/csv.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

enum class Unit : std::uint8_t { none, rad, deg, m, mm };

double to_si(double value, Unit unit);
/// The SI value as a text in the unit, without the last digits that the conversion costs.
std::string in_unit(double value, Unit unit);

/// Where a quantity stands in a row.
struct Column {
  static constexpr std::size_t kAbsent = std::numeric_limits<std::size_t>::max();
  std::size_t index = kAbsent;
  Unit unit = Unit::none;
};

inline bool present(const Column& column) { return column.index != Column::kAbsent; }

/// The columns by which a file may state an orientation.
struct OrientationForm {
  std::array<std::string_view, 4> names;  ///< the last one empty where there are three
  std::string_view what;
  std::string_view degrees_by;  ///< a maker whose pendants show degrees, so that the unit is required; else empty

  std::size_t count() const { return names.back().empty() ? 3 : 4; }
  std::string words() const;  ///< "rx, ry, rz"
};
inline constexpr std::size_t kQuaternion = 0;
inline constexpr std::size_t kRotationVector = 1;
inline constexpr std::size_t kKuka = 3;
inline constexpr std::array<OrientationForm, 5> kOrientationForms = {
    {{.names = {"qw", "qx", "qy", "qz"}, .what = "quaternion", .degrees_by = {}},
     {.names = {"rx", "ry", "rz", {}}, .what = "rotation vector", .degrees_by = {}},
     {.names = {"roll", "pitch", "yaw", {}}, .what = "orientation", .degrees_by = {}},
     {.names = {"A", "B", "C", {}}, .what = "orientation", .degrees_by = "KUKA"},
     {.names = {"W", "P", "R", {}}, .what = "orientation", .degrees_by = "FANUC"}}};

/// A row below the header that holds units alone.
struct UnitRow {
  const Fields& cells;
  std::size_t line;
};

struct Header {
  char separator = ',';
  std::size_t line = 0;
  std::vector<std::string> names;  ///< as the file has them, for messages: units included, no empty ones at the end
  std::size_t fields = 0;          ///< with the empty ones at the end
  Column configuration, split, repeat, target, sigma, order;
  std::array<Column, 3> position;
  /// The form of orientation that the file has, as a place in kOrientationForms; their number where it has none.
  std::size_t orientation = kOrientationForms.size();
  std::array<std::array<Column, 4>, kOrientationForms.size()> orientations;  ///< of each form
  std::vector<Column> joints;                                                ///< in the order of the expected names
  std::vector<Column> followers;   ///< in the order of ExpectedJoints::followers; absent ones as well
  std::vector<bool> own_values;    ///< for each of `joints`, whether the column is the joint's own, not its drive's
  std::vector<Column> torques;     ///< of the joints that the header is expected to name; absent ones as well
  std::vector<std::string> notes;  ///< what is not as measurements_csv would write it
};

inline bool has_orientation(const Header& header) { return header.orientation < kOrientationForms.size(); }

/// The joint names that the header must bear.
struct ExpectedJoints {
  const std::vector<std::string>& names;       ///< the controller's with a convention, else the URDF's
  const std::vector<std::string>& urdf_names;  ///< of the independent joints, base to tip
  const JointConvention* convention;
  const std::vector<MovingJoint>& joints;  ///< of the chain, base to tip
  std::vector<std::size_t> followers;      ///< those of them that mimic another or have a drive outside the chain
  bool kinds_known = true;                 ///< whether `joints` says which of them turn and which slide
  bool with_points = true;                 ///< whether the file must say which target was measured where
};

enum class ValueKind : std::uint8_t { unknown, angle, length };

/// What value `i` of the expected joints (or follower) must be: behind a convention, what all joints are that follow
/// from it.
ValueKind kind_of_value(const ExpectedJoints& joints, std::size_t i);
ValueKind kind_of_joint(const ExpectedJoints& joints, std::size_t i);

/// Whether a column of the measurements that is no joint has this name, and no joint may have it.
bool is_fixed_column(std::string_view name);

/// "expected configuration, target, …" for messages.
std::string expected_columns(const ExpectedJoints& joints);

/// The header that this line is. Throws InputError: a missing, unknown or repeated column, an unknown unit or one that
/// the row of units contradicts, two forms of orientation, a joint that is named like another column.
Header parse_header(std::string_view line, const ExpectedJoints& joints, const Place& place,
                    const UnitRow* units = nullptr);

/// Whether every cell that is not empty is a unit or "-", and one is a unit.
bool is_unit_row(const Fields& cells);

/// Throws InputError for an orientation without a unit where pendants show degrees.
void require_orientation_units(const Header& header, const std::string& source);

}  // namespace kdl_calibration
