#include "estimation/linear_system.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>

#include "support.hpp"
#include "whitened_systems.hpp"

namespace kdl_calibration::linear_system_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::random_matrix;

TEST(LinearSystem, ScalesInformationToAUnitDiagonal) {
  const Eigen::Vector4d diagonal(4.0, 0.0, 0.25, -1.0);
  const MatrixXd information = diagonal.asDiagonal();
  EXPECT_EQ(unit_scale_of_information(information), Eigen::Vector4d(0.5, 0.0, 2.0, 0.0));
}

TEST(LinearSystem, RootIsUpperTriangularWhateverTheUnits) {
  Random random(1);
  const MatrixXd J = random_matrix(20, 5, random) * Eigen::Matrix<double, 5, 1>(1e-6, 1.0, 1e4, 2.0, 1e-2).asDiagonal();
  const MatrixXd information = J.transpose() * J;
  const auto root = well_conditioned_root(information);
  ASSERT_TRUE(root);
  const VectorXd scale = unit_scale_of_information(information);
  const MatrixXd error = scale.asDiagonal() * (root->transpose() * *root - information) * scale.asDiagonal();
  EXPECT_LT(error.norm(), 1e-13);
  EXPECT_EQ(MatrixXd(root->triangularView<Eigen::StrictlyLower>()).norm(), 0.0);
}

TEST(LinearSystem, RootIsGivenWhilePivotsAreAboveAThousandth) {
  const auto has_root = [](double pivot) {
    const double c = std::sqrt(1.0 - pivot * pivot);
    const Eigen::Vector2d units(1e3, 1e-3);
    const Eigen::Matrix2d unit = (Eigen::Matrix2d() << 1.0, c, c, 1.0).finished();
    return well_conditioned_root(units.asDiagonal() * unit * units.asDiagonal()).has_value();
  };
  EXPECT_TRUE(has_root(0.5));
  EXPECT_TRUE(has_root(1.05e-3));
  EXPECT_FALSE(has_root(0.95e-3));
  EXPECT_FALSE(well_conditioned_root(Eigen::Vector2d(1.0, 0.0).asDiagonal()).has_value());
  EXPECT_FALSE(well_conditioned_root((Eigen::Matrix2d() << 1.0, 2.0, 2.0, 1.0).finished()).has_value());
}

/// Configurations of so many points, then priors.
WhitenedSystem random_system(const std::vector<Index>& points, Index priors, Index columns, Random& random) {
  WhitenedSystem system;
  Index rows = 0;
  for (const Index count : points) {
    system.blocks.push_back(rows);
    rows += 3 * count;
  }
  system.blocks.push_back(rows);
  system.jacobian = random_matrix(rows + priors, columns, random);
  system.residual = random_matrix(rows + priors, 1, random);
  return system;
}

void expect_summary(const WhitenedSystem& system, const std::vector<Index>& points) {
  const Index columns = system.jacobian.cols();
  const Index measured = system.blocks.back();
  MatrixXd sums = MatrixXd::Zero(columns, columns);
  double squares_of_sums = 0.0;
  double pairs = 0.0;
  Index row = 0;
  for (const Index count : points) {
    MatrixXd sum = MatrixXd::Zero(3, columns);
    Eigen::Vector3d e = Eigen::Vector3d::Zero();
    for (Index i = 0; i < count; ++i, row += 3) {
      sum += system.jacobian.middleRows(row, 3);
      e += system.residual.segment<3>(row);
      pairs += 3.0 * static_cast<double>(i);
    }
    sums += sum.transpose() * sum;
    squares_of_sums += e.squaredNorm();
  }
  const MatrixXd information = system.jacobian.transpose() * system.jacobian;
  const WhitenedSummary found = testing::summarised(system);
  EXPECT_EQ(found.rows, system.jacobian.rows());
  EXPECT_EQ(found.measured_rows, measured);
  EXPECT_EQ(found.sqrt_information.rows(), std::min(system.jacobian.rows(), columns));
  EXPECT_LT((found.sqrt_information.transpose() * found.sqrt_information - information).norm(),
            1e-12 * information.norm());
  EXPECT_LT((found.sums - sums).norm(), 1e-12 * sums.norm());
  EXPECT_NEAR(found.squares, system.residual.head(measured).squaredNorm(), 1e-11 * found.squares);
  EXPECT_NEAR(found.squares_of_sums, squares_of_sums, 1e-11 * squares_of_sums);
  EXPECT_EQ(found.pairs, pairs);
  const MatrixXd priors = system.jacobian.bottomRows(system.jacobian.rows() - measured);
  EXPECT_LT((found.priors - priors.transpose() * priors).norm(), 1e-13);
}

TEST(WhitenedSummary, IsThatOfTheRowsHoweverManyThereAre) {
  Random random(2);
  for (const std::vector<Index>& points : std::vector<std::vector<Index>>{
           {1}, {2, 1}, {3, 0, 4}, std::vector<Index>(200, 2), std::vector<Index>(70, 7), {5, 400, 2, 400}}) {
    expect_summary(random_system(points, 3, 11, random), points);
  }
  expect_summary(random_system({2, 3}, 0, 4, random), {2, 3});
}

}  // namespace
}  // namespace kdl_calibration::linear_system_test
