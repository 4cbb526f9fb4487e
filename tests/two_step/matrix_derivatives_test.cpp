#include "two_step/matrix_derivatives.hpp"

#include <gtest/gtest.h>

#include "base/random.hpp"
#include "model/error_chains.hpp"
#include "support.hpp"

namespace kdl_calibration::matrix_derivatives_test {
namespace {

using Eigen::Index;
using Eigen::Matrix4d;
using Eigen::VectorXd;

struct Arm {
  explicit Arm(const Robot& robot) : model(complete_model(robot)) {}

  ErrorModel model;
  std::vector<ChainFactor> factors = chain_factors(model);
  Random random = Random(3);
  VectorXd errors = testing::random_errors(model, random, 0.0025, 0.05);
  VectorXd q = testing::random_joints(model, random);

  Eigen::Isometry3d by_kdl(const VectorXd& at_errors, const VectorXd& at_q) const {
    return to_eigen(testing::kdl_pose(error_chain(model, at_errors), at_q));
  }
};

class MatrixDerivatives : public ::testing::TestWithParam<bool> {
protected:
  const Arm arm{GetParam() ? testing::fanuc() : parse_robot(testing::kOddArm)};
};

TEST_P(MatrixDerivatives, TheProductIsThePoseOfTheChain) {
  const MatrixProduct product = matrix_product(arm.factors, arm.errors, arm.q);
  EXPECT_TRUE(product.pose.isApprox(arm.by_kdl(arm.errors, arm.q).matrix(), 1e-14));
}

TEST_P(MatrixDerivatives, AreCentralDifferencesOfThePoseAndZeroWhereTheFactorIsFixed) {
  constexpr double kStep = 1e-6;
  const MatrixProduct product = matrix_product(arm.factors, arm.errors, arm.q);
  ASSERT_EQ(product.derivatives.size(), arm.factors.size());
  for (std::size_t i = 0; i < arm.factors.size(); ++i) {
    Matrix4d expected = Matrix4d::Zero();
    for (const double step : {kStep, -kStep}) {
      VectorXd errors = arm.errors;
      VectorXd q = arm.q;
      if (arm.factors[i].source != ChainFactor::Source::fixed) {
        VectorXd& moved = arm.factors[i].source == ChainFactor::Source::joint ? q : errors;
        moved[static_cast<Index>(arm.factors[i].index)] += step;
      }
      expected += arm.by_kdl(errors, q).matrix() / (2.0 * step);
    }
    EXPECT_LT((product.derivatives[i] - expected).cwiseAbs().maxCoeff(), 1e-8) << arm.factors[i].name;
  }
}

TEST_P(MatrixDerivatives, ColumnsOfAPointAreInTheOrderThatIsAsked) {
  const Eigen::Vector3d point(0.1, -0.2, 0.3);
  const MatrixProduct product = matrix_product(arm.factors, arm.errors, arm.q);
  const std::vector<std::size_t> which = {20, 3, 11};
  const Matrix3Xd columns = point_columns(arm.factors, product, which, point);
  const Matrix3Xd published = point_columns(arm.factors, product, {3, 11, 20}, point);
  ASSERT_EQ(columns.cols(), 3);
  EXPECT_EQ(columns.col(0), published.col(2));
  EXPECT_EQ(columns.col(1), published.col(0));
  EXPECT_EQ(columns.col(2), published.col(1));
  for (std::size_t i = 0; i < arm.factors.size(); ++i) {
    if (arm.factors[i].source == ChainFactor::Source::parameter && arm.factors[i].index == which[0]) {
      EXPECT_EQ(columns.col(0), (product.derivatives[i] * point.homogeneous()).head<3>());
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Robots, MatrixDerivatives, ::testing::Bool());

}  // namespace
}  // namespace kdl_calibration::matrix_derivatives_test
