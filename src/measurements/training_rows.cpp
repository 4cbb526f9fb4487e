#include "measurements/training_rows.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <numeric>

#include "base/preconditions.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/measurements_check.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {
namespace {

bool is_training(const Observation& observation) { return observation.split == Split::train; }

}  // namespace

TrainingRows::TrainingRows(const Measurements& measurements) : all_(measurements) {
  const std::vector<Observation>& rows = all_.observations;
  if (std::all_of(rows.begin(), rows.end(), is_training)) {
    return;
  }
  check(all_);
  apart_ = without_observations(all_);
  std::copy_if(rows.begin(), rows.end(), std::back_inserter(apart_->observations), is_training);
}

std::vector<double> TrainingRows::values_of(std::vector<double> of_all) const {
  if (of_all.empty()) {
    return of_all;
  }
  require_count("values of rows", of_all.size(), all_.observations.size());
  std::vector<double> result;
  for (std::size_t row = 0; row < of_all.size(); ++row) {
    if (is_training(all_.observations[row])) {
      result.push_back(of_all[row]);
    }
  }
  return result;
}

std::vector<double> TrainingRows::values_among_all(std::vector<double> values, double other) const {
  if (!values.empty()) {
    require_count("values of training rows", values.size(), (**this).observations.size());
  }
  if (values.empty() || !has_others()) {
    return values;
  }
  std::vector<double> result;
  result.reserve(all_.observations.size());
  auto next = values.begin();
  for (const Observation& observation : all_.observations) {
    result.push_back(is_training(observation) ? *next++ : other);
  }
  return result;
}

std::vector<bool> configurations_with(Split split, const Measurements& measurements) {
  check(measurements);
  std::vector<bool> found(measurements.configurations.size(), false);
  for (const Observation& observation : measurements.observations) {
    if (observation.split == split) {
      found[static_cast<std::size_t>(observation.configuration)] = true;
    }
  }
  return found;
}

std::vector<bool> trained_configurations(const Measurements& measurements) {
  return configurations_with(Split::train, measurements);
}

Measurements training_sample(const Measurements& measurements, std::size_t most_configurations) {
  const std::vector<bool> trained = trained_configurations(measurements);
  std::vector<std::size_t> all;
  for (std::size_t c = 0; c < trained.size(); ++c) {
    if (trained[c]) {
      all.push_back(c);
    }
  }
  std::vector<bool> chosen(trained.size(), false);
  const std::size_t count = std::min(all.size(), most_configurations);
  for (std::size_t i = 0; i < count; ++i) {
    chosen[all[i * all.size() / count]] = true;
  }
  return subset(measurements, [&](const Observation& observation) {
    return is_training(observation) && chosen[static_cast<std::size_t>(observation.configuration)];
  });
}

Eigen::MatrixXd approach_directions(const Measurements& measurements) {
  const std::vector<Observation>& observations = measurements.observations;
  if (std::none_of(observations.begin(), observations.end(),
                   [](const Observation& o) { return o.order.has_value(); })) {
    return {};
  }
  check(measurements);
  std::vector<std::size_t> rows(observations.size());
  std::iota(rows.begin(), rows.end(), std::size_t{0});
  std::stable_sort(rows.begin(), rows.end(),
                   [&](std::size_t a, std::size_t b) { return observations[a].order < observations[b].order; });
  std::vector<Eigen::Index> visits;
  for (const std::size_t row : rows) {
    const Eigen::Index configuration = observations[row].configuration;
    if (visits.empty() || visits.back() != configuration) {
      visits.push_back(configuration);
    }
  }
  const Eigen::MatrixXd directions = directions_of_motion(measurements.joint_values(Eigen::all, visits));
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(directions.rows(), measurements.joint_values.cols());
  Eigen::MatrixXd counts = sums;
  for (std::size_t v = 0; v < visits.size(); ++v) {
    for (Eigen::Index j = 0; j < directions.rows(); ++j) {
      if (const double direction = directions(j, static_cast<Eigen::Index>(v)); !std::isnan(direction)) {
        sums(j, visits[v]) += direction;
        counts(j, visits[v]) += 1.0;
      }
    }
  }
  return sums.cwiseQuotient(counts);  // 0 / 0 gives NaN: unknown
}

JointRanges trained_ranges(const Measurements& measurements) {
  check(measurements);
  constexpr double kNone = std::numeric_limits<double>::infinity();
  JointRanges ranges(static_cast<std::size_t>(measurements.joint_values.rows()), {kNone, -kNone});
  for (const Observation& observation : measurements.observations) {
    if (!is_training(observation)) {
      continue;
    }
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      const double value = measurements.joint_values(static_cast<Eigen::Index>(i), observation.configuration);
      ranges[i] = {std::min(ranges[i].first, value), std::max(ranges[i].second, value)};
    }
  }
  return ranges;
}

}  // namespace kdl_calibration
