#include "selection/group_sizes.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>

#include "base/preconditions.hpp"
#include "estimation/linear_system.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int kRounds = 60;
constexpr int kRoundsFromNear = 8;
constexpr double kSettledEvidence = 1e-3;  // relative change of a size
constexpr double kSmallest = 1e-16;        // [m^2 or rad^2] smaller variances count as zero
constexpr double kLeastTold = 1e-6;        // number of values
constexpr double kLeastOfAmple = 0.5;      // number of values
constexpr double kFirstSize = 1e-3;        // [m or rad]
constexpr double kLeastPivot = 1e-10;      // of free columns scaled to unit norm
constexpr double kLeastFreedom = 1.0;      // equations left for the noise

// Inverts in place by recursive halving, a third of the operations of solving for a unit matrix.
void invert_lower_triangle(Eigen::Ref<MatrixXd> L) {
  constexpr Index kSmall = 48;
  const Index n = L.rows();
  if (n <= kSmall) {
    L.triangularView<Eigen::Lower>() = MatrixXd(L.triangularView<Eigen::Lower>().solve(MatrixXd::Identity(n, n)));
    return;
  }
  const Index half = n / 2;
  auto below = L.bottomLeftCorner(n - half, half);
  invert_lower_triangle(L.topLeftCorner(half, half));
  invert_lower_triangle(L.bottomRightCorner(n - half, n - half));
  below = -(L.bottomRightCorner(n - half, n - half).triangularView<Eigen::Lower>() * MatrixXd(below));
  below = MatrixXd(below) * L.topLeftCorner(half, half).triangularView<Eigen::Lower>();
}

bool is_held(const SizeLimits& limits, std::size_t group) {
  return group < limits.held.size() && limits.held[group] > 0.0;
}

double limited(const SizeLimits& limits, std::size_t group, double variance) {
  return group < limits.most.size() ? std::min(variance, limits.most[group] * limits.most[group]) : variance;
}

// Raises the prior sigma of marked groups by two standard errors of its logarithm: a prior that is too narrow costs
// more than one that is too wide. Returns whether a group was raised.
bool inflate(std::vector<double>& variances, const SizeLimits& limits, const VectorXd& gamma) {
  bool is_any = false;
  for (std::size_t g = 0; g < std::min(variances.size(), limits.inflated.size()); ++g) {
    if (limits.inflated[g] && !is_held(limits, g)) {
      const double told = std::max(gamma[static_cast<Index>(g)], kLeastOfAmple);
      variances[g] = limited(limits, g, variances[g] * std::exp(4.0 / std::sqrt(2.0 * told)));
      is_any = true;
    }
  }
  return is_any;
}

}  // namespace

LinearSums& LinearSums::operator-=(const LinearSums& other) {
  information -= other.information;
  moment -= other.moment;
  squares -= other.squares;
  equations -= other.equations;
  return *this;
}

SizeEstimator::SizeEstimator(const LinearSums& sums, const std::vector<Index>& columns, const SizedGroups& groups)
    : size_(sums.information.cols()), equations_(sums.equations) {
  require_count("rows of sums", sums.information.rows(), size_);
  require_count("moments of sums", sums.moment.size(), size_);
  require_indices("column", columns, size_);
  std::vector<bool> is_sized(static_cast<std::size_t>(size_), false);
  for (const std::vector<Index>& group : groups) {
    require_indices("the column of a group", group, size_);
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
  information_ = sums.information(sized_, sized_) - coupling.transpose() * slope_;
  moment_ = VectorXd(sums.moment(sized_)) - coupling.transpose() * offset_;
  squares_ = sums.squares - own.dot(offset_);
}

SizeEstimator::Fit SizeEstimator::solve(const std::vector<double>& variances, double variance) const {
  const Index n = information_.cols();
  if (n == 0) {
    return {.x = {}, .gamma = VectorXd::Zero(static_cast<Index>(groups_.size())), .squares = std::max(squares_, 0.0)};
  }
  // In units of the groups' sizes: M = I + S A S / sigma^2 is never singular, and a size of zero removes a group.
  VectorXd S = VectorXd::Zero(n);
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    for (const Index place : groups_[g]) {
      S[place] = std::sqrt(variances[g] / variance);
    }
  }
  MatrixXd M = S.asDiagonal() * information_ * S.asDiagonal();
  M.diagonal().array() += 1.0;
  const Eigen::LLT<MatrixXd> root(M);
  Fit fit;
  const VectorXd u = root.solve(S.cwiseProduct(moment_));
  fit.x = S.cwiseProduct(u);
  fit.squares = std::max(squares_ - 2.0 * fit.x.dot(moment_) + fit.x.dot(information_ * fit.x), 0.0);
  fit.log_determinant = 2.0 * root.matrixLLT().diagonal().array().log().sum();
  // diag(C) in those units: squared columns of L^-1.
  MatrixXd inverse = root.matrixLLT();
  invert_lower_triangle(inverse);
  fit.gamma.resize(static_cast<Index>(groups_.size()));
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    double told = 0.0;
    for (const Index place : groups_[g]) {
      told += 1.0 - inverse.col(place).tail(n - place).squaredNorm();
      fit.penalty += variances[g] > 0.0 ? fit.x[place] * fit.x[place] / variances[g] : 0.0;
    }
    fit.gamma[static_cast<Index>(g)] = told;
  }
  return fit;
}

VectorXd SizeEstimator::all_values(const VectorXd& sized) const {
  VectorXd result = VectorXd::Zero(size_);
  result(sized_) = sized;
  result(free_) = offset_ - slope_ * sized;
  return result;
}

GroupSizes SizeEstimator::estimate(const std::vector<double>& start, const SizeLimits& limits, double rounding) const {
  const double left = equations_ - static_cast<double>(free_.size());
  std::vector<double> variances(groups_.size(), kFirstSize * kFirstSize);
  for (std::size_t g = 0; g < start.size() && g < variances.size(); ++g) {
    variances[g] = start[g] * start[g];
  }
  for (std::size_t g = 0; g < variances.size(); ++g) {
    variances[g] = is_held(limits, g) ? limits.held[g] * limits.held[g] : variances[g];
  }
  const double least = rounding * rounding;
  double variance = std::max((start.empty() ? 0.1 : 1.0) * squares_ / left, least);
  Fit fit;
  const auto evidence_of = [&](const Fit& at) {
    return -0.5 * (left * std::log(variance) + at.log_determinant + at.squares / variance + at.penalty);
  };
  const int rounds = start.empty() ? kRounds : kRoundsFromNear;
  double before = -std::numeric_limits<double>::infinity();
  for (int round = 0; round <= rounds; ++round) {
    fit = solve(variances, variance);
    const double evidence = evidence_of(fit);
    if (round == rounds || (round > 1 && evidence < before + kSettledEvidence)) {
      break;
    }
    before = evidence;
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      if (variances[g] != 0.0 && !is_held(limits, g)) {
        const double told = std::max(fit.gamma[static_cast<Index>(g)], kLeastTold);
        const double next = limited(limits, g, fit.x(groups_[g]).squaredNorm() / told);
        variances[g] = next > kSmallest ? next : 0.0;
      }
    }
    variance = std::max(fit.squares / std::max(left - fit.gamma.sum(), kLeastFreedom), least);
  }
  if (inflate(variances, limits, fit.gamma)) {
    fit = solve(variances, variance);
  }
  GroupSizes result{
      .sizes = {}, .sigma = std::sqrt(variance), .evidence = evidence_of(fit), .values = all_values(fit.x)};
  std::transform(variances.begin(), variances.end(), std::back_inserter(result.sizes),
                 [](double v) { return std::sqrt(v); });
  return result;
}

}  // namespace kdl_calibration
