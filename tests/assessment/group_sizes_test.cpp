#include "kdl_calibration/group_sizes.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>

#include "kdl_calibration/random.hpp"

namespace kdl_calibration {
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

TEST(GroupSizes, EvidenceIsThatOfTheWholeCovariance) {
  const Rows rows(1, 40, 0.3, 0.05, 0.1);
  const SizeEstimator estimator(rows.sums(), rows.columns, rows.groups);
  ASSERT_TRUE(estimator.is_determined());
  const GroupSizes a = estimator.estimate({}, {.held = {0.3, 0.05}}, 1e-9);
  const GroupSizes b = estimator.estimate({}, {.held = {0.1, 0.2}}, 1e-9);
  EXPECT_NEAR(a.evidence - b.evidence, dense_evidence(rows, a.sizes, a.sigma) - dense_evidence(rows, b.sizes, b.sigma),
              1e-9);
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
  LinearSums without = rows.sums();
  without -= fold.sums();
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
}

}  // namespace
}  // namespace kdl_calibration
