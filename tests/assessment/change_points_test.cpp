#include "assessment/change_points.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "base/robust_statistics.hpp"
#include "kdl_calibration/random.hpp"
#include "onset.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using testing::onset;

// ---- the search written out ----------------------------------------------------------------------------------------

/// Binary segmentation with every mean and every sum of deviations found anew.
class SlowSearch {
public:
  SlowSearch(const std::vector<Series>& all, double fitted, double independent, const QualityOptions& options)
      : options_(options), shortest_(std::max(options.segment, 1)), fewest_(std::max<Index>(10, 2 * shortest_)) {
    std::vector<double> centred;
    double comparisons = 0.0;
    for (const Series& series : all) {
      const Index rows = series.values.rows();
      Index change = 0;
      if (rows >= fewest_) {
        change = largest_change(series.values, 0, rows).first;
        for (Index place = shortest_; place <= rows - shortest_; ++place) {
          comparisons += 1.0;
        }
      }
      fitted += static_cast<double>(series.values.cols()) * ((change > 0 ? 1.0 : 0.0) + (change < rows ? 1.0 : 0.0));
      for (Index row = 0; row < rows; ++row) {
        const VectorXd centre = row < change ? medians(series.values, 0, change) : medians(series.values, change, rows);
        for (Index axis = 0; axis < series.values.cols(); ++axis) {
          centred.push_back(series.values(row, axis) - centre[axis]);
        }
      }
    }
    const Scatter scatter = scatter_of(centred, fitted, options.noise_floor);
    sigma_ = scatter.sigma;
    freedom_ = independent * scatter.freedom;
    comparisons_ = comparisons;
  }

  /// Places of the changes of one series, ascending.
  std::vector<Index> changes(const Series& series) const {
    std::vector<Index> places;
    if (series.values.rows() >= fewest_) {
      find(series.values, 0, series.values.rows(), places);
    }
    std::sort(places.begin(), places.end());
    return places;
  }

private:
  std::pair<Index, double> largest_change(const MatrixXd& values, Index first, Index end) const {
    MatrixXd clipped = values;
    for (Index axis = 0; axis < values.cols(); ++axis) {
      const double centre = medians(values, first, end)[axis];
      std::vector<double> deviations;
      for (Index row = first; row < end; ++row) {
        deviations.push_back(values(row, axis) - centre);
      }
      const double reach = 5.0 * std::max({robust_sigma(deviations), sigma_, options_.noise_floor});
      for (Index row = first; row < end; ++row) {
        clipped(row, axis) = std::clamp(values(row, axis), centre - reach, centre + reach);
      }
    }
    std::pair<Index, double> best = {first, 0.0};
    for (Index place = first + shortest_; place <= end - shortest_; ++place) {
      const VectorXd before = clipped.middleRows(first, place - first).colwise().mean();
      const VectorXd after = clipped.middleRows(place, end - place).colwise().mean();
      const double weight = 1.0 / (1.0 / static_cast<double>(place - first) + 1.0 / static_cast<double>(end - place));
      const double statistic = std::sqrt(weight) * (after - before).norm();
      if (statistic > best.second) {
        best = {place, statistic};
      }
    }
    return best;
  }

  void find(const MatrixXd& values, Index first, Index end, std::vector<Index>& places) const {
    const auto [change, statistic] = largest_change(values, first, end);
    const double limit = threshold(options_.false_alarm, comparisons_, values.cols(), freedom_);
    if (end - first < 2 * shortest_ || !(statistic > limit * sigma_)) {
      return;
    }
    const VectorXd before = medians(values, first, change);
    const VectorXd after = medians(values, change, end);
    Index located = change;
    double smallest = std::numeric_limits<double>::infinity();
    for (Index place = first + shortest_; place <= end - shortest_; ++place) {
      double sum = 0.0;
      for (Index row = first; row < end; ++row) {
        sum += (values.row(row).transpose() - (row < place ? before : after)).cwiseAbs().sum();
      }
      if (sum < smallest) {
        smallest = sum;
        located = place;
      }
    }
    if ((medians(values, located, end) - medians(values, first, located)).norm() > options_.smallest_slip * sigma_) {
      places.push_back(located);
      find(values, first, located, places);
      find(values, located, end, places);
    }
  }

  const QualityOptions& options_;
  Index shortest_ = 1;
  Index fewest_ = 10;
  double sigma_ = 0.0;  // none yet while the scatter is looked for
  double freedom_ = 0.0;
  double comparisons_ = 0.0;
};

/// Configurations 3, 5, 7, … with noise of one and steps of this size; now and then a value that is far off.
Series drawn(Index rows, Index axes, double step, Random& random) {
  Series series{.configurations = {}, .values = MatrixXd(rows, axes)};
  const auto first = static_cast<Index>(random.uniform(0.2, 0.5) * static_cast<double>(rows));
  const auto second = static_cast<Index>(random.uniform(0.5, 1.3) * static_cast<double>(rows));
  for (Index row = 0; row < rows; ++row) {
    series.configurations.push_back(static_cast<int>(2 * row + 3));
    for (Index axis = 0; axis < axes; ++axis) {
      const double off = random.uniform(0.0, 1.0) < 0.03 ? random.uniform(-60.0, 60.0) : 0.0;
      series.values(row, axis) = random.normal() + off + (axis == 0 && row >= first ? step : 0.0) +
                                 (axis + 1 == axes && row >= second ? -1.5 * step : 0.0);
    }
  }
  return series;
}

void expect_levels(const std::vector<Levels>& found, const std::vector<Series>& all, const SlowSearch& search,
                   const std::string& where) {
  ASSERT_EQ(found.size(), all.size()) << where;
  for (std::size_t s = 0; s < all.size(); ++s) {
    std::vector<Index> bounds = search.changes(all[s]);
    std::vector<int> starts;
    std::vector<int> last_before;
    for (const Index change : bounds) {
      starts.push_back(all[s].configurations[static_cast<std::size_t>(change)]);
      last_before.push_back(all[s].configurations[static_cast<std::size_t>(change) - 1]);
    }
    ASSERT_EQ(found[s].starts, starts) << where;
    EXPECT_EQ(found[s].last_before, last_before) << where;
    bounds.insert(bounds.begin(), 0);
    bounds.push_back(all[s].values.rows());
    ASSERT_EQ(found[s].values.size() + 1, bounds.size()) << where;
    for (std::size_t level = 0; level + 1 < bounds.size(); ++level) {
      EXPECT_EQ(found[s].values[level], medians(all[s].values, bounds[level], bounds[level + 1])) << where;
    }
  }
}

TEST(ChangePoints, LevelsAreThoseOfASearchWrittenOut) {
  Random random(1);
  std::size_t changes = 0;
  std::size_t unchanged = 0;
  for (int trial = 0; trial < 160; ++trial) {
    const QualityOptions options{.false_alarm = trial % 3 == 0 ? 1e-2 : 1e-6,
                                 .noise_floor = trial % 10 == 0 ? 1.5 : 1e-9,
                                 .smallest_slip = trial % 4 == 0 ? 1.0 : 3.0,
                                 .segment = trial % 8};
    const Index axes = trial % 2 == 0 ? 3 : 1;
    std::vector<Series> all;
    for (int s = 0; s <= trial % 3; ++s) {
      const auto rows = static_cast<Index>(random.uniform(1.0, 45.0));
      all.push_back(drawn(rows, axes, random.uniform(1.0, 7.0), random));
    }
    const double independent = trial % 5 == 0 ? 0.7 : 1.0;
    const SlowSearch search(all, 4.0, independent, options);
    const std::vector<Levels> found = find_levels(all, 4.0, independent, options);
    expect_levels(found, all, search, "trial " + std::to_string(trial));
    for (const Levels& levels : found) {
      changes += levels.starts.size();
      unchanged += levels.starts.empty() ? 1 : 0;
    }
  }
  EXPECT_GT(changes, 60U) << "no fair comparison";
  EXPECT_GT(unchanged, 60U) << "no fair comparison";
}

TEST(ChangePoints, AStepIsFoundFromTheSizeOnThatTheSearchWrittenOutSays) {
  Random random(2);
  for (int trial = 0; trial < 12; ++trial) {
    const Index rows = std::vector<Index>{10, 13, 22, 40}[static_cast<std::size_t>(trial % 4)];
    const QualityOptions options{.smallest_slip = trial % 4 == 3 ? 3.0 : 1.0, .segment = 2 + trial % 3};
    const std::vector<Series> quiet = {drawn(rows, 1, 0.0, random), drawn(11, 1, 0.0, random)};
    const auto stepped = [&](double step) {
      std::vector<Series> all = quiet;
      all[0].values.bottomRows(rows / 2).array() += step;
      return all;
    };
    const double found =
        onset(0.0, 40.0, [&](double step) { return !find_levels(stepped(step), 2.0, 0.8, options)[0].starts.empty(); });
    const double expected = onset(0.0, 40.0, [&](double step) {
      const std::vector<Series> all = stepped(step);
      return !SlowSearch(all, 2.0, 0.8, options).changes(all[0]).empty();
    });
    EXPECT_LT(expected, 39.0) << rows << " rows: no fair comparison";
    EXPECT_NEAR(found, expected, 1e-5) << rows << " rows";
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
  Random random(3);
  for (int trial = 0; trial < 20; ++trial) {
    Repeats repeats;
    std::map<int, std::vector<Eigen::Vector3d>> by_configuration;
    for (int i = 0; i < 2 * trial; ++i) {
      const auto configuration = static_cast<int>(random.uniform(0.0, 10.0));
      const Eigen::Vector3d value{random.normal(), random.normal(), random.normal()};
      repeats.configurations.push_back(configuration);
      repeats.values.insert(repeats.values.end(), value.begin(), value.end());
      by_configuration[configuration].push_back(value);
    }
    const Series series = series_of(repeats, 3);
    ASSERT_EQ(series.configurations.size(), by_configuration.size());
    ASSERT_EQ(series.values.rows(), static_cast<Index>(by_configuration.size()));
    Index row = 0;
    for (const auto& [configuration, values] : by_configuration) {
      EXPECT_EQ(series.configurations[static_cast<std::size_t>(row)], configuration);
      for (Index axis = 0; axis < 3; ++axis) {
        std::vector<double> of_axis;
        for (const Eigen::Vector3d& value : values) {
          of_axis.push_back(value[axis]);
        }
        EXPECT_EQ(series.values(row, axis), median(of_axis)) << configuration;
      }
      ++row;
    }
  }
}

}  // namespace
}  // namespace kdl_calibration
