#include "base/random.hpp"

#include <gmock/gmock.h>

namespace kdl_calibration::random_test {
namespace {

// By another program, whose splitmix64 gives the numbers that are published with the generator's reference code.
TEST(Random, IsTheSameOnEveryPlatform) {
  EXPECT_EQ(Random(0).bits(), 0x568a9b0b1a2c05ecULL);
  EXPECT_EQ(Random(1).bits(), 0x6ec85f1f8547bc0cULL);
  EXPECT_EQ(Random(1, 1).bits(), 0xb18a02f46d8d86c3ULL);
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
