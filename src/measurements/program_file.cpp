#include "measurements/program_file.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "base/number_text.hpp"
#include "measurements/missing_units.hpp"
#include "measurements/stated_joints.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;

bool is_same(double a, double b) {
  constexpr double kRounding = 1e-14;
  return std::abs(a - b) <= kRounding * std::max({1.0, std::abs(a), std::abs(b)});
}

}  // namespace

ProgramFile::ProgramFile(const std::filesystem::path& file, const Robot& robot, const JointConvention* convention,
                         FileContent content, OrientationReading orientation)
    : lines_(file), rows_(lines_, robot.joints, convention, {.content = content, .orientation = orientation}) {
  const Header& header = rows_.header();
  if (std::any_of(header.joints.begin(), header.joints.end(), present)) joints_ = joint_columns(header);
  columns_ = joints_;
  if (content == FileContent::poses) {
    const std::size_t count = kOrientationForms[header.orientation].count();
    columns_.insert(columns_.end(), header.position.begin(), header.position.end());
    std::copy_n(header.orientations[header.orientation].begin(), count, std::back_inserter(columns_));
  }
  column_at_.assign(header.fields, columns_.size());
  for (std::size_t i = 0; i < columns_.size(); ++i) column_at_[columns_[i].index] = i;
  // One mark for all pieces: that of the first number which has one.
  decimals_ = rows_.decimals();
  LineReader lines(file);
  for (MeasurementRows rows(lines, robot.joints, convention, {.content = content, .orientation = orientation});
       decimals_.mark == '\0' && rows.next(); decimals_ = rows.decimals()) {
    for (const Column& column : columns_) rows.row().number(column);
  }
}

std::vector<ProgramLine> ProgramFile::next(std::size_t most) {
  std::vector<ProgramLine> result;
  result.reserve(most);
  while (result.size() < most && rows_.next_line()) {
    result.push_back({.text = std::string(rows_.line()), .number = lines_.place().line});
    read_ += rows_.line().size() + 1;
  }
  return result;
}

double ProgramFile::share() const {
  return static_cast<double>(read_) / static_cast<double>(std::max<std::size_t>(lines_.size_hint(), 1));
}

void ProgramFile::for_each_row(std::span<const ProgramLine> lines,
                               const std::function<void(const Row&, const Fields&, Index)>& work) const {
  DecimalMark decimals = decimals_;
  Fields fields;
  Index i = 0;
  for (const ProgramLine& line : lines) {
    const Place place{lines_.source(), line.number};
    fields.split(line.text, rows_.header().separator, place);
    work(Row(rows_.header(), fields, place, decimals), fields, i++);
  }
}

StatedJoints ProgramFile::stated(std::span<const ProgramLine> lines) const {
  return {.header = rows_.header(), .joints = rows_.joints(), .source = lines_.source(), .line = [lines](Index i) {
            return lines[static_cast<std::size_t>(i)].number;
          }};
}

ProgramPoints ProgramFile::points(std::span<const ProgramLine> lines) const {
  const Header& header = rows_.header();
  Eigen::MatrixXd values(static_cast<Index>(joints_.size()), static_cast<Index>(lines.size()));
  Eigen::AlignedBox3d box(Eigen::Vector3d::Zero());
  ProgramPoints result;
  for_each_row(lines, [&](const Row& row, const Fields&, Index i) {
    for (std::size_t j = 0; j < joints_.size(); ++j) values(static_cast<Index>(j), i) = row.number(joints_[j]);
    if (rows_.joints().content != FileContent::poses) return;
    Eigen::Isometry3d& pose = result.poses.emplace_back(Eigen::Isometry3d::Identity());
    for (std::size_t axis = 0; axis < 3; ++axis) {
      pose.translation()[static_cast<Index>(axis)] = row.number(header.position[axis]);
    }
    const std::optional<Eigen::Quaterniond> orientation = row.orientation();
    if (!orientation) row.fail_row("the orientation is empty: expected one in each row");
    pose.linear() = orientation->toRotationMatrix();
    box.extend(pose.translation());
  });
  check_missing_units(rows_.joints(),
                      {.header = header, .source = lines_.source(), .joint_values = values, .points = box});
  if (states_joints()) {
    apply_convention(stated(lines), values);
    result.joint_values = with_followers(stated(lines), values);
  }
  return result;
}

std::string ProgramFile::label(const ProgramLine& line) const {
  std::string result;
  for_each_row({&line, 1}, [&](const Row& row, const Fields&, Index) {
    const Column& column = rows_.header().configuration;
    if (present(column)) result = name_in(row.text(column));
  });
  return result;
}

std::string ProgramFile::head() const {
  std::string text;
  for (const std::string& line : rows_.head()) text += line + "\n";
  return text;
}

std::string ProgramFile::text(std::span<const ProgramLine> lines, const ProgramPoints& commanded) const {
  Eigen::MatrixXd values(0, static_cast<Index>(lines.size()));
  if (states_joints()) values = column_values(stated(lines), commanded.joint_values);
  std::string text;
  std::vector<double> numbers(columns_.size());
  for_each_row(lines, [&](const Row& row, const Fields& fields, Index i) {
    std::copy(values.col(i).begin(), values.col(i).end(), numbers.begin());
    if (!commanded.poses.empty()) {
      const Eigen::Isometry3d& pose = commanded.poses[static_cast<std::size_t>(i)];
      const Eigen::Vector4d orientation = row.orientation_numbers(Eigen::Quaterniond(pose.linear()).normalized());
      const auto after_joints = numbers.begin() + static_cast<std::ptrdiff_t>(joints_.size());
      std::copy(pose.translation().begin(), pose.translation().end(), after_joints);
      std::copy_n(orientation.begin(), numbers.size() - joints_.size() - 3, after_joints + 3);
    }
    for (std::size_t field = 0; field < fields.size(); ++field) {
      if (field > 0) text += rows_.header().separator;
      const std::size_t column = column_at_[field];
      // A number that stays keeps its digits: 90 degrees are not 89.99999999999999.
      const bool stays = column < columns_.size() && is_same(numbers[column], row.number(columns_[column]));
      if (stays || column == columns_.size()) {
        text += stays ? std::string(fields[field]) : csv_cell(fields[field]);
        continue;
      }
      const std::size_t begin = text.size();
      text += shortest(numbers[column] / to_si(1.0, columns_[column].unit));
      if (decimals_.mark == ',') std::replace(text.begin() + static_cast<std::ptrdiff_t>(begin), text.end(), '.', ',');
    }
    text += '\n';
  });
  return text;
}

}  // namespace kdl_calibration
