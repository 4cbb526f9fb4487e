#include "screening/heavy_tails.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "base/distributions.hpp"

namespace kdl_calibration {
namespace {

constexpr double kLeast = 1e-300;  // least probability used as a divisor
constexpr double kNormalMedian = 0.6745;

// Absolute value of a Student's t with 1 / nu = `heaviness`; of a normal value if 0.
class TailedSize {
public:
  explicit TailedSize(double heaviness) : heaviness_(heaviness) {
    const double nu = 1.0 / heaviness;
    log_constant_ = heaviness == 0.0 ? 0.5 * std::log(2.0 / std::numbers::pi)
                                     : std::log(2.0) + log_gamma((nu + 1.0) / 2.0) - log_gamma(nu / 2.0) -
                                           0.5 * std::log(nu * std::numbers::pi);
  }

  double beyond(double size) const {
    const double p =
        heaviness_ == 0.0 ? std::erfc(size / std::numbers::sqrt2) : f_upper_tail(size * size, 1.0, 1.0 / heaviness_);
    return std::max(p, kLeast);
  }
  // Log density of a size, given its square.
  double log_density(double square) const {
    return log_constant_ -
           (heaviness_ == 0.0 ? 0.5 * square : 0.5 * (1.0 / heaviness_ + 1.0) * std::log1p(square * heaviness_));
  }
  // Sum over sizes with squares `squares` / `unit` of -size times the derivative of the log density.
  double pull(const Eigen::ArrayXd& squares, double unit) const {
    return (1.0 + heaviness_) * (squares / (unit + heaviness_ * squares)).sum();
  }

private:
  double heaviness_;
  double log_constant_;
};

// Ascending sizes. Of the `censored` largest only that they are larger is used.
class CensoredSizes {
public:
  CensoredSizes(const std::vector<double>& sizes, std::size_t censored)
      : sizes_(sizes), known_(sizes.size() - censored), censored_(static_cast<double>(censored)) {
    const std::size_t step = std::max<std::size_t>(1, known_ / kMostSummed);
    squares_.resize(static_cast<Eigen::Index>((known_ + step - 1) / step));
    for (std::size_t i = 0; i < known_; i += step) {
      squares_[static_cast<Eigen::Index>(i / step)] = sizes[i] * sizes[i];
    }
    weight_ = static_cast<double>(known_) / static_cast<double>(squares_.size());
  }

  // Root of the derivative of the log likelihood by the scale, by bisection.
  double likeliest_scale(const TailedSize& tailed) const {
    const double middle = std::log(sizes_[sizes_.size() / 2] / kNormalMedian);
    double lower = middle - 1.5;
    double upper = middle + 1.0;
    for (int i = 0; i < 14; ++i) {
      const double scale = std::exp(0.5 * (lower + upper));
      const double z = sizes_[known_ - 1] / scale;
      const double slope = weight_ * tailed.pull(squares_, scale * scale) - static_cast<double>(known_) +
                           censored_ * z * std::exp(tailed.log_density(z * z)) / tailed.beyond(z);
      (slope > 0.0 ? lower : upper) = 0.5 * (lower + upper);
    }
    return std::exp(0.5 * (lower + upper));
  }

  double log_likelihood(const TailedSize& tailed, double scale) const {
    double sum = 0.0;
    for (const double square : squares_) {
      sum += tailed.log_density(square / (scale * scale));
    }
    return weight_ * sum - static_cast<double>(known_) * std::log(scale) +
           censored_ * std::log(tailed.beyond(sizes_[known_ - 1] / scale));
  }

private:
  static constexpr std::size_t kMostSummed = 1000;  // evenly spaced ones of more

  const std::vector<double>& sizes_;
  std::size_t known_;
  double censored_;
  Eigen::ArrayXd squares_;  // of the summed sizes
  double weight_ = 1.0;     // of each summed size
};

// The size exceeded by any of the values with probability kChance, with the `censored` largest censored.
double limit_without(const std::vector<double>& sizes, std::size_t censored) {
  constexpr double kChance = 0.005;
  constexpr double kHeaviest = 0.4;
  constexpr std::size_t kSteps = 9;
  constexpr double kFarthest = 1e6;  // in scales
  constexpr double kSettled = 1e-6;
  const CensoredSizes known(sizes, censored);
  std::vector<TailedSize> tails;
  std::array<double, kSteps> scales{};
  std::array<double, kSteps> weights{};
  for (std::size_t i = 0; i < kSteps; ++i) {
    tails.emplace_back(kHeaviest * static_cast<double>(i) / static_cast<double>(kSteps - 1));
    scales[i] = known.likeliest_scale(tails[i]);
    weights[i] = known.log_likelihood(tails[i], scales[i]);
  }
  const double best = *std::max_element(weights.begin(), weights.end());
  double total = 0.0;
  for (double& weight : weights) {
    weight = std::exp(weight - best);
    total += weight;
  }
  const double allowed = kChance * total / static_cast<double>(sizes.size());
  double lower = scales.front();
  double upper = kFarthest * lower;
  while (upper > (1.0 + kSettled) * lower) {
    const double middle = std::sqrt(lower * upper);
    double p = 0.0;
    for (std::size_t k = 0; k < kSteps; ++k) {
      p += weights[k] * tails[k].beyond(middle / scales[k]);
    }
    (p > allowed ? lower : upper) = middle;
  }
  return upper;
}

}  // namespace

double limit_of_heavy_tails(std::vector<double> sizes) {
  constexpr double kShare = 0.08;      // largest share of values that can be defects
  constexpr std::size_t kFewest = 10;  // covers the 9 coordinates of one wrong configuration of three targets
  std::size_t censored = std::max(kFewest, static_cast<std::size_t>(kShare * static_cast<double>(sizes.size())));
  std::sort(sizes.begin(), sizes.end());
  if (sizes.size() < 3 * censored || !(sizes[sizes.size() / 2] > 0.0)) {
    return 0.0;
  }
  for (;;) {
    const double limit = limit_without(sizes, censored);
    const std::size_t fewer = censored / 2;
    if (fewer == 0 || sizes[sizes.size() - 1 - fewer] > limit) {
      return limit;
    }
    censored = fewer;
  }
}

}  // namespace kdl_calibration
