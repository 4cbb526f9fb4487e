#include "uncertainty/considered.hpp"

#include <Eigen/Dense>
#include <cstddef>
#include <functional>
#include <numbers>
#include <numeric>
#include <vector>

#include "estimation/least_squares.hpp"
#include "estimation/prediction.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"

namespace kdl_calibration {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;

using Disturbance = std::function<void(Observation& o, std::size_t row)>;

// Adds errors of `rows`.
class Disturbances {
public:
  Disturbances(const FitProblem& fit, const MatrixXd& unit_covariance)
      : fit_(fit), unit_covariance_(unit_covariance.array().isFinite().select(unit_covariance, 0.0)) {
    undisturbed_ = gradient(fit.measurements);
  }

  void add(const Disturbance& disturb, const std::vector<std::size_t>& rows) {
    Measurements measurements = fit_.measurements;
    for (const std::size_t row : rows) {
      disturb(measurements.observations[row], row);
    }
    steps_.emplace_back(unit_covariance_ * (gradient(measurements) - undisturbed_));
  }

  MatrixXd steps() const {
    MatrixXd result(fit_.free.size(), std::ssize(steps_));
    for (std::size_t i = 0; i < steps_.size(); ++i) {
      result.col(static_cast<Eigen::Index>(i)) = steps_[i];
    }
    return result;
  }

private:
  Eigen::VectorXd gradient(const Measurements& measurements) const {
    return LeastSquaresProblem(fit_.model, measurements, fit_.free, fit_.options.joint.residuals)
        .linearise(fit_.start)
        .gradient;
  }

  const FitProblem& fit_;
  MatrixXd unit_covariance_;  // zero for what is not determined
  Eigen::VectorXd undisturbed_;
  std::vector<Eigen::VectorXd> steps_;
};

// A row's point as predicted, and from the middle of those of its station. A factor about the middle leaves it in
// place, as for everything that the same device measures there.
struct PredictedRow {
  Vector3d point;
  Vector3d from_middle;
};

std::vector<PredictedRow> predicted_rows(const FitProblem& fit) {
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(fit.model, fit.start, fit.measurements);
  std::vector<PredictedRow> result;
  std::vector<Vector3d> sums(fit.measurements.stations.size(), Vector3d::Zero());
  std::vector<double> counts(sums.size(), 0.0);
  for (const Observation& row : fit.measurements.observations) {
    result.push_back({.point = predicted_point(fit.start, X_BF, row), .from_middle = {}});
    sums[station_of(row)] += result.back().point;
    counts[station_of(row)] += 1.0;
  }
  for (std::size_t row = 0; row < result.size(); ++row) {
    const std::size_t station = station_of(fit.measurements.observations[row]);
    result[row].from_middle = result[row].point - sums[station] / counts[station];
  }
  return result;
}

// Moves the measured point, along what is measured of it.
void move(Observation& row, const Vector3d& point, const Vector3d& step) {
  if (auto* const distance = std::get_if<Distance>(&row.reading)) {
    distance->length += (point - distance->anchor).stableNormalized().dot(step);
  } else {
    row.position() += step;
  }
}

}  // namespace

MatrixXd considered_steps(const FitProblem& fit, const MatrixXd& unit_covariance, const AssumedSigmas& sigmas) {
  constexpr std::size_t kMostRows = 20000;  // with more, places are measured
  std::vector<std::size_t> all(fit.measurements.observations.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  Disturbances result(fit, unit_covariance);
  if (sigmas.scale > 0.0) {
    const std::vector<PredictedRow> predicted = predicted_rows(fit);
    result.add([&](Observation& o,
                   std::size_t row) { move(o, predicted[row].point, sigmas.scale * predicted[row].from_middle); },
               all);
  }
  if (sigmas.zero > 0.0) {
    result.add(
        [&](Observation& o, std::size_t /*row*/) {
          if (auto* const distance = std::get_if<Distance>(&o.reading)) {
            distance->length += sigmas.zero;
          }
        },
        all);
  }
  if (!(sigmas.length > 0.0) || all.size() > kMostRows) {
    return result.steps();
  }
  for (const auto& [place, rows] : rows_of_stated_places(fit.measurements)) {
    for (int axis = 0; axis < 3; ++axis) {
      result.add(
          [&](Observation& o, std::size_t /*row*/) { o.position()[axis] += sigmas.length / std::numbers::sqrt2; },
          rows);
    }
  }
  for (const auto& [length, rows] : rows_of_stated_distances(fit.measurements)) {
    result.add([&](Observation& o, std::size_t /*row*/) { std::get<Distance>(o.reading).length += sigmas.length; },
               rows);
  }
  return result.steps();
}

}  // namespace kdl_calibration
