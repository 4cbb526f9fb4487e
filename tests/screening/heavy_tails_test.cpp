#include "screening/heavy_tails.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/random.hpp"

namespace kdl_calibration::heavy_tails_test {
namespace {

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

// One in two hundred is what the limit is made for.
TEST(HeavyTails, HardlyASetHasAValueBeyondTheLimit) {
  for (const int degrees : {0, 5, 10}) {
    int sets = 0;
    for (std::uint64_t seed = 1; seed <= 200; ++seed) {
      const std::vector<double> sizes = drawn_sizes(140, degrees, seed);
      sets += *std::max_element(sizes.begin(), sizes.end()) > limit_of_heavy_tails(sizes) ? 1 : 0;
    }
    EXPECT_LE(sets, 6) << "of 200, degrees of freedom: " << degrees;
  }
}

TEST(HeavyTails, LimitIsHigherTheHeavierTheTailsAndKeepsTheUnit) {
  double before = 0.0;
  for (const int degrees : {0, 5, 2}) {
    std::vector<double> sizes = drawn_sizes(2600, degrees, 1);
    const double limit = limit_of_heavy_tails(sizes);
    EXPECT_GT(limit, before) << degrees;
    before = limit;
    for (double& size : sizes) {
      size *= 1e3;
    }
    EXPECT_NEAR(limit_of_heavy_tails(sizes) / limit, 1e3, 1.0) << degrees;
  }
}

TEST(HeavyTails, DefectsStayFarBeyondTheLimit) {
  for (const std::size_t defects : {1U, 3U, 6U, 12U}) {
    for (std::uint64_t seed = 20; seed < 40; ++seed) {
      std::vector<double> sizes = drawn_sizes(180, 0, seed);
      const double clean = limit_of_heavy_tails(sizes);
      for (std::size_t i = 0; i < defects; ++i) {
        sizes[i * 7] = 0.1 * (1.0 + 0.1 * static_cast<double>(i));
      }
      const double limit = limit_of_heavy_tails(sizes);
      EXPECT_LT(limit, 0.01) << defects << ", seed " << seed;
      EXPECT_LT(limit / clean, 10.0) << defects << ", seed " << seed;
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
}  // namespace kdl_calibration::heavy_tails_test
