#include "robot/ur_calibration.hpp"

#include <gmock/gmock.h>

#include <array>
#include <regex>

#include "refusal.hpp"
#include "support.hpp"
#include "ur10.hpp"

namespace kdl_calibration::ur_calibration_test {
namespace {

using ::testing::HasSubstr;
using Matrix = Eigen::Matrix<long double, 4, 4>;
using SixValues = std::array<long double, 6>;

/// The list of this name in a calibration.conf, read in another way than the library does.
SixValues list_of(const std::string& text, const std::string& key) {
  std::smatch list;
  EXPECT_TRUE(std::regex_search(text, list, std::regex(key + R"(\s*=\s*\[([^\]]*)\])")));
  std::istringstream numbers(std::regex_replace(list[1].str(), std::regex(","), " "));
  SixValues values{};
  for (long double& value : values) {
    numbers >> value;
  }
  return values;
}

/// Nominal table of the UR10 as its controller holds it, plus the lists; equation of Denavit and Hartenberg.
Matrix sum_of_tables(const std::string& calibration, const Eigen::VectorXd& q) {
  constexpr long double kRight = 1.570796327L;
  const SixValues a = {0, -0.612L, -0.5723L, 0, 0, 0};
  const SixValues d = {0.1273L, 0, 0, 0.163941L, 0.1157L, 0.0922L};
  const SixValues alpha = {kRight, 0, 0, kRight, -kRight, 0};
  const SixValues da = list_of(calibration, "delta_a");
  const SixValues dd = list_of(calibration, "delta_d");
  const SixValues dalpha = list_of(calibration, "delta_alpha");
  const SixValues dtheta = list_of(calibration, "delta_theta");
  Matrix product = Matrix::Identity();
  product.topLeftCorner<2, 2>() *= -1;  // base_link is turned by 180 degrees from the controller's base
  for (std::size_t i = 0; i < 6; ++i) {
    const long double theta = static_cast<long double>(q[static_cast<Eigen::Index>(i)]) + dtheta[i];
    const long double c = std::cos(theta);
    const long double s = std::sin(theta);
    const long double ca = std::cos(alpha[i] + dalpha[i]);
    const long double sa = std::sin(alpha[i] + dalpha[i]);
    const long double r = a[i] + da[i];
    Matrix A;
    A << c, -s * ca, s * sa, r * c, s, c * ca, -c * sa, r * s, 0, sa, ca, d[i] + dd[i], 0, 0, 0, 1;
    product = product * A;
  }
  return product;
}

Robot calibrated(const Robot& robot, const std::string& calibration) {
  return parse_robot(corrected_urdf(robot.urdf, ur_corrections(robot, calibration, "calibration.conf")));
}

std::string zeros() {
  return std::regex_replace(std::string(kdl_calibration::testing::kUrCalibration), std::regex(R"((\[)[^\]]*\])"),
                            "[0, 0, 0, 0, 0, 0]");
}

void expect_the_sum(const Robot& robot, const std::string& calibration) {
  const Robot found = calibrated(robot, calibration);
  Random random(4);
  for (int i = 0; i < 50; ++i) {
    const Eigen::VectorXd q = testing::random_joints(complete_model(robot), random);
    const Eigen::Matrix4d pose = to_eigen(testing::kdl_pose(found.chain, q)).matrix();
    EXPECT_LT((pose.cast<long double>() - sum_of_tables(calibration, q)).cwiseAbs().maxCoeff(), 1e-12L);
  }
}

TEST(UrCalibration, IsTheSumOfTheTables) {
  const Robot robot = parse_robot(testing::kUr10);
  expect_the_sum(robot, testing::kUrCalibration);
  expect_the_sum(robot, zeros());
}

// The origins lie within 5 mm and 0.01 rad of the nominal ones, although the file has d up to 92 m.
TEST(UrCalibration, LeavesTheLinksWhereTheyAreSeen) {
  const Robot robot = parse_robot(testing::kUr10);
  const std::vector<OriginCorrection> corrections = ur_corrections(robot, testing::kUrCalibration, "c");
  ASSERT_EQ(corrections.size(), 7U);
  for (const OriginCorrection& correction : corrections) {
    EXPECT_LT(correction.correction.p.Norm(), 0.005) << correction.joint;
    EXPECT_LT((correction.correction.M.UnitX() - KDL::Vector(1, 0, 0)).Norm(), 0.01) << correction.joint;
  }
}

// The first description for ROS has its joint frames elsewhere: turned, and aside of the axes of the table.
TEST(UrCalibration, TakesOtherFramesOfTheSameAxes) {
  constexpr const char* kFirst = R"(<robot name="ur10"><link name="base_link"/><link name="l1"/><link name="l2"/>
    <link name="l3"/><link name="l4"/><link name="l5"/><link name="l6"/><link name="tool0"/>
    <joint name="left_shoulder_pan_joint" type="continuous"><parent link="base_link"/><child link="l1"/>
      <origin xyz="0 0 0.1273"/><axis xyz="0 0 1"/></joint>
    <joint name="left_shoulder_lift_joint" type="continuous"><parent link="l1"/><child link="l2"/>
      <origin xyz="0 0.220941 0" rpy="0 1.570796325 0"/><axis xyz="0 1 0"/></joint>
    <joint name="left_elbow_joint" type="continuous"><parent link="l2"/><child link="l3"/>
      <origin xyz="0 -0.1719 0.612"/><axis xyz="0 1 0"/></joint>
    <joint name="left_wrist_1_joint" type="continuous"><parent link="l3"/><child link="l4"/>
      <origin xyz="0 0 0.5723" rpy="0 1.570796325 0"/><axis xyz="0 1 0"/></joint>
    <joint name="left_wrist_2_joint" type="continuous"><parent link="l4"/><child link="l5"/>
      <origin xyz="0 0.1149 0"/><axis xyz="0 0 1"/></joint>
    <joint name="left_wrist_3_joint" type="continuous"><parent link="l5"/><child link="l6"/>
      <origin xyz="0 0 0.1157"/><axis xyz="0 1 0"/></joint>
    <joint name="tool" type="fixed"><parent link="l6"/><child link="tool0"/>
      <origin xyz="0 0.0922 0" rpy="-1.570796325 0 0"/></joint></robot>)";
  const Robot robot = parse_robot(kFirst);
  const Robot found = calibrated(robot, testing::kUrCalibration);
  Random random(4);
  for (int i = 0; i < 20; ++i) {  // its angles have nine digits
    const Eigen::VectorXd q = testing::random_joints(complete_model(robot), random);
    const Eigen::Matrix4d pose = to_eigen(testing::kdl_pose(found.chain, q)).matrix();
    EXPECT_LT((pose.cast<long double>() - sum_of_tables(testing::kUrCalibration, q)).cwiseAbs().maxCoeff(), 2e-8L);
  }
}

std::string frame_of(const std::string& link, const std::string& numbers) {
  std::istringstream values(numbers);
  std::string text = "  " + link + ":\n";
  for (const char* key : {"x", "y", "z", "roll", "pitch", "yaw"}) {
    std::string value;
    values >> value;
    text += std::string("    ") + key + ": " + value + "\n";
  }
  return text;
}

/// Frames in another order than that of the arm.
std::string ur_yaml_text() {
  return "# by ur_calibration\nversion: 1\nkinematics:\n" +
         frame_of("forearm", "-0.612693284 0 0 3.140532249 3.139908847 -3.141687661") +
         frame_of("shoulder", "0 0 0.12799  0 0 1.7796e-05") +
         frame_of("upper_arm", "-6.8695e-05 0 0 1.570050155 0 5.1372e-05") +
         frame_of("wrist_1", "-0.57199 +0.00041566 0.164511275 0.001 -0.0009 0.00005") +
         frame_of("wrist_2", "-0.000163707 -0.11553428 0.000221596 1.570184688 0 9.6187e-05") +
         frame_of("wrist_3", "0.000152646 0.09211961 0.000117863 1.570958711 3.141513161 3.141404971") +
         "  hash: calib_1234567890  # of the controller\n";
}

// The origins of the description, which xacro sets with kinematics_params.
TEST(UrCalibration, ReadsTheYamlOfTheDriver) {
  const std::vector<std::pair<std::string, std::string>> expected = {
      {"shoulder_pan_joint", "xyz=\"0 0 0.12799\" rpy=\"0 0 1.7796e-05\""},
      {"shoulder_lift_joint", "xyz=\"-6.8695e-05 0 0\" rpy=\"1.570050155 0 5.1372e-05\""},
      {"elbow_joint", "xyz=\"-0.612693284 0 0\" rpy=\"3.140532249 3.139908847 -3.141687661\""},
      {"wrist_1_joint", "xyz=\"-0.57199 0.00041566 0.164511275\" rpy=\"0.001 -9e-04 5e-05\""},
      {"wrist_2_joint", "xyz=\"-0.000163707 -0.11553428 0.000221596\" rpy=\"1.570184688 0 9.6187e-05\""},
      {"wrist_3_joint", "xyz=\"0.000152646 0.09211961 0.000117863\" rpy=\"1.570958711 3.141513161 3.141404971\""}};
  const std::string yaml = ur_yaml_text();
  ASSERT_TRUE(is_ur_yaml(yaml));
  const Robot robot = parse_robot(testing::kUr10);
  std::string urdf = testing::kUr10;
  for (const auto& [joint, origin] : expected) {
    const std::size_t begin = urdf.find("<origin", urdf.find("joint name=\"" + joint));
    urdf.replace(begin, urdf.find("/>", begin) - begin, "<origin " + origin);
  }
  EXPECT_EQ(urdf_with_origins(robot.urdf, ur_origins(robot, yaml, "c.yaml")), urdf);
  EXPECT_FALSE(is_ur_yaml(testing::kUrCalibration));
}

TEST(UrCalibration, RefusesAYamlThatIsNone) {
  const Robot robot = parse_robot(testing::kUr10);
  const auto replaced = [](const std::string& what, const std::string& by) {
    std::string text = ur_yaml_text();
    return text.replace(text.find(what), what.size(), by);
  };
  const std::vector<std::pair<std::string, std::string>> texts = {
      {"kinematics:\n", "c.yaml: kinematics: shoulder has no x, expected x, y, z, roll, pitch, yaw"},
      {replaced("  wrist_2:", "  wrist_7:"), "'wrist_7' is unknown, expected shoulder, upper_arm"},
      {replaced("z: 0.12799", "z: 0.12799 m"), "c.yaml:14: z: '0.12799 m' is no number of at most 1e12"},
      {replaced("z: 0.12799", "z 0.12799"), "c.yaml:14: 'z 0.12799' is no key with a colon"},
      {replaced("z: 0.12799", "y: 0.12799"), "c.yaml:14: 'y' is there twice, expected x, y, z"},
      {replaced("z: 0.12799", "rz: 0.12799"), "c.yaml:14: 'rz' is unknown, expected x, y, z"},
      {replaced("z: 0.12799", "z: 0.2284"), "c.yaml: shoulder is 0.10 m and 0.00 rad from where the URDF has it"},
      {replaced("yaw: 1.7796e-05", "yaw: 0.11"), "c.yaml: shoulder is 0.00 m and 0.11 rad from where"},
  };
  for (const auto& [text, words] : texts) {
    EXPECT_THAT(testing::refusal([&, &text = text] { ur_origins(robot, text, "c.yaml"); }), HasSubstr(words)) << text;
  }
  EXPECT_THAT(testing::refusal([&] { ur_origins(testing::fanuc(), ur_yaml_text(), "c.yaml"); }),
              HasSubstr("is no Universal Robot"));
  std::string turned = testing::kUr10;
  turned.replace(turned.find("0 0 1\""), 5, "0 1 0");
  EXPECT_THAT(testing::refusal([&] { ur_origins(parse_robot(turned), ur_yaml_text(), "c.yaml"); }),
              HasSubstr("'shoulder_pan_joint' does not turn about z"));
}

TEST(UrCalibration, RefusesWhatIsNone) {
  const Robot robot = parse_robot(testing::kUr10);
  const auto replaced = [](std::string text, const std::string& what, const std::string& by) {
    return text.replace(text.find(what), what.size(), by);
  };
  const std::string good = testing::kUrCalibration;
  const std::vector<std::pair<std::string, std::string>> texts = {
      {"", "c.conf: no list delta_theta: expected a calibration.conf of a Universal Robot"},
      {replaced(good, "delta_d ", "delta_e "), "no list delta_d"},
      {replaced(good, "delta_a = [", "delta_a = "), "c.conf:3: delta_a: expected six numbers in brackets"},
      {replaced(good, "delta_a = [", "delta_a = [1,"), "c.conf:3: delta_a: expected six numbers in brackets"},
      {replaced(good, "0.00304003843792177708", "x"), "c.conf:3: delta_a: 'x' is no number"},
      {replaced(good, "11.1984514757821039", "1e300"), "is no number of at most 1e12"},
      {replaced(good, "delta_a ", "delta_d "), "delta_d is there twice"},
      {replaced(good, "0.00304003843792177708", "3.04003843792177708"), "expected metres and radians of this robot"},
      {replaced(good, "status = 2", "status = 0"), "calibration_status is not 2: expected the file of a robot whose"},
  };
  for (const auto& [text, words] : texts) {
    EXPECT_THAT(testing::refusal([&, &text = text] { ur_corrections(robot, text, "c.conf"); }), HasSubstr(words))
        << text;
  }
  const auto refused = [&](const Robot& other) {
    return testing::refusal([&] { ur_corrections(other, good, "c.conf"); });
  };
  EXPECT_THAT(refused(testing::fanuc()), HasSubstr("is no Universal Robot: expected the joints shoulder_pan_joint"));
  EXPECT_THAT(refused(parse_robot(replaced(testing::kUr10, "elbow_joint", "left_elbow_joint"))),
              HasSubstr("is no Universal Robot"));
  EXPECT_THAT(refused(calibrated(robot, good)), HasSubstr("expected the maker's URDF, not a corrected one"));
  EXPECT_THAT(refused(parse_robot(testing::kUr10, {.tip = "wrist_3_link"})),
              HasSubstr("no fixed joint between 'wrist_3_joint' and the tip"));
}

}  // namespace
}  // namespace kdl_calibration::ur_calibration_test
