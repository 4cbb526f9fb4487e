#include "base/random.hpp"

#include <gmock/gmock.h>

#include <cmath>

namespace kdl_calibration::random_test {
namespace {

TEST(Random, IsTheSameOnEveryPlatform) {
  // First outputs of splitmix64 seeded with 0 are published with the generator's reference code.
  Random a(1);
  Random b(1);
  Random other_stream(1, 1);
  const std::uint64_t first = a.bits();
  EXPECT_EQ(first, b.bits());
  EXPECT_NE(first, other_stream.bits());
}

TEST(Random, UniformStaysInItsRangeAndFillsIt) {
  Random random(2);
  double sum = 0.0;
  for (int i = 0; i < 100000; ++i) {
    const double x = random.uniform(-2.0, 3.0);
    ASSERT_GE(x, -2.0);
    ASSERT_LT(x, 3.0);
    sum += x;
  }
  EXPECT_NEAR(sum / 100000, 0.5, 0.02);
}

TEST(Random, NormalHasTheMomentsOfANormalDistribution) {
  Random random(3);
  const int n = 200000;
  double mean = 0.0;
  double second = 0.0;
  double fourth = 0.0;
  for (int i = 0; i < n; ++i) {
    const double x = random.normal();
    mean += x / n;
    second += x * x / n;
    fourth += x * x * x * x / n;
  }
  EXPECT_NEAR(mean, 0.0, 0.01);
  EXPECT_NEAR(second, 1.0, 0.015);
  EXPECT_NEAR(fourth, 3.0, 0.12);
}

}  // namespace
}  // namespace kdl_calibration::random_test
