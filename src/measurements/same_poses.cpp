#include "measurements/same_poses.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <utility>

#include "base/text.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/measurements_check.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSameValue = 1e-4;     // [rad] or [m]
constexpr double kShareOfRange = 1e-3;  // of the widest range

VectorXd ranges_of(const MatrixXd& joint_values) {
  return joint_values.size() == 0 ? VectorXd(VectorXd::Zero(joint_values.rows()))
                                  : VectorXd(joint_values.rowwise().maxCoeff() - joint_values.rowwise().minCoeff());
}

VectorXd same(const MatrixXd& joint_values) {
  const double widest = joint_values.rows() > 0 ? ranges_of(joint_values).maxCoeff() : 0.0;
  return VectorXd::Constant(joint_values.rows(), std::min(kSameValue, kShareOfRange * widest));
}

// Whether the configurations have the same directions of approach.
bool are_driven_alike(const DriveSignals& signals, Index a, Index b) {
  const auto differ = [](double one, double other) { return one != other && !(std::isnan(one) && std::isnan(other)); };
  for (Index joint = 0; joint < signals.approach.rows(); ++joint) {
    if (differ(signals.approach(joint, a), signals.approach(joint, b))) {
      return false;
    }
  }
  return true;
}

// Whether temperatures and payloads are near enough to be those of repeats.
bool have_like_circumstances(const DriveSignals& signals, Index a, Index b) {
  constexpr std::array<double, kCircumstances> kNear = {0.2, 0.01};  // [degC], [kg]
  const MatrixXd& circumstances = signals.circumstances;
  const MatrixXd& links = signals.link_temperatures;
  if (links.size() > 0 && ((links.col(a) - links.col(b)).array().abs() > kNear.front()).any()) {
    return false;
  }
  for (Index row = 0; row < circumstances.rows(); ++row) {
    if (std::abs(circumstances(row, a) - circumstances(row, b)) > kNear[static_cast<std::size_t>(row)]) {
      return false;
    }
  }
  return true;
}

// Mean of the known torques, circumstances or temperatures of links.
VectorXd mean_signals(const MatrixXd& torques, const std::vector<Index>& members) {
  VectorXd mean(torques.rows());
  for (Index joint = 0; joint < torques.rows(); ++joint) {
    double sum = 0.0;
    double count = 0.0;
    for (const Index c : members) {
      sum += std::isnan(torques(joint, c)) ? 0.0 : torques(joint, c);
      count += std::isnan(torques(joint, c)) ? 0.0 : 1.0;
    }
    mean[joint] = sum / count;  // NaN if none is known
  }
  return mean;
}

// The configurations of each pose, in the order of their first ones.
std::vector<std::vector<Index>> members_of_poses(const Measurements& measurements) {
  const std::vector<bool> trained = trained_configurations(measurements);
  const std::vector<Index> first = first_at_same_pose(measurements.joint_values);
  const std::vector<std::int16_t> stations = stations_of_configurations(measurements);
  std::vector<std::vector<Index>> poses;
  std::map<Index, std::vector<std::size_t>> at;  // by the first configuration of the pose
  for (std::size_t c = 0; c < first.size(); ++c) {
    const auto own = static_cast<Index>(c);
    std::vector<std::size_t>& candidates = at[first[c]];
    const auto same = std::find_if(candidates.begin(), candidates.end(), [&](std::size_t pose) {
      const Index other = poses[pose].front();
      return trained[c] == trained[static_cast<std::size_t>(other)] &&
             stations[c] == stations[static_cast<std::size_t>(other)] &&
             are_driven_alike(measurements.signals, own, other) &&
             have_like_circumstances(measurements.signals, own, other);
    });
    if (same == candidates.end()) {
      candidates.push_back(poses.size());
      poses.push_back({own});
    } else {
      poses[*same].push_back(own);
    }
  }
  return poses;
}

// Renumbers the members' rows as repeats of the pose.
void renumber(Measurements& measurements, const std::vector<std::vector<Index>>& poses) {
  std::vector<std::int32_t> most(measurements.configurations.size(), 0);  // repeat
  for (const Observation& o : measurements.observations) {
    std::int32_t& repeat = most[static_cast<std::size_t>(o.configuration)];
    repeat = std::max(repeat, o.repeat);
  }
  std::vector<std::pair<std::int32_t, std::int32_t>> place(most.size());  // pose, repeats of earlier members
  for (std::size_t pose = 0; pose < poses.size(); ++pose) {
    std::int32_t before = 0;
    for (const Index c : poses[pose]) {
      place[static_cast<std::size_t>(c)] = {static_cast<std::int32_t>(pose), before};
      before += most[static_cast<std::size_t>(c)];
    }
  }
  for (Observation& o : measurements.observations) {
    const auto [pose, before] = place[static_cast<std::size_t>(o.configuration)];
    o.configuration = pose;
    o.repeat += before;
  }
}

// Columns in the cells of a grid over the two joints with the widest ranges in units of their tolerances. Columns
// within the tolerances are in the same or in adjacent cells.
class PoseGrid {
public:
  PoseGrid(const MatrixXd& joint_values, const VectorXd& tolerances) : joint_values_(joint_values) {
    const VectorXd ranges = ranges_of(joint_values);
    std::vector<Index> joints(static_cast<std::size_t>(ranges.size()));
    std::iota(joints.begin(), joints.end(), Index{0});
    std::stable_sort(joints.begin(), joints.end(),
                     [&](Index a, Index b) { return ranges[a] * tolerances[b] > ranges[b] * tolerances[a]; });
    for (std::size_t axis = 0; axis < std::min(axes_.size(), joints.size()) && joint_values.cols() > 0; ++axis) {
      const Index joint = joints[axis];
      const double width = std::max(tolerances[joint], ranges[joint] / kCells) * (1.0 + 1e-9);
      axes_[axis] = {joint, joint_values.row(joint).minCoeff(), width > 0.0 ? 1.0 / width : 0.0};
    }
  }

  void add(Index column) { cells_[cell_along(0, column)][cell_along(1, column)].push_back(column); }

  // Calls visitor(columns) for the own and each adjacent cell, with the columns in the order in which they were added.
  template <class Visitor>
  void visit_near(Index column, Visitor visitor) const {
    const std::size_t row = cell_along(0, column);
    const std::size_t place = cell_along(1, column);
    for (std::size_t i = row - std::min<std::size_t>(row, 1); i < std::min(row + 2, kCells); ++i) {
      for (std::size_t j = place - std::min<std::size_t>(place, 1); j < std::min(place + 2, kCells); ++j) {
        visitor(cells_[i][j]);
      }
    }
  }

private:
  static constexpr std::size_t kCells = 64;  // along each axis
  struct Axis {
    Index joint = -1;
    double least = 0.0;
    double per_width = 0.0;
  };

  std::size_t cell_along(std::size_t axis, Index column) const {
    const auto& [joint, least, per_width] = axes_[axis];
    return joint < 0 ? 0 : static_cast<std::size_t>((joint_values_(joint, column) - least) * per_width);
  }

  const MatrixXd& joint_values_;
  std::array<Axis, 2> axes_;
  using CellRow = std::array<std::vector<Index>, kCells>;
  std::vector<CellRow> cells_ = std::vector<CellRow>(kCells);
};

// For each column the first one whose joint values are all within the tolerances.
std::vector<Index> first_within(const MatrixXd& joint_values, const VectorXd& tolerances) {
  // Equal poses are neighbours in the order along a generic direction.
  VectorXd direction(joint_values.rows());
  for (Index i = 0; i < direction.size(); ++i) {
    direction[i] = 1.0 / std::sqrt(static_cast<double>(i) + 2.0);
  }
  const VectorXd along = joint_values.transpose() * direction;
  const double reach = tolerances.dot(direction) * (1.0 + 1e-9);
  std::vector<Index> order(static_cast<std::size_t>(joint_values.cols()));
  std::iota(order.begin(), order.end(), Index{0});
  std::sort(order.begin(), order.end(),
            [&](Index a, Index b) { return std::pair(along[a], a) < std::pair(along[b], b); });
  const MatrixXd sorted = joint_values(Eigen::all, order);  // columns that are compared lie close together
  const VectorXd sorted_along = along(order);
  std::vector<Index> leader(order.size());  // by configuration: a column of `sorted`
  PoseGrid leaders(sorted, tolerances);
  for (Index c = 0; c < sorted.cols(); ++c) {
    Index found = c;
    leaders.visit_near(c, [&](const std::vector<Index>& columns) {
      for (auto l = columns.rbegin(); l != columns.rend() && sorted_along[c] - sorted_along[*l] <= reach; ++l) {
        if (*l < found && ((sorted.col(*l) - sorted.col(c)).cwiseAbs().array() <= tolerances.array()).all()) {
          found = *l;
        }
      }
    });
    leader[static_cast<std::size_t>(order[static_cast<std::size_t>(c)])] = found;
    if (found == c) {
      leaders.add(c);
    }
  }
  std::vector<Index> first(order.size(), -1);  // by leader, then by configuration
  std::vector<Index> result(order.size());
  for (std::size_t c = 0; c < order.size(); ++c) {
    Index& least = first[static_cast<std::size_t>(leader[c])];
    least = least < 0 ? static_cast<Index>(c) : least;
    result[c] = least;
  }
  return result;
}

}  // namespace

std::vector<Index> first_at_same_pose(const MatrixXd& joint_values) {
  return first_within(joint_values, same(joint_values));
}

std::vector<Index> first_of_neighbours(const MatrixXd& joint_values) {
  return first_within(
      joint_values,
      (kNeighbourPartOfRange * ranges_of(joint_values)).cwiseMin(kNeighbourDistance).cwiseMax(same(joint_values)));
}

Measurements with_poses_joined(Measurements measurements) {
  check(measurements);
  // At one pose there may be distances from several anchors.
  if (std::any_of(measurements.observations.begin(), measurements.observations.end(), is_distance)) {
    return measurements;
  }
  const std::vector<std::vector<Index>> poses = members_of_poses(measurements);
  if (poses.size() == measurements.configurations.size()) {
    return measurements;
  }
  renumber(measurements, poses);
  MatrixXd joint_values(measurements.joint_values.rows(), static_cast<Index>(poses.size()));
  std::vector<Index> firsts;
  std::vector<std::string> labels;
  std::string example;  // the first pose with several labels
  double scatter = 0.0;
  for (std::size_t pose = 0; pose < poses.size(); ++pose) {
    const std::vector<Index>& members = poses[pose];
    const auto column = static_cast<Index>(pose);
    const MatrixXd values = measurements.joint_values(Eigen::all, members);
    // Relative to the first, so that equal values have an exact mean.
    joint_values.col(column) = values.col(0) + (values.colwise() - values.col(0)).rowwise().mean();
    scatter = std::max(scatter, (values.colwise() - joint_values.col(column)).cwiseAbs().maxCoeff());
    firsts.push_back(members.front());
    labels.push_back(measurements.configurations[static_cast<std::size_t>(members.front())]);
    if (members.size() > 1 && example.empty()) {
      example = in_quotes(labels.back()) + " and " +
                in_quotes(measurements.configurations[static_cast<std::size_t>(members[1])]);
    }
  }
  DriveSignals signals = columns(measurements.signals, firsts);
  for (MatrixXd DriveSignals::*const member :
       {&DriveSignals::torques, &DriveSignals::circumstances, &DriveSignals::link_temperatures}) {
    for (std::size_t pose = 0; pose < poses.size() && (signals.*member).size() > 0; ++pose) {
      (signals.*member).col(static_cast<Index>(pose)) = mean_signals(measurements.signals.*member, poses[pose]);
    }
  }
  measurements.remark += fmt::format(
      "{}{} labels stand for {} poses ({} are one): rows at joint values within {:.2g} rad or m of their mean are "
      "repeats",
      measurements.remark.empty() ? "" : "; ", measurements.configurations.size(), poses.size(), example, scatter);
  measurements.joint_values = std::move(joint_values);
  measurements.signals = std::move(signals);
  measurements.configurations = std::move(labels);
  return measurements;
}

}  // namespace kdl_calibration
