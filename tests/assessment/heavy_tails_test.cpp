#include "assessment/heavy_tails.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "base/f_distribution.hpp"
#include "kdl_calibration/random.hpp"

namespace kdl_calibration {
namespace {

// ---- the rule written out ------------------------------------------------------------------------------------------

double log_density_of_size(double z, double heaviness) {
  if (heaviness == 0.0) {
    return std::log(2.0 / std::sqrt(2.0 * std::numbers::pi)) - z * z / 2.0;
  }
  const double nu = 1.0 / heaviness;
  return std::log(2.0) + log_gamma((nu + 1.0) / 2.0) - log_gamma(nu / 2.0) - 0.5 * std::log(nu * std::numbers::pi) -
         (nu + 1.0) / 2.0 * std::log(1.0 + z * z / nu);
}

double chance_beyond(double z, double heaviness) {
  return heaviness == 0.0 ? std::erfc(z / std::numbers::sqrt2) : f_upper_tail(z * z, 1.0, 1.0 / heaviness);
}

/// Ascending sizes: those before `known` (evenly spaced ones above a thousand), and that the others are larger.
double log_likelihood(const std::vector<double>& sizes, std::size_t known, double heaviness, double scale) {
  const std::size_t step = std::max<std::size_t>(1, known / 1000);
  double sum = 0.0;
  double summed = 0.0;
  for (std::size_t i = 0; i < known; i += step) {
    sum += log_density_of_size(sizes[i] / scale, heaviness);
    summed += 1.0;
  }
  const auto all = static_cast<double>(known);
  return sum * all / summed - all * std::log(scale) +
         static_cast<double>(sizes.size() - known) * std::log(chance_beyond(sizes[known - 1] / scale, heaviness));
}

/// By the golden section of the logarithm of the scale.
double likeliest_scale(const std::vector<double>& sizes, std::size_t known, double heaviness) {
  const double ratio = std::numbers::phi - 1.0;
  double lower = std::log(sizes[known / 2]) - 3.0;
  double upper = std::log(sizes[known - 1]) + 1.0;
  for (int i = 0; i < 26; ++i) {
    const double a = upper - ratio * (upper - lower);
    const double b = lower + ratio * (upper - lower);
    const bool left =
        log_likelihood(sizes, known, heaviness, std::exp(a)) > log_likelihood(sizes, known, heaviness, std::exp(b));
    (left ? upper : lower) = left ? b : a;
  }
  return std::exp(0.5 * (lower + upper));
}

/// What one of as many values exceeds in one of two hundred sets.
double limit_of_known(const std::vector<double>& sizes, std::size_t known) {
  std::vector<std::pair<double, double>> heaviness_and_scale;
  std::vector<double> weights;
  for (int i = 0; i <= 8; ++i) {
    const double heaviness = 0.05 * i;
    heaviness_and_scale.emplace_back(heaviness, likeliest_scale(sizes, known, heaviness));
    weights.push_back(log_likelihood(sizes, known, heaviness, heaviness_and_scale.back().second));
  }
  const double best = *std::max_element(weights.begin(), weights.end());
  double lower = sizes.front() * 1e-3;
  double upper = sizes.back() * 1e6;
  for (int i = 0; i < 60; ++i) {
    const double middle = std::sqrt(lower * upper);
    double chance = 0.0;
    double total = 0.0;
    for (std::size_t k = 0; k < weights.size(); ++k) {
      const auto& [heaviness, scale] = heaviness_and_scale[k];
      chance += std::exp(weights[k] - best) * chance_beyond(middle / scale, heaviness);
      total += std::exp(weights[k] - best);
    }
    (chance / total > 0.005 / static_cast<double>(sizes.size()) ? lower : upper) = middle;
  }
  return upper;
}

double expected_limit(std::vector<double> sizes) {
  std::sort(sizes.begin(), sizes.end());
  auto unknown = std::max<std::size_t>(10, sizes.size() * 8 / 100);
  for (;;) {
    const double limit = limit_of_known(sizes, sizes.size() - unknown);
    unknown /= 2;
    if (unknown == 0 || sizes[sizes.size() - unknown - 1] > limit) {
      return limit;
    }
  }
}

/// Student's t of so many degrees of freedom, normal values where that is 0.
std::vector<double> drawn_sizes(std::size_t count, int degrees, std::uint64_t seed) {
  Random random(seed);
  std::vector<double> sizes;
  for (std::size_t i = 0; i < count; ++i) {
    double squares = 0.0;
    for (int k = 0; k < degrees; ++k) {
      squares += std::pow(random.normal(), 2);
    }
    sizes.push_back(1e-4 * std::abs(random.normal()) / (degrees == 0 ? 1.0 : std::sqrt(squares / degrees)));
  }
  return sizes;
}

void expect_limit(const std::vector<double>& sizes, const char* what) {
  const double expected = expected_limit(sizes);
  EXPECT_NEAR(limit_of_heavy_tails(sizes) / expected, 1.0, 4e-4) << what << ", " << sizes.size() << " values";
}

TEST(HeavyTails, LimitIsThatOfTheLikeliestStudentsTs) {
  for (const std::size_t count : {30U, 140U}) {
    for (const int degrees : {0, 2, 5}) {
      expect_limit(drawn_sizes(count, degrees, count + static_cast<std::uint64_t>(degrees)), "clean");
    }
  }
  expect_limit(drawn_sizes(2600, 5, 1), "so many that every other one counts");
}

// Some of which come back among the known values and some do not.
TEST(HeavyTails, LimitLeavesOutWhatIsLargerThanTheOthersLetExpect) {
  std::uint64_t seed = 20;
  for (const std::size_t defects : {1U, 3U, 6U, 12U}) {
    for (const double factor : {3.0, 10.0, 1000.0}) {
      std::vector<double> sizes = drawn_sizes(180, seed % 2 == 0 ? 6 : 0, seed);
      for (std::size_t i = 0; i < defects; ++i) {
        sizes[i * 7] = 1e-4 * factor * (1.0 + 0.1 * static_cast<double>(i));
      }
      expect_limit(sizes, "with defects");
      ++seed;
    }
  }
}

TEST(HeavyTails, LimitIsZeroWhereTooFewValuesTell) {
  EXPECT_EQ(limit_of_heavy_tails({}), 0.0);
  EXPECT_EQ(limit_of_heavy_tails(drawn_sizes(29, 0, 3)), 0.0);
  EXPECT_GT(limit_of_heavy_tails(drawn_sizes(30, 0, 3)), 1e-4);
  std::vector<double> half(40, 0.0);
  std::fill(half.begin(), half.begin() + 19, 1.0);  // fewer are not zero than are
  EXPECT_EQ(limit_of_heavy_tails(half), 0.0);
}

}  // namespace
}  // namespace kdl_calibration
