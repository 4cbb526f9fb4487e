// Variances of parts: where the restricted likelihood of the whole covariance has its maximum, and Monte Carlo.

#include "noise/variance_estimation.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "base/distributions.hpp"
#include "base/random.hpp"

namespace kdl_calibration::variance_estimation_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Variances = NoiseParts::Variances;

constexpr double kMetre = 1e-10;   // [m^2] the size of the variances of positions
constexpr double kRadian = 1e-7;   // [rad^2] of orientations
constexpr double kSettled = 2e-6;  // twice what an iteration leaves

enum class Kind { means, repeats, orientations };

/// Rows of strata, each with its Jacobian, and the task that they make.
struct Rows {
  MatrixXd J;
  VectorXd e;
  std::vector<std::size_t> of;  // the stratum of each row
  VarianceTask task;

  explicit Rows(Index columns) : J(0, columns), e(0) {
    task.stated = Variances::Zero();
    task.priors = MatrixXd::Zero(columns, columns);
    task.prior_gradient = VectorXd::Zero(columns);
  }

  void add(Kind kind, const MatrixXd& jacobian, const VectorXd& residual, const Variances& coefficients, double known) {
    Stratum& stratum = task.strata.emplace_back();
    stratum.coefficients = coefficients;
    stratum.known = known;
    stratum.count = static_cast<double>(residual.size());
    if (kind == Kind::repeats) {
      stratum.squares = residual.squaredNorm();
    } else {
      for (Index i = 0; i < residual.size(); ++i) {
        stratum.add_row(jacobian.row(i), residual[i], 1.0);
      }
      stratum.complete();
    }
    const Index before = e.size();
    J.conservativeResize(before + residual.size(), J.cols());
    J.bottomRows(residual.size()) = kind == Kind::repeats ? MatrixXd::Zero(residual.size(), J.cols()) : jacobian;
    e.conservativeResize(before + residual.size());
    e.tail(residual.size()) = residual;
    of.insert(of.end(), static_cast<std::size_t>(residual.size()), task.strata.size() - 1);
  }

  Index strata() const { return static_cast<Index>(task.strata.size()); }
  const Stratum& stratum(Index s) const { return task.strata[static_cast<std::size_t>(s)]; }

  MatrixXd design() const {
    MatrixXd D(strata(), task.unknown.cols());
    for (Index s = 0; s < strata(); ++s) {
      D.row(s) = stratum(s).coefficients.transpose() * task.unknown;
    }
    return D;
  }
  /// Variances of the strata by those of the parts.
  VectorXd lambda(const Variances& parts) const {
    VectorXd result(strata());
    for (Index s = 0; s < strata(); ++s) {
      result[s] = stratum(s).known + stratum(s).coefficients.dot(parts);
    }
    return result;
  }
  VectorXd by_row(const VectorXd& of_strata) const {
    VectorXd result(e.size());
    for (Index i = 0; i < e.size(); ++i) {
      result[i] = of_strata[static_cast<Index>(of[static_cast<std::size_t>(i)])];
    }
    return result;
  }
  /// Sums over the rows of each stratum.
  VectorXd by_stratum(const VectorXd& of_rows) const {
    VectorXd result = VectorXd::Zero(strata());
    for (Index i = 0; i < e.size(); ++i) {
      result[static_cast<Index>(of[static_cast<std::size_t>(i)])] += of_rows[i];
    }
    return result;
  }
  /// tr(M_st M_ts) of the blocks of a symmetric matrix.
  MatrixXd squared_blocks(const MatrixXd& M) const {
    MatrixXd result = MatrixXd::Zero(strata(), strata());
    for (Index i = 0; i < e.size(); ++i) {
      for (Index j = 0; j < e.size(); ++j) {
        result(static_cast<Index>(of[static_cast<std::size_t>(i)]),
               static_cast<Index>(of[static_cast<std::size_t>(j)])) += M(i, j) * M(j, i);
      }
    }
    return result;
  }
  VectorXd unknowns(const Variances& parts) const {
    return task.unknown.householderQr().solve(VectorXd(parts - task.stated));
  }
};

/// Restricted likelihood of rows with these variances: what priors are about is a part of the rows' covariance.
struct Restricted {
  MatrixXd P;
  VectorXd pulled;  // P d

  Restricted(const Rows& rows, const VectorXd& lambda) {
    MatrixXd V = rows.by_row(lambda).asDiagonal();
    VectorXd d = rows.e;
    std::vector<Index> free;
    std::vector<Index> known;
    for (Index c = 0; c < rows.J.cols(); ++c) {
      (rows.task.priors(c, c) > 0.0 ? known : free).push_back(c);
    }
    const MatrixXd slope = rows.J(Eigen::all, known) * rows.task.priors(known, known).inverse();
    V += slope * rows.J(Eigen::all, known).transpose();
    d -= slope * rows.task.prior_gradient(known);
    const MatrixXd inverse = V.inverse();
    const MatrixXd J = rows.J(Eigen::all, free);
    P = inverse - inverse * J * (J.transpose() * inverse * J).inverse() * J.transpose() * inverse;
    pulled = P * d;
  }
};

void draw_unknown_parts(Rows& rows, Random& random) {
  std::vector<std::pair<Index, Index>> tied = {{0, 1}, {1, 1}, {2, 3}, {5, 3}, {8, 1}};
  tied.erase(tied.begin() + static_cast<std::ptrdiff_t>(random.bits() % 4));
  rows.task.unknown = MatrixXd::Zero(NoiseParts::kCount, static_cast<Index>(tied.size()));
  for (std::size_t i = 0; i < tied.size(); ++i) {
    rows.task.unknown.col(static_cast<Index>(i)).segment(tied[i].first, tied[i].second).setOnes();
  }
  for (Index k = 0; k < NoiseParts::kCount; ++k) {
    const double size = k == NoiseParts::kOrientation ? kRadian : kMetre;
    rows.task.stated[k] = rows.task.unknown.row(k).sum() > 0.0 ? 0.0 : 0.2 * size * random.uniform(0.0, 1.0);
  }
}

/// Up to eight strata of positions and one of orientations. Of the variances behind them some are none.
// NOLINTNEXTLINE(readability-function-cognitive-complexity): the rule written out
Rows random_rows(unsigned seed) {
  Random random(211, seed);
  constexpr Index kColumns = 4;
  const auto normal = [&] { return random.normal(); };
  Rows rows(kColumns);
  for (const Index c : {Index{1}, Index{3}}) {
    rows.task.priors(c, c) = random.uniform(0.5, 2.0) / kMetre;
    rows.task.prior_gradient[c] = random.normal() / std::sqrt(kMetre);
  }
  rows.task.priors(1, 3) = rows.task.priors(3, 1) = 0.4 / kMetre;
  Variances truth;
  for (Index k = 0; k < NoiseParts::kCount; ++k) {
    const double size = k == NoiseParts::kOrientation ? kRadian : kMetre;
    truth[k] = random.uniform(0.0, 1.0) < 0.4 ? 0.0 : size * std::pow(10.0, random.uniform(-1.0, 1.0));
  }
  draw_unknown_parts(rows, random);
  const auto strata = static_cast<Index>(6 + random.bits() % 3);
  for (Index s = 0; s <= strata; ++s) {
    const Kind kind = s == strata ? Kind::orientations : random.bits() % 3 == 0 ? Kind::repeats : Kind::means;
    const bool turned = kind == Kind::orientations;
    Variances coefficients = Variances::Zero();
    for (Index k = turned ? 8 : 0; k < (turned ? 9 : 8); ++k) {
      coefficients[k] = random.bits() % 2 == 0 && !turned ? 0.0 : random.uniform(0.3, 3.0);
    }
    const double known = (turned ? kRadian : kMetre) * random.uniform(0.05, 0.3);
    const auto count = static_cast<Index>(6 + random.bits() % 9);
    const MatrixXd J = MatrixXd::NullaryExpr(count, kColumns, normal);
    const double sigma = std::sqrt(known + coefficients.dot(truth));
    rows.add(kind, J, VectorXd::NullaryExpr(count, [&] { return sigma * random.normal(); }), coefficients, known);
  }
  return rows;
}

double difference(const MatrixXd& a, const MatrixXd& b) { return (a - b).norm() / std::max(b.norm(), 1e-300); }

/// Fields of the parts that follow from weights and variances of the strata.
void expect_parts(const Rows& rows, const NoiseParts& found, const VectorXd& weights, const VectorXd& freedom,
                  const std::string& what) {
  double of_means = 0.0;
  for (Index s = 0; s < rows.strata(); ++s) {
    of_means += rows.stratum(s).is_of_means() ? freedom[s] : 0.0;
  }
  EXPECT_NEAR(found.degrees_of_freedom, of_means, 1e-7 * (1.0 + of_means)) << what;
  EXPECT_FALSE(found.converged) << what;
  ASSERT_EQ(found.sensitivity.size(), 9U) << what;
  const VectorXd w2 = rows.by_row(weights.cwiseAbs2());
  for (Index k = 0; k < NoiseParts::kCount; ++k) {
    const auto part = static_cast<std::size_t>(k);
    EXPECT_EQ(found.estimated[part], rows.task.unknown.row(k).sum() > 0.0) << what << ", part " << k;
    if (!found.estimated[part]) {
      EXPECT_EQ(found.sensitivity[part].size(), 0) << what << ", part " << k;
      EXPECT_EQ(found.variances[k], rows.task.stated[k]) << what << ", part " << k;
      continue;
    }
    VectorXd coefficients(rows.strata());
    for (Index s = 0; s < rows.strata(); ++s) {
      coefficients[s] = rows.stratum(s).coefficients[k];
    }
    const VectorXd factor = w2.cwiseProduct(rows.by_row(coefficients));
    const MatrixXd expected = rows.J.transpose() * factor.asDiagonal() * rows.J;
    EXPECT_LE((found.sensitivity[part] - expected).norm(), 1e-8 * expected.norm()) << what << ", part " << k;
  }
}

/// Of the unknowns that are not zero; the others have no variance.
MatrixXd covariance_of_parts(const Rows& rows, const VectorXd& x, const MatrixXd& fisher) {
  std::vector<Index> positive;
  for (Index i = 0; i < x.size(); ++i) {
    if (x[i] > 1e-20) {
      positive.push_back(i);
    }
  }
  if (positive.empty()) {
    return MatrixXd::Zero(NoiseParts::kCount, NoiseParts::kCount);
  }
  const MatrixXd expand = rows.task.unknown(Eigen::all, positive);
  const MatrixXd part = fisher(positive, positive);
  const VectorXd scale = part.diagonal().cwiseSqrt().cwiseInverse();
  const MatrixXd inverse =
      scale.asDiagonal() * MatrixXd(scale.asDiagonal() * part * scale.asDiagonal()).inverse() * scale.asDiagonal();
  return expand * inverse * expand.transpose();
}

/// Of unknowns at what should be a minimum.
struct Least {
  bool is_one = true;
  int zeros = 0;
};

/// A slope of zero where an unknown is positive, and none that falls where it is zero. `size`: of what it is made of.
Least least(const VectorXd& x, const VectorXd& slope, const VectorXd& size) {
  Least result;
  for (Index i = 0; i < x.size(); ++i) {
    const bool zero = std::abs(x[i]) <= 1e-20;
    result.zeros += zero ? 1 : 0;
    if (size[i] == 0.0) {  // of no stratum
      result.is_one = result.is_one && zero;
    } else {
      const double relative = slope[i] / size[i];
      result.is_one = result.is_one && (zero ? relative > -kSettled : x[i] > 0.0 && std::abs(relative) < kSettled);
    }
  }
  return result;
}

TEST(VarianceEstimation, MaximisesTheRestrictedLikelihoodWithinWhatVariancesMayBe) {
  int zeros = 0;
  int unsettled = 0;
  for (unsigned seed = 0; seed < 150; ++seed) {
    const std::string what = "seed " + std::to_string(seed);
    const Rows rows = random_rows(seed);
    VarianceEstimation estimation(rows.task);
    ASSERT_EQ(estimation.unknowns(), rows.task.unknown.cols());
    if (!estimation.maximise()) {
      ++unsettled;
      continue;
    }
    const NoiseParts found = estimation.parts();
    const VectorXd x = rows.unknowns(found.variances);
    const VectorXd lambda = rows.lambda(found.variances);
    const Restricted likelihood(rows, lambda);
    const MatrixXd D = rows.design();
    const VectorXd traces = rows.by_stratum(likelihood.P.diagonal());
    const VectorXd squares = rows.by_stratum(likelihood.pulled.cwiseAbs2());
    const Least minimum = least(x, D.transpose() * (traces - squares), D.transpose() * (traces + squares));
    EXPECT_TRUE(minimum.is_one) << what;
    zeros += minimum.zeros;
    const MatrixXd fisher = 0.5 * D.transpose() * rows.squared_blocks(likelihood.P) * D;
    EXPECT_LT(difference(found.covariance, covariance_of_parts(rows, x, fisher)), 1e-4) << what;
    EXPECT_EQ(found.scatter.size(), 0) << what;
    const VectorXd freedom = traces.cwiseProduct(lambda);
    expect_parts(rows, found, lambda.cwiseInverse(), freedom, what);
    double ratio = 0.0;
    for (Index s = 0; s < rows.strata(); ++s) {
      ratio += rows.stratum(s).is_of_means() ? squares[s] * lambda[s] : 0.0;
    }
    const double of_means = found.degrees_of_freedom;
    const double tail = of_means > 0.0 ? reduced_chi_squared_tail(ratio / of_means, of_means) : 1.0;
    EXPECT_NEAR(estimation.tail_of_means(), tail, 1e-6) << what;
  }
  EXPECT_LE(unsettled, 6) << "of 150 are not found in 200 rounds";
  EXPECT_GT(zeros, 120) << "of the unknowns are zero";
  EXPECT_LT(zeros, 450) << "of the unknowns are zero";
}

// Two parts behind three strata, of which the columns take a little: estimates are unbiased and scatter as they say.
TEST(VarianceEstimation, EstimatesAreRightOnAverageAndScatterAsTheySay) {
  constexpr int kRuns = 300;
  const Eigen::Vector2d truth(4.0 * kMetre, 1.5 * kMetre);
  for (const bool likelihood : {true, false}) {
    Random random(3);
    Eigen::Vector2d mean = Eigen::Vector2d::Zero();
    Eigen::Vector2d squares = Eigen::Vector2d::Zero();
    Eigen::Vector2d stated = Eigen::Vector2d::Zero();
    for (int run = 0; run < kRuns; ++run) {
      Rows rows(4);
      rows.task.unknown = MatrixXd::Identity(NoiseParts::kCount, 2);
      const VectorXd x = VectorXd::NullaryExpr(4, [&] { return 1e-4 * random.normal(); });
      for (const auto& [kind, first] : {std::pair{Kind::means, 1.0}, {Kind::means, 3.0}, {Kind::repeats, 0.0}}) {
        const MatrixXd J = MatrixXd::NullaryExpr(60, 4, [&] { return random.normal(); });
        const double sigma = std::sqrt(first * truth[0] + truth[1]);
        VectorXd e = VectorXd::NullaryExpr(60, [&] { return sigma * random.normal(); });
        if (kind == Kind::means) {
          e += J * x;
        }
        rows.add(kind, J, e, first * Variances::Unit(0) + Variances::Unit(1), 0.0);
      }
      VarianceEstimation estimation(rows.task);
      ASSERT_TRUE(likelihood ? estimation.maximise() : estimation.match(Variances::Constant(kMetre))) << run;
      const NoiseParts found = estimation.parts();
      mean += found.variances.head<2>() / kRuns;
      squares += (found.variances.head<2>() - truth).cwiseAbs2() / kRuns;
      stated += found.covariance.diagonal().head<2>() / kRuns;
    }
    for (Index k = 0; k < 2; ++k) {
      const double scatter = std::sqrt(squares[k]);
      EXPECT_NEAR(mean[k], truth[k], 4.0 * scatter / std::sqrt(kRuns)) << k << ", " << likelihood;
      EXPECT_NEAR(std::sqrt(stated[k]) / scatter, 1.0, 0.2) << k << ", " << likelihood;
    }
  }
}

/// Rows of one part each, without columns that matter.
Rows plain_rows(const std::vector<double>& residuals_of_first, const std::vector<double>& of_second) {
  Rows rows(1);
  rows.task.unknown = MatrixXd::Identity(NoiseParts::kCount, 2);
  Index part = 0;
  for (const auto& residuals : {residuals_of_first, of_second}) {
    const VectorXd e = VectorXd::Map(residuals.data(), static_cast<Index>(residuals.size()));
    rows.add(Kind::means, MatrixXd::Zero(e.size(), 1), e, Variances::Unit(part++), 0.0);
  }
  return rows;
}

TEST(VarianceEstimation, GivesMeanSquaresWhereNoColumnTakesAnything) {
  for (const bool likelihood : {true, false}) {
    const Rows rows = plain_rows({3e-5, -4e-5}, {1e-5, 2e-5, 2e-5, -1e-5});
    VarianceEstimation estimation(rows.task);
    ASSERT_TRUE(likelihood ? estimation.maximise() : estimation.match(Variances::Constant(7.0)));
    const NoiseParts found = estimation.parts();
    EXPECT_NEAR(found.variances[0] / 12.5e-10, 1.0, 1e-6) << likelihood;
    EXPECT_NEAR(found.variances[1] / 2.5e-10, 1.0, 1e-6) << likelihood;
    EXPECT_NEAR(found.degrees_of_freedom, 6.0, 1e-6) << likelihood;
    EXPECT_NEAR(found.covariance(0, 0) / (12.5e-10 * 12.5e-10), 1.0, 1e-5) << likelihood << ": 2 v^2 / 2";
    EXPECT_NEAR(found.covariance(1, 1) / (2.5e-10 * 2.5e-10 / 2.0), 1.0, 1e-5) << likelihood << ": 2 v^2 / 4";
    EXPECT_NEAR(estimation.tail_of_means(), reduced_chi_squared_tail(1.0, 6.0), 1e-6) << likelihood;
  }
}

TEST(VarianceEstimation, JudgesWhatIsKnownWhereNothingIsUnknown) {
  Rows rows = plain_rows({3.0, 4.0}, {1.0});
  rows.task.unknown.resize(NoiseParts::kCount, 0);
  rows.task.stated[0] = 2.0;
  rows.task.stated[1] = 4.0;
  VarianceEstimation estimation(rows.task);
  ASSERT_EQ(estimation.unknowns(), 0);
  ASSERT_TRUE(estimation.maximise());
  EXPECT_NEAR(estimation.tail_of_means(), reduced_chi_squared_tail((25.0 / 2.0 + 1.0 / 4.0) / 3.0, 3.0), 1e-12);
}

TEST(VarianceEstimation, FindsNothingWhereAKindOfRowsHasNoSquares) {
  Rows none(1);
  none.task.unknown = MatrixXd::Identity(NoiseParts::kCount, 1);
  EXPECT_FALSE(VarianceEstimation(none.task).maximise()) << "no rows";
  EXPECT_FALSE(VarianceEstimation(none.task).match(Variances::Ones())) << "no rows";
  Rows rows = plain_rows({3.0, 4.0}, {0.0});
  EXPECT_TRUE(VarianceEstimation(rows.task).match(Variances::Ones())) << "other positions have some";
  rows.add(Kind::orientations, MatrixXd::Zero(2, 1), VectorXd::Zero(2), Variances::Unit(NoiseParts::kOrientation), 0.0);
  EXPECT_FALSE(VarianceEstimation(rows.task).maximise()) << "orientations have none";
  EXPECT_FALSE(VarianceEstimation(rows.task).match(Variances::Ones())) << "orientations have none";
}

TEST(VarianceEstimation, AsksNothingOfMeansThatAreNotThere) {
  Rows rows(1);
  rows.task.unknown = MatrixXd::Identity(NoiseParts::kCount, 1);
  rows.add(Kind::repeats, MatrixXd::Zero(2, 1), Eigen::Vector2d(3.0, 4.0), Variances::Unit(0), 0.0);
  VarianceEstimation estimation(rows.task);
  ASSERT_TRUE(estimation.maximise());
  EXPECT_EQ(estimation.tail_of_means(), 1.0);
  EXPECT_EQ(estimation.parts().degrees_of_freedom, 0.0);
}

// One row each of two strata and one column, which leaves share^2 / (1 + share^2) of the first row's freedom.
NoiseParts nearly_used_up(double share) {
  Rows rows(1);
  rows.task.unknown = MatrixXd::Identity(NoiseParts::kCount, 1);
  rows.add(Kind::means, MatrixXd::Ones(1, 1), VectorXd::Zero(1), Variances::Unit(0), 1.0);
  rows.add(Kind::means, MatrixXd::Constant(1, 1, share), VectorXd::Constant(1, 2.0), Variances::Zero(), 1.0);
  VarianceEstimation estimation(rows.task);
  EXPECT_TRUE(estimation.maximise());
  return estimation.parts();
}

TEST(VarianceEstimation, LeavesAtZeroWhatTheColumnsUseUp) {
  const double more_than_half = 0.51 / 0.49;
  const double estimated = nearly_used_up(std::sqrt(more_than_half)).variances[0];
  // The one contrast has the variance 1 + share^2 (1 + x) and the square 4.
  EXPECT_NEAR(estimated, 3.0 / more_than_half - 1.0, 1e-6);
  EXPECT_EQ(nearly_used_up(std::sqrt(0.49 / 0.51)).variances[0], 0.0);
  EXPECT_EQ(nearly_used_up(std::sqrt(2e-6)).variances[0], 0.0);
  EXPECT_EQ(nearly_used_up(0.0).variances[0], 0.0);
}

TEST(VarianceEstimation, TakesColumnsThatNothingTellsApart) {
  const Rows rows = random_rows(1);
  MatrixXd J = MatrixXd::Zero(rows.J.rows(), 6);
  J.leftCols<5>() << rows.J, rows.J.col(0);
  Rows twice(6);
  twice.task.stated = rows.task.stated;
  twice.task.unknown = rows.task.unknown;
  twice.task.priors.topLeftCorner<4, 4>() = rows.task.priors;
  twice.task.prior_gradient.head<4>() = rows.task.prior_gradient;
  for (Index s = 0; s < rows.strata(); ++s) {
    std::vector<Index> own;
    for (std::size_t i = 0; i < rows.of.size(); ++i) {
      if (static_cast<Index>(rows.of[i]) == s) {
        own.push_back(static_cast<Index>(i));
      }
    }
    const Stratum& stratum = rows.stratum(s);
    twice.add(stratum.predicted ? Kind::means : Kind::repeats, J(own, Eigen::all), rows.e(own), stratum.coefficients,
              stratum.known);
  }
  VarianceEstimation once(rows.task);
  VarianceEstimation doubled(twice.task);
  ASSERT_TRUE(once.maximise());
  ASSERT_TRUE(doubled.maximise());
  EXPECT_LT(difference(doubled.parts().variances, once.parts().variances), 1e-4);
  EXPECT_NEAR(doubled.parts().degrees_of_freedom, once.parts().degrees_of_freedom, 1e-3);
}

}  // namespace
}  // namespace kdl_calibration::variance_estimation_test
