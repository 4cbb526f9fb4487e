#include "measurements/measurement_columns.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <unordered_map>
#include <utility>

#include "base/number_text.hpp"
#include "base/text.hpp"
#include "kdl_calibration/mimic.hpp"

namespace kdl_calibration {
namespace {

constexpr std::string_view kTorquePrefix = "tau_";

struct FixedColumn {
  std::string_view name;
  Column* column;
  bool is_length;
  bool required;
};

/// Every column that is no joint.
std::array<FixedColumn, 13> fixed_columns(Header& header) {
  auto& [x, y, z] = header.position;
  auto& [qw, qx, qy, qz] = header.quaternion;
  return {{{"configuration", &header.configuration, false, true},
           {"target", &header.target, false, true},
           {"x", &x, true, true},
           {"y", &y, true, true},
           {"z", &z, true, true},
           {"split", &header.split, false, false},
           {"repeat", &header.repeat, false, false},
           {"order", &header.order, false, false},
           {"qw", &qw, false, false},
           {"qx", &qx, false, false},
           {"qy", &qy, false, false},
           {"qz", &qz, false, false},
           {"sigma", &header.sigma, true, false}}};
}

/// The header cell "name [unit]" cut in two. Without brackets at the end the unit is absent.
std::pair<std::string_view, std::optional<std::string_view>> name_and_unit(std::string_view cell) {
  const std::size_t open = cell.rfind('[');
  if (!cell.ends_with(']') || open == std::string_view::npos) return {cell, std::nullopt};
  return {trimmed(cell.substr(0, open)), trimmed(cell.substr(open + 1, cell.size() - open - 2))};
}

[[noreturn]] void fail_unknown_column(const Place& place, std::string_view cell, std::string_view name,
                                      const ExpectedJoints& joints) {
  const auto& urdf = joints.urdf_names;
  if (joints.convention != nullptr && std::find(urdf.begin(), urdf.end(), name) != urdf.end()) {
    fail(place, "column " + shown(cell) + " has the URDF's joint name, but with the joint convention " +
                    joints.convention->name + " the controller's are expected: " + comma_separated(joints.names));
  }
  const std::string hint =
      joints.convention == nullptr ? " (where joints bear the controller's names, a joint convention has to tell)" : "";
  fail(place, "unknown column " + shown(cell) + ": " + expected_columns(joints) + hint);
}

/// Fills a header from its cells.
class HeaderParser {
public:
  HeaderParser(const ExpectedJoints& joints, const Place& place)
      : joints_(joints), place_(place), fixed_(fixed_columns(header_)) {
    header_.line = place.line;
    header_.joints.resize(joints.names.size());
    header_.followers.resize(joints.followers.size());
    header_.torques.resize(joints.names.size());
    for (std::size_t i = 0; i < joints.names.size(); ++i) joint_columns_.emplace(joints.names[i], &header_.joints[i]);
    for (std::size_t i = 0; i < joints.followers.size(); ++i) {
      joint_columns_.emplace(joints.joints[joints.followers[i]].name, &header_.followers[i]);
    }
    for (const FixedColumn& column : fixed_) {
      if (joint_columns_.contains(column.name)) {
        fail(place.source, "joint " + shown(column.name) +
                               " is named like a column of the measurements: give a joint convention with other names");
      }
    }
  }

  Header parse(std::string_view line) {
    header_.separator = separator_of(line);
    Fields cells;
    cells.split(line, header_.separator, place_);
    header_.fields = cells.size();
    std::size_t named = cells.size();
    while (named > 0 && trimmed(cells[named - 1]).empty()) --named;
    for (std::size_t i = 0; i < named; ++i) add(i, trimmed(cells[i]));
    take_own_values();
    check_complete();
    return std::move(header_);
  }

private:
  // Without the column of a drive, that of the joint which it moves takes its place.
  void take_own_values() {
    header_.own_values.assign(header_.joints.size(), false);
    const std::vector<std::size_t> independent = independent_joints(joints_.joints);
    for (std::size_t i = 0; joints_.convention == nullptr && i < header_.joints.size(); ++i) {
      const auto own = std::find(joints_.followers.begin(), joints_.followers.end(), independent[i]);
      if (own != joints_.followers.end() && !present(header_.joints[i])) {
        header_.own_values[i] = true;
        std::swap(header_.joints[i], header_.followers[static_cast<std::size_t>(own - joints_.followers.begin())]);
      }
    }
  }

  void add(std::size_t index, std::string_view cell) {
    if (cell.empty()) fail(place_, "column " + std::to_string(index + 1) + " has no name");
    header_.names.emplace_back(printable(cell));
    auto [name, unit] = name_and_unit(cell);
    if (joint_columns_.contains(cell)) {  // a joint's own name may end in brackets
      name = cell;
      unit.reset();
    }
    Column* column = nullptr;
    std::vector<std::string_view> units;
    if (const auto joint = joint_columns_.find(name); joint != joint_columns_.end()) {
      column = joint->second;
      units = units_of(*column);
    }
    if (const std::size_t joint = torque_of(name); column == nullptr && joint < header_.torques.size()) {
      column = &header_.torques[joint];
      units = units_of_torque(joint);
    }
    for (const FixedColumn& fixed : fixed_) {
      if (fixed.name != name) continue;
      column = fixed.column;
      if (fixed.is_length) units = {"m", "mm"};
    }
    if (column == nullptr) fail_unknown_column(place_, cell, name, joints_);
    if (present(*column)) {
      fail(place_, "column " + shown(cell) + " repeats '" + header_.names[column->index] + "'");
    }
    *column = {index, unit ? parse_unit(*unit, cell, units) : Unit::none};
  }

  std::vector<std::string_view> units_of(const Column& joint) const {
    ValueKind kind = ValueKind::unknown;
    for (std::size_t i = 0; i < header_.joints.size(); ++i) {
      if (&header_.joints[i] == &joint) kind = kind_of_value(joints_, i);
    }
    for (std::size_t i = 0; i < header_.followers.size(); ++i) {
      if (&header_.followers[i] == &joint) kind = kind_of_joint(joints_, joints_.followers[i]);
    }
    if (kind == ValueKind::angle) return {"rad", "deg"};
    if (kind == ValueKind::length) return {"m", "mm"};
    return {"rad", "deg", "m", "mm"};
  }

  /// The number of the expected joint whose torque the column of this name holds; as many as there are: of none.
  std::size_t torque_of(std::string_view name) const {
    if (!name.starts_with(kTorquePrefix)) return joints_.names.size();
    const auto joint = std::find(joints_.names.begin(), joints_.names.end(), name.substr(kTorquePrefix.size()));
    return static_cast<std::size_t>(joint - joints_.names.begin());
  }

  std::vector<std::string_view> units_of_torque(std::size_t joint) const {
    const ValueKind kind = kind_of_value(joints_, joint);
    if (kind == ValueKind::angle) return {"Nm"};
    if (kind == ValueKind::length) return {"N"};
    return {"Nm", "N"};
  }

  Unit parse_unit(std::string_view unit, std::string_view cell, const std::vector<std::string_view>& allowed) const {
    if (std::find(allowed.begin(), allowed.end(), unit) == allowed.end()) {
      std::string rule = allowed.empty() ? "none" : "";
      for (const std::string_view name : allowed) rule += (rule.empty() ? "[" : ", [") + std::string(name) + "]";
      fail(place_, "unknown unit " + shown(unit) + " in column " + shown(cell) + ": expected " + rule);
    }
    if (unit == "rad") return Unit::rad;
    if (unit == "deg") return Unit::deg;
    if (unit == "Nm" || unit == "N") return Unit::none;
    return unit == "m" ? Unit::m : Unit::mm;
  }

  void check_complete() const {
    std::vector<std::string> missing;
    for (const FixedColumn& fixed : fixed_) {
      if (fixed.required && joints_.with_points && !present(*fixed.column)) missing.emplace_back(fixed.name);
    }
    for (std::size_t i = 0; i < header_.joints.size(); ++i) {
      if (!present(header_.joints[i])) missing.push_back(joints_.names[i]);
    }
    const auto& quaternion = header_.quaternion;
    if (std::any_of(quaternion.begin(), quaternion.end(), present)) {
      for (const FixedColumn& fixed : fixed_) {
        if (fixed.name.starts_with('q') && !present(*fixed.column)) missing.emplace_back(fixed.name);
      }
    }
    if (missing.empty()) return;
    fail(place_, (missing.size() == 1 ? "missing column " : "missing columns ") + comma_separated(missing) + ": " +
                     expected_columns(joints_) + " (the quaternion's four together)");
  }

  const ExpectedJoints& joints_;
  Place place_;
  Header header_;
  std::array<FixedColumn, 13> fixed_;
  std::unordered_map<std::string_view, Column*> joint_columns_;
};

}  // namespace

double to_si(double value, Unit unit) {
  if (unit == Unit::deg) return value * (std::numbers::pi / 180.0);
  if (unit == Unit::mm) return value / 1000.0;
  return value;
}

std::string in_unit(double value, Unit unit) { return shortest(std::round(value / to_si(1.0, unit) * 1e9) / 1e9); }

ValueKind kind_of_joint(const ExpectedJoints& joints, std::size_t i) {
  if (!joints.kinds_known) return ValueKind::unknown;
  return joints.joints[i].type == JointType::prismatic ? ValueKind::length : ValueKind::angle;
}

ValueKind kind_of_value(const ExpectedJoints& joints, std::size_t i) {
  const std::vector<std::size_t> independent = independent_joints(joints.joints);
  if (joints.convention == nullptr) return kind_of_joint(joints, independent[i]);
  std::optional<ValueKind> kind;
  for (std::size_t row = 0; row < independent.size(); ++row) {
    if (joints.convention->matrix(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(i)) == 0.0) continue;
    const ValueKind own = kind_of_joint(joints, independent[row]);
    kind = !kind || *kind == own ? own : ValueKind::unknown;
  }
  return kind.value_or(ValueKind::unknown);
}

bool is_fixed_column(std::string_view name) {
  Header header;
  const auto fixed = fixed_columns(header);
  return std::any_of(fixed.begin(), fixed.end(), [&](const FixedColumn& column) { return column.name == name; });
}

std::string expected_columns(const ExpectedJoints& joints) {
  std::vector<std::string> followers;
  for (const std::size_t i : joints.followers) followers.push_back(joints.joints[i].name);
  const std::string points = "configuration, target, x, y, z";
  return "expected " + (joints.with_points ? points + " and " : "") + "the joints " + comma_separated(joints.names) +
         ", optionally " + (joints.with_points ? "" : points + ", ") + "split, repeat, order, qw, qx, qy, qz, sigma, " +
         std::string(kTorquePrefix) + "<joint>" +
         (followers.empty() ? "" : " and the joints that mimic others: " + comma_separated(followers));
}

Header parse_header(std::string_view line, const ExpectedJoints& joints, const Place& place) {
  return HeaderParser(joints, place).parse(line);
}

}  // namespace kdl_calibration
