#include "kdl_calibration/measuring_plan.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <numeric>

#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/simulation.hpp"
#include "support.hpp"

namespace kdl_calibration {
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
    const MatrixXd q = random_configurations(limits_of(model), 7, random);
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

TEST(MeasuringPlan, IsMuchShorterThanChance) {
  const Robot robot = testing::fanuc();
  const ErrorModel model = complete_model(robot);
  Random random(3);
  const Eigen::VectorXd home = Eigen::VectorXd::Zero(6);
  const MatrixXd q = random_configurations(limits_of(model), 40, random);
  const MatrixXd ordered = q(Eigen::all, short_way(robot.joints, home, q));
  EXPECT_LT(way_time(robot.joints, home, ordered), 0.7 * way_time(robot.joints, home, q));
}

TEST(MeasuringPlan, TakesAsLongAsTheSlowestJoint) {
  const Robot robot = parse_robot(testing::kOddArm);  // 1 rad/s and 1 m/s; "skew" states nothing
  Eigen::VectorXd from = Eigen::VectorXd::Zero(5);
  Eigen::VectorXd to = from;
  to << 0.5, -0.25, 2.0, 1.0, 0.0;
  EXPECT_DOUBLE_EQ(travel_time(robot.joints, from, to), 2.0);
}

TEST(MeasuringPlan, ComesBackFromItsFile) {
  const Robot robot = testing::fanuc();
  const ErrorModel model = complete_model(robot);
  Random random(1);
  const MeasuringPlan plan = plan_of(random_configurations(limits_of(model), 5, random));
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

TEST(MeasuringPlan, ShowsThePendantsAngles) {
  const Robot robot = testing::fanuc();
  const JointConvention convention = pendant(robot);
  Eigen::VectorXd q(6);
  q << 10, 20, 30, 40, 50, 60;
  const std::string csv = plan_csv(plan_of(q * testing::kDegree), robot.joints, &convention);
  // J2 = -q2, J3 = q3 + q2, J4 = -q4, J6 = -q6
  EXPECT_THAT(csv, ::testing::HasSubstr("1,A,10,-20,50,-40,50,-60,,,\n"));
  EXPECT_THAT(csv, ::testing::HasSubstr("1,\"B, left\",10,-20,50,-40,50,-60,,,\n"));
}

TEST(MeasuringPlan, IsReadAsMeasurementsOnceItIsFilledIn) {
  const Robot robot = testing::fanuc();
  std::string csv = plan_csv(plan_of(MatrixXd::Constant(6, 1, 0.25)), robot.joints);
  try {
    parse_measurements(csv, joint_names(robot), nullptr, "plan.csv");
    FAIL() << "read coordinates that are not there";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("plan.csv:3: x[m]"));
  }
  for (std::size_t at = csv.find(",,,"); at != std::string::npos; at = csv.find(",,,", at)) {
    csv.replace(at, 3, ",1,2,3");
  }
  const Measurements read = parse_measurements(csv, joint_names(robot));
  EXPECT_EQ(read.observations.at(1).position, Eigen::Vector3d(1, 2, 3));
}

TEST(MeasuringPlan, ReadsConfigurationsOfHalfMeasuredFiles) {
  const std::string csv =
      "x[mm];z[mm];y[mm];j;configuration;target\n# nothing yet\n;;;1;1;A\n1;2;3;0.5;2;A\n 4;\t;;0.75;3;A\n";
  const Measurements read = parse_configurations(csv, {"j"});
  EXPECT_EQ(read.joint_values, (MatrixXd(1, 3) << 1, 0.5, 0.75).finished());
  EXPECT_THROW(parse_configurations("x[m],y[m],z[m],j,configuration,target\n,,,,1,A\n", {"j"}), InputError);
  EXPECT_THROW(read_configurations("/no/such/plan.csv", {"j"}), InputError);
}

TEST(MeasuringPlan, RefusesNamesThatNoFileCanHold) {
  const Robot robot = testing::fanuc();
  MeasuringPlan plan = plan_of(MatrixXd::Zero(6, 1));
  plan.targets = {"two\nlines"};
  EXPECT_THROW(plan_csv(plan, robot.joints), InputError);
}

}  // namespace
}  // namespace kdl_calibration
