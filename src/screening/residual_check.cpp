// The residuals of a preliminary fit.

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numbers>
#include <optional>
#include <set>
#include <utility>

#include "base/number_range.hpp"
#include "base/robust_statistics.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "screening/change_points.hpp"
#include "screening/data_quality.hpp"
#include "screening/heavy_tails.hpp"
#include "screening/quality_findings.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Vector3d;

// Data of the residual check, row by row.
struct ResidualTable {
  std::vector<Eigen::Isometry3d> X_WF;  // by configuration
  std::vector<Vector3d> targets;        // in the flange frame, as estimated
  std::vector<Levels> levels;           // by target: levels of its residual in the flange frame
  std::vector<Vector3d> residuals;      // in W, minus the level
  std::vector<double> limits;           // [m] limit of a coordinate's deviation

  bool out(std::size_t row) const { return residuals[row].cwiseAbs().maxCoeff() > limits[row]; }
  // Predicted position of a target in W, at its level in that configuration.
  Vector3d expected(std::size_t target, int configuration) const {
    return X_WF[static_cast<std::size_t>(configuration)] * Vector3d(targets[target] + level(target, configuration));
  }
  Vector3d level(std::size_t target, int configuration) const {
    return levels[target].starts.empty() ? Vector3d::Zero() : Vector3d(levels[target].at(configuration));
  }
};

double fitted_parameters(const Estimate& estimate) {
  return static_cast<double>((estimate.errors.array() != 0.0).count() + (estimate.effects.array() != 0.0).count()) +
         6.0 * static_cast<double>(estimate.frames.bases.size()) +
         3.0 * static_cast<double>(estimate.frames.targets.size());
}

// Scatter of the rows of one split; the noise floor if it has none.
double sigma_of_rows(const Measurements& measurements, const ResidualTable& table, const std::vector<double>& relative,
                     Split split, double floor) {
  std::vector<double> values;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    if (measurements.observations[row].split == split) {
      for (Index axis = 0; axis < 3; ++axis) {
        values.push_back(table.residuals[row][axis] / relative[row]);
      }
    }
  }
  return std::max(robust_sigma(std::move(values)), floor);
}

// Number of fitted coordinates; repeats count once because they share the misfit.
double fitted_coordinates(const Measurements& measurements) {
  std::set<std::pair<int, int>> points;
  const TrainingRows training(measurements);
  for (const Observation& observation : (*training).observations) {
    points.insert({observation.configuration, observation.target});
  }
  return 3.0 * static_cast<double>(points.size());
}

// Factor on the limits for rows ignored by a robust fit: 1 / sqrt(1 - h), with a multiple of the mean leverage for h.
double inflation(const Measurements& measurements, double fitted) {
  constexpr double kLargeLeverage = 2.5;
  const double h = kLargeLeverage * fitted / fitted_coordinates(measurements);
  return h < 1.0 ? 1.0 / std::sqrt(1.0 - h) : kInfinity;
}

constexpr double kLargestInflation = 5.0;

void set_limits(const Measurements& measurements, double fitted, const std::vector<double>& relative,
                ResidualTable& table) {
  const double coordinates = fitted_coordinates(measurements);
  const double rest = coordinates - fitted;
  const double train =
      std::sqrt(coordinates / rest) * sigma_of_rows(measurements, table, relative, Split::train, kQuality.noise_floor);
  const double test = std::max(train, sigma_of_rows(measurements, table, relative, Split::test, kQuality.noise_floor));
  const auto rows = measurements.observations.size();
  const double limit = inflation(measurements, fitted) *
                       threshold(kQuality.false_alarm, 3.0 * static_cast<double>(rows), 1, kEfficiency * rest);
  std::vector<double> sizes;
  for (std::size_t row = 0; row < rows; ++row) {
    for (Index axis = 0; axis < 3; ++axis) {
      sizes.push_back(std::abs(table.residuals[row][axis]) / relative[row]);
    }
  }
  const double heavy = limit_of_heavy_tails(std::move(sizes));
  table.limits.resize(rows);
  for (std::size_t row = 0; row < rows; ++row) {
    const double sigma = measurements.observations[row].split == Split::train ? train : test;
    table.limits[row] = relative[row] * std::max(limit * sigma, heavy);
  }
}

ResidualTable residual_table(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate) {
  ResidualTable table;
  table.X_WF = flange_poses(model, estimate, measurements);
  const std::vector<std::int16_t> stations = stations_of_configurations(measurements);
  for (std::size_t c = 0; c < table.X_WF.size(); ++c) {
    table.X_WF[c] = estimate.frames.base(static_cast<std::size_t>(stations[c])) * table.X_WF[c];
  }
  for (const TargetFrame& target : estimate.frames.targets) {
    table.targets.emplace_back(target.X_FT.translation());
  }
  std::vector<Repeats> repeats(measurements.targets.size());
  for (const Observation& observation : measurements.observations) {
    const auto k = static_cast<std::size_t>(observation.target);
    const Eigen::Isometry3d& pose = table.X_WF[static_cast<std::size_t>(observation.configuration)];
    const Vector3d deviation = pose.inverse() * observation.position() - table.targets[k];
    repeats[k].configurations.push_back(observation.configuration);
    repeats[k].values.insert(repeats[k].values.end(), deviation.begin(), deviation.end());
  }
  std::vector<Series> all;
  all.reserve(repeats.size());
  for (const Repeats& target : repeats) {
    all.push_back(series_of(target, 3));
  }
  const double fitted = fitted_parameters(estimate);
  table.levels = find_levels(all, fitted, 1.0, kQuality);
  for (const Observation& observation : measurements.observations) {
    table.residuals.emplace_back(observation.position() - table.expected(static_cast<std::size_t>(observation.target),
                                                                         observation.configuration));
  }
  set_limits(measurements, fitted, relative_sigmas(measurements), table);
  return table;
}

std::vector<QualityFinding> slips_in_residuals(const Measurements& measurements, const ResidualTable& table) {
  std::vector<QualityFinding> findings;
  for (std::size_t k = 0; k < table.levels.size(); ++k) {
    const Levels& levels = table.levels[k];
    for (std::size_t i = 0; i < levels.starts.size(); ++i) {
      const Vector3d step = levels.values[i + 1] - levels.values[i];
      findings.push_back(slip(measurements, levels.last_before[i], {k}, step.norm(), step));
    }
  }
  return findings;
}

// Index of the other target at whose position an outlying row lies.
std::optional<std::size_t> seems_to_be(const Measurements& measurements, const ResidualTable& table, std::size_t row) {
  constexpr double kNear = 0.05;  // relative to the distance between the two
  const Observation& observation = measurements.observations[row];
  const Vector3d own = table.expected(target_of(measurements, row), observation.configuration);
  std::optional<std::size_t> best;
  double nearest = kInfinity;
  for (std::size_t k = 0; k < table.targets.size(); ++k) {
    const Vector3d expected = table.expected(k, observation.configuration);
    const double off = (observation.position() - expected).norm();
    const double reach = std::max(std::numbers::sqrt3 * table.limits[row], kNear * (expected - own).norm());
    if (k != target_of(measurements, row) && off < nearest && off < reach && 2.0 * off < table.residuals[row].norm()) {
      nearest = off;
      best = k;
    }
  }
  return best;
}

// The rows of a group whose targets were exchanged cyclically, beginning with `row`; empty if none.
std::vector<std::size_t> ring(const std::map<std::size_t, std::size_t>& row_of_target,
                              const std::map<std::size_t, std::size_t>& seems, std::size_t row) {
  std::vector<std::size_t> rows;
  std::size_t at = row;
  do {
    rows.push_back(at);
    const auto next_target = seems.find(at);
    const auto next = next_target == seems.end() ? row_of_target.end() : row_of_target.find(next_target->second);
    if (next == row_of_target.end()) {
      return {};
    }
    at = next->second;
  } while (at != row && rows.size() <= seems.size());
  return at == row ? rows : std::vector<std::size_t>{};
}

// Cyclic exchanges of targets, and rows at another target's position. Removes the explained rows from `rows`.
std::vector<Found> exchanged_targets(const Measurements& measurements, const ResidualTable& table, const Group& group,
                                     std::set<std::size_t>& rows) {
  std::map<std::size_t, std::size_t> row_of_target;
  for (const std::size_t row : group.rows) {
    row_of_target[target_of(measurements, row)] = row;
  }
  std::map<std::size_t, std::size_t> seems;
  for (const std::size_t row : rows) {
    if (const auto other = seems_to_be(measurements, table, row)) {
      seems[row] = *other;
    }
  }
  std::vector<Found> found;
  for (const auto& [row, other] : seems) {
    if (rows.count(row) == 0) {
      continue;
    }
    const std::vector<std::size_t> members = ring(row_of_target, seems, row);
    if (members.empty()) {
      found.push_back(found_in(measurements, group, QualityKind::mistaken_target, {row}));
      found.back().finding.targets.push_back(measurements.targets[other]);
      rows.erase(row);
    } else {
      found.push_back(found_in(measurements, group, QualityKind::swapped_targets, members));
      for (const std::size_t member : members) {
        rows.erase(member);
      }
    }
    found.back().finding.amount = table.residuals[row].norm();
    found.back().finding.offset = table.residuals[row];
  }
  return found;
}

// Common residual of the group's inliers, e.g. the robot's own error there.
Vector3d common_residual(const ResidualTable& table, const Group& group) {
  Vector3d sum = Vector3d::Zero();
  double count = 0.0;
  for (const std::size_t row : group.rows) {
    if (!table.out(row)) {
      sum += table.residuals[row];
      count += 1.0;
    }
  }
  return count > 0.0 ? Vector3d(sum / count) : sum;
}

// Finding for a single outlying row: one coordinate, or several.
Found displaced(const Measurements& measurements, const ResidualTable& table, const Group& group, std::size_t row) {
  const Vector3d offset = table.residuals[row] - common_residual(table, group);
  const auto axes_out = (table.residuals[row].cwiseAbs().array() > table.limits[row]).count();
  Index axis = 0;
  table.residuals[row].cwiseAbs().maxCoeff(&axis);
  Found found = found_in(measurements, group,
                         axes_out == 1 ? QualityKind::mistyped_coordinate : QualityKind::displaced_point, {row});
  found.finding.offset = offset;
  found.finding.amount = axes_out == 1 ? std::abs(offset[axis]) : offset.norm();
  found.finding.axis = axes_out == 1 ? static_cast<char>('x' + axis) : ' ';
  return found;
}

// Whether all targets of a configuration are off by more than unmodelled elasticity or temperature can explain, so that
// the robot stood elsewhere.
bool robot_is_elsewhere(const ResidualTable& table, const std::set<std::size_t>& rows) {
  constexpr double kBeyondTheModel = 5.0;
  return std::any_of(rows.begin(), rows.end(), [&](std::size_t row) {
    return table.residuals[row].cwiseAbs().maxCoeff() > kBeyondTheModel * table.limits[row];
  });
}

std::vector<Found> rows_out(const Measurements& measurements, const ResidualTable& table, const Group& group) {
  std::set<std::size_t> rows;
  for (const std::size_t row : group.rows) {
    if (table.out(row)) {
      rows.insert(row);
    }
  }
  std::vector<Found> found = exchanged_targets(measurements, table, group, rows);
  if (rows.size() != group.rows.size() || rows.size() < 2) {
    for (const std::size_t row : rows) {
      found.push_back(displaced(measurements, table, group, row));
    }
  } else if (robot_is_elsewhere(table, rows)) {
    const std::size_t worst = *std::max_element(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) {
      return table.residuals[a].norm() < table.residuals[b].norm();
    });
    found.push_back(found_in(measurements, group, QualityKind::displaced_configuration, {rows.begin(), rows.end()}));
    found.back().finding.amount = table.residuals[worst].norm();
    found.back().finding.offset = table.residuals[worst];
  }
  return found;
}

}  // namespace

std::vector<QualityFinding> check_residuals(const ErrorModel& model, const Measurements& measurements,
                                            const Estimate& estimate) {
  if (!(inflation(measurements, fitted_parameters(estimate)) < kLargestInflation)) {
    return {};
  }
  const std::vector<Group> groups = groups_of(measurements);
  const ResidualTable table = residual_table(model, measurements, estimate);
  std::vector<QualityFinding> findings = slips_in_residuals(measurements, table);
  std::vector<Found> all_found;
  for (const Group& group : groups) {
    std::vector<Found> found = rows_out(measurements, table, group);
    std::move(found.begin(), found.end(), std::back_inserter(all_found));
  }
  std::vector<QualityFinding> rest = put_together(measurements, groups, std::move(all_found));
  findings.insert(findings.end(), rest.begin(), rest.end());
  return findings;
}

}  // namespace kdl_calibration
