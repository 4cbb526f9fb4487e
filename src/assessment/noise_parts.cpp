#include "kdl_calibration/noise_parts.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "assessment/noise_strata.hpp"
#include "base/f_distribution.hpp"
#include "kdl_calibration/input_check.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Variances = NoiseParts::Variances;

// x >= 0 that minimises sum w (z - C x)^2 (Lawson and Hanson 1974, chapter 23), for a few unknowns.
VectorXd nonnegative_least_squares(const MatrixXd& C, const VectorXd& z, const VectorXd& w) {
  const MatrixXd normal = C.transpose() * w.asDiagonal() * C;
  const VectorXd right = C.transpose() * w.cwiseProduct(z);
  const Index n = C.cols();
  VectorXd x = VectorXd::Zero(n);
  std::vector<bool> active(static_cast<std::size_t>(n), false);
  const double small = 1e-12 * right.cwiseAbs().maxCoeff();
  for (Index round = 0; round < 3 * n; ++round) {
    const VectorXd slope = right - normal * x;
    Index best = -1;
    for (Index i = 0; i < n; ++i) {
      if (!active[static_cast<std::size_t>(i)] && slope[i] > small && (best < 0 || slope[i] > slope[best])) {
        best = i;
      }
    }
    if (best < 0) {
      break;
    }
    active[static_cast<std::size_t>(best)] = true;
    for (;;) {
      std::vector<Index> chosen;
      for (Index i = 0; i < n; ++i) {
        if (active[static_cast<std::size_t>(i)]) {
          chosen.push_back(i);
        }
      }
      const MatrixXd part = normal(chosen, chosen);
      const VectorXd solution = part.completeOrthogonalDecomposition().solve(VectorXd(right(chosen)));
      if (solution.minCoeff() > 0.0) {
        x.setZero();
        x(chosen) = solution;
        break;
      }
      double step = 1.0;
      for (std::size_t i = 0; i < chosen.size(); ++i) {
        const auto s = static_cast<Index>(i);
        if (solution[s] <= 0.0) {
          step = std::min(step, x[chosen[i]] / (x[chosen[i]] - solution[s]));
        }
      }
      for (std::size_t i = 0; i < chosen.size(); ++i) {
        double& value = x[chosen[i]];
        value += step * (solution[static_cast<Index>(i)] - value);
        if (!(value > 1e-15 * solution.cwiseAbs().maxCoeff())) {
          value = 0.0;
          active[static_cast<std::size_t>(chosen[i])] = false;
        }
      }
      if (std::none_of(active.begin(), active.end(), [](bool a) { return a; })) {
        break;
      }
    }
  }
  return x;
}

// Patterson and Thompson's equations: of each stratum the residual squares at the weighted solution have the
// expectation lambda (count - trace), trace = tr(C information) / lambda. For these traces the variances are the
// maximum of a gamma likelihood, found by weighted least squares; then the solution is found anew.
class Reml {
public:
  Reml(std::vector<Stratum> strata, MatrixXd unknown, const Variances& stated, MatrixXd priors, VectorXd prior_gradient)
      : strata_(std::move(strata)),
        unknown_(std::move(unknown)),
        priors_(std::move(priors)),
        prior_gradient_(std::move(prior_gradient)) {
    const auto count = static_cast<Index>(strata_.size());
    design_.resize(count, unknown_.cols());
    known_.resize(count);
    for (Index s = 0; s < count; ++s) {
      const Stratum& stratum = strata_[static_cast<std::size_t>(s)];
      design_.row(s) = stratum.coefficients.transpose() * unknown_;
      known_[s] = stratum.known + stratum.coefficients.dot(stated);
    }
  }

  Index unknowns() const { return unknown_.cols(); }

  bool run() {
    constexpr int kRounds = 300;
    constexpr double kSettled = 1e-7;
    double squares = 0.0;
    double count = 0.0;
    for (const Stratum& stratum : strata_) {
      squares += stratum.squares;
      count += stratum.count;
    }
    if (!(squares > 0.0)) {
      return false;
    }
    x_ = VectorXd::Zero(unknown_.cols());
    floor_ = kLeastShare * squares / count;
    lambda_ = x_.size() > 0 ? VectorXd::Constant(known_.size(), squares / count) : VectorXd(known_.cwiseMax(floor_));
    for (int round = 0; round < kRounds; ++round) {
      solve();
      const VectorXd before = lambda_;
      fit_gamma();
      if (!lambda_.allFinite()) {
        return false;
      }
      if ((lambda_ - before).cwiseQuotient(before).cwiseAbs().maxCoeff() < kSettled) {
        solve();
        return true;
      }
    }
    return true;
  }

  /// How probable squares of the means as large as theirs, or larger, are of these variances.
  double tail_of_means() const {
    double ratio = 0.0;
    double freedom = 0.0;
    for (std::size_t i = 0; i < strata_.size(); ++i) {
      if (is_of_means(strata_[i])) {
        const auto s = static_cast<Index>(i);
        ratio += squares_[s] / lambda_[s];
        freedom += freedom_[s];
      }
    }
    return freedom > 0.0 ? reduced_chi_squared_tail(ratio / freedom, freedom) : 1.0;
  }

  NoiseParts parts(const Variances& stated) const {
    NoiseParts result;
    result.variances = stated + unknown_ * x_;
    const VectorXd weight = freedom_.cwiseQuotient(lambda_.cwiseAbs2());
    std::vector<Index> positive;
    for (Index i = 0; i < x_.size(); ++i) {
      if (x_[i] > 0.0) {
        positive.push_back(i);
      }
    }
    if (!positive.empty()) {
      const MatrixXd design = design_(Eigen::all, positive);
      const MatrixXd fisher = 0.5 * design.transpose() * weight.asDiagonal() * design;
      const MatrixXd expand = unknown_(Eigen::all, positive);
      result.covariance = expand * fisher.completeOrthogonalDecomposition().pseudoInverse() * expand.transpose();
    }
    result.sensitivity.resize(static_cast<std::size_t>(NoiseParts::kCount));
    for (Index k = 0; k < NoiseParts::kCount; ++k) {
      result.estimated[static_cast<std::size_t>(k)] = unknown_.row(k).maxCoeff() > 0.0;
      if (!result.estimated[static_cast<std::size_t>(k)]) {
        continue;
      }
      MatrixXd& sum = result.sensitivity[static_cast<std::size_t>(k)];
      sum = MatrixXd::Zero(priors_.rows(), priors_.cols());
      for (std::size_t s = 0; s < strata_.size(); ++s) {
        if (strata_[s].information.size() > 0 && strata_[s].coefficients[k] != 0.0) {
          const double lambda = lambda_[static_cast<Index>(s)];
          sum += strata_[s].coefficients[k] / (lambda * lambda) * strata_[s].information;
        }
      }
    }
    for (std::size_t s = 0; s < strata_.size(); ++s) {
      result.degrees_of_freedom += is_of_means(strata_[s]) ? freedom_[static_cast<Index>(s)] : 0.0;
    }
    return result;
  }

private:
  static constexpr double kLeastShare = 1e-14;

  // Of positions that parameters move.
  static bool is_of_means(const Stratum& stratum) {
    return stratum.information.size() > 0 && stratum.coefficients[NoiseParts::kOrientation] == 0.0;
  }

  // The solution at these variances: what is left of the squares, and the degrees of freedom of each stratum.
  void solve() {
    MatrixXd M = priors_;
    VectorXd g = prior_gradient_;
    for (std::size_t s = 0; s < strata_.size(); ++s) {
      if (strata_[s].information.size() > 0) {
        M += strata_[s].information / lambda_[static_cast<Index>(s)];
        g += strata_[s].gradient / lambda_[static_cast<Index>(s)];
      }
    }
    const VectorXd scale = M.diagonal().unaryExpr([](double d) { return d > 0.0 ? 1.0 / std::sqrt(d) : 0.0; });
    MatrixXd scaled = scale.asDiagonal() * M * scale.asDiagonal();
    scaled.diagonal().array() += 1e-12;
    const Eigen::LDLT<MatrixXd> factor(scaled);
    const MatrixXd inverse = factor.solve(MatrixXd::Identity(M.rows(), M.cols()));
    const MatrixXd C = scale.asDiagonal() * inverse * scale.asDiagonal();
    const VectorXd step = C * g;
    freedom_.resize(known_.size());
    squares_.resize(known_.size());
    for (std::size_t i = 0; i < strata_.size(); ++i) {
      const auto s = static_cast<Index>(i);
      const Stratum& stratum = strata_[i];
      freedom_[s] = stratum.count;
      squares_[s] = stratum.squares;
      if (stratum.information.size() > 0) {
        freedom_[s] -= C.cwiseProduct(stratum.information).sum() / lambda_[s];
        squares_[s] += step.dot(stratum.information * step) - 2.0 * step.dot(stratum.gradient);
      }
      freedom_[s] = std::max(freedom_[s], 0.0);
      squares_[s] = std::max(squares_[s], 0.0);
    }
  }

  void fit_gamma() {
    constexpr int kRounds = 50;
    const VectorXd z = squares_.array() / freedom_.array().max(1e-9);
    for (int round = 0; round < kRounds && x_.size() > 0; ++round) {
      const VectorXd w = freedom_.cwiseQuotient(lambda_.cwiseAbs2());
      x_ = nonnegative_least_squares(design_, z - known_, w * lambda_.squaredNorm());
      const VectorXd next = (known_ + design_ * x_).cwiseMax(floor_);
      const bool settled = (next - lambda_).cwiseQuotient(lambda_).cwiseAbs().maxCoeff() < 1e-10;
      lambda_ = next;
      if (settled) {
        break;
      }
    }
  }

  std::vector<Stratum> strata_;
  MatrixXd unknown_;
  MatrixXd priors_;
  VectorXd prior_gradient_;
  MatrixXd design_;
  VectorXd known_;
  VectorXd lambda_;
  VectorXd freedom_;
  VectorXd squares_;
  VectorXd x_;
  double floor_ = 0.0;
};

}  // namespace

NoiseModel NoiseParts::model(const NoiseModel& stated) const {
  NoiseModel result = stated;
  const auto sigma = [&](Index k) { return std::sqrt(variances[k]); };
  result.misfit = sigma(kMisfit);
  result.target_misfit = sigma(kTargetMisfit);
  if (estimated[kCommon]) {
    result.common = variances.segment<3>(kCommon).cwiseSqrt();
  }
  if (estimated[kIndependent]) {  // without any of its own a point would be known by the others of its repeat
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
  return variance > 0.0 ? 2.0 * value * value / variance : std::numeric_limits<double>::infinity();
}

double NoiseParts::freedom_of_point() const {
  Variances gradient = Variances::Ones();
  gradient[kMisfit] = gradient[kTargetMisfit] = 3.0;
  gradient[kOrientation] = 0.0;
  return freedom(point().trace(), gradient);
}

NoiseParts estimate_noise(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                          const Unknowns& free, const ResidualOptions& options) {
  check(measurements, model);
  check(estimate, model, measurements);
  check(free, model, measurements);
  check(options, measurements);
  constexpr double kSeen = 0.05;  // p of the means' residuals from which on what is stated for points says it all
  const NoiseSample sample = sampled(measurements, options);
  NoiseStrata strata(sample.measurements, sample.options);
  strata.add_means(model, estimate, free);

  Variances stated = Variances::Zero();
  stated.segment<3>(NoiseParts::kCommon) = options.noise.common.cwiseAbs2();
  stated[NoiseParts::kOrientation] = options.noise.orientation * options.noise.orientation;

  const VectorXd information = sample.share * free.prior_information(options.priors);
  VectorXd gradient(free.size());
  for (Index c = 0; c < free.size(); ++c) {
    gradient[c] = -information[c] * Unknowns::value(estimate, free.columns()[static_cast<std::size_t>(c)]);
  }
  const auto with = [&](PartsAsked asked) {
    return Reml(strata.finished(), strata.unknown_parts(asked), stated, information.asDiagonal(), gradient);
  };
  Reml reml = with(PartsAsked::all);
  if (strata.stated()) {
    Reml without_misfits = with(PartsAsked::without_misfits);
    if (without_misfits.run() && without_misfits.tail_of_means() >= kSeen) {
      reml = std::move(without_misfits);
    }
  }
  if (reml.unknowns() == 0 || !reml.run()) {
    return {};
  }
  NoiseParts parts = reml.parts(stated);
  if (strata.stated()) {
    parts.variances.segment<3>(NoiseParts::kIndependent) = strata.mean_known();
  }
  parts.covariance *= sample.share;
  parts.degrees_of_freedom /= sample.share;
  for (MatrixXd& sensitivity : parts.sensitivity) {
    sensitivity /= sample.share;
  }
  parts.converged = true;
  return parts;
}

}  // namespace kdl_calibration
