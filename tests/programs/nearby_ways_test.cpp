#include "programs/nearby_ways.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <numbers>

#include "programs/compensation_support.hpp"
#include "support.hpp"
#include "ur10.hpp"

namespace kdl_calibration::nearby_ways_test {
namespace {

using Eigen::Isometry3d;
using testing::by_kdl;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kPi = std::numbers::pi;

SixJoints six(double a, double b, double c, double d, double e, double f) {
  return (SixJoints() << a, b, c, d, e, f).finished();
}

Robot ur10() { return parse_robot(testing::kUr10, {.base = "base_link", .tip = "tool0"}); }

const SixJoints kAsked = six(0.4, -1.3, 1.7, -1.9, -1.5, 0.3);

TEST(NearbyWays, ComeInTheOrderOfTheirDistances) {
  const Robot robot = ur10();
  const NearbyWays ways(robot);
  ASSERT_TRUE(ways.are_known());
  const Isometry3d X_BF = by_kdl(robot.chain, kAsked);
  const SixJoints near = kAsked + SixJoints::Constant(0.02);
  const std::vector<SixJoints> all = ways.all(X_BF, near);
  ASSERT_THAT(all, SizeIs(8 * 7));  // eight solutions, each also with one of six joints a turn further
  EXPECT_LT((all.front() - kAsked).norm(), 1e-6);
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_LT((by_kdl(robot.chain, all[i]).matrix() - X_BF.matrix()).cwiseAbs().maxCoeff(), 1e-7);
    EXPECT_LE(i == 0 ? 0.0 : (all[i - 1] - near).norm(), (all[i] - near).norm());
  }
  EXPECT_THAT(other_ways(ways.all(X_BF, near), near, kAsked, 2.0), IsEmpty());
}

// Half a turn of joint 6 away, the next turn is as near: pi + 0.1 against pi - 0.1.
TEST(NearbyWays, AreAboutAsNearWithinTwiceTheDistance) {
  const Robot robot = ur10();
  const NearbyWays ways(robot);
  SixJoints near = kAsked;
  near[5] -= kPi - 0.1;
  const Isometry3d X_BF = by_kdl(robot.chain, kAsked);
  const std::vector<SixJoints> others = other_ways(ways.all(X_BF, near), near, kAsked, 2.0);
  ASSERT_FALSE(others.empty());
  SixJoints further = kAsked;
  further[5] -= 2.0 * kPi;
  EXPECT_LT((others.front() - further).norm(), 1e-6);
  for (const SixJoints& each : others) {
    EXPECT_GT((each - kAsked).norm(), 0.05);
    EXPECT_LE((each - near).norm(), 2.0 * (kAsked - near).norm());
  }
  EXPECT_THAT(other_ways(ways.all(X_BF, near), near, kAsked, 1.0), IsEmpty());
}

TEST(NearbyWays, StayWithinTheLimits) {
  Robot robot = testing::fanuc();
  const SixJoints q = six(0.1, -0.2, 0.3, 0.4, 0.5, 0.6);
  const Isometry3d X_BF = by_kdl(robot.chain, q);
  const auto all = [&] { return NearbyWays(robot).all(X_BF, q); };
  const std::size_t before = all().size();
  ASSERT_GT(before, 2U);
  robot.joints[4].lower = 0.0;  // one wrist is left
  for (const SixJoints& each : all()) {
    EXPECT_GE(each[4], 0.0);
  }
  EXPECT_LT(all().size(), before);
}

// What the commands for both elbows differ by, from the library for each.
TEST(NearbyWays, TellHowFarTheirCommandsAre) {
  const Robot robot = ur10();
  const Compensator compensator(testing::bent(robot, 1e-3, 8));
  const Isometry3d X_BF = by_kdl(robot.chain, kAsked);
  const CompensatedPoint taken = compensator.solve(kAsked);
  double expected = 0.0;
  std::vector<CompensatedJoints> others;
  for (const SixJoints& q : NearbyWays(robot).all(X_BF, kAsked)) {
    others.emplace_back(q);
    const CompensatedPoint point = compensator.solve(q);
    expected = std::max(expected, (by_kdl(robot.chain, point.joint_values).translation() -
                                   by_kdl(robot.chain, taken.joint_values).translation())
                                      .norm());
  }
  EXPECT_GT(expected, 1e-3);
  EXPECT_NEAR(spread_of_commands(compensator, X_BF, taken, others), expected, 1e-8);
  EXPECT_EQ(spread_of_commands(compensator, X_BF, taken, {}), 0.0);
}

}  // namespace
}  // namespace kdl_calibration::nearby_ways_test
