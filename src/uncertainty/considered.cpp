#include "uncertainty/considered.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <map>
#include <numbers>
#include <numeric>
#include <utility>
#include <vector>

#include "estimation/least_squares.hpp"
#include "measurements/stations.hpp"

namespace kdl_calibration {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;

// Rows with the same value, by the value.
template <std::size_t N>
using RowsOf = std::map<std::array<double, N>, std::vector<std::size_t>>;

// Those of several configurations, if they are most of the rows: measured values do not repeat.
template <std::size_t N>
RowsOf<N> stated(const Measurements& measurements, RowsOf<N> rows) {
  const auto configuration = [&](std::size_t row) { return measurements.observations[row].configuration; };
  std::size_t repeated = 0;
  std::erase_if(rows, [&](const auto& entry) {
    const std::vector<std::size_t>& own = entry.second;
    const bool once = std::all_of(own.begin(), own.end(),
                                  [&](std::size_t row) { return configuration(row) == configuration(own.front()); });
    repeated += once ? 0 : own.size();
    return once;
  });
  if (2 * repeated < measurements.observations.size()) {
    rows.clear();
  }
  return rows;
}

using Disturbance = std::function<void(Observation&)>;

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
      disturb(measurements.observations[row]);
    }
    steps_.push_back(unit_covariance_ * (gradient(measurements) - undisturbed_));
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

// The mean measured position of each station. A factor about it leaves the middle of the measured region in place, as
// for everything that the same device measures there.
std::vector<Vector3d> centroids(const Measurements& measurements) {
  std::vector<Vector3d> sums(measurements.stations.size(), Vector3d::Zero());
  std::vector<double> counts(sums.size(), 0.0);
  for (const Observation& row : measurements.observations) {
    sums[station_of(row)] += row.position();
    counts[station_of(row)] += 1.0;
  }
  for (std::size_t station = 0; station < sums.size(); ++station) {
    sums[station] /= std::max(counts[station], 1.0);
  }
  return sums;
}

void make_longer(Observation& row, const Vector3d& about, double scale) {
  row.position() += scale * (row.position() - about);
  if (auto* const distance = std::get_if<Distance>(&row.reading)) {
    distance->length *= 1.0 + scale;
  }
}

}  // namespace

MatrixXd considered_steps(const FitProblem& fit, const MatrixXd& unit_covariance, const AssumedSigmas& sigmas) {
  constexpr std::size_t kMostRows = 20000;  // with more, places are measured
  const std::vector<Observation>& observations = fit.measurements.observations;
  std::vector<std::size_t> all(observations.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  Disturbances result(fit, unit_covariance);
  if (sigmas.scale > 0.0) {
    const std::vector<Vector3d> about = centroids(fit.measurements);
    result.add([&](Observation& row) { make_longer(row, about[station_of(row)], sigmas.scale); }, all);
  }
  if (sigmas.zero > 0.0) {
    result.add(
        [&](Observation& row) {
          if (auto* const distance = std::get_if<Distance>(&row.reading)) {
            distance->length += sigmas.zero;
          }
        },
        all);
  }
  if (!(sigmas.length > 0.0) || observations.size() > kMostRows) {
    return result.steps();
  }
  RowsOf<3> places;  // of sockets, planes or anchors
  RowsOf<1> lengths;
  for (const std::size_t row : all) {
    const Vector3d& place = observations[row].position();
    places[{place.x(), place.y(), place.z()}].push_back(row);
    if (const auto* const distance = std::get_if<Distance>(&observations[row].reading)) {
      lengths[{distance->length}].push_back(row);
    }
  }
  for (const auto& [place, rows] : stated(fit.measurements, std::move(places))) {
    for (int axis = 0; axis < 3; ++axis) {
      result.add([&](Observation& row) { row.position()[axis] += sigmas.length / std::numbers::sqrt2; }, rows);
    }
  }
  for (const auto& [length, rows] : stated(fit.measurements, std::move(lengths))) {
    result.add([&](Observation& row) { std::get<Distance>(row.reading).length += sigmas.length; }, rows);
  }
  return result.steps();
}

}  // namespace kdl_calibration
