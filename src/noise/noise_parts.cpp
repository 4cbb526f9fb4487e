#include "noise/noise_parts.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "base/distributions.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "noise/variance_estimation.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Variances = NoiseParts::Variances;

NoiseModel NoiseParts::model(const NoiseModel& stated) const {
  NoiseModel result = stated;
  const auto sigma = [&](Index k) { return std::sqrt(variances[k]); };
  result.misfit = sigma(kMisfit);
  result.target_misfit = sigma(kTargetMisfit);
  if (estimated[kCommon]) {
    result.common = variances.segment<3>(kCommon).cwiseSqrt();
  }
  if (estimated[kIndependent]) {  // at zero, the other points of a repeat would determine a point
    constexpr double kLeastShare = 1e-6;
    const double least = kLeastShare * point().trace() / 3.0;
    result.independent = variances.segment<3>(kIndependent).cwiseMax(least).cwiseSqrt();
  }
  if (estimated[kOrientation]) {
    result.orientation = sigma(kOrientation);
  }
  return result;
}

Matrix3d NoiseParts::point() const {
  const Vector3d own = variances.segment<3>(kCommon) + variances.segment<3>(kIndependent);
  return Vector3d(own.array() + variances[kMisfit] + variances[kTargetMisfit]).asDiagonal();
}

double NoiseParts::freedom(double value, const Variances& gradient) const {
  const double variance = gradient.dot(covariance * gradient);
  return variance > 0.0 ? std::min(2.0 * value * value / variance, residual_degrees_of_freedom)
                        : std::numeric_limits<double>::infinity();
}

double NoiseParts::freedom_of_point() const {
  Variances gradient = Variances::Ones();
  gradient[kMisfit] = gradient[kTargetMisfit] = 3.0;
  gradient[kOrientation] = 0.0;
  return freedom(point().trace(), gradient);
}

namespace {

// The strata of a fit and the parts to estimate.
class SampledStrata {
public:
  SampledStrata(const FitProblem& problem, const NoiseModel& stated, bool by_station = false)
      : sample_(sampled(problem.measurements, with_noise(problem.options.joint.residuals, stated))),
        strata_(sample_.measurements, sample_.options, by_station),
        priors_(prior_rows(problem.free, sample_.options)),
        gradient_(sample_.share * priors_.rows.transpose() * priors_.residuals(problem.free.values(problem.start))) {
    strata_.add_means(problem.model, problem.start, problem.free);
    stated_.segment<3>(NoiseParts::kCommon) = stated.common.cwiseAbs2();
    stated_[NoiseParts::kOrientation] = stated.orientation * stated.orientation;
  }

  const NoiseStrata& strata() const { return strata_; }

  VarianceTask task(PartsAsked asked) const {
    return {.strata = strata_.finished(),
            .unknown = strata_.unknown_parts(asked),
            .stated = stated_,
            .priors = MatrixXd(sample_.share * priors_.information()),
            .prior_gradient = gradient_};
  }
  VarianceEstimation estimation(PartsAsked asked) const { return VarianceEstimation(task(asked)); }

  // The parts scaled from the sample to all configurations.
  NoiseParts whole(NoiseParts parts) const {
    if (strata_.stated()) {
      parts.variances.segment<3>(NoiseParts::kIndependent) = strata_.mean_known();
    }
    parts.covariance *= sample_.share;
    parts.degrees_of_freedom /= sample_.share;
    parts.residual_degrees_of_freedom /= sample_.share;
    parts.scatter /= sample_.share;
    for (MatrixXd& sensitivity : parts.sensitivity) {
      sensitivity /= sample_.share;
    }
    parts.converged = true;
    return parts;
  }

private:
  static ResidualOptions with_noise(ResidualOptions options, const NoiseModel& noise) {
    options.noise = noise;
    return options;
  }

  NoiseSample sample_;
  NoiseStrata strata_;
  PriorRows priors_;
  VectorXd gradient_;
  Variances stated_ = Variances::Zero();
};

// The variances behind the present weights; stated point noise is averaged over the rows.
Variances variances_of(const ResidualOptions& weights, const NoiseStrata& strata) {
  const NoiseModel& noise = weights.noise;
  Variances result = Variances::Zero();
  result[NoiseParts::kMisfit] = noise.misfit * noise.misfit;
  result[NoiseParts::kTargetMisfit] = noise.target_misfit * noise.target_misfit;
  result.segment<3>(NoiseParts::kCommon) = noise.common.cwiseAbs2();
  Vector3d point = strata.mean_known();
  if (!strata.stated()) {
    point = noise.independent.isZero(0.0) ? Vector3d(Vector3d::Ones()) : Vector3d(noise.independent.cwiseAbs2());
    result.segment<3>(NoiseParts::kIndependent) = point;
  }
  result[NoiseParts::kOrientation] = 1.0 / orientation_information(weights, 1.0 / point.mean());
  return result;
}

// The variances of the stations' instruments, of positions or of orientations, as factors on the strata: strata x
// columns. Stations whose own rows hardly tell a variance share the first one.
struct InstrumentColumns {
  MatrixXd columns;
  std::map<std::size_t, Index> column_of;  // of the stations with such rows
};

constexpr double kLeastFreedom = 6.0;  // that tells the variance of a station

// `freedom`: of the strata with one variance for all; empty: one column for all.
InstrumentColumns instrument_columns(const VarianceTask& task, bool of_orientations, const VectorXd& freedom) {
  const double stated = task.stated[NoiseParts::kOrientation];
  const auto count = static_cast<Index>(task.strata.size());
  std::map<std::size_t, std::pair<VectorXd, double>> stations;  // factors on the strata, degrees of freedom
  for (Index s = 0; s < count; ++s) {
    const Stratum& stratum = task.strata[static_cast<std::size_t>(s)];
    if (stratum.is_of_orientations() == of_orientations) {
      auto& [factors, own] = stations.try_emplace(stratum.station, VectorXd::Zero(count), 0.0).first->second;
      const double variance = stated > 0.0 ? stated : 1.0;
      factors[s] =
          of_orientations ? variance * stratum.coefficients[NoiseParts::kOrientation] : stratum.of_instrument();
      own += freedom.size() > 0 ? freedom[s] : 0.0;
    }
  }
  const auto tells = [](const auto& station) { return station.second.second >= kLeastFreedom; };
  const auto first = std::find_if(stations.begin(), stations.end(), tells);
  InstrumentColumns result{.columns = MatrixXd::Zero(count, stations.empty() ? 0 : 1), .column_of = {}};
  for (auto station = stations.begin(); station != stations.end(); ++station) {
    Index column = 0;
    if (tells(*station) && station != first) {
      column = result.columns.cols();
      result.columns.conservativeResize(count, column + 1);
      result.columns.col(column).setZero();
    }
    result.columns.col(column) += station->second.first;
    result.column_of[station->first] = column;
  }
  return result;
}

// Factors on sigma of these variances: of stated noise, or relative to the smallest one.
VectorXd factors_of(const VectorXd& variances, bool stated) {
  constexpr double kLeastShare = 1e-4;  // of the largest variance: misfits explain the rest
  if (stated) {
    return (1.0 + variances.array()).sqrt();
  }
  const VectorXd least = variances.cwiseMax(kLeastShare * variances.maxCoeff());
  return (least / least.minCoeff()).cwiseSqrt();
}

MatrixXd side_by_side(const MatrixXd& left, const MatrixXd& right) {
  MatrixXd result(left.rows(), left.cols() + right.cols());
  result << left, right;
  return result;
}

}  // namespace

std::vector<NoiseFactors> noise_by_station(const FitProblem& fit, const NoiseModel& stated) {
  constexpr double kPValueOfStations = 1e-3;
  constexpr std::size_t kMostOfOwnNoise = 10;  // with more, each has few rows, and strata take much memory
  const std::size_t stations = fit.measurements.stations.size();
  if (stations < 2 || stations > kMostOfOwnNoise) {
    return {};
  }
  Measurements alike = fit.measurements;
  for (Observation& observation : alike.observations) {
    observation.noise = {};
  }
  const TrainingProblem training(with_measurements(fit, alike));
  const SampledStrata sample(*training, stated, true);
  VarianceTask task = sample.task(PartsAsked::beside_instruments);
  task.further = side_by_side(instrument_columns(task, false, {}).columns, instrument_columns(task, true, {}).columns);
  VarianceEstimation one(task);
  if (!one.maximise()) {
    return {};
  }
  const InstrumentColumns positions = instrument_columns(task, false, one.freedom());
  const InstrumentColumns orientations = instrument_columns(task, true, one.freedom());
  const auto freedom =
      static_cast<double>(positions.columns.cols() + orientations.columns.cols() - task.further.cols());
  task.further = side_by_side(positions.columns, orientations.columns);
  const MatrixXd is_of = (task.further.array() > 0.0).cast<double>();
  VarianceEstimation each(std::move(task));
  // The errors of the arm may follow the few rows of a station, which then seem exact.
  if (freedom < 1.0 || !each.maximise() || (is_of.transpose() * each.freedom()).minCoeff() < kLeastFreedom ||
      reduced_chi_squared_tail((one.minus_two_log() - each.minus_two_log()) / freedom, freedom) > kPValueOfStations) {
    return {};
  }
  std::vector<NoiseFactors> result(stations);
  const VectorXd lengths = factors_of(each.further().head(positions.columns.cols()), sample.strata().stated());
  for (const auto& [station, column] : positions.column_of) {
    result[station].length = static_cast<float>(lengths[column]);
  }
  if (!orientations.column_of.empty()) {
    const VectorXd angles = factors_of(each.further().tail(orientations.columns.cols()), stated.orientation > 0.0);
    for (const auto& [station, column] : orientations.column_of) {
      result[station].orientation = static_cast<float>(angles[column]);
    }
  }
  return result;
}

NoiseParts estimate_noise(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                          const Unknowns& free, const ResidualOptions& options) {
  // With at least this p-value the stated noise explains the residuals of the means, and no misfit is estimated.
  constexpr double kPValueOfStatedNoise = 0.05;
  const TrainingProblem training({.model = model,
                                  .measurements = measurements,
                                  .start = estimate,
                                  .free = free,
                                  .options = {.joint = {.residuals = options}}});
  const SampledStrata sample(*training, options.noise);
  VarianceEstimation estimation = sample.estimation(PartsAsked::all);
  if (sample.strata().stated()) {
    VarianceEstimation without_misfits = sample.estimation(PartsAsked::without_misfits);
    if (without_misfits.maximise() && without_misfits.tail_of_means() >= kPValueOfStatedNoise) {
      estimation = std::move(without_misfits);
    }
  }
  if (estimation.unknowns() == 0 || !estimation.maximise()) {
    return {};
  }
  return sample.whole(estimation.parts());
}

NoiseParts noise_beside_weights(const FitProblem& fit, const NoiseModel& stated, bool misfits) {
  const SampledStrata sample(*TrainingProblem(fit), stated);
  VarianceEstimation estimation = sample.estimation(misfits ? PartsAsked::all : PartsAsked::without_misfits);
  if (estimation.unknowns() == 0 || !estimation.match(variances_of(fit.options.joint.residuals, sample.strata()))) {
    return {};
  }
  return sample.whole(estimation.parts());
}

}  // namespace kdl_calibration
