#include "uncertainty/observability.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "support.hpp"

namespace kdl_calibration::observability_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

void expect_indices(const MatrixXd& jacobian, const VectorXd& s, double configurations) {
  const auto n = static_cast<double>(s.size());
  const double least = s.minCoeff();
  const double most = s.maxCoeff();
  double inverses = 0.0;
  for (const double value : s) {
    inverses += 1.0 / value;
  }
  const ObservabilityIndices found = observability_indices(jacobian, static_cast<Eigen::Index>(configurations));
  EXPECT_NEAR(found.O1, std::pow(s.prod(), 1.0 / n) / std::sqrt(configurations), 1e-10 * most);
  EXPECT_NEAR(found.O2, least / most, 1e-10);
  EXPECT_NEAR(found.O3, least, 1e-10 * most);
  EXPECT_NEAR(found.O4, least * least / most, 1e-10 * most);
  EXPECT_NEAR(found.O5, 1.0 / inverses, 1e-10 * most);
}

MatrixXd random_rotation(Index size, Random& random) {
  return testing::random_matrix(size, size, random).householderQr().householderQ();
}

// U diag(s) V^T with more rows than columns, as many, and one of a kind.
TEST(Observability, IndicesAreThoseOfTheSingularValues) {
  Random random(3);
  for (const Index rows : {5, 4}) {
    const MatrixXd U = random_rotation(rows, random);
    const MatrixXd V = random_rotation(4, random);
    const Eigen::Vector4d s(7.0, 3.0, 0.5, 0.02);
    expect_indices(U.leftCols(4) * s.asDiagonal() * V.transpose(), s, 6.0);
  }
  expect_indices(MatrixXd::Constant(4, 1, 3.0), VectorXd::Constant(1, 6.0), 2.0);
}

// Above a hundred columns singular values are found in another way.
TEST(Observability, IndicesOfManyColumnsAreThoseOfTheSingularValues) {
  Random random(4);
  for (const Index columns : {100, 101, 150}) {
    const VectorXd s = VectorXd::LinSpaced(columns, 9.0, 1e-3);
    expect_indices(random_rotation(columns, random) * s.asDiagonal(), s, 40.0);
  }
}

void expect_none(const MatrixXd& jacobian, const char* what) {
  const ObservabilityIndices found = observability_indices(jacobian, 3);
  for (const double index : {found.O1, found.O2, found.O3, found.O4, found.O5}) {
    EXPECT_EQ(index, 0.0) << what;
  }
}

TEST(Observability, IsNoneWhereNotAllColumnsAreDetermined) {
  expect_none(MatrixXd(3, 0), "no columns");
  expect_none(MatrixXd(0, 3), "no rows");
  expect_none(MatrixXd::Identity(2, 3), "more columns than rows");
  expect_none(MatrixXd::Zero(3, 2), "nothing told");
  MatrixXd one = MatrixXd::Identity(3, 2);
  one(1, 1) = 0.0;
  expect_none(one, "one column told");
}

}  // namespace
}  // namespace kdl_calibration::observability_test
