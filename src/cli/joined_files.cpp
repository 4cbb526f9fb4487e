#include "cli/joined_files.hpp"

#include <fmt/core.h>
#include <Eigen/Core>
#include <algorithm>
#include <map>
#include <optional>
#include <string_view>
#include <vector>

#include "base/csv.hpp"
#include "base/text.hpp"
#include "base/units.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/measurement_columns.hpp"
#include "measurements/point_export.hpp"
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

std::optional<std::size_t> column_of(std::string_view meaning, const Fields& heading) {
  for (std::size_t i = 0; i < heading.size(); ++i) {
    if (lower_case(column_meaning(heading[i])) == meaning) {
      return i;
    }
  }
  return std::nullopt;
}

std::string row_of(const Fields& cells, char separator, std::optional<std::size_t> left_out,
                   std::optional<std::size_t> changed, const std::string& value) {
  std::string row;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (i != left_out) {
      row += (i == (left_out == 0 ? 1 : 0) ? "" : std::string(1, separator)) +
             (i == changed ? csv_field(value) : csv_cell(cells[i]));
    }
  }
  return row + "\n";
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
        configurations_(read_configurations(robot, files.joint_values, convention)),
        pattern_(files.names.empty() ? std::nullopt : std::optional<NamePattern>(files.names)),
        lines_(std::filesystem::path(files.points)) {}

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

private:
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
    const bool is_row = stated && stated->before_first;
    if (is_row) {
      csv_.pop_back();  // the header takes the place of a comment
    }
    csv_ += heading_of(robot_, separator_) + row_of(cells_, separator_, label_, name_, "target");
    return is_row;
  }

  void add_row(std::string_view line) {
    cells_.split(line, separator_, lines_.place());
    const bool units = is_unit_row(cells_);
    if (units || *name_ >= cells_.size() || (label_ && *label_ >= cells_.size())) {
      const std::size_t joints = independent_joints(robot_.joints).size();
      csv_ += std::string(joints + 1, separator_) + row_of(cells_, separator_, label_, std::nullopt, {});
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
    csv_ += head->second + row_of(cells_, separator_, label_, name_, point->target);
  }

  const Robot& robot_;
  const JoinedFiles& files_;
  Measurements configurations_;
  std::optional<NamePattern> pattern_;
  LineReader lines_;
  std::map<std::string, std::string> heads_;
  std::optional<std::size_t> name_;
  std::optional<std::size_t> label_;
  char separator_ = '\0';
  std::string csv_;
  std::vector<Comment> comments_;
  Fields cells_;
};

}  // namespace

Measurements read_joined(const Robot& robot, const JoinedFiles& files, const JointConvention* convention) {
  return parse_measurements(robot, Joining(robot, files, convention).csv(), nullptr, files.points, files.orientation);
}

}  // namespace kdl_calibration::cli
