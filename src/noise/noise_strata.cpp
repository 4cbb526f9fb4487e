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

// The system for unit noise, orientations included.
WhitenedSystem unit_system(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                           const Unknowns& free, const ResidualOptions& options) {
  Measurements plain = measurements;
  for (Observation& observation : plain.observations) {
    observation.sigma = 0.0;
  }
  ResidualOptions unit;
  unit.noise.independent.setOnes();
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

NoiseStrata::NoiseStrata(const Measurements& measurements, const ResidualOptions& options)
    : measurements_(measurements), options_(options), stated_(is_stated(measurements, options.noise)) {
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
    add_repeats(of_configuration);
    several_targets_ = several_targets_ || of_configuration.size() > 1;
  }
}

void NoiseStrata::add_means(const ErrorModel& model, const Estimate& estimate, const Unknowns& free) {
  const PositionPredictor predictor(model, estimate, free);
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, measurements_);
  for (const auto& [c, cells] : configurations_) {
    const std::size_t station = station_of(measurements_.observations[cells.front().rows.front()]);
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
    add_means(means);
  }
  if (has_orientations(measurements_)) {
    add_orientations(unit_system(model, measurements_, estimate, free, options_));
  }
}

// Rows of orientations follow those of the configuration's points, multiplied by the root of their weight.
void NoiseStrata::add_orientations(const WhitenedSystem& system) {
  std::size_t block = 0;
  for (const auto& [c, cells] : configurations_) {
    Index row = system.blocks[block++] + 3 * static_cast<Index>(cells.size());
    for (const MeasuredCell& cell : cells) {
      if (cell.orientations > 0.0) {
        Stratum& stratum = means_[{-1, 0, 0}];
        const double factor = 1.0 / cell.orientations;
        for (Index i = 0; i < 3; ++i, ++row) {
          stratum.add_row(system.jacobian.row(row), system.residual[row], factor);
        }
        stratum.count += 3.0;
        stratum.coefficients[NoiseParts::kOrientation] += factor;
        stratum.summed += 1.0;
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
  known_sum_ += known;
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
      Stratum& stratum = repeats_[{kind, std::lround(together), axis}];
      stratum.squares += sum;
      stratum.count += count;
      stratum.coefficients[NoiseParts::kCommon + axis] += of_common;
      stratum.coefficients[NoiseParts::kIndependent + axis] += 1.0;
      stratum.known += known[axis] / rows;
      stratum.summed += 1.0;
    };
    if (separate) {
      add(0, shared[axis], shared_freedom, together);
      add(1, squares[axis] - shared[axis], freedom - shared_freedom, 0.0);
    } else {
      add(2, squares[axis], freedom, 1.0);
    }
  }
}

void NoiseStrata::add_means(const Means& means) {
  const auto targets = static_cast<long>(means.residuals.size());
  const auto T = static_cast<double>(targets);
  const long repeats = std::lround(1.0 / means.inverse_weight);
  for (Index axis = 0; axis < 3; ++axis) {
    Stratum& mean = means_[{targets, repeats, axis}];
    Stratum& deviation = deviations_[{targets, repeats, axis}];
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
    for (Stratum* stratum : {&mean, &deviation}) {
      stratum->coefficients[NoiseParts::kTargetMisfit] += 1.0;
      stratum->coefficients[NoiseParts::kIndependent + axis] += means.inverse_weight;
      stratum->known += means.known[axis];
      stratum->summed += 1.0;
    }
  }
}

// Which parts are estimated: parts x unknowns.
MatrixXd NoiseStrata::unknown_parts(PartsAsked asked) const {
  constexpr double kFreedomPerAxis = 20.0;
  const NoiseModel& noise = options_.noise;
  const bool orientations = has_orientations(measurements_) && asked != PartsAsked::of_repeats;
  const bool misfits = asked == PartsAsked::all;
  const bool repeats = repeat_freedom_ > 0.0;
  const bool by_axis = repeat_freedom_ >= kFreedomPerAxis;
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
  if (!stated_) {
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
