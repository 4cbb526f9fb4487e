#include "estimation/observed_points.hpp"

#include <algorithm>
#include <numeric>
#include <optional>
#include <tuple>

#include "estimation/residual_options.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Row indices sorted by configuration; empty if already sorted.
std::vector<std::uint32_t> order_of_configurations(const Measurements& measurements) {
  const std::vector<Observation>& rows = measurements.observations;
  std::vector<std::uint32_t> order;
  const auto by_configuration = [](const Observation& a, const Observation& b) {
    return a.configuration < b.configuration;
  };
  if (!std::is_sorted(rows.begin(), rows.end(), by_configuration)) {
    order.resize(rows.size());
    std::iota(order.begin(), order.end(), 0U);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return by_configuration(rows[a], rows[b]); });
  }
  return order;
}

// Empty if a coordinate's variance given the others of its repeat is negligible: the inverse would have no correct
// digits.
std::optional<MatrixXd> inverse_covariance(const MatrixXd& covariance) {
  constexpr double kLeastOwnShare = 1e-12;
  const Eigen::LLT<MatrixXd> root(covariance);
  const VectorXd own_share = root.matrixLLT().diagonal().cwiseAbs2().cwiseQuotient(covariance.diagonal());
  if (root.info() != Eigen::Success || !(own_share.minCoeff() > kLeastOwnShare)) {
    return std::nullopt;
  }
  return root.solve(MatrixXd::Identity(covariance.rows(), covariance.cols()));
}

// Information of the means of one configuration's targets, 3 coordinates each, with the misfit added to their
// covariance.
MatrixXd with_misfit(const MatrixXd& information, const NoiseModel& noise) {
  if (!noise.has_misfit()) {
    return information;
  }
  const Index size = information.rows();
  const MatrixXd unit = MatrixXd::Identity(size, size);
  const Eigen::LLT<MatrixXd> root(information);
  MatrixXd covariance = root.solve(unit) + noise.target_misfit * noise.target_misfit * unit;
  covariance += noise.misfit * noise.misfit * Matrix3d::Identity().replicate(size / 3, size / 3);
  return Eigen::LLT<MatrixXd>(covariance).solve(unit);
}

void append_coordinates(std::size_t target, std::vector<Index>& coordinates) {
  const auto first = static_cast<Index>(3 * target);
  coordinates.insert(coordinates.end(), {first, first + 1, first + 2});
}

}  // namespace

Gathering::Gathering(const Measurements& measurements, const ResidualOptions& options)
    : measurements_(measurements),
      options_(options),
      isotropic_(options.noise.is_isotropic()),
      order_(order_of_configurations(measurements)),
      points_(measurements.targets.size()),
      seen_(measurements.targets.size(), false),
      single_coordinates_(has_single_coordinates(measurements)) {}

// Test rows and rows of weight zero are not fitted.
bool Gathering::is_fitted(std::size_t row) const {
  return measurements_.observations[row].split == Split::train && options_.row_weight(row) > 0.0;
}

const ObservedConfiguration* Gathering::next() {
  const std::vector<Observation>& observations = measurements_.observations;
  for (rows_.clear(); rows_.empty();) {
    if (next_ == observations.size()) {
      return nullptr;
    }
    const std::int32_t configuration = observations[row_at(next_)].configuration;
    configuration_.column = configuration;
    for (; next_ < observations.size() && observations[row_at(next_)].configuration == configuration; ++next_) {
      if (is_fitted(row_at(next_))) {
        rows_.push_back(static_cast<std::uint32_t>(row_at(next_)));
      }
    }
  }
  if (single_coordinates_) {
    for (const std::uint32_t row : rows_) {
      add_coordinates(row);
    }
    take_seen_points();
    configuration_.by_point = true;
  } else if (isotropic_) {
    for (const std::uint32_t row : rows_) {
      add_row(row);
    }
    take_seen_points();
  } else {
    add_repeats();
  }
  return &configuration_;
}

// Adds an independent row with isotropic noise: running weighted mean and sum of squares about it (West 1979).
void Gathering::add_row(std::size_t row) {
  const Observation& observation = measurements_.observations[row];
  const auto target = static_cast<std::size_t>(observation.target);
  ObservedPoint& point = points_[target];
  const double information = position_information(options_, observation);
  const double weight = options_.row_weight(row) * information;
  const Vector3d deviation = observation.position() - point.position;
  point.position += deviation * (weight / (point.weight + weight));
  totals_.cost_of_repeats += deviation.squaredNorm() * weight * point.weight / (point.weight + weight);
  point.weight += weight;
  seen_[target] = true;
  totals_.equations += 3;
  totals_.points += 1;
  totals_.weight += weight;
  add_orientation(row, information, point);
}

// The same for coordinates along the directions P of a row: with the information L so far, L + w P and the position
// + (L + w P)^+ w P (z - position), which minimises the sum of squares; and for distances from one anchor.
void Gathering::add_coordinates(std::size_t row) {
  const Observation& observation = measurements_.observations[row];
  const auto target = static_cast<std::size_t>(observation.target);
  ObservedPoint& point = points_[target];
  const double weight = options_.row_weight(row) * position_information(options_, observation);
  if (const auto* const distance = std::get_if<Distance>(&observation.reading)) {
    const double deviation = distance->length - point.distance;
    const double share = weight / (point.weight + weight);
    totals_.cost_of_repeats += deviation * deviation * share * point.weight;
    point.distance += share * deviation;
    point.weight += weight;
    point.position = observation.position();
  } else {
    const Matrix3d before = point.information;
    point.information += weight * directions(observation.reading, point.position);
    const Vector3d deviation = measured_minus_predicted(observation.reading, point.position);
    const Eigen::Matrix3Xd R = root_of_directions(point.information);
    const Vector3d step = inverse_on_directions(R) * (weight * deviation);
    point.directions = projector(R);
    point.position += step;
    totals_.cost_of_repeats +=
        step.dot(before * step) + weight * measured_minus_predicted(observation.reading, point.position).squaredNorm();
  }
  seen_[target] = true;
  totals_.equations += dimension(observation.reading);
  totals_.points += 1;
  totals_.weight += weight;
}

// Running mean of close rotations: along the geodesic by the new one's share.
void Gathering::add_orientation(std::size_t row, double position_information, ObservedPoint& point) {
  const Orientation* const orientation = measurements_.observations[row].orientation();
  if (orientation == nullptr) {
    return;
  }
  const double weight = options_.row_weight(row) *
                        orientation_information(options_, position_information, measurements_.observations[row].noise);
  const Matrix3d Z = orientation->toRotationMatrix();
  if (point.orientation_weight == 0.0) {
    point.orientation = Z;
  } else {
    const double share = weight / (point.orientation_weight + weight);
    const Vector3d deviation = rotation_log(point.orientation.transpose() * Z);
    totals_.cost_of_repeats += deviation.squaredNorm() * share * point.orientation_weight;
    point.orientation = point.orientation * rotation_exp(share * deviation);
  }
  point.orientation_weight += weight;
  totals_.equations += 3;
}

// For any covariance: sums the information of the repeats, a block over the points each. With W = sum W_r and the mean
// z = W^-1 sum W_r z_r, sum (z_r - f)^T W_r (z_r - f) = (z - f)^T W (z - f) + constant. All z are relative to the first
// repeat of their target, because the constant is a small difference of squares.
void Gathering::add_repeats() {
  sort_by_repeat();
  if (options_.noise.tracker || !is_like_the_last()) {  // a tracker's noise depends on the position
    describe_repeats();
  }
  take_means();
}

void Gathering::sort_by_repeat() {
  const auto key = [&](std::uint32_t row) {
    const Observation& observation = measurements_.observations[row];
    return std::tuple(observation.repeat, observation.target);
  };
  const auto before = [&](std::uint32_t a, std::uint32_t b) { return key(a) < key(b); };
  if (!std::is_sorted(rows_.begin(), rows_.end(), before)) {
    std::stable_sort(rows_.begin(), rows_.end(), before);
  }
}

// `before`: the previous row.
Gathering::PatternRow Gathering::pattern_row(std::size_t i, const PatternRow& before) const {
  const Observation& observation = measurements_.observations[rows_[i]];
  const bool is_next = i > 0 && observation.repeat != measurements_.observations[rows_[i - 1]].repeat;
  return {.repeat = before.repeat + (is_next ? 1 : 0),
          .target = observation.target,
          .sigma = observation.sigma,
          .factor = observation.noise.length,
          .weight = options_.row_weight(rows_[i])};
}

bool Gathering::is_like_the_last() const {
  bool alike = rows_.size() == pattern_.rows.size();
  PatternRow row;
  for (std::size_t i = 0; alike && i < rows_.size(); ++i) {
    row = pattern_row(i, row);
    alike = row == pattern_.rows[i];
  }
  return alike;
}

void Gathering::describe_repeats() {
  const auto targets = static_cast<Index>(points_.size());
  const Matrix3d common = options_.noise.common.cwiseAbs2().asDiagonal();
  MatrixXd sum = MatrixXd::Zero(3 * targets, 3 * targets);  // sum of the repeats' information
  std::vector<bool> measured(points_.size(), false);
  pattern_.rows.clear();
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    pattern_.rows.push_back(pattern_row(i, i == 0 ? PatternRow() : pattern_.rows.back()));
  }
  pattern_.repeats.clear();
  for (std::size_t begin = 0; begin < rows_.size();) {
    Repeat& repeat = pattern_.repeats.emplace_back();
    repeat.begin = begin;
    for (; begin < rows_.size() && pattern_.rows[begin].repeat == pattern_.rows[repeat.begin].repeat; ++begin) {
      append_coordinates(static_cast<std::size_t>(pattern_.rows[begin].target), repeat.coordinates);
      measured[static_cast<std::size_t>(pattern_.rows[begin].target)] = true;
    }
    repeat.end = begin;
    const auto count = static_cast<Index>(repeat.end - repeat.begin);
    MatrixXd covariance = common.replicate(count, count);
    for (std::size_t i = repeat.begin; i < repeat.end; ++i) {
      const auto place = static_cast<Index>(3 * (i - repeat.begin));
      covariance.block<3, 3>(place, place) +=
          point_covariance(options_.noise, measurements_.observations[rows_[i]]) / pattern_.rows[i].weight;
    }
    repeat.inverse = inverse_of(covariance);
    sum(repeat.coordinates, repeat.coordinates) += repeat.inverse;
  }
  pattern_.coordinates.clear();
  for (std::size_t k = 0; k < measured.size(); ++k) {
    if (measured[k]) {
      append_coordinates(k, pattern_.coordinates);
    }
  }
  MatrixXd of_measured = sum(pattern_.coordinates, pattern_.coordinates);
  if (of_measured.size() != of_repeats_.size() || of_measured != of_repeats_) {
    root_.compute(of_measured);
    configuration_.information = std::make_shared<const MatrixXd>(with_misfit(of_measured, options_.noise));
    of_repeats_ = std::move(of_measured);
  }
}

const MatrixXd& Gathering::inverse_of(const MatrixXd& covariance) {
  if (covariance.size() != covariance_.size() || covariance != covariance_) {
    std::optional<MatrixXd> found = inverse_covariance(covariance);
    if (!found) {
      throw InputError(measurements_.source + ": configuration '" +
                       measurements_.configurations[static_cast<std::size_t>(configuration_.column)] +
                       "': the noise of single points is too small, expected more than a millionth of what they "
                       "share, along every axis");
    }
    inverse_ = std::move(*found);
    covariance_ = covariance;
  }
  return inverse_;
}

void Gathering::take_means() {
  weighted_.setZero(static_cast<Index>(3 * points_.size()));
  double squares = 0.0;
  for (const Repeat& repeat : pattern_.repeats) {
    deviations_.resize(static_cast<Index>(repeat.coordinates.size()));
    for (std::size_t i = repeat.begin; i < repeat.end; ++i) {
      const Observation& observation = measurements_.observations[rows_[i]];
      const auto target = static_cast<std::size_t>(observation.target);
      ObservedPoint& point = points_[target];
      if (!seen_[target]) {
        point.position = observation.position();
        seen_[target] = true;
      }
      deviations_.segment<3>(static_cast<Index>(3 * (i - repeat.begin))) = observation.position() - point.position;
      if (has_orientation(observation)) {
        add_orientation(rows_[i], 3.0 / point_covariance(options_.noise, observation).trace(), point);
      }
    }
    if (!deviations_.isZero(0.0)) {
      pulls_.noalias() = repeat.inverse * deviations_;
      squares += deviations_.dot(pulls_);
      weighted_(repeat.coordinates) += pulls_;
    }
  }
  totals_.equations += 3 * static_cast<long>(rows_.size());
  totals_.points += static_cast<long>(rows_.size());
  totals_.weight += configuration_.information->trace() / 3.0;
  take_seen_points();
  if (squares == 0.0) {
    return;
  }
  const VectorXd weighted = weighted_(pattern_.coordinates);
  const VectorXd mean = root_.solve(weighted);
  totals_.cost_of_repeats += squares - mean.dot(weighted);
  for (std::size_t i = 0; i < configuration_.points.size(); ++i) {
    configuration_.points[i].position += mean.segment<3>(static_cast<Index>(3 * i));
  }
}

// Moves the gathered points to the configuration and clears them for the next one.
void Gathering::take_seen_points() {
  configuration_.points.clear();
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    if (seen_[k]) {
      points_[k].target = k;
      configuration_.points.push_back(points_[k]);
      points_[k] = {};
      seen_[k] = false;
    }
  }
}

}  // namespace kdl_calibration
