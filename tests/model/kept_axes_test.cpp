#include "model/kept_axes.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <kdl/chainjnttojacsolver.hpp>
#include <numeric>

#include "kept_axes_support.hpp"
#include "model/error_chains.hpp"
#include "model/kinematics.hpp"
#include "model/reduction.hpp"
#include "parameter_chain.hpp"
#include "refusal.hpp"
#include "support.hpp"
#include "ur10.hpp"

namespace kdl_calibration::kept_axes_test {
namespace {

using ::testing::AllOf;
using testing::AxisLine;
using ::testing::ElementsAre;
using testing::fanuc;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

struct TestJoint {
  std::string xyz;
  std::string rpy = "0 0 0";
  std::string axis = "0 0 1";
};

// A URDF of revolute joints j1, j2, … and a tip.
std::string arm(const std::vector<TestJoint>& joints, const std::string& tip) {
  std::string links = "<link name='l0'/>";
  std::string text;
  for (std::size_t i = 1; i <= joints.size(); ++i) {
    const auto& [xyz, rpy, axis] = joints[i - 1];
    const std::string number = std::to_string(i);
    links += "<link name='l" + number + "'/>";
    text += "<joint name='j" + number + "' type='continuous'><parent link='l" + std::to_string(i - 1) +
            "'/><child link='l" + number + "'/><origin xyz='" + xyz + "' rpy='" + rpy + "'/><axis xyz='" + axis +
            "'/></joint>";
  }
  return "<robot name='arm'>" + links + "<link name='tip'/>" + text +
         "<joint name='mount' type='fixed'><parent link='l" + std::to_string(joints.size()) +
         "'/><child link='tip'/><origin xyz='" + tip + "'/></joint></robot>";
}

// An arm whose frames stand far from the wrist's point, (1.2, 0, 0.4) at zero, and are turned. Axis 3 is parallel to
// axis 2 and no axis of its frame.
std::string arm_with_frames_off_the_wrist() {
  return arm({{.xyz = "0 0 0.4", .rpy = "0 0 0.3"},
              {.xyz = "0.2 0 0.1", .rpy = "0 0 -0.3", .axis = "0 1 0"},
              {.xyz = "0 0.1 0.7", .rpy = "0.5235987755982988 0 0", .axis = "0 0.8660254037844386 -0.5"},
              {.xyz = "0.3 0 0", .rpy = "-0.5235987755982988 0 0", .axis = "1 0 0"},
              {.xyz = "0.6 0.15 0", .axis = "0 1 0"},
              {.xyz = "0.085 -0.15 0", .rpy = "0.4 0 0", .axis = "-1 0 0"}},
             "0.1 0 0");
}

// Seven joints with a spherical shoulder, elbow and wrist.
std::string arm_of_seven() {
  return arm({{.xyz = "0 0 0.15"},
              {.xyz = "0 0 0.19", .axis = "0 1 0"},
              {.xyz = "0 0 0.21"},
              {.xyz = "0 0 0.19", .axis = "0 -1 0"},
              {.xyz = "0 0 0.21"},
              {.xyz = "0 0.06 0.19", .axis = "0 1 0"},
              {.xyz = "0 -0.06 0.08"}},
             "0 0 0.045");
}

// Axes, counted from 1, that are parallel or meet.
struct Case {
  std::string name;
  Robot robot;
  std::vector<std::vector<std::size_t>> parallel;
  std::vector<std::vector<std::size_t>> meeting;
  int lost = 0;         // parameters that can be told apart: two for each parallel pair, and for each that meets one,
  int lost_angles = 0;  // and two for the third; with angles, one for each other pair, and one where it meets
};

std::vector<Case> cases() {
  return {{"R2000iC", fanuc(), {{2, 3}}, {{4, 5, 6}}, 5, 9},
          {"Ur10", parse_robot(testing::kUr10), {{2, 3, 4}}, {{5, 6}}, 5, 10},
          {"FramesOffTheWrist", parse_robot(arm_with_frames_off_the_wrist()), {{2, 3}}, {{4, 5, 6}}, 5, 9 + 1},
          {"Seven", parse_robot(arm_of_seven()), {}, {{1, 2, 3}, {3, 4, 5}, {5, 6, 7}}, 9, 15}};
}

class EveryArm : public ::testing::TestWithParam<Case> {};

TEST_P(EveryArm, KeepsItsAxesAtFiniteErrors) {
  for (const KeptAxes kept : {KeptAxes::closed_form, KeptAxes::angles}) {
    const ErrorModel model = complete_model(GetParam().robot, kept);
    Random random(3);
    for (int i = 0; i < 100; ++i) {
      const KDL::Chain chain = folded_chain(model, testing::random_errors(model, random, 0.05, 0.2));
      const std::vector<AxisLine> lines = testing::axis_lines(chain, testing::random_joints(model, random));
      for (const std::vector<std::size_t>& run : GetParam().parallel) {
        for (const std::size_t joint : run) {
          ASSERT_LT(testing::tilt(lines[run.front() - 1], lines[joint - 1]), 1e-12);
        }
      }
      for (const std::vector<std::size_t>& run : GetParam().meeting) {
        std::vector<AxisLine> meeting;
        for (const std::size_t joint : run) {
          meeting.push_back(lines[joint - 1]);
        }
        ASSERT_LT(testing::missed_point(meeting), 1e-12);
      }
    }
  }
}

TEST_P(EveryArm, KeepsTheAnglesBetweenAllNeighbours) {
  const ErrorModel model = complete_model(GetParam().robot, KeptAxes::angles);
  Random random(4);
  const Eigen::VectorXd q = testing::random_joints(model, random);
  const std::vector<AxisLine> nominal = testing::axis_lines(GetParam().robot.chain, q);
  const Eigen::VectorXd errors = testing::random_errors(model, random, 0.05, 0.2);
  const std::vector<AxisLine> lines = testing::axis_lines(folded_chain(model, errors), q);
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
    EXPECT_NEAR(lines[i].direction.dot(lines[i + 1].direction), nominal[i].direction.dot(nominal[i + 1].direction),
                1e-12);
  }
}

// Grassmann's count: a parallel pair takes two of the parameters that can be told apart, and so on. No more are lost.
TEST_P(EveryArm, LosesOnlyTheParametersThatWouldPartTheAxes) {
  std::vector<TargetFrame> targets = generic_targets(1);
  targets[0].with_orientation = true;
  const auto rank = [&](KeptAxes kept, const ReductionOptions& options) {
    return reduced_model(complete_model(GetParam().robot, kept), targets, options).rank;
  };
  const std::vector<std::string> base_and_target = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz",
                                                    "A.x",     "A.y",     "A.z",     "A.Rx",    "A.Ry",    "A.Rz"};
  for (const bool known : {false, true}) {
    const ReductionOptions options{.fixed = known ? base_and_target : std::vector<std::string>()};
    const int all = rank(KeptAxes::none, options);
    EXPECT_EQ(rank(KeptAxes::closed_form, options), all - GetParam().lost) << known;
    EXPECT_EQ(rank(KeptAxes::angles, options), all - GetParam().lost_angles) << known;
  }
}

TEST_P(EveryArm, HasTheJacobianOfTheKdlSolverOnTheChainWithErrorsAsJoints) {
  const ErrorModel model = complete_model(GetParam().robot, KeptAxes::closed_form);
  const testing::ParameterChain oracle = testing::parameter_chain(model);
  KDL::ChainJntToJacSolver solver(oracle.chain);
  std::vector<std::size_t> which(model.parameters.size());
  std::iota(which.begin(), which.end(), 0U);
  Random random(5);
  const Eigen::VectorXd errors = testing::random_errors(model, random, 0.01, 0.05);
  const Eigen::VectorXd q = testing::random_joints(model, random);
  Matrix6Xd jacobian;
  const std::vector<ParameterTwist> twists = parameter_twists(model, errors, which);
  const Eigen::Isometry3d X_BF = flange_jacobian(folded(model, errors), twists, q, jacobian);

  KDL::JntArray all(oracle.chain.getNrOfJoints());
  for (std::size_t j = 0; j < oracle.joint_index.size(); ++j) {
    all(oracle.joint_index[j]) = q[static_cast<Eigen::Index>(j)];
  }
  for (const std::size_t p : which) {
    all(oracle.parameter_index[p]) = errors[static_cast<Eigen::Index>(p)];
  }
  EXPECT_LT(testing::difference(to_kdl(X_BF), testing::kdl_pose(oracle.chain, all.data)), 1e-12);
  KDL::Jacobian expected(all.rows());
  solver.JntToJac(all, expected);
  for (const std::size_t p : which) {
    const Vector6d column = expected.data.col(oracle.parameter_index[p]);
    EXPECT_LT((X_BF.linear() * jacobian.col(static_cast<Eigen::Index>(p)).head<3>() - column.head<3>()).norm(), 1e-12);
    EXPECT_LT((X_BF.linear() * jacobian.col(static_cast<Eigen::Index>(p)).tail<3>() - column.tail<3>()).norm(), 1e-12);
  }

  const ChainFolder folder(model, which);
  FoldedChain chain = folder.shape();
  std::vector<ParameterTwist> folded_twists(which.size());
  folder.fold(errors, chain, folded_twists, 0);
  EXPECT_LT(testing::difference(to_kdl(flange_pose(chain, q)), to_kdl(X_BF)), 1e-12);
  for (const std::size_t p : which) {
    EXPECT_LT((folded_twists[p].linear - twists[p].linear).norm(), 1e-12);
    EXPECT_LT((folded_twists[p].angular - twists[p].angular).norm(), 1e-12);
  }
}

TEST_P(EveryArm, IsTheSameWithTheErrorsThatItLacksAtZero) {
  const ErrorModel kept = complete_model(GetParam().robot, KeptAxes::angles);
  Random random(6);
  const Eigen::VectorXd errors = testing::random_errors(kept, random, 0.01, 0.05);
  const Eigen::VectorXd q = testing::random_joints(kept, random);
  const auto [model, all] = with_free_axes(kept, errors);
  EXPECT_LT(testing::difference(testing::kdl_pose(folded_chain(model, all), q),
                                testing::kdl_pose(folded_chain(kept, errors), q)),
            1e-12);
  std::vector<std::string> names = testing::names_of(model.parameters);
  for (const std::string& name : testing::names_of(complete_model(GetParam().robot).parameters)) {
    EXPECT_EQ(std::count(names.begin(), names.end(), name), 1) << name;
  }
}

INSTANTIATE_TEST_SUITE_P(KeptAxes, EveryArm, ::testing::ValuesIn(cases()),
                         [](const auto& test) { return test.param.name; });

TEST(KeptAxes, OfTheR2000iCTakeTheTurnsOfLink2AndTheShiftsOfTheWrist) {
  const ErrorModel model = complete_model(fanuc(), KeptAxes::closed_form);
  std::vector<std::string> names = testing::names_of(model.parameters);
  std::erase_if(names, [](const std::string& name) { return name.front() == 'd' || name.back() == '0'; });
  EXPECT_THAT(names, ElementsAre("Tx1", "Ty1", "Rx1", "Ry1", "Tz2", "Ty2", "Tz3", "Ty3", "Rz3", "Ry3",  //
                                 "Rz4", "Rx4", "Rz5", "Ry5", "Tz6", "Tx6", "Ty6", "Rz6", "Rx6"));
}

TEST(KeptAxes, NeedNoMoreThanTheRelationsOfTheClosedForm) {
  const AxisRelations kept = axis_relations(parse_robot(testing::kUr10).joints, KeptAxes::closed_form);
  EXPECT_THAT(kept.parallel, ElementsAre(AxisRun{.first = 1, .count = 3}));
  EXPECT_THAT(kept.meeting, ElementsAre(AxisRun{.first = 4, .count = 2}));
  const AxisRelations angles = axis_relations(parse_robot(testing::kUr10).joints, KeptAxes::angles);
  EXPECT_THAT(angles.meeting, ElementsAre(AxisRun{.first = 0, .count = 2}, AxisRun{.first = 3, .count = 2},
                                          AxisRun{.first = 4, .count = 2}));
}

// The first three axes of an arm, and others of these origins.
Robot arm_with(const std::string& third_rpy, const std::string& sixth_xyz) {
  return parse_robot(arm({{.xyz = "0 0 0.4"},
                          {.xyz = "0.2 0 0", .axis = "0 1 0"},
                          {.xyz = "0 0 0.7", .rpy = third_rpy, .axis = "0 1 0"},
                          {.xyz = "0.1 0 0.1", .axis = "1 0 0"},
                          {.xyz = "0.5 0 0", .axis = "0 1 0"},
                          {.xyz = sixth_xyz, .axis = "1 0 0"}},
                         "0.1 0 0"));
}

TEST(KeptAxes, AreRefusedWhereTheNominalOnesAreOnlyNearlyParallelOrNearlyMeet) {
  EXPECT_REFUSED_WITH(AllOf(HasSubstr("j2, j3"), HasSubstr("0.0016 rad from parallel")),
                      complete_model(arm_with("0.0016 0 0", "0.1 0 0"), KeptAxes::closed_form));
  EXPECT_REFUSED_WITH(AllOf(HasSubstr("j4, j5, j6"), HasSubstr("0.3 mm")),
                      complete_model(arm_with("0 0 0", "0.1 0 0.0003"), KeptAxes::closed_form));
  // Numbers that are rounded in the fifth digit are what they mean.
  EXPECT_THAT(axis_relations(arm_with("0.000004 0 0", "0.1 0 0.000004").joints, KeptAxes::closed_form).meeting,
              ElementsAre(AxisRun{.first = 3, .count = 3}));
  // An offset of another size is the robot's.
  EXPECT_THAT(axis_relations(arm_with("0 0 0", "0.1 0 0.03").joints, KeptAxes::closed_form).meeting, IsEmpty());
}

TEST(KeptAxes, AreRefusedWhereThereAreNone) {
  const Robot robot = parse_robot(arm({{.xyz = "0 0 0.4"}, {.xyz = "0.2 0 0", .rpy = "0.7 0 0"}}, "0.1 0 0"));
  EXPECT_REFUSED("none to keep", complete_model(robot, KeptAxes::closed_form));
}

}  // namespace
}  // namespace kdl_calibration::kept_axes_test
