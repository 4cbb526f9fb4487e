#include "programs/parallel_arm.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/random.hpp"
#include "programs/compensation_support.hpp"
#include "robot/joint_ranges.hpp"
#include "robot/ur_calibration.hpp"
#include "robot/urdf_correction.hpp"
#include "support.hpp"
#include "ur10.hpp"

namespace kdl_calibration::parallel_arm_test {
namespace {

using Eigen::Isometry3d;
using ::testing::AnyOf;
using testing::by_kdl;

constexpr double kTurn = 2.0 * std::numbers::pi;

Robot ur10() { return parse_robot(testing::kUr10, {.base = "base_link", .tip = "tool0"}); }

double difference(const SixJoints& a, const SixJoints& b) {
  return (a - b).unaryExpr([](double x) { return std::abs(std::remainder(x, kTurn)); }).maxCoeff();
}

double distance(const Isometry3d& a, const Isometry3d& b) { return (a.matrix() - b.matrix()).cwiseAbs().maxCoeff(); }

Eigen::MatrixXd drawn(const Robot& robot, int count) {
  Random random(5);
  return random_configurations(limits_of(robot.joints), count, random);
}

// By KDL: each reaches the pose, they are all different, and the drawn one is there.
TEST(ParallelArm, FindsEverySolutionOfAPose) {
  const Robot robot = ur10();
  const std::optional<ParallelArm> arm = ParallelArm::of(robot);
  ASSERT_TRUE(arm);
  int of_eight = 0;
  const Eigen::MatrixXd configurations = drawn(robot, 500);
  for (const auto& q : configurations.colwise()) {
    const Isometry3d X_BF = by_kdl(robot.chain, q);
    const ArmSolutions found = arm->solve(X_BF);
    EXPECT_FALSE(found.singular);
    double nearest = 10.0;
    for (std::size_t i = 0; i < found.joint_values.size(); ++i) {
      const SixJoints& solution = found.joint_values[i];
      EXPECT_LE(solution.cwiseAbs().maxCoeff(), std::numbers::pi + 1e-12);
      EXPECT_LT(distance(by_kdl(robot.chain, solution), X_BF), 1e-7);
      nearest = std::min(nearest, difference(solution, q));
      for (std::size_t k = 0; k < i; ++k) {
        EXPECT_GT(difference(solution, found.joint_values[k]), 1e-4);
      }
    }
    EXPECT_LT(nearest, 1e-6);
    EXPECT_THAT(found.joint_values.size(), AnyOf(2U, 4U, 6U, 8U));
    of_eight += found.joint_values.size() == 8 ? 1 : 0;
  }
  EXPECT_GT(of_eight, 200);
}

// Its own calibration tilts the axes by some milliradians and moves their origins by up to 90 m along them. The
// solutions are seeds then, but for poses next to singularities.
TEST(ParallelArm, IsNearTheSolutionsOfACalibratedArm) {
  const Robot nominal = ur10();
  const Robot robot =
      parse_robot(corrected_urdf(nominal.urdf, ur_corrections(nominal, testing::kUrCalibration, "calibration.conf")),
                  {.base = "base_link", .tip = "tool0"});
  const std::optional<ParallelArm> arm = ParallelArm::of(robot);
  ASSERT_TRUE(arm);
  const Compensator exact(testing::bent(robot, 0.0, 1));
  int found = 0;
  const Eigen::MatrixXd configurations = drawn(robot, 200);
  for (const auto& q : configurations.colwise()) {
    const Isometry3d X_BF = by_kdl(robot.chain, q);
    const ArmSolutions seeds = arm->solve(X_BF);
    found += std::any_of(seeds.joint_values.begin(), seeds.joint_values.end(),
                         [&](const SixJoints& seed) {
                           const CompensatedPoint point = exact.solve(X_BF, seed);
                           return difference(point.joint_values, q) < 1e-6;
                         })
                 ? 1
                 : 0;
  }
  EXPECT_GT(found, 180);
}

TEST(ParallelArm, SaysWherePosesHaveNoSolutionOrTooMany) {
  const Robot robot = ur10();
  const std::optional<ParallelArm> arm = ParallelArm::of(robot);
  const Isometry3d straight = by_kdl(robot.chain, Eigen::VectorXd{{0.3, -1.2, 1.4, -1.0, 0.0, 0.2}});
  EXPECT_TRUE(arm->solve(straight).singular);
  const ArmSolutions away = arm->solve(Isometry3d(Eigen::Translation3d(3.0, 0.0, 0.5)));
  EXPECT_TRUE(away.joint_values.empty());
  EXPECT_FALSE(away.singular);
}

TEST(ParallelArm, IsAnArmOfUniversalRobotsAlone) {
  EXPECT_FALSE(ParallelArm::of(testing::fanuc()));
  EXPECT_FALSE(ParallelArm::of(parse_robot(R"(<robot name="r"><link name="a"/><link name="b"/>
    <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>)")));
}

}  // namespace
}  // namespace kdl_calibration::parallel_arm_test
