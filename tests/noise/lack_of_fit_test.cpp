#include "noise/lack_of_fit.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "estimation/identification.hpp"
#include "model/kinematics.hpp"
#include "noise/noise_strata.hpp"
#include "record.hpp"
#include "robot/joint_ranges.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::lack_of_fit_test {
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

TEST(LackOfFitLongRun, IsFalselyFoundAsOftenAsItSays) { expect_as_many_alarms_as_stated(400, 2.5); }

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

using Eigen::Vector3d;

/// Every target in every repeat of a configuration, which has more repeats or less.
struct Trial {
  VirtualExperiment experiment;
  std::vector<int> repeats;  // of each configuration
  Measurements measured;
  Unknowns free;
  Estimate estimate;

  Trial(int targets, std::vector<int> of_configurations, const std::vector<std::string>& names, double misfit)
      : experiment({.targets = published_targets(targets)}),
        repeats(std::move(of_configurations)),
        measured(experiment.measure(static_cast<int>(repeats.size()),
                                    {.sigma = 1e-5, .repeats = 6, .common = Vector3d(2e-5, 0.0, 1e-5)})),
        free(experiment.model, experiment.targets, names),
        estimate(experiment.robot.truth) {
    measured = subset(
        measured, [&](const Observation& o) { return o.repeat <= repeats[static_cast<std::size_t>(o.configuration)]; });
    Random random(7);
    std::map<int, Vector3d> of_configuration;
    for (Observation& o : measured.observations) {
      const Vector3d drawn{random.normal(), random.normal(), random.normal()};
      o.position() += misfit * of_configuration.try_emplace(o.configuration, drawn).first->second;
    }
    estimate.frames.base().translation() += Vector3d(1e-4, -5e-5, 2e-5);
  }

  std::optional<LackOfFit> tested() const { return test_lack_of_fit(experiment.model, measured, estimate, free); }
};

// One target, as many repeats everywhere, nothing free: the textbook's one-way analysis of variance of each axis, which
// have their own variances.
TEST(LackOfFit, OfOneTargetIsTheTextbooksF) {
  constexpr int kCount = 12;
  constexpr int kRepeats = 4;
  for (const double misfit : {0.0, 1e-5}) {
    const Trial trial(1, std::vector<int>(kCount, kRepeats), {}, misfit);
    const auto X_BF = flange_poses(trial.experiment.model, trial.estimate, trial.measured.joint_values);
    Eigen::Array3d between = Eigen::Array3d::Zero();
    Eigen::Array3d within = Eigen::Array3d::Zero();
    for (int c = 0; c < kCount; ++c) {
      Eigen::Matrix3Xd e(3, 0);
      for (const Observation& o : trial.measured.observations) {
        if (o.configuration == c) {
          e.conservativeResize(3, e.cols() + 1);
          e.rightCols<1>() = o.position() - predicted_point(trial.estimate, X_BF, o);
        }
      }
      ASSERT_EQ(e.cols(), kRepeats);
      between += kRepeats * e.rowwise().mean().array().square();
      within += (e.colwise() - e.rowwise().mean()).rowwise().squaredNorm().array();
    }
    const Eigen::Array3d f = (between / kCount) / (within / (kCount * (kRepeats - 1)));
    const LackOfFit found = trial.tested().value();
    EXPECT_NEAR(found.f / f.mean(), 1.0, 1e-7) << misfit;
    EXPECT_NEAR(found.degrees_of_freedom, 3.0 * kCount, 1e-7);
    EXPECT_NEAR(found.repeat_degrees_of_freedom, 3.0 * kCount * (kRepeats - 1), 1e-9);
    EXPECT_TRUE(found.explained_by_joint.empty());
  }
}

TEST(LackOfFit, FindsAMisfitAsLargeAsTheNoiseInUnequalRepeats) {
  const std::vector<std::string> base = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz"};
  std::vector<int> repeats;
  for (int c = 0; c < 40; ++c) {
    repeats.push_back(1 + c % 4);
  }
  for (const int targets : {1, 3}) {
    EXPECT_LT(Trial(targets, repeats, base, 6e-5).tested().value().p_value, 1e-6) << targets;
    EXPECT_GT(Trial(targets, repeats, base, 0.0).tested().value().p_value, 1e-3) << targets;
  }
}

TEST(LackOfFit, LooksAtTrainingRowsAloneAndAtNoSigma) {
  Trial trial(3, {2, 4, 2, 4, 3, 4}, {"base.Tx", "base.Ty", "A.x"}, 1e-5);
  const LackOfFit before = trial.tested().value();
  Measurements& measured = trial.measured;
  for (std::size_t row = 0; row < measured.observations.size(); ++row) {
    measured.observations[row].sigma = row % 3 == 0 ? 1e-3 : 1e-6;
  }
  Observation held_out = measured.observations[4];
  held_out.split = Split::test;
  held_out.repeat = 9;
  held_out.position().x() += 1.0;
  measured.observations.insert(measured.observations.begin(), held_out);
  const LackOfFit after = trial.tested().value();
  EXPECT_EQ(after.f, before.f);
  EXPECT_EQ(after.p_value, before.p_value);
  EXPECT_EQ(after.repeat_degrees_of_freedom, before.repeat_degrees_of_freedom);
}

TEST(LackOfFit, OfManyConfigurationsIsThatOfASample) {
  const Trial trial(1, std::vector<int>(2100, 2), {"base.Tx"}, 1e-6);
  const NoiseSample sample = sampled(trial.measured, {});
  ASSERT_EQ(sample.measurements.joint_values.cols(), 2000);
  const LackOfFit expected =
      test_lack_of_fit(trial.experiment.model, sample.measurements, trial.estimate, trial.free).value();
  EXPECT_EQ(trial.tested().value().f, expected.f);
  EXPECT_EQ(trial.tested().value().repeat_degrees_of_freedom, 3.0 * 2000.0);
}

TEST(LackOfFit, ResidualsOfOneJointAreExplainedByIt) {
  VirtualExperiment experiment = VirtualExperiment({.ranges = published_ranges, .random = Random(11)});
  Measurements measured = experiment.measure(60, {.sigma = 1e-6});
  for (Observation& o : measured.observations) {
    const double q = measured.joint_values(3, o.configuration);
    o.position() += Eigen::Vector3d(0.0001 * std::sin(q), -0.0002 * std::cos(q), 0.00005);
  }
  const std::vector<double> explained = explained_by_joints(experiment.model, experiment.robot.truth, measured);
  ASSERT_EQ(explained.size(), 6U);
  EXPECT_GT(explained[3], 0.999);
  for (const std::size_t other : {0U, 1U, 2U, 4U, 5U}) {
    EXPECT_GT(explained[other], 0.0);
    EXPECT_LT(explained[other], 0.9);
  }
}

TEST(LackOfFit, NothingIsExplainedWhereNothingIsLeft) {
  Trial trial(3, std::vector<int>(8, 1), {}, 0.0);
  const auto X_BF = flange_poses(trial.experiment.model, trial.estimate, trial.measured);
  for (Observation& o : trial.measured.observations) {
    o.position() = predicted_point(trial.estimate, X_BF, o);
  }
  EXPECT_EQ(explained_by_joints(trial.experiment.model, trial.estimate, trial.measured), std::vector<double>(6, 0.0));
}

}  // namespace
}  // namespace kdl_calibration::lack_of_fit_test
