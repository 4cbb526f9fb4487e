#include "uncertainty/influence.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>

#include "estimation/residual_options.hpp"
#include "record.hpp"
#include "uncertainty/covariance.hpp"
#include "uncertainty/published_arm.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::influence_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::column_errors;
using testing::published;
using testing::VirtualExperiment;
using testing::without_sigmas;

// Exact refit of the rows that `keep` leaves, Cook's distance as defined.
double cook_by_refit(const VirtualExperiment& experiment, const Measurements& measured, const Identification& full,
                     const ResidualOptions& residuals, const std::function<bool(const Observation&)>& keep) {
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free, residuals);
  const NormalEquations equations = problem.linearise(full.estimate);
  JointOptions options;
  options.residuals = residuals;
  options.step_tolerance = 1e-13;
  const Identification without =
      identify_jointly(experiment.model, subset(measured, keep), full.estimate, experiment.free, options);
  const Eigen::VectorXd d = column_errors(experiment, full.estimate, without.estimate);
  const double coordinates = static_cast<double>(problem.whitened(full.estimate).residual.size());
  const double variance = (equations.cost - problem.cost_of_repeats()) / (coordinates - 33.0);
  return d.dot(equations.hessian * d) / (33.0 * variance);
}

TEST(Influence, LeverageAddsUpToTheRankAndCooksDistanceIsThatOfARefit) {
  VirtualExperiment experiment = published();
  const Eigen::Vector3d common(0.00002, 0.00001, 0.00003);
  for (const bool correlated : {false, true}) {
    experiment.restart(Random(9));
    const Measurements all = without_sigmas(
        experiment.measure(30, {.sigma = 1e-6, .repeats = 2, .common = 0.1 * common}));  // so small that all is linear
    const Measurements measured =
        subset(all, [](const Observation& o) { return o.configuration != 4 || o.target != 1; });
    JointOptions options;
    options.step_tolerance = 1e-13;
    if (correlated) {
      options.residuals.noise = {.independent = Eigen::Vector3d::Constant(1e-6), .common = 0.1 * common};
    }
    const Identification full = joint_fit(experiment, measured, options);
    const LeastSquaresProblem problem(experiment.model, measured, experiment.free, options.residuals);
    const Eigen::MatrixXd jacobian = problem.whitened(full.estimate).jacobian;
    const Influence found = influence(problem, measured, options.residuals, full.estimate,
                                      problem.whitened_summary(full.estimate).sqrt_information);
    ASSERT_EQ(found.configurations.size(), 30U);
    EXPECT_NEAR(found.leverage_limit, 2.0 * 33.0 / 267.0, 1e-9);
    EXPECT_EQ(found.cook_limit, 4.0 / 30.0);
    EXPECT_NEAR(found.point_cook_limit, 4.0 / 89.0, 1e-15);
    const Eigen::MatrixXd hat = jacobian * (jacobian.transpose() * jacobian).ldlt().solve(jacobian.transpose());
    double sum = 0.0;
    double sum_of_points = 0.0;
    double largest_difference = 0.0;
    for (const ConfigurationInfluence& entry : found.configurations) {
      sum += entry.leverage;
      EXPECT_EQ(entry.high_leverage, entry.leverage > entry.coordinates * found.leverage_limit);
      EXPECT_EQ(entry.influential, entry.cook > found.cook_limit);
      for (const PointInfluence& point : entry.points) {
        sum_of_points += point.leverage;
      }
      if (entry.configuration % 6 != 4) {
        continue;
      }
      const auto other = [&](const Observation& o) { return o.configuration != entry.configuration; };
      const double expected = cook_by_refit(experiment, measured, full, options.residuals, other);
      largest_difference = std::max(largest_difference, std::abs(entry.cook / expected - 1.0));
      for (const PointInfluence& point : entry.points) {
        const double exact = cook_by_refit(experiment, measured, full, options.residuals,
                                           [&](const Observation& o) { return other(o) || o.target != point.target; });
        largest_difference = std::max(largest_difference, std::abs(point.cook / exact - 1.0));
      }
    }
    testing::record("largest difference of Cook's distance from refits", largest_difference);
    EXPECT_NEAR(sum, 33.0, 1e-8);
    EXPECT_NEAR(sum_of_points, 33.0, 1e-8);
    EXPECT_NEAR(hat.trace(), 33.0, 1e-6);
    if (!correlated) {  // the diagonal itself, row by row
      EXPECT_NEAR(found.configurations[0].leverage, hat.diagonal().head(9).sum(), 1e-6);
    }
    EXPECT_LT(largest_difference, 0.01);
  }
}

// The trace of the hat matrix, and that of the configurations' rows in it.
TEST(Influence, LeveragesOfPosesOfAnyWeightAddUpToWhatTheRowsDecide) {
  VirtualExperiment experiment({.targets = testing::as_frames(published_targets())});
  Measurements measured = without_sigmas(experiment.measure(30, {.sigma = 1e-4, .orientation_sigma = 2e-4}));
  ResidualOptions options{.priors = {.length = 5e-5, .angle = 5e-5}, .orientation_length = 0.5};
  const auto alone = [](int configuration, int target) {
    return configuration % 6 == 2 || (target == 0 && configuration % 2 == 1);
  };
  for (std::size_t row = 0; row < measured.observations.size(); ++row) {
    Observation& o = measured.observations[row];
    o.split = o.configuration % 11 == 3 ? Split::test : Split::train;
    if (alone(o.configuration, o.target)) {
      testing::remove_orientation(o);
    }
    options.row_weights.push_back(row == 30 ? 40.0 : row % 5 == 2 ? 0.3 : 1.0);
  }
  const Estimate& truth = experiment.robot.truth;
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free, options);
  const WhitenedSystem system = problem.whitened(truth);
  const Influence found =
      influence(problem, measured, options, truth, problem.whitened_summary(truth).sqrt_information);
  const MatrixXd J = system.jacobian;
  const VectorXd scale = J.colwise().norm().cwiseInverse();
  const MatrixXd scaled = J * scale.asDiagonal();
  const VectorXd hat = (scaled * (scaled.transpose() * scaled).inverse()).cwiseProduct(scaled).rowwise().sum();
  const double decided = hat.head(system.blocks.back()).sum();
  EXPECT_LT(decided, static_cast<double>(experiment.free.size()) - 0.01) << "priors decide some";
  ASSERT_EQ(found.configurations.size() + 1, system.blocks.size());
  double of_points = 0.0;
  for (std::size_t c = 0; c < found.configurations.size(); ++c) {
    const ConfigurationInfluence& entry = found.configurations[c];
    const Index rows = system.blocks[c + 1] - system.blocks[c];
    EXPECT_NE(entry.configuration % 11, 3) << "test rows";
    EXPECT_EQ(entry.coordinates, static_cast<int>(rows));
    EXPECT_NEAR(entry.leverage, hat.segment(system.blocks[c], rows).sum(), 1e-6) << c;
    for (const PointInfluence& point : entry.points) {
      of_points += point.leverage;
      EXPECT_EQ(point.coordinates, alone(entry.configuration, point.target) ? 3 : 6);
    }
  }
  EXPECT_NEAR(of_points, decided, 1e-6);
}

/// The third target in two configurations, in the second with this weight: all that decides its place.
Influence of_a_target_seen_twice(double weight) {
  VirtualExperiment experiment;
  Measurements measured = testing::without_sigmas(experiment.measure(6, {.sigma = 1e-4}));
  measured = subset(measured, [](const Observation& o) { return o.target != 2 || o.configuration < 2; });
  ResidualOptions options;
  for (const Observation& o : measured.observations) {
    options.row_weights.push_back(o.target == 2 && o.configuration == 1 ? weight : 1.0);
  }
  const Unknowns free(experiment.model, experiment.targets, {"C.x", "C.y", "C.z"});
  const Estimate estimate =
      identify_jointly(experiment.model, measured, experiment.robot.truth, free, {.residuals = options}).estimate;
  const LeastSquaresProblem problem(experiment.model, measured, free, options);
  return influence(problem, measured, options, estimate, problem.whitened_summary(estimate).sqrt_information);
}

TEST(Influence, IsInfiniteWhereTheRestDoesNotDetermineAll) {
  const Influence finite = of_a_target_seen_twice(2e-9);
  ASSERT_EQ(finite.configurations.size(), 6U);
  EXPECT_TRUE(std::isfinite(finite.configurations[0].cook));
  EXPECT_GT(finite.configurations[0].cook, 0.0);
  EXPECT_TRUE(std::isfinite(finite.configurations[0].points[2].cook));
  const Influence infinite = of_a_target_seen_twice(5e-10);
  EXPECT_TRUE(std::isinf(infinite.configurations[0].cook));
  EXPECT_TRUE(std::isinf(infinite.configurations[0].points[2].cook));
  EXPECT_TRUE(infinite.configurations[0].influential);
  EXPECT_TRUE(infinite.configurations[0].points[2].influential);
  EXPECT_TRUE(infinite.configurations[0].points[2].high_leverage);
  for (const std::size_t target : {0U, 1U}) {
    EXPECT_EQ(infinite.configurations[0].points[target].cook, 0.0) << "tells nothing of it";
    EXPECT_FALSE(infinite.configurations[0].points[target].high_leverage);
  }
  EXPECT_EQ(infinite.configurations[4].cook, 0.0);
}

// One configuration of three targets of which one is free: nothing is left to judge by.
TEST(Influence, IsNoneWhereNothingIsLeftOver) {
  VirtualExperiment experiment;
  const Measurements measured = testing::without_sigmas(
      subset(experiment.measure(1, {.sigma = 1e-4}), [](const Observation& o) { return o.target == 2; }));
  const Unknowns free(experiment.model, experiment.targets, {"C.x", "C.y", "C.z"});
  const LeastSquaresProblem problem(experiment.model, measured, free);
  const Influence found = influence(problem, measured, {}, experiment.robot.truth,
                                    problem.whitened_summary(experiment.robot.truth).sqrt_information);
  ASSERT_EQ(found.configurations.size(), 1U);
  EXPECT_NEAR(found.configurations[0].leverage, 3.0, 1e-12);
  EXPECT_EQ(found.configurations[0].cook, 0.0);
  EXPECT_FALSE(found.configurations[0].influential);
}

TEST(Influence, IsEmptyWhereTheTriangleDoesNotDetermineAllColumns) {
  VirtualExperiment experiment;
  const Measurements measured = testing::without_sigmas(experiment.measure(6, {.sigma = 1e-4}));
  const Unknowns free(experiment.model, experiment.targets, {"C.x", "C.y"});
  const LeastSquaresProblem problem(experiment.model, measured, free);
  const auto entries = [&](const MatrixXd& sqrt_information) {
    return influence(problem, measured, {}, experiment.robot.truth, sqrt_information).configurations.size();
  };
  const auto parallel = [](double sine) { return (MatrixXd(2, 2) << 1e3, 1.0, 0.0, sine).finished(); };
  EXPECT_EQ(entries(parallel(2e-9)), 6U);
  EXPECT_EQ(entries(parallel(5e-10)), 0U);
  EXPECT_EQ(entries(parallel(-2e-9)), 6U) << "of either sign";
  EXPECT_EQ(entries(MatrixXd::Identity(1, 2)), 0U);
  EXPECT_EQ(entries((MatrixXd(3, 2) << 1.0, 1.0, 1.0, -1.0, 1.0, 1.0).finished()), 6U);
  const Unknowns none(experiment.model, experiment.targets, {});
  const LeastSquaresProblem fixed(experiment.model, measured, none);
  EXPECT_TRUE(influence(fixed, measured, {}, experiment.robot.truth, MatrixXd(3, 0)).configurations.empty());
}

// Sums over fits of the variances that the shifts give, and that white noise would have.
struct Variances {
  VectorXd stated;
  VectorXd white;

  explicit Variances(Eigen::Index columns) : stated(VectorXd::Zero(columns)), white(stated) {}
  // Fits with this sigma of every coordinate.
  Estimate add(const VirtualExperiment& experiment, const Measurements& measured, double sigma) {
    ResidualOptions options;
    options.noise.independent.setConstant(sigma);
    const Identification fit = joint_fit(experiment, measured, {.residuals = options});
    const LeastSquaresProblem problem(experiment.model, measured, experiment.free, options);
    const MatrixXd R = problem.whitened_summary(fit.estimate).sqrt_information;
    white += covariance(R, 1.0).diagonal();
    for (const ConfigurationInfluence& entry : influence(problem, measured, options, fit.estimate, R).configurations) {
      stated += entry.shift.cwiseAbs2();
    }
    return fit.estimate;
  }
};

// A fit takes all noise for white, but each configuration has an error that its three points share. The outer products
// of the shifts are the covariance of the estimate nevertheless: by Monte Carlo, of 12 configurations for 33 unknowns.
TEST(InfluenceLongRun, ShiftsGiveTheCovarianceWhateverTheNoiseWithinAConfiguration) {
  constexpr int kTrials = 400;
  VirtualExperiment experiment = published();
  const MatrixXd q = experiment.configurations(12);
  VectorXd squares = VectorXd::Zero(experiment.free.size());
  Variances sums(experiment.free.size());
  for (int trial = 0; trial < kTrials; ++trial) {
    const Measurements measured =
        without_sigmas(experiment.measure(q, {.sigma = 1e-6, .common = Eigen::Vector3d::Constant(3e-6)}));
    const Estimate estimate = sums.add(experiment, measured, std::hypot(1e-6, 3e-6));
    squares += column_errors(experiment, estimate, experiment.robot.truth).cwiseAbs2();
  }
  const VectorXd ratio = (sums.stated.array() / squares.array()).sqrt();
  const VectorXd of_white = (sums.white.array() / squares.array()).sqrt();
  testing::record("stated sigma over true, mean", ratio.mean());
  testing::record("the same of white noise", of_white.mean());
  EXPECT_NEAR(ratio.mean(), 1.0, 0.1);
  EXPECT_GT(ratio.minCoeff(), 0.75);
  EXPECT_LT(ratio.maxCoeff(), 1.25);
  EXPECT_LT((ratio.array() - 1.0).square().mean(), 0.25 * (of_white.array() - 1.0).square().mean());
}

// For white noise without bias: as E e e^T = I - H, the outer products have the expectation R^-1 R^-T.
TEST(Influence, ShiftsOfWhiteNoiseAddUpToTheCovariance) {
  constexpr int kTrials = 60;
  VirtualExperiment experiment = published();
  const MatrixXd q = experiment.configurations(20);
  Variances sums(experiment.free.size());
  for (int trial = 0; trial < kTrials; ++trial) {
    const Measurements measured = without_sigmas(experiment.measure(q, {.sigma = 1e-6}));
    sums.add(experiment, measured, 1e-6);
  }
  EXPECT_NEAR((sums.stated.array() / sums.white.array()).mean(), 1.0, 0.05);
}

}  // namespace
}  // namespace kdl_calibration::influence_test
