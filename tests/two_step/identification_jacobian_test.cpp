#include "two_step/identification_jacobian.hpp"

#include <gmock/gmock.h>

#include "effects/effect_terms.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "support.hpp"

namespace kdl_calibration::identification_jacobian_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

class IdentificationJacobian : public ::testing::TestWithParam<bool> {
protected:
  void SetUp() override {
    estimate.errors = testing::random_errors(model, random, 0.002, 0.02);
    estimate.frames.base() =
        Eigen::Translation3d(1.0, -2.0, 0.5) * Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized());
    estimate.frames.targets = published_targets();
    q = testing::random_joints(model, random);
  }

  // Every target in W after a motion of one parameter by name, through KDL.
  VectorXd points(const std::string& name, double step) const {
    Estimate moved = estimate;
    const std::size_t dot = name.find('.');
    const auto axis = [](char letter) { return Eigen::Vector3d(Eigen::Vector3d::Unit(letter - 'x')); };
    if (dot == std::string::npos) {
      moved.errors[static_cast<Eigen::Index>(parameter_index(model, name))] += step;
    } else if (name.compare(0, dot, "base") == 0) {
      const Eigen::Vector3d along = step * axis(name.back());
      moved.frames.base() = name[dot + 1] == 'T' ? moved.frames.base() * Eigen::Translation3d(along)
                                                 : moved.frames.base() * Eigen::AngleAxisd(step, axis(name.back()));
    } else {
      moved.frames.targets[static_cast<std::size_t>(name.front() - 'A')].X_FT.translation() += step * axis(name.back());
    }
    const Eigen::Isometry3d X_BF = to_eigen(testing::kdl_pose(error_chain(model, moved.errors), q));
    VectorXd result(9);
    for (Eigen::Index t = 0; t < 3; ++t) {
      result.segment<3>(3 * t) =
          moved.frames.base() * (X_BF * moved.frames.targets[static_cast<std::size_t>(t)].X_FT.translation());
    }
    return result;
  }

  ErrorModel model = complete_model(GetParam() ? parse_robot(testing::kOddArm) : testing::fanuc());
  Random random{5};
  Estimate estimate;
  VectorXd q;
};

TEST_P(IdentificationJacobian, ColumnsAreCentralDifferencesOfKdlsPositions) {
  const Reduction reduction = reduced_model(model, estimate.frames.targets);
  const Unknowns free = Unknowns(model, estimate.frames.targets, reduction.kept);
  const MatrixXd J = identification_jacobian(model, estimate, free, q);
  const std::vector<std::string> names = free.names();
  ASSERT_EQ(J.rows(), 9);
  ASSERT_EQ(J.cols(), static_cast<Eigen::Index>(names.size()));
  for (std::size_t c = 0; c < names.size(); ++c) {
    const double step = 1e-6;
    const VectorXd difference = (points(names[c], step) - points(names[c], -step)) / (2.0 * step);
    EXPECT_LT((J.col(static_cast<Eigen::Index>(c)) - difference).cwiseAbs().maxCoeff(), 1e-8) << names[c];
  }
}

TEST_P(IdentificationJacobian, AIsThePublishedMatrixWrittenOut) {
  const MatrixXd A = base_and_tool_matrix(model, estimate, q);
  const Eigen::Isometry3d T = to_eigen(testing::kdl_pose(error_chain(model, estimate.errors), q));
  const Eigen::Vector3d p = T.translation();
  Eigen::Matrix3d transposed;  // [~p]^T
  transposed << 0, p.z(), -p.y(), -p.z(), 0, p.x(), p.y(), -p.x(), 0;
  const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d O = Eigen::Matrix3d::Zero();
  MatrixXd expected(9, 15);
  expected << I, transposed, T.linear(), O, O, I, transposed, O, T.linear(), O, I, transposed, O, O, T.linear();
  ASSERT_EQ(A.rows(), 9);
  ASSERT_EQ(A.cols(), 15);
  EXPECT_LT((A - expected).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_THAT(base_and_tool_names(estimate.frames.targets),
              ::testing::ElementsAre("p_base.x", "p_base.y", "p_base.z", "phi_base.x", "phi_base.y", "phi_base.z",
                                     "u_A.x", "u_A.y", "u_A.z", "u_B.x", "u_B.y", "u_B.z", "u_C.x", "u_C.y", "u_C.z"));
}

TEST_P(IdentificationJacobian, RefusesEffects) {
  model.effects = gain_terms(model);
  const Unknowns free(model, estimate.frames.targets, {model.effects.front().name});
  EXPECT_THROW(identification_jacobian(model, estimate, free, q), InputError);
}

INSTANTIATE_TEST_SUITE_P(Robots, IdentificationJacobian, ::testing::Bool());

}  // namespace
}  // namespace kdl_calibration::identification_jacobian_test
