#include "noise/variance_estimation.hpp"

#include <Eigen/Dense>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/decompositions.hpp"
#include "base/dense.hpp"
#include "base/distributions.hpp"
#include "estimation/linear_system.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Variances = NoiseParts::Variances;

namespace {

constexpr double kUsedUp = 0.5;       // degrees of freedom: a part with fewer stays zero, its likelihood is flat
constexpr double kLeastShare = 1e-8;  // of a stratum's variance relative to its kind: less is rounding

// Moves to the solution of the active unknowns, but only until the first of them becomes zero. Returns whether the full
// step was taken.
bool go_to_active(const MatrixXd& normal, const VectorXd& right, std::vector<bool>& active, VectorXd& x) {
  std::vector<Index> chosen;
  for (Index i = 0; i < x.size(); ++i) {
    if (active[static_cast<std::size_t>(i)]) {
      chosen.push_back(i);
    }
  }
  const MatrixXd part = normal(chosen, chosen);
  const VectorXd solution = shortest_solution(part, VectorXd(right(chosen)));
  double step = 1.0;
  Index first = -1;
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    const double there = solution[static_cast<Index>(i)];
    const double here = x[chosen[i]];
    if (there <= 0.0 && (first < 0 || here / (here - there) < step)) {
      step = here > there ? here / (here - there) : 0.0;
      first = chosen[i];
    }
  }
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    x[chosen[i]] += step * (solution[static_cast<Index>(i)] - x[chosen[i]]);
  }
  if (first >= 0) {
    x[first] = 0.0;
    active[static_cast<std::size_t>(first)] = false;
  }
  return first < 0;
}

// x >= 0 that minimises x . normal x / 2 - right . x (Lawson and Hanson 1974, chapter 23), for a few unknowns of any
// size.
VectorXd nonnegative_minimum(const MatrixXd& normal, const VectorXd& right) {
  const Index n = right.size();
  const VectorXd scale = unit_scale_of_information(normal);
  const MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  const VectorXd wanted = scale.cwiseProduct(right);
  const double small = 1e-12 * wanted.cwiseAbs().maxCoeff();
  VectorXd x = VectorXd::Zero(n);
  std::vector<bool> active(static_cast<std::size_t>(n), false);
  for (Index round = 0; round < 3 * n; ++round) {
    const VectorXd slope = wanted - scaled * x;
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
    for (Index i = 0; i < n && !go_to_active(scaled, wanted, active, x); ++i) {
      if (std::none_of(active.begin(), active.end(), [](bool a) { return a; })) {
        break;
      }
    }
  }
  return scale.cwiseProduct(x);
}

// Inverts a symmetric matrix. Returns the logarithm of its determinant, with pivots of at least `least`.
double invert(MatrixXd& matrix, double least) {
  if (matrix.size() == 0) {
    return 0.0;
  }
  MatrixXd root = matrix;
  if (!factorise(root) || !(root.diagonal().cwiseAbs2().minCoeff() > least)) {
    const Eigen::LDLT<MatrixXd> pivoted(matrix);
    matrix = pivoted.solve(MatrixXd::Identity(matrix.rows(), matrix.cols()));
    return pivoted.vectorD().cwiseMax(least).array().log().sum();
  }
  const double log_determinant = 2.0 * root.diagonal().array().log().sum();
  invert_lower(root);
  const Factor transposed = factor(root, Shape::lower).transposed();
  matrix = symmetric_product(transposed, transposed);
  return log_determinant;
}

// Pseudo-inverse of the correlation matrix of the strata's residual sums of squares. Their covariance is
// 2 w^-2 expected^T if the true variances are 1 / w. For other variances the same correlation is an approximation.
MatrixXd inverse_correlation(const MatrixXd& expected, const VectorXd& weights) {
  const VectorXd root = expected.diagonal().cwiseMax(kLeastShare).cwiseSqrt();
  const VectorXd left = weights.cwiseQuotient(root);
  const VectorXd right = weights.cwiseProduct(root).cwiseInverse();
  const MatrixXd correlation = left.asDiagonal() * expected * right.asDiagonal();
  return pseudo_inverse(0.5 * (correlation + correlation.transpose()));
}

}  // namespace

VarianceEstimation::VarianceEstimation(VarianceTask task) : task_(std::move(task)) {
  const auto count = static_cast<Index>(task_.strata.size());
  design_.resize(count, unknowns());
  known_.resize(count);
  for (Index s = 0; s < count; ++s) {
    const Stratum& stratum = task_.strata[static_cast<std::size_t>(s)];
    design_.row(s).head(task_.unknown.cols()) = stratum.coefficients.transpose() * task_.unknown;
    known_[s] = stratum.known + stratum.coefficients.dot(task_.stated);
  }
  if (task_.further.cols() > 0) {
    design_.rightCols(task_.further.cols()) = task_.further;
  }
}

VectorXd VarianceEstimation::variances(const VectorXd& x) const {
  return VectorXd(known_ + design_ * x).cwiseMax(floor_);
}

// Starts every unknown at the mean square of its kind, positions or orientations, of the solution with equal weights in
// each kind. False if there is none.
bool VarianceEstimation::start() {
  const auto count = static_cast<Index>(task_.strata.size());
  const auto stratum = [&](Index s) -> const Stratum& { return task_.strata[static_cast<std::size_t>(s)]; };
  const auto means = [&](const auto& squares, const auto& rows) {
    VectorXd result(count);
    for (Index s = 0; s < count; ++s) {
      double sum = 0.0;
      double of = 0.0;
      for (Index t = 0; t < count; ++t) {
        const bool alike = stratum(s).is_of_orientations() == stratum(t).is_of_orientations();
        sum += alike ? squares(t) : 0.0;
        of += alike ? rows(t) : 0.0;
      }
      result[s] = of > 0.0 ? sum / of : 0.0;
    }
    return result;
  };
  const VectorXd whole = means([&](Index s) { return stratum(s).squares; }, [&](Index s) { return stratum(s).count; });
  if (count == 0 || !(whole.minCoeff() > 0.0)) {
    return false;
  }
  const Solution even = solve(whole.cwiseInverse());
  const MatrixXd rows = expectation(even).by_variances;
  const VectorXd left =
      means([&](Index s) { return even.squares[s]; }, [&](Index s) { return std::max(rows.row(s).sum(), 0.0); });
  constexpr double kRounding = 1e-20;  // of squares
  const VectorXd least = left.cwiseMax(kRounding * whole);
  floor_ = kLeastShare * least;
  x_ = VectorXd::Zero(unknowns());
  for (Index i = 0; i < unknowns(); ++i) {
    const auto is_of = (design_.col(i).array() > 0.0).cast<double>();
    if (rows.rowwise().sum().cwiseMax(0.0).dot(is_of.matrix()) < kUsedUp) {
      design_.col(i).setZero();
    }
    x_[i] = (design_.col(i).array() > 0.0).select(least, 0.0).maxCoeff();
  }
  lambda_ = variances(x_);
  return true;
}

VarianceEstimation::Solution VarianceEstimation::solve(const VectorXd& weights) const {
  constexpr double kRidge = 1e-12;
  MatrixXd M = task_.priors;
  VectorXd g = task_.prior_gradient;
  Solution result{.weights = weights, .covariance = {}, .squares = VectorXd(weights.size())};
  for (std::size_t i = 0; i < task_.strata.size(); ++i) {
    const Stratum& stratum = task_.strata[i];
    const double weight = weights[static_cast<Index>(i)];
    result.minus_two_log += weight * stratum.squares - stratum.count * std::log(weight);
    if (stratum.predicted) {
      M += weight * stratum.information;
      g += weight * stratum.gradient;
    }
  }
  const VectorXd scale = M.diagonal().unaryExpr([](double d) { return d > 0.0 ? 1.0 / std::sqrt(d) : 1.0; });
  MatrixXd scaled = scale.asDiagonal() * M * scale.asDiagonal();
  scaled.diagonal().array() += kRidge;
  result.minus_two_log += invert(scaled, kRidge);
  result.covariance = scale.asDiagonal() * scaled * scale.asDiagonal();
  const VectorXd step = result.covariance * g;
  result.minus_two_log -= 2.0 * scale.array().log().sum();
  result.minus_two_log -= step.dot(g);
  for (std::size_t i = 0; i < task_.strata.size(); ++i) {
    const Stratum& stratum = task_.strata[i];
    double& left = result.squares[static_cast<Index>(i)];
    left = stratum.squares;
    if (stratum.predicted) {
      left = std::max(left + step.dot(stratum.information * step) - 2.0 * step.dot(stratum.gradient), 0.0);
    }
  }
  return result;
}

VarianceEstimation::Expectation VarianceEstimation::expectation(const Solution& solution) const {
  const auto count = static_cast<Index>(task_.strata.size());
  std::vector<MatrixXd> explained(task_.strata.size());  // covariance x information
  const Eigen::SparseMatrix<double> priors = task_.priors.sparseView();
  Expectation result{.by_variances = MatrixXd::Zero(count, count), .by_priors = VectorXd::Zero(count)};
  for (Index s = 0; s < count; ++s) {
    const Stratum& stratum = task_.strata[static_cast<std::size_t>(s)];
    result.by_variances(s, s) = stratum.count;
    if (!stratum.predicted) {
      continue;
    }
    MatrixXd& own = explained[static_cast<std::size_t>(s)];
    own = product(factor(solution.covariance), factor(stratum.information));  // both are symmetric
    result.by_variances(s, s) -= 2.0 * solution.weights[s] * own.trace();
    result.by_priors[s] = MatrixXd(priors * own).cwiseProduct(solution.covariance).sum();
    for (Index t = 0; t <= s; ++t) {
      const MatrixXd& other = explained[static_cast<std::size_t>(t)];
      const double both = other.size() > 0 ? own.cwiseProduct(other.transpose()).sum() : 0.0;
      result.by_variances(s, t) += solution.weights[t] * solution.weights[t] * both;
      if (t != s) {
        result.by_variances(t, s) += solution.weights[s] * solution.weights[s] * both;
      }
    }
  }
  return result;
}

// Fisher scoring: the variances whose expected residual squares at the present weights equal the actual ones.
VectorXd VarianceEstimation::fisher_scoring_step() {
  const Expectation expected = expectation(solution_);
  const MatrixXd weight = 0.5 * solution_.weights.cwiseAbs2().asDiagonal().toDenseMatrix();
  fisher_ = design_.transpose() * weight * expected.by_variances * design_;
  const VectorXd left = solution_.squares - expected.by_priors - expected.by_variances * known_;
  return nonnegative_minimum(fisher_, design_.transpose() * weight * left);
}

// Step towards x, shortened until the likelihood does not fall. False if it falls even for a short step.
bool VarianceEstimation::go_towards(const VectorXd& x) {
  constexpr int kHalvings = 30;
  constexpr double kRounding = 1e-12;  // relative to the terms of the sum
  const double allowed = kRounding * (1.0 + std::abs(solution_.minus_two_log));
  double step = 1.0;
  for (int halving = 0; halving < kHalvings; ++halving, step *= 0.5) {
    const VectorXd there = x_ + step * (x - x_);
    const VectorXd lambda = variances(there);
    Solution solution = solve(lambda.cwiseInverse());
    if (solution.minus_two_log <= solution_.minus_two_log + allowed) {
      x_ = there;
      lambda_ = lambda;
      solution_ = std::move(solution);
      return true;
    }
  }
  return false;
}

bool VarianceEstimation::maximise() {
  constexpr int kRounds = 200;
  constexpr double kSettled = 1e-7;
  constexpr double kNear = 1e-3;  // smaller steps fail only by rounding
  if (!start()) {
    return false;
  }
  solution_ = solve(lambda_.cwiseInverse());
  with_own_weights_ = true;
  if (unknowns() == 0) {
    finish();
    return true;
  }
  for (int round = 0; round < kRounds; ++round) {
    if (!std::isfinite(solution_.minus_two_log)) {
      return false;
    }
    const VectorXd x = fisher_scoring_step();
    const double change = (variances(x) - lambda_).cwiseQuotient(lambda_).cwiseAbs().maxCoeff();
    const bool stuck = !go_towards(x);
    if (change < kSettled || (stuck && (change < kNear || !go_towards(mm_step())))) {
      finish();
      return agrees();
    }
  }
  return false;
}

// A step that never decreases the likelihood (minorisation and maximisation: Zhou, Hu, Qiao and Cho 2019, section 3):
// x_i^2 <- x_i^2 (sum_s w_s^2 d_si squares_s) / (sum_s w_s d_si freedom_s).
VectorXd VarianceEstimation::mm_step() const {
  const Expectation expected = expectation(solution_);
  const VectorXd freedom = (expected.by_variances * lambda_ + expected.by_priors).cwiseProduct(solution_.weights);
  const VectorXd found = design_.transpose() * solution_.weights.cwiseAbs2().cwiseProduct(solution_.squares);
  const VectorXd wanted = design_.transpose() * solution_.weights.cwiseProduct(freedom);
  return (wanted.array() > 0.0).select(x_.cwiseProduct(found.cwiseQuotient(wanted).cwiseMax(0.0).cwiseSqrt()), 0.0);
}

// Whether the residual squares of positions and of orientations agree with the variances within a factor of 1.5 in
// sigma. Stated noise may be larger, and is not tested if nothing was estimated.
bool VarianceEstimation::agrees() const {
  constexpr double kFactor = 1.5 * 1.5;
  constexpr double kEnoughFreedom = 10.0;  // below it squares cannot contradict the variances
  const Expectation expected = expectation(solution_);
  const VectorXd squares = expected.by_variances * lambda_ + expected.by_priors;
  const VectorXd of_stated = expected.by_variances * known_;
  for (const bool of_orientations : {false, true}) {
    double found = 0.0;
    double wanted = 0.0;
    double stated = 0.0;
    double freedom = 0.0;
    bool is_estimated = false;
    for (std::size_t i = 0; i < task_.strata.size(); ++i) {
      if (task_.strata[i].is_of_orientations() == of_orientations) {
        const auto s = static_cast<Index>(i);
        found += solution_.squares[s];
        wanted += squares[s];
        stated += of_stated[s];
        freedom += std::max(expected.by_variances.row(s).sum(), 0.0);
        is_estimated = is_estimated || design_.row(s).maxCoeff() > 0.0;
      }
    }
    if (freedom < kEnoughFreedom || !is_estimated) {
      continue;
    }
    if (wanted * kFactor < found || wanted > kFactor * std::max(found, stated)) {
      return false;
    }
  }
  return true;
}

bool VarianceEstimation::match(const Variances& weights) {
  constexpr int kRounds = 100;
  constexpr double kSettled = 1e-7;
  if (!start()) {
    return false;
  }
  VectorXd even(known_.size());
  for (Index s = 0; s < even.size(); ++s) {
    const Stratum& stratum = task_.strata[static_cast<std::size_t>(s)];
    even[s] = stratum.known + stratum.coefficients.dot(weights);
  }
  solution_ = solve(even.cwiseInverse());
  with_own_weights_ = false;
  const Expectation expected = expectation(solution_);
  const VectorXd root = expected.by_variances.diagonal().cwiseMax(0.0).cwiseSqrt();
  const MatrixXd uncorrelated = inverse_correlation(expected.by_variances, even.cwiseInverse());
  const MatrixXd design = expected.by_variances * design_;
  const VectorXd left = solution_.squares - expected.by_priors - expected.by_variances * known_;
  for (int round = 0; round < kRounds; ++round) {
    const VectorXd scale = (root.array() > kLeastShare).select(std::sqrt(0.5) / (lambda_.array() * root.array()), 0.0);
    const MatrixXd weight = scale.asDiagonal() * uncorrelated * scale.asDiagonal();
    fisher_ = design.transpose() * weight * design;
    x_ = nonnegative_minimum(fisher_, design.transpose() * weight * left);
    const VectorXd before = std::exchange(lambda_, variances(x_));
    if (!lambda_.allFinite()) {
      return false;
    }
    if ((lambda_ - before).cwiseQuotient(before).cwiseAbs().maxCoeff() < kSettled) {
      break;
    }
  }
  finish();
  if (agrees()) {
    return true;
  }
  if (!maximise()) {  // the maximum likelihood parts and the solution with their weights
    return false;
  }
  solution_ = solve(even.cwiseInverse());
  with_own_weights_ = false;
  finish();
  return agrees();
}

void VarianceEstimation::finish() {
  const Expectation expected = expectation(solution_);
  freedom_ = (expected.by_variances * lambda_ + expected.by_priors).cwiseQuotient(lambda_).cwiseMax(0.0);
}

double VarianceEstimation::tail_of_means() const {
  double ratio = 0.0;
  double freedom = 0.0;
  for (std::size_t i = 0; i < task_.strata.size(); ++i) {
    if (task_.strata[i].is_of_means()) {
      const auto s = static_cast<Index>(i);
      ratio += solution_.squares[s] / lambda_[s];
      freedom += freedom_[s];
    }
  }
  return freedom > 0.0 ? reduced_chi_squared_tail(ratio / freedom, freedom) : 1.0;
}

// Equations minus determined unknowns, reduced by the share of the priors.
double VarianceEstimation::freedom_of_residuals() const {
  double result = 0.0;
  for (std::size_t i = 0; i < task_.strata.size(); ++i) {
    const Stratum& stratum = task_.strata[i];
    const double told = stratum.predicted ? solution_.weights[static_cast<Index>(i)] *
                                                solution_.covariance.cwiseProduct(stratum.information).sum()
                                          : 0.0;
    result += stratum.count - told;
  }
  return result;
}

NoiseParts VarianceEstimation::parts() const {
  NoiseParts result;
  result.residual_degrees_of_freedom = std::max(freedom_of_residuals(), 1.0);
  result.variances = task_.stated + task_.unknown * x_;
  std::vector<Index> positive;
  for (Index i = 0; i < x_.size(); ++i) {
    if (x_[i] > 0.0) {
      positive.push_back(i);
    }
  }
  if (!positive.empty()) {
    const MatrixXd expand = task_.unknown(Eigen::all, positive);
    const MatrixXd fisher = fisher_(positive, positive);
    result.covariance = expand * pseudo_inverse(fisher) * expand.transpose();
  }
  result.scatter = with_own_weights_ ? MatrixXd() : task_.priors;
  result.sensitivity.resize(static_cast<std::size_t>(NoiseParts::kCount));
  for (Index k = 0; k < NoiseParts::kCount; ++k) {
    result.estimated[static_cast<std::size_t>(k)] = task_.unknown.row(k).maxCoeff() > 0.0;
    if (result.estimated[static_cast<std::size_t>(k)]) {
      result.sensitivity[static_cast<std::size_t>(k)] = 0.0 * task_.priors;
    }
  }
  for (std::size_t i = 0; i < task_.strata.size(); ++i) {
    const Stratum& stratum = task_.strata[i];
    const auto s = static_cast<Index>(i);
    const double squared = solution_.weights[s] * solution_.weights[s];
    result.degrees_of_freedom += stratum.is_of_means() ? freedom_[s] : 0.0;
    if (stratum.predicted && !with_own_weights_) {
      result.scatter += squared * lambda_[s] * stratum.information;
    }
    for (Index k = 0; k < NoiseParts::kCount && stratum.predicted; ++k) {
      if (result.estimated[static_cast<std::size_t>(k)]) {
        result.sensitivity[static_cast<std::size_t>(k)] += squared * stratum.coefficients[k] * stratum.information;
      }
    }
  }
  result.degrees_of_freedom = std::min(result.degrees_of_freedom, result.residual_degrees_of_freedom);
  return result;
}

}  // namespace kdl_calibration
