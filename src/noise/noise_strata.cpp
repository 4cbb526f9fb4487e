#include "noise/noise_strata.hpp"

#include <algorithm>
#include <cmath>

#include "base/dense.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Variances = NoiseParts::Variances;

namespace {

constexpr double kLeastRowWeight = 1e-6;

bool is_stated(const Measurements& measurements, const NoiseModel& noise) {
  const bool every_row = std::all_of(measurements.observations.begin(), measurements.observations.end(),
                                     [](const Observation& o) { return o.sigma > 0.0; });
  return every_row || noise.tracker || !noise.independent.isZero(0.0);
}

bool have_own_noise(const Measurements& measurements) {
  const auto& rows = measurements.observations;
  return std::any_of(rows.begin(), rows.end(), [](const Observation& o) { return o.noise != NoiseFactors(); });
}

// The system for unit noise, orientations included. Single coordinates are in units of their stated sigma, if any.
WhitenedSystem unit_system(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                           const Unknowns& free, const ResidualOptions& options) {
  const bool as_stated = has_single_coordinates(measurements) && is_stated(measurements, options.noise);
  Measurements plain = measurements;
  for (Observation& observation : plain.observations) {
    observation.sigma = as_stated ? observation.sigma : 0.0;
    observation.noise = {};
  }
  ResidualOptions unit;
  if (as_stated) {
    unit.noise = options.noise;
  } else {
    unit.noise.independent.setOnes();
  }
  unit.noise.orientation = 1.0;
  unit.row_weights = options.row_weights;
  std::replace_if(
      unit.row_weights.begin(), unit.row_weights.end(), [](double w) { return !(w > kLeastRowWeight); }, 0.0);
  return LeastSquaresProblem(model, plain, free, unit).whitened(estimate);
}

}  // namespace

void Stratum::add_row(const Eigen::RowVectorXd& row, double residual, double factor) {
  constexpr Index kTogether = 64;
  if (!predicted) {
    predicted = true;
    information = MatrixXd::Zero(row.size(), row.size());
    gradient = VectorXd::Zero(row.size());
    pending.resize(kTogether, row.size());
    factors.resize(kTogether);
  }
  if (count_of_pending == kTogether) {
    add_pending();
  }
  pending.row(count_of_pending) = row;
  factors[count_of_pending++] = factor;
  gradient += factor * residual * row.transpose();
  squares += factor * residual * residual;
}

void Stratum::add_pending() {
  const auto rows = pending.topRows(count_of_pending);
  const MatrixXd weighted = factors.head(count_of_pending).asDiagonal() * rows;
  add_symmetric_product(1.0, kdl_calibration::factor(weighted).transposed(), kdl_calibration::factor(rows).transposed(),
                        information);
  count_of_pending = 0;
}

void Stratum::complete() {
  if (predicted) {
    add_pending();
    information.triangularView<Eigen::StrictlyUpper>() = information.transpose();
    pending.resize(0, 0);
  }
}

NoiseStrata::NoiseStrata(const Measurements& measurements, const ResidualOptions& options, bool by_station)
    : measurements_(measurements),
      options_(options),
      stated_(is_stated(measurements, options.noise)),
      by_station_(by_station || have_own_noise(measurements)) {
  std::map<std::pair<std::int32_t, std::int32_t>, MeasuredCell> cells;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    const Observation& o = measurements.observations[row];
    if (weight(row) > kLeastRowWeight) {
      MeasuredCell& cell = cells[{o.configuration, o.target}];
      cell.target = o.target;
      cell.weight += weight(row);
      cell.mean += weight(row) * o.position();
      cell.rows.push_back(row);
      cell.orientations += has_orientation(o) ? weight(row) : 0.0;
    }
  }
  for (auto& [key, cell] : cells) {
    cell.mean /= cell.weight;
    for (const std::size_t row : cell.rows) {
      const Vector3d own = point_covariance(options.noise, measurements.observations[row]).diagonal();
      cell.known += stated_ ? Vector3d(own * weight(row) / (cell.weight * cell.weight)) : Vector3d(Vector3d::Zero());
    }
    configurations_[key.first].push_back(std::move(cell));
  }
  for (const auto& [c, of_configuration] : configurations_) {
    if (!has_single_coordinates(measurements)) {
      add_repeats(of_configuration);
    }
    several_targets_ = several_targets_ || of_configuration.size() > 1;
  }
}

const Observation& NoiseStrata::first_row(const std::vector<MeasuredCell>& cells) const {
  return measurements_.observations[cells.front().rows.front()];
}

Stratum& NoiseStrata::stratum(std::map<Key, Stratum>& strata, std::array<long, 3> kinds, const Observation& row) const {
  const std::size_t station = by_station_ ? station_of(row) : 0;
  Stratum& result = strata[{kinds[0], kinds[1], kinds[2], static_cast<long>(station)}];
  result.station = station;
  return result;
}

void NoiseStrata::add_means(const ErrorModel& model, const Estimate& estimate, const Unknowns& free) {
  if (has_single_coordinates(measurements_)) {
    const WhitenedSystem system = unit_system(model, measurements_, estimate, free, options_);
    add_coordinates(system);
    add_orientations(system);
    return;
  }
  const PositionPredictor predictor(model, estimate, free);
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, measurements_);
  for (const auto& [c, cells] : configurations_) {
    const std::size_t station = station_of(first_row(cells));
    const std::vector<Matrix3Xd> jacobians = predictor.jacobians(measurements_, c, station);
    const Eigen::Isometry3d X_WF = estimate.frames.base(station) * X_BF[static_cast<std::size_t>(c)];
    Means means;
    for (const MeasuredCell& cell : cells) {
      const auto k = static_cast<std::size_t>(cell.target);
      means.jacobians.push_back(jacobians[k]);
      means.residuals.emplace_back(cell.mean - X_WF * estimate.frames.targets[k].X_FT.translation());
      means.inverse_weight += 1.0 / cell.weight / static_cast<double>(cells.size());
      means.known += cell.known / static_cast<double>(cells.size());
    }
    add_means(means, first_row(cells));
  }
  if (has_orientations(measurements_)) {
    add_orientations(unit_system(model, measurements_, estimate, free, options_));
  }
}

namespace {

// Rows of orientations follow those of the configuration's positions.
Index first_orientation(const std::vector<MeasuredCell>& cells, Index end) {
  return end - 3 * std::count_if(cells.begin(), cells.end(), [](const auto& cell) { return cell.orientations > 0.0; });
}

}  // namespace

void NoiseStrata::add_coordinates(const WhitenedSystem& system) {
  std::size_t block = 0;
  for (const auto& [c, cells] : configurations_) {
    Index row = system.blocks[block++];
    const Index end = first_orientation(cells, system.blocks[block]);
    const Observation& first = first_row(cells);
    Stratum& coordinates = stratum(means_, {-2, 0, 0}, first);
    const double variance = first.noise.length * first.noise.length;
    for (; row < end; ++row) {
      coordinates.add_row(system.jacobian.row(row), system.residual[row], 1.0);
      coordinates.count += 1.0;
      coordinates.coefficients[NoiseParts::kIndependent] += variance;
      coordinates.known += stated_ ? variance : 0.0;
      coordinates.summed += 1.0;
    }
  }
}

// They are multiplied by the root of their weight.
void NoiseStrata::add_orientations(const WhitenedSystem& system) {
  std::size_t block = 0;
  for (const auto& [c, cells] : configurations_) {
    Index row = first_orientation(cells, system.blocks[++block]);
    const Observation& first = first_row(cells);
    for (const MeasuredCell& cell : cells) {
      if (cell.orientations > 0.0) {
        Stratum& orientations = stratum(means_, {-1, 0, 0}, first);
        const double factor = 1.0 / cell.orientations;
        for (Index i = 0; i < 3; ++i, ++row) {
          orientations.add_row(system.jacobian.row(row), system.residual[row], factor);
        }
        orientations.count += 3.0;
        orientations.coefficients[NoiseParts::kOrientation] +=
            factor * first.noise.orientation * first.noise.orientation;
        orientations.summed += 1.0;
      }
    }
  }
}

std::vector<Stratum> NoiseStrata::finished() const {
  std::vector<Stratum> result;
  for (const auto& strata : {means_, deviations_, repeats_}) {
    for (const auto& [key, stratum] : strata) {
      if (stratum.count > 0.0) {
        Stratum& mean = result.emplace_back(stratum);
        mean.coefficients /= mean.summed;
        mean.known /= mean.summed;
        mean.complete();
      }
    }
  }
  return result;
}

Vector3d NoiseStrata::mean_known() const {
  return known_rows_ > 0.0 ? Vector3d(known_sum_ / known_rows_) : Vector3d::Zero();
}

// Deviations from the means over the repeats: their sums over the targets of a repeat, and the rest.
void NoiseStrata::add_repeats(const std::vector<MeasuredCell>& cells) {
  std::map<std::int32_t, std::pair<Vector3d, double>> of_repeat;
  Vector3d squares = Vector3d::Zero();
  Vector3d known = Vector3d::Zero();
  const Observation& first = first_row(cells);
  const double variance = first.noise.length * first.noise.length;
  double freedom = 0.0;
  double rows = 0.0;
  for (const MeasuredCell& cell : cells) {
    freedom += static_cast<double>(cell.rows.size()) - 1.0;
    for (const std::size_t row : cell.rows) {
      const Observation& o = measurements_.observations[row];
      const Vector3d deviation = std::sqrt(weight(row)) * (o.position() - cell.mean);
      squares += deviation.cwiseAbs2();
      auto& [sum, count] = of_repeat.try_emplace(o.repeat, Vector3d::Zero(), 0.0).first->second;
      sum += deviation;
      count += 1.0;
      rows += 1.0;
      known += stated_ ? Vector3d(point_covariance(options_.noise, o).diagonal()) : Vector3d(Vector3d::Zero());
    }
  }
  known_sum_ += known / variance;
  known_rows_ += rows;
  if (!(freedom > 0.0)) {
    return;
  }
  repeat_freedom_ += freedom;
  const double together = rows / static_cast<double>(of_repeat.size());  // targets in a repeat, on average
  const bool separate = together > 1.5;
  several_in_a_repeat_ = several_in_a_repeat_ || separate;
  const double shared_freedom = separate ? std::min(static_cast<double>(of_repeat.size()) - 1.0, freedom) : 0.0;
  Vector3d shared = Vector3d::Zero();
  for (const auto& [repeat, sum] : of_repeat) {
    shared += separate ? Vector3d(sum.first.cwiseAbs2() / sum.second) : Vector3d(Vector3d::Zero());
  }
  for (Index axis = 0; axis < 3; ++axis) {
    const auto add = [&](long kind, double sum, double count, double of_common) {
      Stratum& repeats = stratum(repeats_, {kind, std::lround(together), axis}, first);
      repeats.squares += sum;
      repeats.count += count;
      repeats.coefficients[NoiseParts::kCommon + axis] += of_common;
      repeats.coefficients[NoiseParts::kIndependent + axis] += variance;
      repeats.known += known[axis] / rows;
      repeats.summed += 1.0;
    };
    if (separate) {
      add(0, shared[axis], shared_freedom, together);
      add(1, squares[axis] - shared[axis], freedom - shared_freedom, 0.0);
    } else {
      add(2, squares[axis], freedom, 1.0);
    }
  }
}

void NoiseStrata::add_means(const Means& means, const Observation& row_of_station) {
  const double variance = row_of_station.noise.length * row_of_station.noise.length;
  const auto targets = static_cast<long>(means.residuals.size());
  const auto T = static_cast<double>(targets);
  const long repeats = std::lround(1.0 / means.inverse_weight);
  for (Index axis = 0; axis < 3; ++axis) {
    Stratum& mean = stratum(means_, {targets, repeats, axis}, row_of_station);
    Stratum& deviation = stratum(deviations_, {targets, repeats, axis}, row_of_station);
    Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(means.jacobians.front().cols());
    double residuals = 0.0;
    for (std::size_t t = 0; t < means.residuals.size(); ++t) {
      const Eigen::RowVectorXd row = means.jacobians[t].row(axis);
      if (targets > 1) {
        deviation.add_row(row, means.residuals[t][axis], 1.0);
      }
      sum += row;
      residuals += means.residuals[t][axis];
    }
    if (targets > 1) {
      deviation.add_row(sum, residuals, -1.0 / T);
    }
    mean.add_row(sum, residuals, 1.0 / T);
    mean.count += 1.0;
    deviation.count += T - 1.0;
    mean.coefficients[NoiseParts::kMisfit] += T;
    mean.coefficients[NoiseParts::kCommon + axis] += T * means.inverse_weight;
    for (Stratum* each : {&mean, &deviation}) {
      each->coefficients[NoiseParts::kTargetMisfit] += 1.0;
      each->coefficients[NoiseParts::kIndependent + axis] += variance * means.inverse_weight;
      each->known += means.known[axis];
      each->summed += 1.0;
    }
  }
}

// Which parts are estimated: parts x unknowns.
MatrixXd NoiseStrata::unknown_parts(PartsAsked asked) const {
  constexpr double kFreedomPerAxis = 20.0;
  const NoiseModel& noise = options_.noise;
  const bool instruments = asked != PartsAsked::beside_instruments;
  const bool orientations = has_orientations(measurements_) && asked != PartsAsked::of_repeats && instruments;
  const bool misfits = asked == PartsAsked::all || !instruments;
  const bool repeats = repeat_freedom_ > 0.0;
  const bool by_axis = repeat_freedom_ >= kFreedomPerAxis && instruments;
  std::vector<Variances> columns;
  const auto add = [&](Index first, Index count) {
    Variances& column = columns.emplace_back(Variances::Zero());
    column.segment(first, count).setOnes();
  };
  const auto add_axes = [&](Index first) {
    for (Index axis = 0; axis < (by_axis ? 3 : 0); ++axis) {
      add(first + axis, 1);
    }
    if (!by_axis) {
      add(first, 3);
    }
  };
  if (several_targets_ && misfits) {
    add(NoiseParts::kMisfit, 1);
  }
  if ((repeats || stated_) && misfits) {
    add(NoiseParts::kTargetMisfit, 1);
  }
  if (noise.common.isZero(0.0) && several_in_a_repeat_) {
    add_axes(NoiseParts::kCommon);
  }
  if (!stated_ && instruments) {
    add_axes(NoiseParts::kIndependent);
  }
  if (orientations && !(noise.orientation > 0.0)) {
    add(NoiseParts::kOrientation, 1);
  }
  MatrixXd result(NoiseParts::kCount, static_cast<Index>(columns.size()));
  for (std::size_t i = 0; i < columns.size(); ++i) {
    result.col(static_cast<Index>(i)) = columns[i];
  }
  return result;
}

namespace {

// Largest number of configurations in the sample.
constexpr Eigen::Index kMostStrataConfigurations = 2000;

}  // namespace

NoiseSample sampled(const Measurements& measurements, const ResidualOptions& options) {
  const Index count = measurements.joint_values.cols();
  if (count <= kMostStrataConfigurations) {
    return {.measurements = measurements, .options = options};
  }
  std::vector<bool> chosen(static_cast<std::size_t>(count), false);
  for (Index i = 0; i < kMostStrataConfigurations; ++i) {
    chosen[static_cast<std::size_t>(i * count / kMostStrataConfigurations)] = true;
  }
  const auto keep = [&](const Observation& o) { return chosen[static_cast<std::size_t>(o.configuration)]; };
  NoiseSample sample{.measurements = subset(measurements, keep), .options = options};
  sample.options.row_weights.clear();
  for (std::size_t row = 0; row < options.row_weights.size(); ++row) {
    if (keep(measurements.observations[row])) {
      sample.options.row_weights.push_back(options.row_weights[row]);
    }
  }
  sample.share = static_cast<double>(kMostStrataConfigurations) / static_cast<double>(count);
  return sample;
}

}  // namespace kdl_calibration
