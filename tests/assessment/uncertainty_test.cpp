#include "kdl_calibration/covariance.hpp"
#include "kdl_calibration/influence.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "kdl_calibration/lack_of_fit.hpp"
#include "kdl_calibration/noise_components.hpp"
#include "kdl_calibration/observability.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>

#include "base/f_distribution.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/random.hpp"
#include "kdl_calibration/simulation.hpp"
#include "record.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using testing::VirtualExperiment;
using testing::without_sigmas;

TEST(Uncertainty, UpperTailOfTheFDistribution) {
  for (const double n : {1.0, 2.0, 5.0, 30.0}) {
    for (const double f : {0.01, 0.3, 1.0, 3.0, 50.0}) {
      // With two degrees of freedom in the numerator the integral has a closed form.
      EXPECT_NEAR(f_upper_tail(f, 2.0, n), std::pow(1.0 + 2.0 * f / n, -0.5 * n), 1e-12) << f << ", " << n;
      EXPECT_NEAR(f_upper_tail(f, 7.0, n) + f_upper_tail(1.0 / f, n, 7.0), 1.0, 1e-12) << f << ", " << n;
    }
  }
}

TEST(Uncertainty, CriticalValuesHaveTheirTail) {
  for (const double tail : {0.9, 0.5, 0.05, 1e-3, 1e-6}) {
    for (const double n : {1.0, 2.0, 5.0, 237.0}) {
      const double expected = 0.5 * n * (std::pow(tail, -2.0 / n) - 1.0);  // as above
      EXPECT_NEAR(f_critical(tail, 2.0, n) / expected, 1.0, 1e-9) << tail << ", " << n;
      EXPECT_NEAR(f_upper_tail(f_critical(tail, 2.6, n), 2.6, n) / tail, 1.0, 1e-9) << tail << ", " << n;
    }
  }
  EXPECT_NEAR(f_critical(0.5, 3.0, 3.0), 1.0, 1e-12);  // symmetry
  EXPECT_NEAR(t_critical_95(3.0), 3.182446, 1e-6);     // printed tables
}

TEST(Uncertainty, CovarianceIsTheInverseOfTheNormalMatrix) {
  Random random(1);
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::NullaryExpr(40, 6, [&] { return random.normal(); });
  jacobian.col(2) *= 1e6;
  const Eigen::MatrixXd expected = 0.25 * (jacobian.transpose() * jacobian).inverse();
  const Eigen::MatrixXd found = covariance(jacobian, 0.25);
  for (Eigen::Index i = 0; i < 6; ++i) {
    for (Eigen::Index j = 0; j < 6; ++j) {
      const double scale = std::sqrt(expected(i, i) * expected(j, j));
      EXPECT_NEAR(found(i, j), expected(i, j), 1e-10 * scale);
    }
  }
}

TEST(Uncertainty, WhatIsNotDeterminedHasInfiniteVariance) {
  Random random(2);
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::NullaryExpr(40, 4, [&] { return random.normal(); });
  jacobian.col(3) = jacobian.col(0);
  const Eigen::MatrixXd found = covariance(jacobian, 1.0);
  EXPECT_TRUE(std::isinf(found(0, 0)));
  EXPECT_TRUE(std::isinf(found(3, 3)));
  EXPECT_TRUE(std::isfinite(found(1, 1)));
  EXPECT_NEAR(found(1, 1), (jacobian.leftCols(3).transpose() * jacobian.leftCols(3)).inverse()(1, 1), 1e-12);
}

TEST(Uncertainty, FTailIsThatOfTheTables) {
  // Quantiles from printed tables of the F distribution.
  EXPECT_NEAR(f_upper_tail(4.9646, 1, 10), 0.05, 1e-5);
  EXPECT_NEAR(f_upper_tail(2.9782, 10, 10), 0.05, 1e-5);
  EXPECT_NEAR(f_upper_tail(3.8415, 1, 1e7), 0.05, 1e-5);
  EXPECT_NEAR(f_upper_tail(1.0, 7, 7), 0.5, 1e-12);  // symmetry
  EXPECT_EQ(f_upper_tail(0.0, 3, 5), 1.0);
  EXPECT_LT(f_upper_tail(50.0, 100, 100), 1e-30);
}

/// With errors of the irreducible model.
VirtualExperiment published(const Random& random = Random(1)) {
  return VirtualExperiment({.ranges = published_ranges, .random = random});
}

/// Difference of an estimate from the truth in the coordinates of the columns: base, geometric, targets.
Eigen::VectorXd column_errors(const VirtualExperiment& experiment, const Estimate& estimate, const Estimate& truth) {
  Eigen::VectorXd d(33);
  const Eigen::Isometry3d off = truth.X_WB.inverse() * estimate.X_WB;
  const Eigen::AngleAxisd turn(off.linear());
  d.head<3>() = off.translation();
  d.segment<3>(3) = turn.angle() * turn.axis();
  for (std::size_t i = 0; i < experiment.free.geometric().size(); ++i) {
    const auto p = static_cast<Eigen::Index>(experiment.free.geometric()[i]);
    d[6 + static_cast<Eigen::Index>(i)] = estimate.errors[p] - truth.errors[p];
  }
  for (int k = 0; k < 3; ++k) {
    const auto target = static_cast<std::size_t>(k);
    d.segment<3>(24 + 3 * k) = estimate.targets[target].X_FT.translation() - truth.targets[target].X_FT.translation();
  }
  return d;
}

struct MonteCarlo {
  Eigen::VectorXd std_ratio;  // observed over predicted, per column
  double mean_nees = 0.0;
  double coverage = 0.0;  // of 95 % intervals of predicted coordinates
};

MonteCarlo monte_carlo(int runs, const MeasuringNoise& noise, const NoiseModel& assumed, bool estimate_noise) {
  VirtualExperiment experiment = published();
  MonteCarlo result;
  Eigen::VectorXd squares = Eigen::VectorXd::Zero(33);
  Eigen::VectorXd predicted = Eigen::VectorXd::Zero(33);
  double covered = 0.0;
  double intervals = 0.0;
  Random pose_random(1234);
  const Eigen::MatrixXd unmeasured = random_configurations(experiment.ranges, 200, pose_random);
  for (int run = 0; run < runs; ++run) {
    experiment.restart(Random(77, static_cast<std::uint64_t>(run)));
    const VirtualRobot& robot = experiment.robot;
    // The noise model speaks for all.
    const Measurements measured = without_sigmas(experiment.measure(30, noise));
    JointOptions options;
    options.residuals.noise = assumed;
    const Identification found = identify_jointly(experiment.model, measured, nominal_start(experiment.model, measured),
                                                  experiment.free, options);
    const LeastSquaresProblem problem(experiment.model, measured, experiment.free, options.residuals);
    const Eigen::MatrixXd jacobian = problem.whitened(found.estimate).jacobian;
    const double factor = estimate_noise ? problem.linearise(found.estimate).cost / (270.0 - 33.0) : 1.0;
    const Eigen::MatrixXd C = covariance(jacobian, factor);
    const Eigen::VectorXd d = column_errors(experiment, found.estimate, robot.truth);
    squares += d.cwiseAbs2() / runs;
    predicted += C.diagonal() / runs;
    result.mean_nees += d.dot(C.ldlt().solve(d)) / runs;
    const PositionPredictor predictor(experiment.model, found.estimate, experiment.free);
    const std::vector<Eigen::Isometry3d> truth = flange_poses(experiment.model, robot.truth, unmeasured);
    const std::vector<Eigen::Isometry3d> ours = flange_poses(experiment.model, found.estimate, unmeasured);
    for (Eigen::Index c = run % 10; c < unmeasured.cols(); c += 10) {  // a tenth of the poses in each run
      const auto i = static_cast<std::size_t>(c);
      const Eigen::Vector3d error = found.estimate.X_WB * (ours[i] * found.estimate.targets[1].X_FT.translation()) -
                                    robot.truth.X_WB * (truth[i] * robot.truth.targets[1].X_FT.translation());
      const Eigen::Matrix3d P = predicted_covariance(predictor, C, unmeasured.col(c), 1);
      for (int axis = 0; axis < 3; ++axis) {
        covered += std::abs(error[axis]) < 1.959964 * std::sqrt(P(axis, axis)) ? 1.0 : 0.0;
        intervals += 1.0;
      }
    }
  }
  result.std_ratio = (squares.array() / predicted.array()).sqrt();
  result.coverage = covered / intervals;
  return result;
}

// Share of every predicted sigma, amount of the mean NEES, and share of the 95 % intervals.
struct Tolerance {
  double std_ratio = 0.0;
  double nees = 0.0;
  double coverage = 0.0;
};
constexpr Tolerance kOf100Runs{.std_ratio = 0.3, .nees = 3.0, .coverage = 0.025};
constexpr Tolerance kOf1000Runs{.std_ratio = 0.1, .nees = 0.8, .coverage = 0.01};

void expect_confirmed(const MonteCarlo& found, const Tolerance& tolerance) {
  testing::record("least std over predicted", found.std_ratio.minCoeff());
  testing::record("largest std over predicted", found.std_ratio.maxCoeff());
  testing::record("NEES", found.mean_nees);
  testing::record("coverage", found.coverage);
  EXPECT_GT(found.std_ratio.minCoeff(), 1.0 - tolerance.std_ratio);
  EXPECT_LT(found.std_ratio.maxCoeff(), 1.0 + tolerance.std_ratio);
  EXPECT_NEAR(found.mean_nees, 33.0, tolerance.nees);
  EXPECT_NEAR(found.coverage, 0.95, tolerance.coverage);
}

void expect_covariance_confirmed(int runs, const Tolerance& tolerance) {
  const NoiseModel assumed{.independent = Eigen::Vector3d::Constant(0.00003)};
  expect_confirmed(monte_carlo(runs, {.sigma = 0.00003}, assumed, false), tolerance);
}

void expect_covariance_confirmed_under_correlated_noise(int runs, const Tolerance& tolerance) {
  // The repeats of the real robot: 58, 59, 31 um shared by the points of a repeat, 11 um of each by itself.
  const Eigen::Vector3d common(0.000058, 0.000059, 0.000031);
  const MeasuringNoise noise{.sigma = 0.000011, .common = common};
  const NoiseModel full{.independent = Eigen::Vector3d::Constant(0.000011), .common = common};
  expect_confirmed(monte_carlo(runs, noise, full, false), tolerance);
  const MonteCarlo independent = monte_carlo(runs / 4, noise, {}, true);
  EXPECT_LT(independent.coverage, 0.92) << "the model without the common part would do as well";
}

TEST(Uncertainty, MonteCarloConfirmsTheCovariance) { expect_covariance_confirmed(100, kOf100Runs); }

TEST(Uncertainty, MonteCarloConfirmsTheCovarianceUnderCorrelatedNoise) {
  expect_covariance_confirmed_under_correlated_noise(100, kOf100Runs);
}

TEST(UncertaintyLongRun, MonteCarloConfirmsTheCovariance) { expect_covariance_confirmed(1000, kOf1000Runs); }

TEST(UncertaintyLongRun, MonteCarloConfirmsTheCovarianceUnderCorrelatedNoise) {
  expect_covariance_confirmed_under_correlated_noise(1000, kOf1000Runs);
}

void expect_residual_components_to_cover_correlated_noise(int runs) {
  VirtualExperiment experiment = published(Random(5));
  double ratio = 0.0;
  for (int run = 0; run < runs; ++run, experiment.draw_robot()) {
    const Measurements measured =
        without_sigmas(experiment.measure(60, {.sigma = 0.00001, .common = Eigen::Vector3d::Constant(0.00005)}));
    const Identification found =
        identify_jointly(experiment.model, measured, nominal_start(experiment.model, measured), experiment.free);
    const WhitenedSystem system =
        LeastSquaresProblem(experiment.model, measured, experiment.free).whitened(found.estimate);
    const ResidualNoise noise = noise_from_residuals(system, 33, 1.0);
    EXPECT_GT(noise.common, 2.0 * noise.independent);
    const Eigen::VectorXd d = column_errors(experiment, found.estimate, experiment.robot.truth);
    const Eigen::MatrixXd C = covariance(system, noise, 1.0);
    ratio += (d.array().square() / C.diagonal().array()).segment(6, 18).mean() / runs;
  }
  EXPECT_GT(ratio, 0.7);
  EXPECT_LT(ratio, 1.4);
}

TEST(Uncertainty, ResidualComponentsCoverCorrelatedNoiseThatNobodyStated) {
  expect_residual_components_to_cover_correlated_noise(25);
}

TEST(UncertaintyLongRun, ResidualComponentsCoverCorrelatedNoiseThatNobodyStated) {
  expect_residual_components_to_cover_correlated_noise(100);
}

TEST(Uncertainty, ResidualsGiveBothComponentsOfTheNoise) {
  VirtualExperiment experiment = published(Random(7));
  const Measurements measured =
      without_sigmas(experiment.measure(400, {.sigma = 0.00004, .common = Eigen::Vector3d::Constant(0.00003)}));
  const Identification found =
      identify_jointly(experiment.model, measured, nominal_start(experiment.model, measured), experiment.free);
  const ResidualNoise noise = noise_from_residuals(
      LeastSquaresProblem(experiment.model, measured, experiment.free).whitened(found.estimate), 33, 1.0);
  EXPECT_NEAR(noise.independent, 0.00004, 0.05 * 0.00004);
  EXPECT_NEAR(noise.common, 0.00003, 0.1 * 0.00003);
}

TEST(Uncertainty, RepeatsGiveBothComponentsOfTheNoise) {
  VirtualExperiment experiment = published(Random(6));
  const Eigen::Vector3d common(0.00006, 0.00005, 0.00003);
  const Measurements measured = experiment.measure(40, {.sigma = 0.00001, .repeats = 20, .common = common});
  const RepeatNoise noise = noise_from_repeats(measured);
  EXPECT_TRUE(noise.separable);
  EXPECT_EQ(noise.degrees_of_freedom, 40 * 3 * 19);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(noise.common[axis], common[axis], 0.1 * common[axis]);
    EXPECT_NEAR(noise.independent[axis], 0.00001, 0.000001);
  }
  const Measurements single = subset(measured, [](const Observation& o) { return o.repeat == 1; });
  EXPECT_EQ(noise_from_repeats(single).degrees_of_freedom, 0.0);
}

TEST(Uncertainty, SummaryOfManyConfigurationsIsThatOfTheStackedJacobian) {
  VirtualExperiment experiment = published(Random(8));
  const auto count = static_cast<int>(LeastSquaresProblem::kManyConfigurations) + 13;
  const Measurements all = experiment.measure(count, {.sigma = 0.0001});
  // Some configurations lack a target or two, and one has none at all.
  const Measurements measured = subset(all, [](const Observation& o) {
    return !(o.configuration % 5 == 1 && o.target == 2) && !(o.configuration % 7 == 2 && o.target != 1) &&
           o.configuration != 4;
  });
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free, {.priors = {.length = 0.001}});
  const Estimate estimate = nominal_start(experiment.model, measured);
  const WhitenedSummary expected = summarised(problem.whitened(estimate));
  const WhitenedSummary found = problem.whitened_summary(estimate);
  EXPECT_EQ(found.rows, expected.rows);
  EXPECT_EQ(found.measured_rows, expected.measured_rows);
  EXPECT_EQ(found.pairs, expected.pairs);
  EXPECT_NEAR(found.squares, expected.squares, 1e-12 * expected.squares);
  EXPECT_NEAR(found.squares_of_sums, expected.squares_of_sums, 1e-12 * expected.squares_of_sums);
  EXPECT_LT((found.priors - expected.priors).norm(), 1e-12 * expected.priors.norm());
  EXPECT_LT((found.sums - expected.sums).norm(), 1e-12 * expected.sums.norm());
  const Eigen::MatrixXd information = expected.triangle.transpose() * expected.triangle;
  EXPECT_LT((found.triangle.transpose() * found.triangle - information).norm(), 1e-12 * information.norm());
}

// The rows of 400 configurations, of correlated noise and with priors, do not fit into one triangle's turn.
TEST(Uncertainty, SummaryOfManyRowsIsThatOfTheStackedJacobian) {
  VirtualExperiment experiment = published(Random(9));
  const Measurements all = experiment.measure(400, {.sigma = 0.0001});
  const Measurements measured = subset(all, [](const Observation& o) { return o.configuration % 7 != o.target; });
  ResidualOptions options{.priors = {.length = 0.001}};
  options.noise.common.setConstant(0.0002);
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free, options);
  const Estimate estimate = nominal_start(experiment.model, measured);
  const WhitenedSystem system = problem.whitened(estimate);
  const WhitenedSummary found = problem.whitened_summary(estimate);

  const Eigen::Index measured_rows = system.blocks.back();
  ASSERT_EQ(measured_rows, 3 * static_cast<Eigen::Index>(measured.observations.size()));
  EXPECT_EQ(found.measured_rows, measured_rows);
  EXPECT_EQ(found.rows, system.jacobian.rows());
  EXPECT_TRUE(found.triangle.isUpperTriangular(0.0));
  const Eigen::MatrixXd information = system.jacobian.transpose() * system.jacobian;
  EXPECT_LT((found.triangle.transpose() * found.triangle - information).norm(), 1e-12 * information.norm());
  const Eigen::VectorXd priors =
      system.jacobian.bottomRows(system.jacobian.rows() - measured_rows).colwise().squaredNorm();
  EXPECT_GT(priors.norm(), 0.0);
  EXPECT_LT((found.priors - priors).norm(), 1e-12 * priors.norm());
  EXPECT_NEAR(found.squares, system.residual.head(measured_rows).squaredNorm(), 1e-12 * found.squares);
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(system.jacobian.cols(), system.jacobian.cols());
  double pairs = 0.0;
  for (std::size_t b = 0; b + 1 < system.blocks.size(); ++b) {
    for (int axis = 0; axis < 3; ++axis) {
      Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(system.jacobian.cols());
      for (Eigen::Index row = system.blocks[b] + axis; row < system.blocks[b + 1]; row += 3) {
        sum += system.jacobian.row(row);
        pairs += static_cast<double>(row - system.blocks[b] - axis) / 3.0;
      }
      sums += sum.transpose() * sum;
    }
  }
  EXPECT_LT((found.sums - sums).norm(), 1e-12 * sums.norm());
  EXPECT_EQ(found.pairs, pairs);
}

TEST(Uncertainty, SummaryTakesConfigurationsOfAnySize) {
  Random random(10);
  Eigen::MatrixXd rows(1500 + 3, 5);
  for (double& element : rows.reshaped()) {
    element = random.normal();
  }
  for (const Eigen::Index first : {3, 600, 1200}) {
    const WhitenedSystem system{
        .jacobian = rows, .residual = Eigen::VectorXd::Zero(rows.rows()), .blocks = {0, first, 1500}};
    const Eigen::MatrixXd triangle = summarised(system).triangle;
    EXPECT_LT((triangle.transpose() * triangle - rows.transpose() * rows).norm(), 1e-10);
  }
  const WhitenedSystem few{.jacobian = rows.topRows(4), .residual = Eigen::VectorXd::Zero(4), .blocks = {0, 3}};
  EXPECT_EQ(summarised(few).triangle, few.jacobian);
}

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

TEST(Uncertainty, LeverageAddsUpToTheRankAndCooksDistanceIsThatOfARefit) {
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
    const Identification full = identify_jointly(experiment.model, measured, nominal_start(experiment.model, measured),
                                                 experiment.free, options);
    const LeastSquaresProblem problem(experiment.model, measured, experiment.free, options.residuals);
    const Eigen::MatrixXd jacobian = problem.whitened(full.estimate).jacobian;
    const Influence found = influence(problem, measured, options.residuals, full.estimate,
                                      problem.whitened_summary(full.estimate).triangle);
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

TEST(Uncertainty, ResidualsOfOneJointAreExplainedByIt) {
  VirtualExperiment experiment = published(Random(11));
  Measurements measured = experiment.measure(60, {.sigma = 1e-6});
  for (Observation& o : measured.observations) {
    const double q = measured.joint_values(3, o.configuration);
    o.position += Eigen::Vector3d(0.0001 * std::sin(q), -0.0002 * std::cos(q), 0.00005);
  }
  const std::vector<double> explained = explained_by_joints(experiment.model, experiment.robot.truth, measured);
  ASSERT_EQ(explained.size(), 6U);
  EXPECT_GT(explained[3], 0.999);
  for (const std::size_t other : {0U, 1U, 2U, 4U, 5U}) {
    EXPECT_GT(explained[other], 0.0);
    EXPECT_LT(explained[other], 0.9);
  }
}

TEST(Uncertainty, RadiusHoldsItsShareOfNormalErrors) {
  EXPECT_NEAR(radius_of_probability(Eigen::Matrix3d::Identity()), 2.79548, 1e-4);  // chi, three degrees of freedom
  EXPECT_NEAR(radius_of_probability(Eigen::Vector3d(0.0, 4.0, 0.0).asDiagonal()), 2.0 * 1.95996, 0.01);
  EXPECT_EQ(radius_of_probability(Eigen::Matrix3d::Zero()), 0.0);
  Random random(10);
  const Eigen::Matrix3d A = Eigen::Matrix3d::NullaryExpr([&] { return random.normal(); });
  const double radius = radius_of_probability(A * A.transpose());
  double inside = 0.0;
  const int draws = 100000;
  for (int i = 0; i < draws; ++i) {
    inside += (A * Eigen::Vector3d{random.normal(), random.normal(), random.normal()}).norm() < radius ? 1.0 : 0.0;
  }
  EXPECT_NEAR(inside / draws, 0.95, 0.003);
}

TEST(Uncertainty, ObservabilityIndicesFollowTheirDefinitions) {
  const Eigen::MatrixXd jacobian = Eigen::Vector3d(4.0, 2.0, 1.0).asDiagonal();
  const ObservabilityIndices o = observability_indices(jacobian, 3);
  EXPECT_NEAR(o.O1, 2.0 / std::sqrt(3.0), 1e-12);
  EXPECT_NEAR(o.O2, 0.25, 1e-12);
  EXPECT_NEAR(o.O3, 1.0, 1e-12);
  EXPECT_NEAR(o.O4, 0.25, 1e-12);
  EXPECT_NEAR(o.O5, 1.0 / 1.75, 1e-12);
}

TEST(Uncertainty, PredictionJacobianIsTheCentralDifference) {
  VirtualExperiment experiment = published(Random(7));
  const VirtualRobot& robot = experiment.robot;
  const Eigen::VectorXd q = experiment.configurations(1).col(0);
  const Measurements measured = experiment.measure(q);
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free);
  const Matrix3Xd jacobian = PositionPredictor(experiment.model, robot.truth, experiment.free).jacobians(q)[2];
  const auto point = [&](const Eigen::VectorXd& step) {
    const Estimate moved = problem.unknowns().moved(robot.truth, step);
    return Eigen::Vector3d(moved.X_WB *
                           (flange_poses(experiment.model, moved, q)[0] * moved.targets[2].X_FT.translation()));
  };
  const Eigen::MatrixXd expected = testing::central_differences(problem.columns(), 1e-6, point);
  for (Eigen::Index c = 0; c < problem.columns(); ++c) {
    EXPECT_LT((jacobian.col(c) - expected.col(c)).norm(), 1e-8) << c;
  }
}

}  // namespace
}  // namespace kdl_calibration
