#include "planning/measuring_plan.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "base/csv.hpp"
#include "base/decompositions.hpp"
#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// ---- Order ---------------------------------------------------------------------------------------------------------

// Times between all configurations; row and column 0 are home.
MatrixXd travel_times(const std::vector<MovingJoint>& joints, const VectorXd& home, const MatrixXd& joint_values) {
  MatrixXd stops(joint_values.rows(), joint_values.cols() + 1);
  stops << home, joint_values;
  MatrixXd times = MatrixXd::Zero(stops.cols(), stops.cols());
  for (Index i = 0; i < stops.cols(); ++i) {
    for (Index j = 0; j < i; ++j) {
      times(i, j) = times(j, i) = travel_time(joints, stops.col(i), stops.col(j));
    }
  }
  return times;
}

std::vector<Index> nearest_neighbours(const MatrixXd& times) {
  std::vector<Index> way = {0};
  std::vector<bool> visited(static_cast<std::size_t>(times.cols()), false);
  visited[0] = true;
  while (static_cast<Index>(way.size()) < times.cols()) {
    Index nearest = -1;
    for (Index i = 1; i < times.cols(); ++i) {
      const bool closer = nearest < 0 || times(way.back(), i) < times(way.back(), nearest);
      if (!visited[static_cast<std::size_t>(i)] && closer) {
        nearest = i;
      }
    }
    visited[static_cast<std::size_t>(nearest)] = true;
    way.push_back(nearest);
  }
  return way;
}

// Seconds saved by reversing way[first … last].
double saved(const MatrixXd& times, const std::vector<Index>& way, std::size_t first, std::size_t last) {
  double gain = times(way[first - 1], way[first]) - times(way[first - 1], way[last]);
  if (last + 1 < way.size()) {
    gain += times(way[last], way[last + 1]) - times(way[first], way[last + 1]);
  }
  return gain;
}

void untangle(const MatrixXd& times, std::vector<Index>& way) {
  constexpr double kLeast = 1e-9;
  for (bool improved = true; improved;) {
    improved = false;
    for (std::size_t first = 1; first + 1 < way.size(); ++first) {
      for (std::size_t last = first + 1; last < way.size(); ++last) {
        if (saved(times, way, first, last) > kLeast) {
          std::reverse(way.begin() + static_cast<std::ptrdiff_t>(first),
                       way.begin() + static_cast<std::ptrdiff_t>(last) + 1);
          improved = true;
        }
      }
    }
  }
}

// ---- File ----------------------------------------------------------------------------------------------------------

struct JointColumn {
  std::string name;
  bool length = false;
};

// Joint columns, named and counted as in the URDF or by the controller.
std::vector<JointColumn> joint_columns(const std::vector<MovingJoint>& joints, const JointConvention* convention) {
  std::vector<JointColumn> columns;
  const std::vector<std::size_t> independent = independent_joints(joints);
  if (convention == nullptr) {
    const std::vector<std::string> names = independent_joint_names(joints);
    for (std::size_t i = 0; i < names.size(); ++i) {
      columns.push_back({.name = names[i], .length = joints[independent[i]].type == JointType::prismatic});
    }
    return columns;
  }
  for (Index c = 0; c < convention->matrix.cols(); ++c) {
    const std::string& name = convention->controller_joints[static_cast<std::size_t>(c)];
    bool any_length = false;
    bool any_angle = false;
    for (Index r = 0; r < convention->matrix.rows(); ++r) {
      if (convention->matrix(r, c) != 0.0) {
        const MovingJoint& joint = joints[independent[static_cast<std::size_t>(r)]];
        (joint.type == JointType::prismatic ? any_length : any_angle) = true;
      }
    }
    if (any_length && any_angle) {
      throw InputError(convention->name + ": controller joint " + in_quotes(name) +
                       " moves angles and lengths, expected one of the two");
    }
    columns.push_back({.name = name, .length = any_length});
  }
  return columns;
}

void require_label(const std::string& text) {
  const bool control = std::any_of(text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 32; });
  if (text.empty() || control) {
    throw InputError("name " + in_quotes(text) + " cannot stand in a plan, expected one without control characters");
  }
}

}  // namespace

double travel_time(const std::vector<MovingJoint>& joints, const Eigen::Ref<const VectorXd>& from,
                   const Eigen::Ref<const VectorXd>& to) {
  double slowest = 0.0;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const auto k = static_cast<Index>(i);
    const double velocity = joints[i].velocity.value_or(1.0);
    slowest = std::max(slowest, std::abs(to[k] - from[k]) / (velocity > 0.0 ? velocity : 1.0));
  }
  return slowest;
}

double way_time(const std::vector<MovingJoint>& joints, const VectorXd& home, const MatrixXd& joint_values) {
  double total = 0.0;
  for (Index c = 0; c < joint_values.cols(); ++c) {
    total += c == 0 ? travel_time(joints, home, joint_values.col(0))
                    : travel_time(joints, joint_values.col(c - 1), joint_values.col(c));
  }
  return total;
}

std::vector<Index> short_way(const std::vector<MovingJoint>& joints, const VectorXd& home,
                             const MatrixXd& joint_values) {
  const MatrixXd times = travel_times(joints, home, joint_values);
  std::vector<Index> way = nearest_neighbours(times);
  untangle(times, way);
  way.erase(way.begin());
  for (Index& stop : way) {
    --stop;
  }
  return way;
}

std::string plan_csv(const MeasuringPlan& plan, const std::vector<MovingJoint>& joints,
                     const JointConvention* convention) {
  require_count("labels of configurations", plan.configurations.size(), plan.joint_values.cols());
  require_count("joint values of a plan", plan.joint_values.rows(), joints.size());
  require_finite("a joint value of a plan", plan.joint_values.allFinite());
  if (!plan.stations.empty()) {
    require_count("stations of a plan", plan.stations.size(), plan.joint_values.cols());
  }
  if (plan.points.cols() > 0) {
    require_count("points of a plan", plan.points.cols(), plan.joint_values.cols());
  }
  if (convention != nullptr) {
    matched_convention(*convention, independent_joint_names(joints));
  }
  const std::vector<JointColumn> columns = joint_columns(joints, convention);
  std::string csv;
  for (const std::string& note : plan.notes) {
    csv += "# " + one_line(note) + "\n";
  }
  const bool at_stations = !plan.stations.empty();
  csv += at_stations ? "configuration,station,target" : "configuration,target";
  for (const JointColumn& column : columns) {
    csv += "," + csv_field(column.name + (column.length ? "[mm]" : "[deg]"));
  }
  csv += plan.distances ? ",distance[m]\n" : ",x[m],y[m],z[m]\n";
  MatrixXd values = independent_joint_values(joints, plan.joint_values);
  if (convention != nullptr) {
    values = solution(convention->matrix, values.colwise() - convention->offset);
  }
  for (Index c = 0; c < values.cols(); ++c) {
    const std::string& label = plan.configurations[static_cast<std::size_t>(c)];
    require_label(label);
    std::string station_cell;
    if (at_stations) {
      require_label(plan.stations[static_cast<std::size_t>(c)]);
      station_cell = csv_field(plan.stations[static_cast<std::size_t>(c)]) + ",";
    }
    std::string joint_cells;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const double value = values(static_cast<Index>(i), c) * (columns[i].length ? 1e3 : 1.0 / kDegree);
      joint_cells += "," + shortest(std::round(value * 1e9) / 1e9);
    }
    std::string point = plan.distances ? "," : ",,,";
    if (plan.points.cols() > 0) {
      const Eigen::Vector3d known = plan.points.col(c);
      point = "," + shortest(known.x()) + "," + shortest(known.y()) + "," + shortest(known.z());
    }
    for (const std::string& target : plan.targets) {
      require_label(target);
      csv += csv_field(label) + "," + station_cell + csv_field(target) + joint_cells + point + "\n";
    }
  }
  return csv;
}

std::string with_decimal_commas(const std::string& csv) {
  LineReader lines(csv, "the plan");
  std::string result;
  Fields cells;
  std::vector<bool> has_unit;  // of each column, empty before the header
  for (std::string_view line; lines.next(line);) {
    if (is_comment(line)) {
      result += std::string(line) + "\n";
      continue;
    }
    cells.split(line, ',', lines.place());
    const bool is_header = has_unit.empty();
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (is_header) {
        has_unit.push_back(cells[i].ends_with(']'));
      }
      std::string cell = csv_cell(cells[i]);
      if (!is_header && has_unit[i]) {
        cell = cells[i];
        std::replace(cell.begin(), cell.end(), '.', ',');
      }
      result += (i == 0 ? "" : ";") + cell;
    }
    result += "\n";
  }
  return result;
}

}  // namespace kdl_calibration
