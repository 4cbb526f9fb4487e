#include "base/robust_statistics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "base/distributions.hpp"
#include "base/random.hpp"

namespace kdl_calibration::robust_statistics_test {
namespace {

using Eigen::Index;

std::vector<double> normal_values(int count, double sigma, Random& random) {
  std::vector<double> values;
  for (int i = 0; i < count; ++i) {
    values.push_back(sigma * random.normal());
  }
  return values;
}

TEST(RobustStatistics, MediansAreOfTheRowsAskedFor) {
  EXPECT_EQ(median({}), 0.0);
  EXPECT_EQ(median({3.0, -1.0, 2.0}), 2.0);
  EXPECT_EQ(median({4.0, 1.0, 3.0, 2.0}), 2.5);
  Eigen::MatrixXd values(5, 2);
  values << 9, 9, 1, 10, 2, 30, 3, 20, 9, 9;
  EXPECT_EQ(medians(values, 1, 4), Eigen::Vector2d(2.0, 20.0));
  EXPECT_EQ(medians(values, 3, 4), Eigen::Vector2d(3.0, 20.0));
}

TEST(RobustStatistics, SigmaIsThatOfNormalValues) {
  Random random(1);
  for (const double sigma : {1e-5, 1.0, 1e4}) {
    EXPECT_NEAR(robust_sigma(normal_values(200000, sigma, random)) / sigma, 1.0, 0.01);
  }
}

TEST(RobustStatistics, SigmaLeavesOutWhatIsBeyondThreeOfTheMediansSigma) {
  // Ten values with a median size of 1: three times 1.4826 are 4.4478.
  const std::vector<double> most = {0.2, -0.5, 0.8, -0.9, 1.0, 1.0, -1.2, 1.5, 2.0};
  double squares = 0.0;
  for (const double value : most) {
    squares += value * value;
  }
  const auto with = [&](double last) {
    std::vector<double> all = most;
    all.push_back(last);
    return robust_sigma(all);
  };
  EXPECT_NEAR(with(-4.447), std::sqrt((squares + 4.447 * 4.447) / 10.0) / 0.98658, 1e-9);
  for (const double beyond : {4.449, -20.0, 1e9}) {
    EXPECT_NEAR(with(beyond), std::sqrt(squares / 9.0) / 0.98658, 1e-9) << beyond;
  }
  EXPECT_EQ(robust_sigma({}), 0.0);
}

TEST(RobustStatistics, ScatterAllowsForWhatWasFitted) {
  const std::vector<double> values = {1.0, -1.0, 2.0, -2.0, 0.5, -0.5};
  const Scatter scatter = scatter_of(values, 2.0, 0.1);
  EXPECT_NEAR(scatter.sigma, robust_sigma(values) * std::sqrt(6.0 / 4.0), 1e-12);
  EXPECT_NEAR(scatter.freedom, 0.8 * 4.0, 1e-12);
  EXPECT_EQ(scatter_of(values, 2.0, 7.0).sigma, 7.0) << "the floor";
  EXPECT_EQ(scatter_of(values, 6.0, 0.1).sigma, std::numeric_limits<double>::infinity());
  EXPECT_EQ(scatter_of(values, 6.0, 0.1).freedom, 0.0);
}

TEST(RobustStatistics, TailsAreTheIntegralsOfTheirDensities) {
  for (const double t : {0.0, 0.3, 1.0, 2.5, 4.0}) {
    double one = 0.0;
    double three = 0.0;
    constexpr double kStep = 1e-4;
    for (int i = 0; i < 120000; ++i) {
      const double x = t + (i + 0.5) * kStep;
      const double normal = std::sqrt(2.0 / std::numbers::pi) * std::exp(-0.5 * x * x) * kStep;
      one += normal;
      three += x * x * normal;
    }
    EXPECT_NEAR(reduced_chi_squared_tail(t * t, 1.0), one, 1e-7) << t;
    EXPECT_NEAR(reduced_chi_squared_tail(t * t / 3.0, 3.0), three, 1e-7) << t;
  }
}

TEST(RobustStatistics, AThresholdIsExceededOnceInSoManyComparisons) {
  for (const Index axes : {1, 3}) {
    for (const double comparisons : {1.0, 40.0, 1000.0}) {
      const double limit = threshold(1e-3, comparisons, axes, 1e12);
      const auto freedom = static_cast<double>(axes);
      EXPECT_NEAR(comparisons * reduced_chi_squared_tail(limit * limit / freedom, freedom) / 1e-3, 1.0, 1e-4)
          << axes << ", " << comparisons;
    }
  }
  EXPECT_EQ(threshold(1e-3, 0.0, 1, 1e12), threshold(1e-3, 1.0, 1, 1e12));
  EXPECT_NEAR(threshold(5.0, 1.0, 1, 1e12), 0.0, 1e-6) << "a probability above one";
  // Two-sided quantiles of Student's t from a table; Wallace's approximation is good to a percent of them.
  EXPECT_NEAR(threshold(0.05, 1.0, 1, 5.0) / 2.5706, 1.0, 0.01);
  EXPECT_NEAR(threshold(0.01, 1.0, 1, 10.0) / 3.1693, 1.0, 0.01);
  EXPECT_NEAR(threshold(0.01, 10.0, 1, 20.0) / 3.8495, 1.0, 0.01);
  EXPECT_EQ(threshold(0.05, 1.0, 1, 0.2), threshold(0.05, 1.0, 1, 1.0));
}

}  // namespace
}  // namespace kdl_calibration::robust_statistics_test
