#include "kdl_calibration/lack_of_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "kdl_calibration/identification.hpp"
#include "record.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using testing::VirtualExperiment;

struct Sort {
  std::string name;
  int repeats = 2;
  double common = 0.0;  // [m] of a repeat
};

const std::vector<Sort>& sorts() {
  static const std::vector<Sort> all = {{"2 repeats", 2},
                                        {"3 repeats", 3},
                                        {"10 repeats", 10},
                                        {"2 repeats, common", 2, 4e-5},
                                        {"3 repeats, common", 3, 4e-5},
                                        {"10 repeats, common", 10, 4e-5}};
  return all;
}

struct Alarms {
  double of_twenty = 0.0;    // share of p-values below 0.05
  double of_thousand = 0.0;  // below 0.001
  double mean = 0.0;         // of the p-values
};

// Of arms that the model describes: 30 configurations, three targets.
Alarms false_alarms(const Sort& sort, int runs) {
  VirtualExperiment experiment;
  Alarms result;
  for (int run = 0; run < runs; ++run) {
    experiment.restart(Random(41, static_cast<std::uint64_t>(run)));
    const Measurements measured = testing::without_sigmas(experiment.measure(
        30, {.sigma = 1e-5, .repeats = sort.repeats, .common = Eigen::Vector3d::Constant(sort.common)}));
    const Identification fit = identify_jointly(experiment.model, measured, experiment.robot.truth, experiment.free);
    const double p = test_lack_of_fit(experiment.model, measured, fit.estimate, experiment.free).value().p_value;
    result.of_twenty += (p < 0.05 ? 1.0 : 0.0) / runs;
    result.of_thousand += (p < 0.001 ? 1.0 : 0.0) / runs;
    result.mean += p / runs;
  }
  return result;
}

// `sigmas` of the share that many runs scatter by.
void expect_as_many_alarms_as_stated(int runs, double sigmas) {
  for (const Sort& sort : sorts()) {
    const Alarms found = false_alarms(sort, runs);
    testing::record(sort.name + ", share below 0.05", found.of_twenty);
    testing::record(sort.name + ", share below 0.001", found.of_thousand);
    testing::record(sort.name + ", mean p", found.mean);
    EXPECT_NEAR(found.of_twenty, 0.05, 0.01 + sigmas * std::sqrt(0.05 * 0.95 / runs)) << sort.name;
    EXPECT_LE(found.of_thousand, 0.002 + sigmas * std::sqrt(0.001 / runs)) << sort.name;
    EXPECT_NEAR(found.mean, 0.5, 0.02 + sigmas * std::sqrt(1.0 / 12.0 / runs)) << sort.name;
  }
}

TEST(LackOfFit, IsFalselyFoundAsOftenAsItSays) { expect_as_many_alarms_as_stated(60, 2.5); }

TEST(LackOfFitCampaign, IsFalselyFoundAsOftenAsItSays) { expect_as_many_alarms_as_stated(5000, 0.0); }

// Three configurations of one target give nine coordinates, and base and target take them all.
TEST(LackOfFit, IsNotAskedWhereTheMeansLeaveNoFreedom) {
  VirtualExperiment experiment({.targets = published_targets(1)});
  std::vector<std::string> names = experiment.free.names();
  std::erase_if(names, [](const std::string& name) { return !name.starts_with("base.") && !name.starts_with("A."); });
  const Unknowns free(experiment.model, experiment.targets, names);
  ASSERT_EQ(free.size(), 9);
  const auto tested = [&](int configurations) {
    const Measurements measured =
        testing::without_sigmas(experiment.measure(configurations, {.sigma = 1e-5, .repeats = 5}));
    return test_lack_of_fit(experiment.model, measured, experiment.robot.truth, free);
  };
  EXPECT_FALSE(tested(2).has_value());
  EXPECT_FALSE(tested(3).has_value());
  const auto four = tested(4);
  ASSERT_TRUE(four.has_value());
  EXPECT_NEAR(four->degrees_of_freedom, 3.0, 1e-6);
}

TEST(LackOfFit, IsTestedWhereNothingIsFree) {
  VirtualExperiment experiment;
  const Unknowns none(experiment.model, experiment.targets, {});
  const Measurements measured = testing::without_sigmas(experiment.measure(20, {.sigma = 1e-5, .repeats = 3}));
  const LackOfFit right = test_lack_of_fit(experiment.model, measured, experiment.robot.truth, none).value();
  EXPECT_NEAR(right.degrees_of_freedom, 180.0, 1e-9);
  EXPECT_GT(right.p_value, 0.01);
  Estimate off = experiment.robot.truth;
  off.X_WB.translation().x() += 5e-5;
  EXPECT_LT(test_lack_of_fit(experiment.model, measured, off, none).value().p_value, 1e-9);
}

TEST(LackOfFit, NeedsRepeats) {
  VirtualExperiment experiment;
  const Measurements measured = experiment.measure(20, {.sigma = 1e-5});
  EXPECT_FALSE(test_lack_of_fit(experiment.model, measured, experiment.robot.truth, experiment.free).has_value());
}

}  // namespace
}  // namespace kdl_calibration
