#include "uncertainty/identifiability.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>
#include <string>
#include <vector>

#include "support.hpp"

namespace kdl_calibration::identifiability_test {
namespace {

using ::testing::ElementsAre;
using ::testing::UnorderedElementsAre;

Eigen::MatrixXd random_matrix(Eigen::Index rows, Eigen::Index columns) {
  Random random(1);
  return testing::random_matrix(rows, columns, random);
}

TEST(Identifiability, SingularValuesAreThoseOfUnitColumnsWhateverTheirUnits) {
  const Eigen::MatrixXd jacobian = random_matrix(30, 5);
  const Eigen::VectorXd units = (Eigen::VectorXd(5) << 1.0, 1000.0, 1e-6, 1.0, 30.0).finished();
  const Eigen::VectorXd expected = jacobian.colwise().normalized().jacobiSvd().singularValues();
  for (const Eigen::MatrixXd& of : {jacobian, Eigen::MatrixXd(jacobian * units.asDiagonal())}) {
    const Identifiability found = identifiability(of, {"a", "b", "c", "d", "e"});
    EXPECT_LT((found.singular_values - expected).norm(), 1e-12);
    EXPECT_NEAR(found.condition, expected[0] / expected[4], 1e-9);
    EXPECT_EQ(found.rank, 5);
    EXPECT_TRUE(found.tied.empty());
  }
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

TEST(Identifiability, HandlesFewerRowsThanColumns) {
  const Identifiability found = identifiability(random_matrix(2, 3), {"a", "b", "c"});
  EXPECT_EQ(found.rank, 2);
  EXPECT_EQ(found.columns, 3);
  ASSERT_EQ(found.singular_values.size(), 3);
  EXPECT_GT(found.singular_values[1], 0.0);
  EXPECT_EQ(found.singular_values[2], 0.0);
  ASSERT_EQ(found.tied.size(), 1U);
}

// Two columns of which the smaller singular value is this share of the larger, and a third that is apart.
Eigen::MatrixXd nearly_parallel(double share) {
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(4, 3);
  const double angle = 2.0 * std::atan(share);
  jacobian.topLeftCorner<2, 2>() << 1.0, std::cos(angle), 0.0, std::sin(angle);
  jacobian(3, 2) = 5.0;
  return jacobian;
}

std::vector<std::string> one_name_each(Eigen::Index columns) {
  std::vector<std::string> names;
  for (Eigen::Index c = 0; c < columns; ++c) {
    names.emplace_back(1, static_cast<char>('a' + c));
  }
  return names;
}

TEST(Identifiability, CountsSingularValuesAboveATolerance) {
  const auto found = [](double share, const IdentifiabilityOptions& options = {}) {
    return identifiability(nearly_parallel(share), {"a", "b", "c"}, options);
  };
  const Identifiability above = found(1.2e-9);
  EXPECT_EQ(above.rank, 3);
  EXPECT_NEAR(above.condition * 1.2e-9, 1.0, 1e-3);
  EXPECT_TRUE(above.tied.empty());
  const Identifiability below = found(0.8e-9);
  EXPECT_EQ(below.rank, 2);
  EXPECT_TRUE(std::isinf(below.condition));
  ASSERT_EQ(below.tied.size(), 1U);
  EXPECT_THAT(below.tied[0], ElementsAre("a", "b"));
  EXPECT_TRUE(below.weak.empty()) << "what is not there is not weak";
  EXPECT_EQ(found(1e-3, {.tolerance = 1.2e-3}).rank, 2);
  EXPECT_EQ(found(1e-3, {.tolerance = 1.2e-3}).tied, below.tied);
  EXPECT_EQ(found(1e-3, {.tolerance = 0.8e-3}).rank, 3);
}

TEST(Identifiability, NamesWhatIsBelowAHundredthAsWeak) {
  const auto weak = [](double share, const IdentifiabilityOptions& options = {}) {
    return identifiability(nearly_parallel(share), {"a", "b", "c"}, options).weak;
  };
  EXPECT_EQ(weak(0.011).size(), 0U);
  ASSERT_EQ(weak(0.009).size(), 1U);
  EXPECT_THAT(weak(0.009)[0], UnorderedElementsAre("a", "b"));
  EXPECT_EQ(weak(0.11, {.weak = 0.1}).size(), 0U);
  EXPECT_EQ(weak(0.09, {.weak = 0.1}).size(), 1U);
}

// J = U diag(values) V^T has unit columns where the rows of V are such that the squares of the values weigh alike.
TEST(Identifiability, NamesTheWeakestFirstAndInEachTheHeaviestFirst) {
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(8, 6);
  // b - a is weak by 1e-3, and e by 1e-4 of c and d.
  jacobian.col(0) = Eigen::VectorXd::Unit(8, 0);
  jacobian.col(1) = Eigen::VectorXd::Unit(8, 0) + 1e-3 * Eigen::VectorXd::Unit(8, 1);
  jacobian.col(2) = Eigen::VectorXd::Unit(8, 2);
  jacobian.col(3) = Eigen::VectorXd::Unit(8, 3);
  jacobian.col(4) =
      0.8 * Eigen::VectorXd::Unit(8, 2) + 0.6 * Eigen::VectorXd::Unit(8, 3) + 1e-4 * Eigen::VectorXd::Unit(8, 4);
  jacobian.col(5) = Eigen::VectorXd::Unit(8, 5);
  const Identifiability found = identifiability(jacobian, one_name_each(6));
  EXPECT_EQ(found.rank, 6);
  ASSERT_EQ(found.weak.size(), 2U);
  // Squares of its unit vector: 0.5 of e, 0.32 of c, 0.18 of d.
  EXPECT_THAT(found.weak[0], ElementsAre("e", "c", "d"));
  EXPECT_THAT(found.weak[1], UnorderedElementsAre("a", "b"));
}

// The direction (1, -x) / |(1, -x)| is weak: the second column is named where its square is above a tenth.
std::size_t named_of_a_direction(double x) {
  Eigen::MatrixXd jacobian(3, 3);
  const double y = std::sqrt(1.0 - x * x);
  // a = x b + y c but for a thousandth.
  jacobian << x, 1.0, 0.0, y, 0.0, 1.0, 1e-3, 0.0, 0.0;
  const Identifiability found = identifiability(jacobian, {"a", "b", "c"});
  EXPECT_EQ(found.weak.size(), 1U);
  return found.weak.empty() ? 0 : found.weak[0].size();
}

TEST(Identifiability, NamesWhatMakesUpNineTenthsOfADirection) {
  // Shares 1/2 of a, x^2 / 2 of b and y^2 / 2 of c.
  EXPECT_EQ(named_of_a_direction(std::sqrt(0.82)), 2U) << "0.91 without c";
  EXPECT_EQ(named_of_a_direction(std::sqrt(0.78)), 3U) << "0.89 without c";
}

TEST(Identifiability, NamesWhatADependencyNeedsByAMillionth) {
  const auto tied = [](double coefficient) {
    Eigen::MatrixXd jacobian = random_matrix(20, 4);
    for (const Eigen::Index c : {0, 1, 2}) {
      jacobian.col(c).normalize();
    }
    jacobian.col(3) = jacobian.col(0) + coefficient * jacobian.col(1);
    return identifiability(jacobian, {"a", "b", "c", "d"}).tied;
  };
  ASSERT_EQ(tied(2e-6).size(), 1U);
  EXPECT_THAT(tied(2e-6)[0], ElementsAre("a", "b", "d"));
  EXPECT_THAT(tied(-2e-6)[0], ElementsAre("a", "b", "d"));
  ASSERT_EQ(tied(0.5e-6).size(), 1U);
  EXPECT_THAT(tied(0.5e-6)[0], ElementsAre("a", "d"));
}

TEST(Identifiability, MergesThreeGroupsAndKeepsTheOthersApart) {
  Eigen::MatrixXd jacobian = random_matrix(20, 9);
  jacobian.col(4) = jacobian.col(0) + jacobian.col(1);
  jacobian.col(5) = jacobian.col(2) - jacobian.col(3);
  jacobian.col(6) = 3.0 * jacobian.col(1) + jacobian.col(2);
  jacobian.col(8) = -jacobian.col(7);
  const Identifiability found = identifiability(jacobian, one_name_each(9));
  EXPECT_EQ(found.rank, 5);
  ASSERT_EQ(found.tied.size(), 2U);
  EXPECT_THAT(found.tied[0], UnorderedElementsAre("a", "b", "c", "d", "e", "f", "g"));
  EXPECT_THAT(found.tied[1], ElementsAre("h", "i"));
}

TEST(Identifiability, OfNothingIsNothing) {
  const Identifiability none = identifiability(Eigen::MatrixXd(0, 2), {"a", "b"});
  EXPECT_EQ(none.columns, 2);
  EXPECT_EQ(none.rank, 0);
  EXPECT_EQ(none.singular_values.size(), 0);
  EXPECT_EQ(none.condition, 0.0);
}

}  // namespace
}  // namespace kdl_calibration::identifiability_test
