#include "robot/chain_to_dh.hpp"

#include <fmt/core.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/number_text.hpp"
#include "refusal.hpp"
#include "results/calibrated_urdf.hpp"
#include "support.hpp"
#include "ur10.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::chain_to_dh_test {
namespace {

using testing::urdf::JointAt;

Robot arm_of(const std::vector<JointAt>& joints) {
  return parse_robot(testing::urdf::serial_of(joints, "continuous", "-1:1"));
}

/// n joints anywhere, skew to each other; every third one slides where `sliding`.
Robot random_arm(int n, bool sliding, std::uint64_t seed) {
  Random random(seed);
  const auto three = [&](double size) {
    return fmt::format("{} {} {}", random.uniform(-size, size), random.uniform(-size, size),
                       random.uniform(-size, size));
  };
  std::vector<JointAt> joints;
  for (int i = 0; i < n; ++i) {
    joints.push_back({three(1.0), three(3.0), three(1.0), sliding && i % 3 == 1 ? "prismatic" : ""});
  }
  joints.push_back({three(0.5), three(3.0), "0 0 1", "fixed"});
  return arm_of(joints);
}

/// Two axes so far from parallel [rad], beside others.
Robot nearly_parallel(double angle) {
  const std::string tilt = shortest(0.6 * angle) + " " + shortest(0.8 * angle) + " 0.3";
  return arm_of({{"0 0 0.6"},
                 {"0.3 0 0", "1.5707963267948966 0 0"},
                 {"1.1 0.05 0.2", tilt},
                 {"0.9 0 -0.1", tilt},
                 {"0.1 0 0", "0 1.5 0"},
                 {"0 0 0.2", "0 0 0", "0 0 1", "fixed"}});
}

void expect_the_same_arm(const Robot& robot, const std::string& name) {
  for (const DhConvention convention : {DhConvention::standard, DhConvention::modified}) {
    const std::string text = dh_json(dh_table_of(robot, convention));
    const Robot again = parse_robot(dh_urdf(parse_dh_table(text)));
    const PoseDifference difference = largest_difference(robot, again);
    EXPECT_LT(difference.position, 1e-12) << name << text;
    EXPECT_LT(difference.rotation, 1e-12) << name << text;
    const ErrorModel model = complete_model(robot);
    Random random(5);
    for (int i = 0; i < 20; ++i) {
      const Eigen::VectorXd q = testing::random_joints(model, random);
      EXPECT_LT(testing::difference(testing::kdl_pose(robot.chain, q), testing::kdl_pose(again.chain, q)), 2e-12)
          << name << text;
    }
    EXPECT_EQ(joint_names(again), joint_names(robot));
    for (const DhRow& row : parse_dh_table(text).rows) {
      EXPECT_LT(std::max(std::abs(row.a), std::abs(row.d)), 30.0) << name << text;
    }
  }
}

TEST(ChainToDh, IsTheSameArm) {
  expect_the_same_arm(testing::fanuc(), "FANUC");
  expect_the_same_arm(parse_robot(testing::kOddArm), "odd arm");
  for (const bool sliding : {false, true}) {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      expect_the_same_arm(random_arm(7, sliding, seed), "random arm " + std::to_string(seed));
    }
  }
  for (const double angle : {0.3, 0.11, 0.09, 1e-2, 1e-3, 1e-5, 1e-8, 1e-12, 1e-15, 0.0}) {
    expect_the_same_arm(nearly_parallel(angle), "tilted by " + shortest(angle));
  }
  expect_the_same_arm(arm_of({{"0 0 0"}}), "one joint");
  expect_the_same_arm(arm_of({{"0 0 1"}, {"0 0 1"}, {"0 0 0.5", "3.141592653589793 0 0"}, {"1e-6 0 0"}}),
                      "joints on one axis, and one against it");
  expect_the_same_arm(arm_of({{"0 0 0", "0 0 0", "1 0 0", "prismatic"},
                              {"0 0 0", "0 0 0", "0 1 0", "prismatic"},
                              {"0 0 0.4", "0 0 0", "0 0 -1", "prismatic"},
                              {"0.1 0 0", "0 0 0", "0 0 1", "prismatic"},
                              {"0 0.2 0"}}),
                      "gantry");
}

TEST(ChainToDh, FindsThePublishedTableAgain) {
  const std::string ur5 =
      "convention,standard\njoint,a[m],alpha[rad],d[m],theta[rad]\n"
      "1,0,1.5707963267948966,0.089159,0\n2,-0.425,0,0,0\n3,-0.39225,0,0,0\n"
      "4,0,1.5707963267948966,0.10915,0\n5,0,-1.5707963267948966,0.09465,0\n6,0,0,0.0823,0\n";
  const std::string puma =
      "convention,modified\njoint,a[m],alpha[rad],d[m],theta[rad]\n"
      "1,0,0,0.67,0\n2,0,-1.5707963267948966,0,0\n3,0.4318,0,0,0.5\n"
      "4,0.0203,-1.5707963267948966,0.4318,0\n5,0,1.5707963267948966,0,0\n"
      "6,0,-1.5707963267948966,0,0\n";
  for (const std::string& text : {ur5, puma}) {
    const DhTable expected = parse_dh_table(text);
    const DhTable found = dh_table_of(parse_robot(dh_urdf(expected)), expected.convention);
    for (std::size_t i = 0; i < expected.rows.size(); ++i) {
      for (const auto value : {&DhRow::a, &DhRow::alpha, &DhRow::beta, &DhRow::d, &DhRow::theta}) {
        EXPECT_NEAR(found.rows[i].*value, expected.rows[i].*value, 1e-14) << text << i;
      }
    }
    EXPECT_LT(testing::difference(found.tip, expected.tip), 1e-14);
    if (expected.convention == DhConvention::standard) {
      EXPECT_LT(testing::difference(found.base, expected.base), 1e-14);
    }
  }
}

// Its closed form has d1, a2, a3, d4, d5, d6 and joint offsets.
TEST(ChainToDh, OfAUrThatKeptItsAnglesHasTheZerosOfItsClosedForm) {
  const Robot robot = parse_robot(testing::kUr10);
  const ErrorModel model = complete_model(robot, KeptAxes::angles);
  Random random(3);
  const Eigen::VectorXd errors = testing::random_errors(model, random, 0.005, 0.02);
  const DhTable table = dh_table_of(parse_robot(calibrated_urdf(robot, model, errors)), DhConvention::standard);
  for (const std::size_t i : {0U, 3U, 4U}) {
    EXPECT_NEAR(table.rows[i].a, 0.0, 1e-10) << i;
    EXPECT_NEAR(std::abs(table.rows[i].alpha), std::numbers::pi / 2, 1e-9) << i;
  }
  for (const std::size_t i : {1U, 2U}) {
    EXPECT_NEAR(table.rows[i].alpha, 0.0, 1e-12) << i;
    EXPECT_NEAR(table.rows[i].beta, 0.0, 1e-12) << i;
    EXPECT_EQ(table.rows[i].d, 0.0) << i;
  }
}

TEST(ChainToDh, RefusesMimicJoints) {
  const std::string urdf = testing::urdf::serial({{"continuous", ""}, {"continuous", "<mimic joint='j1'/>"}});
  EXPECT_REFUSED("joint 'j2' mimics another one, which a DH table cannot state",
                 dh_table_of(parse_robot(urdf), DhConvention::standard));
}

}  // namespace
}  // namespace kdl_calibration::chain_to_dh_test
