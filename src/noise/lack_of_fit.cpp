#include "noise/lack_of_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/decompositions.hpp"
#include "base/distributions.hpp"
#include "measurements/training_rows.hpp"
#include "model/kinematics.hpp"
#include "noise/noise_strata.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

std::vector<double> explained_by_joints(const ErrorModel& model, const Estimate& estimate,
                                        const Measurements& measurements) {
  const Measurements means = averaged(*TrainingRows(measurements));
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, means);
  const std::vector<Observation>& rows = means.observations;
  const auto n = static_cast<Index>(rows.size());
  Eigen::MatrixX3d residuals(n, 3);
  for (Index r = 0; r < n; ++r) {
    const Observation& o = rows[static_cast<std::size_t>(r)];
    residuals.row(r) = measured_minus_predicted(o, estimate, X_BF);
  }
  const double total = residuals.squaredNorm();
  std::vector<double> explained;
  for (Index j = 0; j < means.joint_values.rows(); ++j) {
    MatrixXd terms(n, 3);
    for (Index r = 0; r < n; ++r) {
      const double q = means.joint_values(j, rows[static_cast<std::size_t>(r)].configuration);
      terms.row(r) << 1.0, std::sin(q), std::cos(q);
    }
    const MatrixXd fitted = terms * shortest_solution(terms, MatrixXd(residuals));
    explained.push_back(total > 0.0 ? 1.0 - (residuals - fitted).squaredNorm() / total : 0.0);
  }
  return explained;
}

namespace {

// A variance and the degrees of freedom of its estimate.
struct Scatter {
  double variance = 0.0;
  double freedom = 0.0;
};

// Variances of the common and independent parts, from the repeats only.
class RepeatVariances {
public:
  RepeatVariances(const std::vector<Stratum>& strata, const MatrixXd& parts) : parts_(parts) {
    std::vector<const Stratum*> repeats;
    for (const Stratum& stratum : strata) {
      if (!stratum.predicted) {
        repeats.push_back(&stratum);
      }
    }
    const auto count = static_cast<Index>(repeats.size());
    MatrixXd design(count, parts.cols());
    VectorXd variance(count);
    VectorXd freedom(count);
    for (Index s = 0; s < count; ++s) {
      const Stratum& stratum = *repeats[static_cast<std::size_t>(s)];
      design.row(s) = stratum.coefficients.transpose() * parts;
      variance[s] = stratum.squares / stratum.count;
      freedom[s] = stratum.count;
    }
    VectorXd fitted = VectorXd::Constant(count, variance.mean());
    MatrixXd normal;
    constexpr int kMostRounds = 20;
    for (int round = 0; round < kMostRounds; ++round) {
      const VectorXd weight = freedom.cwiseQuotient(fitted.cwiseAbs2());
      normal = design.transpose() * weight.asDiagonal() * design;
      variances_ = shortest_solution(normal, VectorXd(design.transpose() * weight.cwiseProduct(variance)));
      fitted = (design * variances_).cwiseMax(1e-6 * variance.maxCoeff());
    }
    covariance_ = 2.0 * pseudo_inverse(normal);
  }

  Scatter of(const Stratum& stratum) const {
    const VectorXd coefficients = parts_.transpose() * stratum.coefficients;
    const double variance = coefficients.dot(variances_);
    return {.variance = variance, .freedom = 2.0 * variance * variance / coefficients.dot(covariance_ * coefficients)};
  }

private:
  const MatrixXd& parts_;
  VectorXd variances_;
  MatrixXd covariance_;
};

}  // namespace

std::optional<LackOfFit> test_lack_of_fit(const ErrorModel& model, const Measurements& measurements,
                                          const Estimate& estimate, const Unknowns& free) {
  NoiseSample sample = sampled(*TrainingRows(measurements), {});
  for (Observation& observation : sample.measurements.observations) {
    observation.sigma = 0.0;
  }
  NoiseStrata strata(sample.measurements, sample.options);
  if (!(strata.repeat_freedom() > 0.0)) {
    return std::nullopt;
  }
  strata.add_means(model, estimate, free);
  const std::vector<Stratum> all = strata.finished();
  const MatrixXd parts = strata.unknown_parts(PartsAsked::of_repeats);
  const RepeatVariances repeats(all, parts);
  MatrixXd information = MatrixXd::Zero(free.size(), free.size());
  VectorXd gradient = VectorXd::Zero(free.size());
  std::vector<std::pair<const Stratum*, Scatter>> tested;
  for (const Stratum& stratum : all) {
    const Scatter expected = stratum.is_of_means() ? repeats.of(stratum) : Scatter{};
    if (expected.variance > 0.0) {
      information += stratum.information / expected.variance;
      gradient += stratum.gradient / expected.variance;
      tested.emplace_back(&stratum, expected);
    }
  }
  VectorXd step = gradient;
  MatrixXd C = information;
  if (free.size() > 0) {  // Eigen cannot decompose a matrix without columns
    step = shortest_solution(information, gradient);
    C = pseudo_inverse(information);
  }
  LackOfFit result;
  double sum_of_logarithms = 0.0;
  double tests = 0.0;
  double squares = 0.0;
  for (const auto& [stratum, expected] : tested) {
    const double freedom = stratum->count - C.cwiseProduct(stratum->information).sum() / expected.variance;
    const double left = stratum->squares - 2.0 * step.dot(stratum->gradient) + step.dot(stratum->information * step);
    if (!(freedom > 0.5)) {
      continue;
    }
    const double f = std::max(left, 0.0) / freedom / expected.variance;
    sum_of_logarithms += std::log(std::max(f_upper_tail(f, freedom, expected.freedom), 1e-300));
    tests += 1.0;
    squares += f * freedom;
    result.degrees_of_freedom += freedom;
  }
  if (tests == 0.0) {
    return std::nullopt;
  }
  result.f = squares / result.degrees_of_freedom;
  result.repeat_degrees_of_freedom = 3.0 * strata.repeat_freedom();
  result.p_value = reduced_chi_squared_tail(-sum_of_logarithms / tests, 2.0 * tests);
  return result;
}

}  // namespace kdl_calibration
