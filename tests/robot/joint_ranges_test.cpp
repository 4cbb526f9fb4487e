#include "robot/joint_ranges.hpp"

#include <gtest/gtest.h>

#include <cmath>
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

// Mean, standard deviation and correlation of uniform numbers that are independent.
TEST(RandomConfigurations, AreUniformWithinTheirRangesAndIndependentOfEachOther) {
  const JointRanges ranges = {{-1.0, 2.0}, {5.0, 6.0}, {-30.0, -20.0}};
  Random random(3);
  Eigen::MatrixXd drawn = random_configurations(ranges, 20000, random);
  for (Eigen::Index i = 0; i < 3; ++i) {
    const auto [lower, upper] = ranges[static_cast<std::size_t>(i)];
    EXPECT_GE(drawn.row(i).minCoeff(), lower);
    EXPECT_LE(drawn.row(i).maxCoeff(), upper);
    drawn.row(i) = (drawn.row(i).array() - 0.5 * (lower + upper)) * std::sqrt(12.0) / (upper - lower);
  }
  EXPECT_LT(drawn.rowwise().mean().norm(), 0.03);
  EXPECT_LT((drawn * drawn.transpose() / 20000.0 - Eigen::Matrix3d::Identity()).norm(), 0.05);
  EXPECT_LT((drawn.leftCols(19999) * drawn.rightCols(19999).transpose() / 19999.0).norm(), 0.05);
  EXPECT_EQ(random_configurations(ranges, 0, random).cols(), 0);
}

}  // namespace
}  // namespace kdl_calibration::joint_ranges_test
