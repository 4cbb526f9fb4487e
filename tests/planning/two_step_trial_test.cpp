#include "planning/two_step_trial.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include "record.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::two_step_trial_test {
namespace {

/// The published experiment, drawn anew for each seed.
class TwoStepTrialTest : public ::testing::Test {
protected:
  TwoStepTrialResult run(std::uint64_t seed, int rounds, bool recorded = false, double noise = 0.0) {
    testing::VirtualExperiment experiment({.model = model, .sizes = {}, .random = Random(seed)});
    TwoStepTrial trial{.robot = experiment.robot,
                       .configurations =
                           [this](Random& r) {
                             ++drawn;
                             return random_configurations(ranges, 30, r);
                           },
                       .noise = {.sigma = noise},
                       .rounds = rounds,
                       .recorded = recorded,
                       .progress = progress};
    Random elsewhere(seed, 1);
    trial.held_out = random_configurations(ranges, 60, elsewhere);
    drawn = 0;
    return run_two_step_trial(trial, experiment.random);
  }

  ErrorModel model = complete_model(testing::fanuc());
  JointRanges ranges = published_ranges(model.joints);
  int drawn = 0;
  std::function<void(double)> progress;
};

TEST_F(TwoStepTrialTest, ArrivesAtTheTruthUpToTheGaugeWithThePublishedFactor) {
  double log_factor = 0.0;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const TwoStepTrialResult result = run(seed, 200);
    EXPECT_TRUE(result.settled) << seed << ": " << result.identification.message;
    EXPECT_EQ(drawn, result.identification.iterations) << "fresh configurations in every round";
    EXPECT_TRUE(result.truth.comparable());
    EXPECT_LT(result.truth.largest_length, 1e-10) << seed;
    EXPECT_LT(result.truth.largest_angle, 1e-10) << seed;
    EXPECT_LT(result.rounds.back().held_out.max, 1e-10) << seed;
    ASSERT_EQ(result.rounds.size(), result.identification.rms_history.size());
    EXPECT_EQ(result.rounds[3].round.misfit, result.identification.rms_history[3]);
    log_factor += std::log(result.factor) / 3.0;
  }
  testing::record("factor with fresh configurations", std::exp(log_factor));
  EXPECT_GT(std::exp(log_factor), 0.6);
  EXPECT_LT(std::exp(log_factor), 0.7);
}

TEST_F(TwoStepTrialTest, WithRecordedConfigurationsMeasuresOnceAndIsSlower) {
  const TwoStepTrialResult result = run(3, 600, true);
  EXPECT_EQ(drawn, 1);
  EXPECT_TRUE(result.settled) << result.identification.message;
  EXPECT_GT(result.factor, 0.65);
  EXPECT_LT(result.factor, 1.0);
  EXPECT_LT(result.truth.points.max, 1e-10);
}

TEST_F(TwoStepTrialTest, TellsTheShareOfTheRoundsThatAreDone) {
  std::vector<double> shares;
  progress = [&](double share) { shares.push_back(share); };
  run(1, 4);
  EXPECT_EQ(shares, (std::vector<double>{0.25, 0.5, 0.75, 1.0}));
}

TEST_F(TwoStepTrialTest, WithNoiseItSettlesWhereNoiseAloneMovesIt) {
  const double sigma = 3e-5;
  const TwoStepTrialResult result = run(2, 60, false, sigma);
  EXPECT_EQ(result.rounds.size(), 60U);
  EXPECT_TRUE(result.settled) << result.rounds.back().round.change << " " << result.floor;
  EXPECT_NEAR(result.floor / sigma, std::sqrt(18.0 / 90.0), 1e-9) << "what 90 coordinates leave of 18 parameters";
  EXPECT_GT(result.factor, 0.5);
  EXPECT_LT(result.factor, 0.8);
  EXPECT_LT(result.truth.points.rms, 2e-4);
  EXPECT_FALSE(run(2, 5, false, sigma).settled);
}

}  // namespace
}  // namespace kdl_calibration::two_step_trial_test
