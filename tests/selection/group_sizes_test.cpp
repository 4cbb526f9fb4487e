#include "selection/group_sizes.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "base/random.hpp"

namespace kdl_calibration::group_sizes_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// y = J x + noise with two free columns and two groups.
struct Rows {
  MatrixXd J;
  VectorXd y;
  SizedGroups groups = {{2, 4, 6}, {3, 5, 7, 8}};
  std::vector<Index> columns = {0, 1, 2, 3, 4, 5, 6, 7, 8};

  Rows(unsigned seed, Index count, double first, double second, double sigma) {
    Random random(seed);
    J.resize(count, 9);
    for (double& entry : J.reshaped()) {
      entry = random.normal();
    }
    VectorXd x(9);
    x[0] = 5.0;
    x[1] = -3.0;
    for (const Index c : groups[0]) {
      x[c] = first * random.normal();
    }
    for (const Index c : groups[1]) {
      x[c] = second * random.normal();
    }
    y = J * x;
    for (double& value : y) {
      value += sigma * random.normal();
    }
  }

  LinearSums sums() const {
    return {.information = J.transpose() * J,
            .moment = J.transpose() * y,
            .squares = y.squaredNorm(),
            .equations = static_cast<double>(J.rows())};
  }
};

/// log of the likelihood of contrasts that the free columns do not touch, written out with the whole covariance
/// (Patterson and Thompson 1971).
double dense_evidence(const Rows& rows, const std::vector<double>& sizes, double sigma) {
  MatrixXd V = sigma * sigma * MatrixXd::Identity(rows.J.rows(), rows.J.rows());
  for (std::size_t g = 0; g < sizes.size(); ++g) {
    const MatrixXd own = rows.J(Eigen::all, rows.groups[g]);
    V += sizes[g] * sizes[g] * own * own.transpose();
  }
  const MatrixXd Q = Eigen::HouseholderQR<MatrixXd>(rows.J.leftCols<2>()).householderQ();
  const MatrixXd K = Q.rightCols(rows.J.rows() - 2);
  const Eigen::LLT<MatrixXd> root(MatrixXd(K.transpose() * V * K));
  const VectorXd contrasts = K.transpose() * rows.y;
  return -0.5 * (2.0 * root.matrixLLT().diagonal().array().log().sum() + contrasts.dot(root.solve(contrasts)));
}

TEST(GroupSizes, TheEstimateIsWhereTheWholeCovarianceHasItsMaximum) {
  const Rows rows(2, 60, 0.3, 0.05, 0.1);
  const GroupSizes found = SizeEstimator(rows.sums(), rows.columns, rows.groups).estimate({}, {}, 1e-9);
  const double best = dense_evidence(rows, found.sizes, found.sigma);
  for (const double factor : {0.97, 1.03}) {
    EXPECT_LT(dense_evidence(rows, {factor * found.sizes[0], found.sizes[1]}, found.sigma), best);
    EXPECT_LT(dense_evidence(rows, {found.sizes[0], factor * found.sizes[1]}, found.sigma), best);
    EXPECT_LT(dense_evidence(rows, found.sizes, factor * found.sigma), best);
  }
}

TEST(GroupSizes, ValuesAreThoseOfRidgeRegression) {
  const Rows rows(3, 30, 0.3, 0.05, 0.1);
  const GroupSizes found =
      SizeEstimator(rows.sums(), rows.columns, rows.groups).estimate({}, {.held = {0.2, 0.04}}, 1e-9);
  MatrixXd M = rows.J.transpose() * rows.J / (found.sigma * found.sigma);
  for (std::size_t g = 0; g < 2; ++g) {
    for (const Index c : rows.groups[g]) {
      M(c, c) += 1.0 / (found.sizes[g] * found.sizes[g]);
    }
  }
  const VectorXd expected = M.ldlt().solve(VectorXd(rows.J.transpose() * rows.y / (found.sigma * found.sigma)));
  EXPECT_LT((found.values - expected).norm(), 1e-10);
}

TEST(GroupSizes, SizesAndNoiseAreTheTrueOnesOnAverage) {
  double first = 0.0;
  double second = 0.0;
  double noise = 0.0;
  constexpr int kRuns = 300;
  for (unsigned run = 0; run < kRuns; ++run) {
    const Rows rows(100 + run, 80, 0.3, 0.2, 0.1);
    const GroupSizes found = SizeEstimator(rows.sums(), rows.columns, rows.groups).estimate({}, {}, 1e-9);
    first += found.sizes[0] * found.sizes[0] / kRuns;
    second += found.sizes[1] * found.sizes[1] / kRuns;
    noise += found.sigma * found.sigma / kRuns;
  }
  EXPECT_NEAR(first, 0.09, 0.015);
  EXPECT_NEAR(second, 0.04, 0.006);
  EXPECT_NEAR(noise, 0.01, 0.0005);
}

TEST(GroupSizes, AmpleOnesAreHardlyEverBelowTheTruth) {
  constexpr int kRuns = 400;
  int above = 0;
  int ample_above = 0;
  for (unsigned run = 0; run < kRuns; ++run) {
    const Rows rows(2000 + run, 20, 0.3, 0.3, 0.1);
    const SizeEstimator estimator(rows.sums(), rows.columns, rows.groups);
    const GroupSizes inflated = estimator.estimate({}, {.held = {}, .most = {}, .inflated = {true, true}}, 1e-9);
    above += estimator.estimate({}, {}, 1e-9).sizes[0] > 0.3 ? 1 : 0;  // of three values
    ample_above += inflated.sizes[0] > 0.3 ? 1 : 0;
  }
  EXPECT_LT(above, 0.6 * kRuns);
  EXPECT_GT(ample_above, 0.8 * kRuns);
  EXPECT_LT(ample_above, kRuns);
}

TEST(GroupSizes, WhatIsNotThereIsSmallOrOff) {
  int off = 0;
  for (unsigned run = 0; run < 50; ++run) {
    const Rows rows(500 + run, 80, 0.3, 0.0, 0.1);
    const GroupSizes found = SizeEstimator(rows.sums(), rows.columns, rows.groups).estimate({}, {}, 1e-9);
    EXPECT_GT(found.sizes[0], 0.02);
    EXPECT_LT(found.sizes[1], 0.05);
    off += found.sizes[1] < 1e-3 ? 1 : 0;
  }
  EXPECT_GT(off, 15);
}

TEST(GroupSizes, WithoutAFoldAreThoseOfTheOthers) {
  const Rows rows(4, 50, 0.3, 0.05, 0.1);
  Rows fold = rows;
  fold.J = rows.J.topRows(5);
  fold.y = rows.y.head(5);
  Rows rest = rows;
  rest.J = rows.J.bottomRows(45);
  rest.y = rows.y.tail(45);
  LinearSums without = fold.sums();
  without.subtract_from(rows.sums());
  const GroupSizes a = SizeEstimator(without, rows.columns, rows.groups).estimate({}, {}, 1e-9);
  const GroupSizes b = SizeEstimator(rest.sums(), rows.columns, rows.groups).estimate({}, {}, 1e-9);
  EXPECT_LT((a.values - b.values).norm(), 1e-8);
  EXPECT_NEAR(a.evidence, b.evidence, 1e-6);
}

TEST(GroupSizes, FreeColumnsThatAreNotDeterminedAreSaid) {
  Rows rows(5, 30, 0.3, 0.05, 0.1);
  rows.J.col(1) = 2.0 * rows.J.col(0);
  EXPECT_FALSE(SizeEstimator(rows.sums(), rows.columns, rows.groups).is_determined());
  Rows few(6, 3, 0.3, 0.05, 0.1);
  EXPECT_FALSE(SizeEstimator(few.sums(), few.columns, few.groups).is_determined()) << "one equation is left";
  Rows four(6, 4, 0.3, 0.05, 0.1);
  EXPECT_TRUE(SizeEstimator(four.sums(), four.columns, four.groups).is_determined()) << "two equations are left";
}

// Of two free columns of which the second is the first and this much of another one.
bool tells_apart(double part) {
  MatrixXd J = MatrixXd::Identity(9, 9);
  J(0, 1) = 3.0;
  J(1, 1) = 3.0 * part;
  const LinearSums sums{
      .information = J.transpose() * J, .moment = VectorXd::Zero(9), .squares = 1.0, .equations = 9.0};
  return SizeEstimator(sums, {0, 1, 2}, {{2}}).is_determined();
}

TEST(GroupSizes, FreeColumnsAreToldApartByAHundredThousandthOfTheirLength) {
  EXPECT_TRUE(tells_apart(1.5e-5));
  EXPECT_FALSE(tells_apart(0.7e-5));
}

TEST(GroupSizes, KeepWhatIsHeldAndStayBelowTheMost) {
  for (unsigned seed = 700; seed < 720; ++seed) {
    const Rows rows(seed, 60, 0.3, 0.2, 0.1);
    const SizeEstimator estimator(rows.sums(), rows.columns, rows.groups);
    for (const bool inflated : {false, true}) {
      const GroupSizes found =
          estimator.estimate({}, {.held = {0.12}, .most = {0.01, 0.03}, .inflated = {inflated, inflated}}, 1e-9);
      EXPECT_NEAR(found.sizes[0], 0.12, 1e-12) << seed;
      EXPECT_NEAR(found.sizes[1], 0.03, 1e-12) << "the truth is far above, seed " << seed;
    }
  }
}

TEST(GroupSizes, AreTheSameFromFarAndFromNear) {
  for (unsigned seed = 700; seed < 720; ++seed) {
    const Rows rows(seed, 60, 0.3, 0.05, 0.1);
    const SizeEstimator estimator(rows.sums(), rows.columns, rows.groups);
    const GroupSizes far = estimator.estimate({}, {}, 1e-9);
    GroupSizes start = far;
    start.sigma *= 1.5;
    std::for_each(start.sizes.begin(), start.sizes.end(), [](double& size) { size *= 1.5; });
    const GroupSizes near = estimator.estimate(start, {}, 1e-9);
    EXPECT_NEAR(near.evidence, far.evidence, 0.02) << seed;
    EXPECT_NEAR(near.sigma, far.sigma, 1e-3 * far.sigma) << seed;
  }
}

TEST(GroupSizes, DoNotDependOnTheUnit) {
  const Rows metres(13, 60, 0.3, 0.05, 0.1);
  Rows millimetres = metres;
  millimetres.y *= 1e3;
  const GroupSizes a =
      SizeEstimator(metres.sums(), metres.columns, metres.groups).estimate({.sizes = {0.2, 0.04}}, {}, 1e-9);
  const GroupSizes b = SizeEstimator(millimetres.sums(), millimetres.columns, millimetres.groups)
                           .estimate({.sizes = {0.2e3, 0.04e3}}, {}, 1e-6);
  for (std::size_t g = 0; g < 2; ++g) {
    EXPECT_NEAR(b.sizes[g], 1e3 * a.sizes[g], 1e-6 * b.sizes[g]) << g;
  }
  EXPECT_NEAR(b.sigma, 1e3 * a.sigma, 1e-6 * b.sigma);
  EXPECT_LT((b.values - 1e3 * a.values).norm(), 1e-6 * b.values.norm());
}

TEST(GroupSizes, EvidenceIsThatOfTheWholeCovarianceWithoutTheFreeColumns) {
  for (const double size : {0.0, 1e-3, 0.2}) {
    const Rows rows(8, 30, 0.3, 0.05, 0.1);
    const SizeEstimator estimator(rows.sums(), rows.columns, rows.groups);
    const GroupSizes found = estimator.estimate({.sizes = {0.3, size}}, {}, 0.2);
    EXPECT_EQ(found.sigma, 0.2) << "rounding";
    EXPECT_NEAR(found.evidence, dense_evidence(rows, found.sizes, found.sigma), 1e-9) << size;
    EXPECT_EQ(found.sizes[1] == 0.0, size == 0.0) << "what is switched off stays so";
  }
}

// One value that one row tells: y = x, beside rows that tell the noise. The first round goes from 1 mm to about x^2
// over the share of x that is told.
double size_of(double value, double sigma) {
  Rows rows(9, 40, 0.0, 0.0, sigma);
  rows.J.setZero();
  rows.J.topLeftCorner<2, 2>().setIdentity();
  rows.J(2, 2) = 1.0;
  rows.y.setConstant(sigma);
  rows.y[2] = value;
  return SizeEstimator(rows.sums(), {0, 1, 2}, {{2}}).estimate({}, {}, 1e-15).sizes[0];
}

TEST(GroupSizes, ASizeBelowTenNanometresIsNone) {
  EXPECT_NEAR(size_of(2e-8, 1e-12) / 2e-8, 1.0, 1e-3);
  EXPECT_EQ(size_of(0.5e-8, 1e-12), 0.0);
}

TEST(GroupSizes, WithoutGroupsTheNoiseIsWhatTheFreeColumnsLeave) {
  const Rows rows(10, 30, 0.0, 0.0, 0.1);
  const SizeEstimator estimator(rows.sums(), {0, 1}, {});
  ASSERT_TRUE(estimator.is_determined());
  const GroupSizes found = estimator.estimate({}, {}, 1e-9);
  const MatrixXd J = rows.J.leftCols<2>();
  const VectorXd x = J.householderQr().solve(rows.y);
  EXPECT_TRUE(found.sizes.empty());
  EXPECT_NEAR(found.sigma, (rows.y - J * x).norm() / std::sqrt(28.0), 1e-12);
  EXPECT_LT((found.values.head<2>() - x).norm(), 1e-12);
  EXPECT_TRUE(found.values.tail<7>().isZero(0.0));
}

}  // namespace
}  // namespace kdl_calibration::group_sizes_test
