#include "robot/urdf_correction.hpp"

#include <gmock/gmock.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <numbers>
#include <regex>

#include "base/number_text.hpp"
#include "base/random.hpp"
#include "kdl_calibration/robot.hpp"
#include "model/parameters.hpp"
#include "refusal.hpp"
#include "results/calibrated_urdf.hpp"
#include "support.hpp"

namespace kdl_calibration::urdf_export_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// Everything that a hand-edited URDF may hold; every joint has an origin.
const std::string kAwkward = R"(<?xml version='1.0' encoding="utf-8"?>
<?editor <joint name="j1"><origin xyz="5 5 5"/></joint> ?>
<!-- <joint name="j1" type="revolute"><origin xyz="9 9 9" rpy="0 0 0"/></joint> it's "old" -->
<robot	name = "awkward" >
  <gazebo note='a > b, "<joint>"'> x &lt; y <![CDATA[ <joint name="j1"><origin xyz="7 7 7"/> ]]> </gazebo>
  <link name="base" /><link name="l1">
    <visual> <origin xyz="1 1 1" rpy="0 0 1"/> <geometry><box size="1 1 1"/></geometry> </visual>
  </link>
  <link name="l2"/> <link name="l3"/> <link name="l4"/>	<link name='tip'/>
  <transmission name="t1"><joint name="j1"><origin xyz="8 8 8" rpy="0 0 0"/></joint></transmission>
  <joint   type='revolute'   name='j1'  >
    <!-- measured <origin xyz="0 0 0"/> by hand -->
    <origin
        rpy = '  0.10   -2e-1 0.30 '
        xyz = ' 1.0E-1   +.2  -0.3000 '   />
    <parent link="base"/> <child link="l1"/> <axis xyz="0 0.6 0.8"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="j2" type="prismatic"><origin xyz="0 0 0.50"/><parent link="l1"/><child link="l2"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name='bolt' type='fixed'><origin rpy='0.5 0 0'></origin><parent link='l2'/><child link='l3'/></joint>
  <joint name="j&quot;3" type="continuous"><parent link="l3"/><origin	/><child link="l4"/></joint>
  <joint name="tool" type="fixed">
    <parent link="l4"/>
    <child link="tip"/>
    <origin rpy="3.141592653589793 -1.5707963267948966 0" xyz="0 0 0"/>
    <unknown rpy="1 2 3" xyz="4 5 6"/>
  </joint>
</robot>
<!-- the end -->)";

/// The same robot with joints whose origin is absent.
const std::string kWithoutOrigins = R"(<robot name="bare">
  <link name="base"/><link name="l1"/><link name="l2"/><link name="tip"/>
  <joint name="j1" type="continuous">
    <parent link="base"/><child link="l1"/>
  </joint>
	<joint name='j2' type='continuous'>

		<!-- no origin -->
		<parent link='l1'/><child link='l2'/>
	</joint>
  <joint name="tool" type="fixed"><parent link="l2"/><child link="tip"/></joint>
</robot>
)";

std::string with_windows_line_ends(const std::string& text) {
  return std::regex_replace(text, std::regex("\n"), "\r\n");
}

KDL::Rotation random_rotation(Random& random, double angle) {
  const KDL::Vector axis{random.normal(), random.normal(), random.normal()};
  return KDL::Rotation::Rot(axis, angle);
}

/// Corrections of the published size for every joint of the chain, fixed ones included.
std::vector<OriginCorrection> random_corrections(const Robot& robot, std::uint64_t seed) {
  Random random(seed);
  std::vector<OriginCorrection> corrections;
  for (const KDL::Segment& segment : robot.chain.segments) {
    const KDL::Vector shift{0.0025 * random.normal(), 0.0025 * random.normal(), 0.0025 * random.normal()};
    const double angle = 3.0 * std::numbers::pi / 180.0 * random.normal();
    corrections.push_back({segment.getJoint().getName(), KDL::Frame(random_rotation(random, angle), shift)});
  }
  return corrections;
}

/// The chain with each joint's origin multiplied by its correction.
KDL::Chain corrected_chain(const Robot& robot, const std::vector<OriginCorrection>& corrections) {
  std::size_t i = 0;
  return testing::chain_with(
      robot, [&](const KDL::Segment& segment) { return segment.pose(0.0) * corrections[i++].correction; });
}

double largest_difference(const KDL::Chain& a, const KDL::Chain& b) {
  EXPECT_EQ(a.getNrOfJoints(), b.getNrOfJoints());
  Random random(7);
  double largest = 0.0;
  for (int i = 0; i < 1000; ++i) {
    const Eigen::VectorXd q = Eigen::VectorXd::NullaryExpr(
        a.getNrOfJoints(), [&] { return random.uniform(-std::numbers::pi, std::numbers::pi); });
    largest = std::max(largest, testing::difference(testing::kdl_pose(a, q), testing::kdl_pose(b, q)));
  }
  return largest;
}

/// The text with every number in an xyz or rpy value of an <origin> made a '#'.
std::string with_origin_numbers_hidden(std::string text) {
  static const std::regex origin("<origin[^>]*>");
  static const std::regex number("[-+]?[0-9.]+([eE][-+]?[0-9]+)?");
  std::string result;
  std::smatch match;
  while (std::regex_search(text, match, origin)) {
    result += match.prefix().str() + std::regex_replace(match.str(), number, "#");
    text = match.suffix().str();
  }
  return result + text;
}

std::vector<std::string> origins(const std::string& text) {
  static const std::regex origin("<origin[^>]*>");
  return {std::sregex_token_iterator(text.begin(), text.end(), origin), std::sregex_token_iterator()};
}

std::string message_of(const std::string& urdf, const std::vector<OriginCorrection>& corrections) {
  return testing::refusal([&] { corrected_urdf(urdf, corrections); });
}

OriginCorrection shift(const std::string& joint, double x, double y, double z) {
  return {joint, KDL::Frame(KDL::Vector(x, y, z))};
}

OriginCorrection turn(const std::string& joint, const KDL::Rotation& rotation) { return {joint, KDL::Frame(rotation)}; }

void expect_corrected_motion(const std::string& urdf, std::uint64_t seed) {
  const Robot robot = parse_robot(urdf);
  const std::vector<OriginCorrection> corrections = random_corrections(robot, seed);
  const Robot corrected = parse_robot(corrected_urdf(urdf, corrections));
  EXPECT_LT(largest_difference(corrected.chain, corrected_chain(robot, corrections)), 1e-12);
  EXPECT_GT(largest_difference(corrected.chain, robot.chain), 1e-4);
}

void expect_identities_keep_every_byte(const std::string& urdf) {
  std::vector<OriginCorrection> corrections = random_corrections(parse_robot(urdf), 1);
  for (OriginCorrection& correction : corrections) {
    correction.correction = KDL::Frame::Identity();
  }
  EXPECT_EQ(corrected_urdf(urdf, corrections), urdf);
}

void expect_only_numbers_change(const std::string& urdf, std::uint64_t seed) {
  const std::string result = corrected_urdf(urdf, random_corrections(parse_robot(urdf), seed));
  EXPECT_EQ(with_origin_numbers_hidden(result), with_origin_numbers_hidden(urdf));
  expect_corrected_motion(urdf, seed);
  expect_identities_keep_every_byte(urdf);
}

TEST(UrdfExport, WritesOnlyTheNumbersThatChange) {
  EXPECT_EQ(corrected_urdf("<robot><joint name='j'><origin xyz='1.0  0.50 2e0' rpy='0 0.0 0'/></joint></robot>",
                           {shift("j", 0, 0.25, 0)}),
            "<robot><joint name='j'><origin xyz='1.0  0.75 2e0' rpy='0 0.0 0'/></joint></robot>");
  EXPECT_EQ(corrected_urdf("<robot><joint name='j'><origin xyz='1.0 0 0' rpy='0.0 0.0 0.0'/></joint></robot>",
                           {turn("j", KDL::Rotation::RotZ(0.5))}),
            "<robot><joint name='j'><origin xyz='1.0 0 0' rpy='0.0 0.0 0.5'/></joint></robot>");
}

TEST(UrdfExport, WritesTheShortestNumbersThatReadBackTheSame) {
  const std::string result = corrected_urdf("<robot><joint name='j'><origin xyz='0 0 0'/></joint></robot>",
                                            {shift("j", 1.2345678901234567, -1e-7, 0.1)});
  EXPECT_EQ(result, "<robot><joint name='j'><origin xyz='1.2345678901234567 -1e-07 0.1'/></joint></robot>");
}

TEST(UrdfExport, ChangesNothingButOriginsInAHandEditedFile) {
  const Robot robot = parse_robot(kAwkward);
  std::string expected = kAwkward;
  const auto replace = [&expected](const std::string& from, const std::string& to) {
    const std::size_t at = expected.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    expected.replace(at, from.size(), to);
  };
  replace("xyz=\"0 0 0.50\"", "xyz=\"0 0 0.75\"");
  replace("<origin rpy='0.5 0 0'>", "<origin xyz='0.125 0 0' rpy='0.5 0 0'>");
  replace("<origin\t/>", "<origin xyz=\"0.5 0 0\"\t/>");
  EXPECT_EQ(corrected_urdf(kAwkward, {shift("j\"3", 0.5, 0, 0), shift("bolt", 0.125, 0, 0), shift("j2", 0, 0, 0.25)}),
            expected);
}

TEST(UrdfExport, LeavesCommentsAndOtherElementsOfTheSameNameAlone) {
  const std::vector<OriginCorrection> corrections = random_corrections(parse_robot(kAwkward), 3);
  const std::string result = corrected_urdf(kAwkward, corrections);
  for (const char* kept :
       {R"(<?editor <joint name="j1"><origin xyz="5 5 5"/></joint> ?>)",
        R"(<!-- <joint name="j1" type="revolute"><origin xyz="9 9 9" rpy="0 0 0"/></joint> it's "old" -->)",
        R"(<![CDATA[ <joint name="j1"><origin xyz="7 7 7"/> ]]>)", R"(<visual> <origin xyz="1 1 1" rpy="0 0 1"/>)",
        R"(<joint name="j1"><origin xyz="8 8 8" rpy="0 0 0"/></joint></transmission>)",
        R"(<!-- measured <origin xyz="0 0 0"/> by hand -->)", R"(<unknown rpy="1 2 3" xyz="4 5 6"/>)"}) {
    EXPECT_THAT(result, HasSubstr(kept));
  }
  EXPECT_EQ(origins(result).size(), origins(kAwkward).size());
}

TEST(UrdfExport, MovesTheChainAsTheCorrectionsSay) {
  for (const std::string& urdf : {kAwkward, kWithoutOrigins}) {
    expect_corrected_motion(urdf, 4);
    expect_corrected_motion(with_windows_line_ends(urdf), 5);
  }
  expect_corrected_motion("\xEF\xBB\xBF" + kWithoutOrigins, 6);
}

TEST(UrdfExport, KeepsWindowsLineEndsAndTheByteOrderMark) {
  const std::vector<OriginCorrection> corrections = random_corrections(parse_robot(kAwkward), 3);
  const std::string result = corrected_urdf(kAwkward, corrections);
  EXPECT_EQ(corrected_urdf(with_windows_line_ends(kAwkward), corrections), with_windows_line_ends(result));
  const std::string bare = corrected_urdf(kWithoutOrigins, {shift("j1", 1, 0, 0), shift("j2", 2, 0, 0)});
  EXPECT_EQ(corrected_urdf("\xEF\xBB\xBF" + with_windows_line_ends(kWithoutOrigins),
                           {shift("j1", 1, 0, 0), shift("j2", 2, 0, 0)}),
            "\xEF\xBB\xBF" + with_windows_line_ends(bare));
}

TEST(UrdfExport, IdentityCorrectionsKeepEveryByte) {
  expect_identities_keep_every_byte(kAwkward);
  expect_identities_keep_every_byte(with_windows_line_ends(kAwkward));
  expect_identities_keep_every_byte(kWithoutOrigins);
  expect_identities_keep_every_byte("\xEF\xBB\xBF" + kWithoutOrigins);
  EXPECT_EQ(corrected_urdf(kAwkward, {}), kAwkward);
}

TEST(UrdfExport, AddsAnAbsentOriginWithTheIndentOfItsJoint) {
  const std::string result =
      corrected_urdf(kWithoutOrigins, {shift("j1", 0.5, 0, 0),
                                       turn("j2", KDL::Rotation::RotZ(0.5)),
                                       {"tool", KDL::Frame(KDL::Rotation::RotZ(0.25), KDL::Vector(0, 0, 1))}});
  EXPECT_EQ(result, R"(<robot name="bare">
  <link name="base"/><link name="l1"/><link name="l2"/><link name="tip"/>
  <joint name="j1" type="continuous">
    <origin xyz="0.5 0 0"/>
    <parent link="base"/><child link="l1"/>
  </joint>
	<joint name='j2' type='continuous'>
		<origin rpy='0 0 0.5'/>

		<!-- no origin -->
		<parent link='l1'/><child link='l2'/>
	</joint>
  <joint name="tool" type="fixed"><origin xyz="0 0 1" rpy="0 0 0.25"/><parent link="l2"/><child link="tip"/></joint>
</robot>
)");
}

TEST(UrdfExport, AddsAnAbsentAttributeBesideTheOther) {
  const KDL::Frame both(KDL::Rotation::RotZ(0.5), KDL::Vector(1, 0, 0));
  EXPECT_EQ(corrected_urdf("<robot><joint name='j'><origin xyz=\"0 0 0\" /></joint></robot>", {{"j", both}}),
            "<robot><joint name='j'><origin xyz=\"1 0 0\" rpy=\"0 0 0.5\" /></joint></robot>");
  EXPECT_EQ(corrected_urdf("<robot><joint name='j'><origin rpy='0 0 0'/></joint></robot>", {{"j", both}}),
            "<robot><joint name='j'><origin xyz='1 0 0' rpy='0 0 0.5'/></joint></robot>");
  EXPECT_EQ(corrected_urdf("<robot><joint name='j'><origin></origin></joint></robot>", {{"j", both}}),
            "<robot><joint name='j'><origin xyz=\"1 0 0\" rpy=\"0 0 0.5\"></origin></joint></robot>");
}

TEST(UrdfExport, UnderstandsEntitiesAndQuotedBrackets) {
  EXPECT_EQ(
      corrected_urdf("<robot><joint note='a/>b' name='x&amp;&#121;'><origin t='>' xyz='&#49; 0 0'/></joint></robot>",
                     {shift("x&y", 1, 0, 0)}),
      "<robot><joint note='a/>b' name='x&amp;&#121;'><origin t='>' xyz='2 0 0'/></joint></robot>");
}

TEST(UrdfExport, WritesAValueAnewWhereAnEntityHidesWhereItsNumbersBegin) {
  const auto value = [](const std::string& xyz) {
    return corrected_urdf("<robot><joint name='j'><origin xyz='" + xyz + "'/></joint></robot>",
                          {shift("j", 0.0, 0.5, 0.0)});
  };
  EXPECT_THAT(value("&#49; 2.0 3.0"), HasSubstr("xyz='1 2.5 3'"));
  EXPECT_THAT(value("1.0&#32;2.0 3.0"), HasSubstr("xyz='1 2.5 3'"));
  EXPECT_THAT(value(" 1.0 2.0  3.0 "), HasSubstr("xyz=' 1.0 2.5  3.0 '"));
}

std::string robot_with_rpy(const std::array<double, 3>& rpy) {
  return "<robot name='r'><link name='a'/><link name='b'/><joint name='j' type='continuous'><origin rpy='" +
         shortest(rpy[0]) + " " + shortest(rpy[1]) + " " + shortest(rpy[2]) +
         "'/><parent link='a'/><child link='b'/></joint></robot>";
}

TEST(UrdfExport, RotationsComeBackToTheLastDigitsAtAndNearGimbalLock) {
  Random random(8);
  const double quarter = std::numbers::pi / 2;
  for (int i = 0; i < 4000; ++i) {
    const double distance = i % 20 == 0 ? 0.0 : std::pow(10.0, -(i % 20));
    const double pitch = (i % 2 == 0 ? 1.0 : -1.0) * quarter + (i % 3 == 0 ? 1.0 : -1.0) * distance;
    const std::string before = robot_with_rpy({random.uniform(-4, 4), pitch, random.uniform(-4, 4)});
    KDL::Rotation change = random_rotation(random, std::pow(10.0, random.uniform(-16, 0.5)));
    if (i % 5 == 0) {
      change = KDL::Rotation::RotX(random.uniform(-3, 3));  // stays in gimbal lock
    }
    const KDL::Rotation expected = parse_robot(before).joints[0].origin.M * change;
    const std::string after = corrected_urdf(before, {turn("j", change)});
    ASSERT_LT(testing::difference(KDL::Frame(parse_robot(after).joints[0].origin.M), KDL::Frame(expected)), 2e-15)
        << before << "\n"
        << after;
  }
}

std::array<double, 3> rpy_of(const std::string& urdf) {
  std::smatch rpy;
  EXPECT_TRUE(std::regex_search(urdf, rpy, std::regex("rpy='(\\S+) (\\S+) (\\S+)'"))) << urdf;
  return {std::stod(rpy[1]), std::stod(rpy[2]), std::stod(rpy[3])};
}

TEST(UrdfExport, KeepsTheTurnsOfAnglesUpToAHundredRadians) {
  const auto yaw_of = [](double yaw) {
    return rpy_of(corrected_urdf(robot_with_rpy({0.0, 0.0, yaw}), {turn("j", KDL::Rotation::RotZ(0.25))}))[2];
  };
  EXPECT_NEAR(yaw_of(50.0), 50.25, 1e-12);
  EXPECT_NEAR(yaw_of(-99.0), -98.75, 1e-12);
  EXPECT_NEAR(yaw_of(101.0), std::remainder(101.25, 2.0 * std::numbers::pi), 1e-12);
}

TEST(UrdfExport, InGimbalLockTheYawStaysAndTheRollTakesTheChange) {
  Random random(12);
  for (int i = 0; i < 200; ++i) {
    const double pitch = i % 2 == 0 ? std::numbers::pi / 2 : -std::numbers::pi / 2;
    const std::array<double, 3> old = {random.uniform(-7, 7), pitch, random.uniform(-7, 7)};
    const double change = random.uniform(-0.01, 0.01);
    const std::string before = robot_with_rpy(old);
    const std::array<double, 3> now = rpy_of(corrected_urdf(before, {turn("j", KDL::Rotation::RotX(change))}));
    EXPECT_EQ(now[2], old[2]) << before;
    EXPECT_NEAR(now[1], pitch, 1e-15) << before;
    EXPECT_NEAR(now[0], old[0] + change, 1e-14) << before;
  }
}

// The other roll, pitch and yaw of the same rotation.
std::array<double, 3> flipped(const std::array<double, 3>& rpy) {
  constexpr double kHalf = std::numbers::pi;
  return {rpy[0] + kHalf, kHalf - rpy[1], rpy[2] + kHalf};
}

double from_whole_turns(double angle) { return std::abs(std::remainder(angle, 2.0 * std::numbers::pi)); }

TEST(UrdfExport, OfAllEquivalentAnglesItWritesThoseNearestToTheOldText) {
  Random random(13);
  for (int i = 0; i < 500; ++i) {
    const double near_lock = i % 2 == 0 ? random.uniform(-6, 6) : std::numbers::pi / 2 + random.uniform(-1e-3, 1e-3);
    const std::array<double, 3> old = {random.uniform(-6, 6), near_lock, random.uniform(-6, 6)};
    const std::string before = robot_with_rpy(old);
    const std::string after = corrected_urdf(before, {turn("j", random_rotation(random, random.uniform(0.0, 0.2)))});
    const std::array<double, 3> rpy = rpy_of(after);
    double nearest = std::numeric_limits<double>::infinity();
    for (const auto& [a, b, c] : {rpy, flipped(rpy)}) {
      nearest =
          std::min(nearest, from_whole_turns(a - old[0]) + from_whole_turns(b - old[1]) + from_whole_turns(c - old[2]));
    }
    const double distance = std::abs(rpy[0] - old[0]) + std::abs(rpy[1] - old[1]) + std::abs(rpy[2] - old[2]);
    EXPECT_LE(distance, nearest + 1e-12) << before << "\n" << after;
  }
}

TEST(UrdfExport, AnglesOfManyTurnsLoseNoDigits) {
  const std::string before = robot_with_rpy({1e9, -3e7, 2e8});
  const KDL::Rotation change = KDL::Rotation::RotX(0.01) * KDL::Rotation::RotY(0.02);
  const KDL::Frame expected(parse_robot(before).joints[0].origin.M * change);
  const std::string after = corrected_urdf(before, {turn("j", change)});
  EXPECT_LT(testing::difference(KDL::Frame(parse_robot(after).joints[0].origin.M), expected), 1e-14) << after;
}

TEST(UrdfExportBadInput, MalformedXmlIsNamedWithItsLine) {
  EXPECT_THAT(message_of("<robot>\n<joint name='j'>\n</robot>", {}),
              AllOf(HasSubstr(":2"), HasSubstr("malformed XML")));
  EXPECT_THAT(message_of("", {}), HasSubstr("empty"));
  EXPECT_THAT(message_of("<sdf/>", {}), HasSubstr("no <robot>"));
}

TEST(UrdfExportBadInput, JointsThatAreNotThereOnceAreNamed) {
  EXPECT_THAT(message_of(kAwkward, {shift("j9", 1, 0, 0)}), HasSubstr("no joint 'j9'"));
  EXPECT_THAT(message_of("<robot><t><joint name='j'/></t></robot>", {shift("j", 1, 0, 0)}), HasSubstr("no joint 'j'"));
  EXPECT_THAT(message_of("<robot><joint name='j'></joint>\n<joint name='j'></joint></robot>", {shift("j", 1, 0, 0)}),
              AllOf(HasSubstr(":2"), HasSubstr("joint 'j' exists twice")));
  EXPECT_THAT(message_of(kAwkward, {shift("j1", 1, 0, 0), shift("j1", 1, 0, 0)}),
              HasSubstr("joint 'j1' has two corrections"));
}

TEST(UrdfExportBadInput, OriginsThatCannotBeCorrectedAreNamed) {
  EXPECT_THAT(message_of("<robot>\n<joint name='j'><origin xyz='1 2'/></joint></robot>", {shift("j", 1, 0, 0)}),
              AllOf(HasSubstr(":2"), HasSubstr("joint 'j'"), HasSubstr("xyz '1 2'"), HasSubstr("three numbers")));
  EXPECT_THAT(message_of("<robot><joint name='j'/></robot>", {shift("j", 1, 0, 0)}),
              AllOf(HasSubstr("joint 'j'"), HasSubstr("empty")));
  EXPECT_THAT(message_of(kAwkward, {shift("j1", std::numeric_limits<double>::quiet_NaN(), 0, 0)}),
              AllOf(HasSubstr("joint 'j1'"), HasSubstr("not finite"), Not(HasSubstr("\n"))));
}

TEST(UrdfExport, ChangesOnlyNumbersInTheProjectsUrdf) { expect_only_numbers_change(testing::fanuc().urdf, 9); }

TEST(UrdfExportOnRealData, ChangesOnlyNumbersInTheRosIndustrialUrdf) {
  const std::string urdf =
      load_robot(std::filesystem::path(SHARED_DATA_DIR) / "ros_industrial/fanuc_r2000ic165f.urdf").urdf;
  expect_only_numbers_change(urdf, 10);

  // Of all origins, those of the chain's seven joints and no others.
  const std::string result = corrected_urdf(urdf, random_corrections(parse_robot(urdf), 10));
  const std::vector<std::string> before = origins(urdf);
  const std::vector<std::string> after = origins(result);
  ASSERT_EQ(before.size(), after.size());
  int changed = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    changed += before[i] != after[i] ? 1 : 0;
  }
  EXPECT_EQ(changed, 7);
}

TEST(UrdfExportOnRealData, ChangesOnlyNumbersInTheUr10Urdf) {
  expect_only_numbers_change(load_robot(std::filesystem::path(SHARED_DATA_DIR) / "ur10_tracker_poses/ur10.urdf").urdf,
                             11);
}

TEST(UrdfExport, OfATipInTheMiddleLeavesTheRestUntouched) {
  const Robot robot = parse_robot(testing::kOddArm, {.base = "world", .tip = "d"});
  ASSERT_EQ(robot.joints.size(), 4U);
  const ErrorModel model = complete_model(robot);
  const std::string exported = calibrated_urdf(robot, model, testing::errors_of(model, {{"dq2", 0.01}}));
  const std::size_t behind = robot.urdf.find("<joint name=\"skew\"");
  EXPECT_EQ(exported.substr(exported.find("<joint name=\"skew\"")), robot.urdf.substr(behind));
  EXPECT_NE(exported, robot.urdf);
}

}  // namespace
}  // namespace kdl_calibration::urdf_export_test
