#include "screening/change_points.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>

#include "base/random.hpp"

namespace kdl_calibration::change_points_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

/// Configurations 3, 5, 7, … with noise of one, a step of this size in the middle, now and then a value that is far
/// off.
Series drawn(Index rows, Index axes, double step, Random& random) {
  Series series{.configurations = {}, .values = MatrixXd(rows, axes)};
  for (Index row = 0; row < rows; ++row) {
    series.configurations.push_back(static_cast<int>(2 * row + 3));
    for (Index axis = 0; axis < axes; ++axis) {
      const double off = random.uniform(0.0, 1.0) < 0.03 ? random.uniform(-60.0, 60.0) : 0.0;
      series.values(row, axis) = random.normal() + off + (row >= rows / 2 ? step : 0.0);
    }
  }
  return series;
}

TEST(ChangePoints, FindALargeStepAndHardlyEverOneInNoiseWithOutliers) {
  Random random(1);
  int false_alarms = 0;
  int found_where_it_is = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Index rows = 24 + trial % 20;
    const Index axes = trial % 2 == 0 ? 3 : 1;
    const std::vector<Levels> found =
        find_levels({drawn(rows, axes, 0.0, random), drawn(rows, axes, 20.0, random)}, 4.0, 1.0, {});
    ASSERT_EQ(found.size(), 2U);
    false_alarms += found[0].starts.empty() ? 0 : 1;
    const auto middle = static_cast<int>(2 * (rows / 2) + 3);
    found_where_it_is += std::any_of(found[1].starts.begin(), found[1].starts.end(),
                                     [&](int start) { return std::abs(start - middle) <= 2; })
                             ? 1
                             : 0;
  }
  EXPECT_LE(false_alarms, 4) << "of 200";
  EXPECT_GE(found_where_it_is, 190) << "of 200";
}

TEST(ChangePoints, DoNotDependOnUnitAndOrigin) {
  Random random(2);
  for (int trial = 0; trial < 50; ++trial) {
    const Series series = drawn(24, 3, 6.0, random);
    Series other = series;
    other.values.array() = 1e-5 * series.values.array() + 0.7;
    const Levels found = find_levels({series}, 3.0, 1.0, {})[0];
    const Levels scaled = find_levels({other}, 3.0, 1.0, {})[0];
    ASSERT_EQ(scaled.starts, found.starts) << trial;
    for (std::size_t level = 0; level < found.values.size(); ++level) {
      EXPECT_LT((1e5 * (scaled.values[level].array() - 0.7) - found.values[level].array()).abs().maxCoeff(), 1e-9);
    }
  }
}

// ---- exact values --------------------------------------------------------------------------------------------------

Series of_values(const std::vector<double>& values) {
  Series series{.configurations = {}, .values = Eigen::Map<const VectorXd>(values.data(), Index(values.size()))};
  for (std::size_t i = 0; i < values.size(); ++i) {
    series.configurations.push_back(static_cast<int>(i));
  }
  return series;
}

TEST(ChangePoints, AValueHalfwayBelongsToTheLaterLevel) {
  const Series halfway = of_values({0, 0, 0, 0, 0, 0, 0.5, 1, 1, 1, 1, 1, 1});
  EXPECT_THAT(find_levels({halfway}, 0.0, 1.0, {})[0].starts, ElementsAre(6));
}

TEST(ChangePoints, NeedTenValuesAndThreeOnEitherSide) {
  // Zeros and ones with a little noise.
  const auto starts = [](int zeros, int ones, int segment = 3) {
    std::vector<double> values;
    for (int i = 0; i < zeros + ones; ++i) {
      values.push_back((i < zeros ? 0.0 : 1.0) + 0.01 * std::sin(5.0 * i));
    }
    return find_levels({of_values(values)}, 0.0, 1.0, {.false_alarm = 0.3, .segment = segment})[0].starts;
  };
  EXPECT_THAT(starts(6, 3), IsEmpty());
  EXPECT_THAT(starts(7, 3), ElementsAre(7));
  EXPECT_THAT(starts(3, 7), ElementsAre(3));
  EXPECT_THAT(starts(10, 2, 2), ElementsAre(10));
  EXPECT_THAT(starts(2, 10, 2), ElementsAre(2));
  EXPECT_THAT(starts(10, 1, 0), ElementsAre(10));
  EXPECT_THAT(starts(6, 5, 6), IsEmpty());
  EXPECT_THAT(starts(6, 6, 6), ElementsAre(6));
}

TEST(ChangePoints, TellTheLevelOfAConfigurationFromItsStartOn) {
  const Levels levels{.starts = {4, 9},
                      .last_before = {3, 8},
                      .values = {VectorXd::Constant(1, 1.0), VectorXd::Constant(1, 2.0), VectorXd::Constant(1, 3.0)}};
  const std::map<int, double> expected = {{-1, 1.0}, {3, 1.0}, {4, 2.0}, {8, 2.0}, {9, 3.0}, {20, 3.0}};
  for (const auto& [configuration, value] : expected) {
    EXPECT_EQ(levels.at(configuration)[0], value) << "configuration " << configuration;
  }
}

// ---- series --------------------------------------------------------------------------------------------------------

TEST(ChangePoints, ASeriesHasTheMedianOfEachConfigurationsRepeatsInAnyOrder) {
  const Repeats repeats{.configurations = {7, 2, 7, 7}, .values = {1.0, 10.0, 5.0, 50.0, 9.0, 20.0, 2.0, 30.0}};
  const Series series = series_of(repeats, 2);
  EXPECT_THAT(series.configurations, ElementsAre(2, 7));
  EXPECT_EQ(series.values, (MatrixXd(2, 2) << 5.0, 50.0, 2.0, 20.0).finished());
  EXPECT_EQ(series_of({}, 2).values.rows(), 0);
}

}  // namespace
}  // namespace kdl_calibration::change_points_test
