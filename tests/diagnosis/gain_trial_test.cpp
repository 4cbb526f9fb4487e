#include "diagnosis/gain_trial.hpp"

#include <gtest/gtest.h>

#include "diagnosis/trial_fit.hpp"
#include "effects/effect_terms.hpp"
#include "mistake_table.hpp"

namespace kdl_calibration::gain_trial_test {
namespace {

using testing::light_arm;
using testing::Measured;
using testing::measured;

const Measured& of_light_arm() {
  static const Measured m = measured(light_arm(), 3);
  return m;
}

std::optional<GainTrial> tried(const Measured& m) {
  return try_gains(m.model, m.data, nominal_start(m.model, m.data), m.free);
}

TEST(GainTrial, TellsTheJointWithTheLargestGainAndHowManyOthersHaveOne) {
  Measured m = of_light_arm();
  m.data.joint_values.row(2) *= 0.9;
  m.data.joint_values.row(4) *= 1.02;
  m.data.joint_values.row(1) /= 1.013;
  m.data.joint_values.row(3) /= 1.007;
  const std::optional<GainTrial> found = tried(m);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->joint, 2U);
  EXPECT_NEAR(found->factor, 1.0 / 0.9, 1e-3);
  EXPECT_EQ(found->others, 2);
}

TEST(GainTrial, LargestIsTheGainOfLargestSizeAndOfTheFactorsOwnSign) {
  Measured m = of_light_arm();
  m.data.joint_values.row(4) /= 0.95;
  m.data.joint_values.row(1) /= 1.03;
  const std::optional<GainTrial> found = tried(m);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->joint, 4U);
  EXPECT_NEAR(found->factor, 0.95, 1e-3);
  EXPECT_EQ(found->others, 1);
}

TEST(GainTrial, MisfitsAreThoseOfTheFitsWithAndWithoutGains) {
  Measured m = of_light_arm();
  m.data.joint_values.row(2) *= 0.98;
  const std::optional<GainTrial> found = tried(m);
  ASSERT_TRUE(found);
  ErrorModel wide = m.model;
  wide.effects = gain_terms(m.model);
  Estimate start = nominal_start(m.model, m.data);
  start.effects = Eigen::VectorXd::Zero(6);
  const Unknowns with_gains = m.free.with_group(wide, UnknownGroup::effects);
  const double with = rms_of(wide, m.data, identify_jointly(wide, m.data, start, with_gains).estimate);
  const double without = rms_of(wide, m.data, identify_jointly(wide, m.data, start, m.free).estimate);
  EXPECT_LT(with, 1e-4);
  EXPECT_GT(without, 1e-3);
  EXPECT_NEAR(found->rms, with, 1e-9);
  EXPECT_NEAR(found->rms_rigid, without, 1e-9);
  // What is free of effects is not: the gains are.
  Measured free = m;
  free.model.effects = load_terms(m.model);
  free.free = m.free.with(free.model, UnknownGroup::effects, {0});
  const std::optional<GainTrial> beside = tried(free);
  ASSERT_TRUE(beside);
  EXPECT_NEAR(beside->rms, with, 1e-9);
  EXPECT_NEAR(beside->rms_rigid, without, 1e-9);
}

TEST(GainTrial, ThereIsNoneBesideErrorsBeyondAnyRobots) {
  Measured m = measured(light_arm(), 3);
  m.data.joint_values.row(2) *= 0.9;
  m.data.joint_values.row(1).array() += 0.3;
  EXPECT_TRUE(tried(m)) << "an offset of 0.3 rad";
  m.data.joint_values.row(1).array() += 0.1;
  EXPECT_FALSE(tried(m)) << "an offset of 0.4 rad";
}

}  // namespace
}  // namespace kdl_calibration::gain_trial_test
