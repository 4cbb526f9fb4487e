#include "kdl_calibration/measurements.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <tuple>
#include <unordered_set>
#include <utility>

#include "base/csv.hpp"
#include "base/number_range.hpp"
#include "base/number_text.hpp"
#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/orientation_reading.hpp"
#include "measurements/configuration_means.hpp"
#include "measurements/label_table.hpp"
#include "measurements/measurement_columns.hpp"
#include "measurements/measurement_row.hpp"
#include "measurements/measurement_rows.hpp"
#include "measurements/measurements_check.hpp"
#include "measurements/missing_units.hpp"
#include "measurements/readings.hpp"
#include "measurements/stated_joints.hpp"
#include "measurements/training_rows.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

constexpr double kSamePose = 1e-4;  // [rad] or [m] largest difference between rows of one configuration

/// Gathers the rows of one file.
class Collector {
public:
  Collector(const Header& header, const std::string& source, bool with_points)
      : header_(header),
        source_(source),
        with_points_(with_points),
        joint_columns_(joint_columns(header)),
        torques_(header.torques),
        circumstances_(header.circumstances),
        link_temperatures_(header.link_temperatures) {
    joint_row_.resize(joint_columns_.size());
  }

  void reserve(std::size_t rows) {
    observations_.reserve(rows);
    lines_.reserve(rows);
  }

  void add(const Row& row, std::size_t line) {
    Observation observation;
    observation.split = row.split();
    for (std::size_t j = 0; j < joint_row_.size(); ++j) joint_row_[j] = row.number(joint_columns_[j]);
    observation.target = present(header_.target) ? label(targets_, row, header_.target) : only_target();
    if (std::cmp_greater(targets_.size(), kMostTargets)) row.fail_row("one target more than the limit of 100");
    if (present(header_.station)) take_station(row, observation);
    observation.reading = reading(row, observation.station);
    observation.configuration = configuration(row, observation);
    observation.repeat = row.repeat();
    observation.sigma = row.sigma();
    if (states_orientation(header_)) take_orientation(row, observation);
    if (present(header_.order)) observation.order = row.order();
    observations_.push_back(observation);
    lines_.push_back(line);
    torques_.add(row, observation.configuration);
    circumstances_.add(row, observation.configuration);
    link_temperatures_.add(row, observation.configuration);
  }

  Measurements finish(const ExpectedJoints& joints, const DecimalMark& decimals) && {
    if (observations_.empty()) {
      fail(source_, fmt::format("no rows after the header in line {}", header_.line));
    }
    check_duplicates();
    check_anchors();
    take_means_of_scattered_values();
    const StatedJoints stated{.header = header_, .joints = joints, .source = source_, .line = [&](Eigen::Index c) {
                                return lines_[first_rows_[static_cast<std::size_t>(c)]];
                              }};
    const Eigen::Map<Eigen::MatrixXd> read(joint_values_.data(), static_cast<Eigen::Index>(joint_columns_.size()),
                                           static_cast<Eigen::Index>(first_rows_.size()));
    Eigen::AlignedBox3d points;
    double largest_distance = 0.0;
    for (const Observation& o : observations_) {
      points.extend(o.position());
      if (const auto* const distance = std::get_if<Distance>(&o.reading)) {
        largest_distance = std::max(largest_distance, distance->length);
      }
    }
    check_missing_units(joints, {.header = header_,
                                 .source = source_,
                                 .joint_values = read,
                                 .points = points,
                                 .largest_distance = largest_distance});
    apply_convention(stated, read);
    Measurements result;
    result.source = source_;
    for (const MovingJoint& joint : joints.joints) result.joints.push_back(joint.name);
    if (joints.convention == nullptr) result.joint_units = joint_units(joints);
    result.configurations = configurations_.take_labels();
    result.targets = targets_.take_labels();
    if (stations_.size() > 0) result.stations = stations_.take_labels();
    result.observations = std::move(observations_);
    if (joints.followers.empty()) {
      std::exchange(lines_, {});  // frees memory before the joint values are copied
      std::exchange(first_rows_, {});
    }
    result.joint_values = with_followers(stated, read);
    result.signals.torques = joint_torques(torques_.means(result.configurations.size()), joints);
    result.signals.circumstances = circumstances_.means(result.configurations.size());
    result.signals.links = header_.links;
    result.signals.link_temperatures = link_temperatures_.means(result.configurations.size());
    result.signals.approach = approach_directions(result);
    result.remark = recognised(decimals);
    if (!scatter_.empty()) {
      result.remark += fmt::format(
          "{}joint values of {} configurations scatter by up to {:.2g} rad or m from row to row: their means are used",
          result.remark.empty() ? "" : "; ", scatter_.size(), largest_scatter_);
    }
    return result;
  }

private:
  static std::int32_t label(LabelTable& table, const Row& row, const Column& column) {
    const std::string_view text = name_in(row.text(column));
    const std::int32_t number = table.find(text);
    if (number < table.size()) return number;
    if (const std::string fault = label_fault(text); !fault.empty()) row.fail_cell(column, fault);
    table.add(text);
    return number;
  }

  /// Text on how the file differs from one of measurements_csv.
  std::string recognised(const DecimalMark& decimals) const {
    std::vector<std::string> notes = header_.notes;
    if (decimals.mark == ',') notes.insert(notes.begin() + (header_.separator == '\t' ? 1 : 0), "decimal commas");
    return notes.empty() ? "" : "read with " + comma_separated(notes);
  }

  /// Target index for a file of configurations without target names.
  std::int32_t only_target() {
    if (targets_.size() == 0) targets_.add("1");
    return 0;
  }

  /// For a file without configuration labels: each row is a new configuration.
  std::int32_t next_configuration() {
    configurations_.add(std::to_string(configurations_.size() + 1));
    return configurations_.size() - 1;
  }

  /// The row's configuration, checked against its earlier rows.
  std::int32_t configuration(const Row& row, const Observation& observation) {
    const std::int32_t count = configurations_.size();
    const std::int32_t number =
        present(header_.configuration) ? labelled_configuration(row, observation) : next_configuration();
    const std::size_t joints = joint_row_.size();
    if (number == count) {
      joint_values_.insert(joint_values_.end(), joint_row_.begin(), joint_row_.end());
      first_rows_.push_back(observations_.size());
      return number;
    }
    const auto index = static_cast<std::size_t>(number);
    const double* first_values = joint_values_.data() + index * joints;
    const std::size_t first_row = first_rows_[index];
    for (std::size_t j = 0; j < joints; ++j) {
      const double difference = joint_row_[j] - first_values[j];
      if (!(std::abs(difference) <= kSamePose)) fail_inconsistent(row, joint_columns_[j], "joint values", first_row);
      if (difference != 0.0) {
        std::vector<double>& sums = scatter_.try_emplace(number, joints, 0.0).first->second;
        sums[j] += difference;
        largest_scatter_ = std::max(largest_scatter_, std::abs(difference));
      }
    }
    const Observation& first = observations_[first_row];
    if (first.split != observation.split) fail_inconsistent(row, header_.split, "split", first_row);
    if (first.station != observation.station) fail_inconsistent(row, header_.station, "station", first_row);
    return number;
  }

  [[noreturn]] void fail_inconsistent(const Row& row, const Column& column, const std::string& rule,
                                      std::size_t first_row) const {
    row.fail_cell(column, fmt::format("differs from line {}: expected one {} in all rows of configuration {}",
                                      lines_[first_row], rule, shown(row.text(header_.configuration))));
  }

  /// The reading of a file of measurements, or the position in one of configurations, whose coordinates may be empty.
  Reading reading(const Row& row, std::int16_t station) {
    if (!with_points_) {
      Eigen::Vector3d position = Eigen::Vector3d::Zero();
      for (std::size_t i = 0; i < 3; ++i) {
        const Column& column = header_.position[i];
        if (row.has(column)) position[static_cast<Eigen::Index>(i)] = row.number(column);
      }
      return Point{position};
    }
    Reading result = row.reading();
    if (std::holds_alternative<Distance>(result)) {
      const bool has_place = row.has(header_.position[0]);
      if (anchors_have_places_.try_emplace(station, has_place).first->second != has_place) {
        row.fail_row(
            "x, y, z of the anchor are given in some rows of the station and empty in others: expected them "
            "in all or in none");
      }
    }
    return result;
  }

  static void take_orientation(const Row& row, Observation& observation) {
    const std::optional<Eigen::Quaterniond> orientation = row.orientation();
    if (!orientation) return;
    if (!is_whole(observation)) {
      row.fail_row("an orientation beside single coordinates or a distance: expected one of the two");
    }
    observation.reading = Pose{observation.position(), *orientation};
  }

  void take_station(const Row& row, Observation& observation) {
    const std::int32_t station = label(stations_, row, header_.station);
    if (std::cmp_greater(stations_.size(), kMostStations)) row.fail_row("one station more than the limit of 100");
    observation.station = static_cast<std::int16_t>(station);
  }

  /// The number of the row's label. Distances from another anchor than that of the first row are a configuration of
  /// their own, at the same joint values.
  std::int32_t labelled_configuration(const Row& row, const Observation& observation) {
    const std::int32_t number = label(configurations_, row, header_.configuration);
    const auto index = static_cast<std::size_t>(number);
    if (index == first_rows_.size()) return number;
    const Observation& first = observations_[first_rows_[index]];
    if (!is_distance(observation) && !is_distance(first)) return number;
    const bool same_place = is_distance(observation) == is_distance(first) && observation.station == first.station &&
                            observation.position() == first.position();
    if (same_place) return number;
    std::string text(name_in(row.text(header_.configuration)));
    const auto station = static_cast<std::size_t>(observation.station);
    text += " from " + (stations_.size() > 0 ? stations_.labels()[station] : "W");
    if (const Eigen::Vector3d& anchor = observation.position(); is_distance(observation) && !anchor.isZero(0.0)) {
      text += fmt::format(" {:.6g} {:.6g} {:.6g}", anchor.x(), anchor.y(), anchor.z());
    }
    const std::int32_t own = configurations_.find(text);
    if (own == configurations_.size()) configurations_.add(text);
    return own;
  }

  /// Replaces joint values that scatter between rows by their means.
  void take_means_of_scattered_values() {
    std::vector<double> rows(first_rows_.size(), 0.0);
    for (const Observation& o : observations_) rows[static_cast<std::size_t>(o.configuration)] += 1.0;
    const std::size_t joints = joint_row_.size();
    for (const auto& [number, sums] : scatter_) {
      const auto index = static_cast<std::size_t>(number);
      for (std::size_t j = 0; j < joints; ++j) joint_values_[index * joints + j] += sums[j] / rows[index];
    }
  }

  /// A row with the place of an anchor and no distance would be a point at the anchor.
  void check_anchors() const {
    const auto place = [](const Observation& o) {
      return std::array{static_cast<double>(o.station), o.position().x(), o.position().y(), o.position().z()};
    };
    std::set<std::array<double, 4>> anchors;
    for (const Observation& o : observations_) {
      if (is_distance(o)) anchors.insert(place(o));
    }
    if (anchors.empty()) return;
    for (std::size_t row = 0; row < observations_.size(); ++row) {
      if (is_whole(observations_[row]) && anchors.count(place(observations_[row])) > 0) {
        fail(fmt::format("{}:{}", source_, lines_[row]),
             "the distance is empty and x, y, z are those of an anchor, expected a distance or a measured point");
      }
    }
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
    // Single coordinates of one point along other directions are no duplicates.
    const auto direction = [this](std::size_t i) {
      const auto* const some = std::get_if<Coordinates>(&observations_[i].reading);
      return some == nullptr
                 ? std::array{3.0, 0.0, 0.0, 0.0}
                 : std::array{static_cast<double>(some->count), some->normal.x(), some->normal.y(), some->normal.z()};
    };
    std::sort(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) {
      return std::tuple(key(a), direction(a), a) < std::tuple(key(b), direction(b), b);
    });
    const auto twin = std::adjacent_find(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) {
      return key(a) == key(b) && direction(a) == direction(b);
    });
    if (twin == rows.end()) return;
    const Observation& o = observations_[*twin];
    fail(Place{source_, lines_[*(twin + 1)]},
         fmt::format(
             "configuration {}, repeat {}, target {} is measured twice, before in line {}: expected one row for each",
             shown(configurations_.labels()[static_cast<std::size_t>(o.configuration)]), o.repeat,
             shown(targets_.labels()[static_cast<std::size_t>(o.target)]), lines_[*twin]));
  }

  std::vector<JointUnit> joint_units(const ExpectedJoints& joints) const {
    std::vector<Column> columns(joints.joints.size());
    const std::vector<std::size_t> independent = independent_joints(joints.joints);
    for (std::size_t i = 0; i < joints.followers.size(); ++i) columns[joints.followers[i]] = header_.followers[i];
    for (std::size_t i = 0; i < independent.size(); ++i) columns[independent[i]] = header_.joints[i];
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
  const bool with_points_;
  std::vector<Column> joint_columns_;  ///< expected columns, then those of followers in the file
  LabelTable configurations_;
  LabelTable targets_;
  LabelTable stations_;
  std::vector<double> joint_values_;     ///< of the file's columns in SI, configuration by configuration
  std::vector<std::size_t> first_rows_;  ///< first row of each configuration
  std::vector<double> joint_row_;
  std::map<std::int32_t, std::vector<double>>
      scatter_;  ///< sums of differences from the first row, for configurations whose rows differ
  double largest_scatter_ = 0.0;
  std::vector<Observation> observations_;
  std::map<std::int16_t, bool> anchors_have_places_;  ///< of stations with distances, whether x, y, z are given
  ConfigurationMeans torques_;
  ConfigurationMeans circumstances_;
  ConfigurationMeans link_temperatures_;
  std::vector<std::size_t> lines_;  ///< line of each observation
};

Measurements collect(LineReader& lines, const std::vector<MovingJoint>& chain, const JointConvention* convention,
                     const FileKind& kind) {
  require_at_least("moving joints to read", chain.size(), 1);
  MeasurementRows rows(lines, chain, convention, kind);
  Collector collector(rows.header(), lines.source(), kind.content == FileContent::measurements);
  for (bool first = true; rows.next(); first = false) {
    collector.add(rows.row(), lines.place().line);
    // Rows have similar lengths; reserved memory in excess is never touched.
    if (first) collector.reserve(lines.size_hint() / rows.line().size() + 1);
  }
  return std::move(collector).finish(rows.joints(), rows.decimals());
}

/// Independent joints of which only the names are known.
std::vector<MovingJoint> joints_named(const std::vector<std::string>& names) {
  std::vector<MovingJoint> joints(names.size());
  for (std::size_t i = 0; i < names.size(); ++i) joints[i].name = names[i];
  return joints;
}

}  // namespace

Measurements parse_measurements(std::string_view csv, const std::vector<std::string>& urdf_joints,
                                const JointConvention* convention, const std::string& source) {
  LineReader lines(csv, source);
  return collect(lines, joints_named(urdf_joints), convention, {.kinds_known = false});
}

Measurements parse_measurements(const Robot& robot, std::string_view csv, const JointConvention* convention,
                                const std::string& source) {
  return parse_measurements(robot, csv, convention, source, OrientationReading::usual);
}

Measurements parse_measurements(const Robot& robot, std::string_view csv, const JointConvention* convention,
                                const std::string& source, OrientationReading reading) {
  LineReader lines(csv, source);
  return collect(lines, robot.joints, convention, {.orientation = reading, .links = link_names(robot)});
}

Measurements read_measurements(const std::filesystem::path& file, const std::vector<std::string>& urdf_joints,
                               const JointConvention* convention) {
  LineReader lines(file);
  return collect(lines, joints_named(urdf_joints), convention, {.kinds_known = false});
}

Measurements read_measurements(const Robot& robot, const std::filesystem::path& file,
                               const JointConvention* convention) {
  return read_measurements(robot, file, convention, OrientationReading::usual);
}

Measurements read_measurements(const Robot& robot, const std::filesystem::path& file, const JointConvention* convention,
                               OrientationReading reading) {
  LineReader lines(file);
  return collect(lines, robot.joints, convention, {.orientation = reading, .links = link_names(robot)});
}

Measurements parse_configurations(std::string_view csv, const std::vector<std::string>& urdf_joints,
                                  const JointConvention* convention, const std::string& source) {
  LineReader lines(csv, source);
  return collect(lines, joints_named(urdf_joints), convention,
                 {.kinds_known = false, .content = FileContent::configurations});
}

Measurements read_configurations(const std::filesystem::path& file, const std::vector<std::string>& urdf_joints,
                                 const JointConvention* convention) {
  LineReader lines(file);
  return collect(lines, joints_named(urdf_joints), convention,
                 {.kinds_known = false, .content = FileContent::configurations});
}

Measurements read_configurations(const Robot& robot, const std::filesystem::path& file,
                                 const JointConvention* convention) {
  LineReader lines(file);
  return collect(lines, robot.joints, convention, {.content = FileContent::configurations, .links = link_names(robot)});
}

}  // namespace kdl_calibration
