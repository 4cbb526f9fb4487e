#include "model/kinematics.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <kdl/chainjnttojacsolver.hpp>
#include <numeric>

#include "model/error_chains.hpp"
#include "parameter_chain.hpp"
#include "support.hpp"
#include "two_step/matrix_derivatives.hpp"

namespace kdl_calibration::kinematics_test {
namespace {

using testing::difference;
using testing::fanuc;
using testing::kDegree;
using testing::kdl_pose;

class EveryChainsKinematics : public ::testing::TestWithParam<bool> {
protected:
  EveryChainsKinematics() : which(model.parameters.size()) { std::iota(which.begin(), which.end(), 0U); }

  // Of the target in the base frame, for a twist in the frame of the flange.
  Eigen::Vector3d motion(const Eigen::Isometry3d& X_BF, const Vector6d& twist) const {
    return X_BF.linear() * (twist.head<3>() + twist.tail<3>().cross(target));
  }

  const ErrorModel model = complete_model(GetParam() ? fanuc() : parse_robot(testing::kOddArm));
  const Eigen::Vector3d target{0.1, -0.05, 0.2};
  std::vector<std::size_t> which;
};

TEST_P(EveryChainsKinematics, FlangePoseIsThatOfTheKdlSolver) {
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 3.0 * kDegree);
    const Eigen::VectorXd q = testing::random_joints(model, random);
    const KDL::Frame ours = to_kdl(flange_pose(folded(model, errors), q));
    ASSERT_LT(difference(ours, kdl_pose(error_chain(model, errors), q)), 1e-12);
  }
}

TEST_P(EveryChainsKinematics, BatchPosesAreTheSinglePoses) {
  Random random(2);
  const FoldedChain chain = folded(model, testing::random_errors(model, random, 0.01, 0.1));
  Eigen::MatrixXd q(model.joints.size(), 37);
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    q.col(c) = testing::random_joints(model, random);
  }
  const auto poses = flange_poses(chain, q);
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    ASSERT_LT(difference(to_kdl(poses[static_cast<std::size_t>(c)]), to_kdl(flange_pose(chain, q.col(c)))), 1e-15);
  }
}

TEST_P(EveryChainsKinematics, IdentificationJacobianIsThatOfTheKdlSolverOnTheChainWithErrorsAsJoints) {
  Random random(3);
  const testing::ParameterChain oracle = testing::parameter_chain(model);
  KDL::ChainJntToJacSolver solver(oracle.chain);
  for (int i = 0; i < 100; ++i) {
    const Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 3.0 * kDegree);
    const Eigen::VectorXd q = testing::random_joints(model, random);
    Matrix6Xd jacobian;
    const Eigen::Isometry3d X_BF =
        flange_jacobian(folded(model, errors), parameter_twists(model, errors, which), q, jacobian);

    KDL::JntArray all(oracle.chain.getNrOfJoints());
    for (std::size_t j = 0; j < oracle.joint_index.size(); ++j) {
      all(oracle.joint_index[j]) = q[static_cast<Eigen::Index>(j)];
    }
    for (std::size_t p = 0; p < which.size(); ++p) {
      all(oracle.parameter_index[p]) = errors[static_cast<Eigen::Index>(p)];
    }
    KDL::Jacobian expected(all.rows());
    solver.JntToJac(all, expected);
    for (std::size_t p = 0; p < which.size(); ++p) {
      const auto column = jacobian.col(static_cast<Eigen::Index>(p));
      const Eigen::VectorXd reference = expected.data.col(oracle.parameter_index[p]);
      ASSERT_LT((X_BF.linear() * column.head<3>() - reference.head<3>()).norm(), 1e-12) << model.parameters[p].name;
      ASSERT_LT((X_BF.linear() * column.tail<3>() - reference.tail<3>()).norm(), 1e-12) << model.parameters[p].name;
    }
  }
}

TEST_P(EveryChainsKinematics, IdentificationJacobianIsTheCentralDifference) {
  Random random(4);
  const Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 3.0 * kDegree);
  const Eigen::VectorXd q = testing::random_joints(model, random);
  const Eigen::MatrixXd expected = testing::central_differences(errors.size(), 1e-6, [&](const Eigen::VectorXd& step) {
    return Eigen::Vector3d(flange_pose(folded(model, errors + step), q) * target);
  });
  Matrix6Xd jacobian;
  const Eigen::Isometry3d X_BF =
      flange_jacobian(folded(model, errors), parameter_twists(model, errors, which), q, jacobian);
  for (Eigen::Index p = 0; p < errors.size(); ++p) {
    EXPECT_LT((motion(X_BF, jacobian.col(p)) - expected.col(p)).norm(), 1e-9)
        << model.parameters[static_cast<std::size_t>(p)].name;
  }
}

TEST_P(EveryChainsKinematics, BaseColumnsAreTheMotionOfTheBaseInItsOwnFrame) {
  Random random(6);
  const FoldedChain chain = folded(model, testing::random_errors(model, random, 0.0025, 3.0 * kDegree));
  const Eigen::VectorXd q = testing::random_joints(model, random);
  Matrix6Xd jacobian;
  const Eigen::Isometry3d X_BF = flange_jacobian(chain, base_twists(), q, jacobian);
  const Eigen::MatrixXd expected = testing::central_differences(6, 1e-6, [&](const Eigen::VectorXd& step) {
    const Eigen::Matrix3d R = rotation_exp(step.tail<3>());
    return Eigen::Vector3d(R * (X_BF * target) + step.head<3>());
  });
  for (int c = 0; c < 6; ++c) {
    EXPECT_LT((motion(X_BF, jacobian.col(c)) - expected.col(c)).norm(), 1e-9);
  }
}

TEST_P(EveryChainsKinematics, ThreeRoutesToTheManipulatorJacobianAgree) {
  Random random(7);
  for (int i = 0; i < 100; ++i) {
    const Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 3.0 * kDegree);
    const ManipulatorJacobians routes = manipulator_jacobians(model, errors, testing::random_joints(model, random));
    ASSERT_EQ(routes.kdl.cols(), static_cast<Eigen::Index>(model.joints.size()));
    ASSERT_LT((routes.matrix_derivative - routes.kdl).cwiseAbs().maxCoeff(), 1e-12);
    ASSERT_LT((routes.cross_product - routes.kdl).cwiseAbs().maxCoeff(), 1e-12);
    ASSERT_LT(routes.largest_difference, 1e-12);
  }
}

// Whatever the order of a frame's parameters: with a rotation in front of a translation it has a lever arm.
TEST_P(EveryChainsKinematics, FolderGivesTheFoldedChainAndTheTwists) {
  Random random(8);
  ErrorModel arm = model;
  for (int order = 0; order < 2; ++order) {
    const Eigen::VectorXd errors = testing::random_errors(arm, random, 0.01, 0.1);
    const FoldedChain expected = folded(arm, errors);
    const std::vector<ParameterTwist> expected_twists = parameter_twists(arm, errors, which);
    const ChainFolder folder(arm, which);
    FoldedChain chain = folder.shape();
    std::vector<ParameterTwist> twists(which.size());
    folder.fold(errors, chain, twists, 0);
    EXPECT_EQ(chain.prismatic, expected.prismatic);
    for (std::size_t i = 0; i < expected.links.size(); ++i) {
      EXPECT_LT((chain.links[i].matrix() - expected.links[i].matrix()).norm(), 1e-14) << i;
    }
    for (std::size_t p = 0; p < which.size(); ++p) {
      EXPECT_EQ(twists[p].frame, expected_twists[p].frame);
      EXPECT_LT((twists[p].linear - expected_twists[p].linear).norm(), 1e-14) << arm.parameters[p].name;
      EXPECT_LT((twists[p].angular - expected_twists[p].angular).norm(), 1e-14) << arm.parameters[p].name;
    }
    std::reverse(arm.parameters.begin(), arm.parameters.end());
  }
}

TEST(Kinematics, FoldsAxesOfAnyDirection) {
  Random random(9);
  for (const std::string axis : {"0 0 -1", "1e-9 0 -1", "0.3 -0.2 -0.9", "-1 0 0", "0.6 0 -0.5", "0 0.1 0.9"}) {
    std::string urdf = testing::kOddArm;
    const std::string old = "0 -1 0";
    urdf.replace(urdf.find(old), old.size(), axis);
    const ErrorModel model = complete_model(parse_robot(urdf));
    const Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 3.0 * kDegree);
    const Eigen::VectorXd q = testing::random_joints(model, random);
    const KDL::Frame ours = to_kdl(flange_pose(folded(model, errors), q));
    EXPECT_LT(difference(ours, kdl_pose(error_chain(model, errors), q)), 1e-12) << axis;
  }
}

INSTANTIATE_TEST_SUITE_P(Kinematics, EveryChainsKinematics, ::testing::Values(true, false),
                         [](const auto& test) { return test.param ? "R2000iC" : "OddArm"; });

}  // namespace
}  // namespace kdl_calibration::kinematics_test
