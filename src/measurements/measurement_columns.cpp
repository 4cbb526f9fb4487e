#include "measurements/measurement_columns.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "base/text.hpp"
#include "measurements/drive_signals.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

constexpr std::string_view kTorquePrefix = "tau_";
constexpr std::string_view kTemperaturePrefix = "temperature_";

enum class Quantity : std::uint8_t { none, length, angle, temperature, mass };

struct FixedColumn {
  std::string_view name;
  Column* column;
  Quantity quantity = Quantity::none;
  bool required = false;  // in measurements
};

/// All columns other than joints.
std::vector<FixedColumn> fixed_columns(Header& header) {
  using enum Quantity;
  auto& [x, y, z] = header.position;
  auto& [n_x, n_y, n_z] = header.normal;
  std::vector<FixedColumn> columns = {{"configuration", &header.configuration, none, true},
                                      {"target", &header.target, none, true},
                                      {"x", &x, length, true},
                                      {"y", &y, length, true},
                                      {"z", &z, length, true},
                                      {"n_x", &n_x},
                                      {"n_y", &n_y},
                                      {"n_z", &n_z},
                                      {"along", &header.along, length},
                                      {"distance", &header.distance, length},
                                      {"split", &header.split},
                                      {"station", &header.station},
                                      {"repeat", &header.repeat},
                                      {"order", &header.order},
                                      {"collection", header.passed_over.data()},
                                      {"group", &header.passed_over[1]},
                                      {"sigma", &header.sigma, length},
                                      {"temperature", header.circumstances.data(), temperature},
                                      {"payload", &header.circumstances[1], mass}};
  for (std::size_t form = 0; form < kOrientationForms.size(); ++form) {
    for (std::size_t i = 0; i < kOrientationForms[form].count(); ++i) {
      columns.push_back(
          {kOrientationForms[form].names[i], &header.orientations[form][i], form == kQuaternion ? none : angle});
    }
  }
  return columns;
}

constexpr std::array kOtherNames = {Word{"name", "target"},          Word{"point", "target"},
                                    Word{"point name", "target"},    Word{"pose", "configuration"},
                                    Word{"config", "configuration"}, Word{"anchor", "station"}};

bool alike(std::string_view a, std::string_view b, bool any_case) {
  return any_case ? lower_case(a) == lower_case(b) : a == b;
}

/// Index of the name; with `any_case` of its only match ignoring case. The number of names if there is none.
std::size_t index_of(const std::vector<std::string>& names, std::string_view name, bool any_case) {
  const auto same = [&](std::string_view other) { return alike(other, name, any_case); };
  const auto first = std::find_if(names.begin(), names.end(), same);
  const bool more = any_case && first != names.end() && std::find_if(first + 1, names.end(), same) != names.end();
  return more ? names.size() : static_cast<std::size_t>(first - names.begin());
}

/// The unit of a cell that contains only a unit, in brackets or not.
std::string_view unit_alone(std::string_view cell) {
  const auto [name, unit] = name_and_unit(trimmed(cell));
  return unit && name.empty() ? *unit : trimmed(cell);
}

[[noreturn]] void fail_unknown_column(const Place& place, std::string_view cell, std::string_view name,
                                      const ExpectedJoints& joints) {
  const auto& urdf = joints.urdf_names;
  if (joints.convention != nullptr && std::find(urdf.begin(), urdf.end(), name) != urdf.end()) {
    fail(place, "column " + shown(cell) + " has the URDF's joint name, but with the joint convention " +
                    joints.convention->name + " the controller's are expected: " + comma_separated(joints.names));
  }
  const std::string hint = joints.convention == nullptr ? " (controller's joint names need --joint-convention)" : "";
  fail(place, "unknown column " + shown(cell) + hint + ": " + expected_columns(joints));
}

/// Fills a header from its cells.
class HeaderParser {
public:
  HeaderParser(const ExpectedJoints& joints, const Place& place, const UnitRow* units)
      : joints_(joints), place_(place), units_(units), fixed_(fixed_columns(header_)), joint_names_(joints.names) {
    header_.line = place.line;
    header_.joints.resize(joints.names.size());
    header_.followers.resize(joints.followers.size());
    header_.torques.resize(joints.names.size());
    for (const std::size_t i : joints.followers) joint_names_.push_back(joints.joints[i].name);
    for (const std::string& name : joint_names_) {
      if (is_fixed_column(name)) {
        fail(place.source, "joint " + shown(name) +
                               " is named like a column of the measurements: give a joint convention with other names");
      }
    }
  }

  Header parse(std::string_view line) {
    header_.separator = separator_of(line);
    if (header_.separator == '\t') header_.notes.emplace_back("tabs");
    if (units_ != nullptr) header_.notes.push_back("units in line " + std::to_string(units_->line));
    Fields cells;
    cells.split(line, header_.separator, place_);
    header_.fields = cells.size();
    std::size_t named = cells.size();
    while (named > 0 && trimmed(cells[named - 1]).empty()) --named;
    for (std::size_t i = 0; i < named; ++i) add(i, name_in(trimmed(cells[i])));
    take_own_values();
    find_orientation();
    check_complete();
    if (const std::string fault = fault_of_links(header_.links, joints_.links, joints_.joints); !fault.empty()) {
      fail(place_, fault);
    }
    return std::move(header_);
  }

private:
  /// Meaning of a name in the header; no column if unknown.
  struct Meaning {
    Column* column = nullptr;
    std::string name;
    std::vector<std::string_view> units;
  };

  // If a drive has no column, the column of its joint is used.
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
    if (index_of(joint_names_, cell, false) < joint_names_.size()) {  // a joint's own name may end in brackets
      name = cell;
      unit.reset();
    }
    Meaning meaning = meaning_of(name);
    const bool names_link = name.size() > kTemperaturePrefix.size() &&
                            alike(name.substr(0, kTemperaturePrefix.size()), kTemperaturePrefix, true);
    if (meaning.column == nullptr && names_link) {
      meaning = temperature_of_link(std::string(name.substr(kTemperaturePrefix.size())));
    }
    if (meaning.column == nullptr) fail_unknown_column(place_, cell, name, joints_);
    if (present(*meaning.column)) {
      fail(place_, "column " + shown(cell) + " repeats '" + header_.names[meaning.column->index] + "'");
    }
    std::string_view word;
    if (unit) word = known_unit(*unit, cell, meaning.units, place_);
    const bool canonical = name == meaning.name && (!unit || (cell.ends_with(']') && *unit == word));
    if (units_ != nullptr) word = unit_below(index, cell, word, meaning.units);
    const auto& unused = header_.passed_over;
    if (std::any_of(unused.begin(), unused.end(), [&](const Column& column) { return &column == meaning.column; })) {
      header_.notes.push_back("\"" + printable(cell) + "\" passed over");
    } else if (!canonical) {
      header_.notes.push_back("\"" + printable(cell) + "\" as " + printable(meaning.name) +
                              (word.empty() ? "" : " in " + std::string(word)));
    }
    *meaning.column = {index, unit_named(word)};
  }

  // Exact matches come first, joint names before others.
  Meaning meaning_of(std::string_view name) {
    for (const bool any_case : {false, true}) {
      const std::size_t joint = index_of(joint_names_, name, any_case);
      if (joint < header_.joints.size()) {
        return {&header_.joints[joint], joint_names_[joint], units_of(kind_of_value(joints_, joint))};
      }
      if (joint < joint_names_.size()) {
        const std::size_t follower = joint - header_.joints.size();
        return {&header_.followers[follower], joint_names_[joint],
                units_of(kind_of_joint(joints_, joints_.followers[follower]))};
      }
      if (alike(name.substr(0, kTorquePrefix.size()), kTorquePrefix, any_case)) {
        const std::size_t torque = index_of(joints_.names, name.substr(kTorquePrefix.size()), any_case);
        if (torque < joints_.names.size()) {
          return {&header_.torques[torque], std::string(kTorquePrefix) + joints_.names[torque],
                  units_of_torque(torque)};
        }
      }
      const std::string_view wanted = any_case ? column_meaning(name) : name;
      for (const FixedColumn& fixed : fixed_) {
        if (!alike(fixed.name, wanted, any_case)) continue;
        return {fixed.column, std::string(fixed.name), units_of(fixed.quantity)};
      }
    }
    return {};
  }

  /// The column of this link. The pointer is valid until the next one is added.
  Meaning temperature_of_link(std::string link) {
    for (const bool any_case : {true, false}) {
      const std::size_t known = index_of(joints_.links, link, any_case);
      if (known < joints_.links.size()) link = joints_.links[known];
    }
    if (const std::string fault = fault_of_links({link}, joints_.links, {}); !fault.empty()) fail(place_, fault);
    const std::size_t index = index_of(header_.links, link, false);
    if (index == header_.links.size()) {
      header_.links.push_back(link);
      header_.link_temperatures.emplace_back();
    }
    return {&header_.link_temperatures[index], std::string(kTemperaturePrefix) + link, units_of(Quantity::temperature)};
  }

  static std::vector<std::string_view> units_of(ValueKind kind) {
    if (kind == ValueKind::angle) return {"rad", "deg"};
    if (kind == ValueKind::length) return {"m", "mm"};
    return {"rad", "deg", "m", "mm"};
  }

  static std::vector<std::string_view> units_of(Quantity quantity) {
    if (quantity == Quantity::none) return {};
    if (quantity == Quantity::temperature) return {"degC"};
    if (quantity == Quantity::mass) return {"kg"};
    return units_of(quantity == Quantity::angle ? ValueKind::angle : ValueKind::length);
  }

  std::vector<std::string_view> units_of_torque(std::size_t joint) const {
    const ValueKind kind = kind_of_value(joints_, joint);
    if (kind == ValueKind::angle) return {"Nm"};
    if (kind == ValueKind::length) return {"N"};
    return {"Nm", "N"};
  }

  /// The unit in the library's notation.
  static std::string_view known_unit(std::string_view unit, std::string_view cell,
                                     const std::vector<std::string_view>& allowed, const Place& place) {
    const std::string_view word = translated(unit, kUnitWords);
    if (std::find(allowed.begin(), allowed.end(), word) == allowed.end()) {
      std::string rule = allowed.empty() ? "none" : "";
      for (const std::string_view name : allowed) rule += (rule.empty() ? "[" : ", [") + std::string(name) + "]";
      fail(place, "unknown unit " + shown(unit) + " in column " + shown(cell) + ": expected " + rule);
    }
    return word;
  }

  /// The unit from the row of units for a column with unit `word` in the header.
  std::string_view unit_below(std::size_t index, std::string_view cell, std::string_view word,
                              const std::vector<std::string_view>& allowed) const {
    const std::string_view unit = unit_alone(units_->cells[index]);
    if (unit.empty() || unit == "-") return word;
    const Place place{place_.source, units_->line};
    const std::string_view below = known_unit(unit, cell, allowed, place);
    if (!word.empty() && word != below) {
      fail(place, "unit " + shown(unit) + " contradicts column " + shown(cell) + ": expected one unit in header and " +
                      "row of units");
    }
    return below;
  }

  const std::string& name_of_first(std::size_t form) const {
    const auto& columns = header_.orientations[form];
    return header_.names[std::find_if(columns.begin(), columns.end(), present)->index];
  }

  void find_orientation() {
    for (std::size_t form = 0; form < kOrientationForms.size(); ++form) {
      const auto& columns = header_.orientations[form];
      if (std::none_of(columns.begin(), columns.end(), present)) continue;
      if (states_orientation(header_)) {
        fail(place_, "columns '" + name_of_first(header_.orientation) + "' and '" + name_of_first(form) +
                         "' state orientations in two forms: expected either " +
                         kOrientationForms[header_.orientation].words() + " or " + kOrientationForms[form].words());
      }
      header_.orientation = form;
    }
    if (!states_orientation(header_) || header_.orientation == kQuaternion) return;
    header_.reading = joints_.orientation == OrientationReading::usual ? kOrientationForms[header_.orientation].usual
                                                                       : joints_.orientation;
    header_.notes.push_back(orientation_note(header_));
  }

  // The columns of a coordinate along a direction stand together.
  void add_missing_of_line(std::vector<std::string>& missing) const {
    if (!present(header_.along) && std::none_of(header_.normal.begin(), header_.normal.end(), present)) return;
    for (const FixedColumn& fixed : fixed_) {
      const bool states_line = fixed.name == "along" || fixed.name.starts_with("n_");
      if (states_line && !present(*fixed.column)) missing.emplace_back(fixed.name);
    }
  }

  void check_complete() const {
    std::vector<std::string> missing;
    const bool poses = joints_.content == FileContent::poses;
    // x, y and z stand together, or another length is in their place.
    const bool replaced = !poses && (present(header_.along) || present(header_.distance)) &&
                          std::none_of(header_.position.begin(), header_.position.end(), present);
    for (const FixedColumn& fixed : fixed_) {
      const bool required = poses ? fixed.quantity == Quantity::length && fixed.required
                                  : joints_.content == FileContent::measurements && fixed.required;
      if (required && !(replaced && fixed.quantity == Quantity::length) && !present(*fixed.column))
        missing.emplace_back(fixed.name);
    }
    add_missing_of_line(missing);
    if (poses && !states_orientation(header_)) missing.emplace_back("an orientation");
    const bool with_joints = !poses || std::any_of(header_.joints.begin(), header_.joints.end(), present);
    for (std::size_t i = 0; with_joints && i < header_.joints.size(); ++i) {
      if (!present(header_.joints[i])) missing.push_back(joints_.names[i]);
    }
    for (std::size_t i = 0; states_orientation(header_) && i < kOrientationForms[header_.orientation].count(); ++i) {
      if (present(header_.orientations[header_.orientation][i])) continue;
      missing.emplace_back(kOrientationForms[header_.orientation].names[i]);
    }
    if (missing.empty()) return;
    fail(place_, (missing.size() == 1 ? "missing column " : "missing columns ") + comma_separated(missing) + ": " +
                     expected_columns(joints_) + " (an orientation's columns together)");
  }

  const ExpectedJoints& joints_;
  Place place_;
  const UnitRow* units_;
  Header header_;
  std::vector<FixedColumn> fixed_;
  std::vector<std::string> joint_names_;  ///< expected names, then followers
};

}  // namespace

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

std::string OrientationForm::words() const { return comma_separated({names.begin(), names.begin() + count()}); }

std::string orientation_note(const Header& header) {
  if (header.reading == OrientationReading::usual) return {};
  return "orientations from " + kOrientationForms[header.orientation].words() + " as " + to_string(header.reading);
}

// Not the angles of orientations: joints with those names take precedence.
std::string_view column_meaning(std::string_view name) { return translated(name, kOtherNames); }

bool is_fixed_column(std::string_view name) {
  Header header;
  const auto fixed = fixed_columns(header);
  return std::any_of(fixed.begin(), fixed.end(), [&](const FixedColumn& column) {
    return column.name == name && column.quantity != Quantity::angle;
  });
}

std::string expected_columns(const ExpectedJoints& joints) {
  std::vector<std::string> followers;
  for (const std::size_t i : joints.followers) followers.push_back(joints.joints[i].name);
  const std::string own = "the joints " + comma_separated(joints.names);
  std::string forms;
  for (const OrientationForm& form : kOrientationForms) forms += (forms.empty() ? "" : "; ") + form.words();
  const std::string orientation = "an orientation (" + forms + ")";
  std::string required = own;
  std::string optional = "configuration, target, x, y, z, ";
  if (joints.content == FileContent::measurements) {
    required = "configuration, target, x, y, z (or n_x, n_y, n_z, along; or distance) and " + own;
    optional.clear();
  } else if (joints.content == FileContent::poses) {
    required = "x, y, z and " + orientation;
    optional = own + ", configuration, target, ";
  }
  return "expected " + required + ", optionally " + optional + "split, repeat, order, sigma, station, temperature, " +
         std::string(kTemperaturePrefix) + "<link>, payload, " + std::string(kTorquePrefix) + "<joint>" +
         (joints.content == FileContent::poses ? "" : ", " + orientation) +
         (followers.empty() ? "" : " and the joints that mimic others: " + comma_separated(followers));
}

Header parse_header(std::string_view line, const ExpectedJoints& joints, const Place& place, const UnitRow* units) {
  return HeaderParser(joints, place, units).parse(line);
}

bool is_unit_row(const Fields& cells) {
  bool any = false;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const std::string unit = lower_case(unit_alone(cells[i]));
    if (unit.empty() || unit == "-") continue;
    if (std::none_of(kUnitWords.begin(), kUnitWords.end(), [&](const Word& w) { return w.first == unit; }))
      return false;
    any = true;
  }
  return any;
}

namespace {

void require_orientation_units(const Header& header, const std::string& source) {
  if (!states_orientation(header) || kOrientationForms[header.orientation].degrees_by.empty()) return;
  const OrientationForm& form = kOrientationForms[header.orientation];
  std::vector<std::string> bare;
  std::vector<std::string> cures;
  for (std::size_t i = 0; i < form.count(); ++i) {
    if (header.orientations[header.orientation][i].unit != Unit::none) continue;
    bare.emplace_back(form.names[i]);
    cures.push_back(bare.back() + "[deg]");
  }
  if (bare.empty()) return;
  fail(Place{source, header.line}, "no unit of " + comma_separated(bare) + ": write " + comma_separated(cures) +
                                       " as on pendants of " + std::string(form.degrees_by) + " (or [rad])");
}

}  // namespace

void require_clear_orientations(const Header& header, const ExpectedJoints& joints, const std::string& source) {
  require_orientation_units(header, source);
  if (joints.orientation != OrientationReading::usual) {
    if (header.reading == OrientationReading::usual) {
      fail(Place{source, header.line}, "no three numbers of an orientation are there to be read as " +
                                           to_string(joints.orientation) + ": expected rx, ry, rz or no --orientation");
    }
    return;
  }
  const auto& columns = header.orientations[kRotationVector];
  const bool in_degrees =
      std::any_of(columns.begin(), columns.end(), [](const Column& column) { return column.unit == Unit::deg; });
  if (in_degrees && joints.content == FileContent::poses) {
    fail(Place{source, header.line},
         "rx, ry, rz in degrees may be a rotation vector or angles: expected --orientation fixed-xyz (Yaskawa, "
         "Kinova), moving-xyz (Stäubli), moving-zyx or rotation-vector (UR)");
  }
}

}  // namespace kdl_calibration
