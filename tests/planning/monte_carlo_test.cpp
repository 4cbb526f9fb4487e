#include "planning/monte_carlo.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "planning/experiment.hpp"
#include "planning/pose_selection.hpp"
#include "support.hpp"

namespace kdl_calibration::monte_carlo_test {
namespace {

using Eigen::MatrixXd;

struct Fixture {
  ErrorModel model = complete_model(testing::fanuc());
  std::vector<TargetFrame> targets = published_targets();
  Experiment experiment = nominal_experiment(model, targets, {.sigma = 3e-5});
  MatrixXd train;
  MatrixXd test;

  Fixture() {
    Random random(9);
    const MatrixXd all = random_configurations(published_ranges(model.joints), 1000, random);
    const MatrixXd none = MatrixXd::Zero(columns(experiment), columns(experiment));
    train = all(Eigen::all, select_configurations(experiment, {all, none}, {.count = 20, .starts = 2}).chosen);
    test = random_configurations(published_ranges(model.joints), 60, random);
  }

  MonteCarlo runs(int count) {
    return {.model = model,
            .with_errors = experiment.free.geometric(),
            .targets = targets,
            .sizes = {.length = 5e-4, .angle = 5e-4, .base_position = 1e-3, .target_length = 5e-4},
            .noise = {.sigma = 3e-5},
            .train = [this](Random&) { return train; },
            .test = [this](Random&) { return test; },
            .calibration = {},
            .runs = count,
            .seed = 1};
  }
};

// Within these shares of the predicted mean, RMS and largest sigma.
void expect_predicted_sigma(int runs, double of_mean, double of_largest) {
  Fixture f;
  const MonteCarloResult result = run_monte_carlo(f.runs(runs));
  EXPECT_EQ(result.not_trusted, 0);
  ASSERT_EQ(result.rms.rows(), 60);
  ASSERT_EQ(result.rms.cols(), 3);
  const Prediction promise = predicted(f.experiment, information(f.experiment, f.train), f.test);
  EXPECT_NEAR(result.rms.mean() / promise.sigma.mean, 1.0, of_mean);
  EXPECT_NEAR(result.all.rms / promise.sigma.rms, 1.0, of_mean);
  EXPECT_NEAR(result.rms.maxCoeff() / promise.sigma.max, 1.0, of_largest);
}

TEST(MonteCarlo, AgreesWithThePredictedSigma) { expect_predicted_sigma(20, 0.15, 0.5); }

TEST(MonteCarloLongRun, AgreesWithThePredictedSigma) { expect_predicted_sigma(200, 0.05, 0.2); }

TEST(MonteCarlo, GivesTheSameAnswerOnAnyNumberOfThreads) {
  Fixture f;
  MonteCarlo runs = f.runs(6);
  runs.train = [&](Random& random) { return random_configurations(published_ranges(f.model.joints), 15, random); };
  runs.threads = 1;
  const MonteCarloResult one = run_monte_carlo(runs);
  runs.threads = 3;
  const MonteCarloResult three = run_monte_carlo(runs);
  EXPECT_EQ(one.rms, three.rms);
  EXPECT_EQ(one.all.max, three.all.max);
  EXPECT_EQ(one.maxima.p95, three.maxima.p95);
  EXPECT_EQ(one.all.count, 6 * 60 * 3);
  EXPECT_DOUBLE_EQ(one.maxima.max, one.all.max);
  EXPECT_NEAR(one.means.mean, one.all.mean, 1e-15);
}

TEST(MonteCarlo, TellsTheShareOfTheRunsThatAreDone) {
  Fixture f;
  MonteCarlo runs = f.runs(4);
  for (const int threads : {1, 3}) {
    runs.threads = threads;
    std::vector<double> shares;
    runs.progress = [&](double share) { shares.push_back(share); };
    run_monte_carlo(runs);
    EXPECT_THAT(shares, ::testing::ElementsAre(0.25, 0.5, 0.75, 1.0)) << threads << " threads";
  }
}

TEST(MonteCarlo, RunsOfOtherNumbersOfTestsHaveNoCommonPoints) {
  Fixture f;
  MonteCarlo runs = f.runs(2);
  runs.threads = 1;
  int calls = 0;
  runs.test = [&](Random&) { return MatrixXd(f.test.leftCols(++calls)); };
  const MonteCarloResult result = run_monte_carlo(runs);
  EXPECT_EQ(result.rms.size(), 0);
  EXPECT_EQ(result.all.count, 3 + 6);
}

TEST(MonteCarlo, StatisticsAreThoseOfTheErrorsOfAllRuns) {
  Fixture f;
  const MonteCarloResult result = run_monte_carlo(f.runs(3));
  ASSERT_EQ(result.all_errors.size(), 3U * 60U * 3U);
  EXPECT_TRUE(std::is_sorted(result.all_errors.begin(), result.all_errors.end()));
  const Eigen::Map<const Eigen::VectorXd> errors(result.all_errors.data(), 540);
  EXPECT_NEAR(result.all.rms, errors.norm() / std::sqrt(540.0), 1e-15);
  EXPECT_NEAR(result.rms.norm() * std::sqrt(3.0) / errors.norm(), 1.0, 1e-12) << "of each point, over the runs";
  ASSERT_EQ(result.mean_errors.size(), 3U);
  EXPECT_NEAR(result.mean_errors[0] + result.mean_errors[1] + result.mean_errors[2], errors.sum() / 180.0, 1e-15);
  EXPECT_EQ(result.largest_errors.back(), result.all_errors.back());
}

// The errors that were drawn are as large as those predicted from the noise alone.
TEST(MonteCarlo, PredictsTheErrorsThatTheNoiseAloneMakes) {
  Fixture f;
  MonteCarlo runs = f.runs(20);
  runs.noise.repeats = 4;
  runs.train = [&](Random& random) { return random_configurations(published_ranges(f.model.joints), 12, random); };
  runs.test = [&](Random& random) { return random_configurations(published_ranges(f.model.joints), 30, random); };
  EXPECT_NEAR(error_statistics(predicted_errors(runs)).rms / run_monte_carlo(runs).all.rms, 1.0, 0.15);
  runs.runs = 2;
  EXPECT_EQ(predicted_errors(runs).size(), 60U);
  runs.train = [&](Random&) { return MatrixXd(f.train.leftCols(3)); };  // which determine nothing
  EXPECT_THAT(predicted_errors(runs), ::testing::IsEmpty());
  for (const MeasuringNoise& noise :
       {MeasuringNoise{}, MeasuringNoise{.sigma = 1e-5, .orientation_sigma = 1e-4},
        MeasuringNoise{.sigma = 1e-5, .tracker = TrackerNoise{.range = 1e-5, .transverse = 1e-5}}}) {
    MonteCarlo other = f.runs(2);
    other.noise = noise;
    EXPECT_THAT(predicted_errors(other), ::testing::IsEmpty());
  }
}

TEST(MonteCarlo, PassesOnWhatARunRefuses) {
  Fixture f;
  MonteCarlo runs = f.runs(4);
  runs.train = [&](Random&) { return MatrixXd(f.train.leftCols(2)); };
  EXPECT_THROW(run_monte_carlo(runs), InputError);
}

}  // namespace
}  // namespace kdl_calibration::monte_carlo_test
