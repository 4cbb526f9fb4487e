#include "noise/noise_parts.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

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
  SampledStrata(const FitProblem& problem, const NoiseModel& stated)
      : sample_(sampled(problem.measurements, with_noise(problem.options.joint.residuals, stated))),
        strata_(sample_.measurements, sample_.options),
        priors_(prior_rows(problem.free, sample_.options)),
        gradient_(sample_.share * priors_.rows.transpose() * priors_.residuals(problem.free.values(problem.start))) {
    strata_.add_means(problem.model, problem.start, problem.free);
    stated_.segment<3>(NoiseParts::kCommon) = stated.common.cwiseAbs2();
    stated_[NoiseParts::kOrientation] = stated.orientation * stated.orientation;
  }

  const NoiseStrata& strata() const { return strata_; }

  VarianceEstimation estimation(PartsAsked asked) const {
    return VarianceEstimation({.strata = strata_.finished(),
                               .unknown = strata_.unknown_parts(asked),
                               .stated = stated_,
                               .priors = MatrixXd(sample_.share * priors_.information()),
                               .prior_gradient = gradient_});
  }

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

}  // namespace

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
