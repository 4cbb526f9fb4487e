#include "cli/joined_files.hpp"

#include <fmt/core.h>
#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <vector>

#include "base/csv.hpp"
#include "base/text.hpp"
#include "base/units.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/measurement_columns.hpp"
#include "measurements/point_export.hpp"
#include "measurements/stations.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr std::string_view kConfiguration = "{configuration}";
constexpr std::string_view kTarget = "{target}";

struct PointName {
  std::string configuration;
  std::string target;
};

// The text before, between and behind the two words of a pattern.
class NamePattern {
public:
  explicit NamePattern(const std::string& pattern) {
    const std::size_t configuration = pattern.find(kConfiguration);
    const std::size_t target = pattern.find(kTarget);
    target_first_ = target < configuration;
    const std::string_view first = target_first_ ? kTarget : kConfiguration;
    const std::size_t begin = std::min(configuration, target);
    const std::size_t second = std::max(configuration, target);
    if (second == std::string::npos || second <= begin + first.size()) {
      throw InputError("--point-names: " + shown(pattern) +
                       ", expected a pattern such as C{configuration}_{target}, with some text between the two");
    }
    before_ = pattern.substr(0, begin);
    between_ = pattern.substr(begin + first.size(), second - begin - first.size());
    behind_ = pattern.substr(second + (target_first_ ? kConfiguration : kTarget).size());
  }

  // None if the name does not fit.
  std::optional<PointName> parts(std::string_view name) const {
    const std::size_t middle = name.find(between_, before_.size());
    const bool fits = name.starts_with(before_) && name.ends_with(behind_) && middle != std::string_view::npos &&
                      middle > before_.size() && middle + between_.size() + behind_.size() < name.size();
    if (!fits) {
      return std::nullopt;
    }
    const std::string_view rest = name.substr(middle + between_.size());
    std::string first(name.substr(before_.size(), middle - before_.size()));
    std::string second(rest.substr(0, rest.size() - behind_.size()));
    return target_first_ ? PointName{.configuration = std::move(second), .target = std::move(first)}
                         : PointName{.configuration = std::move(first), .target = std::move(second)};
  }

private:
  std::string before_;
  std::string between_;
  std::string behind_;
  bool target_first_ = false;
};

// All digits of a number without a decimal point, which the points' file may write as a comma.
std::string pointless(double value) {
  std::string text = fmt::format("{:.16e}", value);
  const std::size_t e = text.find('e');
  const int exponent = std::stoi(text.substr(e + 1)) - 16;
  text.resize(e);
  text.erase(std::remove(text.begin(), text.end(), '.'), text.end());
  return fmt::format("{}e{}", text, exponent);
}

// Names that a column of a joint may have, in lower case.
std::set<std::string> names_of_joints(const Robot& robot, const JointConvention* convention) {
  std::set<std::string> names;
  for (const MovingJoint& joint : robot.joints) {
    names.insert({lower_case(joint.name), lower_case(drive_of(joint).name)});
  }
  for (std::size_t i = 0; convention != nullptr && i < convention->controller_joints.size(); ++i) {
    names.insert(lower_case(convention->controller_joints[i]));
  }
  return names;
}

// The cells in front of every row of a configuration: its label, then the values of the independent joints.
std::map<std::string, std::string> heads_of(const Robot& robot, const Measurements& configurations, char separator) {
  const Eigen::MatrixXd values = independent_joint_values(robot.joints, configurations.joint_values);
  std::map<std::string, std::string> heads;
  for (Eigen::Index c = 0; c < values.cols(); ++c) {
    const std::string& label = configurations.configurations[static_cast<std::size_t>(c)];
    std::string head = csv_field(label) + separator;
    for (const double value : values.col(c)) {
      head += pointless(value) + separator;
    }
    heads[label] = head;
  }
  return heads;
}

std::string heading_of(const Robot& robot, char separator) {
  std::string head = std::string("configuration") + separator;
  for (const std::size_t i : independent_joints(robot.joints)) {
    const MovingJoint& joint = robot.joints[i];
    head += csv_field(drive_of(joint).name + (joint.type == JointType::prismatic ? "[m]" : "[rad]")) + separator;
  }
  return head;
}

std::string meaning_of(std::string_view column) {
  return lower_case(column_meaning(name_and_unit(trimmed(column)).first));
}

std::optional<std::size_t> column_of(std::string_view meaning, const Fields& heading) {
  for (std::size_t i = 0; i < heading.size(); ++i) {
    if (meaning_of(heading[i]) == meaning) {
      return i;
    }
  }
  return std::nullopt;
}

std::map<std::string, Eigen::Index> columns_of(const Measurements& configurations) {
  std::map<std::string, Eigen::Index> columns;
  for (const std::string& label : configurations.configurations) {
    columns.emplace(label, std::ssize(columns));
  }
  return columns;
}

// What the file of joint values also says of its configurations: a heading, and the cell of each label.
struct SharedColumn {
  std::string name;
  std::map<std::string, std::string> cells;
};

std::vector<SharedColumn> shared_columns(const Measurements& configurations) {
  const std::vector<Observation>& rows = configurations.observations;
  SharedColumn split{.name = "split", .cells = {}};
  SharedColumn station{.name = "station", .cells = {}};
  SharedColumn order{.name = "order", .cells = {}};
  for (const Observation& o : rows) {
    const std::string& label = configurations.configurations[static_cast<std::size_t>(o.configuration)];
    split.cells.emplace(label, o.split == Split::test ? "test" : "train");
    station.cells.emplace(label, configurations.stations[static_cast<std::size_t>(o.station)]);
    order.cells.emplace(label, o.order ? std::to_string(*o.order) : "");
  }
  std::vector<SharedColumn> result;
  if (std::any_of(rows.begin(), rows.end(), [](const Observation& o) { return o.split == Split::test; })) {
    result.push_back(std::move(split));
  }
  if (names_stations(configurations)) {
    result.push_back(std::move(station));
  }
  if (rows.front().order) {
    result.push_back(std::move(order));
  }
  return result;
}

std::string labels_in(const std::string& file, const Measurements& configurations) {
  constexpr std::size_t kLongest = 120;
  return "expected a configuration of " + file + ": " +
         shortened(comma_separated(configurations.configurations), kLongest);
}

// Puts the joint values in front of the points' rows. Lines keep their numbers, so that messages name the right one.
class Joining {
public:
  Joining(const Robot& robot, const JoinedFiles& files, const JointConvention* convention)
      : robot_(robot),
        files_(files),
        convention_(convention),
        joint_names_(names_of_joints(robot, convention)),
        configurations_(read_configurations(robot, files.joint_values, convention)),
        columns_(columns_of(configurations_)),
        pattern_(files.names.empty() ? std::nullopt : std::optional<NamePattern>(files.names)),
        lines_(std::filesystem::path(files.points)) {}

  // The rows of both files, and torques and circumstances, which belong to configurations.
  Measurements read() {
    Measurements measurements = parse_measurements(robot_, csv(), nullptr, files_.points, files_.orientation);
    take(&DriveSignals::torques, "torques", measurements);
    take(&DriveSignals::circumstances, "temperature or payload", measurements);
    take(&DriveSignals::link_temperatures, "temperatures of links", measurements);
    if (measurements.signals.links.empty()) {
      measurements.signals.links = configurations_.signals.links;
    }
    return measurements;
  }

private:
  std::string csv() {
    for (std::string_view line; lines_.next(line);) {
      if (line.find_first_not_of(" \t,;") == std::string_view::npos || is_comment(line)) {
        csv_ += "\n";
        if (separator_ == '\0' && is_comment(line)) {
          comments_.push_back({std::string(line), lines_.place().line});
        }
      } else if (separator_ != '\0' || header_is_row(line)) {
        add_row(line);
      }
    }
    return std::move(csv_);
  }

  // Reads the header; whether the line is a row as well, as an export states its columns in a comment.
  bool header_is_row(std::string_view line) {
    const std::optional<ExportHeader> stated = export_header(comments_, line, lines_.source());
    const std::string header = stated ? stated->text : std::string(line);
    separator_ = separator_of(header);
    cells_.split(header, separator_, lines_.place());
    name_ = column_of("target", cells_);
    label_ = column_of("configuration", cells_);
    if (!name_ || label_.has_value() == pattern_.has_value()) {
      fail(lines_.place(), pattern_ ? "expected a column 'name' and, with --point-names, no column 'configuration'"
                                    : "expected a column 'configuration' beside --joints-file, or --point-names");
    }
    heads_ = heads_of(robot_, configurations_, separator_);
    shared_ = shared_columns(configurations_);
    const bool is_row = stated && stated->before_first;
    if (is_row) {
      csv_.pop_back();  // the header takes the place of a comment
    }
    csv_ += heading_of(robot_, separator_);
    in_front_.assign(cells_.size(), false);
    for (const SharedColumn& column : shared_) {
      csv_ += column.name + separator_;
      own_.push_back(column_of(column.name, cells_));
      if (own_.back()) {
        in_front_[*own_.back()] = true;
      }
    }
    if (label_) {
      in_front_[*label_] = true;
    }
    pass_over_joints();
    csv_ += row_of_points("target");
    return is_row;
  }

  void add_row(std::string_view line) {
    cells_.split(line, separator_, lines_.place());
    const bool units = is_unit_row(cells_);
    if (units || *name_ >= cells_.size() || (label_ && *label_ >= cells_.size())) {
      const std::size_t joints = independent_joints(robot_.joints).size();
      csv_ += std::string(joints + 1 + shared_.size(), separator_) + row_of_points(std::nullopt);
      return;
    }
    const std::optional<PointName> point =
        pattern_ ? pattern_->parts(cells_[*name_])
                 : PointName{.configuration = std::string(cells_[*label_]), .target = std::string(cells_[*name_])};
    if (!point) {
      fail(lines_.place(), "point " + shown(cells_[*name_]) + " is not named as --point-names says, " +
                               shown(files_.names) + "; " + labels_in(files_.joint_values, configurations_));
    }
    const auto head = heads_.find(point->configuration);
    if (head == heads_.end()) {
      fail(lines_.place(), "configuration " + shown(point->configuration) + " has no joint values, " +
                               labels_in(files_.joint_values, configurations_));
    }
    csv_ += head->second;
    for (std::size_t i = 0; i < shared_.size(); ++i) {
      csv_ += csv_field(agreed_value(i, point->configuration)) + separator_;
    }
    csv_ += row_of_points(point->target);
  }

  // Joint values that the points' file has as well are not needed twice. Throws InputError if they differ.
  void pass_over_joints() {
    constexpr double kSamePose = 1e-4;  // [rad] or [m], as within a configuration
    bool any = false;
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      const bool is_joint = joint_names_.contains(meaning_of(cells_[i]));
      in_front_[i] = in_front_[i] || is_joint;
      any = any || is_joint;
    }
    if (!any) {
      return;
    }
    if (!label_) {
      fail(lines_.place(), "joint values beside --joints-file and --point-names: expected them in one of the files");
    }
    const Measurements own = read_configurations(robot_, files_.points, convention_);
    for (std::size_t c = 0; c < own.configurations.size(); ++c) {
      const auto other = columns_.find(own.configurations[c]);
      if (other != columns_.end() &&
          (own.joint_values.col(static_cast<Eigen::Index>(c)) - configurations_.joint_values.col(other->second))
                  .cwiseAbs()
                  .maxCoeff() > kSamePose) {
        throw InputError(files_.points + ": joint values of configuration " + shown(own.configurations[c]) +
                         " differ from those of " + files_.joint_values + ", expected the same");
      }
    }
  }

  // What the files say of a configuration in a column that both may have. An empty cell says nothing.
  std::string agreed_value(std::size_t i, const std::string& configuration) const {
    const auto& [name, cells] = shared_[i];
    const std::string& stated = cells.at(configuration);
    const std::string here(own_[i] && *own_[i] < cells_.size() ? name_in(trimmed(cells_[*own_[i]])) : "");
    if (!here.empty() && here != stated) {
      fail(lines_.place(), fmt::format("{} {}, but {} has {} for configuration {}, expected the same", name,
                                       shown(here), files_.joint_values, shown(stated), shown(configuration)));
    }
    return stated;
  }

  // The cells of the points' file that are in no column in front of them.
  std::string row_of_points(const std::optional<std::string>& target) const {
    std::string row;
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      if (i >= in_front_.size() || !in_front_[i]) {
        row += (target && i == name_ ? csv_field(*target) : csv_cell(cells_[i])) + separator_;
      }
    }
    if (!row.empty()) {
      row.pop_back();
    }
    return row + "\n";
  }

  // The means of the file that has them.
  void take(Eigen::MatrixXd DriveSignals::*member, const char* what, Measurements& measurements) const {
    constexpr double kNotMeasured = std::numeric_limits<double>::quiet_NaN();
    const Eigen::MatrixXd& stated = configurations_.signals.*member;
    Eigen::MatrixXd& taken = measurements.signals.*member;
    if (stated.size() == 0) {
      return;
    }
    if (taken.size() > 0) {
      throw InputError(files_.points + ": has " + what + ", and " + files_.joint_values +
                       " as well, expected them in one of the two");
    }
    taken.setConstant(stated.rows(), std::ssize(measurements.configurations), kNotMeasured);
    for (Eigen::Index c = 0; c < taken.cols(); ++c) {
      const auto found = columns_.find(measurements.configurations[static_cast<std::size_t>(c)]);
      if (found != columns_.end()) {
        taken.col(c) = stated.col(found->second);
      }
    }
  }

  const Robot& robot_;
  const JoinedFiles& files_;
  const JointConvention* convention_;
  std::set<std::string> joint_names_;
  Measurements configurations_;
  std::map<std::string, Eigen::Index> columns_;  // of configurations_, by label
  std::optional<NamePattern> pattern_;
  LineReader lines_;
  std::map<std::string, std::string> heads_;
  std::vector<SharedColumn> shared_;
  std::vector<std::optional<std::size_t>> own_;  // the points' columns of the same meaning
  std::vector<bool> in_front_;                   // whether what a column of the points' file says stands before them
  std::optional<std::size_t> name_;
  std::optional<std::size_t> label_;
  char separator_ = '\0';
  std::string csv_;
  std::vector<Comment> comments_;
  Fields cells_;
};

}  // namespace

Measurements read_joined(const Robot& robot, const JoinedFiles& files, const JointConvention* convention) {
  return Joining(robot, files, convention).read();
}

}  // namespace kdl_calibration::cli
