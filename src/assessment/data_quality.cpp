#include "kdl_calibration/data_quality.hpp"
#include "kdl_calibration/joint_convention.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <tuple>
#include <utility>

#include "base/median.hpp"
#include "base/parallel.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// ---- robust statistics ---------------------------------------------------------------------------------------------

// Of the columns of the rows [first, end).
VectorXd medians(const MatrixXd& values, Index first, Index end) {
  VectorXd result(values.cols());
  for (Index axis = 0; axis < values.cols(); ++axis) {
    const auto column = values.col(axis).segment(first, end - first);
    result[axis] = median({column.begin(), column.end()});
  }
  return result;
}

constexpr double kNormalOverMad = 1.4826;             // sigma over the median absolute deviation of normal values
constexpr double kTrim = 3.0;                         // in sigmas
constexpr double kNormalOverTrimmed = 1.0 / 0.98658;  // sigma over that of normal values cut off at kTrim
constexpr double kEfficiency = 0.8;                   // of that sigma, with some reserve

// Sigma of centred normal values among which there may be others: the median absolute deviation says which to leave
// out, the root mean square of the rest is more exact than it.
double robust_sigma(std::vector<double> centred) {
  for (double& value : centred) {
    value = std::abs(value);
  }
  const double first = kNormalOverMad * median(centred);
  double sum = 0.0;
  double count = 0.0;
  for (const double value : centred) {
    if (value <= kTrim * first) {
      sum += value * value;
      count += 1.0;
    }
  }
  return count > 0.0 ? kNormalOverTrimmed * std::sqrt(sum / count) : 0.0;
}

// Probability that the norm of `axes` (1 or 3) standard normal values exceeds t.
double tail_of_norm(double t, Index axes) {
  const double one = std::erfc(t / std::numbers::sqrt2);
  return axes == 1 ? one : one + std::sqrt(2.0 / std::numbers::pi) * t * std::exp(-0.5 * t * t);
}

// A robust sigma and the degrees of freedom that it is worth.
struct Scatter {
  double sigma = kInfinity;
  double freedom = 0.0;
};

// Of centred values, from which `fitted` parameters were estimated; infinite where nothing is left to tell it.
Scatter scatter_of(const std::vector<double>& centred, double fitted, double floor) {
  const double rest = static_cast<double>(centred.size()) - fitted;
  if (rest <= 0.0) {
    return {};
  }
  const double sigma = robust_sigma(centred) * std::sqrt(static_cast<double>(centred.size()) / rest);
  return {.sigma = std::max(sigma, floor), .freedom = kEfficiency * rest};
}

// What the norm over such a sigma exceeds with probability false_alarm / comparisons: the normal quantile z, turned
// into Student's (Wallace 1959, the inverse of his approximation).
double threshold(double false_alarm, double comparisons, Index axes, double freedom) {
  const double probability = std::min(false_alarm, 1.0) / std::max(comparisons, 1.0);
  double z = 0.0;
  double upper = 40.0;
  while (upper - z > 1e-9) {
    const double middle = 0.5 * (z + upper);
    (tail_of_norm(middle, axes) > probability ? z : upper) = middle;
  }
  const double n = std::max(freedom, 1.0);
  const double corrected = z * (8.0 * n + 3.0) / (8.0 * n + 1.0);
  return std::sqrt(n * std::expm1(corrected * corrected / n));
}

// ---- changes in a series -------------------------------------------------------------------------------------------

// One row per configuration in which it was measured: the medians over the repeats.
struct Series {
  std::vector<int> configurations;
  MatrixXd values;
};

// What was measured of one target or pair, in any order.
struct Repeats {
  std::vector<int> configurations;
  std::vector<double> values;  // of each, one per axis
};

Series series_of(const Repeats& repeats, Index axes) {
  const std::vector<int>& of = repeats.configurations;
  std::vector<Index> order(of.size());
  std::iota(order.begin(), order.end(), Index{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](Index a, Index b) { return of[static_cast<std::size_t>(a)] < of[static_cast<std::size_t>(b)]; });
  const MatrixXd sorted = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      repeats.values.data(), static_cast<Index>(of.size()), axes)(order, Eigen::all);
  Series series{.configurations = {}, .values = MatrixXd(sorted.rows(), axes)};
  for (Index first = 0; first < sorted.rows();) {
    const int configuration = of[static_cast<std::size_t>(order[static_cast<std::size_t>(first)])];
    Index end = first + 1;
    while (end < sorted.rows() && of[static_cast<std::size_t>(order[static_cast<std::size_t>(end)])] == configuration) {
      ++end;
    }
    auto row = series.values.row(static_cast<Index>(series.configurations.size()));
    if (end == first + 1) {
      row = sorted.row(first);
    } else {
      row = medians(sorted, first, end);
    }
    series.configurations.push_back(configuration);
    first = end;
  }
  series.values.conservativeResize(static_cast<Index>(series.configurations.size()), Eigen::NoChange);
  return series;
}

// A step between the rows position - 1 and position of a series.
struct Change {
  Index position = 0;
  double statistic = 0.0;  // in units of the values; over sigma it is a norm of standard normal values
};

Index shortest(const QualityOptions& options) { return std::max(options.segment, 1); }

// Largest difference of winsorised means over the steps in the rows [first, end): sqrt(n1 n2 / n) |m2 - m1|.
Change largest_change(const MatrixXd& values, Index first, Index end, const QualityOptions& options, double sigma) {
  constexpr double kWinsor = 5.0;
  const Index n = end - first;
  MatrixXd clipped = values.middleRows(first, n);
  const VectorXd centre = medians(values, first, end);
  for (Index axis = 0; axis < values.cols(); ++axis) {
    const VectorXd deviation = (clipped.col(axis).array() - centre[axis]).matrix();
    const double reach =
        kWinsor * std::max({robust_sigma({deviation.begin(), deviation.end()}), sigma, options.noise_floor});
    clipped.col(axis) = deviation.cwiseMax(-reach).cwiseMin(reach);
  }
  const VectorXd total = clipped.colwise().sum();
  VectorXd before = VectorXd::Zero(values.cols());
  Change best{.position = first};
  for (Index i = 1; i + shortest(options) <= n; ++i) {
    before += clipped.row(i - 1).transpose();
    if (i < shortest(options)) {
      continue;
    }
    const auto n1 = static_cast<double>(i);
    const auto n2 = static_cast<double>(n - i);
    const double statistic = std::sqrt(n1 * n2 / static_cast<double>(n)) * ((total - before) / n2 - before / n1).norm();
    if (statistic > best.statistic) {
      best = {.position = first + i, .statistic = statistic};
    }
  }
  return best;
}

// The step that leaves the smallest sum of absolute deviations from the medians on either side of `change`.
Index located(const MatrixXd& values, Index first, Index end, Index change, Index segment) {
  const VectorXd before = medians(values, first, change);
  const VectorXd after = medians(values, change, end);
  double sum = 0.0;  // over the rows in front, relative to all of them being behind
  double smallest = kInfinity;
  Index best = change;
  for (Index i = first; i < end - segment; ++i) {
    sum += (values.row(i).transpose() - before).lpNorm<1>() - (values.row(i).transpose() - after).lpNorm<1>();
    if (i + 1 - first >= segment && sum < smallest) {
      smallest = sum;
      best = i + 1;
    }
  }
  return best;
}

// Binary segmentation.
void find_changes(const MatrixXd& values, Index first, Index end, double sigma, double limit,
                  const QualityOptions& options, std::vector<Index>& changes) {
  if (end - first < 2 * shortest(options)) {
    return;
  }
  const Change change = largest_change(values, first, end, options, sigma);
  if (!(change.statistic > limit * sigma)) {
    return;
  }
  const Index position = located(values, first, end, change.position, shortest(options));
  const double step = (medians(values, position, end) - medians(values, first, position)).norm();
  if (!(step > options.smallest_slip * sigma)) {
    return;
  }
  find_changes(values, first, position, sigma, limit, options, changes);
  changes.push_back(position);
  find_changes(values, position, end, sigma, limit, options, changes);
}

// What a series is worth configuration by configuration: constant between its changes.
struct Levels {
  std::vector<int> starts;       // configuration in which the second, third … level begins
  std::vector<int> last_before;  // the one measured before it
  std::vector<VectorXd> values;

  const VectorXd& at(int configuration) const {
    const auto above = std::upper_bound(starts.begin(), starts.end(), configuration);
    return values[static_cast<std::size_t>(above - starts.begin())];
  }
};

Levels levels_of(const Series& series, const std::vector<Index>& changes) {
  Levels levels;
  Index first = 0;
  for (const Index change : changes) {
    levels.values.push_back(medians(series.values, first, change));
    levels.starts.push_back(series.configurations[static_cast<std::size_t>(change)]);
    levels.last_before.push_back(series.configurations[static_cast<std::size_t>(change - 1)]);
    first = change;
  }
  levels.values.push_back(medians(series.values, first, series.values.rows()));
  return levels;
}

// Less tells no slip: what is left of a segment of three values beside their median is no measure of the noise.
Index fewest_rows(const QualityOptions& options) { return std::max(Index{10}, 2 * shortest(options)); }

// Levels of several series with one sigma. `fitted` parameters were estimated from the values before, of which the
// part `independent` tells something of its own.
std::vector<Levels> find_levels(const std::vector<Series>& all, double fitted, double independent,
                                const QualityOptions& options) {
  std::vector<double> centred;
  double comparisons = 0.0;
  for (const Series& series : all) {
    const Index rows = series.values.rows();
    Index change = rows;
    if (rows >= fewest_rows(options)) {
      change = largest_change(series.values, 0, rows, options, 0.0).position;
      comparisons += static_cast<double>(rows - 2 * shortest(options) + 1);
    }
    for (const auto& [first, end] : {std::pair<Index, Index>{0, change}, std::pair<Index, Index>{change, rows}}) {
      if (first < end) {
        const MatrixXd part =
            series.values.middleRows(first, end - first).rowwise() - medians(series.values, first, end).transpose();
        centred.insert(centred.end(), part.reshaped().begin(), part.reshaped().end());
        fitted += static_cast<double>(part.cols());
      }
    }
  }
  const Scatter scatter = scatter_of(centred, fitted, options.noise_floor);
  std::vector<Levels> result;
  for (const Series& series : all) {
    std::vector<Index> changes;
    const double limit =
        threshold(options.false_alarm, comparisons, series.values.cols(), independent * scatter.freedom);
    const Index rows = series.values.rows() < fewest_rows(options) ? 0 : series.values.rows();
    find_changes(series.values, 0, rows, scatter.sigma, limit, options, changes);
    result.push_back(levels_of(series, changes));
  }
  return result;
}

// ---- what both checks share ----------------------------------------------------------------------------------------

// Rows that were measured together.
struct Group {
  int configuration = 0;
  int repeat = 0;
  std::vector<std::size_t> rows;
};

std::vector<Group> groups_of(const Measurements& measurements) {
  const auto key = [&](std::size_t row) {
    const Observation& observation = measurements.observations[row];
    return std::pair(observation.configuration, observation.repeat);
  };
  std::vector<std::size_t> rows(measurements.observations.size());
  std::iota(rows.begin(), rows.end(), std::size_t{0});
  std::stable_sort(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  std::vector<Group> groups;
  for (auto first = rows.begin(); first != rows.end();) {
    const auto end = std::find_if(first, rows.end(), [&](std::size_t row) { return key(row) != key(*first); });
    groups.push_back({.configuration = key(*first).first, .repeat = key(*first).second, .rows = {first, end}});
    first = end;
  }
  return groups;
}

// Of each row its stated sigma over their median; 1 where not all rows state one.
std::vector<double> relative_sigmas(const Measurements& measurements) {
  std::vector<double> sigmas;
  for (const Observation& observation : measurements.observations) {
    sigmas.push_back(observation.sigma);
  }
  const bool stated = std::all_of(sigmas.begin(), sigmas.end(), [](double sigma) { return sigma > 0.0; });
  const double middle = median(sigmas);
  for (double& sigma : sigmas) {
    sigma = stated ? sigma / middle : 1.0;
  }
  return sigmas;
}

std::string millimetres(double metres) {
  const double value = metres * 1e3;
  const int digits = std::abs(value) >= 0.95 ? 1 : (std::abs(value) >= 0.095 ? 2 : 4);
  std::array<char, 64> buffer{};
  const auto [end, error] =
      std::to_chars(buffer.data(), buffer.data() + buffer.size(), value, std::chars_format::fixed, digits);
  return (error == std::errc() ? std::string(buffer.data(), end) : "many") + " mm";
}

std::string listed(const std::vector<std::string>& names, const std::string& last) {
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i) {
    text += (i == 0 ? "" : (i + 1 < names.size() ? ", " : " " + last + " ")) + names[i];
  }
  return text;
}

// A finding and where it was made, before the repeats are put together.
struct Found {
  QualityFinding finding;
  int configuration = 0;
  std::vector<std::size_t> rows;  // whose blame it is
};

std::string where(const QualityFinding& finding, bool every_repeat, bool always) {
  std::string text = "configuration " + finding.configuration;
  if (finding.repeat != 0 && (always || !every_repeat)) {
    text += ", repeat " + std::to_string(finding.repeat);
  }
  return text;
}

// `all`: nothing of that configuration's targets is left out.
std::string describe(const QualityFinding& finding, bool all) {
  const std::string& first = finding.targets.front();
  const bool bound = finding.offset.isZero(0.0);
  const std::string about = (bound ? "at least " : "about ") + millimetres(finding.amount);
  const std::string several = finding.repeat == 0 ? " in every repeat" : "";
  switch (finding.kind) {
    case QualityKind::slipped_target:
      return "target " + listed(finding.targets, "or") + " slipped by " + about + " after configuration " +
             finding.configuration;
    case QualityKind::swapped_targets:
      return "targets " + listed(finding.targets, "and") + " are swapped in " + where(finding, all, false);
    case QualityKind::mistaken_target:
      return "target " + first + " in " + where(finding, all, false) + " lies where target " + finding.targets.back() +
             " is";
    case QualityKind::mistyped_coordinate:
      return "target " + first + " in " + where(finding, all, true) + ": " + finding.axis + " is off by about " +
             millimetres(finding.offset[finding.axis - 'x']) + several;
    case QualityKind::displaced_point:
      return "target " + listed(finding.targets, "or") + " in " + where(finding, all, true) + " is off by " + about +
             several;
    case QualityKind::displaced_configuration:
      return "targets " + listed(finding.targets, "and") + " in " + where(finding, all, false) + " are off by up to " +
             millimetres(finding.amount) + "; are its joint values right?";
  }
  return {};
}

// One finding where all repeats of a configuration have the same.
std::vector<QualityFinding> put_together(const Measurements& measurements, const std::vector<Group>& groups,
                                         std::vector<Found> all_found) {
  std::map<int, std::size_t> repeats;
  for (const Group& group : groups) {
    ++repeats[group.configuration];
  }
  std::map<std::tuple<int, QualityKind, std::vector<std::string>, char>, std::vector<QualityFinding>> alike;
  for (Found& found : all_found) {
    found.finding.configuration = measurements.configurations[static_cast<std::size_t>(found.configuration)];
    const QualityFinding& finding = found.finding;
    alike[{found.configuration, finding.kind, finding.targets, finding.axis}].push_back(finding);
  }
  std::vector<QualityFinding> result;
  for (auto& [key, findings] : alike) {
    const bool all = findings.size() == repeats[std::get<0>(key)];
    if (all && findings.size() > 1) {
      QualityFinding& whole = findings.front();
      for (std::size_t i = 1; i < findings.size(); ++i) {
        whole.amount += findings[i].amount;
        whole.offset += findings[i].offset;
      }
      whole.amount /= static_cast<double>(findings.size());
      whole.offset /= static_cast<double>(findings.size());
      whole.repeat = 0;
      findings.resize(1);
    }
    for (QualityFinding& finding : findings) {
      finding.message = describe(finding, all);
      result.push_back(std::move(finding));
    }
  }
  return result;
}

QualityFinding slip(const Measurements& measurements, int last_before, const std::set<std::size_t>& targets,
                    double amount, const Vector3d& offset) {
  QualityFinding finding{.kind = QualityKind::slipped_target,
                         .configuration = measurements.configurations[static_cast<std::size_t>(last_before)],
                         .amount = amount,
                         .offset = offset};
  for (const std::size_t target : targets) {
    finding.targets.push_back(measurements.targets[target]);
  }
  finding.message = describe(finding, true);
  return finding;
}

// ---- distances -----------------------------------------------------------------------------------------------------

using Pair = std::pair<std::size_t, std::size_t>;  // targets, the smaller number first

Pair pair_of(std::size_t a, std::size_t b) { return {std::min(a, b), std::max(a, b)}; }

struct DistanceLevels {
  std::map<Pair, Levels> levels;
  double limit = kInfinity;  // [m] what a distance may deviate where the rows' relative sigmas are 1
};

std::size_t target_of(const Measurements& measurements, std::size_t row) {
  return static_cast<std::size_t>(measurements.observations[row].target);
}

double distance(const Measurements& measurements, std::size_t a, std::size_t b) {
  return (measurements.observations[a].position - measurements.observations[b].position).norm();
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
                               const std::vector<double>& relative, const QualityOptions& options) {
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
  // The shape of m points has 3m - 6 degrees of freedom, however many distances there are.
  const double freedom = std::max(3.0 * static_cast<double>(measurements.targets.size()) - 6.0, 1.0);
  const double independent = std::min(freedom / std::max(static_cast<double>(by_pair.size()), 1.0), 1.0);
  std::vector<Levels> levels = find_levels(all, 0.0, independent, options);
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
  const Scatter scatter = scatter_of(centred, fitted, options.noise_floor);
  result.limit = scatter.sigma *
                 threshold(options.false_alarm, static_cast<double>(centred.size()), 1, independent * scatter.freedom);
  return result;
}

// A distance that changed by `amount`, of one repeat or from one configuration on.
struct Deviation {
  Pair pair;
  double amount = 0.0;
  int start = 0;        // of a change
  int last_before = 0;  // of a change
};

// Whose blame the deviations are: the target with most of them, then with the largest; both targets of a pair that
// stands alone. Takes the deviations that are explained out of the list.
std::pair<std::set<std::size_t>, double> blame(std::vector<Deviation>& deviations) {
  std::map<std::size_t, std::pair<int, double>> score;
  double largest = 0.0;
  for (const Deviation& deviation : deviations) {
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
    const auto found = std::find_if(deviations.begin(), deviations.end(), [&](const Deviation& deviation) {
      return deviation.pair.first == worst->first || deviation.pair.second == worst->first;
    });
    const Deviation alone = *found;
    deviations.erase(found);
    return {{alone.pair.first, alone.pair.second}, std::abs(alone.amount)};
  }
  double amount = 0.0;
  std::erase_if(deviations, [&](const Deviation& deviation) {
    const bool explained = deviation.pair.first == worst->first || deviation.pair.second == worst->first;
    amount = explained ? std::max(amount, std::abs(deviation.amount)) : amount;
    return explained;
  });
  return {{worst->first}, amount};
}

std::vector<QualityFinding> slips_in_distances(const Measurements& measurements, const DistanceLevels& distances) {
  std::vector<Deviation> changes;
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
    // The largest change locates best; the others of the same slip may be found one configuration beside it.
    const Deviation largest = *std::max_element(
        changes.begin(), changes.end(),
        [](const Deviation& a, const Deviation& b) { return std::abs(a.amount) < std::abs(b.amount); });
    std::vector<Deviation> together;
    std::erase_if(changes, [&](const Deviation& change) {
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

// The deviations of a group's distances, with the targets' names as `name` gives them for the rows.
template <class Name>
std::vector<Deviation> deviations(const Measurements& measurements, const Group& group, const DistanceLevels& distances,
                                  const std::vector<double>& relative, const Name& name, double& cost) {
  std::vector<Deviation> result;
  cost = 0.0;
  for_pairs(group.rows, [&](std::size_t a, std::size_t b) {
    const Pair pair = pair_of(name(a), name(b));
    const auto levels = distances.levels.find(pair);
    if (levels == distances.levels.end()) {
      return;
    }
    const double amount = distance(measurements, a, b) - levels->second.at(group.configuration)[0];
    const double sigma = std::hypot(relative[a], relative[b]) / std::numbers::sqrt2;
    cost += amount * amount / (sigma * sigma);
    if (std::abs(amount) > distances.limit * sigma) {
      result.push_back({.pair = pair, .amount = amount});
    }
  });
  return result;
}

// The two rows whose names, exchanged, make all distances right.
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
    double cost = 0.0;
    if (deviations(measurements, group, distances, relative, exchanged, cost).empty() && cost < smallest) {
      smallest = cost;
      best = {a, b};
    }
  });
  return best;
}

// ---- residuals -----------------------------------------------------------------------------------------------------

// Everything that the check of the residuals looks at, row by row.
struct ResidualTable {
  std::vector<Eigen::Isometry3d> X_WF;  // by configuration
  std::vector<Vector3d> targets;        // in the flange frame, as estimated
  std::vector<Levels> levels;           // by target: its residual in the flange frame
  std::vector<Vector3d> residuals;      // in W, less the level
  std::vector<double> limits;           // [m] what a coordinate may deviate

  bool out(std::size_t row) const { return residuals[row].cwiseAbs().maxCoeff() > limits[row]; }
  // Where a target should be in a configuration.
  Vector3d expected(std::size_t target, int configuration) const {
    return X_WF[static_cast<std::size_t>(configuration)] * Vector3d(targets[target] + level(target, configuration));
  }
  Vector3d level(std::size_t target, int configuration) const {
    return levels[target].starts.empty() ? Vector3d::Zero() : Vector3d(levels[target].at(configuration));
  }
};

double fitted_parameters(const Estimate& estimate) {
  return static_cast<double>((estimate.errors.array() != 0.0).count() + (estimate.deflections.array() != 0.0).count()) +
         6.0 + 3.0 * static_cast<double>(estimate.targets.size());
}

// Scatter of the rows of one split; the floor where it has none.
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

// Coordinates that the fit had to explain; the repeats of a configuration share its misfit.
double fitted_coordinates(const Measurements& measurements) {
  std::set<std::pair<int, int>> points;
  for (const Observation& observation : measurements.observations) {
    if (observation.split == Split::train) {
      points.insert({observation.configuration, observation.target});
    }
  }
  return 3.0 * static_cast<double>(points.size());
}

// How much larger than sigma the residual of a row may be that a robust fit left out: 1 / sqrt(1 - h) with its leverage
// h, for which a multiple of the mean leverage is taken.
double inflation(const Measurements& measurements, double fitted) {
  constexpr double kLargeLeverage = 2.5;
  const double h = kLargeLeverage * fitted / fitted_coordinates(measurements);
  return h < 1.0 ? 1.0 / std::sqrt(1.0 - h) : kInfinity;
}

constexpr double kLargestInflation = 5.0;

void set_limits(const Measurements& measurements, double fitted, const std::vector<double>& relative,
                const QualityOptions& options, ResidualTable& table) {
  const double coordinates = fitted_coordinates(measurements);
  const double rest = coordinates - fitted;
  const double train =
      std::sqrt(coordinates / rest) * sigma_of_rows(measurements, table, relative, Split::train, options.noise_floor);
  const double test = std::max(train, sigma_of_rows(measurements, table, relative, Split::test, options.noise_floor));
  const auto rows = measurements.observations.size();
  const double limit = inflation(measurements, fitted) *
                       threshold(options.false_alarm, 3.0 * static_cast<double>(rows), 1, kEfficiency * rest);
  table.limits.resize(rows);
  for (std::size_t row = 0; row < rows; ++row) {
    table.limits[row] = limit * relative[row] * (measurements.observations[row].split == Split::train ? train : test);
  }
}

ResidualTable residual_table(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                             const QualityOptions& options) {
  ResidualTable table;
  table.X_WF = flange_poses(model, estimate, measurements.joint_values);
  for (Eigen::Isometry3d& pose : table.X_WF) {
    pose = estimate.X_WB * pose;
  }
  for (const TargetFrame& target : estimate.targets) {
    table.targets.emplace_back(target.X_FT.translation());
  }
  std::vector<Repeats> repeats(measurements.targets.size());
  for (const Observation& observation : measurements.observations) {
    const auto k = static_cast<std::size_t>(observation.target);
    const Eigen::Isometry3d& pose = table.X_WF[static_cast<std::size_t>(observation.configuration)];
    const Vector3d deviation = pose.inverse() * observation.position - table.targets[k];
    repeats[k].configurations.push_back(observation.configuration);
    repeats[k].values.insert(repeats[k].values.end(), deviation.begin(), deviation.end());
  }
  std::vector<Series> all;
  all.reserve(repeats.size());
  for (const Repeats& target : repeats) {
    all.push_back(series_of(target, 3));
  }
  const double fitted = fitted_parameters(estimate);
  table.levels = find_levels(all, fitted, 1.0, options);
  for (const Observation& observation : measurements.observations) {
    table.residuals.emplace_back(
        observation.position - table.expected(static_cast<std::size_t>(observation.target), observation.configuration));
  }
  set_limits(measurements, fitted, relative_sigmas(measurements), options, table);
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

// The other target that a row which is out seems to show, by number.
std::optional<std::size_t> seems_to_be(const Measurements& measurements, const ResidualTable& table, std::size_t row) {
  constexpr double kNear = 0.05;  // of the distance between the two
  const Observation& observation = measurements.observations[row];
  const Vector3d own = table.expected(target_of(measurements, row), observation.configuration);
  std::optional<std::size_t> best;
  double nearest = kInfinity;
  for (std::size_t k = 0; k < table.targets.size(); ++k) {
    const Vector3d expected = table.expected(k, observation.configuration);
    const double off = (observation.position - expected).norm();
    const double reach = std::max(std::numbers::sqrt3 * table.limits[row], kNear * (expected - own).norm());
    if (k != target_of(measurements, row) && off < nearest && off < reach && 2.0 * off < table.residuals[row].norm()) {
      nearest = off;
      best = k;
    }
  }
  return best;
}

// The rows of a group whose targets were exchanged in a ring that begins with `row`; empty where they were not.
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

Found found_in(const Measurements& measurements, const Group& group, QualityKind kind, std::vector<std::size_t> rows) {
  std::sort(rows.begin(), rows.end(),
            [&](std::size_t a, std::size_t b) { return target_of(measurements, a) < target_of(measurements, b); });
  Found found{.configuration = group.configuration, .rows = std::move(rows)};
  found.finding.kind = kind;
  found.finding.repeat = group.repeat;
  for (const std::size_t row : found.rows) {
    found.finding.targets.push_back(measurements.targets[target_of(measurements, row)]);
  }
  return found;
}

// Rings of exchanged targets and rows that lie where another target is. Takes the rows explained out of `rows`.
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

// What the rows of the group that are not out have in common, e.g. the robot's own error there.
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

// A row that is out by itself: one coordinate, or several.
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

// All targets of a configuration together are off where the robot is: by so much that neither its elasticity nor
// temperature, which the model does not know, is to blame.
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

// Whether a finding of the residuals speaks of a target that the distances blame, in the same place.
bool same_matter(const QualityFinding& residual, const QualityFinding& distance) {
  const bool slips = residual.kind == QualityKind::slipped_target;
  if (slips != (distance.kind == QualityKind::slipped_target) ||
      (!slips && residual.configuration != distance.configuration) ||
      (!slips && residual.repeat != 0 && distance.repeat != 0 && residual.repeat != distance.repeat)) {
    return false;
  }
  return std::any_of(distance.targets.begin(), distance.targets.end(), [&](const std::string& name) {
    return std::find(residual.targets.begin(), residual.targets.end(), name) != residual.targets.end();
  });
}

}  // namespace

std::string to_string(QualityKind kind) {
  switch (kind) {
    case QualityKind::slipped_target:
      return "slipped_target";
    case QualityKind::swapped_targets:
      return "swapped_targets";
    case QualityKind::mistaken_target:
      return "mistaken_target";
    case QualityKind::mistyped_coordinate:
      return "mistyped_coordinate";
    case QualityKind::displaced_point:
      return "displaced_point";
    case QualityKind::displaced_configuration:
      return "displaced_configuration";
  }
  return "unknown";
}

std::vector<QualityFinding> check_distances(const Measurements& measurements, const QualityOptions& options) {
  const std::vector<Group> groups = groups_of(measurements);
  const std::vector<double> relative = relative_sigmas(measurements);
  const DistanceLevels distances = distance_levels(measurements, groups, relative, options);
  std::vector<QualityFinding> findings = slips_in_distances(measurements, distances);
  std::vector<Found> all_found;
  for (const Group& group : groups) {
    double cost = 0.0;
    std::vector<Deviation> out = deviations(
        measurements, group, distances, relative, [&](std::size_t row) { return target_of(measurements, row); }, cost);
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

std::vector<QualityFinding> check_residuals(const ErrorModel& model, const Measurements& measurements,
                                            const Estimate& estimate, const QualityOptions& options) {
  if (estimate.targets.size() != measurements.targets.size()) {
    throw InputError(measurements.source + ": " + std::to_string(measurements.targets.size()) +
                     " targets were measured, the preliminary fit has " + std::to_string(estimate.targets.size()));
  }
  if (!(inflation(measurements, fitted_parameters(estimate)) < kLargestInflation)) {
    return {};
  }
  const std::vector<Group> groups = groups_of(measurements);
  const ResidualTable table = residual_table(model, measurements, estimate, options);
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

std::vector<QualityFinding> check_measurements(const ErrorModel& model, const Measurements& measurements,
                                               const Estimate& estimate, const QualityOptions& options) {
  std::vector<QualityFinding> findings = check_residuals(model, measurements, estimate, options);
  const std::size_t of_residuals = findings.size();
  for (QualityFinding& finding : check_distances(measurements, options)) {
    const bool named = std::any_of(findings.begin(), findings.begin() + static_cast<std::ptrdiff_t>(of_residuals),
                                   [&](const QualityFinding& other) { return same_matter(other, finding); });
    if (!named) {
      findings.push_back(std::move(finding));
    }
  }
  return findings;
}

// ---- joint conventions ---------------------------------------------------------------------------------------------

namespace {

// The joint values of the file, and the convention that made them the URDF's.
struct Reading {
  MatrixXd matrix;
  VectorXd offset;
};

ConventionTrial trial(std::string description, const MatrixXd& controller_values, const Reading& reading) {
  return {.description = std::move(description),
          .rms = kInfinity,
          .joint_values = (reading.matrix * controller_values).colwise() + reading.offset};
}

std::string named(const JointConvention& convention) {
  return "the convention " + std::filesystem::path(convention.name).filename().string();
}

bool same_reading(const ConventionTrial& a, const ConventionTrial& b) {
  return (a.joint_values - b.joint_values).isZero(1e-12);
}

// The convention's rows as the independent joints, its columns as those of `used`; nothing for other joints.
std::optional<Reading> reading_of(const JointConvention& convention, const std::vector<std::string>& joints,
                                  const JointConvention* used) {
  const auto known = [&](const std::string& name) {
    return std::find(convention.urdf_joints.begin(), convention.urdf_joints.end(), name) !=
           convention.urdf_joints.end();
  };
  if (convention.urdf_joints.size() != joints.size() || !std::all_of(joints.begin(), joints.end(), known)) {
    return std::nullopt;
  }
  const JointConvention ordered = matched_convention(convention, joints);
  Reading reading{.matrix = ordered.matrix, .offset = ordered.offset};
  if (used != nullptr) {
    for (std::size_t j = 0; j < used->controller_joints.size(); ++j) {
      const auto found =
          std::find(ordered.controller_joints.begin(), ordered.controller_joints.end(), used->controller_joints[j]);
      if (found == ordered.controller_joints.end()) {
        return std::nullopt;
      }
      reading.matrix.col(static_cast<Index>(j)) = ordered.matrix.col(found - ordered.controller_joints.begin());
    }
  }
  return reading;
}

std::vector<ConventionTrial> readings(const std::vector<std::string>& names, const MatrixXd& joint_values,
                                      const JointConvention* used, const std::vector<JointConvention>& others) {
  const auto joints = static_cast<Index>(names.size());
  Reading present{.matrix = MatrixXd::Identity(joints, joints), .offset = VectorXd::Zero(joints)};
  if (used != nullptr) {
    const JointConvention ordered = matched_convention(*used, names);
    present = {.matrix = ordered.matrix, .offset = ordered.offset};
  }
  const MatrixXd controller = present.matrix.partialPivLu().solve(joint_values.colwise() - present.offset);
  std::vector<ConventionTrial> trials = {
      trial(used != nullptr ? named(*used) : "the joint values as they are", controller, present)};
  trials.front().present = true;
  const auto consider = [&](ConventionTrial candidate) {
    if (std::none_of(trials.begin(), trials.end(), [&](const auto& other) { return same_reading(other, candidate); })) {
      trials.push_back(std::move(candidate));
    }
  };
  for (const JointConvention& other : others) {
    if (const auto reading = reading_of(other, names, used)) {
      consider(trial(named(other), controller, *reading));
    }
  }
  if (used != nullptr) {
    consider(trial("the joint values as they are", controller,
                   {.matrix = MatrixXd::Identity(joints, joints), .offset = VectorXd::Zero(joints)}));
  }
  for (Index j = 0; j < joints; ++j) {
    Reading flipped = present;
    flipped.matrix.row(j) *= -1.0;
    consider(trial(names[static_cast<std::size_t>(j)] + " with the opposite sign", controller, flipped));
  }
  for (Index j = 0; used != nullptr && j < joints; ++j) {
    Reading flipped = present;
    flipped.matrix.col(j) *= -1.0;
    consider(
        trial("the controller's " + used->controller_joints[static_cast<std::size_t>(j)] + " with the opposite sign",
              controller, flipped));
  }
  return trials;
}

// Errors that no robot has: with enough of them a wrong reading may fit, e.g. the fifth joint's opposite sign as half a
// turn of the fourth and the sixth.
bool plausible(const ErrorModel& model, const VectorXd& errors) {
  constexpr double kLargestLength = 0.05;  // [m]
  constexpr double kLargestAngle = 0.35;   // [rad]
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const double limit = is_length(model, model.parameters[p]) ? kLargestLength : kLargestAngle;
    if (!(std::abs(errors[static_cast<Index>(p)]) < limit)) {
      return false;
    }
  }
  return true;
}

double rms_of(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate) {
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, measurements.joint_values);
  double sum = 0.0;
  double count = 0.0;
  for (const Observation& observation : measurements.observations) {
    if (observation.split == Split::train) {
      const Vector3d predicted =
          estimate.X_WB * (X_BF[static_cast<std::size_t>(observation.configuration)] *
                           estimate.targets[static_cast<std::size_t>(observation.target)].X_FT.translation());
      sum += (observation.position - predicted).squaredNorm();
      count += 1.0;
    }
  }
  const double rms = std::sqrt(sum / count);
  return std::isfinite(rms) ? rms : kInfinity;
}

}  // namespace

std::vector<ConventionTrial> try_conventions(const ErrorModel& model, const Measurements& measurements,
                                             const FreeParameters& free, const JointConvention* used,
                                             const std::vector<JointConvention>& others,
                                             const ConventionOptions& options) {
  std::vector<ConventionTrial> trials =
      readings(independent_joint_names(model.joints), independent_joint_values(model.joints, measurements.joint_values),
               used, others);
  parallel_for(trials.size(), options.threads, [&](std::size_t i) {
    Measurements reread = measurements;
    trials[i].joint_values = all_joint_values(model.joints, trials[i].joint_values);
    reread.joint_values = trials[i].joint_values;
    const Estimate start = nominal_start(model, reread, options.registration);
    trials[i].rms = rms_of(model, reread, start);
    const Identification fit = identify_jointly(model, reread, start, free, options.joint);
    if (plausible(model, fit.estimate.errors)) {
      trials[i].rms = std::min(trials[i].rms, rms_of(model, reread, fit.estimate));
    }
  });
  std::stable_sort(trials.begin(), trials.end(),
                   [](const ConventionTrial& a, const ConventionTrial& b) { return a.rms < b.rms; });
  return trials;
}

std::optional<ConventionTrial> better_convention(const std::vector<ConventionTrial>& trials, double factor) {
  const auto present =
      std::find_if(trials.begin(), trials.end(), [](const ConventionTrial& trial) { return trial.present; });
  if (present == trials.end() || trials.front().present || !(trials.front().rms < factor * present->rms)) {
    return std::nullopt;
  }
  return trials.front();
}

}  // namespace kdl_calibration
