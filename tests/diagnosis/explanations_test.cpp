#include "diagnosis/explanations.hpp"

#include <gtest/gtest.h>
#include <Eigen/Dense>
#include <algorithm>

#include "base/random.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Wide = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;

Eigen::MatrixXd random_matrix(Index rows, Index columns, Random& random) {
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&](Index /*row*/, Index /*column*/) { return random.normal(); });
}

// A fit whose variances are known, as none can be smaller: 4e-10 m^2 of means, 1e-10 of deviations.
LinearisedFit fit_of(Index of_means, Index of_points, Index columns) {
  Random random(11);
  LinearisedFit fit{.jacobian = random_matrix(of_means + of_points, columns, random),
                    .residual = 1e-7 * random_matrix(of_means + of_points, 1, random)};
  fit.strata.assign(static_cast<std::size_t>(of_means), RowStratum::shared);
  fit.strata.resize(static_cast<std::size_t>(of_means + of_points), RowStratum::of_points);
  fit.coordinates << static_cast<double>(of_means), static_cast<double>(of_points), 0.0;
  fit.least_variance << 4e-10, 1e-10, 1.0;
  fit.sizes = Eigen::VectorXd::Constant(columns, 1e-3);
  fit.is_error.assign(static_cast<std::size_t>(columns), false);  // the arm is as crude as is ordinary
  fit.values = 1e-4 * random_matrix(columns, 1, random);
  fit.weight = 1.0;
  fit.doubted_squares = fit.residual.squaredNorm();
  fit.offset = Eigen::VectorXd::Zero(3);
  fit.predicted = random_matrix(3, columns, random);
  return fit;
}

// Rows over their sigma, with the ordinary sizes below: columns of J, then of C, then the right side.
Wide equations(const LinearisedFit& fit, const Eigen::MatrixXd& C) {
  const Index n = fit.jacobian.cols();
  const Index m = fit.jacobian.rows();
  Wide all = Wide::Zero(m + n, n + C.cols() + 1);
  for (Index row = 0; row < m; ++row) {
    const auto stratum = static_cast<Index>(fit.strata[static_cast<std::size_t>(row)]);
    const long double weight = 1.0L / std::sqrt(static_cast<long double>(fit.least_variance[stratum]));
    all.row(row).head(n) = weight * fit.jacobian.row(row).cast<long double>();
    all.row(row).segment(n, C.cols()) = weight * C.row(row).cast<long double>();
    all(row, n + C.cols()) = weight * fit.residual[row];
  }
  for (Index i = 0; i < n; ++i) {
    all(m + i, i) = 1.0L / fit.sizes[i];
    all(m + i, n + C.cols()) = -static_cast<long double>(fit.values[i]) / fit.sizes[i];
  }
  return all;
}

Eigen::VectorXd least_squares(const Wide& equations) {
  const Index n = equations.cols() - 1;
  return equations.leftCols(n).colPivHouseholderQr().solve(equations.col(n)).cast<double>();
}

struct Shape {
  Index of_means;
  Index of_points;
  Index columns;
  double parting;  // of two columns that are otherwise the same, which only their sizes tell apart
};

class OfFits : public ::testing::TestWithParam<Shape> {
protected:
  static LinearisedFit fit() {
    const Shape& shape = GetParam();
    LinearisedFit fit = fit_of(shape.of_means, shape.of_points, shape.columns);
    fit.jacobian.col(1) = fit.jacobian.col(0) + shape.parting * fit.jacobian.col(2);
    fit.sizes[0] = shape.parting < 1.0 ? 1e3 : 1e-3;
    return fit;
  }
};

TEST_P(OfFits, OrdinaryStepIsThatOfLeastSquares) {
  const LinearisedFit fit = this->fit();
  const Eigen::VectorXd expected = least_squares(equations(fit, Eigen::MatrixXd(fit.jacobian.rows(), 0)));
  const Eigen::VectorXd step = Explanations(fit).ordinary_step();
  for (Index i = 2; i < step.size(); ++i) {
    EXPECT_NEAR(step[i], expected[i], 1e-9 * expected.tail(expected.size() - 2).norm()) << i;
  }
  EXPECT_NEAR(step[0] + step[1], expected[0] + expected[1], 1e-9 * expected.norm());
  EXPECT_NEAR(step[1], expected[1], 1e-6 * expected.norm());
}

TEST_P(OfFits, AMistakeIsEstimatedBesideAllColumns) {
  const LinearisedFit fit = this->fit();
  Random random(3);
  const Eigen::MatrixXd C = random_matrix(fit.jacobian.rows(), 2, random);
  const Eigen::VectorXd expected = least_squares(equations(fit, C)).tail(2);
  const Explanations explanations(fit);
  const Explained found = explanations.explained(explanations.sums(C), {});
  EXPECT_LT((found.estimate - expected).norm(), 1e-7 * expected.norm());
}

INSTANTIATE_TEST_SUITE_P(All, OfFits,
                         ::testing::Values(Shape{90, 60, 20, 1.0}, Shape{90, 0, 60, 1.0}, Shape{30, 200, 75, 1.0},
                                           Shape{300, 20, 130, 1.0}, Shape{90, 60, 20, 1e-5}, Shape{90, 90, 60, 1e-9},
                                           Shape{90, 60, 20, 0.0}));

}  // namespace
}  // namespace kdl_calibration
