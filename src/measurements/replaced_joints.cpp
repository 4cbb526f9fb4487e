#include "measurements/replaced_joints.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cstddef>
#include <string_view>
#include <vector>

#include "base/csv.hpp"
#include "base/number_text.hpp"
#include "measurements/measurement_rows.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// A column of joint values: its place and unit, and its values in SI.
struct JointCells {
  Column column;
  Eigen::VectorXd values;
};

std::vector<JointCells> joint_cells(const MeasurementRows& rows, const MatrixXd& joint_values) {
  const ExpectedJoints& joints = rows.joints();
  const Header& header = rows.header();
  const std::vector<std::size_t> independent = independent_joints(joints.joints);
  MatrixXd stated = independent_joint_values(joints.joints, joint_values);
  if (joints.convention != nullptr) {
    stated = joints.convention->matrix.partialPivLu().solve(stated.colwise() - joints.convention->offset).eval();
  }
  std::vector<JointCells> cells;
  for (std::size_t i = 0; i < header.joints.size(); ++i) {
    const bool own = header.own_values[i];
    cells.push_back({.column = header.joints[i],
                     .values = own ? joint_values.row(static_cast<Index>(independent[i])).transpose().eval()
                                   : stated.row(static_cast<Index>(i)).transpose().eval()});
  }
  for (std::size_t i = 0; i < header.followers.size(); ++i) {
    if (present(header.followers[i])) {
      cells.push_back({.column = header.followers[i],
                       .values = joint_values.row(static_cast<Index>(joints.followers[i])).transpose()});
    }
  }
  return cells;
}

// Point or comma, whichever the file's joint values have.
char decimal_mark(const Robot& robot, const std::filesystem::path& file, const JointConvention* convention) {
  LineReader lines(file);
  MeasurementRows rows(lines, robot.joints, convention, {.with_points = false});
  while (rows.decimals().mark == '\0' && rows.next()) {
    for (const Column& column : rows.header().joints) {
      rows.row().number(column);
    }
  }
  return rows.decimals().mark;
}

}  // namespace

std::string with_joint_values(const Robot& robot, const std::filesystem::path& file, const JointConvention* convention,
                              const Measurements& asked, const MatrixXd& joint_values) {
  const char mark = decimal_mark(robot, file, convention);
  LineReader lines(file);
  MeasurementRows rows(lines, robot.joints, convention, {.with_points = false});
  const std::vector<JointCells> cells = joint_cells(rows, joint_values);
  std::vector<const JointCells*> at(rows.header().fields, nullptr);
  for (const JointCells& each : cells) {
    at[each.column.index] = &each;
  }
  std::string text;
  for (const std::string& line : rows.head()) {
    text += line + "\n";
  }
  for (std::size_t row = 0; rows.next(); ++row) {
    const Index configuration = asked.observations.at(row).configuration;
    for (std::size_t i = 0; i < rows.fields().size(); ++i) {
      if (i > 0) text += rows.header().separator;
      if (const JointCells* own = i < at.size() ? at[i] : nullptr) {
        std::string number = shortest(own->values[configuration] / to_si(1.0, own->column.unit));
        if (mark == ',') std::replace(number.begin(), number.end(), '.', ',');
        text += number;
      } else {
        text += csv_cell(rows.fields()[i]);
      }
    }
    text += '\n';
  }
  return text;
}

}  // namespace kdl_calibration
