// Covariances at their limits: what counts as determined, and spheres about a normal error.

#include "uncertainty/covariance.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "base/decompositions.hpp"
#include "base/random.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "noise/noise_components.hpp"
#include "planning/simulation.hpp"
#include "record.hpp"
#include "robot/joint_ranges.hpp"
#include "uncertainty/published_arm.hpp"
#include "uncertainty/unit_columns.hpp"
#include "virtual_experiment.hpp"
#include "whitened_systems.hpp"

namespace kdl_calibration::covariance_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::column_errors;
using testing::published;
using testing::VirtualExperiment;
using testing::without_sigmas;

MatrixXd random_matrix(Index rows, Index columns, unsigned seed) {
  Random random(61, seed);
  return testing::random_matrix(rows, columns, random);
}

// Two columns of which the smaller singular value is this share of the larger, in any unit.
MatrixXd nearly_parallel(double share) {
  MatrixXd J(2, 2);
  J << 1.0, 1e3 * std::cos(2.0 * std::atan(share)), 0.0, 1e3 * std::sin(2.0 * std::atan(share));
  return J;
}

TEST(Covariance, DirectionsBelowABillionthOfTheLargestAreNotDetermined) {
  const MatrixXd above = covariance(nearly_parallel(2e-9), 1.0);
  EXPECT_TRUE(above.allFinite());
  const double sine = std::sin(2.0 * std::atan(2e-9));
  EXPECT_NEAR(above(0, 0) * sine * sine, 1.0, 1e-6);
  EXPECT_NEAR(above(1, 1) * 1e6 * sine * sine, 1.0, 1e-6);
  EXPECT_EQ(undetermined_directions(nearly_parallel(2e-9)).cols(), 0);
  const MatrixXd below = covariance(nearly_parallel(5e-10), 1.0);
  EXPECT_TRUE(std::isinf(below(0, 0)));
  EXPECT_TRUE(std::isinf(below(1, 1)));
  const MatrixXd directions = undetermined_directions(nearly_parallel(5e-10));
  ASSERT_EQ(directions.cols(), 1);
  EXPECT_NEAR(directions(0, 0) / directions(1, 0), -1e3, 1e-4);
}

// Against the largest of all, not the next one.
TEST(Covariance, DirectionsAreMeasuredByTheLargest) {
  MatrixXd J(3, 3);
  J << 1.0, 1.0, 1.0, 0.0, 1e-5, 0.0, 0.0, 0.0, 1e-10;
  const VectorXd values = (J * unit_scale(J).asDiagonal()).jacobiSvd().singularValues();
  ASSERT_LT(values[2], 5e-10 * values[0]);
  ASSERT_GT(values[2], 1e-6 * values[1]);
  EXPECT_EQ(undetermined_directions(J).cols(), 1);
  EXPECT_TRUE(std::isinf(covariance(J, 1.0)(2, 2)));
}

// Three columns: the first takes part in the direction that is not determined with this share of its square.
VectorXd variances_where_a_column_takes_part(double share) {
  const double angle = std::sqrt(2.0 * share);
  MatrixXd J(2, 3);
  J << -std::sin(0.5 * angle), 1.0, std::cos(angle), std::cos(0.5 * angle), 0.0, std::sin(angle);
  return covariance(J, 1.0).diagonal();
}

TEST(Covariance, AColumnIsNotDeterminedFromAMillionthOfADirectionOn) {
  const VectorXd above = variances_where_a_column_takes_part(2e-6);
  EXPECT_TRUE(above.array().isInf().all()) << above.transpose();
  const VectorXd below = variances_where_a_column_takes_part(5e-7);
  EXPECT_NEAR(below[0], 1.0, 1e-2);
  EXPECT_TRUE(std::isinf(below[1]));
  EXPECT_TRUE(std::isinf(below[2]));
}

TEST(Covariance, OfFewRowsIsThatOfWhatTheyDetermine) {
  MatrixXd J = MatrixXd::Zero(2, 4);
  J(0, 1) = 2.0;
  J(1, 3) = 0.5;
  const MatrixXd found = covariance(J, 3.0);
  EXPECT_TRUE(std::isinf(found(0, 0)));
  EXPECT_TRUE(std::isinf(found(2, 2)));
  EXPECT_NEAR(found(1, 1), 0.75, 1e-14);
  EXPECT_NEAR(found(3, 3), 12.0, 1e-13);
  EXPECT_NEAR(found(1, 3), 0.0, 1e-14);
  const MatrixXd directions = undetermined_directions(J);
  ASSERT_EQ(directions.cols(), 2);
  EXPECT_TRUE((J * directions).isZero(1e-14));
  // What has no column at all counts by itself: along unit vectors.
  EXPECT_NEAR((directions.transpose() * directions - MatrixXd::Identity(2, 2)).norm(), 0.0, 1e-14);
}

// The inverse of a triangle is taken up to a condition of a million, where both agree.
TEST(Covariance, IsTheSameOnBothSidesOfWhereSingularValuesTakeOver) {
  for (const double share : {1e-3, 1e-5, 0.9e-6, 1.1e-6, 1e-7}) {
    const MatrixXd J = nearly_parallel(share);
    const double sine = std::sin(2.0 * std::atan(share));
    EXPECT_EQ(regular_inverse(triangular_factor(J * unit_scale(J).asDiagonal())).has_value(), share > 1e-6) << share;
    EXPECT_EQ(undetermined_directions(J).rows(), 2);
    EXPECT_EQ(undetermined_directions(J).cols(), 0);
    EXPECT_NEAR(covariance(J, 1.0)(0, 0) * sine * sine, 1.0, 1e-8) << share;
    EXPECT_NEAR(covariance(J, 1.0)(0, 1) * 1e3 * sine * sine, -std::cos(2.0 * std::atan(share)), 1e-8) << share;
  }
  EXPECT_FALSE(regular_inverse(MatrixXd::Ones(2, 2)));
  EXPECT_FALSE(regular_inverse(MatrixXd::Zero(2, 2)));
  EXPECT_FALSE(regular_inverse(MatrixXd::Identity(2, 3)));
}

// Above a hundred columns singular values are found in another way. Column 7 is ten times column 130.
TEST(Covariance, OfSquareAndOfWideMatricesIsTheInverseOfTheInformation) {
  for (const auto& [rows, columns] :
       {std::pair<Index, Index>{1, 1}, {2, 2}, {7, 7}, {300, 100}, {300, 101}, {300, 140}}) {
    const MatrixXd J = random_matrix(rows, columns, 4);
    const MatrixXd expected = (J.transpose() * J).inverse();
    EXPECT_LT((covariance(J, 2.0) - 2.0 * expected).norm(), 1e-10 * expected.norm()) << columns;
    EXPECT_EQ(undetermined_directions(J).cols(), 0) << columns;
    MatrixXd in_another_unit = J;  // of the last column
    in_another_unit.col(columns - 1) *= 1e6;
    MatrixXd found = covariance(in_another_unit, 2.0);
    found.row(columns - 1) *= 1e6;
    found.col(columns - 1) *= 1e6;
    EXPECT_LT((found - 2.0 * expected).norm(), 1e-10 * expected.norm()) << columns;
  }
  MatrixXd J = random_matrix(300, 140, 4);
  J.col(7) = 10.0 * J.col(130);
  const MatrixXd found = covariance(J, 1.0);
  MatrixXd without(300, 139);
  without << J.leftCols(7), J.rightCols(132);
  const VectorXd expected = (without.transpose() * without).inverse().diagonal();
  for (Index i = 0; i < 140; ++i) {
    ASSERT_EQ(std::isinf(found(i, i)), i == 7 || i == 130) << i;
    if (i != 7 && i != 130) {
      EXPECT_NEAR(found(i, i) / expected[i < 7 ? i : i - 1], 1.0, 1e-9) << i;
    }
  }
  const MatrixXd directions = undetermined_directions(J);
  ASSERT_EQ(directions.cols(), 1);
  EXPECT_NEAR(directions(7, 0) / directions(130, 0), -0.1, 1e-9);
}

TEST(Covariance, OfNoColumnsIsEmpty) {
  EXPECT_EQ(covariance(MatrixXd(5, 0), 1.0).size(), 0);
  EXPECT_EQ(undetermined_directions(MatrixXd(5, 0)).size(), 0);
  const MatrixXd one = covariance(MatrixXd::Constant(4, 1, 0.5), 3.0);
  ASSERT_EQ(one.size(), 1);
  EXPECT_NEAR(one(0, 0), 3.0, 1e-14);
  const MatrixXd nothing = undetermined_directions(MatrixXd::Constant(4, 1, 0.5));
  EXPECT_EQ(nothing.rows(), 1);
  EXPECT_EQ(nothing.cols(), 0);
  EXPECT_EQ(undetermined_directions(MatrixXd::Zero(4, 1)).cwiseAbs(), MatrixXd::Ones(1, 1));
}

TEST(Covariance, UndeterminedDirectionsAreTheKernel) {
  MatrixXd J = random_matrix(12, 6, 1);
  J.col(1) = 1e4 * J.col(1);
  J.col(4) = 2.0 * J.col(0) - 3.0 * J.col(1);
  J.col(5).setZero();
  const MatrixXd directions = undetermined_directions(J);
  ASSERT_EQ(directions.cols(), 2);
  EXPECT_LT((J * directions).norm(), 1e-9);
  EXPECT_EQ(Eigen::FullPivLU<MatrixXd>(directions).rank(), 2);
  EXPECT_NEAR(directions.row(5).norm(), 1.0, 1e-9) << "a column without effect has no scale";
}

TEST(Covariance, TheTriangleOfAMatrixKeepsItsInformation) {
  const MatrixXd tall = random_matrix(7, 4, 2);
  const MatrixXd sqrt_information = triangular_factor(tall);
  EXPECT_EQ(sqrt_information.rows(), 4);
  EXPECT_TRUE(sqrt_information.isUpperTriangular(0.0));
  EXPECT_LT((sqrt_information.transpose() * sqrt_information - tall.transpose() * tall).norm(), 1e-12);
  const MatrixXd few = random_matrix(3, 4, 3);
  EXPECT_EQ(triangular_factor(few), few);
  EXPECT_EQ(triangular_factor(sqrt_information), sqrt_information);
}

TEST(Covariance, SandwichKeepsWhatIsInfiniteApart) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  for (const Index infinite : {0, 1, 3}) {
    const MatrixXd A = random_matrix(4, 4, 4);
    MatrixXd outer = A * A.transpose();
    outer.row(infinite).setZero();
    outer.col(infinite).setZero();
    const MatrixXd B = random_matrix(4, 4, 5);
    const MatrixXd middle = B * B.transpose();
    const MatrixXd expected = outer * middle * outer;
    outer(infinite, infinite) = kInfinite;
    MatrixXd found = sandwich(outer, middle);
    EXPECT_EQ(found(infinite, infinite), kInfinite);
    found(infinite, infinite) = 0.0;
    EXPECT_LT((found - expected).norm(), 1e-12) << infinite;
  }
}

// Configurations of two points and of one, and a prior, their noise written out.
TEST(Covariance, OfEqualWeightsIsThatOfErrorsWithACommonPart) {
  const MatrixXd rows = random_matrix(13, 4, 7);
  MatrixXd J = rows;
  J.row(12).setZero();
  J(12, 2) = 1.5;
  const WhitenedSystem system{.jacobian = J, .residual = VectorXd::Zero(13), .blocks = {0, 6, 9, 12}};
  const ResidualNoise noise{.independent = 0.2, .common = 0.7, .degrees_of_freedom = 5.0};
  const double unit_weight = 9.0;
  MatrixXd errors = MatrixXd::Zero(13, 13);
  for (Index i = 0; i < 12; ++i) {
    for (Index j = i % 3; j < 12; j += 3) {
      const bool together = (i < 6 && j < 6) || i == j;
      errors(i, j) = unit_weight * ((together ? 0.49 : 0.0) + (i == j ? 0.04 : 0.0));
    }
  }
  errors(12, 12) = 1.0;
  const MatrixXd inverse = (J.transpose() * J).inverse();
  const MatrixXd expected = inverse * J.transpose() * errors * J * inverse;
  EXPECT_LT((covariance(testing::summarised(system), noise, unit_weight) - expected).norm(), 1e-12 * expected.norm());
}

// ---- Monte Carlo ----------------------------------------------------------------------------------------------------

struct CovarianceTrials {
  Eigen::VectorXd std_ratio;  // observed over predicted, per column
  double mean_nees = 0.0;
  double coverage = 0.0;  // of 95 % intervals of predicted coordinates
};

CovarianceTrials monte_carlo(int runs, const MeasuringNoise& noise, const NoiseModel& assumed, bool estimate_noise) {
  VirtualExperiment experiment = published();
  CovarianceTrials result;
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
    const Identification found = joint_fit(experiment, measured, options);
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
      const Eigen::Vector3d error =
          found.estimate.frames.base() * (ours[i] * found.estimate.frames.targets[1].X_FT.translation()) -
          robot.truth.frames.base() * (truth[i] * robot.truth.frames.targets[1].X_FT.translation());
      const Matrix3Xd J = predictor.jacobians(unmeasured.col(c))[1];
      const Eigen::Matrix3d P = J * C * J.transpose();
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

void expect_confirmed(const CovarianceTrials& found, const Tolerance& tolerance) {
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
  const CovarianceTrials independent = monte_carlo(runs / 4, noise, {}, true);
  EXPECT_LT(independent.coverage, 0.92) << "the model without the common part would do as well";
}

TEST(Covariance, MonteCarloConfirmsTheCovariance) { expect_covariance_confirmed(100, kOf100Runs); }

TEST(Covariance, MonteCarloConfirmsTheCovarianceUnderCorrelatedNoise) {
  expect_covariance_confirmed_under_correlated_noise(100, kOf100Runs);
}

TEST(CovarianceLongRun, MonteCarloConfirmsTheCovariance) { expect_covariance_confirmed(1000, kOf1000Runs); }

TEST(CovarianceLongRun, MonteCarloConfirmsTheCovarianceUnderCorrelatedNoise) {
  expect_covariance_confirmed_under_correlated_noise(1000, kOf1000Runs);
}

void expect_residual_components_to_cover_correlated_noise(int runs) {
  VirtualExperiment experiment = published(Random(5));
  double ratio = 0.0;
  for (int run = 0; run < runs; ++run, experiment.draw_robot()) {
    const Measurements measured =
        without_sigmas(experiment.measure(60, {.sigma = 0.00001, .common = Eigen::Vector3d::Constant(0.00005)}));
    const Identification found = joint_fit(experiment, measured);
    const WhitenedSummary system =
        LeastSquaresProblem(experiment.model, measured, experiment.free).whitened_summary(found.estimate);
    const ResidualNoise noise = noise_from_residuals(system, 33, 1.0);
    EXPECT_GT(noise.common, 2.0 * noise.independent);
    const Eigen::VectorXd d = column_errors(experiment, found.estimate, experiment.robot.truth);
    const Eigen::MatrixXd C = covariance(system, noise, 1.0);
    ratio += (d.array().square() / C.diagonal().array()).segment(6, 18).mean() / runs;
  }
  EXPECT_GT(ratio, 0.7);
  EXPECT_LT(ratio, 1.4);
}

TEST(Covariance, ResidualComponentsCoverCorrelatedNoiseThatNobodyStated) {
  expect_residual_components_to_cover_correlated_noise(25);
}

TEST(CovarianceLongRun, ResidualComponentsCoverCorrelatedNoiseThatNobodyStated) {
  expect_residual_components_to_cover_correlated_noise(100);
}

}  // namespace
}  // namespace kdl_calibration::covariance_test
