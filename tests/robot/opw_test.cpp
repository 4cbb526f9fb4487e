#include "robot/opw.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <numbers>

#include "refusal.hpp"
#include "results/calibrated_urdf.hpp"
#include "support.hpp"
#include "ur10.hpp"

namespace kdl_calibration::opw_test {
namespace {

using ::testing::HasSubstr;
using testing::kdl_pose;

// The tip of the publication, Brandstoetter, Angerer and Hofbaur 2014, equations of the direct kinematics.
Eigen::Isometry3d published_pose(const OpwParameters& p, const Eigen::VectorXd& q) {
  std::array<double, 6> t{};
  std::array<double, 6> s{};
  std::array<double, 6> c{};
  for (std::size_t i = 0; i < t.size(); ++i) {
    t[i] = p.signs[i] * q[static_cast<Eigen::Index>(i)] - p.offsets[i];
    s[i] = std::sin(t[i]);
    c[i] = std::cos(t[i]);
  }
  const double psi = std::atan2(p.a2, p.c3);
  const double k = std::hypot(p.a2, p.c3);
  const double x = p.c2 * s[1] + k * std::sin(t[1] + t[2] + psi) + p.a1;
  const double z = p.c2 * c[1] + k * std::cos(t[1] + t[2] + psi);
  Eigen::Matrix3d R_0c;
  R_0c << c[0] * c[1] * c[2] - c[0] * s[1] * s[2], -s[0], c[0] * c[1] * s[2] + c[0] * s[1] * c[2],  //
      s[0] * c[1] * c[2] - s[0] * s[1] * s[2], c[0], s[0] * c[1] * s[2] + s[0] * s[1] * c[2],       //
      -s[1] * c[2] - c[1] * s[2], 0.0, -s[1] * s[2] + c[1] * c[2];
  Eigen::Matrix3d R_ce;
  R_ce << c[3] * c[4] * c[5] - s[3] * s[5], -c[3] * c[4] * s[5] - s[3] * c[5], c[3] * s[4],  //
      s[3] * c[4] * c[5] + c[3] * s[5], -s[3] * c[4] * s[5] + c[3] * c[5], s[3] * s[4],      //
      -s[4] * c[5], s[4] * s[5], c[4];
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = R_0c * R_ce;
  pose.translation() = Eigen::Vector3d(x * c[0] - p.b * s[0], x * s[0] + p.b * c[0], z + p.c1) +
                       p.c4 * pose.linear() * Eigen::Vector3d::UnitZ();
  return to_eigen(p.base) * pose * to_eigen(p.tip);
}

void expect_published(const Robot& robot) {
  const OpwParameters found = opw_parameters_of(robot);
  Random random(1);
  const ErrorModel model = complete_model(robot);
  for (int i = 0; i < 100; ++i) {
    const Eigen::VectorXd q = testing::random_joints(model, random);
    ASSERT_LT(testing::difference(to_kdl(published_pose(found, q)), kdl_pose(robot.chain, q)), 1e-12);
  }
}

auto are(const std::vector<double>& numbers) { return ::testing::Pointwise(::testing::DoubleNear(1e-12), numbers); }

// The nominal robot with errors of these names.
Robot with_errors(const Robot& robot, const std::map<std::string, double>& errors, KeptAxes kept = KeptAxes::none) {
  const ErrorModel model = complete_model(robot, kept);
  return parse_robot(calibrated_urdf(robot, model, testing::errors_of(model, errors)));
}

TEST(Opw, OfTheR2000iCAreTheLengthsOfItsDataSheet) {
  const Robot robot = testing::fanuc();
  const OpwParameters found = opw_parameters_of(robot);
  EXPECT_NEAR(found.a1, 0.312, 1e-15);
  EXPECT_NEAR(found.a2, -0.225, 1e-15);
  EXPECT_NEAR(found.b, 0.0, 1e-15);
  EXPECT_NEAR(found.c1, 0.670, 1e-15);
  EXPECT_NEAR(found.c2, 1.075, 1e-15);
  EXPECT_NEAR(found.c3, 1.280, 1e-15);
  EXPECT_NEAR(found.c4, 0.215, 1e-15);
  expect_published(robot);
}

TEST(Opw, GiveThePublishedPoseOfCalibratedRobots) {
  const Robot robot = testing::fanuc();
  Random random(2);
  for (int i = 0; i < 20; ++i) {
    const ErrorModel model = complete_model(robot, KeptAxes::angles);
    const Eigen::VectorXd errors = testing::random_errors(model, random, 0.02, 0.1);
    expect_published(parse_robot(calibrated_urdf(robot, model, errors)));
  }
}

// The robot of the plugin's documentation, whose axes have all signs: a KUKA KR 6 R700 of ROS-Industrial.
TEST(Opw, OfAKukaAreThoseThatItsPluginForMoveItDocuments) {
  const auto joint = [](int i, const std::string& xyz, const std::string& axis) {
    return "<joint name='joint_a" + std::to_string(i) + "' type='continuous'><parent link='l" + std::to_string(i - 1) +
           "'/><child link='l" + std::to_string(i) + "'/><origin xyz='" + xyz + "'/><axis xyz='" + axis + "'/></joint>";
  };
  std::string links;
  for (int i = 0; i < 8; ++i) {
    links += "<link name='l" + std::to_string(i) + "'/>";
  }
  const Robot robot =
      parse_robot("<robot name='kuka'>" + links + joint(1, "0 0 0.4", "0 0 -1") + joint(2, "0.025 0 0", "0 1 0") +
                  joint(3, "0.315 0 0", "0 1 0") + joint(4, "0 0 0.035", "-1 0 0") + joint(5, "0.365 0 0", "0 1 0") +
                  joint(6, "0.08 0 0", "-1 0 0") +
                  "<joint name='tool' type='fixed'><parent link='l6'/><child link='l7'/>"
                  "<origin rpy='0 1.57079632679489661923 0'/></joint></robot>");
  const OpwParameters found = opw_parameters_of(robot);
  const std::vector<double> lengths = {found.a1, found.a2, found.b, found.c1, found.c2, found.c3, found.c4};
  EXPECT_THAT(lengths, are({0.025, -0.035, 0, 0.4, 0.315, 0.365, 0.08}));
  EXPECT_THAT(found.offsets, are({0, -std::numbers::pi / 2, 0, 0, 0, 0}));
  EXPECT_THAT(found.signs, ::testing::ElementsAre(-1, 1, 1, -1, 1, -1));
  EXPECT_TRUE(KDL::Equal(found.base, KDL::Frame::Identity(), 1e-12));
  EXPECT_TRUE(KDL::Equal(found.tip, KDL::Frame::Identity(), 1e-12));
  expect_published(robot);
}

TEST(Opw, AreRefusedForArmsOutsideOfTheFamily) {
  const Robot robot = testing::fanuc();
  EXPECT_REFUSED_WITH(
      ::testing::AllOf(HasSubstr("joint_3 and joint_4 are 0.001 rad from a right angle"), HasSubstr("keep_axes")),
      opw_parameters_of(with_errors(robot, {{"Rz3", 0.001}}, KeptAxes::closed_form)));
  EXPECT_REFUSED("joint_2 and joint_3 are 0.002 rad from parallel",
                 opw_parameters_of(with_errors(robot, {{"Rz2", 0.002}})));
  EXPECT_REFUSED("joint_6 misses the wrist's point by 0.3 mm", opw_parameters_of(with_errors(robot, {{"Tz5", 3e-4}})));
  EXPECT_REFUSED("no arm of OPW kinematics", opw_parameters_of(parse_robot(testing::kUr10)));
  EXPECT_REFUSED("six revolute joints", opw_parameters_of(parse_robot(testing::kOddArm)));
}

}  // namespace
}  // namespace kdl_calibration::opw_test
