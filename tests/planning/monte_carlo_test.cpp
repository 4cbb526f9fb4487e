#include "kdl_calibration/monte_carlo.hpp"
#include "kdl_calibration/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "kdl_calibration/experiment.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/pose_selection.hpp"
#include "kdl_calibration/truth_comparison.hpp"
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

TEST(MonteCarlo, EachRunIsARobotThatIsMeasuredAndCalibrated) {
  Fixture f;
  MonteCarlo runs = f.runs(2);
  runs.X_WB = Eigen::Isometry3d(Eigen::Translation3d(1.0, -2.0, 0.5));
  runs.seed = 5;
  runs.train = [&](Random& random) { return random_configurations(published_ranges(f.model.joints), 14, random); };
  runs.test = [&](Random& random) { return random_configurations(published_ranges(f.model.joints), 4, random); };
  MatrixXd squares = MatrixXd::Zero(4, 3);
  std::vector<double> all;
  std::vector<double> means;
  std::vector<double> maxima;
  for (std::uint64_t r = 0; r < 2; ++r) {
    Random random(5, r);
    const VirtualRobot robot =
        placed(virtual_robot(f.model, runs.with_errors, f.targets, runs.sizes, random), runs.X_WB);
    const MatrixXd train = runs.train(random);
    const MatrixXd test = runs.test(random);
    const Measurements measured = measure(robot, train, runs.noise, random);
    const Calibration calibration = calibrate(f.model, measured, {.held_out = false, .try_readings = false});
    const std::vector<double> distances =
        distances_from_truth(f.model, calibration.identification.estimate, robot.truth, test);
    for (Eigen::Index i = 0; i < 12; ++i) {
      const double distance = distances[static_cast<std::size_t>(i)];
      squares(i / 3, i % 3) += distance * distance;
    }
    all.insert(all.end(), distances.begin(), distances.end());
    means.push_back(error_statistics(distances).mean);
    maxima.push_back(error_statistics(distances).max);
  }
  const MonteCarloResult result = run_monte_carlo(runs);
  EXPECT_EQ(result.runs, 2);
  EXPECT_LT((result.rms - (squares / 2.0).cwiseSqrt()).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_NEAR(result.all.rms, error_statistics(all).rms, 1e-12);
  EXPECT_NEAR(result.means.mean, error_statistics(means).mean, 1e-12);
  EXPECT_NEAR(result.maxima.max, error_statistics(maxima).max, 1e-12);
  for (auto* values : {&all, &means, &maxima}) {
    std::sort(values->begin(), values->end());
  }
  const auto near = [](const std::vector<double>& expected) {
    return ::testing::Pointwise(::testing::DoubleNear(1e-12), expected);
  };
  EXPECT_THAT(result.all_errors, near(all));
  EXPECT_THAT(result.mean_errors, near(means));
  EXPECT_THAT(result.largest_errors, near(maxima));
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

TEST(MonteCarlo, PredictsTheErrorsThatTheNoiseAloneMakes) {
  Fixture f;
  MonteCarlo runs = f.runs(25);
  runs.noise.repeats = 4;
  runs.seed = 6;
  runs.train = [&](Random& random) { return random_configurations(published_ranges(f.model.joints), 10, random); };
  runs.test = [&](Random& random) { return random_configurations(published_ranges(f.model.joints), 32, random); };
  const Experiment halved = nominal_experiment(f.model, f.targets, {.sigma = 1.5e-5});
  std::vector<double> expected;
  for (std::uint64_t r = 0; r < 20; ++r) {
    Random random(6, r);
    virtual_robot(f.model, runs.with_errors, f.targets, runs.sizes, random);
    const MatrixXd known = information(halved, runs.train(random));
    const MatrixXd test = runs.test(random);
    for (Eigen::Index c = 0; c < 30; ++c) {
      expected.push_back(predicted(halved, known, MatrixXd(test.col(c)), 1).worst_configuration);
    }
  }
  std::sort(expected.begin(), expected.end());
  EXPECT_THAT(predicted_errors(runs), ::testing::Pointwise(::testing::DoubleNear(1e-12), expected));
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
  runs.runs = 0;
  EXPECT_THROW(run_monte_carlo(runs), InputError);
}

}  // namespace
}  // namespace kdl_calibration::monte_carlo_test
