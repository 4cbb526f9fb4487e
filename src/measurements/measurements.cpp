#include "kdl_calibration/measurements.hpp"
#include "base/decompositions.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <string>
#include <utility>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/directions.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/measurements_check.hpp"
#include "measurements/training_rows.hpp"

namespace kdl_calibration {
namespace {

/// Mean of the orientations of the given rows, see averaged(); NaN if none of them has one.
Eigen::Quaterniond mean_orientation(const std::vector<Eigen::Quaterniond>& orientations,
                                    const std::vector<std::size_t>& rows) {
  std::vector<Eigen::Quaterniond> given;
  for (const std::size_t row : rows) {
    if (!is_point(orientations[row])) given.push_back(orientations[row]);
  }
  if (given.empty()) return orientations[rows.front()];
  if (given.size() == 1) return given.front();
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (const Eigen::Quaterniond& q : given) sum += q.coeffs() * q.coeffs().transpose();
  const Eigen::Vector4d mean = spectrum(sum).vectors.col(3).normalized();
  return Eigen::Quaterniond(mean.dot(given.front().coeffs()) < 0.0 ? Eigen::Vector4d(-mean) : mean);
}

/// Mean of the given rows, which share configuration and target.
Observation mean_observation(const std::vector<Observation>& observations, const std::vector<std::size_t>& rows) {
  Observation mean = observations[rows.front()];
  const auto count = static_cast<double>(rows.size());
  Eigen::Vector3d difference = Eigen::Vector3d::Zero();  // relative to the first, so that equal rows have an exact mean
  double variance = 0.0;
  bool all_stated = true;
  for (const std::size_t row : rows) {
    const Observation& o = observations[row];
    difference += o.position - mean.position;
    variance += o.sigma * o.sigma;
    all_stated = all_stated && o.sigma > 0.0;
  }
  mean.position += difference / count;
  mean.sigma = all_stated ? std::sqrt(variance) / count : 0.0;
  mean.repeat = 1;
  return mean;
}

/// Replaces the mean of rows with directions P and weights w: L^+ sum w P z with L = sum w P. Of distances it is their
/// weighted mean. Returns what it measures.
MeasuredCoordinates take_mean_of_coordinates(const Measurements& measurements, const std::vector<std::size_t>& rows,
                                             Observation& mean) {
  const bool all_stated = mean.sigma > 0.0;
  Eigen::Matrix3d L = Eigen::Matrix3d::Zero();
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weights = 0.0;
  double distances = 0.0;
  for (const std::size_t row : rows) {
    const Observation& o = measurements.observations[row];
    const double w = all_stated ? 1.0 / (o.sigma * o.sigma) : 1.0;
    L += w * measurements.coordinates[row].directions;
    sum += w * o.position;
    weights += w;
    distances += w * measurements.coordinates[row].distance;
  }
  if (distances > 0.0) {
    mean.position = measurements.observations[rows.front()].position;
    mean.sigma = all_stated ? 1.0 / std::sqrt(weights) : 0.0;
    return {.distance = distances / weights};
  }
  const Eigen::Matrix3Xd R = root_of_directions(L);
  mean.position = inverse_on_directions(R) * sum;
  mean.sigma = all_stated ? std::sqrt(static_cast<double>(R.cols()) / L.trace()) : 0.0;
  return {.directions = projector(R)};
}

}  // namespace

Eigen::Quaterniond point_alone() {
  return Eigen::Quaterniond(Eigen::Vector4d::Constant(std::numeric_limits<double>::quiet_NaN()));
}

bool is_point(const Eigen::Quaterniond& orientation) { return std::isnan(orientation.w()); }

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
  for (std::size_t i = 0; i < measurements.observations.size(); ++i) {
    const Observation& o = measurements.observations[i];
    if (!keep(o)) continue;
    numbers[static_cast<std::size_t>(o.configuration)] = 0;
    kept.observations.push_back(o);
    if (!measurements.orientations.empty()) kept.orientations.push_back(measurements.orientations[i]);
    if (has_single_coordinates(measurements)) kept.coordinates.push_back(measurements.coordinates[i]);
    if (!measurements.order.empty()) kept.order.push_back(measurements.order[i]);
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
  drop_unused_orientations(kept.orientations);
  return kept;
}

Measurements whole_points(const Measurements& measurements) {
  const Observation* const first = measurements.observations.data();
  Measurements whole = subset(measurements, [&](const Observation& o) {
    return coordinates_of(measurements, static_cast<std::size_t>(&o - first)) == 3;
  });
  whole.coordinates.clear();
  return whole;
}

Measurements without_rows(const Measurements& measurements, const std::vector<std::string>& names) {
  // Distances from other anchors are configurations "12 from A2".
  const auto is_named = [&](const Observation& o, const std::string& name) {
    const std::string& label = measurements.configurations[static_cast<std::size_t>(o.configuration)];
    return label == name || (has_single_coordinates(measurements) && label.rfind(name + " from ", 0) == 0);
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
  if (rows_of_single_coordinates(kept) == 0) {
    kept.coordinates.clear();
  }
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
  Measurements means = measurements;
  means.observations.clear();
  means.orientations.clear();
  means.coordinates.clear();
  means.order.clear();
  const auto& observations = measurements.observations;
  const auto key = [&](std::size_t i) { return std::pair(observations[i].configuration, observations[i].target); };
  std::vector<std::size_t> order(observations.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto before = [&](std::size_t a, std::size_t b) { return key(a) < key(b); };
  if (!std::is_sorted(order.begin(), order.end(), before)) {
    std::stable_sort(order.begin(), order.end(), before);
  }
  std::vector<std::size_t> rows;
  for (std::size_t k = 0; k < order.size(); ++k) {
    rows.push_back(order[k]);
    if (k + 1 < order.size() && key(order[k]) == key(order[k + 1])) continue;
    means.observations.push_back(mean_observation(observations, rows));
    if (has_single_coordinates(measurements)) {
      means.coordinates.push_back(rows.size() == 1
                                      ? measurements.coordinates[rows.front()]
                                      : take_mean_of_coordinates(measurements, rows, means.observations.back()));
    }
    if (!measurements.orientations.empty()) {
      means.orientations.push_back(mean_orientation(measurements.orientations, rows));
    }
    if (!measurements.order.empty()) means.order.push_back(measurements.order[rows.front()]);
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
  const auto pad = [&](std::size_t count) {
    result.orientations.resize(result.orientations.size() + count, point_alone());
  };
  const bool poses = !first.orientations.empty() || !second.orientations.empty();
  if (poses && first.orientations.empty()) {
    pad(first.observations.size());
  }
  if (poses && second.orientations.empty()) {
    pad(second.observations.size());
  }
  result.orientations.insert(result.orientations.end(), second.orientations.begin(), second.orientations.end());
  if (has_single_coordinates(first) || has_single_coordinates(second)) {
    result.coordinates.clear();
    for (const Measurements* part : {&first, &second}) {
      for (std::size_t row = 0; row < part->observations.size(); ++row) {
        result.coordinates.push_back(coordinates_at(*part, row));
      }
    }
  }
  result.signals = side_by_side(first.signals, second.signals);
  if (first.order.empty() || second.order.empty()) {
    result.order.clear();
  } else {
    result.order.insert(result.order.end(), second.order.begin(), second.order.end());
  }
  return result;
}

}  // namespace kdl_calibration
