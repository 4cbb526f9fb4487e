#include "kdl_calibration/measurements.hpp"
#include "base/decompositions.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/measurements_check.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {
namespace {

/// Mean of the given orientations, see averaged().
Orientation mean_orientation(const std::vector<Orientation>& given) {
  if (given.size() == 1) return given.front();
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (const Orientation& q : given) sum += q.coeffs() * q.coeffs().transpose();
  const Eigen::Vector4d mean = spectrum(sum).vectors.col(3).normalized();
  return Orientation(mean.dot(given.front().coeffs()) < 0.0 ? Eigen::Vector4d(-mean) : mean);
}

using SameCell = std::vector<const Observation*>;

/// Mean of whole points or poses.
Reading mean_of_points(const SameCell& rows) {
  const Eigen::Vector3d first = rows.front()->position();  // so that equal rows have an exact mean
  Eigen::Vector3d difference = Eigen::Vector3d::Zero();
  std::vector<Orientation> orientations;
  for (const Observation* row : rows) {
    difference += row->position() - first;
    if (row->orientation() != nullptr) orientations.push_back(*row->orientation());
  }
  const Eigen::Vector3d mean = first + difference / static_cast<double>(rows.size());
  return orientations.empty() ? Reading(Point{mean}) : Reading(Pose{mean, mean_orientation(orientations)});
}

double weight(const Observation& row, bool by_sigma) { return by_sigma ? 1.0 / (row.sigma * row.sigma) : 1.0; }

/// Mean of rows with directions P and weights w, L^+ sum w P z with L = sum w P, and its sigma for w = 1 / sigma^2.
std::pair<Reading, double> mean_of_coordinates(const SameCell& rows, bool by_sigma) {
  Eigen::Matrix3d L = Eigen::Matrix3d::Zero();
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Observation* row : rows) {
    const double w = weight(*row, by_sigma);
    L += w * directions(row->reading, row->position());
    sum += w * row->position();
  }
  const Reading mean = reading_along(L, inverse_on_directions(root_of_directions(L)) * sum);
  return {mean, std::sqrt(static_cast<double>(dimension(mean)) / L.trace())};
}

/// Weighted mean of distances from one anchor.
std::pair<Reading, double> mean_of_distances(const SameCell& rows, bool by_sigma) {
  double weights = 0.0;
  double sum = 0.0;
  for (const Observation* row : rows) {
    const double w = weight(*row, by_sigma);
    weights += w;
    sum += w * std::get<Distance>(row->reading).length;
  }
  return {Distance{.length = sum / weights, .anchor = rows.front()->position()}, 1.0 / std::sqrt(weights)};
}

/// Mean of the given rows, which share configuration and target.
Observation mean_observation(const SameCell& rows) {
  Observation mean = *rows.front();
  mean.repeat = 1;
  if (rows.size() == 1) return mean;
  const bool all_stated =
      std::all_of(rows.begin(), rows.end(), [](const Observation* row) { return row->sigma > 0.0; });
  if (std::all_of(rows.begin(), rows.end(), [](const Observation* row) { return is_whole(*row); })) {
    mean.reading = mean_of_points(rows);
    double variance = 0.0;
    for (const Observation* row : rows) variance += row->sigma * row->sigma;
    mean.sigma = std::sqrt(variance) / static_cast<double>(rows.size());
  } else {
    std::tie(mean.reading, mean.sigma) =
        is_distance(mean) ? mean_of_distances(rows, all_stated) : mean_of_coordinates(rows, all_stated);
  }
  if (!all_stated) mean.sigma = 0.0;
  return mean;
}

}  // namespace

Measurements subset(const Measurements& measurements, const std::function<bool(const Observation&)>& keep) {
  check(measurements);
  require_function("what says which observations to keep", keep);
  Measurements kept;
  kept.source = measurements.source;
  kept.remark = measurements.remark;
  kept.joints = measurements.joints;
  kept.targets = measurements.targets;
  kept.stations = measurements.stations;
  kept.joint_units = measurements.joint_units;
  std::vector<std::int32_t> numbers(measurements.configurations.size(), -1);
  for (const Observation& o : measurements.observations) {
    if (!keep(o)) continue;
    numbers[static_cast<std::size_t>(o.configuration)] = 0;
    kept.observations.push_back(o);
  }
  std::vector<Eigen::Index> columns;
  for (std::size_t c = 0; c < numbers.size(); ++c) {
    if (numbers[c] < 0) continue;
    numbers[c] = static_cast<std::int32_t>(columns.size());
    columns.push_back(static_cast<Eigen::Index>(c));
    kept.configurations.push_back(measurements.configurations[c]);
  }
  kept.joint_values = measurements.joint_values(Eigen::all, columns);
  kept.signals = kdl_calibration::columns(measurements.signals, columns);
  for (Observation& o : kept.observations) o.configuration = numbers[static_cast<std::size_t>(o.configuration)];
  return kept;
}

Measurements without_rows(const Measurements& measurements, const std::vector<std::string>& names) {
  // Distances from other anchors are configurations "12 from A2".
  const bool single_coordinates = has_single_coordinates(measurements);
  const auto is_named = [&](const Observation& o, const std::string& name) {
    const std::string& label = measurements.configurations[static_cast<std::size_t>(o.configuration)];
    return label == name || (single_coordinates && label.rfind(name + " from ", 0) == 0);
  };
  const auto matches = [&](const Observation& o, const std::string& name) {
    const std::size_t colon = name.rfind(':');
    return is_named(o, name) || (colon != std::string::npos && is_named(o, name.substr(0, colon)) &&
                                 measurements.targets[static_cast<std::size_t>(o.target)] == name.substr(colon + 1));
  };
  for (const std::string& name : names) {
    if (std::none_of(measurements.observations.begin(), measurements.observations.end(),
                     [&](const Observation& o) { return matches(o, name); })) {
      throw InputError(measurements.source + ": " + in_quotes(name) +
                       " cannot be left out: expected a configuration that was measured, or CONFIGURATION:TARGET");
    }
  }
  Measurements kept = subset(measurements, [&](const Observation& o) {
    return std::none_of(names.begin(), names.end(), [&](const std::string& name) { return matches(o, name); });
  });
  if (kept.observations.empty()) {
    throw InputError(measurements.source + ": nothing is left to read without " + comma_separated(names));
  }
  if (!names.empty()) {
    kept.remark += (kept.remark.empty() ? "" : "; ") + std::string("left out as asked: ") + comma_separated(names);
  }
  return kept;
}

Measurements averaged(const Measurements& measurements) {
  check(measurements);
  Measurements means = without_observations(measurements);
  const auto& observations = measurements.observations;
  const auto key = [&](std::size_t i) { return std::pair(observations[i].configuration, observations[i].target); };
  std::vector<std::size_t> order(observations.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto before = [&](std::size_t a, std::size_t b) { return key(a) < key(b); };
  if (!std::is_sorted(order.begin(), order.end(), before)) {
    std::stable_sort(order.begin(), order.end(), before);
  }
  SameCell rows;
  for (std::size_t k = 0; k < order.size(); ++k) {
    rows.push_back(&observations[order[k]]);
    if (k + 1 < order.size() && key(order[k]) == key(order[k + 1])) continue;
    means.observations.push_back(mean_observation(rows));
    rows.clear();
  }
  return means;
}

Measurements joined(const Measurements& first, const Measurements& second) {
  check(first);
  check(second);
  require_count("joints of the second measurements", second.joint_values.rows(), first.joint_values.rows());
  const bool same_joints = first.joints.empty() || second.joints.empty() || first.joints == second.joints;
  if (!same_joints || first.targets != second.targets) {
    refuse_input("the second measurements have other joints or targets", "those of the first");
  }
  if (first.stations != second.stations) {
    refuse_input("the second measurements have other stations", "those of the first");
  }
  Measurements result = first;
  const auto offset = static_cast<std::int32_t>(first.joint_values.cols());
  result.joint_values.resize(first.joint_values.rows(), first.joint_values.cols() + second.joint_values.cols());
  result.joint_values << first.joint_values, second.joint_values;
  // The second ones are numbered on from the first, past labels that those have.
  const std::set<std::string> taken(first.configurations.begin(), first.configurations.end());
  std::size_t number = taken.size();
  for (std::size_t c = 0; c < second.configurations.size(); ++c) {
    do {
      ++number;
    } while (taken.count(std::to_string(number)) > 0);
    result.configurations.push_back(std::to_string(number));
  }
  for (Observation observation : second.observations) {
    observation.configuration += offset;
    result.observations.push_back(observation);
  }
  result.signals = side_by_side(first.signals, second.signals);
  if (!has_order(first) || !has_order(second)) result = without_order(std::move(result));
  return result;
}

}  // namespace kdl_calibration
