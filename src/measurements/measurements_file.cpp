#include "kdl_calibration/measurements_file.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <system_error>
#include <tuple>
#include <unordered_set>
#include <utility>

#include "base/csv.hpp"
#include "base/number_range.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements_check.hpp"
#include "kdl_calibration/mimic.hpp"
#include "measurements/measurement_columns.hpp"

namespace kdl_calibration {
namespace {

constexpr std::int32_t kMostTargets = 100;
constexpr double kQuaternionTolerance = 1e-3;
constexpr double kRoundedJointValue = 1e-5;  // [rad] or [m] that rounding may cost: half of 0.001 deg, of 0.01 mm

/// Why a cell that should hold a number does not.
std::string number_fault(std::string_view text, std::errc error, double value) {
  if (text.empty()) return "is empty: expected a number";
  if (error == std::errc::result_out_of_range) return "is outside the range of a double";
  if (error == std::errc() && !std::isfinite(value)) return "is not finite: expected a finite number";
  if (error == std::errc()) return "is out of range: expected at most 1e12";
  const bool comma = text.find(',') != std::string_view::npos;
  if (comma && text.find_first_not_of("0123456789+-.,eE") == std::string_view::npos) {
    return "has a decimal comma: expected a number with a decimal point";
  }
  return "is not a number";
}

/// One row of the file, read cell by cell.
class Row {
public:
  Row(const Header& header, const Fields& fields, const Place& place)
      : header_(header), fields_(fields), place_(place) {
    if (fields.size() != header.fields) fail_ragged();
    for (std::size_t i = header.names.size(); i < fields.size(); ++i) {
      if (!trimmed(fields[i]).empty()) fail(place, "value " + shown(fields[i]) + " in a column without a name");
    }
  }

  const Header& header() const { return header_; }
  bool has(const Column& column) const { return present(column) && !trimmed(fields_[column.index]).empty(); }
  std::string_view text(const Column& column) const { return fields_[column.index]; }

  double number(const Column& column) const {
    const std::string_view text = trimmed(fields_[column.index]);
    const char* first = text.data();
    const char* last = first + text.size();
    if (text.size() > 1 && text[0] == '+' && text[1] != '-') ++first;  // which from_chars does not take
    double value = 0.0;
    const auto [end, error] = std::from_chars(first, last, value);
    if (error != std::errc() || end != last || !(std::abs(value) <= kLargestNumber)) {
      fail_cell(column, number_fault(text, end == last ? error : std::errc::invalid_argument, value));
    }
    return to_si(value, column.unit);
  }

  Split split() const {
    if (!has(header_.split)) return Split::train;
    const std::string_view text = trimmed(fields_[header_.split.index]);
    if (text == "train") return Split::train;
    if (text == "test") return Split::test;
    fail_cell(header_.split, "is no split: expected train or test");
  }

  std::int32_t repeat() const {
    if (!has(header_.repeat)) return 1;
    const std::string_view text = trimmed(fields_[header_.repeat.index]);
    std::int32_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || value < 0) {
      fail_cell(header_.repeat, "is no repeat: expected an integer from 0 to 2147483647");
    }
    return value;
  }

  std::int64_t order() const {
    const std::string_view text = trimmed(fields_[header_.order.index]);
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size()) {
      fail_cell(header_.order, "is no place in an order: expected an integer");
    }
    return value;
  }

  double sigma() const {
    if (!has(header_.sigma)) return 0.0;
    const double value = number(header_.sigma);
    if (!(value > 0.0)) fail_cell(header_.sigma, "is not positive: expected a standard deviation above 0");
    if (value < kSmallestSigma) fail_cell(header_.sigma, "is out of range: expected at least 1e-15 m");
    return value;
  }

  /// All NaN where the row measures a point alone.
  Eigen::Quaterniond quaternion() const {
    const auto& columns = header_.quaternion;
    const auto given = std::count_if(columns.begin(), columns.end(), [&](const Column& c) { return has(c); });
    if (given == 0) return point_alone();
    if (given != 4) fail(place_, "the quaternion has an empty cell: expected all of qw, qx, qy, qz or none");
    const Eigen::Quaterniond q(number(columns[0]), number(columns[1]), number(columns[2]), number(columns[3]));
    const double norm = q.norm();
    if (!(std::abs(norm - 1.0) <= kQuaternionTolerance)) {
      fail(place_, "the norm of the quaternion (qw " + shown(text(columns[0])) + ", ...) is " + shortest(norm) +
                       ": expected 1 within 0.001");
    }
    // What is normalised to rounding stays to the last bit, so that a written file reads back the same.
    constexpr double kRounding = 8 * std::numeric_limits<double>::epsilon();
    return std::abs(norm - 1.0) <= kRounding ? q : Eigen::Quaterniond(q.coeffs() / norm);
  }

  [[noreturn]] void fail_cell(const Column& column, const std::string& what) const {
    fail(place_, header_.names[column.index] + " " + shown(fields_[column.index]) + " " + what);
  }
  [[noreturn]] void fail_row(const std::string& what) const { fail(place_, what); }

private:
  [[noreturn]] void fail_ragged() const {
    const bool more_commas = header_.separator == ',' && fields_.size() > header_.fields;
    fail(place_, std::to_string(fields_.size()) + " fields, expected " + std::to_string(header_.fields) +
                     " as in the header in line " + std::to_string(header_.line) +
                     (more_commas ? " (decimal commas are not read)" : ""));
  }

  const Header& header_;
  const Fields& fields_;
  Place place_;
};

/// Numbers labels in the order of their first appearance.
class LabelTable {
public:
  LabelTable() : index_(16, Hash{&labels_}, Equal{&labels_}) {}
  LabelTable(const LabelTable&) = delete;
  LabelTable& operator=(const LabelTable&) = delete;

  /// The number of the label, or the size of the table for a new one.
  /// Files go through their labels in order, so the last one and the one behind it are tried before the hash.
  std::int32_t find(std::string_view label) {
    const std::int32_t next = last_ + 1 < size() ? last_ + 1 : 0;
    for (const std::int32_t guess : {last_, next}) {
      if (guess < size() && labels_[static_cast<std::size_t>(guess)] == label) return last_ = guess;
    }
    const auto found = index_.find(label);
    return found == index_.end() ? size() : last_ = *found;
  }

  void add(std::string_view label) {
    last_ = size();
    labels_.emplace_back(label);
    index_.insert(last_);
  }

  std::int32_t size() const { return static_cast<std::int32_t>(labels_.size()); }
  const std::vector<std::string>& labels() const { return labels_; }

  /// Leaves the table empty.
  std::vector<std::string> take_labels() {
    index_ = Index(0, Hash{&labels_}, Equal{&labels_});
    last_ = 0;
    return std::exchange(labels_, {});
  }

private:
  // The set holds numbers alone; the text of a label is kept once.
  struct Hash {
    using is_transparent = void;
    const std::vector<std::string>* labels;
    std::size_t operator()(std::string_view label) const { return std::hash<std::string_view>()(label); }
    std::size_t operator()(std::int32_t i) const { return (*this)((*labels)[static_cast<std::size_t>(i)]); }
  };
  struct Equal {
    using is_transparent = void;
    const std::vector<std::string>* labels;
    bool operator()(std::int32_t a, std::int32_t b) const { return a == b; }
    bool operator()(std::string_view a, std::int32_t b) const { return a == (*labels)[static_cast<std::size_t>(b)]; }
    bool operator()(std::int32_t a, std::string_view b) const { return (*this)(b, a); }
  };

  using Index = std::unordered_set<std::int32_t, Hash, Equal>;

  std::vector<std::string> labels_;
  Index index_;
  std::int32_t last_ = 0;
};

/// Gathers the rows of one file.
class Collector {
public:
  Collector(const Header& header, const std::string& source)
      : header_(header), source_(source), joint_columns_(header.joints) {
    std::copy_if(header.followers.begin(), header.followers.end(), std::back_inserter(joint_columns_), present);
    joint_row_.resize(joint_columns_.size());
  }

  void reserve(std::size_t rows) {
    observations_.reserve(rows);
    lines_.reserve(rows);
  }

  void add(const Row& row, std::size_t line) {
    Observation observation;
    observation.split = row.split();
    observation.configuration = configuration(row, observation.split);
    observation.target = label(targets_, row, header_.target);
    if (targets_.size() > kMostTargets) row.fail_row("one target more than the limit of 100");
    observation.repeat = row.repeat();
    for (std::size_t i = 0; i < 3; ++i) {
      observation.position[static_cast<Eigen::Index>(i)] = row.number(header_.position[i]);
    }
    observation.sigma = row.sigma();
    observations_.push_back(observation);
    lines_.push_back(line);
    if (present(header_.quaternion[0])) orientations_.push_back(row.quaternion());
    if (present(header_.order)) order_.push_back(row.order());
  }

  Measurements finish(const ExpectedJoints& joints) && {
    if (observations_.empty()) {
      fail(source_, "no measurement behind the header in line " + std::to_string(header_.line));
    }
    check_duplicates();
    check_missing_units(joints);
    Measurements result;
    result.source = source_;
    for (const MovingJoint& joint : joints.joints) result.joints.push_back(joint.name);
    if (joints.convention == nullptr) {
      result.joint_units = joint_units(joints);
    } else {
      convert_joints(*joints.convention);
    }
    result.configurations = configurations_.take_labels();
    result.targets = targets_.take_labels();
    result.observations = std::move(observations_);
    drop_unused_orientations(orientations_);
    result.orientations = std::move(orientations_);
    result.order = std::move(order_);
    if (joints.followers.empty()) {
      std::exchange(lines_, {});  // before the joint values are there twice
      std::exchange(first_rows_, {});
    }
    const auto rows = static_cast<Eigen::Index>(joint_columns_.size());
    const auto columns = static_cast<Eigen::Index>(result.configurations.size());
    const Eigen::Map<const Eigen::MatrixXd> read(joint_values_.data(), rows, columns);
    if (joints.followers.empty()) {
      result.joint_values = read;
    } else {
      const auto independent = static_cast<Eigen::Index>(header_.joints.size());
      result.joint_values = all_joint_values(joints.joints, read.topRows(independent));
      check_followers(joints, read.bottomRows(rows - independent), result.joint_values);
    }
    return result;
  }

private:
  static std::int32_t label(LabelTable& table, const Row& row, const Column& column) {
    const std::string_view text = row.text(column);
    const std::int32_t number = table.find(text);
    if (number < table.size()) return number;
    if (const std::string fault = label_fault(text); !fault.empty()) row.fail_cell(column, fault);
    table.add(text);
    return number;
  }

  /// The row's configuration, checked against the rows of the same one before.
  std::int32_t configuration(const Row& row, Split split) {
    const std::int32_t count = configurations_.size();
    const std::int32_t number = label(configurations_, row, header_.configuration);
    const std::size_t joints = joint_row_.size();
    for (std::size_t j = 0; j < joints; ++j) joint_row_[j] = row.number(joint_columns_[j]);
    if (number == count) {
      joint_values_.insert(joint_values_.end(), joint_row_.begin(), joint_row_.end());
      first_rows_.push_back(observations_.size());
      return number;
    }
    const auto index = static_cast<std::size_t>(number);
    const double* first_values = joint_values_.data() + index * joints;
    const std::size_t first_row = first_rows_[index];
    for (std::size_t j = 0; j < joints; ++j) {
      if (joint_row_[j] != first_values[j]) fail_inconsistent(row, joint_columns_[j], "joint values", first_row);
    }
    if (split != observations_[first_row].split) fail_inconsistent(row, header_.split, "split", first_row);
    return number;
  }

  [[noreturn]] void fail_inconsistent(const Row& row, const Column& column, const std::string& rule,
                                      std::size_t first_row) const {
    row.fail_cell(column, "differs from line " + std::to_string(lines_[first_row]) + ": expected one " + rule +
                              " in all rows of configuration " + shown(row.text(header_.configuration)));
  }

  void check_duplicates() const {
    const auto key = [this](std::size_t i) {
      const Observation& o = observations_[i];
      return std::tuple(o.configuration, o.repeat, o.target);
    };
    std::size_t ordered = 1;
    while (ordered < observations_.size() && key(ordered - 1) < key(ordered)) ++ordered;
    if (ordered == observations_.size()) return;
    std::vector<std::size_t> rows(observations_.size());
    std::iota(rows.begin(), rows.end(), std::size_t{0});
    std::sort(rows.begin(), rows.end(),
              [&](std::size_t a, std::size_t b) { return std::tuple(key(a), a) < std::tuple(key(b), b); });
    const auto twin =
        std::adjacent_find(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) { return key(a) == key(b); });
    if (twin == rows.end()) return;
    const Observation& o = observations_[*twin];
    fail(Place{source_, lines_[*(twin + 1)]},
         "configuration " + shown(configurations_.labels()[static_cast<std::size_t>(o.configuration)]) + ", repeat " +
             std::to_string(o.repeat) + ", target " + shown(targets_.labels()[static_cast<std::size_t>(o.target)]) +
             " is measured twice, before in line " + std::to_string(lines_[*twin]) + ": expected one row for each");
  }

  /// Throws where a column without a unit holds what no robot has in rad or m.
  void check_missing_units(const ExpectedJoints& joints) const {
    if (!joints.kinds_known) return;
    const std::size_t columns = joint_row_.size();
    for (std::size_t j = 0; j < header_.joints.size(); ++j) {
      if (header_.joints[j].unit != Unit::none) continue;
      double largest = 0.0;
      for (std::size_t i = j; i < joint_values_.size(); i += columns) {
        largest = std::max(largest, std::abs(joint_values_[i]));
      }
      const ValueKind kind = kind_of_value(joints, j);
      const std::string& name = joints.names[j];
      if (kind == ValueKind::angle && largest > largest_angle(joints)) {
        fail(source_, "joint values of " + shown(name) + " up to " + shortest(largest) +
                          " without a unit are no radians: degrees? write " + printable(name) + "[deg] (or [rad])");
      }
      if (kind == ValueKind::length && largest > largest_length(joints)) {
        fail(source_, "joint values of " + shown(name) + " up to " + shortest(largest) +
                          " without a unit are no metres: millimetres? write " + printable(name) + "[mm] (or [m])");
      }
    }
    check_missing_units_of_points(joints);
  }

  void check_missing_units_of_points(const ExpectedJoints& joints) const {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (header_.position[axis].unit != Unit::none) continue;
      const auto of_axis = [&](const Observation& o) { return o.position[static_cast<Eigen::Index>(axis)]; };
      const auto [low, high] =
          std::minmax_element(observations_.begin(), observations_.end(),
                              [&](const auto& a, const auto& b) { return of_axis(a) < of_axis(b); });
      const double apart = of_axis(*high) - of_axis(*low);
      if (apart > largest_length(joints)) {
        const char name = "xyz"[axis];
        fail(source_, "targets " + rounded(apart) + " m apart along " + name +
                          " without a unit are beyond this robot: millimetres? write " + name + "[mm] (or [m])");
      }
    }
  }

  static std::string rounded(double value) { return shortest(std::round(value)); }

  /// Two turns, or twice the widest limit.
  static double largest_angle(const ExpectedJoints& joints) {
    double largest = 2.0 * std::numbers::pi;
    for (const MovingJoint& joint : joints.joints) {
      if (joint.type != JointType::prismatic) {
        largest = std::max({largest, std::abs(joint.lower.value_or(0.0)), std::abs(joint.upper.value_or(0.0))});
      }
    }
    return 2.0 * largest;
  }

  /// Twenty times what the arm reaches, tools of a metre included.
  static double largest_length(const ExpectedJoints& joints) {
    double reach = 1.0;
    for (const MovingJoint& joint : joints.joints) {
      reach += joint.origin.p.Norm();
      if (joint.type == JointType::prismatic) {
        reach += std::max({1.0, std::abs(joint.lower.value_or(0.0)), std::abs(joint.upper.value_or(0.0))});
      }
    }
    return 20.0 * reach;
  }

  /// One configuration after the other, so that its values do not depend on where it stands.
  void convert_joints(const JointConvention& convention) {
    const auto size = static_cast<Eigen::Index>(header_.joints.size());
    for (std::size_t c = 0; c < first_rows_.size(); ++c) {
      Eigen::Map<Eigen::VectorXd> values(joint_values_.data() + c * joint_row_.size(), size);
      values = (convention.matrix * values + convention.offset).eval();
      if (!(values.cwiseAbs().maxCoeff() <= kLargestNumber)) {
        fail(Place{source_, lines_[first_rows_[c]]},
             "joint values out of range behind the joint convention " + convention.name + ": expected at most 1e12");
      }
    }
  }

  /// Throws where the column of a follower says otherwise than its leader's: `read` has one row for each column.
  void check_followers(const ExpectedJoints& joints, const Eigen::Ref<const Eigen::MatrixXd>& read,
                       const Eigen::MatrixXd& joint_values) const {
    Eigen::Index row = 0;
    for (std::size_t i = 0; i < joints.followers.size(); ++i) {
      const Column& column = header_.followers[i];
      if (!present(column)) continue;
      const MovingJoint& joint = joints.joints[joints.followers[i]];
      const auto expected = joint_values.row(static_cast<Eigen::Index>(joints.followers[i]));
      const double tolerance = kRoundedJointValue * (1.0 + std::abs(joint.mimic->multiplier));
      for (Eigen::Index c = 0; c < read.cols(); ++c) {
        if (std::abs(read(row, c) - expected[c]) <= tolerance) continue;
        const std::string& leader = joints.joints[joint.mimic->leader].name;
        fail(Place{source_, lines_[first_rows_[static_cast<std::size_t>(c)]]},
             header_.names[column.index] + " " + shown(in_unit(read(row, c), column.unit)) +
                 " contradicts the URDF, where the joint mimics " + shown(leader) + ": expected " +
                 in_unit(expected[c], column.unit) + " (" + shortest(joint.mimic->multiplier) + " times that of " +
                 shown(leader) + " plus " + in_unit(joint.mimic->offset, column.unit) + ")");
      }
      ++row;
    }
  }

  std::vector<JointUnit> joint_units(const ExpectedJoints& joints) const {
    std::vector<Column> columns(joints.joints.size());
    const std::vector<std::size_t> independent = independent_joints(joints.joints);
    for (std::size_t i = 0; i < independent.size(); ++i) columns[independent[i]] = header_.joints[i];
    for (std::size_t i = 0; i < joints.followers.size(); ++i) columns[joints.followers[i]] = header_.followers[i];
    std::vector<JointUnit> units;
    for (const Column& column : columns) {
      const bool angle = column.unit == Unit::rad || column.unit == Unit::deg;
      units.push_back(column.unit == Unit::none ? JointUnit::unstated : angle ? JointUnit::radian : JointUnit::metre);
    }
    const bool any = std::any_of(units.begin(), units.end(), [](JointUnit u) { return u != JointUnit::unstated; });
    return any ? units : std::vector<JointUnit>();
  }

  const Header& header_;
  const std::string& source_;
  std::vector<Column> joint_columns_;  ///< the expected ones, then those of followers that the file has
  LabelTable configurations_;
  LabelTable targets_;
  std::vector<double> joint_values_;     ///< as the file has them but in SI, configuration by configuration
  std::vector<std::size_t> first_rows_;  ///< of each configuration
  std::vector<double> joint_row_;
  std::vector<Observation> observations_;
  std::vector<Eigen::Quaterniond> orientations_;
  std::vector<std::int64_t> order_;
  std::vector<std::size_t> lines_;  ///< of each observation
};

Measurements collect(LineReader& lines, const std::vector<MovingJoint>& chain, const JointConvention* convention,
                     bool kinds_known) {
  const std::vector<std::string> urdf_joints = independent_joint_names(chain);
  std::optional<JointConvention> matched;
  if (convention != nullptr) matched = matched_convention(*convention, urdf_joints);
  ExpectedJoints joints{matched ? matched->controller_joints : urdf_joints,
                        urdf_joints,
                        matched ? &*matched : nullptr,
                        chain,
                        {},
                        kinds_known};
  for (std::size_t i = 0; i < chain.size(); ++i) {
    if (chain[i].mimic) joints.followers.push_back(i);
  }
  std::string_view line;
  if (!next_record(lines, line)) fail(lines.source(), "empty: " + expected_columns(joints));
  const Header header = parse_header(line, joints, lines.place());
  Collector collector(header, lines.source());
  Fields fields;
  for (bool first = true; next_record(lines, line); first = false) {
    fields.split(line, header.separator, lines.place());
    collector.add(Row(header, fields, lines.place()), lines.place().line);
    // Rows are about equally long; what is reserved too much is never touched.
    if (first) collector.reserve(lines.size_hint() / line.size() + 1);
  }
  return std::move(collector).finish(joints);
}

/// Joints that follow none, of which only the names are known.
std::vector<MovingJoint> joints_named(const std::vector<std::string>& names) {
  std::vector<MovingJoint> joints(names.size());
  for (std::size_t i = 0; i < names.size(); ++i) joints[i].name = names[i];
  return joints;
}

template <typename Number>
void append_number(std::string& text, Number value) {
  std::array<char, 32> digits{};
  const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), value);
  text.append(digits.data(), end);
}

std::vector<std::string> csv_labels(const std::vector<std::string>& labels, const char* what,
                                    const std::string& source) {
  std::vector<std::string> fields;
  for (const std::string& label : labels) {
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
};

UsedColumns used_columns(const Measurements& measurements) {
  UsedColumns used;
  used.quaternion = !measurements.orientations.empty();
  used.order = !measurements.order.empty();
  for (const Observation& o : measurements.observations) {
    used.split = used.split || o.split == Split::test;
    used.repeat = used.repeat || o.repeat != 1;
    used.sigma = used.sigma || o.sigma > 0.0;
  }
  return used;
}

std::string csv_header(const Measurements& measurements, const UsedColumns& used) {
  std::string text = "configuration";
  if (used.split) text += ",split";
  if (used.repeat) text += ",repeat";
  text += ",target";
  const std::vector<std::string> names = csv_labels(measurements.joints, "joint", measurements.source);
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (is_fixed_column(measurements.joints[i])) {
      fail(measurements.source, "joint " + shown(names[i]) + " is named like a column of the measurements");
    }
    const JointUnit unit = measurements.joint_units.empty() ? JointUnit::unstated : measurements.joint_units[i];
    std::string name = measurements.joints[i];
    if (unit == JointUnit::radian) name += "[rad]";
    if (unit == JointUnit::metre) name += "[m]";
    text += "," + csv_field(name);
  }
  text += ",x[m],y[m],z[m]";
  if (used.quaternion) text += ",qw,qx,qy,qz";
  if (used.sigma) text += ",sigma[m]";
  if (used.order) text += ",order";
  return text + "\n";
}

}  // namespace

Measurements parse_measurements(std::string_view csv, const std::vector<std::string>& urdf_joints,
                                const JointConvention* convention, const std::string& source) {
  LineReader lines(csv, source);
  return collect(lines, joints_named(urdf_joints), convention, false);
}

Measurements parse_measurements(const Robot& robot, std::string_view csv, const JointConvention* convention,
                                const std::string& source) {
  LineReader lines(csv, source);
  return collect(lines, robot.joints, convention, true);
}

Measurements read_measurements(const std::filesystem::path& file, const std::vector<std::string>& urdf_joints,
                               const JointConvention* convention) {
  LineReader lines(file);
  return collect(lines, joints_named(urdf_joints), convention, false);
}

Measurements read_measurements(const Robot& robot, const std::filesystem::path& file,
                               const JointConvention* convention) {
  LineReader lines(file);
  return collect(lines, robot.joints, convention, true);
}

std::string measurements_csv(const Measurements& measurements) {
  check(measurements);
  const UsedColumns used = used_columns(measurements);
  std::string text = csv_header(measurements, used);
  const auto configurations = csv_labels(measurements.configurations, "configuration", measurements.source);
  const auto targets = csv_labels(measurements.targets, "target", measurements.source);
  const auto append_cell = [&text](auto value) {
    text += ',';
    append_number(text, value);
  };
  for (std::size_t i = 0; i < measurements.observations.size(); ++i) {
    const Observation& o = measurements.observations[i];
    text += configurations[static_cast<std::size_t>(o.configuration)];
    if (used.split) text += o.split == Split::test ? ",test" : ",train";
    if (used.repeat) append_cell(o.repeat);
    text += "," + targets[static_cast<std::size_t>(o.target)];
    for (const double value : measurements.joint_values.col(o.configuration)) append_cell(value);
    for (const double value : o.position) append_cell(value);
    if (used.quaternion) {
      const Eigen::Quaterniond& q = measurements.orientations[i];
      if (is_point(q))
        text += ",,,,";
      else
        for (const double value : {q.w(), q.x(), q.y(), q.z()}) append_cell(value);
    }
    if (used.sigma) {
      if (o.sigma > 0.0)
        append_cell(o.sigma);
      else
        text += ',';
    }
    if (used.order) append_cell(measurements.order[i]);
    text += '\n';
  }
  return text;
}

}  // namespace kdl_calibration
