#include "kdl_calibration/group_sizes.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "kdl_calibration/random.hpp"
#include "refusal.hpp"

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

TEST(GroupSizes, AmpleOnesAreHardlyEverBelowTheTruth) {
  constexpr int kRuns = 400;
  int above = 0;
  int ample_above = 0;
  for (unsigned run = 0; run < kRuns; ++run) {
    const Rows rows(2000 + run, 20, 0.3, 0.3, 0.1);
    const SizeEstimator estimator(rows.sums(), rows.columns, rows.groups);
    const GroupSizes ample = estimator.estimate({}, {.held = {}, .most = {}, .ample = {true, true}}, 1e-9);
    above += estimator.estimate({}, {}, 1e-9).sizes[0] > 0.3 ? 1 : 0;  // of three values
    ample_above += ample.sizes[0] > 0.3 ? 1 : 0;
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

/// The iteration as its comment states it, with M = A / sigma^2 + diag(1 / s^2) inverted, all columns in it.
struct PlainIteration {
  const Rows& rows;
  std::vector<double> variances;
  double variance = 0.0;
  std::vector<double> held = {0.0, 0.0};
  std::vector<double> most = {1e9, 1e9};
  double least = 0.0;
  int rounds = 0;
  double evidence = 0.0;
  VectorXd x;

  double left() const { return static_cast<double>(rows.J.rows() - 2); }

  bool is_on(Index column) const {
    for (std::size_t g = 0; g < 2; ++g) {
      const std::vector<Index>& group = rows.groups[g];
      if (std::find(group.begin(), group.end(), column) != group.end()) {
        return variances[g] > 0.0;
      }
    }
    return true;
  }

  // x, the number of values told by each group, and squares left; the evidence.
  std::pair<std::vector<double>, double> solve() {
    std::vector<Index> on;
    for (Index c = 0; c < 9; ++c) {
      if (is_on(c)) {
        on.push_back(c);
      }
    }
    const MatrixXd J = rows.J(Eigen::all, on);
    VectorXd prior = VectorXd::Zero(J.cols());
    std::vector<std::vector<Index>> places(2);
    for (std::size_t i = 0; i < on.size(); ++i) {
      for (std::size_t g = 0; g < 2; ++g) {
        if (std::count(rows.groups[g].begin(), rows.groups[g].end(), on[i]) > 0) {
          prior[static_cast<Index>(i)] = 1.0 / variances[g];
          places[g].push_back(static_cast<Index>(i));
        }
      }
    }
    MatrixXd M = J.transpose() * J / variance;
    M.diagonal() += prior;
    const MatrixXd C = M.inverse();
    const VectorXd values = C * J.transpose() * rows.y / variance;
    x = VectorXd::Zero(9);
    x(on) = values;
    std::vector<double> told(2, 0.0);
    for (std::size_t g = 0; g < 2; ++g) {
      for (const Index i : places[g]) {
        told[g] += 1.0 - C(i, i) * prior[i];
      }
    }
    const double squares = (rows.y - J * values).squaredNorm();
    evidence = dense_evidence(rows, {std::sqrt(variances[0]), std::sqrt(variances[1])}, std::sqrt(variance));
    return {told, squares};
  }

  void run(int most_rounds) {
    double before = -std::numeric_limits<double>::infinity();
    for (rounds = 0; rounds < most_rounds; ++rounds) {
      const auto [told, squares] = solve();
      if (rounds > 1 && evidence < before + 1e-3) {
        break;
      }
      before = evidence;
      for (std::size_t g = 0; g < 2; ++g) {
        if (held[g] == 0.0 && variances[g] != 0.0) {
          double of_group = 0.0;
          for (const Index c : rows.groups[g]) {
            of_group += x[c] * x[c];
          }
          variances[g] = std::min(of_group / std::max(told[g], 1e-6), most[g] * most[g]);
          variances[g] = variances[g] > 1e-16 ? variances[g] : 0.0;
        }
      }
      variance = std::max(squares / std::max(left() - told[0] - told[1], 1.0), least);
    }
    solve();
  }

  /// By two standard errors of the logarithm of a size, 1 / sqrt(2 gamma), gamma no less than half a value.
  void widen(const std::vector<bool>& which) {
    const std::vector<double> told = solve().first;
    for (std::size_t g = 0; g < 2; ++g) {
      if (which[g] && held[g] == 0.0) {
        const double size = std::sqrt(variances[g]) * std::exp(2.0 / std::sqrt(2.0 * std::max(told[g], 0.5)));
        variances[g] = std::pow(std::min(size, most[g]), 2);
      }
    }
    solve();
  }

  // Of what the free columns leave.
  double first_variance(double share) const {
    const MatrixXd J = rows.J.leftCols<2>();
    return share * (rows.y - J * J.householderQr().solve(rows.y)).squaredNorm() / left();
  }
};

void expect_sizes(const GroupSizes& found, const PlainIteration& expected, const std::string& what) {
  ASSERT_EQ(found.sizes.size(), 2U) << what;
  for (std::size_t g = 0; g < 2; ++g) {
    const double size = std::sqrt(expected.variances[g]);
    EXPECT_NEAR(found.sizes[g], size, 1e-8 * size) << what << ", group " << g;
  }
  EXPECT_NEAR(found.sigma, std::sqrt(expected.variance), 1e-7 * found.sigma) << what;
  ASSERT_EQ(found.values.size(), 9) << what;
  EXPECT_LT((found.values - expected.x).norm(), 1e-8 * expected.x.norm()) << what;
}

TEST(GroupSizes, IterateAsTheirFormulasSay) {
  struct Sort {
    std::string name;
    Index rows;
    double first;
    double second;
    double sigma;
  };
  const std::vector<Sort> sorts = {{"large", 40, 0.3, 0.05, 0.1},
                                   {"beside little noise", 25, 3.0, 0.04, 0.01},
                                   {"few rows", 13, 0.3, 0.1, 0.1},
                                   {"lost in the noise", 30, 0.3, 0.0, 0.3}};
  int most_rounds = 0;
  int most_rounds_from_near = 0;
  for (const Sort& sort : sorts) {
    for (unsigned seed = 0; seed < 8; ++seed) {
      const std::string what = sort.name + ", seed " + std::to_string(seed);
      const Rows rows(700 + seed, sort.rows, sort.first, sort.second, sort.sigma);
      const SizeEstimator estimator(rows.sums(), rows.columns, rows.groups);
      PlainIteration from_far{.rows = rows, .variances = {1e-6, 1e-6}};
      from_far.variance = from_far.first_variance(0.1);
      from_far.run(60);
      most_rounds = std::max(most_rounds, from_far.rounds);
      expect_sizes(estimator.estimate({}, {}, 1e-9), from_far, what);
      PlainIteration from_near{.rows = rows, .variances = {0.04, 0.0025}};
      from_near.variance = from_near.first_variance(1.0);
      from_near.run(8);
      most_rounds_from_near = std::max(most_rounds_from_near, from_near.rounds);
      expect_sizes(estimator.estimate({0.2, 0.05}, {}, 1e-9), from_near, what + ", from near");
      PlainIteration limited{.rows = rows, .variances = {0.0144, 1e-6}, .held = {0.12, 0.0}, .most = {0.01, 0.03}};
      limited.variance = limited.first_variance(0.1);
      limited.run(60);
      expect_sizes(estimator.estimate({}, {.held = {0.12}, .most = {0.01, 0.03}, .ample = {}}, 1e-9), limited,
                   what + ", limited");
      limited.widen({true, true});
      expect_sizes(estimator.estimate({}, {.held = {0.12}, .most = {0.01, 0.03}, .ample = {true, true}}, 1e-9), limited,
                   what + ", ample and limited");
      from_far.widen({false, true});
      expect_sizes(estimator.estimate({}, {.held = {}, .most = {}, .ample = {false, true}}, 1e-9), from_far,
                   what + ", ample");
    }
  }
  EXPECT_GT(most_rounds, 10) << "rounds of the slowest";
  EXPECT_EQ(most_rounds_from_near, 8) << "rounds of the slowest";
}

TEST(GroupSizes, EvidenceDiffersFromThatOfTheWholeCovarianceByTheFreeColumnsAlone) {
  for (const double size : {0.0, 1e-3, 0.2}) {
    const Rows rows(8, 30, 0.3, 0.05, 0.1);
    const SizeEstimator estimator(rows.sums(), rows.columns, rows.groups);
    const GroupSizes found = estimator.estimate({0.3, size}, {}, 0.2);
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

TEST(GroupSizes, WithoutFreeColumnsAllIsSized) {
  Rows rows(11, 30, 0.3, 0.2, 0.1);
  rows.y -= rows.J.leftCols<2>() * Eigen::Vector2d(5.0, -3.0);
  const GroupSizes found =
      SizeEstimator(rows.sums(), {2, 3, 4, 5, 6, 7, 8}, rows.groups).estimate({}, {.held = {0.3, 0.2}}, 1e-9);
  VectorXd prior = VectorXd::Constant(9, 1.0 / 0.04);
  prior(rows.groups[0]).setConstant(1.0 / 0.09);
  MatrixXd M = rows.J.transpose() * rows.J / (found.sigma * found.sigma);
  M.diagonal() += prior;
  const MatrixXd part = M.bottomRightCorner<7, 7>();
  const VectorXd moment = rows.J.transpose() * rows.y / (found.sigma * found.sigma);
  EXPECT_LT((found.values.tail<7>() - part.inverse() * moment.tail<7>()).norm(), 1e-10);
  EXPECT_TRUE(found.values.head<2>().isZero(0.0));
}

TEST(GroupSizes, RefuseSumsAndColumnsThatDoNotFit) {
  using testing::refusal;
  const Rows rows(12, 30, 0.3, 0.2, 0.1);
  LinearSums sums = rows.sums();
  EXPECT_EQ(refusal([&] {
              SizeEstimator(sums, {0, 9}, rows.groups);
            }),
            "column 9 is not there, expected an index below 9");
  EXPECT_EQ(refusal([&] {
              SizeEstimator(sums, {0, 1}, {{2, 9}});
            }),
            "the column of a group 9 is not there, expected an index below 9");
  sums.moment.conservativeResize(8);
  EXPECT_EQ(refusal([&] { SizeEstimator(sums, {0, 1}, {}); }), "8 moments of sums, expected 9");
  sums = rows.sums();
  sums.information.conservativeResize(8, 9);
  EXPECT_EQ(refusal([&] { SizeEstimator(sums, {0, 1}, {}); }), "8 rows of sums, expected 9");
}

TEST(GroupSizes, SumsAreTakenOffEntryByEntry) {
  LinearSums all{
      .information = MatrixXd::Constant(2, 2, 5.0), .moment = VectorXd::Ones(2), .squares = 7.0, .equations = 9};
  all -= {.information = MatrixXd::Identity(2, 2), .moment = VectorXd::Unit(2, 0), .squares = 3.0, .equations = 4.0};
  EXPECT_EQ(all.information, (MatrixXd(2, 2) << 4.0, 5.0, 5.0, 4.0).finished());
  EXPECT_EQ(all.moment, VectorXd::Unit(2, 1));
  EXPECT_EQ(all.squares, 4.0);
  EXPECT_EQ(all.equations, 5.0);
}

}  // namespace
}  // namespace kdl_calibration
