#include "selection/group_sizes.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <utility>

#include "base/dense.hpp"
#include "estimation/linear_system.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int kRounds = 60;
constexpr double kSettledEvidence = 1e-3;
constexpr double kSmallest = 1e-16;    // [m^2 or rad^2] smaller variances count as zero
constexpr double kLeastTold = 1e-6;    // number of values
constexpr double kLeastOfAmple = 0.5;  // number of values
constexpr double kFirstSize = 1e-3;    // [m or rad]
constexpr double kLeastPivot = 1e-10;  // of free columns scaled to unit norm
constexpr double kLeastFreedom = 1.0;  // equations left for the noise

bool is_held(const SizeLimits& limits, std::size_t group) {
  return group < limits.held.size() && limits.held[group] > 0.0;
}

double limited(const SizeLimits& limits, std::size_t group, double variance) {
  return group < limits.most.size() ? std::min(variance, limits.most[group] * limits.most[group]) : variance;
}

double first_size(const GroupSizes& start, const SizeLimits& limits, std::size_t group) {
  return is_held(limits, group) ? limits.held[group] : group < start.sizes.size() ? start.sizes[group] : kFirstSize;
}

// Raises the prior sigma of marked groups by two standard errors of its logarithm: a prior that is too narrow costs
// more than one that is too wide.
void inflate(std::vector<double>& variances, const SizeLimits& limits, const VectorXd& gamma) {
  for (std::size_t g = 0; g < std::min(variances.size(), limits.inflated.size()); ++g) {
    if (limits.inflated[g] && !is_held(limits, g)) {
      const double told = std::max(gamma[static_cast<Index>(g)], kLeastOfAmple);
      variances[g] = limited(limits, g, variances[g] * std::exp(4.0 / std::sqrt(2.0 * told)));
    }
  }
}

}  // namespace

LinearSums& LinearSums::operator+=(const LinearSums& other) {
  information += other.information;
  moment += other.moment;
  squares += other.squares;
  equations += other.equations;
  return *this;
}

void LinearSums::subtract_from(const LinearSums& all) {
  information = all.information - information;
  moment = all.moment - moment;
  squares = all.squares - squares;
  equations = all.equations - equations;
}

SizeEstimator::SizeEstimator(const LinearSums& sums, const std::vector<Index>& columns, const SizedGroups& groups)
    : size_(sums.information.cols()), equations_(sums.equations) {
  std::vector<bool> is_sized(static_cast<std::size_t>(size_), false);
  for (const std::vector<Index>& group : groups) {
    std::vector<Index>& places = groups_.emplace_back();
    for (const Index column : group) {
      places.push_back(static_cast<Index>(sized_.size()));
      sized_.push_back(column);
      is_sized[static_cast<std::size_t>(column)] = true;
    }
  }
  std::copy_if(columns.begin(), columns.end(), std::back_inserter(free_),
               [&](Index column) { return !is_sized[static_cast<std::size_t>(column)]; });
  const MatrixXd A = sums.information(free_, free_);
  const VectorXd scale = unit_scale_of_information(A);
  const Eigen::LLT<MatrixXd> root(MatrixXd(scale.asDiagonal() * A * scale.asDiagonal()));
  determined_ = root.info() == Eigen::Success &&
                (free_.empty() || root.matrixLLT().diagonal().minCoeff() > std::sqrt(kLeastPivot)) &&
                equations_ - static_cast<double>(free_.size()) > kLeastFreedom;
  if (!determined_) {
    return;
  }
  const auto solved = [&](auto right) {  // Eigen must not access the first entry of an empty matrix
    if (right.size() > 0) {
      right = (scale.asDiagonal() * root.solve(scale.asDiagonal() * right)).eval();
    }
    return right;
  };
  const MatrixXd coupling = sums.information(free_, sized_);
  const VectorXd own = sums.moment(free_);
  offset_ = solved(own);
  slope_ = solved(coupling);
  information_ = MatrixXd::Zero(coupling.cols(), coupling.cols());
  for (Index c = 0; c < information_.cols(); ++c) {
    for (Index r = c; r < information_.rows(); ++r) {
      information_(r, c) = sums.information(sized_[static_cast<std::size_t>(r)], sized_[static_cast<std::size_t>(c)]);
    }
  }
  add_symmetric_product(-1.0, factor(coupling).transposed(), factor(slope_).transposed(), information_);
  moment_ = VectorXd(sums.moment(sized_)) - coupling.transpose() * offset_;
  squares_ = sums.squares - own.dot(offset_);
}

// Keeps the memory of the fit.
void SizeEstimator::solve(const std::vector<double>& variances, double variance, Fit& fit) const {
  const Index n = information_.cols();
  fit.x = VectorXd::Zero(n);
  fit.squares = std::max(squares_, 0.0);
  if (n == 0) {
    return;
  }
  // In units of the groups' sizes: M = I + S A S / sigma^2 is never singular, and a size of zero removes a group.
  VectorXd S = VectorXd::Zero(n);
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    S(groups_[g]).setConstant(std::sqrt(variances[g] / variance));
  }
  if (fit.root.cols() != n) {
    fit.root = MatrixXd::Zero(n, n);
  }
  for (Index c = 0; c < n; ++c) {
    fit.root.col(c).tail(n - c) = S[c] * S.tail(n - c).cwiseProduct(information_.col(c).tail(n - c));
  }
  fit.root.diagonal().array() += 1.0;
  factorise(fit.root);
  MatrixXd u = S.cwiseProduct(moment_);
  fit.root.triangularView<Eigen::Lower>().solveInPlace(u);
  fit.root.triangularView<Eigen::Lower>().adjoint().solveInPlace(u);
  fit.x = S.cwiseProduct(u);
  // With M u = S b: x . A x = u . S A S u = x . b - u . u.
  fit.squares = std::max(squares_ - fit.x.dot(moment_) - u.squaredNorm(), 0.0);
  fit.log_determinant = 2.0 * fit.root.diagonal().array().log().sum();
  fit.penalty = u.squaredNorm() / variance;
}

// diag(C) in units of the groups' sizes: squared columns of L^-1.
VectorXd SizeEstimator::gamma(Fit& fit) const {
  VectorXd result(static_cast<Index>(groups_.size()));
  invert_lower(fit.root);
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    double told = 0.0;
    for (const Index place : groups_[g]) {
      told += 1.0 - fit.root.col(place).tail(fit.root.rows() - place).squaredNorm();
    }
    result[static_cast<Index>(g)] = told;
  }
  return result;
}

VectorXd SizeEstimator::all_values(const VectorXd& sized) const {
  VectorXd result = VectorXd::Zero(size_);
  result(sized_) = sized;
  result(free_) = offset_ - slope_ * sized;
  return result;
}

GroupSizes SizeEstimator::estimate(const GroupSizes& start, const SizeLimits& limits, double rounding) const {
  const double left = equations_ - static_cast<double>(free_.size());
  const bool near = !start.sizes.empty();
  std::vector<double> variances(groups_.size());
  for (std::size_t g = 0; g < variances.size(); ++g) {
    variances[g] = std::pow(first_size(start, limits, g), 2);
  }
  const double least = rounding * rounding;
  const double first = start.sigma > 0.0 ? start.sigma * start.sigma : (near ? 1.0 : 0.1) * squares_ / left;
  double variance = std::max(first, least);
  Fit fit;
  VectorXd told;
  const auto evidence_of = [&](const Fit& at) {
    return -0.5 * (left * std::log(variance) + at.log_determinant + at.squares / variance + at.penalty);
  };
  double before = -std::numeric_limits<double>::infinity();
  for (int round = 0; round <= kRounds; ++round) {
    solve(variances, variance, fit);
    const double evidence = evidence_of(fit);
    if (round == kRounds || (round > (near ? 0 : 1) && evidence < before + kSettledEvidence)) {
      break;
    }
    before = evidence;
    told = gamma(fit);
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      if (variances[g] != 0.0 && !is_held(limits, g)) {
        const double next =
            limited(limits, g, fit.x(groups_[g]).squaredNorm() / std::max(told[static_cast<Index>(g)], kLeastTold));
        variances[g] = next > kSmallest ? next : 0.0;
      }
    }
    variance = std::max(fit.squares / std::max(left - told.sum(), kLeastFreedom), least);
  }
  if (std::find(limits.inflated.begin(), limits.inflated.end(), true) != limits.inflated.end()) {
    inflate(variances, limits, gamma(fit));
    solve(variances, variance, fit);
  }
  GroupSizes result{.sizes = {},
                    .sigma = std::sqrt(variance),
                    .evidence = evidence_of(fit),
                    .values = all_values(fit.x),
                    .root = std::move(fit.root)};
  std::transform(variances.begin(), variances.end(), std::back_inserter(result.sizes),
                 [](double v) { return std::sqrt(v); });
  return result;
}

}  // namespace kdl_calibration
