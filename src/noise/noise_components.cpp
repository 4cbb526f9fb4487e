#include "noise/noise_components.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "measurements/measurements_check.hpp"
#include "measurements/readings.hpp"
#include "measurements/training_rows.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {

using Eigen::Vector3d;

namespace {

// Scatter of the measured orientations about their mean.
void add_orientation_scatter(const Measurements& measurements, RepeatNoise& noise) {
  if (!has_orientations(measurements)) {
    return;
  }
  std::map<std::pair<std::int32_t, std::int32_t>, std::pair<Orientation, int>> cells;
  const Measurements means = averaged(measurements);
  for (const Observation& o : means.observations) {
    if (has_orientation(o)) {
      cells[{o.configuration, o.target}] = {*o.orientation(), 0};
    }
  }
  double squares = 0.0;
  for (const Observation& o : measurements.observations) {
    if (has_orientation(o)) {
      auto& [mean, count] = cells[{o.configuration, o.target}];
      squares += rotation_log((mean.conjugate() * *o.orientation()).toRotationMatrix()).squaredNorm();
      noise.orientation_degrees_of_freedom += ++count > 1 ? 1.0 : 0.0;
    }
  }
  if (noise.orientation_degrees_of_freedom > 0.0) {
    noise.orientation = std::sqrt(squares / (3.0 * noise.orientation_degrees_of_freedom));
  }
}

// Deviation of each repeat from the mean over the repeats.
using RepeatDeviations = std::map<std::int32_t, Vector3d>;

// Subtracts the mean; returns the sum of the squared deviations along each axis.
Vector3d centre(RepeatDeviations& repeats) {
  Vector3d mean = Vector3d::Zero();
  for (const auto& [repeat, position] : repeats) {
    mean += position / static_cast<double>(repeats.size());
  }
  Vector3d squares = Vector3d::Zero();
  for (auto& [repeat, position] : repeats) {
    position -= mean;
    squares += position.cwiseAbs2();
  }
  return squares;
}

// Sums of products of two targets' deviations in the same repeats.
struct Products {
  Vector3d sum = Vector3d::Zero();
  double freedom = 0.0;

  void add(const RepeatDeviations& first, const RepeatDeviations& second) {
    double common = 0.0;
    for (const auto& [repeat, deviation] : first) {
      if (const auto other = second.find(repeat); other != second.end()) {
        sum += deviation.cwiseProduct(other->second);
        common += 1.0;
      }
    }
    freedom += std::max(common - 1.0, 0.0);
  }
};

}  // namespace

RepeatNoise noise_from_repeats(const Measurements& measurements) {
  const TrainingRows training(measurements);
  const auto& rows = (*training).observations;
  const auto other_repeat = [&](const Observation& o) { return o.repeat != rows.front().repeat; };
  if (has_single_coordinates(measurements) || std::none_of(rows.begin(), rows.end(), other_repeat)) {
    return {};
  }
  std::map<std::int32_t, std::map<std::int32_t, RepeatDeviations>> cells;  // indexed by configuration and target
  for (const Observation& o : rows) {
    cells[o.configuration][o.target][o.repeat] = o.position();
  }
  RepeatNoise noise;
  Vector3d squares = Vector3d::Zero();
  Products products;
  for (auto& [configuration, targets] : cells) {
    for (auto& [target, repeats] : targets) {
      squares += centre(repeats);
      noise.degrees_of_freedom += static_cast<double>(repeats.size()) - 1.0;
    }
    for (auto first = targets.begin(); first != targets.end(); ++first) {
      for (auto second = std::next(first); second != targets.end(); ++second) {
        products.add(first->second, second->second);
      }
    }
  }
  if (noise.degrees_of_freedom == 0.0) {
    return noise;
  }
  const Vector3d variance = squares / noise.degrees_of_freedom;
  noise.total = variance.cwiseSqrt();
  noise.separable = products.freedom > 0.0;
  Vector3d shared = Vector3d::Zero();
  if (noise.separable) {
    shared = (products.sum / products.freedom).cwiseMax(0.0).cwiseMin(variance);
  }
  noise.common = shared.cwiseSqrt();
  noise.independent = (variance - shared).cwiseSqrt();
  add_orientation_scatter(*training, noise);
  return noise;
}

double ResidualNoise::total() const { return std::hypot(independent, common); }

ResidualNoise noise_from_residuals(const WhitenedSummary& summary, int rank, double unit_weight) {
  const double squares = summary.squares;
  const double products = (summary.squares_of_sums - squares) / 2.0;
  const double pairs = summary.pairs;
  const auto coordinates = static_cast<double>(summary.measured_rows);
  ResidualNoise noise;
  noise.degrees_of_freedom = coordinates - rank;
  if (noise.degrees_of_freedom <= 0.0) {
    return noise;
  }
  const double lost = coordinates / noise.degrees_of_freedom / unit_weight;
  const double variance = squares / coordinates * lost;
  const double shared = pairs > 0.0 ? std::clamp(products / pairs * lost, 0.0, variance) : 0.0;
  noise.common = std::sqrt(shared);
  noise.independent = std::sqrt(variance - shared);
  return noise;
}

}  // namespace kdl_calibration
