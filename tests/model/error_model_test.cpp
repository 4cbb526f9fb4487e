#include "kdl_calibration/error_model.hpp"

#include <gmock/gmock.h>

#include "model/error_chains.hpp"
#include "model/parameters.hpp"
#include "parameter_chain.hpp"
#include "support.hpp"

namespace kdl_calibration::error_model_test {
namespace {

using testing::difference;
using ::testing::ElementsAre;
using testing::fanuc;
using testing::kDegree;
using testing::kdl_pose;

TEST(ErrorModel, CompleteModelIsThePublishedOne) {
  const ErrorModel model = complete_model(fanuc());
  std::vector<std::string> names = testing::names_of(model.parameters);
  std::erase_if(names, [](const std::string& name) { return name.back() == '0'; });  // link 0 is the base's own
  EXPECT_THAT(names, ElementsAre("dq1", "dq2", "dq3", "dq4", "dq5", "dq6",           //
                                 "Tx1", "Ty1", "Rx1", "Ry1", "Tz2", "Ty2", "Rz2", "Ry2", "Tz3", "Ty3", "Rz3", "Ry3",
                                 "Tz4", "Tx4", "Rz4", "Rx4", "Tz5", "Ty5", "Rz5", "Ry5", "Tz6", "Tx6", "Rz6", "Rx6"));
}

TEST(ErrorModel, LengthsOfThePublicationAreTheNominalValues) {
  const ErrorModel model = complete_model(fanuc());
  const auto nominal = [&](const char* name) { return model.parameters[parameter_index(model, name)].nominal; };
  EXPECT_DOUBLE_EQ(nominal("Tz0"), 0.670);
  EXPECT_DOUBLE_EQ(nominal("Ty1"), 0.312);
  EXPECT_DOUBLE_EQ(nominal("Tz2"), 1.075);
  EXPECT_DOUBLE_EQ(nominal("Tz3"), 0.225);
  EXPECT_DOUBLE_EQ(nominal("Ty3"), 1.280);
  EXPECT_EQ(nominal("Tx1"), 0.0);
}

class EveryChain : public ::testing::TestWithParam<bool> {
protected:
  const ErrorModel model = complete_model(GetParam() ? fanuc() : parse_robot(testing::kOddArm));
};

TEST_P(EveryChain, ErrorSegmentsAndFoldedChainGiveTheSameFlangePose) {
  Random random(5);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 3.0 * kDegree);
    const Eigen::VectorXd q = testing::random_joints(model, random);
    ASSERT_LT(difference(kdl_pose(error_chain(model, errors), q), kdl_pose(folded_chain(model, errors), q)), 1e-12);
  }
}

TEST_P(EveryChain, WithZeroErrorsIsTheNominalChain) {
  const Robot robot = GetParam() ? fanuc() : parse_robot(testing::kOddArm);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  Random random(6);
  for (int i = 0; i < 100; ++i) {
    const Eigen::VectorXd q = testing::random_joints(model, random);
    ASSERT_LT(difference(kdl_pose(robot.chain, q), kdl_pose(error_chain(model, zero), q)), 1e-14);
  }
}

TEST_P(EveryChain, WithErrorsAsJointsGivesTheSamePose) {
  Random random(7);
  const Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 3.0 * kDegree);
  const Eigen::VectorXd q = testing::random_joints(model, random);
  const testing::ParameterChain chain = testing::parameter_chain(model);
  Eigen::VectorXd all(chain.chain.getNrOfJoints());
  for (std::size_t i = 0; i < chain.joint_index.size(); ++i) {
    all[chain.joint_index[i]] = q[static_cast<Eigen::Index>(i)];
  }
  for (std::size_t p = 0; p < chain.parameter_index.size(); ++p) {
    all[chain.parameter_index[p]] = errors[static_cast<Eigen::Index>(p)];
  }
  EXPECT_LT(difference(kdl_pose(chain.chain, all), kdl_pose(error_chain(model, errors), q)), 1e-13);
}

INSTANTIATE_TEST_SUITE_P(ErrorModel, EveryChain, ::testing::Values(true, false),
                         [](const auto& test) { return test.param ? "R2000iC" : "OddArm"; });

/// The published product, written out once: Tz(l1) Rz(q1+dq1) [Tx1 Ty1 Rx1 Ry1] Rx(q2+dq2) … as one reads it.
KDL::Frame published_model(const ErrorModel& model, const Eigen::VectorXd& e, const Eigen::VectorXd& q) {
  const auto v = [&](const char* name) { return e[static_cast<Eigen::Index>(parameter_index(model, name))]; };
  const auto T = [](double x, double y, double z) { return KDL::Frame(KDL::Vector(x, y, z)); };
  const auto Rx = [](double a) { return KDL::Frame(KDL::Rotation::RotX(a)); };
  const auto Ry = [](double a) { return KDL::Frame(KDL::Rotation::RotY(a)); };
  const auto Rz = [](double a) { return KDL::Frame(KDL::Rotation::RotZ(a)); };
  return T(0, 0, 0.670) * Rz(q[0] + v("dq1")) *                                                          //
         T(v("Tx1"), 0.312 + v("Ty1"), 0) * Rx(v("Rx1")) * Ry(v("Ry1")) * Rx(q[1] + v("dq2")) *          //
         T(0, v("Ty2"), 1.075 + v("Tz2")) * Rz(v("Rz2")) * Ry(v("Ry2")) * Rx(q[2] + v("dq3")) *          //
         T(0, 1.280 + v("Ty3"), 0.225 + v("Tz3")) * Rz(v("Rz3")) * Ry(v("Ry3")) * Ry(q[3] + v("dq4")) *  //
         T(v("Tx4"), 0, v("Tz4")) * Rz(v("Rz4")) * Rx(v("Rx4")) * Rx(q[4] + v("dq5")) *                  //
         T(0, v("Ty5"), v("Tz5")) * Rz(v("Rz5")) * Ry(v("Ry5")) * Ry(q[5] + v("dq6")) *                  //
         T(0, 0.215, 0) * T(v("Tx6"), 0, v("Tz6")) * Rz(v("Rz6")) * Rx(v("Rx6"));
}

TEST(ErrorModel, EqualsThePublishedFormulaWrittenOut) {
  const ErrorModel model = complete_model(fanuc());
  Random random(8);
  for (int i = 0; i < 100; ++i) {
    Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 3.0 * kDegree);
    for (const char* name : {"Tz0", "Tx0", "Ty0", "Rz0", "Rx0", "Ry0"}) {
      errors[static_cast<Eigen::Index>(parameter_index(model, name))] = 0.0;
    }
    const Eigen::VectorXd q = testing::random_joints(model, random);
    ASSERT_LT(difference(published_model(model, errors, q), kdl_pose(error_chain(model, errors), q)), 1e-13);
  }
}

}  // namespace
}  // namespace kdl_calibration::error_model_test
