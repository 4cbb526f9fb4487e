#include "base/distributions.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace kdl_calibration::distributions_test {
namespace {

TEST(FDistribution, UpperTailHasItsClosedFormAndItsSymmetry) {
  for (const double n : {1.0, 2.0, 5.0, 30.0}) {
    for (const double f : {0.01, 0.3, 1.0, 3.0, 50.0}) {
      // With two degrees of freedom in the numerator the integral has a closed form.
      EXPECT_NEAR(f_upper_tail(f, 2.0, n), std::pow(1.0 + 2.0 * f / n, -0.5 * n), 1e-12) << f << ", " << n;
      EXPECT_NEAR(f_upper_tail(f, 7.0, n) + f_upper_tail(1.0 / f, n, 7.0), 1.0, 1e-12) << f << ", " << n;
    }
  }
}

TEST(FDistribution, CriticalValuesHaveTheirTail) {
  for (const double tail : {0.9, 0.5, 0.05, 1e-3, 1e-6}) {
    for (const double n : {1.0, 2.0, 5.0, 237.0}) {
      const double expected = 0.5 * n * (std::pow(tail, -2.0 / n) - 1.0);  // as above
      EXPECT_NEAR(f_critical(tail, 2.0, n) / expected, 1.0, 1e-9) << tail << ", " << n;
      EXPECT_NEAR(f_upper_tail(f_critical(tail, 2.6, n), 2.6, n) / tail, 1.0, 1e-9) << tail << ", " << n;
    }
  }
  EXPECT_NEAR(f_critical(0.5, 3.0, 3.0), 1.0, 1e-12);  // symmetry
  EXPECT_NEAR(t_critical_95(3.0), 3.182446, 1e-6);     // printed tables
}

TEST(FDistribution, TailIsThatOfTheTables) {
  // Quantiles from printed tables of the F distribution.
  EXPECT_NEAR(f_upper_tail(4.9646, 1, 10), 0.05, 1e-5);
  EXPECT_NEAR(f_upper_tail(2.9782, 10, 10), 0.05, 1e-5);
  EXPECT_NEAR(f_upper_tail(3.8415, 1, 1e7), 0.05, 1e-5);
  EXPECT_NEAR(f_upper_tail(1.0, 7, 7), 0.5, 1e-12);  // symmetry
  EXPECT_EQ(f_upper_tail(0.0, 3, 5), 1.0);
  EXPECT_LT(f_upper_tail(50.0, 100, 100), 1e-30);
  EXPECT_EQ(f_upper_tail(std::numeric_limits<double>::infinity(), 3, 5), 0.0);
}

// With four degrees of freedom the tail of chi-squared is exp(-x/2) (1 + x/2).
// Against the sum of the probabilities of each number.
TEST(Binomial, UpperTailIsTheSumOfItsTerms) {
  for (const int trials : {1, 3, 12, 40}) {
    double sum = 1.0;
    for (int least = 0; least <= trials; ++least) {
      EXPECT_NEAR(binomial_upper_tail(least, trials, 0.05) / sum, 1.0, 1e-9) << least << " of " << trials;
      sum = 0.0;
      double other = std::pow(0.95, trials);
      for (int k = 0; k <= trials; ++k) {
        sum += k > least ? other : 0.0;
        other *= 0.05 / 0.95 * (trials - k) / (k + 1.0);
      }
    }
    EXPECT_EQ(binomial_upper_tail(trials + 1, trials, 0.05), 0.0);
  }
  EXPECT_EQ(binomial_upper_tail(0, 0, 0.05), 1.0);
}

// Baarda (1968): 17.075 for one condition, a level of 0.1 % and a power of 80 %.
TEST(ChiSquared, NonCentralityIsThatOfBaardasTable) {
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_NEAR(non_centrality(0.001, 0.8, 1.0, infinity), 17.075, 1e-3);
  EXPECT_NEAR(non_centrality(0.05, 0.5, 1.0, infinity), 1.96 * 1.96, 2e-2);  // half of a normal value beyond its limit
  EXPECT_GT(non_centrality(0.001, 0.8, 6.0, infinity), non_centrality(0.001, 0.8, 1.0, infinity));
  EXPECT_GT(non_centrality(0.001, 0.8, 1.0, 10.0), non_centrality(0.001, 0.8, 1.0, infinity));
  const double limit = f_critical(1e-8, 1.0, 1.0);
  EXPECT_NEAR(std::sqrt(non_centrality(1e-8, 0.8, 1.0, 1.0)) / (std::sqrt(limit) + 0.8416), 1.0, 1e-9);
}

// Against all orders of a few values.
TEST(RankSum, TailIsTheShareOfOrdersThatAreAsUnequal) {
  const std::vector<double> values = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
  const auto pairs = [&](unsigned chosen) {
    int count = 0;
    for (unsigned i = 0; i < values.size(); ++i) {
      for (unsigned j = 0; j < i; ++j) {
        count += ((chosen >> i) & 1U) != 0 && ((chosen >> j) & 1U) == 0 ? 1 : 0;
      }
    }
    return count;
  };
  for (const unsigned first : {0b11111000000U, 0b11010010100U, 0b00101010101U}) {
    std::vector<double> one;
    std::vector<double> other;
    for (unsigned i = 0; i < values.size(); ++i) {
      (((first >> i) & 1U) != 0 ? one : other).push_back(values[i]);
    }
    double as_unequal = 0.0;
    double orders = 0.0;
    for (unsigned chosen = 0; chosen < (1U << values.size()); ++chosen) {
      if (std::popcount(chosen) == std::popcount(first)) {
        orders += 1.0;
        as_unequal += pairs(chosen) > pairs(first) ? 1.0 : pairs(chosen) == pairs(first) ? 0.5 : 0.0;
      }
    }
    EXPECT_NEAR(rank_sum_upper_tail(one, other), as_unequal / orders, 0.01);
  }
  EXPECT_EQ(rank_sum_upper_tail({}, values), 1.0);
}

TEST(ChiSquared, TailHasItsClosedFormAlsoAsTheLimitOfF) {
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double x : {0.1, 2.0, 9.4877, 40.0}) {
    const double tail = std::exp(-0.5 * x) * (1.0 + 0.5 * x);
    EXPECT_NEAR(reduced_chi_squared_tail(x / 4.0, 4.0) / tail, 1.0, 1e-12) << x;
    EXPECT_NEAR(f_upper_tail(x / 4.0, 4.0, infinity) / tail, 1.0, 1e-12) << x;
    EXPECT_NEAR(f_critical(tail, 4.0, infinity) / (x / 4.0), 1.0, 1e-12) << x;
  }
  EXPECT_EQ(reduced_chi_squared_tail(infinity, 4.0), 0.0);
  EXPECT_EQ(reduced_chi_squared_tail(0.0, 4.0), 1.0);
}

// The sum of many squares is normal: by the cube root of Wilson and Hilferty, to a few parts in the degrees of freedom.
TEST(ChiSquared, TailHoldsAtAMillionDegreesOfFreedom) {
  constexpr double kFreedom = 1e6;
  constexpr double kPart = 2.0 / (9.0 * kFreedom);
  for (const double z : {-2.0, 0.0, 1.0, 3.0}) {
    const double ratio = std::pow(1.0 - kPart + z * std::sqrt(kPart), 3.0);
    EXPECT_NEAR(reduced_chi_squared_tail(ratio, kFreedom), 0.5 * std::erfc(z / std::sqrt(2.0)), 1e-6) << z;
  }
}
// Table G.2 of the GUM, JCGM 100:2008, column 95.45 %.
TEST(Distributions, CoverageFactorsAreThoseOfTheGum) {
  for (const auto& [freedom, k] : std::vector<std::pair<double, double>>{
           {1, 13.97}, {2, 4.53}, {3, 3.31}, {5, 2.65}, {10, 2.28}, {20, 2.13}, {50, 2.05}, {100, 2.025}}) {
    EXPECT_NEAR(coverage_factor(freedom), k, 0.0051) << freedom;
  }
  EXPECT_NEAR(coverage_factor(std::numeric_limits<double>::infinity()), 2.0, 1e-9);
}

}  // namespace
}  // namespace kdl_calibration::distributions_test
