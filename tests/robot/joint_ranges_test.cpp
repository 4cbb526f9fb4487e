#include "robot/joint_ranges.hpp"

#include <gtest/gtest.h>

#include <numbers>

#include "base/random.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::joint_ranges_test {
namespace {

constexpr double kPi = std::numbers::pi;

std::vector<MovingJoint> joints_of(const std::vector<JointType>& types) {
  std::vector<MovingJoint> joints(types.size());
  for (std::size_t i = 0; i < types.size(); ++i) {
    joints[i].type = types[i];
  }
  return joints;
}

TEST(JointRanges, AreTheLimitsAndATurnOrAMetreEachWayWhereThereAreNone) {
  std::vector<MovingJoint> joints =
      joints_of({JointType::revolute, JointType::continuous, JointType::prismatic, JointType::prismatic});
  joints[0].lower = -1.5;
  joints[3].upper = 4.0;
  const JointRanges expected = {{-1.5, kPi}, {-kPi, kPi}, {-1.0, 1.0}, {-1.0, 4.0}};
  EXPECT_EQ(limits_of(joints), expected);
}

TEST(JointRanges, OfThePublicationAreHalfATurnForTheFirstFourIndependentJoints) {
  std::vector<MovingJoint> joints = joints_of(std::vector<JointType>(7, JointType::revolute));
  joints[1].mimic = Mimic{.leader = 0};
  const std::pair<double, double> half = {-kPi / 2.0, kPi / 2.0};
  const std::pair<double, double> whole = {-kPi, kPi};
  EXPECT_EQ(published_ranges(joints), (JointRanges{half, whole, half, half, half, whole, whole}));
  EXPECT_EQ(published_ranges({joints[0], joints[2]}), (JointRanges{half, half}));
}

TEST(RandomConfigurations, AreDrawnJointByJointWithinTheirRanges) {
  const JointRanges ranges = {{-1.0, 2.0}, {5.0, 6.0}, {-30.0, -20.0}};
  Random random(3);
  const Eigen::MatrixXd drawn = random_configurations(ranges, 40, random);
  Random again(3);
  for (Eigen::Index c = 0; c < 40; ++c) {
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      const double value = drawn(static_cast<Eigen::Index>(i), c);
      EXPECT_EQ(value, again.uniform(ranges[i].first, ranges[i].second)) << c << " " << i;
    }
  }
  EXPECT_EQ(random_configurations(ranges, 0, random).cols(), 0);
}

}  // namespace
}  // namespace kdl_calibration::joint_ranges_test
