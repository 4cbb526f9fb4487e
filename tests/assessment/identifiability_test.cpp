#include "kdl_calibration/identifiability.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>

#include "kdl_calibration/random.hpp"

namespace kdl_calibration {
namespace {

using ::testing::ElementsAre;
using ::testing::UnorderedElementsAre;

Eigen::MatrixXd random_matrix(Eigen::Index rows, Eigen::Index columns) {
  Random random(1);
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return random.normal(); });
}

TEST(Identifiability, IsIndependentOfTheUnitsOfTheColumns) {
  const Eigen::MatrixXd jacobian = random_matrix(20, 3);
  const Eigen::Vector3d units(1.0, 1000.0, 1e-6);
  const Identifiability plain = identifiability(jacobian, {"a", "b", "c"});
  const Identifiability scaled = identifiability(jacobian * units.asDiagonal(), {"a", "b", "c"});
  EXPECT_EQ(plain.rank, 3);
  EXPECT_TRUE(plain.tied.empty());
  EXPECT_NEAR(plain.condition, scaled.condition, 1e-9 * plain.condition);
}

TEST(Identifiability, SingularValuesAreThoseOfTheScaledMatrix) {
  const Eigen::MatrixXd jacobian = random_matrix(30, 5);
  Eigen::MatrixXd scaled = jacobian;
  scaled.colwise().normalize();
  const Eigen::VectorXd expected = scaled.jacobiSvd().singularValues();
  const Identifiability found = identifiability(jacobian, {"a", "b", "c", "d", "e"});
  EXPECT_LT((found.singular_values - expected).norm(), 1e-12);
  EXPECT_NEAR(found.condition, expected[0] / expected[4], 1e-9);
}

TEST(Identifiability, NamesTiedParametersAndThoseWithoutEffect) {
  Eigen::MatrixXd jacobian = random_matrix(20, 6);
  jacobian.col(3) = 2.0 * jacobian.col(0) - jacobian.col(2);
  jacobian.col(4).setZero();
  const Identifiability found = identifiability(jacobian, {"a", "b", "c", "d", "e", "f"});
  EXPECT_EQ(found.rank, 4);
  EXPECT_TRUE(std::isinf(found.condition));
  ASSERT_EQ(found.tied.size(), 2U);
  EXPECT_THAT(found.tied[0], UnorderedElementsAre("a", "c", "d"));
  EXPECT_THAT(found.tied[1], ElementsAre("e"));
}

TEST(Identifiability, MergesGroupsThatShareAParameter) {
  Eigen::MatrixXd jacobian = random_matrix(20, 5);
  jacobian.col(3) = jacobian.col(0) + jacobian.col(1);
  jacobian.col(4) = jacobian.col(1) - jacobian.col(2);
  const Identifiability found = identifiability(jacobian, {"a", "b", "c", "d", "e"});
  EXPECT_EQ(found.rank, 3);
  ASSERT_EQ(found.tied.size(), 1U);
  EXPECT_THAT(found.tied[0], UnorderedElementsAre("a", "b", "c", "d", "e"));
}

TEST(Identifiability, NamesWeaklyDeterminedCombinations) {
  Eigen::MatrixXd jacobian = random_matrix(50, 4);
  jacobian.col(3) = jacobian.col(1) + 1e-3 * jacobian.col(3);
  const Identifiability found = identifiability(jacobian, {"a", "b", "c", "d"});
  EXPECT_EQ(found.rank, 4);
  EXPECT_TRUE(found.tied.empty());
  ASSERT_EQ(found.weak.size(), 1U);
  EXPECT_THAT(found.weak[0], UnorderedElementsAre("b", "d"));
  EXPECT_TRUE(identifiability(random_matrix(50, 4), {"a", "b", "c", "d"}).weak.empty());
}

TEST(Identifiability, HandlesFewerRowsThanColumns) {
  const Identifiability found = identifiability(random_matrix(2, 3), {"a", "b", "c"});
  EXPECT_EQ(found.rank, 2);
  ASSERT_EQ(found.tied.size(), 1U);
}

}  // namespace
}  // namespace kdl_calibration
