// How far the tool leaves straight lines between compensated points: controllers of all languages, by KDL.

#include <gmock/gmock.h>

#include <fmt/args.h>
#include <fmt/core.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_nr.hpp>
#include <kdl/chainiksolvervel_pinv.hpp>
#include <memory>
#include <string>
#include <vector>

#include "kdl_calibration/calibrate.hpp"
#include "programs/compensation_support.hpp"
#include "programs/pose_numbers.hpp"
#include "support.hpp"

namespace kdl_calibration::straight_lines_test {
namespace {

using Eigen::AngleAxisd;
using Eigen::Isometry3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::by_kdl;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::kDegree;
using ::testing::SizeIs;

const Robot& arm() {
  static const Robot robot = testing::fanuc();
  return robot;
}

VectorXd joints(const std::array<double, 6>& degrees) {
  return Eigen::Map<const VectorXd>(degrees.data(), 6) * kDegree;
}

// Places along lines of 0.1 to 1.5 m that turn the tool by up to 80 degrees.
std::vector<VectorXd> places() {
  return {joints({-30, -20, 10, 20, -60, 15}), joints({25, 10, -25, 35, -45, -30}), joints({28, 8, -22, 30, -50, -30}),
          joints({-5, 25, 5, -40, -70, 60})};
}

Isometry3d tool_frame() {
  Isometry3d X_FT(AngleAxisd(0.7, Vector3d(1, 2, -1).normalized()));
  X_FT.translation() = Vector3d(0.11, -0.06, 0.32);
  return X_FT;
}

// A program that drives to the first place by joint values and then along straight lines, whose poses are those of the
// tool in the base.
struct Words {
  std::string head;
  std::string first;  // of six joint values [deg]
  std::string line;   // of the numbers of a pose
  std::string end;
};

// The shipped controller of the FANUC, which counts joints and places frames in its own way.
Controller controller_of(PointNotation notation) {
  if (notation != PointNotation::fixed_xyz) {
    return {};
  }
  Controller controller = read_controller(URDF_DIR "/fanuc_r2000ic_165f_controller.json");
  controller.frames.tool["7"] = controller.X_FP.inverse() * tool_frame();
  return controller;
}

Words words_of(PointNotation notation, const std::vector<double>& tool) {
  const auto list = [](const std::vector<double>& numbers) { return fmt::format("{:.7f}", fmt::join(numbers, ",")); };
  const std::string none = "[9E9,9E9,9E9,9E9,9E9,9E9]";
  if (notation == PointNotation::quaternion) {
    return {.head = "MODULE m\nPERS tooldata pen:=[TRUE,[[" + list({tool[0], tool[1], tool[2]}) + "],[" +
                    list({tool[3], tool[4], tool[5], tool[6]}) +
                    "]],[1,[0,0,1],[1,0,0,0],0,0,0]];\nPROC main()\nConfL \\Off;\n",
            .first = "MoveAbsJ [[{:.7f},{:.7f},{:.7f},{:.7f},{:.7f},{:.7f}]," + none + "],v100,fine,pen;\n",
            .line = "MoveL [[{:.7f},{:.7f},{:.7f}],[{:.10f},{:.10f},{:.10f},{:.10f}],[0,0,0,0]," + none +
                    "],v100,z10,pen;\n",
            .end = "ENDPROC\nENDMODULE\n"};
  }
  if (notation == PointNotation::moving_zyx) {
    return {.head = fmt::format(
                "DEF m()\n$BASE=$NULLFRAME\n$TOOL={{X {:.7f},Y {:.7f},Z {:.7f},A {:.7f},B {:.7f},C {:.7f}}}\n", tool[0],
                tool[1], tool[2], tool[3], tool[4], tool[5]),
            .first = "PTP {{A1 {:.7f},A2 {:.7f},A3 {:.7f},A4 {:.7f},A5 {:.7f},A6 {:.7f}}}\n",
            .line = "LIN {{X {:.7f},Y {:.7f},Z {:.7f},A {:.7f},B {:.7f},C {:.7f}}} C_DIS\n",
            .end = "END\n"};
  }
  return {.head = fmt::format("def m():\nset_tcp(p[{:.9f}])\n", fmt::join(tool, ",")),
          .first = "movej([{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f}])\n",
          .line = "movel(p[{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f}], r=0.01)\n",
          .end = "end\n"};
}

std::vector<double> numbers_of_pose(PointNotation notation, const Isometry3d& X) {
  PointNumbers old = PointNumbers::Zero(notation == PointNotation::quaternion ? 7 : 6);
  old[3] = notation == PointNotation::quaternion ? 1.0 : 0.0;
  const PointNumbers numbers = numbers_of(notation, X, old);
  std::vector<double> result(numbers.data(), numbers.data() + numbers.size());
  const bool is_ur = notation == PointNotation::rotation_vector;
  for (std::size_t i = 0; i < result.size(); ++i) {
    result[i] *= is_ur ? 1.0 : i < 3 ? 1e3 : notation == PointNotation::quaternion ? 1.0 : 1.0 / kDegree;
  }
  return result;
}

std::string filled(const std::string& form, const std::vector<double>& numbers) {
  fmt::dynamic_format_arg_store<fmt::format_context> arguments;
  for (const double number : numbers) {
    arguments.push_back(number);
  }
  return fmt::vformat(form, arguments);
}

std::string ls_program(const std::vector<VectorXd>& configurations) {
  std::string lines = "/PROG  T\n/MN\n";
  std::string positions = "/POS\n";
  for (std::size_t i = 0; i < configurations.size(); ++i) {
    lines += fmt::format("{:4}:{} P[{}] {} FINE    ;\n", i + 1, i == 0 ? "J" : "L", i + 1, i == 0 ? "9%" : "9mm/sec");
    const std::vector<double> n =
        numbers_of_pose(PointNotation::fixed_xyz, controller_of(PointNotation::fixed_xyz).X_BW.inverse() *
                                                      by_kdl(arm().chain, configurations[i]) * tool_frame());
    positions += fmt::format(
        "P[{}]{{\n   GP1:\n UF : 0, UT : 7, CONFIG : 'N U T, 0, 0, 0',\n X ={:.7f} mm, Y ={:.7f} mm, Z ={:.7f} mm,\n"
        " W ={:.7f} deg, P ={:.7f} deg, R ={:.7f} deg\n}};\n",
        i + 1, n[0], n[1], n[2], n[3], n[4], n[5]);
  }
  return lines + positions + "/END\n";
}

std::string program(PointNotation notation, const std::vector<VectorXd>& configurations) {
  if (notation == PointNotation::fixed_xyz) {
    return ls_program(configurations);
  }
  const Words words = words_of(notation, numbers_of_pose(notation, tool_frame()));
  std::string text = words.head;
  for (std::size_t i = 0; i < configurations.size(); ++i) {
    const double unit = notation == PointNotation::rotation_vector ? 1.0 : kDegree;
    const VectorXd shown = configurations[i] / unit;
    text += i == 0
                ? filled(words.first, {shown.data(), shown.data() + 6})
                : filled(words.line, numbers_of_pose(notation, by_kdl(arm().chain, configurations[i]) * tool_frame()));
  }
  return text + words.end;
}

Isometry3d between(const Isometry3d& a, const Isometry3d& b, double share) {
  Isometry3d X(Quaterniond(a.linear()).slerp(share, Quaterniond(b.linear())));
  X.translation() = a.translation() + share * (b.translation() - a.translation());
  return X;
}

// The nominal arm's tool on the straight line between two commands, at 300 places by KDL's inverse kinematics; the
// deviations of the true arm's tool from the line between the places that were meant.
LineDeviation driven(const KDL::Chain& true_chain, const std::array<VectorXd, 2>& commanded,
                     const std::array<VectorXd, 2>& meant) {
  constexpr int kPlaces = 300;
  const Isometry3d tool = tool_frame();
  const auto pose = [&](const KDL::Chain& chain, const VectorXd& q) { return Isometry3d(by_kdl(chain, q) * tool); };
  const std::array ends = {pose(arm().chain, meant[0]), pose(arm().chain, meant[1])};
  const Vector3d along = (ends[1].translation() - ends[0].translation()).normalized();
  KDL::ChainFkSolverPos_recursive forward(arm().chain);
  KDL::ChainIkSolverVel_pinv velocities(arm().chain);
  KDL::ChainIkSolverPos_NR solver(arm().chain, forward, velocities, 100, 1e-10);
  KDL::JntArray q(6);
  q.data = commanded[0];
  LineDeviation largest;
  for (int i = 1; i < kPlaces; ++i) {
    const double share = static_cast<double>(i) / kPlaces;
    const Isometry3d X =
        between(pose(arm().chain, commanded[0]), pose(arm().chain, commanded[1]), share) * tool.inverse();
    const KDL::JntArray seed = q;
    solver.CartToJnt(seed, to_kdl(X), q);
    EXPECT_LT((by_kdl(arm().chain, q.data).matrix() - X.matrix()).norm(), 1e-6);
    const Isometry3d reached = pose(true_chain, q.data);
    const Vector3d offset = reached.translation() - ends[0].translation();
    largest.position = std::max(largest.position, (offset - offset.dot(along) * along).norm());
    largest.orientation =
        std::max(largest.orientation,
                 AngleAxisd(between(ends[0], ends[1], share).linear().transpose() * reached.linear()).angle());
  }
  return largest;
}

TEST(StraightLines, AreLeftAsFarAsTheTrueArmLeavesThemInEveryLanguage) {
  int lines = 0;
  for (const std::uint64_t seed : {3U, 8U}) {
    const Calibration found = testing::bent(arm(), 3e-3, seed);
    const Compensator compensator(found);
    const KDL::Chain true_chain = found.urdf_chain();
    for (const PointNotation notation : {PointNotation::fixed_xyz, PointNotation::quaternion, PointNotation::moving_zyx,
                                         PointNotation::rotation_vector}) {
      const std::string text = program(notation, places());
      const Controller controller = controller_of(notation);
      const CompensatedProgram result = compensated_program({.robot = arm(),
                                                             .compensator = compensator,
                                                             .controller = controller,
                                                             .language = language_of({.source = "IN", .text = text})},
                                                            {{.source = "IN", .text = text}}, {}, 1e-6);
      ASSERT_THAT(result.positions, SizeIs(places().size())) << text;
      ASSERT_THAT(result.paths, SizeIs(places().size() - 1));
      EXPECT_EQ(result.lines, places().size() - 1);
      EXPECT_EQ(result.paths.front().deviation.position, result.largest_deviation.position);
      for (std::size_t i = 0; i + 1 < result.paths.size(); ++i) {
        EXPECT_GE(result.paths[i].deviation.position, result.paths[i + 1].deviation.position);
      }
      const std::size_t last_line =
          std::max_element(result.paths.begin(), result.paths.end(),
                           [](const PathDeviation& a, const PathDeviation& b) { return a.line < b.line; })
              ->line;
      for (const PathDeviation& path : result.paths) {
        const std::size_t k = places().size() - 2 - (last_line - path.line);
        const LineDeviation expected =
            driven(true_chain, {result.positions[k].point.joint_values, result.positions[k + 1].point.joint_values},
                   {places()[k], places()[k + 1]});
        // The place of the largest deviation is met to half a step.
        EXPECT_NEAR(path.deviation.position, expected.position, 0.03 * expected.position + 2e-7);
        EXPECT_NEAR(path.deviation.orientation, expected.orientation, 0.01 * expected.orientation + 1e-6);
        EXPECT_GT(expected.position, 1e-6);
        ++lines;
      }
    }
  }
  EXPECT_EQ(lines, 2 * 4 * 3);
}

// Joint 1 turns by e more than it is told. A line across the front from -a to a, at the distance r from axis 1, is
// commanded from -a/(1 + e) to a/(1 + e). Its middle stays in front: r (cos(a/(1 + e)) - cos(a)) beyond the line.
TEST(StraightLines, AreBentByTheGainOfTheFirstJoint) {
  constexpr double kGain = 2e-3;
  constexpr double kAngle = 30.0;
  CalibrationParts parts;
  parts.model = complete_model(arm());
  parts.model.effects.push_back({.name = "gain.1", .joint = arm().joints[0].name, .index = 0, .function = JointGain{}});
  parts.estimate.errors = parts.urdf_errors = VectorXd::Zero(static_cast<Eigen::Index>(parts.model.parameters.size()));
  parts.estimate.effects = VectorXd::Constant(1, kGain);
  parts.verdict = Verdict::trusted;
  const Calibration found(std::make_shared<CalibrationParts>(parts));
  const std::string text = fmt::format(
      "MODULE m\nPROC main()\nMoveAbsJ [[{0},-20,10,0,-60,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\n"
      "MoveL [[0,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\nENDPROC\nENDMODULE\n",
      -kAngle);
  const VectorXd last = joints({kAngle, -20, 10, 0, -60, 0});
  const std::vector<double> pose = numbers_of_pose(PointNotation::quaternion, by_kdl(arm().chain, last));
  std::string with_pose = text;
  with_pose.replace(with_pose.find("MoveL [[0,0,0],[1,0,0,0],[0,0,0,0]"), 34,
                    filled("MoveL [[{:.7f},{:.7f},{:.7f}],[{:.10f},{:.10f},{:.10f},{:.10f}],[0,0,0,0]", pose));
  with_pose.insert(with_pose.find("MoveAbsJ"), "ConfL \\Off;\n");
  const Compensator compensator(found);
  const Controller controller;
  const auto of = [&](double tolerance) {
    return compensated_program({.robot = arm(),
                                .compensator = compensator,
                                .controller = controller,
                                .language = language_of({.source = "IN", .text = with_pose})},
                               {{.source = "IN", .text = with_pose}}, {}, tolerance);
  };
  const double radius = by_kdl(arm().chain, joints({0, -20, 10, 0, -60, 0})).translation().head<2>().norm();
  const double expected = radius * (std::cos(kAngle * kDegree / (1.0 + kGain)) - std::cos(kAngle * kDegree));
  EXPECT_GT(expected, 0.5e-3);
  const CompensatedProgram result = of(0.9 * expected);
  ASSERT_THAT(result.paths, SizeIs(1));
  EXPECT_EQ(result.paths.front().line, 5U);
  EXPECT_NEAR(result.paths.front().deviation.position, expected, 0.01 * expected);
  EXPECT_THAT(of(1.1 * expected).paths, SizeIs(0));
}

// A joint zero of the first axis turns all lines about it: they stay straight.
TEST(StraightLines, StayStraightUnderAnErrorThatMovesTheWholeArm) {
  const ErrorModel model = complete_model(arm());
  const Calibration found = testing::calibration_of(model, testing::errors_of(model, {{"dq1", 0.01}, {"Tz0", 0.004}}));
  const std::string text = program(PointNotation::moving_zyx, places());
  const CompensatedProgram result =
      testing::compensated(arm(), Compensator(found), {}, {{.source = "IN", .text = text}});
  EXPECT_EQ(result.lines, 3U);
  EXPECT_LT(result.largest_deviation.position, 1e-8);
  EXPECT_LT(result.largest_deviation.orientation, 1e-7);
}

// '-' joints, '|' a straight line, '(' a circle or a spline.
std::string kinds(const std::string& text) {
  const ProgramText program{.source = "IN", .text = text};
  std::string result;
  for (const ProgramMotion& motion : language_of(program).parse({program}).motions) {
    result += !motion.is_straight ? '-' : motion.is_curved ? '(' : '|';
  }
  return result;
}

TEST(StraightLines, AreNotThoseOfCirclesAndSplines) {
  const std::string position =
      "{\n GP1:\n UF : 0, UT : 0,\n J1=0 deg, J2=0 deg, J3=0 deg,\n J4=0 deg, J5=9 deg, J6=0 deg\n};\n";
  EXPECT_EQ(kinds("/PROG  T\n/MN\n 1:J P[1] 9% FINE ;\n 2:L P[2] 9mm/sec FINE ;\n 3:C P[1] \n : P[2] 9mm/sec FINE ;\n"
                  " 4:A P[1] 9mm/sec FINE ;\n 5:S P[2] 9mm/sec FINE ;\n/POS\nP[1]" +
                  position + "P[2]" + position + "/END\n"),
            "-|((((");
  const std::string target = "[[1,2,3],[1,0,0,0],[0,0,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]";
  EXPECT_EQ(kinds("MODULE m\nPROC main()\nMoveJ " + target + ",v9,fine,tool0;\nMoveL " + target +
                  ",v9,z1,tool0;\nMoveC " + target + "," + target + ",v9,z1,tool0;\nENDPROC\nENDMODULE\n"),
            "-|((");
  const std::string pose = " {X 1,Y 2,Z 3,A 0,B 0,C 0}";
  EXPECT_EQ(kinds("DEF m()\nPTP" + pose + "\nLIN" + pose + "\nSLIN" + pose + "\nCIRC" + pose + "," + pose +
                  "\nSPLINE\nSPL" + pose + "\nENDSPLINE\nEND\n"),
            "-||(((");
  const std::string script =
      "def m():\nmovej([0,-1,1,0,1,0])\nmovel([0.1,-1,1,0,1,0])\nmovep([0.2,-1,1,0,1,0])\n"
      "movec([0.3,-1,1,0,1,0],[0.4,-1,1,0,1,0])\nend\n";
  EXPECT_EQ(kinds(script), "-||((");
  const CompensatedProgram result =
      testing::compensated(arm(), Compensator(testing::bent(arm(), 1e-3, 3)), {}, {{.source = "IN", .text = script}});
  EXPECT_EQ(result.lines, 2U);
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("IN:5: moves along a circle or spline")));
}

}  // namespace
}  // namespace kdl_calibration::straight_lines_test
