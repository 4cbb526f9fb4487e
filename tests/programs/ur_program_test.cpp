#include "programs/ur_program.hpp"

#include <gmock/gmock.h>

#include <fmt/core.h>
#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <kdl/chainiksolverpos_lma.hpp>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "programs/compensation_support.hpp"
#include "programs/program_language.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::ur_program_test {
namespace {

using Eigen::AngleAxisd;
using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kHalf = 0.5 * std::numbers::pi;

// A UR5 as the maker's URDF has it: `base` is turned by half a turn against `base_link`.
const Robot& ur5() {
  static const Robot robot = [] {
    const auto joint = [](const std::string& name, const std::string& child, const std::string& parent,
                          const std::string& origin, const std::string& axis) {
      return fmt::format(R"(<link name="{1}"/><joint name="{0}" type="revolute"><parent link="{2}"/><child link="{1}"/>
        <origin {3}/><axis xyz="{4}"/><limit lower="-6.2831853" upper="6.2831853" effort="1" velocity="1"/></joint>)",
                         name, child, parent, origin, axis);
    };
    const auto fixed = [](const std::string& child, const std::string& parent, const std::string& origin) {
      return fmt::format(R"(<link name="{0}"/><joint name="to_{0}" type="fixed"><parent link="{1}"/><child link="{0}"/>
        <origin {2}/></joint>)",
                         child, parent, origin);
    };
    return parse_robot(
        R"(<robot name="ur5"><link name="base_link"/>)" +
            fixed("base", "base_link", R"(xyz="0 0 0" rpy="0 0 3.141592653589793")") +
            joint("shoulder_pan_joint", "a", "base_link", R"(xyz="0 0 0.089159")", "0 0 1") +
            joint("shoulder_lift_joint", "b", "a", R"(xyz="0 0.13585 0" rpy="0 1.5707963267948966 0")", "0 1 0") +
            joint("elbow_joint", "c", "b", R"(xyz="0 -0.1197 0.425")", "0 1 0") +
            joint("wrist_1_joint", "d", "c", R"(xyz="0 0 0.39225" rpy="0 1.5707963267948966 0")", "0 1 0") +
            joint("wrist_2_joint", "e", "d", R"(xyz="0 0.093 0")", "0 0 1") +
            joint("wrist_3_joint", "f", "e", R"(xyz="0 0 0.09465")", "0 1 0") +
            fixed("tool0", "f", R"(xyz="0 0.0823 0" rpy="-1.5707963267948966 0 0")") + "</robot>",
        {.base = "base_link", .tip = "tool0"}, "ur5.urdf");
  }();
  return robot;
}

// The tool flange in the controller's base by the Denavit-Hartenberg parameters that the maker publishes for the UR5.
Isometry3d controller_pose(const VectorXd& q) {
  struct Row {
    double a, alpha, d;
  };
  constexpr std::array<Row, 6> kRows = {{{0.0, kHalf, 0.089159},
                                         {-0.425, 0.0, 0.0},
                                         {-0.39225, 0.0, 0.0},
                                         {0.0, kHalf, 0.10915},
                                         {0.0, -kHalf, 0.09465},
                                         {0.0, 0.0, 0.0823}}};
  Isometry3d pose = Isometry3d::Identity();
  for (std::size_t i = 0; i < kRows.size(); ++i) {
    pose = pose * AngleAxisd(q[static_cast<Eigen::Index>(i)], Vector3d::UnitZ()) *
           Eigen::Translation3d(kRows[i].a, 0.0, kRows[i].d) * AngleAxisd(kRows[i].alpha, Vector3d::UnitX());
  }
  return pose;
}

std::string listed(const VectorXd& numbers) {
  std::string text;
  for (const double number : numbers) {
    text += fmt::format("{}{:.9f}", text.empty() ? "" : ", ", number);
  }
  return "[" + text + "]";
}

std::string pose_text(const Isometry3d& pose) {
  const AngleAxisd turn(pose.linear());
  VectorXd numbers(6);
  numbers << pose.translation(), turn.angle() * turn.axis();
  return "p" + listed(numbers);
}

VectorXd six(double a, double b, double c, double d, double e, double f) {
  return (VectorXd(6) << a, b, c, d, e, f).finished();
}

const VectorXd kStart = six(0.4, -1.3, 1.7, -1.9, -1.5, 0.3);
const VectorXd kEnd = six(0.7, -1.5, 1.9, -2.0, -1.4, 0.1);

Calibration bent(double size) { return testing::bent(ur5(), size, 8); }

CompensatedProgram compensated(const Calibration& found, const std::string& text, const ProgramFrames& frames = {},
                               const VectorXd& near = {}) {
  Controller controller = controller_of_links(ur5());
  controller.frames = frames;
  return testing::compensated(ur5(), Compensator(found), controller, {{.source = "in.script", .text = text}}, near);
}

const ProgramFrames& flange_as_tool() {
  static const ProgramFrames frames{.user = {}, .tool = {{"tcp", Isometry3d::Identity()}}};
  return frames;
}

Program parsed(const std::string& text) { return ur_script().parse({{.source = "in.script", .text = text}}); }

VectorXd numbers_of(const ProgramPoint& point) {
  VectorXd numbers(6);
  for (std::size_t i = 0; i < 6; ++i) {
    numbers[static_cast<Eigen::Index>(i)] = point.fields[i].value;
  }
  return numbers;
}

Isometry3d pose_in(const ProgramPoint& point) {
  const VectorXd n = numbers_of(point);
  const Vector3d vector = n.tail<3>();
  return Eigen::Translation3d(n.head<3>()) * AngleAxisd(vector.norm(), vector.normalized());
}

// [m] of the calibrated flange from where the nominal one would be, if the controller moves to this pose near `q`.
double miss(const Calibration& found, const Isometry3d& commanded, const VectorXd& q) {
  KDL::ChainIkSolverPos_LMA controller_ik(ur5().chain, Eigen::Matrix<double, 6, 1>::Ones(), 1e-12);
  KDL::JntArray seed(6);
  seed.data = q;
  KDL::JntArray driven(6);
  const Isometry3d in_base_link = AngleAxisd(std::numbers::pi, Vector3d::UnitZ()) * commanded;
  EXPECT_GE(controller_ik.CartToJnt(seed, to_kdl(in_base_link), driven), 0);
  const Isometry3d reached = to_eigen(testing::kdl_pose(found.urdf_chain(), driven.data));
  return (reached.translation() - to_eigen(testing::kdl_pose(ur5().chain, q)).translation()).norm();
}

TEST(UrScript, HasTheMakersPosesInTheBaseOfTheController) {
  const Isometry3d by_links =
      controller_of_links(ur5()).X_BW.inverse() * to_eigen(testing::kdl_pose(ur5().chain, kEnd));
  EXPECT_LT((by_links.matrix() - controller_pose(kEnd).matrix()).norm(), 1e-12);
}

TEST(UrScript, ComesBackByteForByteWithoutErrors) {
  const std::string text =
      "def test():\r\n  # movel(p[1,2,3,0,0,0])\r\n\tset_tcp(p[0,0,0.1,0,0,0])\n  textmsg(\"movej([\")\n"
      "  movej(" +
      listed(kStart) + ", a=1.4, v=1.05)\n  movel( " +
      pose_text(controller_pose(kEnd) * Eigen::Translation3d(0, 0, 0.1)) + ", a=1.2, v=0.25, r=0.01)\nend\n";
  const CompensatedProgram result = compensated(bent(0.0), text);
  EXPECT_EQ(result.texts.front(), text);
  EXPECT_THAT(result.positions, SizeIs(2));
  EXPECT_THAT(result.warnings, IsEmpty());
}

TEST(UrScript, BringsTheCalibratedArmWhereTheNominalOneWouldBe) {
  const Calibration found = bent(1e-3);
  const Isometry3d tool = Eigen::Translation3d(0.01, -0.02, 0.15) * AngleAxisd(0.4, Vector3d::UnitY());
  const std::string text = "set_tcp(" + pose_text(tool) + ")\nmovej(" + listed(kStart) + ")\nmovel(" +
                           pose_text(controller_pose(kEnd) * tool) + ")\n";
  const CompensatedProgram result = compensated(found, text);
  const std::vector<ProgramPoint> written = parsed(result.texts.front()).points;
  ASSERT_THAT(written, SizeIs(2));
  const VectorXd joints = numbers_of(written[0]);
  const auto flange = [](const KDL::Chain& chain, const VectorXd& q) {
    return to_eigen(testing::kdl_pose(chain, q)).translation().eval();
  };
  EXPECT_LT((flange(found.urdf_chain(), joints) - flange(ur5().chain, kStart)).norm(), 5e-6);
  EXPECT_GT((flange(found.urdf_chain(), kStart) - flange(ur5().chain, kStart)).norm(), 1e-3);
  EXPECT_LT(miss(found, pose_in(written[1]) * tool.inverse(), kEnd), 5e-6);
  EXPECT_GT(miss(found, controller_pose(kEnd), kEnd), 1e-3);
}

// The other elbow reaches the same pose: the commands differ, and each is right for its own joint values.
TEST(UrScript, TakesTheJointValuesNextToTheProgramsOwn) {
  const Calibration found = bent(1e-3);
  const Isometry3d pose = controller_pose(kEnd);
  KDL::ChainIkSolverPos_LMA ik(ur5().chain, Eigen::Matrix<double, 6, 1>::Ones(), 1e-12);
  KDL::JntArray seed(6);
  seed.data = six(kEnd[0], kEnd[1] + kEnd[2], -kEnd[2], kEnd[3] + kEnd[2], kEnd[4], kEnd[5]);
  KDL::JntArray other(6);
  ASSERT_GE(ik.CartToJnt(seed, testing::kdl_pose(ur5().chain, kEnd), other), 0);
  ASSERT_GT((other.data - kEnd).norm(), 1.0);
  const auto commanded = [&](const std::string& text, const VectorXd& near = {}) {
    return pose_in(parsed(compensated(found, text, flange_as_tool(), near).texts.front()).points.back());
  };
  for (const VectorXd& q : std::vector<VectorXd>{kEnd, other.data}) {
    const VectorXd near = q + VectorXd::Constant(6, 0.02);
    const std::string global = "global Way_p=" + pose_text(pose) + "\nglobal Way_q=" + listed(near) + "\n";
    const std::vector<Isometry3d> all = {
        commanded("movej(" + listed(near) + ")\nmovel(" + pose_text(pose) + ")\n"),
        commanded("movel(" + pose_text(pose) + ")\n", near),
        commanded("movej(get_inverse_kin(" + pose_text(pose) + ", " + listed(near) + "), a=1)\n"),
        commanded(global + "movej(get_inverse_kin(Way_p, qnear=Way_q), a=1.3, v=1.0)\n")};
    for (const Isometry3d& each : all) {
      EXPECT_LT(miss(found, each, q), 5e-6);
    }
  }
  EXPECT_REFUSED("in.script:1: line 1: is a pose whose joint values depend on the point before",
                 compensated(found, "movel(" + pose_text(pose) + ")\n", flange_as_tool()));
}

TEST(UrScript, SaysWhereAPoseIsReachedInAnotherWayThanBefore) {
  const std::string pose = "w=" + pose_text(controller_pose(kEnd)) + "\n";
  const VectorXd other_elbow = six(kEnd[0], kEnd[1] + kEnd[2], -kEnd[2], kEnd[3] + kEnd[2], kEnd[4], kEnd[5]);
  const std::string first = pose + "movej(" + listed(kStart) + ")\nmovel(w)\n";
  EXPECT_THAT(compensated(bent(1e-3), first + "movel(w)\n", flange_as_tool()).warnings, IsEmpty());
  const CompensatedProgram result =
      compensated(bent(1e-3), first + "movej(" + listed(other_elbow) + ")\nmovel(w)\n", flange_as_tool());
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("in.script:5: reaches a pose with other joint values")));
}

TEST(UrScript, ReadsVariablesAndLeavesWhatIsComputed) {
  const std::string a = listed(kStart);
  const std::string b = listed(kEnd);
  const std::string text = "home = " + a + "\n" +                                          // 1
                           "local away=" + b + " # away\n" +                               // 2
                           "unused = " + a + "\n" +                                        // 3
                           "if (home == away):\nend\n" +                                   // 4, 5
                           "movej(home)\nmovej(away, v=1)\n" +                             // 6, 7
                           "home[2] = 1.0\n" +                                             // 8
                           "movel(pose_add(get_actual_tcp_pose(), p[0,0,0.1,0,0,0]))\n" +  // 9
                           "movej([d2r(0), 0, 0, 0, 0, 0])\n" +                            // 10
                           "movel(pose_trans(plane, p[0,0,0.1,0,0,0]))\n";                 // 11
  const Program program = parsed(text);
  ASSERT_THAT(program.points, SizeIs(2));
  EXPECT_EQ(program.points[0].name, "home");
  EXPECT_EQ(program.points[1].line, 2U);
  ASSERT_THAT(program.motions, SizeIs(5));
  EXPECT_EQ(program.motions[0].point, 0U);
  EXPECT_EQ(program.motions[1].point, 1U);
  EXPECT_FALSE(program.motions[2].point || program.motions[3].point || program.motions[4].point);
  EXPECT_TRUE(program.motions[2].is_straight);
  EXPECT_THAT(compensated(bent(1e-3), text).warnings,
              ElementsAre(HasSubstr("in.script:8: a target is computed at run time: not compensated here (also in "
                                    "lines 9, 10)"),
                          HasSubstr("in.script:11: pose_trans states a target in a feature")));
}

TEST(UrScript, KnowsTheToolThatIsSet) {
  const std::string pose = pose_text(controller_pose(kEnd));
  const std::string start = "movej(" + listed(kStart) + ")\n";
  EXPECT_REFUSED("in.script:2: line 2: tool frame (set_tcp) tcp is not known, expected it in --frames",
                 compensated(bent(0.0), start + "movel(" + pose + ")\n"));
  const auto tools = [&](const std::string& text) {
    std::vector<std::optional<std::string>> result;
    for (const ProgramPoint& point : parsed(text).points) {
      result.push_back(point.tool_frame);
    }
    return result;
  };
  const std::string set = "set_tcp(p[0, 0, 0.1, 0, 0, 0])\n";
  const std::string other = "set_tcp(p[0, 0, 0.2, 0, 0, 0])\n";
  EXPECT_THAT(tools(set + "movel(" + pose + ")\n" + other + "movel(" + pose + ")\n" + set + "movel(" + pose + ")\n"),
              ElementsAre("set_tcp in line 1", "set_tcp in line 3", "set_tcp in line 1"));
  EXPECT_THAT(parsed(set + other).remarks.front().lines, ElementsAre(2U));
  EXPECT_THAT(tools("set_tcp(tool)\nmovel(" + pose + ")\n"), IsEmpty());
  EXPECT_THAT(tools(set + "w = " + pose + "\nmovel(w)\n" + other + "movel(w)\n"), IsEmpty());
  EXPECT_THAT(tools(set + "w = " + pose + "\nmovel(w)\n" + set + "movel(w)\n"), SizeIs(1));
}

TEST(UrScript, SaysWhatItLeavesAlone) {
  const auto remarks = [](const std::string& text) {
    std::vector<std::string> lines;
    for (const ProgramRemark& remark : parsed(text).remarks) {
      lines.push_back(remark.what.substr(0, 20) + " " + std::to_string(remark.lines.front()));
    }
    return lines;
  };
  const std::string pose = pose_text(controller_pose(kEnd));
  const std::string joints = listed(kEnd);
  EXPECT_THAT(remarks("movej(get_inverse_kin(" + pose + ", " + joints + ", 1e-10, 1e-10, p[0,0,0.3,0,0,0]))\n"),
              ElementsAre("a target is computed 1"));
  EXPECT_THAT(remarks("movej(get_inverse_kin(" + pose + ", qnear=" + joints + ", tcp=p[0,0,0.3,0,0,0]))\n"),
              ElementsAre("a target is computed 1"));
  EXPECT_THAT(remarks("A=" + pose + "\ndef go(A):\nmovel(A)\nend\ngo(A)\nmovej(" + joints + ")\n"),
              ElementsAre("a target is computed 3", "a pose is no target  1"));
  EXPECT_THAT(remarks("movej(" + joints + ")\nmovel(" + pose + ")\nset_tcp(p[0,0,0.3,0,0,0])\n"),
              ElementsAre("set_tcp sets another 3"));
  EXPECT_THAT(remarks("movej(" + joints + ")\nforce_mode(tool0, [0,0,1,0,0,0], [0,0,9,0,0,0], 2, limits)\n"),
              ElementsAre("conveyors, forces an 2"));
  EXPECT_THAT(parsed("optimovej(" + joints + ")\noptimovel(" + joints + ")\n").points, SizeIs(2));
}

TEST(UrScript, RefusesATextThatIsCutShort) {
  const std::string whole =
      "def go():\n  thread watch():\n    while (True):\n      if not (a[1] == 2):  # def (\n        sync()\n      elif "
      "b:\n        textmsg(\"if (\", [1, {2}])\n      end\n    end\n  end\n  sends = obj.end\n  movej(" +
      listed(kStart) + ")\nend\ngo()\n";
  EXPECT_THAT(parsed(whole).points, SizeIs(1));
  int cut = 0;
  for (std::size_t size = whole.find("go"); size < whole.rfind("end"); ++size) {
    cut +=
        testing::refusal([&] { parsed(whole.substr(0, size)); }).find("expected the whole program") != std::string::npos
            ? 1
            : 0;
  }
  EXPECT_EQ(cut, static_cast<int>(whole.rfind("end") - whole.find("go")));
  EXPECT_REFUSED("in.script:2: '[' has no ']', expected the whole program", parsed("movej(home)\nmovel(p[0,0,\n"));
  EXPECT_REFUSED("in.script:1: 'def' has no 'end', expected", parsed("def go():\n  if x:\n  end\n  movej(home)\n"));
  EXPECT_REFUSED("in.script:2: '(' has no ')' before the 'end' in line 3, expected",
                 parsed("def go():\n  movej((home)\nend\n"));
  EXPECT_REFUSED("in.script:2: 'end' ends nothing, expected the whole program", parsed("movej(home)\nend\n"));
  // Brackets are no members behind a point.
  EXPECT_REFUSED("in.script:2: '(' has no ')', expected the whole program",
                 parsed("movej(home)\nmovel(.(p[0,0,0,0,0,0])\n"));
  EXPECT_REFUSED("in.script:1: ')' ends nothing", parsed("movej(home))\n"));
}

// Half a turn of joint 6 from the point before, where the next turn, or the other wrist, is about as near.
TEST(UrScript, SaysWhereAnotherWayIsAboutAsNear) {
  const Calibration found = bent(1e-3);
  const std::string start = "movej(" + listed(kStart) + ")\n";
  const auto warnings = [&](const VectorXd& asked, const std::string& word) {
    return compensated(found, start + word + "(" + pose_text(controller_pose(asked)) + ")\n", flange_as_tool())
        .warnings;
  };
  VectorXd flipped = kStart;  // near the other wrist
  flipped[3] += 1.6;
  flipped[4] = 0.4;
  flipped[5] += 1.4;
  EXPECT_THAT(warnings(flipped, "movej"),
              ElementsAre(AllOf(HasSubstr("in.script:2: another way to a pose"), HasSubstr(" mm away"))));
  EXPECT_THAT(warnings(kEnd, "movej"), IsEmpty());
  EXPECT_THAT(warnings(kEnd, "movel"), IsEmpty());
}

TEST(ProgramLanguages, AreToldFromTheText) {
  const auto name = [](const std::string& text) {
    return std::string(language_of({.source = "in", .text = text}).name);
  };
  EXPECT_EQ(name("def a():\n  movej(x)\nend\n"), "URScript");
  EXPECT_EQ(name("/PROG  A\n/MN\n 1:  CALL movej(1) ;\n/POS\n/END\n"), "FANUC LS");
  EXPECT_REFUSED("in:1: begins with 'G00 X1', expected a program in one of these languages: FANUC LS (.LS), ",
                 name("G00 X1\n"));
  EXPECT_REFUSED(
      "in: is compressed, as a .urp of Universal Robots is, whose format is not documented, expected the "
      ".script",
      name("\x1f\x8b\x08"));
}

}  // namespace
}  // namespace kdl_calibration::ur_program_test
