#include "base/dense.hpp"

#include <gtest/gtest.h>
#include <Eigen/Dense>
#include <limits>

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

MatrixXd random(Index rows, Index columns) {
  std::srand(1);
  return MatrixXd::Random(rows, columns);
}

MatrixXd lower(const MatrixXd& matrix) { return matrix.triangularView<Eigen::Lower>(); }

// Sizes below, at and above those of a tile, of the cached rows and of the depth at a time.
constexpr Index kSizes[] = {1, 4, 23, 24, 25, 49, 130, 257, 301};

TEST(Dense, ProductsAreThoseOfEigen) {
  for (const Index n : kSizes) {
    for (const Index depth : {Index{1}, Index{40}, Index{300}}) {
      const MatrixXd A = random(n, depth);
      const MatrixXd B = random(depth, n + 3);
      MatrixXd sum = MatrixXd::Ones(n, n + 3);
      add_product(-0.5, factor(A), factor(B).transposed(), sum);
      EXPECT_LT((sum - MatrixXd::Ones(n, n + 3) + 0.5 * A * B).norm(), 1e-9) << n << " " << depth;
      MatrixXd square = MatrixXd::Zero(n, n);
      add_symmetric_product(1.0, factor(A), factor(A), square);
      EXPECT_LT(lower(square - A * A.transpose()).norm(), 1e-9) << n << " " << depth;
      EXPECT_LT((symmetric_product(factor(A), factor(A)) - A * A.transpose()).norm(), 1e-9) << n << " " << depth;
      EXPECT_LT((product(factor(A), factor(B).transposed()) - A * B).norm(), 1e-9) << n << " " << depth;
    }
  }
}

TEST(Dense, TilesAreTheSameBitsInRegistersOfEveryWidth) {
  for (const Index depth : {1, 7, 256}) {
    const MatrixXd a = random(kTileRows, depth);
    const MatrixXd b = random(kTileColumns, depth);
    MatrixXd expected = MatrixXd::Zero(kTileRows, kTileColumns);
    for (Index k = 0; k < depth; ++k) {  // in the order of the columns, without fused multiply-add
      for (Index j = 0; j < kTileColumns; ++j) {
        expected.col(j) += a.col(k) * b(j, k);
      }
    }
    for (const TileProduct multiply : tile_products()) {
      MatrixXd tile = MatrixXd::Constant(kTileRows, kTileColumns, std::numeric_limits<double>::quiet_NaN());
      multiply(a.data(), b.data(), depth, tile.data());
      EXPECT_EQ(tile, expected) << depth;
    }
  }
}

// The unused rows and the entries above the diagonal change nothing.
TEST(Dense, SmallFactorsAreTheSameBitsInRegistersOfEveryWidth) {
  constexpr double kLeast = 1e-9;
  for (const Index n : {1, 4, 7, 8, 9, 33, 127}) {
    const MatrixXd A = random(n, 2 * n);
    MatrixXd S = A * A.transpose();
    const Eigen::VectorXd scale = S.diagonal().cwiseSqrt().cwiseInverse();
    S = scale.asDiagonal() * S * scale.asDiagonal();
    MatrixXd padded = MatrixXd::Zero((n + kPaddedRows - 1) / kPaddedRows * kPaddedRows, n);
    padded.topRows(n) = S;
    MatrixXd L = padded;
    const double pivot = factorise_small(kLeast, L);
    EXPECT_LT((lower(L.topRows(n)) * lower(L.topRows(n)).transpose() - S).norm(), 1e-13 * static_cast<double>(n)) << n;
    EXPECT_NEAR(pivot, L.diagonal().cwiseAbs2().minCoeff(), 1e-14) << n;
    for (const SmallFactor factorise_in : small_factors()) {
      MatrixXd other = padded;
      other.triangularView<Eigen::StrictlyUpper>().setZero();
      EXPECT_EQ(factorise_in(kLeast, n, other.rows(), other.data()), pivot) << n;
      EXPECT_EQ(lower(other.topRows(n)), lower(L.topRows(n))) << n;
      other = padded;
      other.row(n - 1).setZero();
      EXPECT_EQ(factorise_in(kLeast, n, other.rows(), other.data()), 0.0) << n;
    }
  }
}

TEST(Dense, EntriesBesideATriangleCountAsZero) {
  for (const Index n : kSizes) {
    const MatrixXd L = random(n, n);
    const MatrixXd A = random(n, n);
    for (const bool upper : {false, true}) {
      const Factor triangle = upper ? factor(L, Shape::lower).transposed() : factor(L, Shape::lower);
      const MatrixXd expected = upper ? MatrixXd(lower(L).transpose()) : lower(L);
      MatrixXd left = MatrixXd::Zero(n, n);
      add_product(1.0, triangle, factor(A), left);
      EXPECT_LT((left - expected * A.transpose()).norm(), 1e-9) << n;
      MatrixXd right = MatrixXd::Zero(n, n);
      add_product(1.0, factor(A), triangle, right);
      EXPECT_LT((right - A * expected.transpose()).norm(), 1e-9) << n;
    }
  }
}

TEST(Dense, FactorsInversesAndSolutionsAreThoseOfTheMatrix) {
  for (const Index n : kSizes) {
    const MatrixXd J = random(2 * n, n);
    const MatrixXd A = J.transpose() * J + MatrixXd::Identity(n, n);
    MatrixXd root = A;
    ASSERT_TRUE(factorise(root));
    const MatrixXd L = lower(root);
    EXPECT_LT((L * L.transpose() - A).norm(), 1e-12 * A.norm()) << n;
    invert_lower(root);
    EXPECT_LT((lower(root) * L - MatrixXd::Identity(n, n)).norm(), 1e-11) << n;
    MatrixXd X = random(n, 5);
    solve_lower(L, X);
    EXPECT_LT((L * X - random(n, 5)).norm(), 1e-11) << n;
    MatrixXd indefinite = A;
    indefinite(n - 1, n - 1) = -1.0;
    EXPECT_FALSE(factorise(indefinite)) << n;
  }
}

}  // namespace
}  // namespace kdl_calibration
