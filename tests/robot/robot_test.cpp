#include "kdl_calibration/robot.hpp"

#include <console_bridge/console.h>
#include <fmt/core.h>
#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <iostream>
#include <numbers>
#include <optional>
#include <sstream>
#include <utility>

#include "base/number_text.hpp"
#include "base/random.hpp"
#include "refusal.hpp"
#include "robot/urdf_reading.hpp"
#include "support.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::robot_test {
namespace {

using ::testing::AllOf;
using testing::difference;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::kdl_pose;
using ::testing::Not;
using testing::urdf::joint;
using testing::urdf::links;
using testing::urdf::robot_of;

const std::string kTwoLinks = "<link name='a'/><link name='b'/>";
const std::string kEnds = "<parent link='a'/><child link='b'/>";

/// A robot of two links whose only joint has this type and content.
std::string one_joint(const std::string& type, const std::string& content) {
  return robot_of(kTwoLinks + "<joint name='j' type='" + type + "'>" + kEnds + content + "</joint>");
}

/// base -j1- l1 -j2- l2 with two leaves behind l2.
std::string forked(const std::string& left, const std::string& right) {
  return robot_of(links({"base", "l1", "l2", left, right}) + joint("j1", "continuous", "base", "l1") +
                  joint("j2", "continuous", "l1", "l2") + joint("to_" + left, "fixed", "l2", left) +
                  joint("to_" + right, "fixed", "l2", right));
}

std::string message_of(const std::string& urdf, const RobotOptions& options = {}) {
  return testing::refusal([&] { parse_robot(urdf, options, "test.urdf"); });
}

Eigen::Isometry3d origin_of(const Eigen::Vector3d& xyz, const Eigen::Vector3d& rpy) {
  using Eigen::Vector3d;
  return Eigen::Translation3d(xyz) * Eigen::AngleAxisd(rpy.z(), Vector3d::UnitZ()) *
         Eigen::AngleAxisd(rpy.y(), Vector3d::UnitY()) * Eigen::AngleAxisd(rpy.x(), Vector3d::UnitX());
}

const std::string kMixed = robot_of(
    "<link name='base'/><link name='l1'/><link name='plate'/><link name='tip'/><link name='l3'/>"
    "<link name='l2'><inertial><origin xyz='0.1 0 0' rpy='0 0 1.5707963267948966'/><mass value='4'/>"
    "<inertia ixx='1' iyy='2' izz='3' ixy='0' ixz='0' iyz='0'/></inertial></link>" +
    joint("turn", "revolute", "base", "l1",
          "<origin xyz='0.1 -0.2 0.3' rpy='0.4 0.5 -0.6'/><axis xyz='0 3 4'/>"
          "<limit lower='-1.5' upper='2.5' effort='0' velocity='0.7'/>") +
    joint("bolt", "fixed", "l1", "plate", "<origin xyz='0 0.05 0' rpy='1 0 0'/>") +
    joint("slide", "prismatic", "plate", "l2",
          "<origin xyz='1 0 0' rpy='0 -1.2 0'/><axis xyz='0 0 -2'/>"
          "<limit lower='0' upper='0.25' effort='0' velocity='0'/>") +
    joint("spin", "continuous", "l2", "l3", "<origin rpy='0 0 3'/>") +
    joint("tool", "fixed", "l3", "tip", "<origin xyz='0.01 0.02 0.03' rpy='0.1 0.2 0.3'/>"));

TEST(Robot, ReadsJointsAndLimits) {
  const Robot robot = parse_robot(kMixed, {}, "mixed.urdf");
  EXPECT_EQ(robot.name, "r");
  EXPECT_EQ(robot.source, "mixed.urdf");
  EXPECT_EQ(robot.urdf, kMixed);
  EXPECT_EQ(robot.base, "base");
  EXPECT_EQ(robot.tip, "tip");
  EXPECT_EQ(robot.tip_joint, "tool");
  EXPECT_THAT(joint_names(robot), ElementsAre("turn", "slide", "spin"));

  ASSERT_EQ(robot.joints.size(), 3U);
  const MovingJoint& turn = robot.joints[0];
  EXPECT_EQ(turn.type, JointType::revolute);
  EXPECT_DOUBLE_EQ(turn.axis.y(), 0.6);
  EXPECT_DOUBLE_EQ(turn.axis.z(), 0.8);
  EXPECT_EQ(turn.lower, -1.5);
  EXPECT_EQ(turn.upper, 2.5);
  EXPECT_EQ(turn.velocity, 0.7);
  EXPECT_EQ(robot.joints[1].type, JointType::prismatic);
  EXPECT_EQ(robot.joints[1].lower, 0.0);
  EXPECT_EQ(robot.joints[1].upper, 0.25);
  EXPECT_EQ(robot.joints[1].velocity, std::nullopt);
  EXPECT_EQ(robot.joints[2].type, JointType::continuous);
  EXPECT_EQ(robot.joints[2].lower, std::nullopt);
  EXPECT_EQ(robot.joints[2].upper, std::nullopt);
}

TEST(Robot, TurnsTheWholeTensorOfInertiaIntoTheLinkFrame) {
  const Robot robot = parse_robot(robot_of(
      "<link name='a'/><link name='b'><inertial><origin xyz='0.1 -0.2 0.3' rpy='0.4 -0.5 0.6'/><mass value='2'/>"
      "<inertia ixx='5' iyy='6' izz='7' ixy='0.3' ixz='-0.2' iyz='0.1'/></inertial></link>" +
      joint("j", "continuous", "a", "b")));
  const Eigen::Matrix3d R = origin_of({0, 0, 0}, {0.4, -0.5, 0.6}).linear();
  const Eigen::Vector3d p(0.1, -0.2, 0.3);
  const Eigen::Matrix3d about_cog = (Eigen::Matrix3d() << 5, 0.3, -0.2, 0.3, 6, 0.1, -0.2, 0.1, 7).finished();
  const Eigen::Matrix3d expected =
      R * about_cog * R.transpose() + 2.0 * (p.squaredNorm() * Eigen::Matrix3d::Identity() - p * p.transpose());
  const KDL::RigidBodyInertia inertia = robot.chain.getSegment(0).getInertia();
  const KDL::RotationalInertia found = inertia.getRotationalInertia();
  EXPECT_LT((Eigen::Map<const Eigen::Matrix3d>(found.data) - expected).norm(), 1e-13);
  EXPECT_LT((Eigen::Map<const Eigen::Vector3d>(inertia.getCOG().data) - p).norm(), 1e-15);
  EXPECT_EQ(inertia.getMass(), 2.0);
}

TEST(Robot, LimitsMayBeZeroOnOneSideOrTheSameOnBoth) {
  const auto limits = [](const std::string& range) {
    const Robot robot = parse_robot(one_joint("revolute", "<limit effort='0' velocity='0' " + range + "/>"));
    return std::pair(robot.joints[0].lower, robot.joints[0].upper);
  };
  using Limits = std::pair<std::optional<double>, std::optional<double>>;
  EXPECT_EQ(limits("lower='-1' upper='0'"), Limits(-1.0, 0.0));
  EXPECT_EQ(limits("lower='0' upper='1'"), Limits(0.0, 1.0));
  EXPECT_EQ(limits("lower='0.5' upper='0.5'"), Limits(0.5, 0.5));
  EXPECT_EQ(limits("upper='2'"), Limits(0.0, 2.0));
  EXPECT_EQ(limits("lower='0' upper='0'"), Limits());
  const Robot turning = parse_robot(one_joint("continuous", "<limit effort='0' velocity='3' lower='-1' upper='1'/>"));
  EXPECT_EQ(turning.joints[0].lower, std::nullopt);
  EXPECT_EQ(turning.joints[0].velocity, 3.0);
}

TEST(Robot, LeavesTheConsoleOfOthersAsItWas) {
  class Handler : public console_bridge::OutputHandler {
    void log(const std::string& /*text*/, console_bridge::LogLevel /*level*/, const char* /*file*/,
             int /*line*/) override {}
  } handler;
  console_bridge::OutputHandler* const before = console_bridge::getOutputHandler();
  const console_bridge::LogLevel level = console_bridge::getLogLevel();
  console_bridge::useOutputHandler(&handler);
  console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_DEBUG);
  parse_robot(kMixed);
  EXPECT_EQ(console_bridge::getOutputHandler(), &handler);
  EXPECT_EQ(console_bridge::getLogLevel(), console_bridge::CONSOLE_BRIDGE_LOG_DEBUG);
  (void)message_of(one_joint("hinge", ""));
  EXPECT_EQ(console_bridge::getOutputHandler(), &handler);
  EXPECT_EQ(console_bridge::getLogLevel(), console_bridge::CONSOLE_BRIDGE_LOG_DEBUG);
  console_bridge::useOutputHandler(before);
  console_bridge::setLogLevel(level);
}

TEST(Robot, ChainAndJointsBothGiveTheHandWrittenForwardKinematics) {
  const Robot robot = parse_robot(kMixed);
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d q{random.uniform(-1.5, 2.5), random.uniform(0, 0.25), random.uniform(-9, 9)};
    const Eigen::Isometry3d expected =
        origin_of({0.1, -0.2, 0.3}, {0.4, 0.5, -0.6}) * Eigen::AngleAxisd(q[0], Eigen::Vector3d(0, 0.6, 0.8)) *
        origin_of({0, 0.05, 0}, {1, 0, 0}) * origin_of({1, 0, 0}, {0, -1.2, 0}) * Eigen::Translation3d(0, 0, -q[1]) *
        origin_of({0, 0, 0}, {0, 0, 3}) * Eigen::AngleAxisd(q[2], Eigen::Vector3d::UnitX()) *
        origin_of({0.01, 0.02, 0.03}, {0.1, 0.2, 0.3});
    ASSERT_LT(difference(kdl_pose(robot.chain, q), to_kdl(expected)), 1e-14);

    KDL::Frame folded = robot.joints[0].origin * KDL::Frame(KDL::Rotation::Rot(robot.joints[0].axis, q[0]));
    folded = folded * robot.joints[1].origin * KDL::Frame(robot.joints[1].axis * q[1]);
    folded = folded * robot.joints[2].origin * KDL::Frame(KDL::Rotation::Rot(robot.joints[2].axis, q[2]));
    ASSERT_LT(difference(folded * robot.tip_origin, to_kdl(expected)), 1e-14);
  }
}

TEST(Robot, RotationsAreOrthonormalToTheLastDigits) {
  Random random(2);
  for (int i = 0; i < 2000; ++i) {
    std::string rpy;
    for (int angle = 0; angle < 3; ++angle) rpy += shortest(random.uniform(-7, 7)) + " ";
    const Robot robot = parse_robot(one_joint("continuous", "<origin rpy='" + rpy + "'/>"));
    const KDL::Rotation& m = robot.joints[0].origin.M;
    for (int k = 0; k < 9; ++k) {
      // In long double, so that the check's own rounding stays out of the bound.
      long double product = 0.0L;
      for (int l = 0; l < 3; ++l) {
        product += static_cast<long double>(m(k / 3, l)) * m(k % 3, l);
      }
      ASSERT_NEAR(static_cast<double>(product - (k % 4 == 0 ? 1.0L : 0.0L)), 0.0, 1e-15) << rpy;
    }
  }
}

TEST(Robot, ReadsAPartOfTheTreeBetweenTheGivenLinks) {
  const Robot robot = parse_robot(kMixed, {.base = "l1", .tip = "l2"});
  EXPECT_THAT(joint_names(robot), ElementsAre("slide"));
  EXPECT_EQ(robot.chain.getNrOfSegments(), 2U);
  EXPECT_EQ(robot.tip_joint, "");
  EXPECT_EQ(robot.tip_origin, KDL::Frame::Identity());
}

TEST(Robot, TipDefaultsToTool0ThenFlange) {
  EXPECT_EQ(parse_robot(forked("tool0", "flange")).tip, "tool0");
  EXPECT_EQ(parse_robot(forked("camera", "flange")).tip, "flange");
  EXPECT_THAT(message_of(forked("camera", "gripper")),
              AllOf(HasSubstr("test.urdf"), HasSubstr("tip is ambiguous"), HasSubstr("camera, gripper")));
  EXPECT_EQ(parse_robot(forked("camera", "gripper"), {.base = "", .tip = "camera"}).tip, "camera");
}

TEST(Robot, TipIsSoughtBelowTheGivenBase) {
  const std::string urdf = robot_of(links({"world", "base", "l1", "tool0"}) + joint("post", "fixed", "world", "base") +
                                    joint("side", "fixed", "world", "tool0") + joint("j1", "continuous", "base", "l1"));
  EXPECT_EQ(parse_robot(urdf, {.base = "base", .tip = ""}).tip, "l1");
}

TEST(Robot, IgnoresWhatStandsBesideTheChain) {
  const std::string urdf = robot_of(
      links({"base", "l1", "tool0", "f", "p", "m"}) + "some words" + joint("j1", "continuous", "base", "l1") +
      joint("to", "fixed", "l1", "tool0") + joint("float", "floating", "base", "f") +
      joint("plane", "planar", "base", "p") +
      joint("mimic", "continuous", "base", "m", "<axis xyz='0 0 0'/><mimic joint='j1'/>") +
      "<transmission name='t'><joint name='j1'/><joint name='nobody'/></transmission><gazebo><any/>text</gazebo>");
  EXPECT_THAT(joint_names(parse_robot(urdf)), ElementsAre("j1"));
}

TEST(Robot, ReadsAByteOrderMarkCommentsAndWindowsLineEnds) {
  const std::string urdf = "\xEF\xBB\xBF<?xml version='1.0'?>\r\n<!-- <joint name='no'> -- >\r\n-->\r\n" +
                           one_joint("continuous", "\r\n<!-- <origin xyz='9 9 9'/> --><origin xyz='1 2 3'/>\r\n");
  const Robot robot = parse_robot(urdf);
  EXPECT_EQ(robot.joints[0].origin.p, KDL::Vector(1, 2, 3));
  EXPECT_EQ(robot.urdf, urdf);
}

TEST(Robot, PrintsNothing) {
  std::ostringstream out;
  std::streambuf* const error_buffer = std::cerr.rdbuf(out.rdbuf());
  std::streambuf* const output_buffer = std::cout.rdbuf(out.rdbuf());
  (void)message_of(robot_of(""));
  (void)message_of(one_joint("hinge", ""));
  (void)message_of(kMixed);
  std::cerr.rdbuf(error_buffer);
  std::cout.rdbuf(output_buffer);
  EXPECT_EQ(out.str(), "");
}

TEST(RobotBadInput, UnreadableFileIsNamedWithTheReason) {
  EXPECT_REFUSED_WITH(AllOf(HasSubstr("/no/such/robot.urdf"), HasSubstr("No such file or directory")),
                      load_robot("/no/such/robot.urdf"));
  EXPECT_REFUSED_WITH(AllOf(HasSubstr("/: "), HasSubstr("directory")), load_robot("/"));
}

TEST(RobotBadInput, IsNamedWithWhereAndWhatItIs) {
  const std::string far = "<origin xyz='1e12 0 0'/>";
  const std::string limits = "<limit effort='0' velocity='0' lower='2' upper='1'/>";
  struct Fault {
    std::string urdf;
    std::vector<std::string> words;
    RobotOptions options = {};
  };
  for (const auto& [urdf, words, options] : std::vector<Fault>{
           {"", {"test.urdf: empty"}},
           {"<robot name='r'>\n<link name='a'>\n</robot>", {"test.urdf:2", "malformed XML"}},
           {"<robot name='r'>\n\n<link name=a/></robot>", {"test.urdf:3"}},
           {"links: 6", {"test.urdf:1", "malformed XML"}},
           {std::string("<robot>\n\0</robot>", 17), {"test.urdf:2", "zero"}},
           {"<sdf version='1.6'/>", {"test.urdf", "no <robot>"}},
           {robot_of(""), {"No link elements found"}},
           {one_joint("hinge", ""), {"test.urdf: not a valid URDF: Joint [j] has no known type [hinge]; "}},
           {one_joint("continuous", "<origin xyz='0 nan 0'/>"), {"[j]", "nan"}},
           {one_joint("continuous", "<origin xyz='0 1e999 0'/>"), {"1e999"}},
           {one_joint("continuous", "<origin xyz='0&#10;0 0 0'/>"), {"test.urdf"}},
           {one_joint("revolute", ""), {"[j]", "limits"}},
           {one_joint("revolute", limits), {"joint 'j'", "lower limit 2", "upper limit 1"}},
           {one_joint("fixed", ""), {"no moving joint", "'a'", "'b'"}},
           {robot_of("<link name='a'/>"), {"no moving joint"}},
           {one_joint("revolute", "<origin xyz='1 0 0' quat_xyzw='0 0 1 0'/>"),
            {"joint 'j'", "'quat_xyzw' of <origin>"}},
           {one_joint("revolute", "<axis xyz='1 0 0' expressed_in='a'/>"), {"'expressed_in'"}},
           {one_joint("continuous", "<mimic joint='other'/>"), {"joint 'j' mimics joint 'other'", "a moving joint"}},
           {one_joint("floating", ""), {"joint 'j' is floating"}},
           {one_joint("planar", ""), {"joint 'j' is planar"}},
           {one_joint("continuous", "<axis xyz='0 0 0'/>"), {"joint 'j'", "axis of length 0"}},
           {forked("x", "y"), {"'x'", "'y'", "not connected"}, {.base = "x", .tip = "y"}},
           {forked("x", "y"), {"not connected"}, {.base = "l2", .tip = "base"}},
           {forked("x", "y"), {"no base link 'two"}, {.base = "two\nlines", .tip = "x"}},
           {forked("x", "y"), {"no tip link 'tcp'", "base, l1, l2, x, y"}, {.base = "", .tip = "tcp"}},
           {robot_of(kTwoLinks + joint("j", "continuous", "a", "b") + joint("k", "continuous", "b", "a")), {"a loop"}},
           {robot_of(links({"root", "tip", "a", "b"}) + joint("i", "continuous", "root", "tip") +
                     joint("j", "continuous", "a", "b") + joint("k", "continuous", "b", "a")),
            {"form a loop"}},
           {robot_of(links({"a", "b", "c"}) + joint("j", "continuous", "a", "b") + joint("k", "continuous", "c", "b")),
            {"link 'b'", "'j'", "'k'"}},
           {robot_of(links({"a", "b", "c", "d"}) + joint("i", "fixed", "a", "b", far) +
                     joint("j", "fixed", "b", "c", far) + joint("k", "continuous", "c", "d")),
            {"joint 'j'", "out of range"}}}) {
    const std::string message = message_of(urdf, options);
    for (const std::string& word : words) {
      EXPECT_THAT(message, AllOf(HasSubstr(word), Not(HasSubstr("\n")), Not(HasSubstr("; ;")))) << urdf;
    }
  }
  EXPECT_EQ(message_of(one_joint("continuous", "<axis xyz='1e-300 0 0'/>")), "nothing was refused");
}

TEST(RobotBadInput, DeepNestingIsAnErrorAndNoCrash) {
  std::string deep;
  for (int i = 0; i < 200000; ++i) {
    deep += "<a>";
  }
  EXPECT_THAT(message_of(deep), HasSubstr("nested too deeply"));
  EXPECT_THAT(message_of("<?skip " + deep + "?>" + one_joint("continuous", "")), HasSubstr("nothing was refused"));
}

TEST(RobotBadInput, PercentSignsAreTextAndNoFormat) {
  EXPECT_THAT(message_of(one_joint("continuous", "<origin xyz='0 %s%n%n 0'/>")), HasSubstr("[%s%n%n]"));
  EXPECT_THAT(message_of(one_joint("%s%n%n", "")), HasSubstr("[%s%n%n]"));
  EXPECT_THAT(message_of(robot_of("<link name='a'/><link name='%n%s'/><link name='%n%s'/>")), HasSubstr("%n%s"));
  const std::string urdf = robot_of(links({"a", "%n%s"}) + joint("100 %%", "continuous", "a", "%n%s"));
  const Robot robot = parse_robot(urdf, {}, "test.urdf");
  EXPECT_EQ(robot.tip, "%n%s");
  EXPECT_EQ(robot.joints.front().name, "100 %%");
}

/// So many links l000, l001, ... borne by the first.
std::string star_of(int count) {
  std::string content = "<link name='l000'/>";
  for (int i = 1; i < count; ++i) {
    const std::string name = fmt::format("l{:03}", i);
    content += "<link name='" + name + "'/>" + joint("j" + name, "continuous", "l000", name);
  }
  return robot_of(content);
}

TEST(RobotBadInput, LinksAreListedUpToFiftyOfThem) {
  std::string fifty = "test.urdf: no base link 'none', the links are: l000";
  for (int i = 1; i < 50; ++i) {
    fifty += fmt::format(", l{:03}", i);
  }
  EXPECT_EQ(message_of(star_of(50), {.base = "none", .tip = ""}), fifty);
  EXPECT_EQ(message_of(star_of(51), {.base = "none", .tip = ""}), fifty + ", ... (51 in all)");
}

TEST(RobotBadInput, JointsAreAtMostTwoThousand) {
  EXPECT_EQ(message_of(star_of(2001), {.base = "", .tip = "l007"}), "nothing was refused");
  EXPECT_EQ(message_of(star_of(2002), {.base = "", .tip = "l007"}), "test.urdf: more joints than the limit of 2000");
}

TEST(RobotBadInput, TextIsAtMost64MiB) {
  std::string text(std::size_t{64} << 20U, ' ');
  EXPECT_EQ(message_of(text), "test.urdf: empty, expected a URDF");
  text += ' ';
  EXPECT_EQ(message_of(text), "test.urdf: larger than the limit of 64 MiB");
}

TEST(RobotBadInput, JointsWithoutEndsOrNamesAreToldByTheirKind) {
  const std::string nameless = robot_of(kTwoLinks + "<joint type='continuous'>" + kEnds + "</joint>");
  EXPECT_THAT(message_of(nameless), AllOf(HasSubstr("not a valid URDF: "), HasSubstr("unnamed joint")));
  for (const char* ends : {"", "<parent link='a'/>", "<parent link='a'/><child/>", "<parent/><child link='b'/>"}) {
    const std::string one = std::string("<joint name='j' type='continuous'>") + ends + "</joint>";
    const std::string two = std::string("<joint name='k' type='continuous'>") + ends + "</joint>";
    EXPECT_THAT(message_of(robot_of(kTwoLinks + one)), HasSubstr("not a valid URDF: ")) << ends;
    const bool one_child = std::string(ends).find("child link") != std::string::npos;
    EXPECT_THAT(message_of(robot_of(kTwoLinks + one + two)),
                HasSubstr(one_child ? "link 'b' is the child of joints 'j' and 'k'" : "not a valid URDF: "))
        << ends;
  }
  const std::string same = joint("j", "continuous", "a", "b");
  EXPECT_THAT(message_of(robot_of(kTwoLinks + same + same)), HasSubstr("not a valid URDF: joint 'j' is not unique"));
}

TEST(RobotBadInput, MacrosAreToBeExpandedFirst) {
  const auto refused = [&](const std::string& content, const std::string& source) {
    return testing::refusal([&] { parse_robot(robot_of(kTwoLinks + content), {}, source); });
  };
  const auto expected = [](const std::string& found, const std::string& source, const std::string& target) {
    return source + ":" + found + " is xacro, expected a URDF; expand it first: xacro " + source + " > " + target;
  };
  const std::string include = "<xacro:include/>";
  EXPECT_EQ(refused(include, "arm.urdf.xacro"), expected("1: <xacro:include>", "arm.urdf.xacro", "arm.urdf"));
  EXPECT_EQ(refused(include, "arm.xacro"), expected("1: <xacro:include>", "arm.xacro", "robot.urdf"));
  const auto in_joint = [&](const std::string& inside) {
    return "\n\n<joint name='j' type='continuous'>\n<parent link='a'/><child link='b'/>" + inside + "</joint>";
  };
  const std::vector<std::pair<std::string, std::string>> read = {
      {in_joint("<origin xyz='${l} 0 0'/>"), "4: '${l} 0 0'"},
      {in_joint("<limit\nlower='$(arg low)'/>"), "5: '$(arg low)'"},
      {in_joint("<mimic joint='$(find k)'/>"), "4: '$(find k)'"},
      {in_joint("<xacro:axis_of/>"), "4: <xacro:axis_of>"},
      {"\n<link name='${prefix}c'/>", "2: '${prefix}c'"},
      {"\n<link name='c'>\n<xacro:inertia_of/></link>", "3: <xacro:inertia_of>"}};
  for (const auto& [content, found] : read) {
    EXPECT_EQ(refused(content, "arm.urdf"), expected(found, "arm.urdf", "robot.urdf"));
  }
}

// What a chain is made of does not depend on them.
TEST(Robot, MacrosInShapesMassesAndExtensionsAreNotRead) {
  const auto read = [&](const std::string& inside, const std::string& beside) {
    return parse_robot(robot_of("<link name='a'/><link name='b'>" + inside + "</link>" +
                                joint("j", "continuous", "a", "b", "<origin xyz='1 2 3'/>") + beside));
  };
  for (const char* inside : {"<visual><xacro:arm_mesh/></visual>",
                             "<visual><geometry><mesh filename='$(find arm)/b.stl'/></geometry></visual>",
                             "<visual><geometry><sphere radius='${r}'/></geometry></visual>",
                             "<collision><geometry><xacro:box_of a='1'/></geometry></collision>",
                             "<inertial><xacro:cylinder/></inertial>", "<!-- <xacro:inertia_of/> ${m} -->"}) {
    EXPECT_EQ(read(inside, "").joints.at(0).origin.p, KDL::Vector(1.0, 2.0, 3.0)) << inside;
  }
  for (const char* beside : {"<gazebo><xacro:plugin/></gazebo>", "<gazebo a='${pi}'/>",
                             "<transmission name='${t}'><xacro:gear/></transmission>", "<!-- $(find b) -->"}) {
    EXPECT_EQ(read("", beside).joints.size(), 1U) << beside;
  }
}

TEST(RobotBadInput, MassesAreInRangeOnEveryAxis) {
  const auto with = [](const std::string& origin, const std::string& mass) {
    return message_of(robot_of("<link name='a'/><link name='b'><inertial><origin xyz='" + origin + "'/><mass value='" +
                               mass +
                               "'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>" +
                               joint("j", "continuous", "a", "b")));
  };
  EXPECT_EQ(with("0 0 0", "1e12"), "nothing was refused");
  EXPECT_EQ(with("1 -2 3", "1"), "nothing was refused");
  EXPECT_THAT(with("0 0 0", "1.01e12"), HasSubstr("link 'b': mass or its centre is not finite or out of range"));
  for (const char* far : {"2e12 0 0", "0 -2e12 0", "0 0 2e12"}) {
    EXPECT_THAT(with(far, "1"), HasSubstr("link 'b': mass or its centre")) << far;
    EXPECT_THAT(message_of(one_joint("continuous", "<origin xyz='" + std::string(far) + "'/>")),
                HasSubstr("joint 'j': origin is not finite or out of range"))
        << far;
  }
}

TEST(UrdfEncoding, IsUtf8ByItsBytesAndByWhatItSays) {
  const auto refused = [](const std::string& text) { return testing::refusal([&] { require_utf8(text, "r"); }); };
  const std::string taken = "nothing was refused";
  const std::string utf8 = "\xc3\xbc";
  const auto stated = [](const std::string& encoding) { return "\n<?xml version='1.0' encoding=" + encoding + "?>\n"; };
  EXPECT_EQ(refused("plain"), taken);
  EXPECT_EQ(refused(utf8), taken);
  EXPECT_EQ(refused("a\n" + utf8 + "\n\n" + utf8), taken);
  EXPECT_EQ(refused("<?xml version='1.0'?>" + utf8 + " encoding='latin1'"), taken);
  for (const char* encoding : {"'UTF-8'", "\"utf-8\"", "'utf8'", "\"UTF8\""}) {
    EXPECT_EQ(refused(stated(encoding) + utf8), taken) << encoding;
  }
  EXPECT_EQ(refused(stated("'latin1'") + "plain"), taken);
  EXPECT_EQ(refused(stated("'latin1'") + utf8), "r:2: letters in the encoding 'LATIN1', expected XML in UTF-8");
  EXPECT_EQ(refused(stated("\"a'b\"") + utf8), "r:2: letters in the encoding 'A'B', expected XML in UTF-8");
  EXPECT_EQ(refused("\xff\xfe<"), "r:1: UTF-16, expected XML in UTF-8");
  EXPECT_EQ(refused("\xfe\xff<"), "r:1: UTF-16, expected XML in UTF-8");
  EXPECT_EQ(refused(std::string("\na\n\0\n", 5)), "r:3: zero byte, expected XML in UTF-8");
  const std::string latin = ": letters in another encoding, such as Latin-1, expected XML in UTF-8";
  EXPECT_EQ(refused("\xfc"), "r:1" + latin);
  EXPECT_EQ(refused("\n\xfc"), "r:2" + latin);
  EXPECT_EQ(refused(utf8 + "\n\nab\nlast \xfc"), "r:4" + latin);
  EXPECT_EQ(refused(utf8 + "\nab\nx\xfcy\n" + utf8 + "\n"), "r:3" + latin);
}

const std::filesystem::path kSharedData = SHARED_DATA_DIR;

TEST(RobotOnRealData, ReadsTheRosIndustrialDescription) {
  const Robot robot = load_robot(kSharedData / "ros_industrial/fanuc_r2000ic165f.urdf");
  EXPECT_EQ(robot.base, "base_link");
  EXPECT_EQ(robot.tip, "tool0");
  EXPECT_EQ(robot.tip_joint, "link_6-tool0");
  EXPECT_THAT(joint_names(robot), ElementsAre("joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"));
  const Eigen::Isometry3d stretched =
      origin_of({0.312 + 1.280 + 0.215, 0, 0.670 + 1.075 + 0.225}, {std::numbers::pi, -std::numbers::pi / 2, 0});
  EXPECT_LT(difference(kdl_pose(robot.chain, Eigen::VectorXd::Zero(6)), to_kdl(stretched)), 1e-15);
}

TEST(RobotOnRealData, ReadsTheUr10) {
  const Robot robot = load_robot(kSharedData / "ur10_tracker_poses/ur10.urdf");
  EXPECT_EQ(robot.base, "base_link");
  EXPECT_EQ(robot.tip, "tool0");
  ASSERT_EQ(robot.joints.size(), 6U);
  // From the maker's lengths: a2 + a3, d4 + d6 and d1 - d5, turned by half a turn into base_link.
  const KDL::Vector tip = kdl_pose(robot.chain, Eigen::VectorXd::Zero(6)).p;
  EXPECT_NEAR(tip.x(), 0.612 + 0.5723, 1e-9);
  EXPECT_NEAR(tip.y(), 0.163941 + 0.0922, 1e-9);
  EXPECT_NEAR(tip.z(), 0.1273 - 0.1157, 1e-9);
}

}  // namespace
}  // namespace kdl_calibration::robot_test
