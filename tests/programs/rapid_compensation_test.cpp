#include <gmock/gmock.h>

#include <fmt/core.h>
#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <kdl/chainjnttojacsolver.hpp>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "programs/compensation_support.hpp"
#include "programs/program_language.hpp"
#include "programs/rapid_program.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::rapid_compensation_test {
namespace {

using Eigen::AngleAxisd;
using Eigen::Isometry3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;
using ::testing::AllOf;
using testing::bent;
using testing::by_kdl;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::kDegree;
using ::testing::SizeIs;

// Lengths [m] of an arm as ABB draws it: axis 2 before axis 1, the forearm above axis 3.
struct Lengths {
  double shoulder, height, upper, elbow, fore, flange;
};
constexpr Lengths kIrb120 = {0.0, 0.29, 0.27, 0.07, 0.302, 0.072};
constexpr Lengths kIrb140 = {0.07, 0.352, 0.36, 0.0, 0.38, 0.065};

// A URDF as ROS-Industrial writes them for ABB: joint values are the controller's, tool0 is its tool frame.
Robot arm(const Lengths& l) {
  std::string text = R"(<robot name="irb"><link name="base_link"/>)";
  const auto joint = [&](int number, const std::string& xyz, const std::string& axis, double limit) {
    const std::string parent = number == 1 ? "base_link" : fmt::format("link_{}", number - 1);
    text += fmt::format(R"(<link name="link_{0}"/><joint name="joint_{0}" type="revolute"><parent link="{1}"/>
      <child link="link_{0}"/><origin xyz="{2}"/><axis xyz="{3}"/>
      <limit lower="{4}" upper="{5}" effort="1" velocity="1"/></joint>)",
                        number, parent, xyz, axis, -limit * kDegree, limit * kDegree);
  };
  joint(1, "0 0 0", "0 0 1", 200);
  joint(2, fmt::format("{} 0 {}", l.shoulder, l.height), "0 1 0", 110);
  joint(3, fmt::format("0 0 {}", l.upper), "0 1 0", 230);
  joint(4, fmt::format("0 0 {}", l.elbow), "1 0 0", 200);
  joint(5, fmt::format("{} 0 0", l.fore), "0 1 0", 120);
  joint(6, fmt::format("{} 0 0", l.flange), "1 0 0", 400);
  text += R"(<link name="tool0"/><joint name="joint_6-tool0" type="fixed"><parent link="link_6"/><child link="tool0"/>
    <origin rpy="0 1.5707963267948966 0"/></joint></robot>)";
  return parse_robot(text, {.base = "base_link", .tip = "tool0"}, "irb.urdf");
}

const Robot& irb120() {
  static const Robot robot = arm(kIrb120);
  return robot;
}
const Robot& irb140() {
  static const Robot robot = arm(kIrb140);
  return robot;
}

CompensatedProgram compensated(const Robot& robot, const Calibration& found, const std::string& text,
                               const CompensatedJoints& near = {}) {
  return testing::compensated(robot, Compensator(found), controller_of_links(robot),
                              {{.source = "IN.mod", .text = text}}, near);
}

std::string list(const std::vector<double>& numbers, int decimals) {
  std::string text;
  for (const double number : numbers) {
    text += fmt::format("{}{:.{}f}", text.empty() ? "" : ",", number, decimals);
  }
  return "[" + text + "]";
}

std::string pose_text(const Isometry3d& pose) {
  const Vector3d p = 1e3 * pose.translation();
  const Quaterniond q(pose.linear());
  return list({p.x(), p.y(), p.z()}, 4) + "," + list({q.w(), q.x(), q.y(), q.z()}, 9);
}

constexpr const char* kNoAxes = "[9E9,9E9,9E9,9E9,9E9,9E9]";

using Words = std::array<int, 4>;

// confdata of joint values [rad]: the quadrants, and cfx by where the wrist centre is in the frames of links 1 and 2.
Words words_of(const VectorXd& q, const Lengths& l) {
  const auto quadrant = [](double value) { return static_cast<int>(std::floor(value / (90.0 * kDegree))); };
  const double before_lower_arm = l.fore * std::cos(q[2]) + l.elbow * std::sin(q[2]);
  const double before_axis_1 =
      l.shoulder + l.upper * std::sin(q[1]) + l.fore * std::cos(q[1] + q[2]) + l.elbow * std::sin(q[1] + q[2]);
  return {quadrant(q[0]), quadrant(q[3]), quadrant(q[5]),
          (before_axis_1 < 0.0 ? 4 : 0) + (before_lower_arm < 0.0 ? 2 : 0) + (q[4] < 0.0 ? 1 : 0)};
}

std::string robtarget(const Isometry3d& pose, const Words& words) {
  return fmt::format("[{},[{},{},{},{}],{}]", pose_text(pose), words[0], words[1], words[2], words[3], kNoAxes);
}

Isometry3d pose_in(const ProgramPoint& point) {
  const auto n = [&](std::size_t i) { return point.fields[i].value; };
  Isometry3d pose = Isometry3d::Identity();
  pose.translation() = 1e-3 * Vector3d(n(0), n(1), n(2));
  pose.linear() = Quaterniond(n(3), n(4), n(5), n(6)).normalized().toRotationMatrix();
  return pose;
}

// The same place in all configurations of an IRB 140, as they ran on a controller: A. Gil, ARTE, A Robotics Toolbox for
// Education, test_configurations, with joint values for the first. The others follow from the lengths, by a program of
// its own. All are in degrees.
TEST(AbbRapid, MeansThePublishedJointValuesOfEachConfiguration) {
  struct Row {
    Words words;
    std::array<double, 6> joints;
  };
  const std::vector<Row> rows = {{{0, 1, -2, 1}, {23.9625, 6.7721, -7.1508, 90.852, -23.9653, -90.9324}},
                                 {{0, -1, 0, 0}, {23.96, 6.77, -7.15, -89.15, 23.97, 89.07}},
                                 {{0, 1, -2, 3}, {23.96, 92.35, -172.85, 155.74, -81.32, -176.11}},
                                 {{0, -1, 0, 2}, {23.96, 92.35, -172.85, -24.26, 81.32, 3.89}},
                                 {{-2, -1, -2, 5}, {-156.04, -83.65, -38.94, -27.81, -60.52, -165.45}},
                                 {{-2, 1, 0, 4}, {-156.04, -83.65, -38.94, 152.19, 60.52, 14.55}},
                                 {{-2, -1, -2, 7}, {-156.04, -31.11, -141.06, -72.96, -25.14, -108.70}},
                                 {{-2, 1, 0, 6}, {-156.04, -31.11, -141.06, 107.04, 25.14, 71.30}}};
  const Calibration found = bent(irb140(), 1e-4, 1);
  for (const Row& row : rows) {
    const std::string text = fmt::format(
        "MODULE m\nPROC main()\nMoveJ [[515,200,712],[0.7071,0,0.7071,0],[{},{},{},{}],{}],vmax,fine,tool0;\nENDPROC\n"
        "ENDMODULE\n",
        row.words[0], row.words[1], row.words[2], row.words[3], kNoAxes);
    const CompensatedProgram result = compensated(irb140(), found, text);
    ASSERT_THAT(result.positions, SizeIs(1));
    const VectorXd asked = result.positions[0].point.joint_values - result.positions[0].point.change;
    for (std::size_t i = 0; i < row.joints.size(); ++i) {
      EXPECT_NEAR(asked[static_cast<Eigen::Index>(i)] / kDegree, row.joints[i], 0.01)
          << row.words[3] << " axis " << i + 1;
    }
    EXPECT_EQ(words_of(asked, kIrb140), row.words);
  }
}

// The pose of an IRB 120 with all joint values zero, and where the wrist of its home position points 30 degrees down.
TEST(AbbRapid, HasTheMakersFaceplate) {
  Isometry3d zero = Isometry3d::Identity();
  zero.translation() = Vector3d(0.374, 0.0, 0.63);
  zero.linear() = Quaterniond(std::sqrt(0.5), 0.0, std::sqrt(0.5), 0.0).toRotationMatrix();
  EXPECT_LT((by_kdl(irb120().chain, VectorXd::Zero(6)).matrix() - zero.matrix()).norm(), 1e-12);
  const std::string home =
      "MODULE m\nPROC main()\nMoveJ [[364.353829072,0,594],[0.5,0,0.866025404,0],[0,0,0,0],"
      "[9E9,9E9,9E9,9E9,9E9,9E9]],vmax,fine,tool0;\nENDPROC\nENDMODULE\n";
  const CompensatedProgram result = compensated(irb120(), bent(irb120(), 0.0, 1), home);
  EXPECT_EQ(result.texts.front(), home);
  EXPECT_NEAR(result.positions.at(0).point.joint_values[4], 30.0 * kDegree, 1e-8);
  EXPECT_NEAR(result.positions.at(0).point.joint_values.norm(), 30.0 * kDegree, 1e-7);
}

// Robots that have no cfx write 0 whatever the sign of axis 5, and in front of or behind axis 1.
TEST(AbbRapid, FollowsTheQuadrantsOfARobotWithoutCfx) {
  const Calibration found = bent(irb140(), 1e-4, 1);
  for (const Words& words : {Words{0, 1, -2, 0}, Words{0, -1, 0, 0}, Words{-2, -1, -2, 0}, Words{-2, 1, 0, 0}}) {
    const std::string text = fmt::format(
        "MODULE m\nPROC main()\nMoveJ [[515,200,712],[0.7071,0,0.7071,0],[{},{},{},0],{}],vmax,fine,tool0;\nENDPROC\n"
        "ENDMODULE\n",
        words[0], words[1], words[2], kNoAxes);
    const CompensatedProgram result = compensated(irb140(), found, text);
    const Words reached = words_of(result.positions.at(0).point.joint_values, kIrb140);
    EXPECT_THAT(reached, ElementsAre(words[0], words[1], words[2], ::testing::AnyOf(0, 1, 4, 5)));
  }
}

TEST(AbbRapid, WritesQuadrantsThatTheNewJointValuesHave) {
  VectorXd q = (VectorXd(6) << 0.3, 0.2, -0.1, 0.0, 0.6, 1.0).finished();
  const Isometry3d pose = by_kdl(irb120().chain, q);
  const std::string text =
      "MODULE m\nPROC main()\nMoveJ " + robtarget(pose, {0, 0, 0, 0}) + ",vmax,fine,tool0;\nENDPROC\nENDMODULE\n";
  bool is_below = false;
  bool is_above = false;
  for (std::uint64_t seed = 1; seed < 9; ++seed) {
    const CompensatedProgram result = compensated(irb120(), bent(irb120(), 1e-3, seed), text);
    ASSERT_TRUE(result.positions.at(0).written);
    const bool is_negative = result.positions[0].point.joint_values[3] < 0.0;
    EXPECT_THAT(result.texts.front(), HasSubstr(is_negative ? "],[0,-1,0,0],[9E9" : "],[0,0,0,0],[9E9"));
    is_below = is_below || is_negative;
    is_above = is_above || !is_negative;
  }
  EXPECT_TRUE(is_below && is_above);
}

TEST(AbbRapid, TakesJointValuesNextToThePointBeforeWhileTheCheckIsOff) {
  const VectorXd q = (VectorXd(6) << 0.3, 0.2, -0.1, 2.0, -0.6, -1.0).finished();
  const VectorXd start = q + VectorXd::Constant(6, 0.05);
  const std::string target = robtarget(by_kdl(irb120().chain, q), {0, 0, 0, 0});
  const std::vector<double> degrees = {start[0] / kDegree, start[1] / kDegree, start[2] / kDegree,
                                       start[3] / kDegree, start[4] / kDegree, start[5] / kDegree};
  const std::string text = "MODULE m\nPROC main()\nConfL\\Off;\nMoveAbsJ [" + list(degrees, 6) + "," + kNoAxes +
                           "],vmax,fine,tool0;\nMoveL " + target + ",vmax,fine,tool0;\nENDPROC\nENDMODULE\n";
  const Calibration found = bent(irb120(), 1e-4, 2);
  const CompensatedProgram result = compensated(irb120(), found, text);
  EXPECT_LT((result.positions.at(1).point.joint_values - q).norm(), 0.01);
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("IN.mod:3: ConfL \\Off lets the controller choose")));
  EXPECT_REFUSED("IN.mod:3: target of MoveL: no joint values reach it with this configuration",
                 compensated(irb120(), found,
                             "MODULE m\nPROC main()\nMoveL " + target + ",vmax,fine,tool0;\nENDPROC\nENDMODULE\n"));
}

// As if the program stated them itself.
TEST(AbbRapid, LeavesTargetsInFramesOfABackupThatDoNotStandStill) {
  const std::string target = robtarget(by_kdl(irb120().chain, VectorXd::Constant(6, 0.4)), {0, 0, 0, 0});
  Controller controller = controller_of_links(irb120());
  controller.frames = abb_rapid().read_frames(
      "PERS tooldata tFixed:=[FALSE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
      "PERS wobjdata wHeld:=[TRUE,TRUE,\"\",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n",
      "user.sys");
  const std::string text = "MODULE m\nCONST robtarget p1:=" + target + ";\nCONST robtarget p2:=" + target +
                           ";\nCONST robtarget p3:=" + target +
                           ";\nPROC main()\nMoveJ p1,v10,fine,tool0;\nMoveL p2,v10,fine,tFixed\\WObj:=wHeld;\n"
                           "MoveL p3,v10,fine,tool0\\WObj:=wHeld;\nENDPROC\nENDMODULE\n";
  const CompensatedProgram result = testing::compensated(irb120(), Compensator(bent(irb120(), 1e-3, 1)), controller,
                                                         {{.source = "IN.mod", .text = text}});
  ASSERT_THAT(result.positions, SizeIs(1));
  EXPECT_EQ(result.positions.front().name, "p1");
  EXPECT_THAT(
      result.warnings,
      ElementsAre(AllOf(HasSubstr("IN.mod:3: a point is relative to a tool that stands in the cell, or to a frame "
                                  "that the robot"),
                        HasSubstr("(also in line 4)"))));
}

TEST(AbbRapid, RefusesFramesThatNobodyStates) {
  const std::string target = robtarget(by_kdl(irb120().chain, VectorXd::Constant(6, 0.4)), {0, 0, 0, 0});
  const auto text = [&](const std::string& frames) {
    return "MODULE m\nCONST robtarget p10:=" + target + ";\nPROC main()\nMoveL p10,v10,fine," + frames +
           ";\nENDPROC\nENDMODULE\n";
  };
  const Calibration exact = bent(irb120(), 0.0, 1);
  EXPECT_REFUSED("IN.mod:2: p10: wobjdata w1 is not known, expected it in --frames",
                 compensated(irb120(), exact, text("tool0\\WObj:=W1")));
  EXPECT_REFUSED("IN.mod:2: p10: tooldata tgun is not known, expected it in --frames",
                 compensated(irb120(), exact, text("tGun")));
  EXPECT_EQ(compensated(irb120(), exact, text("tool0")).texts.front(), text("tool0"));
}

// ---- Random programs -----------------------------------------------------------------------------------------------

// A program of points at joint values, in the notations of the language.
class RandomProgram {
public:
  RandomProgram(const Robot& robot, const Lengths& lengths, bool has_cfx, std::uint64_t seed)
      : robot_(robot), lengths_(lengths), has_cfx_(has_cfx), random_(seed) {
    for (const char* name : {"tA", "tB"}) {
      tools_.push_back(frame(0.2));
      declarations_ +=
          fmt::format("PERS tooldata {}:=[TRUE,[{}],[1,[0,0,1],[1,0,0,0],0,0,0]];\n", name, pose_text(tools_.back()));
    }
    for (const char* name : {"wA", "wB"}) {
      const Isometry3d user = frame(0.5);
      const Isometry3d object = frame(0.5);
      objects_.push_back(user * object);
      declarations_ += fmt::format("TASK PERS wobjdata {}:=[FALSE,TRUE,\"\",[{}],[{}]];\r\n", name, pose_text(user),
                                   pose_text(object));
    }
  }

  struct Point {
    VectorXd q;
    Words words;
    Isometry3d tool = Isometry3d::Identity();
    Isometry3d object = Isometry3d::Identity();
    bool has_joints = false;
  };

  void add() {
    Point point = drawn();
    const int number = static_cast<int>(points_.size());
    const std::string name = fmt::format("p{}", number);
    point.has_joints = random_.uniform() < 0.2;
    const bool is_data = random_.uniform() < 0.6;
    const bool is_element = random_.uniform() < 0.3;
    std::string frames = "tool0";
    if (const double draw = random_.uniform(); draw < 0.6) {
      const std::size_t index = draw < 0.3 ? 0 : 1;
      point.tool = tools_[index];
      point.object = objects_[index];
      frames = index == 0 ? "TA \\WOBJ:=wA" : "tB\\WObj:=wB\\TLoad:=load0";
    }
    const std::string type = point.has_joints ? "jointtarget" : "robtarget";
    const std::string value = point.has_joints ? joints(point.q) : pose(point);
    if (is_data) {
      declarations_ += is_element ? fmt::format("  CONST {} {}{{1}}:=[ {} ]; ! {{\n", type, name, value)
                                  : fmt::format("\tLOCAL PERS {} {} := {};\r\n", type, name, value);
      points_.push_back(point);
    } else {
      inline_points_.push_back(point);
    }
    const std::string target = !is_data ? value : is_element ? name + "{1}" : name;
    statements_ += fmt::format("    {} {}\\ID:=7, v100\\T:=2,\n      z10, {};\n",
                               point.has_joints          ? "MoveAbsJ"
                               : random_.uniform() < 0.5 ? "MoveJ"
                                                         : "movel",
                               target, frames);
  }

  std::string text() const {
    return "MODULE random\n" + declarations_ + "PROC main()\n" + statements_ + "ENDPROC\nENDMODULE\n";
  }

  // In the order of the text: data stand before the motions.
  std::vector<Point> points() const {
    std::vector<Point> all = points_;
    all.insert(all.end(), inline_points_.begin(), inline_points_.end());
    return all;
  }

private:
  Isometry3d frame(double size) {
    Isometry3d result = Isometry3d::Identity();
    result.translation() = size * Vector3d(random_.normal(), random_.normal(), random_.normal());
    result.linear() = Quaterniond(random_.normal(), random_.normal(), random_.normal(), random_.normal())
                          .normalized()
                          .toRotationMatrix();
    return result;
  }

  // Away from singularities, at times with axis 1, 4 or 6 on the edge of a quadrant.
  Point drawn() {
    constexpr std::array<double, 6> kMost = {170, 100, 150, 190, 110, 390};
    for (;;) {
      Point point{.q = VectorXd(6), .words = {}};
      for (Eigen::Index i = 0; i < 6; ++i) {
        point.q[i] = (2.0 * random_.uniform() - 1.0) * kMost[static_cast<std::size_t>(i)] * kDegree;
      }
      if (random_.uniform() < 0.3) {
        const Eigen::Index axis =
            std::array<Eigen::Index, 3>{0, 3, 5}[static_cast<std::size_t>(3.0 * random_.uniform())];
        point.q[axis] = 90.0 * kDegree * std::round(point.q[axis] / (90.0 * kDegree));
      }
      point.words = words_of(point.q, lengths_);
      const double elbow = lengths_.fore * std::cos(point.q[2]) + lengths_.elbow * std::sin(point.q[2]);
      const double reach = point.q[1] + point.q[2];
      const double axis_1 = lengths_.shoulder + lengths_.upper * std::sin(point.q[1]) +
                            lengths_.fore * std::cos(reach) + lengths_.elbow * std::sin(reach);
      const bool is_hidden = !has_cfx_ && elbow < 0.0;
      if (std::abs(point.q[4]) > 0.2 && std::abs(elbow) > 0.1 && std::abs(axis_1) > 0.1 && !is_hidden) {
        point.words[3] = has_cfx_ ? point.words[3] : 0;
        return point;
      }
    }
  }

  static std::string joints(const VectorXd& q) {
    std::vector<double> degrees;
    for (const double value : q) {
      degrees.push_back(value / kDegree);
    }
    return "[" + list(degrees, 6) + "," + kNoAxes + "]";
  }

  std::string pose(const Point& point) const {
    return robtarget(point.object.inverse() * by_kdl(robot_.chain, point.q) * point.tool, point.words);
  }

  const Robot& robot_;
  const Lengths& lengths_;
  bool has_cfx_;
  Random random_;
  std::vector<Isometry3d> tools_;
  std::vector<Isometry3d> objects_;
  std::vector<Point> points_;
  std::vector<Point> inline_points_;
  std::string declarations_;
  std::string statements_;
};

// The joint values to which the controller drives the nominal arm for this point.
VectorXd driven(const Robot& robot, const ProgramPoint& written, const RandomProgram::Point& point) {
  if (point.has_joints) {
    VectorXd q(6);
    for (std::size_t i = 0; i < 6; ++i) {
      q[static_cast<Eigen::Index>(i)] = written.fields[i].value * kDegree;
    }
    return q;
  }
  // Newton's method with KDL's kinematics. KDL's own solvers stop at 1e-6 rad.
  const Isometry3d commanded = point.object * pose_in(written) * point.tool.inverse();
  KDL::ChainJntToJacSolver derivatives(robot.chain);
  KDL::JntArray q(6);
  q.data = point.q;
  for (int step = 0; step < 12; ++step) {
    const Isometry3d now = by_kdl(robot.chain, q.data);
    const AngleAxisd turn(commanded.linear() * now.linear().transpose());
    KDL::Jacobian jacobian(6);
    derivatives.JntToJac(q, jacobian);
    q.data += jacobian.data.partialPivLu().solve(
        (VectorXd(6) << commanded.translation() - now.translation(), turn.angle() * turn.axis()).finished());
  }
  EXPECT_LT((by_kdl(robot.chain, q.data).matrix() - commanded.matrix()).norm(), 1e-10);
  return q.data;
}

void expect_words(const ProgramPoint& written, const VectorXd& q, const RandomProgram::Point& point,
                  const Lengths& lengths) {
  constexpr std::array<Eigen::Index, 3> kTurning = {0, 3, 5};
  EXPECT_EQ(words_of(q, lengths)[3], words_of(point.q, lengths)[3]);
  for (std::size_t i = 0; i < kTurning.size(); ++i) {
    const double lower = written.turn_fields[i].value * 90.0 * kDegree;
    constexpr double kRounding = 2e-6;  // [rad]
    EXPECT_GE(q[kTurning[i]], lower - kRounding);
    EXPECT_LE(q[kTurning[i]], lower + 90.0 * kDegree + kRounding);
  }
}

// But for the last digit: quaternions are written with norm 1.
void expect_same_numbers(const std::string& before, const std::string& after) {
  const Program a = abb_rapid().parse({{.source = "IN.mod", .text = before}});
  const Program b = abb_rapid().parse({{.source = "OUT.mod", .text = after}});
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    for (std::size_t k = 0; k < a.points[i].fields.size(); ++k) {
      const NumberField& field = a.points[i].fields[k];
      EXPECT_NEAR(b.points[i].fields[k].value, field.value, 1.5 * std::pow(10.0, -field.decimals));
    }
  }
}

TEST(AbbRapid, BringsTheCalibratedArmWhereTheNominalOneWouldBe) {
  constexpr int kPrograms = 24;
  constexpr int kPoints = 20;
  int turned = 0;
  for (std::uint64_t seed = 1; seed <= kPrograms; ++seed) {
    const bool is_120 = seed % 2 == 0;
    const Robot& robot = is_120 ? irb120() : irb140();
    const Lengths& lengths = is_120 ? kIrb120 : kIrb140;
    RandomProgram random(robot, lengths, seed % 3 != 0, seed);
    for (int i = 0; i < kPoints; ++i) {
      random.add();
    }
    const std::string text = random.text();
    expect_same_numbers(text, compensated(robot, bent(robot, 0.0, 1), text).texts.front());
    const Calibration found = bent(robot, 5e-4, seed);
    const CompensatedProgram result = compensated(robot, found, text);
    EXPECT_THAT(result.warnings, Each(HasSubstr("ends in another configuration")));
    const std::vector<ProgramPoint> before = abb_rapid().parse({{.source = "IN.mod", .text = text}}).points;
    const std::vector<ProgramPoint> written =
        abb_rapid().parse({{.source = "OUT.mod", .text = result.texts.front()}}).points;
    const std::vector<RandomProgram::Point> points = random.points();
    ASSERT_EQ(written.size(), points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      SCOPED_TRACE(fmt::format("program {} point {} {}", seed, i, written[i].name));
      ASSERT_EQ(result.positions[i].point.status, CompensationStatus::exact);
      const VectorXd q = driven(robot, written[i], points[i]);
      const Isometry3d reached = by_kdl(found.urdf_chain(), q);
      const Isometry3d wanted = by_kdl(robot.chain, points[i].q);
      EXPECT_LT((reached.translation() - wanted.translation()).norm(), 5e-7);
      EXPECT_LT(AngleAxisd(reached.linear().transpose() * wanted.linear()).angle(), 1e-7);
      if (!points[i].has_joints) {
        expect_words(written[i], q, points[i], lengths);
        for (std::size_t k = 0; k < 3; ++k) {
          turned += written[i].turn_fields[k].value != before[i].turn_fields[k].value ? 1 : 0;
        }
      }
    }
  }
  EXPECT_GT(turned, 10);
}

}  // namespace
}  // namespace kdl_calibration::rapid_compensation_test
