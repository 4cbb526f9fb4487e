#include "two_step/two_step.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

#include "record.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::two_step_test {
namespace {

using testing::held_out_rms;
using testing::published_experiment;
using testing::VirtualExperiment;

/// The steps on the same recorded configurations, round after round.
Identification by_recorded(const VirtualExperiment& experiment, const Measurements& recorded,
                           const TwoStepOptions& options = {.rounds = 600}) {
  return identify_in_two_steps(
      experiment.model, [&](int) { return recorded; }, nominal_start(experiment.model, recorded),
      experiment.free.geometric(), options);
}

void expect_a_tenth_of_a_millimetre_of_two_steps(std::uint64_t seeds) {
  VirtualExperiment experiment = published_experiment();
  double log_factor = 0.0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    experiment.restart(Random(seed));
    const auto fresh = [&](int) { return experiment.measure(30); };
    const Estimate start = nominal_start(experiment.model, fresh(0));
    const Identification found =
        identify_in_two_steps(experiment.model, fresh, start, experiment.free.geometric(), {.rounds = 40});
    ASSERT_NE(found.termination, Termination::diverged) << seed << ": " << found.message;
    ASSERT_LE(held_out_rms(experiment, found.estimate, 100), 1e-4) << seed;
    log_factor += std::log(found.convergence_factor) / static_cast<double>(seeds);
  }
  const double factor = std::exp(log_factor);
  testing::record("factor with fresh configurations", factor);
  EXPECT_GT(factor, 0.5);
  EXPECT_LT(factor, 0.75);
}

TEST(TwoStepProcedure, WithFreshConfigurationsReachATenthOfAMillimetre) {
  expect_a_tenth_of_a_millimetre_of_two_steps(4);
}

TEST(TwoStepProcedureLongRun, WithFreshConfigurationsReachATenthOfAMillimetre) {
  expect_a_tenth_of_a_millimetre_of_two_steps(20);
}

TEST(TwoStepProcedure, WithRecordedConfigurationsConvergeMoreSlowlyToTheTruth) {
  VirtualExperiment experiment = published_experiment(3);
  const Measurements recorded = experiment.measure(30);
  const Identification stopped = by_recorded(experiment, recorded);
  testing::record("factor with recorded configurations", stopped.convergence_factor);
  ASSERT_EQ(stopped.termination, Termination::converged) << stopped.message;
  EXPECT_GT(stopped.convergence_factor, 0.65);
  EXPECT_LT(stopped.convergence_factor, 1.0);
  EXPECT_LT(held_out_rms(experiment, stopped.estimate, 100), 1e-9);
  // Rounds that go on into rounding state the same factor.
  const int rounds = stopped.iterations + 60;
  const Identification longer = by_recorded(experiment, recorded, {.rounds = rounds, .step_tolerance = 0.0});
  EXPECT_EQ(longer.iterations, rounds);
  EXPECT_NEAR(longer.convergence_factor, stopped.convergence_factor, 0.01);
}

TEST(TwoStepProcedure, WithNoiseEndNearTheJointOptimum) {
  // Near it, not at it: the published A turns the base about the flange's lever alone, without the tool's.
  VirtualExperiment experiment = published_experiment(4);
  const double sigma = 0.00003;
  const Measurements recorded = experiment.measure(30, {.sigma = sigma});
  const Identification two_step = by_recorded(experiment, recorded);
  const Identification joint = joint_fit(experiment, recorded);
  EXPECT_EQ(two_step.termination, Termination::converged) << two_step.message;
  EXPECT_GE(two_step.rms, joint.rms);
  EXPECT_LT(two_step.rms - joint.rms, 0.001 * sigma);
}

TEST(ConvergenceFactor, IsTheGeometricMeanOfTheRatiosBehindTheFirst) {
  EXPECT_NEAR(convergence_factor({50.0, 1.0, 0.2, 0.01}), 0.1, 1e-15);
  EXPECT_NEAR(convergence_factor({50.0, 1.0, 0.2, 0.01, 0.9e-12, 1e-14}), 0.1, 1e-15);
  EXPECT_NEAR(convergence_factor({50.0, 1.0, 0.25}), 0.25, 1e-15);
  EXPECT_NEAR(convergence_factor({50.0, 1.0, 0.25, 1e-3}, 1e-2), 0.25, 1e-15);
  EXPECT_EQ(convergence_factor({50.0, 1.0}), 0.0);
  EXPECT_EQ(convergence_factor({50.0, 1.0, 1e-13}), 0.0);
  EXPECT_EQ(convergence_factor({}), 0.0);
}

}  // namespace
}  // namespace kdl_calibration::two_step_test
