// The shipped robot, as it is read, and its two joint conventions against the data sheet and against the ROS-Industrial
// description.

#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"

namespace kdl_calibration::urdf_reading_test {
namespace {

using testing::difference;
using ::testing::ElementsAre;
using testing::fanuc;
using testing::kDegree;
using testing::kdl_pose;

JointConvention convention(const std::string& name) {
  return read_joint_convention(std::string(URDF_DIR) + "/fanuc_r2000ic_165f_" + name + ".json");
}

Eigen::VectorXd urdf_joints(const JointConvention& convention, const Eigen::VectorXd& controller) {
  return convention.matrix * controller + convention.offset;
}

Eigen::VectorXd six(const std::array<double, 6>& values) { return Eigen::Map<const Eigen::VectorXd>(values.data(), 6); }

/// Wrist centre [mm] at each J3 of its range, in steps of 0.02 degrees, J3 relative to the upper arm.
Eigen::Matrix3Xd wrist_centres(double j2) {
  const Robot robot = load_robot(std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf", {.base = "", .tip = "link_5"});
  const JointConvention serial = convention("serial");
  Eigen::Matrix3Xd centres(3, 312 * 50 + 1);
  for (Eigen::Index step = 0; step < centres.cols(); ++step) {
    const double j3 = -132.0 + static_cast<double>(step) / 50.0;
    const Eigen::VectorXd q = urdf_joints(serial, six({0, j2, j3, 0, 0, 0}) * kDegree);
    centres.col(step) = 1000.0 * to_eigen(kdl_pose(robot.chain, q.head(5)).p);
  }
  return centres;
}

TEST(FanucUrdf, HasTheLinksAndJointsByTheirNames) {
  const Robot robot = fanuc();
  EXPECT_EQ(robot.base, "base_link");
  EXPECT_EQ(robot.tip, "flange");
  EXPECT_EQ(robot.tip_joint, "joint_flange");
  EXPECT_THAT(joint_names(robot), ElementsAre("joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"));
  std::vector<std::string> links;
  for (const KDL::Segment& segment : robot.chain.segments) {
    links.push_back(segment.getName());
  }
  EXPECT_THAT(links, ElementsAre("link_1", "link_2", "link_3", "link_4", "link_5", "link_6", "flange"));
}

TEST(FanucUrdf, HasTheRangesAndSpeedsOfTheDataSheet) {
  const double lower[] = {-185, -60, -132, -360, -125, -360};
  const double upper[] = {185, 76, 180, 360, 125, 360};
  const double speed[] = {130, 115, 125, 180, 180, 260};
  const double sign[] = {1, -1, 1, -1, 1, -1};
  const Robot robot = fanuc();
  ASSERT_EQ(robot.joints.size(), 6U);
  for (std::size_t i = 0; i < 6; ++i) {
    const MovingJoint& joint = robot.joints[i];
    EXPECT_DOUBLE_EQ(joint.lower.value(), kDegree * std::min(sign[i] * lower[i], sign[i] * upper[i])) << joint.name;
    EXPECT_DOUBLE_EQ(joint.upper.value(), kDegree * std::max(sign[i] * lower[i], sign[i] * upper[i])) << joint.name;
    EXPECT_DOUBLE_EQ(joint.velocity.value(), kDegree * speed[i]) << joint.name;
  }
}

// The data sheet's reach is that of the wrist centre, where the axes of J4, J5 and J6 meet. "Level" and "upright" are
// said of the line from the axis of J3 to the wrist centre: its length is hypot(225, 1280) = 1299.6 mm.

TEST(FanucDataSheet, WristCentreReachesForwardUpAndBack) {
  EXPECT_NEAR(wrist_centres(76).row(1).maxCoeff(), 2654.7, 0.05);
  EXPECT_NEAR(wrist_centres(0).row(2).maxCoeff(), 3044.6, 0.05);
  EXPECT_NEAR(-wrist_centres(-60).row(1).minCoeff(), 1918.6, 0.05);
}

TEST(FanucConvention, SerialTurnsTheSignsOfJ2J4AndJ6AndPendantAddsJ2ToTheThirdJoint) {
  EXPECT_EQ(urdf_joints(convention("serial"), six({1, 2, 3, 4, 5, 6})), six({1, -2, 3, -4, 5, -6}));
  EXPECT_EQ(urdf_joints(convention("pendant"), six({1, 2, 3, 4, 5, 6})), six({1, -2, 5, -4, 5, -6}));
}

TEST(FanucConvention, PendantKeepsTheForearmLevelWhileJ2Moves) {
  const Robot robot = fanuc();
  const KDL::Rotation upright = kdl_pose(robot.chain, Eigen::VectorXd::Zero(6)).M;
  for (int j2 = -60; j2 <= 76; j2 += 8) {
    const Eigen::VectorXd controller = six({0, 1.0 * j2, 0, 0, 0, 0}) * kDegree;
    const KDL::Rotation flange = kdl_pose(robot.chain, urdf_joints(convention("pendant"), controller)).M;
    EXPECT_TRUE(KDL::Equal(flange, upright, 1e-14)) << "J2 = " << j2;
  }
}

TEST(FanucConvention, BothNameTheControllersAndTheUrdfsJoints) {
  for (const char* name : {"serial", "pendant"}) {
    EXPECT_THAT(convention(name).controller_joints, ElementsAre("J1", "J2", "J3", "J4", "J5", "J6")) << name;
    EXPECT_EQ(convention(name).urdf_joints, joint_names(fanuc())) << name;
  }
}

/// The ROS-Industrial description: arm along +x, joints with the controller's signs, J3 relative to the upper arm.
Robot ros_industrial() {
  return load_robot(std::string(SHARED_DATA_DIR) + "/ros_industrial/fanuc_r2000ic165f.urdf",
                    {.base = "base_link", .tip = "flange"});
}

TEST(FanucUrdfOnRealData, PutsTheFlangeWhereRosIndustrialPutsIt) {
  const Robot ours = fanuc();
  const Robot theirs = ros_industrial();
  // A quarter turn about z, without rounding: their x is our y.
  const KDL::Rotation turn(0, -1, 0, 1, 0, 0, 0, 0, 1);
  const JointConvention signs = convention("serial");
  Random random(2);
  const Eigen::MatrixXd controllers = random_configurations(limits_of(theirs.joints), 1000, random);
  for (const auto& controller : controllers.colwise()) {
    const KDL::Frame expected = kdl_pose(theirs.chain, controller);
    const KDL::Frame pose = kdl_pose(ours.chain, urdf_joints(signs, controller));
    ASSERT_LE(difference(pose, KDL::Frame(turn * expected.M * turn.Inverse(), turn * expected.p)), 1e-12);
  }
}

TEST(FanucUrdfOnRealData, HasTheLimitsOfRosIndustrial) {
  const Robot ours = fanuc();
  const Robot theirs = ros_industrial();
  const Eigen::VectorXd sign = convention("serial").matrix.diagonal();
  ASSERT_EQ(theirs.joints.size(), ours.joints.size());
  for (std::size_t i = 0; i < ours.joints.size(); ++i) {
    const bool same = sign[static_cast<Eigen::Index>(i)] > 0;
    EXPECT_EQ(ours.joints[i].lower.value(), same ? theirs.joints[i].lower.value() : -theirs.joints[i].upper.value());
    EXPECT_EQ(ours.joints[i].upper.value(), same ? theirs.joints[i].upper.value() : -theirs.joints[i].lower.value());
    EXPECT_EQ(ours.joints[i].velocity.value(), theirs.joints[i].velocity.value());
  }
}

}  // namespace
}  // namespace kdl_calibration::urdf_reading_test
