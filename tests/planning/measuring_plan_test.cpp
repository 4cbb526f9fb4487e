#include "planning/measuring_plan.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <numeric>

#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::measuring_plan_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

MeasuringPlan plan_of(const MatrixXd& joint_values) {
  MeasuringPlan plan{.joint_values = joint_values, .targets = {"A", "B, left"}, .notes = {"one\nline"}};
  for (Index c = 0; c < joint_values.cols(); ++c) {
    plan.configurations.push_back(std::to_string(c + 1));
  }
  return plan;
}

JointConvention pendant(const Robot& robot) {
  return matched_convention(read_joint_convention(std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json"),
                            joint_names(robot));
}

TEST(MeasuringPlan, OrdersTheWayAsWellAsAnyOrderOfAFew) {
  const Robot robot = testing::fanuc();
  const ErrorModel model = complete_model(robot);
  Random random(2);
  const Eigen::VectorXd home = Eigen::VectorXd::Zero(6);
  int best_found = 0;
  for (int trial = 0; trial < 10; ++trial) {
    const MatrixXd q = random_configurations(limits_of(model.joints), 7, random);
    std::vector<Index> order(7);
    std::iota(order.begin(), order.end(), Index{0});
    double best = 1e9;
    do {
      best = std::min(best, way_time(robot.joints, home, q(Eigen::all, order)));
    } while (std::next_permutation(order.begin(), order.end()));
    std::vector<Index> way = short_way(robot.joints, home, q);
    const double time = way_time(robot.joints, home, q(Eigen::all, way));
    EXPECT_LE(time, 1.25 * best);
    best_found += time < best + 1e-9 ? 1 : 0;
    std::sort(way.begin(), way.end());
    EXPECT_EQ(way, order = (std::iota(order.begin(), order.end(), Index{0}), order));
  }
  EXPECT_GE(best_found, 3);
}

// Joints of different velocities, a slide among them; the last one states none.
constexpr const char* kUnevenArm = R"(<robot name="uneven">
  <link name="rail"/><link name="carriage"/><link name="arm"/><link name="hand"/><link name="tip"/>
  <joint name="slide" type="prismatic"><parent link="rail"/><child link="carriage"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" velocity="0.25" effort="1"/></joint>
  <joint name="shoulder" type="revolute"><parent link="carriage"/><child link="arm"/><origin xyz="0 0 0.5"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0.5 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="4" effort="1"/></joint>
  <joint name="wrist" type="continuous"><parent link="hand"/><child link="tip"/><origin xyz="0.5 0 0"/>
    <axis xyz="0 1 0"/></joint>
</robot>)";

JointConvention uneven_convention() {
  return {.name = "uneven.json",
          .controller_joints = {"E1", "J1", "J2", "J3"},
          .urdf_joints = {"slide", "shoulder", "elbow", "wrist"},
          .matrix = MatrixXd::Identity(4, 4),
          .offset = Eigen::VectorXd::Zero(4)};
}

// max |to - from| / velocity.
double seconds(const Eigen::VectorXd& from, const Eigen::VectorXd& to) {
  const Eigen::Vector4d velocities(0.25, 2.0, 4.0, 1.0);
  return (to - from).cwiseAbs().cwiseQuotient(velocities).maxCoeff();
}

TEST(MeasuringPlan, EveryJointDrivesAtItsOwnVelocity) {
  const Robot robot = parse_robot(kUnevenArm);
  const Eigen::Vector4d home(0.5, -0.5, 1.0, -2.0);
  for (int joint = 0; joint < 4; ++joint) {  // each alone, there and back
    const Eigen::Vector4d to = home + 0.75 * Eigen::Vector4d::Unit(joint);
    EXPECT_DOUBLE_EQ(travel_time(robot.joints, home, to), seconds(home, to)) << "joint " << joint;
    EXPECT_DOUBLE_EQ(travel_time(robot.joints, to, home), seconds(home, to)) << "joint " << joint;
  }
  Random random(4);
  const MatrixXd q = random_configurations(limits_of(robot.joints), 20, random);
  double total = seconds(home, q.col(0));
  for (Index c = 1; c < q.cols(); ++c) {
    const double time = seconds(q.col(c - 1), q.col(c));
    EXPECT_DOUBLE_EQ(travel_time(robot.joints, q.col(c - 1), q.col(c)), time);
    total += time;
  }
  EXPECT_NEAR(way_time(robot.joints, home, q), total, 1e-12);
  EXPECT_EQ(way_time(robot.joints, home, MatrixXd(4, 0)), 0.0);
}

TEST(MeasuringPlan, OrdersByTimeAndNotByDistance) {
  const Robot robot = parse_robot(kUnevenArm);
  // The elbow is far but fast, the slide near but slow.
  MatrixXd q = MatrixXd::Zero(4, 2);
  q(2, 0) = 3.0;
  q(0, 1) = 0.5;
  const Eigen::VectorXd home = Eigen::VectorXd::Zero(4);
  EXPECT_EQ(short_way(robot.joints, home, q), (std::vector<Index>{0, 1}));
  EXPECT_DOUBLE_EQ(way_time(robot.joints, home, q), 0.75 + 2.0);
  // At one velocity for all it is the other way round.
  std::vector<MovingJoint> even = robot.joints;
  for (MovingJoint& joint : even) {
    joint.velocity = 1.0;
  }
  EXPECT_EQ(short_way(even, home, q), (std::vector<Index>{1, 0}));
  EXPECT_DOUBLE_EQ(way_time(even, home, q), 3.0 + 3.0);
}

// No part of the way is better reversed.
TEST(MeasuringPlan, NoReversalMakesTheWayShorter) {
  const Robot robot = parse_robot(kUnevenArm);
  Random random(6);
  const Eigen::Vector4d home(0.5, -0.5, 1.0, -2.0);
  for (const int count : {0, 1, 2, 9, 20, 30, 40}) {
    const MatrixXd q = random_configurations(limits_of(robot.joints), count, random);
    const std::vector<Index> way = short_way(robot.joints, home, q);
    ASSERT_EQ(way.size(), static_cast<std::size_t>(count));
    const double time = way_time(robot.joints, home, q(Eigen::all, way));
    for (auto first = way.begin(); first != way.end(); ++first) {
      for (auto last = first + 1; last != way.end(); ++last) {
        std::vector<Index> reversed = way;
        std::reverse(reversed.begin() + (first - way.begin()), reversed.begin() + (last - way.begin()) + 1);
        EXPECT_GE(way_time(robot.joints, home, q(Eigen::all, reversed)), time - 1e-9) << count << " stops";
      }
    }
  }
}

TEST(MeasuringPlan, AJointThatStatesNoVelocityDrivesAtOne) {
  std::vector<MovingJoint> joints = parse_robot(kUnevenArm).joints;
  joints[0].velocity = 0.0;
  joints[1].velocity.reset();
  EXPECT_DOUBLE_EQ(travel_time(joints, Eigen::Vector4d::Zero(), Eigen::Vector4d(0.75, 0.0, 0.0, 0.0)), 0.75);
  EXPECT_DOUBLE_EQ(travel_time(joints, Eigen::Vector4d::Zero(), Eigen::Vector4d(0.0, -1.5, 0.0, 0.0)), 1.5);
}

TEST(MeasuringPlan, RoundsToABillionthOfADegreeOrAMillimetre) {
  const Robot robot = parse_robot(kUnevenArm);
  Eigen::VectorXd q(4);
  q << 0.12345678901234e-3, 0.12345678951 * testing::kDegree, -7.0000000004 * testing::kDegree, 0.0;
  EXPECT_THAT(plan_csv(plan_of(q), robot.joints), ::testing::HasSubstr("1,A,0.123456789,0.12345679,-7,0,,,\n"));
}

TEST(MeasuringPlan, OfControllersJointsHasTheirOffsetsAndTheUnitsOfWhatTheyMove) {
  const Robot robot = parse_robot(kUnevenArm);
  JointConvention convention = uneven_convention();
  convention.offset << 0.5, 10 * testing::kDegree, 0.0, -20 * testing::kDegree;
  convention.matrix(0, 0) = -1.0;
  convention.matrix(2, 1) = 0.5;  // J1 moves the elbow too
  const MeasuringPlan plan = plan_of(Eigen::Vector4d(0.75, 30 * testing::kDegree, 45 * testing::kDegree, 0.0));
  const std::string csv = plan_csv(plan, robot.joints, &convention);
  EXPECT_THAT(csv, ::testing::HasSubstr(",E1[mm],J1[deg],J2[deg],J3[deg],"));
  EXPECT_THAT(csv, ::testing::HasSubstr("1,A,-250,20,35,20,,,\n"));
  const auto refused = [&] { return testing::refusal([&] { plan_csv(plan, robot.joints, &convention); }); };
  convention.urdf_joints.back() = "other";
  EXPECT_THAT(refused(), ::testing::HasSubstr("other"));
  convention.urdf_joints.back() = "wrist";
  convention.matrix(0, 1) = 0.01;  // J1 would move the slide as well
  EXPECT_THAT(refused(), ::testing::HasSubstr("uneven.json: controller joint 'J1' moves angles and lengths"));
}

TEST(MeasuringPlan, ComesBackFromItsFile) {
  const Robot robot = testing::fanuc();
  const ErrorModel model = complete_model(robot);
  Random random(1);
  const MeasuringPlan plan = plan_of(random_configurations(limits_of(model.joints), 5, random));
  const JointConvention convention = pendant(robot);
  for (const JointConvention* behind : {static_cast<const JointConvention*>(nullptr), &convention}) {
    const std::string csv = plan_csv(plan, robot.joints, behind);
    const Measurements read = parse_configurations(csv, joint_names(robot), behind);
    EXPECT_LT((read.joint_values - plan.joint_values).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_EQ(read.configurations, plan.configurations);
    EXPECT_EQ(read.targets, plan.targets);
    EXPECT_EQ(read.observations.size(), 10U);
    EXPECT_THAT(csv, ::testing::HasSubstr(behind == nullptr ? ",joint_1[deg]," : ",J1[deg],"));
    EXPECT_THAT(csv, ::testing::StartsWith("# one line\nconfiguration,target,"));
  }
}

TEST(MeasuringPlan, RefusesNamesThatNoFileCanHold) {
  const Robot robot = testing::fanuc();
  MeasuringPlan plan = plan_of(MatrixXd::Zero(6, 1));
  for (const std::string name : {"two\nlines", "", "\x1f"}) {
    plan.targets = {"A", name};
    EXPECT_THAT(testing::refusal([&] { plan_csv(plan, robot.joints); }),
                ::testing::HasSubstr("cannot stand in a plan"));
    plan.targets = {"A"};
    plan.configurations = {name};
    EXPECT_THAT(testing::refusal([&] { plan_csv(plan, robot.joints); }),
                ::testing::HasSubstr("cannot stand in a plan"));
    plan.configurations = {"1"};
  }
  plan.targets = {" "};
  EXPECT_THAT(plan_csv(plan, robot.joints), ::testing::HasSubstr("\n1,\" \",0,"));
}

}  // namespace
}  // namespace kdl_calibration::measuring_plan_test
