#include "diagnosis/explanations.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "base/decompositions.hpp"
#include "base/dense.hpp"
#include "base/distributions.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kTiny = std::numeric_limits<double>::min();
constexpr double kFewestDegrees = 5.0;  // of freedom that tell the noise

// The rows of each stratum.
std::array<std::vector<Index>, kStrata> rows_of_strata(std::span<const RowStratum> strata) {
  std::array<std::vector<Index>, kStrata> result;
  for (std::size_t row = 0; row < strata.size(); ++row) {
    result[static_cast<std::size_t>(strata[row])].push_back(static_cast<Index>(row));
  }
  return result;
}

Factor of_root(const MatrixXd& root) { return factor(root, root.rows() == root.cols() ? Shape::upper : Shape::full); }

// Replaces A = L L^T by L^-1. False if A is not positive definite.
bool invert_root(MatrixXd& A) {
  if (!factorise(A)) {
    return false;
  }
  invert_lower(A);
  A.triangularView<Eigen::StrictlyUpper>().setZero();
  return true;
}

struct Determined {
  VectorXd solution;
  MatrixXd covariance;  // A^+
  double explained = 0.0;
  double rank = 0.0;
};

// A^+ b and b^T A^+ b on the directions of A that are more than rounding of `whole`, A before the projection.
Determined solved(const MatrixXd& A, const VectorXd& b, const MatrixXd& whole) {
  constexpr double kDetermined = 1e-9;
  Determined result{.solution = VectorXd::Zero(b.size()), .covariance = MatrixXd::Zero(b.size(), b.size())};
  if (b.size() == 0) {
    return result;
  }
  const VectorXd scale = whole.diagonal().unaryExpr([](double d) { return d > 0.0 ? 1.0 / std::sqrt(d) : 0.0; });
  const auto [values, vectors] = spectrum(scale.asDiagonal() * A * scale.asDiagonal());
  for (Index i = 0; i < values.size(); ++i) {
    if (values[i] > kDetermined) {
      const VectorXd direction = scale.asDiagonal() * vectors.col(i);
      const double along = direction.dot(b);
      result.solution += along / values[i] * direction;
      result.covariance += direction * direction.transpose() / values[i];
      result.explained += along * along / values[i];
      result.rank += 1.0;
    }
  }
  return result;
}

}  // namespace

// The fit beside ordinary sizes: rows J / sigma and 1 / (size of each column), with the triangle R.
struct Explanations::Equations {
  Weights weights;
  VectorXd per_size = {};  // 1 / (factor * size)
  MatrixXd inverse_root = {};
  VectorXd x = {};                      // R^-T times the right side
  OfStrata freedom = OfStrata::Zero();  // that the measured rows keep
  double of_sizes = 0.0;                // that the equations of ordinary sizes keep
};

// What an alternative explains beside these equations.
struct Explanations::Gain {
  MatrixXd whole;   // C^T C
  MatrixXd X = {};  // R^-T J^T C
  VectorXd estimate = {};
  MatrixXd covariance = {};  // of the estimate
  double explained = 0.0;
  double rank = 0.0;
};

struct Explanations::Solution {
  VectorXd estimate;
  MatrixXd covariance = {};
  double explained = 0.0;
  double rank = 0.0;
  VectorXd step = {};                // of the free columns
  OfStrata left = OfStrata::Zero();  // squares, over the equations' variances
  double left_sizes = 0.0;
  OfStrata taken = OfStrata::Zero();  // degrees of freedom by the alternative's columns
};

Explanations::Explanations(const LinearisedFit& fit) : fit_(fit) {
  for (Index column = 0; column < fit.sizes.size(); ++column) {
    if (fit.sizes[column] > 0.0) {
      free_.push_back(column);
    }
  }
  Weights weights;
  const auto rows = rows_of_strata(fit.strata);
  for (std::size_t s = 0; s < kStrata; ++s) {
    const auto place = static_cast<Index>(s);
    const MatrixXd J = fit.jacobian(rows[s], free_);
    const VectorXd e = fit.residual(rows[s]);
    root_[s] = triangular_factor(J);
    gram_[s] = symmetric_product(of_root(root_[s]).transposed(), of_root(root_[s]).transposed());
    gradient_[s] = J.transpose() * e;
    squares_[place] = e.squaredNorm();
    weights.variance[place] =
        std::max(squares_[place] / std::max(fit.coordinates[place], 1.0), fit.least_variance[place]);
  }
  without_ = std::make_shared<const Equations>(weighed(nothing(), with_freedom(weights, fit.doubted_variance)));
}

VectorXd Explanations::ordinary_step() const {
  VectorXd step = VectorXd::Zero(fit_.sizes.size());
  step(free_) = solution(nothing(), *without_).step;
  return step;
}

AlternativeSums Explanations::nothing() const {
  AlternativeSums none;
  none.cross.fill(MatrixXd(fit_.sizes.size(), 0));
  return none;
}

bool Explanations::is_error(Index free) const {
  return fit_.is_error[static_cast<std::size_t>(free_[static_cast<std::size_t>(free)])];
}

// R^-1 of R^T R = J^T J / variance + diag(per_size)^2. By Cholesky's factor, and once more by that of what rounding has
// left (Yamamoto, Nakatsukasa, Yanagisawa and Fukaya 2015: CholeskyQR2), as accurate as by reflections, which take over
// where too little is left.
MatrixXd Explanations::inverse_root(const OfStrata& variance, const VectorXd& per_size) const {
  constexpr double kFar = 0.5;
  const Index columns = per_size.size();
  MatrixXd A = per_size.cwiseAbs2().asDiagonal();
  for (std::size_t s = 0; s < kStrata; ++s) {
    A += gram_[s] / variance[static_cast<Index>(s)];
  }
  const VectorXd scale = A.diagonal().cwiseSqrt().cwiseInverse();
  A = scale.asDiagonal() * A * scale.asDiagonal();
  if (invert_root(A)) {
    const MatrixXd of_sizes = A * scale.cwiseProduct(per_size).asDiagonal();
    MatrixXd left = symmetric_product(factor(of_sizes, Shape::lower), factor(of_sizes, Shape::lower));
    for (std::size_t s = 0; s < kStrata; ++s) {
      const MatrixXd rows = root_[s] * (scale / std::sqrt(variance[static_cast<Index>(s)])).asDiagonal();
      const MatrixXd turned = product(factor(A, Shape::lower), of_root(rows));
      const Factor part = factor(turned, of_root(rows).shape == Shape::upper ? Shape::lower : Shape::full);
      add_symmetric_product(1.0, part, part, left);
    }
    left.triangularView<Eigen::StrictlyUpper>() = left.transpose();
    if ((left - MatrixXd::Identity(columns, columns)).norm() < kFar && invert_root(left)) {
      return scale.asDiagonal() *
             product(factor(A, Shape::lower).transposed(), factor(left, Shape::lower));  // (left A)^T
    }
  }
  MatrixXd rows = per_size.asDiagonal();
  for (std::size_t s = 0; s < kStrata; ++s) {
    const Index above = rows.rows();
    rows.conservativeResize(above + root_[s].rows(), Eigen::NoChange);
    rows.bottomRows(root_[s].rows()) = root_[s] / std::sqrt(variance[static_cast<Index>(s)]);
  }
  return triangular_factor(rows).triangularView<Eigen::Upper>().solve(MatrixXd::Identity(columns, columns));
}

Explanations::Equations Explanations::equations(const Weights& weights) const {
  const auto columns = static_cast<Index>(free_.size());
  Equations result{.weights = weights, .per_size = VectorXd(columns)};
  for (Index i = 0; i < columns; ++i) {
    result.per_size[i] = 1.0 / ((is_error(i) ? weights.size : 1.0) * fit_.sizes[free_[static_cast<std::size_t>(i)]]);
  }
  VectorXd right = -result.per_size.cwiseAbs2().cwiseProduct(fit_.values(free_));
  for (std::size_t s = 0; s < kStrata; ++s) {
    right += gradient_[s] / weights.variance[static_cast<Index>(s)];
  }
  result.inverse_root = inverse_root(weights.variance, result.per_size);
  result.x = result.inverse_root.transpose() * right;
  for (std::size_t s = 0; s < kStrata; ++s) {
    const auto place = static_cast<Index>(s);
    const MatrixXd fitted =
        product(of_root(root_[s]), factor(result.inverse_root, Shape::upper).transposed());  // J R^-1
    result.freedom[place] = fit_.coordinates[place] - fitted.squaredNorm() / weights.variance[place];
  }
  for (Index i = 0; i < columns; ++i) {
    result.of_sizes +=
        is_error(i) ? 1.0 - result.inverse_root.row(i).squaredNorm() * result.per_size[i] * result.per_size[i] : 0.0;
  }
  return result;
}

Explanations::Gain Explanations::gain(const AlternativeSums& sums, const Equations& equations) const {
  const Index columns = sums.cross[0].cols();
  MatrixXd cross = MatrixXd::Zero(std::ssize(free_), columns);
  Gain result{.whole = MatrixXd::Zero(columns, columns)};
  VectorXd right = VectorXd::Zero(columns);
  for (std::size_t s = 0; s < kStrata && columns > 0; ++s) {
    const double weight = 1.0 / equations.weights.variance[static_cast<Index>(s)];
    cross += weight * sums.cross[s](free_, Eigen::all);
    result.whole += weight * sums.own[s];
    right += weight * sums.right[s];
  }
  if (sums.B.size() > 0) {  // rows of the ordinary sizes of x = x' - B g
    const MatrixXd B = equations.per_size.asDiagonal() * sums.B(free_, Eigen::all);
    cross -= equations.per_size.asDiagonal() * B;
    result.whole += B.transpose() * B;
    right += B.transpose() * equations.per_size.cwiseProduct(fit_.values(free_));
  }
  result.X = equations.inverse_root.transpose().triangularView<Eigen::Lower>() * cross;
  const Determined found =
      solved(result.whole - result.X.transpose() * result.X, right - result.X.transpose() * equations.x, result.whole);
  result.estimate = found.solution;
  result.covariance = found.covariance;
  result.explained = found.explained;
  result.rank = found.rank;
  return result;
}

Explanations::Solution Explanations::solution(const AlternativeSums& sums, const Equations& equations) const {
  const OfStrata& variance = equations.weights.variance;
  const Index columns = sums.cross[0].cols();
  const Gain gain = this->gain(sums, equations);
  const VectorXd& estimate = gain.estimate;
  Solution result{.estimate = estimate, .covariance = gain.covariance, .explained = gain.explained, .rank = gain.rank};
  for (std::size_t s = 0; s < kStrata && columns > 0; ++s) {
    const auto place = static_cast<Index>(s);
    result.taken[place] = gain.rank * sums.own[s].trace() / variance[place] / std::max(gain.whole.trace(), kTiny);
  }
  const MatrixXd& X = gain.X;
  const VectorXd in_rows = equations.inverse_root * (equations.x - X * estimate);
  result.step = in_rows;
  if (sums.B.size() > 0) {
    result.step -= sums.B(free_, Eigen::all) * estimate;
  }
  const VectorXd errors = (fit_.values(free_) + result.step).cwiseProduct(equations.per_size);
  for (Index i = 0; i < errors.size(); ++i) {
    result.left_sizes += is_error(i) ? errors[i] * errors[i] : 0.0;
  }
  // |e - J x' - C' g|^2
  for (std::size_t s = 0; s < kStrata; ++s) {
    const auto place = static_cast<Index>(s);
    double squares = squares_[place] - 2.0 * in_rows.dot(gradient_[s]) + (root_[s] * in_rows).squaredNorm();
    if (columns > 0) {
      squares += estimate.dot(sums.own[s] * estimate) - 2.0 * estimate.dot(sums.right[s]) +
                 2.0 * in_rows.dot(sums.cross[s](free_, Eigen::all) * estimate);
    }
    result.left[place] = std::max(squares, 0.0) / variance[place];
  }
  return result;
}

// With few degrees of freedom left, the weights stay. Means over points scatter no less than the points do about them.
// An arm without any error keeps some size.
Explanations::Weights Explanations::fitted(const Solution& solution, const Equations& equations) const {
  constexpr double kLeastSize = 0.05;
  Weights result = equations.weights;
  const OfStrata freedom = equations.freedom - solution.taken;
  for (Index s = 0; s < freedom.size(); ++s) {
    if (freedom[s] >= kFewestDegrees) {
      result.variance[s] = std::max(result.variance[s] * solution.left[s] / freedom[s], fit_.least_variance[s]);
    }
  }
  if (fit_.coordinates[1] > 0.0) {
    result.variance[0] = std::max(result.variance[0], result.variance[1]);
  }
  if (equations.of_sizes >= 1.0) {
    result.size = std::max(result.size * std::sqrt(solution.left_sizes / equations.of_sizes), kLeastSize);
  }
  return result;
}

// The equations with these weights, but with the variances `before` where those leave too few degrees of freedom:
// ordinary errors then explain the noise of few rows, and nothing tells its size.
Explanations::Equations Explanations::with_freedom(const Weights& weights, const OfStrata& before) const {
  Equations result = equations(weights);
  Weights kept = weights;
  for (Index s = 0; s < before.size(); ++s) {
    if (result.freedom[s] < kFewestDegrees) {
      kept.variance[s] = std::max(kept.variance[s], before[s]);
    }
  }
  return (kept.variance != weights.variance).any() ? equations(kept) : result;
}

// The equations with the weights that follow from their own solution.
Explanations::Equations Explanations::weighed(const AlternativeSums& sums, Equations result) const {
  constexpr int kMostPasses = 20;
  constexpr double kSame = 0.03;
  for (int pass = 0; pass < kMostPasses; ++pass) {
    const Weights weights = result.weights;
    Weights next = fitted(solution(sums, result), result);
    if (without_ != nullptr) {  // what an alternative explains is no noise, and no error of the arm
      next.variance = next.variance.min(without_->weights.variance);
      next.size = std::min(next.size, without_->weights.size);
    }
    result = with_freedom(next, weights.variance);
    if ((result.weights.variance / weights.variance).log().abs().maxCoeff() < kSame &&
        std::abs(std::log(result.weights.size / weights.size)) < kSame) {
      break;
    }
  }
  return result;
}

AlternativeSums Explanations::sums(const MatrixXd& C) const {
  MatrixXd weighted = MatrixXd::Zero(std::ssize(free_), C.cols());
  const auto strata = rows_of_strata(fit_.strata);
  for (std::size_t s = 0; s < kStrata; ++s) {
    weighted += fit_.jacobian(strata[s], free_).transpose() * C(strata[s], Eigen::all) /
                without_->weights.variance[static_cast<Index>(s)];
  }
  MatrixXd B = MatrixXd::Zero(fit_.sizes.size(), C.cols());
  B(free_, Eigen::all) = without_->inverse_root * (without_->inverse_root.transpose() * weighted);
  AlternativeSums result = sums_of_rows(C - fit_.jacobian * B, 0);
  result.B = B;
  result.size = C.transpose() * C;
  return result;
}

AlternativeSums Explanations::sums_of_rows(const MatrixXd& C, Index first) const {
  AlternativeSums result;
  const auto strata = rows_of_strata(
      std::span(fit_.strata).subspan(static_cast<std::size_t>(first), static_cast<std::size_t>(C.rows())));
  for (std::size_t s = 0; s < kStrata; ++s) {
    const MatrixXd own = C(strata[s], Eigen::all);
    const MatrixXd J = fit_.jacobian.middleRows(first, C.rows())(strata[s], Eigen::all);
    result.cross[s] = J.transpose() * own;
    result.own[s] = own.transpose() * own;
    result.right[s] = own.transpose() * fit_.residual.segment(first, C.rows())(strata[s]);
  }
  result.size = result.own[0] + result.own[1];
  return result;
}

double Explanations::first_evidence(const AlternativeSums& sums) const {
  const Gain found = gain(sums, *without_);
  const double freedom = without_->freedom.sum() + without_->of_sizes;  // the squares that are left without it
  const double left = std::max(freedom - found.explained, 1e-12 * freedom);
  return 0.5 * freedom * std::log(freedom / left) - 0.5 * found.rank * std::log(fit_.coordinates.sum());
}

Explained Explanations::explained(const AlternativeSums& sums, const AlternativeMotion& motion) const {
  const Equations at = weighed(sums, *without_);
  const Solution found = solution(sums, at);
  const Solution without = solution(nothing(), at);
  Explained result{.estimate = found.estimate, .covariance = found.covariance};
  const OfStrata left = found.left * at.weights.variance;
  result.share_left = (left[0] + left[1]) / std::max(fit_.doubted_squares, kTiny);

  // Degrees of freedom of the variances that the explained squares are compared with, by their shares (Satterthwaite).
  const double explained = std::max(found.explained, kTiny);
  const auto taken_from = [&](double with, double others, double freedom) {
    const double share = std::clamp((others - with) / explained, 0.0, 1.0);
    return share * share / std::max(freedom, 0.1);
  };
  double inverse = taken_from(found.left_sizes, without.left_sizes, at.of_sizes);
  for (Index s = 0; s < found.left.size(); ++s) {
    inverse += taken_from(found.left[s], without.left[s], at.freedom[s] - found.taken[s]);
  }
  const double rest = 1.0 / std::max(inverse, kTiny);
  if (found.rank > 0.0 && rest >= 1.0) {
    result.p_value = f_upper_tail(found.explained / found.rank, found.rank, rest);
    result.evidence =
        0.5 * rest * std::log1p(found.explained / rest) - 0.5 * found.rank * std::log(fit_.coordinates.sum());
  }

  result.size = std::sqrt(found.estimate.dot(sums.size * found.estimate) / std::max(fit_.weight, kTiny));

  const MatrixXd predicted = fit_.predicted(Eigen::all, free_);
  result.moves = moved(fit_.offset + predicted * found.step, motion, found.estimate);
  return result;
}

// RMS motion [m] of the predicted points, which it moves to `before`; in part, before and after it.
double Explanations::moved(const VectorXd& before, const AlternativeMotion& motion, const VectorXd& estimate) const {
  VectorXd after = before;
  if (motion.of_robot.size() > 0) {
    after += fit_.predicted * (motion.of_robot * estimate);
  }
  if (motion.of_points.size() > 0) {
    after += motion.of_points * estimate;
  }
  const double squares = motion.in_part ? std::max(before.squaredNorm(), after.squaredNorm()) : after.squaredNorm();
  return std::sqrt(3.0 * squares / static_cast<double>(fit_.predicted.rows()));
}

std::optional<Detectable> Explanations::detectable(const AlternativeSums& sums, const AlternativeMotion& motion,
                                                   double level, double power) const {
  constexpr double kDetermined = 1e-9;
  const Gain gain = this->gain(sums, *without_);
  // Columns that move the measured points by 1 m RMS each, in independent directions.
  const auto [sizes, directions] = spectrum(sums.size / std::max(fit_.weight, kTiny));
  std::vector<Index> visible;
  for (Index i = 0; i < sizes.size(); ++i) {
    if (sizes[i] > kDetermined * sizes.maxCoeff()) {
      visible.push_back(i);
    }
  }
  if (visible.empty()) {
    return std::nullopt;
  }
  const MatrixXd unit = directions(Eigen::all, visible) * sizes(visible).cwiseSqrt().cwiseInverse().asDiagonal();
  const MatrixXd whole = unit.transpose() * gain.whole * unit;
  const auto [remaining, of_unit] = spectrum(whole - (gain.X * unit).transpose() * (gain.X * unit));
  if (!(remaining[0] > kDetermined * whole.trace())) {
    return std::nullopt;
  }
  const VectorXd least = unit * of_unit.col(0);
  // The step that the fit takes for it.
  VectorXd step = VectorXd::Zero(fit_.sizes.size());
  step(free_) = without_->inverse_root * (gain.X * least);
  if (sums.B.size() > 0) {
    step += sums.B * least;
  }
  // Errors that become larger than ordinary show it, and the residuals, each with its degrees of freedom.
  double of_sizes = 0.0;
  for (Index i = 0; i < std::ssize(free_); ++i) {
    const double error = step[free_[static_cast<std::size_t>(i)]] * without_->per_size[i];
    of_sizes += is_error(i) ? error * error / remaining[0] : 0.0;
  }
  of_sizes = std::min(of_sizes, 1.0);
  const double rest = 1.0 / (of_sizes * of_sizes / std::max(without_->of_sizes, 0.1) +
                             (1.0 - of_sizes) * (1.0 - of_sizes) / std::max(without_->freedom.sum(), 0.1));
  const double size = std::sqrt(non_centrality(level, power, gain.rank, std::max(rest, 1.0)) / remaining[0]);
  AlternativeMotion missed = motion;
  missed.of_robot = -motion.of_robot;
  missed.of_points = -motion.of_points;
  return Detectable{
      .estimate = size * least, .size = size, .moves = moved(size * fit_.predicted * step, missed, size * least)};
}

}  // namespace kdl_calibration
