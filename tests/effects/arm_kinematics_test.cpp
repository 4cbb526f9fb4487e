#include "effects/arm_kinematics.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/error_chains.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"
#include "two_step/matrix_derivatives.hpp"

namespace kdl_calibration::arm_kinematics_test {
namespace {

using testing::fanuc;
using testing::kdl_pose;

/// An arm with errors and with every term of every group, as large as they are on real ones.
struct Bent {
  ErrorModel model;
  Eigen::VectorXd errors;
  Eigen::VectorXd effects;
  Eigen::MatrixXd q;

  explicit Bent(const Robot& robot) : model(complete_model(robot)) {
    Random random(7);
    q = random_configurations(limits_of(model.joints), 60, random);
    errors = testing::random_errors(model, random, 0.001, 0.001);
    for (const std::string& name : effect_group_names()) {
      const std::vector<EffectTerm> terms = effect_terms(model, *effect_group(name), q);
      model.effects.insert(model.effects.end(), terms.begin(), terms.end());
    }
    const std::string& joint = model.joints[2].name;
    const OwnEffect growth{
        .name = "growth", .joint = joint, .axis = EffectAxis::along, .columns = [](const Eigen::MatrixXd& at) {
          return Eigen::MatrixXd(at.row(1).transpose());
        }};
    const std::vector<EffectTerm> terms = own_terms(model, growth, q);
    model.effects.insert(model.effects.end(), terms.begin(), terms.end());
    effects.resize(static_cast<Eigen::Index>(model.effects.size()));
    for (double& value : effects) {
      value = 2e-4 * random.normal();
    }
  }
};

class OfArms : public ::testing::TestWithParam<const char*> {
protected:
  Bent bent() const { return Bent(GetParam() == std::string("fanuc") ? fanuc() : parse_robot(testing::kOddArm)); }
};

TEST_P(OfArms, PoseIsThatOfTheKdlSolverAtTheJointValuesWithTheirEffects) {
  const Bent bent = this->bent();
  const ArmKinematics arm(bent.model, bent.errors, bent.effects);
  const KDL::Chain chain = folded_chain(bent.model, bent.errors);
  const Eigen::MatrixXd moved = effective_joint_values(bent.model, bent.effects, bent.q);
  const Eigen::Index joints = bent.q.rows();
  ASSERT_EQ(moved.rows(), 4 * joints);
  EXPECT_GT((moved.topRows(joints) - bent.q).cwiseAbs().maxCoeff(), 1e-4);
  EXPECT_GT(moved.middleRows(joints, 2 * joints).cwiseAbs().maxCoeff(), 1e-4);
  EXPECT_GT(moved.row(3 * joints + 2).cwiseAbs().maxCoeff(), 1e-6);
  for (Eigen::Index c = 0; c < bent.q.cols(); ++c) {
    const KDL::Chain stretched = stretched_chain(bent.model, chain, moved.col(c).tail(joints));
    const KDL::Chain tilted = tilted_chain(stretched, moved.col(c).segment(joints, 2 * joints));
    EXPECT_LT(testing::difference(kdl_pose(tilted, moved.col(c).head(joints)), to_kdl(arm.flange_pose(bent.q.col(c)))),
              1e-12);
  }
}

TEST_P(OfArms, JacobianIsTheDerivativeOfThePose) {
  const Bent bent = this->bent();
  const ArmKinematics arm(bent.model, bent.errors, bent.effects);
  const ArmKinematics rigid(bent.model, bent.errors, {});
  double largest = 0.0;
  double without = 0.0;
  for (Eigen::Index c = 0; c < bent.q.cols(); ++c) {
    const Eigen::VectorXd q = bent.q.col(c);
    Matrix6Xd jacobian;
    Matrix6Xd of_links;
    const Eigen::Isometry3d pose = arm.flange_pose(q, jacobian);
    EXPECT_LT((pose.matrix() - arm.flange_pose(q).matrix()).cwiseAbs().maxCoeff(), 1e-14);
    rigid.flange_pose(q, of_links);
    const Eigen::MatrixXd expected = testing::central_differences(q.size(), 1e-6, [&](const Eigen::VectorXd& step) {
      const Eigen::Isometry3d moved = arm.flange_pose(q + step);
      Vector6d motion;
      motion << moved.translation(), rotation_log(moved.linear() * pose.linear().transpose());
      return motion;
    });
    largest = std::max(largest, (jacobian - expected).cwiseAbs().maxCoeff());
    without = std::max(without, (of_links - expected).cwiseAbs().maxCoeff());
  }
  EXPECT_LT(largest, 1e-8);
  EXPECT_GT(without, 1e-4) << "the effects' own share";
}

TEST_P(OfArms, IsTheSameFromSeveralThreads) {
  const Bent bent = this->bent();
  const ArmKinematics arm(bent.model, bent.errors, bent.effects);
  std::vector<Matrix6Xd> found(4);
  std::vector<std::thread> threads;
  for (Matrix6Xd& jacobian : found) {
    threads.emplace_back([&] {
      for (Eigen::Index c = 0; c < bent.q.cols(); ++c) {
        arm.flange_pose(bent.q.col(c), jacobian);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  for (const Matrix6Xd& jacobian : found) {
    EXPECT_TRUE(jacobian == found.front());
  }
}

INSTANTIATE_TEST_SUITE_P(CalibratedArm, OfArms, ::testing::Values("fanuc", "odd"),
                         [](const auto& kind) { return std::string(kind.param); });

TEST(CalibratedArm, WithoutEffectsIsTheRigidChain) {
  const Bent bent(fanuc());
  const KDL::Chain chain = error_chain(bent.model, bent.errors);
  for (const Eigen::VectorXd& effects : {Eigen::VectorXd(), Eigen::VectorXd(0.0 * bent.effects)}) {
    const ArmKinematics arm(bent.model, bent.errors, effects);
    const Eigen::VectorXd q = bent.q.col(3);
    EXPECT_LT(testing::difference(kdl_pose(chain, q), to_kdl(arm.flange_pose(q))), 1e-12);
    Matrix6Xd jacobian;
    arm.flange_pose(q, jacobian);
    EXPECT_LT((jacobian - manipulator_jacobians(bent.model, bent.errors, q).kdl).cwiseAbs().maxCoeff(), 1e-12);
  }
}

TEST(CalibratedArm, IsRefusedWithErrorsThatAreNotFinite) {
  const Bent bent(fanuc());
  EXPECT_EQ(ArmKinematics(bent.model, bent.errors, bent.effects).joints(), 6);
  Eigen::VectorXd odd = bent.errors;
  odd[4] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(ArmKinematics(bent.model, odd, bent.effects), InputError);
}

}  // namespace
}  // namespace kdl_calibration::arm_kinematics_test
