// Covariances at their limits: what counts as determined, and spheres about a normal error.

#include "kdl_calibration/covariance.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "assessment/unit_columns.hpp"
#include "base/triangular_factor.hpp"
#include "kdl_calibration/random.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::refusal;

MatrixXd random_matrix(Index rows, Index columns, unsigned seed) {
  Random random(61, seed);
  return MatrixXd::NullaryExpr(rows, columns, [&] { return random.normal(); });
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
  EXPECT_TRUE(std::isinf(above[0]));
  EXPECT_TRUE(std::isinf(above[1]));
  EXPECT_TRUE(std::isinf(above[2]));
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

// A full square matrix is not reduced to a triangle.
TEST(Covariance, OfASquareMatrixIsTheInverseOfTheInformation) {
  for (const Index columns : {1, 2, 7}) {
    const MatrixXd J = random_matrix(columns, columns, 3);
    const MatrixXd expected = 3.0 * (J.transpose() * J).inverse();
    EXPECT_LT((covariance(J, 3.0) - expected).norm(), 1e-10 * expected.norm()) << columns;
    EXPECT_EQ(undetermined_directions(J).rows(), columns);
    EXPECT_EQ(undetermined_directions(J).cols(), 0);
  }
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
TEST(Covariance, OfManyColumnsIsTheInverseOfTheInformation) {
  for (const Index columns : {100, 101, 140}) {
    const MatrixXd J = random_matrix(300, columns, 4);
    const MatrixXd expected = (J.transpose() * J).inverse();
    EXPECT_LT((covariance(J, 2.0) - 2.0 * expected).norm(), 1e-11 * expected.norm()) << columns;
    EXPECT_EQ(undetermined_directions(J).cols(), 0) << columns;
  }
  MatrixXd J = random_matrix(300, 140, 4);
  J.col(7) = 10.0 * J.col(130);
  const MatrixXd found = covariance(J, 1.0);
  for (Index i = 0; i < 140; ++i) {
    EXPECT_EQ(std::isinf(found(i, i)), i == 7 || i == 130) << i;
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
  const MatrixXd triangle = triangular_factor(tall);
  EXPECT_EQ(triangle.rows(), 4);
  EXPECT_TRUE(triangle.isUpperTriangular(0.0));
  EXPECT_LT((triangle.transpose() * triangle - tall.transpose() * tall).norm(), 1e-12);
  for (const Index rows : {3, 4}) {
    const MatrixXd few = random_matrix(rows, 4, 3);
    EXPECT_EQ(triangular_factor(few), few) << rows;
  }
}

TEST(Covariance, SandwichKeepsWhatIsInfiniteApart) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  for (const Index infinite : {0, 1, 3}) {
    const MatrixXd A = random_matrix(4, 4, 4);
    MatrixXd outer = A * A.transpose();
    outer(infinite, infinite) = kInfinite;
    const MatrixXd B = random_matrix(4, 4, 5);
    const MatrixXd middle = B * B.transpose();
    const MatrixXd found = sandwich(outer, middle);
    for (Index i = 0; i < 4; ++i) {
      for (Index j = 0; j < 4; ++j) {
        double expected = 0.0;
        for (Index k = 0; k < 4 && i != infinite && j != infinite; ++k) {
          for (Index l = 0; l < 4; ++l) {
            expected += k == infinite || l == infinite ? 0.0 : outer(i, k) * middle(k, l) * outer(l, j);
          }
        }
        EXPECT_NEAR(i == infinite && j == infinite ? 0.0 : found(i, j), expected, 1e-12) << infinite << i << j;
      }
    }
    EXPECT_EQ(found(infinite, infinite), kInfinite);
  }
}

// What one sphere holds of a normal error, by a fine sum over directions v: with rho chi of three degrees of freedom
// the share of rho |C^(1/2) v| below r.
double share_within(double r, const Vector3d& sigmas) {
  constexpr int kAbove = 160;
  constexpr int kAround = 160;
  double share = 0.0;
  for (int i = 0; i < kAbove; ++i) {
    const double z = (i + 0.5) / kAbove;
    for (int j = 0; j < kAround; ++j) {
      const double angle = (j + 0.5) / kAround * std::numbers::pi / 2.0;
      const double flat = std::sqrt(1.0 - z * z);
      const double length = sigmas.cwiseProduct(Vector3d(flat * std::cos(angle), flat * std::sin(angle), z)).norm();
      const double t = r / length;
      share += std::erf(t / std::numbers::sqrt2) - std::sqrt(2.0 / std::numbers::pi) * t * std::exp(-0.5 * t * t);
    }
  }
  return share / (kAbove * kAround);
}

TEST(Covariance, RadiiHoldTheirShareOfNormalErrors) {
  for (const Vector3d& sigmas :
       {Vector3d(1.0, 1.0, 1.0), Vector3d(1.0, 2.0, 3.0), Vector3d(0.2, 5.0, 1.0), Vector3d(3.0, 0.1, 3.0)}) {
    const Matrix3d R = Eigen::AngleAxisd(0.7, Vector3d(1.0, 2.0, -1.0).normalized()).toRotationMatrix();
    for (const double unit : {1.0, 1e-5, 1e4}) {
      const Matrix3d C = unit * unit * R * Vector3d(sigmas.cwiseAbs2()).asDiagonal() * R.transpose();
      EXPECT_EQ(radius_of_probability(C), radius_of_probability(C, 0.95));
      for (const double probability : {0.01, 0.3, 0.95, 0.9999}) {
        const double r = radius_of_probability(C, probability) / unit;
        if (unit != 1.0) {
          EXPECT_NEAR(r, radius_of_probability(Matrix3d(C / (unit * unit)), probability), 1e-9 * r) << sigmas;
          continue;
        }
        const double outside = 1.0 - share_within(r, sigmas);
        EXPECT_NEAR(outside, 1.0 - probability, 2e-2 * std::min(probability, 1.0 - probability))
            << sigmas.transpose() << ", " << probability;
      }
    }
  }
}

// Published quantiles: chi of one, two and three degrees of freedom.
TEST(Covariance, RadiiOfErrorsInALineAPlaneAndAllDirectionsAreThoseOfTheTables) {
  const auto radius = [](double x, double y, double z, double probability) {
    return radius_of_probability(Vector3d(x * x, y * y, z * z).asDiagonal(), probability);
  };
  EXPECT_NEAR(radius(1.0, 1.0, 1.0, 0.95), 2.795483482915, 1e-9);
  EXPECT_NEAR(radius(1.0, 1.0, 1.0, 0.5), 1.538172254386, 1e-9);
  EXPECT_NEAR(radius(1.0, 1.0, 1.0, 0.999999), 5.538, 0.01);
  EXPECT_NEAR(radius(0.0, 1.0, 1.0, 0.95), std::sqrt(-2.0 * std::log(0.05)), 2e-3);
  EXPECT_NEAR(radius(1.0, 0.0, 0.0, 0.95), 1.959964, 2e-3);
  EXPECT_NEAR(radius(0.0, 1e-4, 0.0, 0.95) / 1e-4, 1.959964, 2e-3);
  EXPECT_NEAR(radius(0.0, 0.0, 7.0, 0.95) / 7.0, 1.959964, 2e-3);
}

TEST(Covariance, OfPredictionsIsThatOfTheirColumns) {
  testing::VirtualExperiment experiment;
  const Unknowns free(experiment.model, experiment.targets, {"base.Tx", "base.Rz", "A.x", "B.y"});
  const VectorXd q = experiment.configurations(1).col(0);
  const PositionPredictor predictor(experiment.model, experiment.robot.truth, free);
  const MatrixXd A = random_matrix(4, 4, 6);
  const MatrixXd C = A * A.transpose();
  for (std::size_t target = 0; target < 3; ++target) {
    const MatrixXd J = predictor.jacobians(q)[target];
    EXPECT_LT((predicted_covariance(predictor, C, q, target) - J * C * J.transpose()).norm(), 1e-12) << target;
  }
  EXPECT_EQ(refusal([&] { predicted_covariance(predictor, C, q, 3); }),
            "the target 3 is not there, expected an index below 3");
  EXPECT_EQ(refusal([&] { predicted_covariance(predictor, MatrixXd::Zero(4, 5), q, 0); }),
            "5 columns of a covariance, expected 4");
  EXPECT_EQ(refusal([&] { predicted_covariance(predictor, MatrixXd::Zero(5, 4), q, 0); }),
            "5 rows of a covariance, expected 4");
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
  EXPECT_LT((covariance(system, noise, unit_weight) - expected).norm(), 1e-12 * expected.norm());
  WhitenedSummary summary = summarised(system);
  EXPECT_LT((covariance(summary, noise, unit_weight) - expected).norm(), 1e-12 * expected.norm());
  summary.priors.conservativeResize(3);
  EXPECT_EQ(refusal([&] { covariance(summary, noise, 1.0); }), "3 priors of a summary, expected 4");
  summary = summarised(system);
  summary.sums.conservativeResize(4, 3);
  EXPECT_EQ(refusal([&] { covariance(summary, noise, 1.0); }), "3 columns of a summary's sums, expected 4");
}

}  // namespace
}  // namespace kdl_calibration
