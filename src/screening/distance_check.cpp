// Distances between targets, constant on a rigid tool.

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
#include "measurements/measurements_check.hpp"
#include "screening/change_points.hpp"
#include "screening/data_quality.hpp"
#include "screening/heavy_tails.hpp"
#include "screening/quality_findings.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Vector3d;

using Pair = std::pair<std::size_t, std::size_t>;  // target indices, the smaller first

Pair pair_of(std::size_t a, std::size_t b) { return {std::min(a, b), std::max(a, b)}; }

struct DistanceLevels {
  std::map<Pair, Levels> levels;
  double limit = kInfinity;  // [m] limit of a deviation for relative sigmas of 1
};

double distance(const Measurements& measurements, std::size_t a, std::size_t b) {
  return (measurements.observations[a].position() - measurements.observations[b].position()).norm();
}

template <class Visit>
void for_pairs(const std::vector<std::size_t>& rows, const Visit& visit) {
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t j = i + 1; j < rows.size(); ++j) {
      visit(rows[i], rows[j]);
    }
  }
}

DistanceLevels distance_levels(const Measurements& measurements, const std::vector<Group>& groups,
                               const std::vector<double>& relative) {
  std::map<Pair, Repeats> by_pair;
  for (const Group& group : groups) {
    for_pairs(group.rows, [&](std::size_t a, std::size_t b) {
      Repeats& repeats = by_pair[pair_of(target_of(measurements, a), target_of(measurements, b))];
      repeats.configurations.push_back(group.configuration);
      repeats.values.push_back(distance(measurements, a, b));
    });
  }
  std::vector<Series> all;
  all.reserve(by_pair.size());
  for (const auto& [pair, repeats] : by_pair) {
    all.push_back(series_of(repeats, 1));
  }
  // The distances of m points have only 3m - 6 degrees of freedom.
  const double freedom = std::max(3.0 * static_cast<double>(measurements.targets.size()) - 6.0, 1.0);
  const double independent = std::min(freedom / std::max(static_cast<double>(by_pair.size()), 1.0), 1.0);
  std::vector<Levels> levels = find_levels(all, 0.0, independent, kQuality);
  DistanceLevels result;
  std::size_t next = 0;
  double fitted = 0.0;
  for (const auto& [pair, repeats] : by_pair) {
    fitted += static_cast<double>(levels[next].values.size());
    result.levels[pair] = std::move(levels[next++]);
  }
  std::vector<double> centred;
  for (const Group& group : groups) {
    for_pairs(group.rows, [&](std::size_t a, std::size_t b) {
      const Levels& level = result.levels.at(pair_of(target_of(measurements, a), target_of(measurements, b)));
      const double sigma = std::hypot(relative[a], relative[b]) / std::numbers::sqrt2;
      centred.push_back((distance(measurements, a, b) - level.at(group.configuration)[0]) / sigma);
    });
  }
  const Scatter scatter = scatter_of(centred, fitted, kQuality.noise_floor);
  result.limit = scatter.sigma *
                 threshold(kQuality.false_alarm, static_cast<double>(centred.size()), 1, independent * scatter.freedom);
  for (double& value : centred) {
    value = std::abs(value);
  }
  result.limit = std::max(result.limit, limit_of_heavy_tails(std::move(centred)));
  return result;
}

// A distance that deviates by `amount` in one repeat, or from one configuration on.
struct DistanceChange {
  Pair pair;
  double amount = 0.0;
  int start = 0;        // of a change
  int last_before = 0;  // of a change
};

// The target responsible for most deviations, then for the largest; both targets of a single pair. Removes the
// explained deviations from the list.
std::pair<std::set<std::size_t>, double> blame(std::vector<DistanceChange>& deviations) {
  std::map<std::size_t, std::pair<int, double>> score;
  double largest = 0.0;
  for (const DistanceChange& deviation : deviations) {
    for (const std::size_t target : {deviation.pair.first, deviation.pair.second}) {
      auto& [count, sum] = score[target];
      ++count;
      sum += std::abs(deviation.amount);
    }
    largest = std::max(largest, std::abs(deviation.amount));
  }
  const auto worst =
      std::max_element(score.begin(), score.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  if (worst->second.first == 1) {
    const auto found = std::find_if(deviations.begin(), deviations.end(), [&](const DistanceChange& deviation) {
      return deviation.pair.first == worst->first || deviation.pair.second == worst->first;
    });
    const DistanceChange alone = *found;
    deviations.erase(found);
    return {{alone.pair.first, alone.pair.second}, std::abs(alone.amount)};
  }
  double amount = 0.0;
  std::erase_if(deviations, [&](const DistanceChange& deviation) {
    const bool explained = deviation.pair.first == worst->first || deviation.pair.second == worst->first;
    amount = explained ? std::max(amount, std::abs(deviation.amount)) : amount;
    return explained;
  });
  return {{worst->first}, amount};
}

std::vector<QualityFinding> slips_in_distances(const Measurements& measurements, const DistanceLevels& distances) {
  std::vector<DistanceChange> changes;
  for (const auto& [pair, levels] : distances.levels) {
    for (std::size_t i = 0; i < levels.starts.size(); ++i) {
      changes.push_back({.pair = pair,
                         .amount = levels.values[i + 1][0] - levels.values[i][0],
                         .start = levels.starts[i],
                         .last_before = levels.last_before[i]});
    }
  }
  std::vector<QualityFinding> findings;
  while (!changes.empty()) {
    // The largest change locates the slip best; others of the same slip may be one configuration off.
    const DistanceChange largest = *std::max_element(
        changes.begin(), changes.end(),
        [](const DistanceChange& a, const DistanceChange& b) { return std::abs(a.amount) < std::abs(b.amount); });
    std::vector<DistanceChange> together;
    std::erase_if(changes, [&](const DistanceChange& change) {
      const bool near = std::abs(change.start - largest.start) <= 1;
      if (near) {
        together.push_back(change);
      }
      return near;
    });
    while (!together.empty()) {
      const auto [targets, amount] = blame(together);
      findings.push_back(slip(measurements, largest.last_before, targets, amount, Vector3d::Zero()));
    }
  }
  return findings;
}

// Distances beyond their limit, and the sum of squares of all.
struct Deviations {
  std::vector<DistanceChange> beyond;
  double cost = 0.0;  // sum of squares in units of sigma
};

// Deviations of a group's distances, with the rows' targets given by `name`.
template <class Name>
Deviations deviations(const Measurements& measurements, const Group& group, const DistanceLevels& distances,
                      const std::vector<double>& relative, const Name& name) {
  Deviations result;
  for_pairs(group.rows, [&](std::size_t a, std::size_t b) {
    const Pair pair = pair_of(name(a), name(b));
    const Levels& levels = distances.levels.at(pair);
    const double amount = distance(measurements, a, b) - levels.at(group.configuration)[0];
    const double sigma = std::hypot(relative[a], relative[b]) / std::numbers::sqrt2;
    result.cost += amount * amount / (sigma * sigma);
    if (std::abs(amount) > distances.limit * sigma) {
      result.beyond.push_back({.pair = pair, .amount = amount});
    }
  });
  return result;
}

// The two rows for which exchanging the names makes all distances right.
std::optional<std::pair<std::size_t, std::size_t>> swap_in_distances(const Measurements& measurements,
                                                                     const Group& group,
                                                                     const DistanceLevels& distances,
                                                                     const std::vector<double>& relative) {
  std::optional<std::pair<std::size_t, std::size_t>> best;
  double smallest = kInfinity;
  for_pairs(group.rows, [&](std::size_t a, std::size_t b) {
    const auto exchanged = [&](std::size_t row) {
      return target_of(measurements, row == a ? b : (row == b ? a : row));
    };
    const Deviations left = deviations(measurements, group, distances, relative, exchanged);
    if (left.beyond.empty() && left.cost < smallest) {
      smallest = left.cost;
      best = {a, b};
    }
  });
  return best;
}

}  // namespace

std::vector<QualityFinding> check_distances(const Measurements& measurements) {
  const std::vector<Group> groups = groups_of(measurements);
  const std::vector<double> relative = relative_sigmas(measurements);
  const DistanceLevels distances = distance_levels(measurements, groups, relative);
  std::vector<QualityFinding> findings = slips_in_distances(measurements, distances);
  std::vector<Found> all_found;
  for (const Group& group : groups) {
    const auto named = [&](std::size_t row) { return target_of(measurements, row); };
    std::vector<DistanceChange> out = deviations(measurements, group, distances, relative, named).beyond;
    if (out.empty()) {
      continue;
    }
    if (const auto swapped = swap_in_distances(measurements, group, distances, relative)) {
      all_found.push_back(
          found_in(measurements, group, QualityKind::swapped_targets, {swapped->first, swapped->second}));
      all_found.back().finding.amount = distance(measurements, swapped->first, swapped->second);
      continue;
    }
    while (!out.empty()) {
      const auto [targets, amount] = blame(out);
      std::vector<std::size_t> rows;
      std::copy_if(group.rows.begin(), group.rows.end(), std::back_inserter(rows),
                   [&, &blamed = targets](std::size_t row) { return blamed.count(target_of(measurements, row)) > 0; });
      all_found.push_back(found_in(measurements, group, QualityKind::displaced_point, rows));
      all_found.back().finding.amount = amount;
    }
  }
  std::vector<QualityFinding> rest = put_together(measurements, groups, std::move(all_found));
  findings.insert(findings.end(), rest.begin(), rest.end());
  return findings;
}

}  // namespace kdl_calibration
