#include "measurements/same_poses.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <utility>

#include "base/text.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/measurements_check.hpp"
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

// Mean of the known torques.
VectorXd mean_torques(const MatrixXd& torques, const std::vector<Index>& members) {
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
             are_driven_alike(measurements.signals, own, other);
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
  std::vector<Index> leader(order.size());
  std::vector<Index> leaders;  // in this order; those within tolerance begin at `begin`
  std::size_t begin = 0;
  for (const Index c : order) {
    while (begin < leaders.size() && along[c] - along[leaders[begin]] > reach) {
      ++begin;
    }
    const auto found = std::find_if(leaders.begin() + static_cast<std::ptrdiff_t>(begin), leaders.end(), [&](Index l) {
      return ((joint_values.col(l) - joint_values.col(c)).cwiseAbs().array() <= tolerances.array()).all();
    });
    leader[static_cast<std::size_t>(c)] = found == leaders.end() ? c : *found;
    if (found == leaders.end()) {
      leaders.push_back(c);
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
  constexpr double kNear = 0.05;  // [rad] or [m]
  constexpr double kOfRange = 0.05;
  return first_within(joint_values, (kOfRange * ranges_of(joint_values)).cwiseMin(kNear).cwiseMax(same(joint_values)));
}

Measurements with_poses_joined(Measurements measurements) {
  check(measurements);
  // At one pose there may be distances from several anchors.
  if (std::any_of(measurements.coordinates.begin(), measurements.coordinates.end(),
                  [](const MeasuredCoordinates& measured) { return measured.distance > 0.0; })) {
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
  for (std::size_t pose = 0; pose < poses.size() && signals.torques.size() > 0; ++pose) {
    signals.torques.col(static_cast<Index>(pose)) = mean_torques(measurements.signals.torques, poses[pose]);
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
