#include <gmock/gmock.h>

#include <fmt/core.h>
#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <kdl/chainiksolverpos_lma.hpp>
#include <memory>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/simulation.hpp"
#include "model/error_chains.hpp"
#include "programs/compensation_support.hpp"
#include "programs/ls_program.hpp"
#include "programs/wrist_arm.hpp"
#include "refusal.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"

namespace kdl_calibration::programs_test {
namespace {

using Eigen::AngleAxisd;
using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using ::testing::AllOf;
using testing::by_kdl;
using testing::calibration_of;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using testing::kDegree;
using ::testing::SizeIs;
using ::testing::StartsWith;

const Robot& fanuc() {
  static const Robot robot = testing::fanuc();
  return robot;
}

const Controller& controller() {
  static const Controller shipped = read_controller(URDF_DIR "/fanuc_r2000ic_165f_controller.json");
  return shipped;
}

Calibration bent(double size) { return testing::bent(fanuc(), size, 3); }

using Numbers = std::array<double, 6>;

// A pose, and joint values that bring a point 55 mm in front of the faceplate there.
constexpr Numbers kPose = {1500, 0, 360, 135, -45, 0};
constexpr Numbers kAtPose = {7.962, -5.284, -36.250, 77.661, -51.975, -79.273};

std::string cartesian(int number, const std::string& frames, const std::string& configuration, const Numbers& n) {
  return fmt::format(
      "P[{}]{{\n   GP1:\n\t{},\t\tCONFIG : '{}',\n\tX ={:10.3f}  mm,\tY ={:10.3f}  mm,\tZ ={:10.3f}  mm,\n"
      "\tW ={:10.3f} deg,\tP ={:10.3f} deg,\tR ={:10.3f} deg\n}};\n",
      number, frames, configuration, n[0], n[1], n[2], n[3], n[4], n[5]);
}

std::string joints(int number, const Numbers& n) {
  return fmt::format(
      "P[{}]{{\n   GP1:\n\tUF : 3, UT : 9,\t\n\tJ1={:10.3f} deg,\tJ2={:10.3f} deg,\tJ3={:10.3f} deg,\n"
      "\tJ4={:10.3f} deg,\tJ5={:10.3f} deg,\tJ6={:10.3f} deg\n}};\n",
      number, n[0], n[1], n[2], n[3], n[4], n[5]);
}

std::string program(const std::string& positions, const std::string& lines = "   1:J P[1] 100% FINE    ;\n") {
  return "/PROG  TEST\n/ATTR\nCOMMENT\t\t= \"\";\n/APPL\n/MN\n" + lines + "/POS\n" + positions + "/END\n";
}

std::string with_crlf(const std::string& text) {
  std::string result;
  for (const char c : text) {
    result += c == '\n' ? "\r\n" : std::string(1, c);
  }
  return result;
}

CompensatedProgram compensated(const Calibration& calibration, const std::string& text,
                               const ProgramFrames& frames = {}) {
  Controller with_frames = controller();
  with_frames.frames = frames;
  return testing::compensated(fanuc(), Compensator(calibration), with_frames, {{.source = "IN.LS", .text = text}});
}

Program parsed(const std::string& text, const std::string& source) {
  return fanuc_ls().parse({{.source = source, .text = text}});
}

Numbers values_of(const ProgramPoint& position) {
  Numbers values{};
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = position.fields[i].value;
  }
  return values;
}

// The controller's pose of the faceplate in the world, written out: the world stands 0.67 m above the base with x along
// the base's y; at zero the faceplate's z points along the world's x and its x upwards.
Isometry3d flange_of(const Numbers& n, const Isometry3d& user = Isometry3d::Identity(),
                     const Isometry3d& tool = Isometry3d::Identity()) {
  Isometry3d pose = Isometry3d::Identity();
  pose.translation() = 1e-3 * Vector3d(n[0], n[1], n[2]);
  pose.linear() = (AngleAxisd(n[5] * kDegree, Vector3d::UnitZ()) * AngleAxisd(n[4] * kDegree, Vector3d::UnitY()) *
                   AngleAxisd(n[3] * kDegree, Vector3d::UnitX()))
                      .toRotationMatrix();
  Isometry3d world = Isometry3d::Identity();
  world.translation().z() = 0.67;
  world.linear() = AngleAxisd(90.0 * kDegree, Vector3d::UnitZ()).toRotationMatrix();
  Isometry3d faceplate = Isometry3d::Identity();
  faceplate.linear().col(0) = Vector3d::UnitZ();
  faceplate.linear().col(1) = Vector3d::UnitX();
  faceplate.linear().col(2) = Vector3d::UnitY();
  return world * user * pose * (faceplate * tool).inverse();
}

VectorXd urdf_joints(const Numbers& j) {
  return (VectorXd(6) << j[0], -j[1], j[2] + j[1], -j[3], j[4], -j[5]).finished() * kDegree;
}

double distance(const Isometry3d& a, const Isometry3d& b) {
  return std::max((a.translation() - b.translation()).norm(), AngleAxisd(a.linear().transpose() * b.linear()).angle());
}

// ---- The arm -------------------------------------------------------------------------------------------------------

TEST(WristArm, FindsEverySolutionOfAPose) {
  const WristArm arm(fanuc(), SixJoints::Zero());
  Random random(7);
  const Eigen::MatrixXd drawn = random_configurations(limits_of(fanuc().joints), 500, random);
  for (const auto& q : drawn.colwise()) {
    const Isometry3d X_BF = by_kdl(fanuc().chain, q);
    const ArmSolutions found = arm.solve(X_BF);
    double nearest = 10.0;
    for (const SixJoints& solution : found.joint_values) {
      EXPECT_LT(distance(by_kdl(fanuc().chain, solution), X_BF), 1e-8);
      double largest = 0.0;
      for (Eigen::Index i = 0; i < 6; ++i) {
        largest = std::max(largest, std::abs(std::remainder(solution[i] - q[i], 2.0 * std::numbers::pi)));
      }
      nearest = std::min(nearest, largest);
    }
    EXPECT_LT(nearest, 1e-6);
    EXPECT_THAT(found.joint_values.size(), ::testing::AnyOf(4U, 8U));
    std::vector<std::array<bool, 3>> postures;
    for (const SixJoints& solution : found.joint_values) {
      const ArmPosture posture = arm.posture(solution);
      const std::array<bool, 3> own = {posture.front, posture.elbow_up, solution[4] > 0.0};
      EXPECT_EQ(std::count(postures.begin(), postures.end(), own), 0);
      postures.push_back(own);
    }
  }
}

TEST(WristArm, RefusesAnArmOfAnotherBuild) {
  const Robot without_flange = parse_robot(R"(<robot name="r"><link name="a"/><link name="b"/>
    <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>)");
  EXPECT_THAT(testing::refusal([&] { WristArm(without_flange, SixJoints::Zero()); }),
              HasSubstr("expected six revolute joints, axes 2 and 3 parallel"));
}

// ---- The controller's conventions ----------------------------------------------------------------------------------

// Joint values and pose of an R-2000iB/165F, which has the same links, with both wrists: J. Strybis, "The Perils of
// Six-Axis Robots", 2013. The pose is that of a point 55 mm in front of the faceplate.
TEST(FanucController, HasThePublishedPosesOfJointValues) {
  const Isometry3d X_BF = flange_of(kPose) * Eigen::Translation3d(0.0, -0.055, 0.0);
  const Numbers flip = {7.962, -5.284, -36.250, -102.339, 51.975, 100.727};
  for (const Numbers& j : {kAtPose, flip}) {
    EXPECT_LT(distance(by_kdl(fanuc().chain, urdf_joints(j)), X_BF), 4e-5);
  }
  const WristArm arm(fanuc(), SixJoints::Zero());
  EXPECT_EQ(arm.posture(urdf_joints(kAtPose)), ArmPosture());
  EXPECT_EQ(arm.posture(urdf_joints(flip)), ArmPosture());
  // The pose with its CONFIG stands for these joint values: both are compensated alike.
  ProgramFrames frames;
  frames.tool["1"] = Eigen::Translation3d(0.0, 0.0, 0.055) * Isometry3d::Identity();
  const Calibration found = bent(1e-4);
  for (const auto& [configuration, j] : {std::pair{"N U T, 0, 0, 0", kAtPose}, std::pair{"F U T, 0, 0, 0", flip}}) {
    const CompensatedProgram of_pose =
        compensated(found, program(cartesian(1, "UF : 0, UT : 1", configuration, kPose)), frames);
    const CompensatedProgram of_joints = compensated(found, program(joints(1, j)));
    EXPECT_LT((of_pose.positions.front().change - of_joints.positions.front().change).norm(), 1e-7);
  }
}

TEST(FanucController, StandsAtTheKnownPoseWithAllJointsZero) {
  EXPECT_LT(distance(by_kdl(fanuc().chain, VectorXd::Zero(6)), flange_of({1807, 0, 1300, 180, -90, 0})), 1e-12);
  const Isometry3d shipped =
      controller().X_BW *
      frame_of_xyzwpr((SixJoints() << 1.807, 0, 1.3, std::numbers::pi, -0.5 * std::numbers::pi, 0).finished()) *
      controller().X_FP.inverse();
  EXPECT_LT(distance(shipped, flange_of({1807, 0, 1300, 180, -90, 0})), 1e-12);
}

// A controller writes the group on a line of its own, and other variables before the frames.
TEST(FanucController, ReadsFramesOfABackup) {
  const std::string text =
      "[*SYSTEM*]$CELL_GRP  Storage: SHADOW  Access: RW  : ARRAY[1] OF CELL_GRP_T\n"
      "     Field: $CELL_GRP[1].$MOUNT_LOC Access: RW: POSITION = \n  Group: 1   Config: N D B, 0, 0, 0\n"
      "  X:     0.000   Y:     0.000   Z:   670.000\n  W:     0.000   P:     0.000   R:     0.000\n"
      "     Field: $CELL_GRP[1].$AUX_ORDER  ARRAY[1] OF INTEGER\n      [1] = Uninitialized\n\n"
      "[*SYSTEM*]$MNUFRAME  Storage: CMOS  Access: RW  : ARRAY[2,9] OF POSITION\n"
      "    [1,1] = \n  Group: 1   Config: N D B, 0, 0, 0\n  X:  1500.000   Y:  -250.500   Z:   300.000\n"
      "  W:     0.000   P:      .000   R:    90.000\n    [1,3] = Uninitialized\n"
      "     [1,2] =   Group: 1   Config: N D B, 0, 0, 0\n  X: ********   Y: ********   Z: ********\n"
      "  W: ********   P: ********   R: ********\n"
      "     [2,1] =   Group: 2   Config: N D B, 0, 0, 0\n  X:     1.000   Y:     0.000   Z:     0.000\n"
      "  W:     0.000   P:     0.000   R:     0.000\n\n"
      "[*SYSTEM*]$MNUFRAMENUM  Storage: CMOS  Access: RW  : ARRAY[2] OF BYTE\n     [1] = 1\n"
      "[*SYSTEM*]$MNUTOOL  Storage: CMOS  Access: RW  : ARRAY[2,10] OF POSITION\r\n"
      "     [1,4] =   Group: 1   Config: N D B, 0, 0, 0\r\n  X:     0.000   Y:     0.000   Z:   125.000\r\n"
      "  W:     0.000   P:   -90.000   R:     0.000\r\n";
  const std::filesystem::path file = std::filesystem::path(::testing::TempDir()) / "SYSFRAME.VA";
  std::ofstream(file) << text;
  const ProgramFrames frames = read_program_frames(file, fanuc_ls());
  ASSERT_THAT(frames.user, SizeIs(1));
  ASSERT_THAT(frames.tool, SizeIs(1));
  EXPECT_LT((frames.user.at("1") * Vector3d(0.01, 0.0, 0.0) - Vector3d(1.5, -0.2405, 0.3)).norm(), 1e-12);
  EXPECT_LT((frames.tool.at("4") * Vector3d(0.0, 0.0, 0.01) - Vector3d(-0.01, 0.0, 0.125)).norm(), 1e-12);
}

// ---- Programs ------------------------------------------------------------------------------------------------------

TEST(LsProgram, ComesBackByteForByteWithoutErrors) {
  const std::string pose = cartesian(1, "UF : 0, UT : 0", "N U T, 0, 0, 0", kPose);
  const std::string bent_arm = joints(2, {10.5, -20.25, 5, 170, -60, -190});
  std::string hand_written = pose;
  hand_written.replace(hand_written.find("     0.000"), 10, "     -.000");
  std::string second_group = bent_arm;
  second_group.insert(second_group.find("};"), "   GP2:\n\tUF : 0, UT : 1,\t\n\tJ1=   100.000  mm\n");
  const std::string comment = "P[7:\"a]{ GP1: \"]" + bent_arm.substr(4);
  const std::string straight_down =
      cartesian(4, "UF : 2, UT : 1", "F U T, 0, -1, 0", {100, -20.5, .25, -180, 90, 12.5});
  ProgramFrames frames;
  frames.user["2"] = Eigen::Translation3d(1.5, 0.2, -0.3) * Isometry3d::Identity();
  frames.tool["1"] = Eigen::Translation3d(0.0, 0.0, 0.125) * Isometry3d::Identity();
  const Calibration exact = bent(0.0);
  EXPECT_EQ(compensated(exact, program(pose) + "\x1a").texts.front(), program(pose) + "\x1a");
  for (const std::string& positions :
       {std::string(), pose, bent_arm, hand_written, second_group, comment, straight_down, pose + bent_arm + comment}) {
    for (const std::string& text : {program(positions), with_crlf(program(positions))}) {
      EXPECT_EQ(compensated(exact, text, frames).texts.front(), text);
    }
  }
}

TEST(LsProgram, BringsTheCalibratedArmWhereTheNominalOneWouldBe) {
  const Calibration found = bent(1e-3);
  const KDL::Chain calibrated = found.urdf_chain();
  Random random(5);
  const std::vector<Numbers> drawn = {
      kAtPose, {-150, 30, -10, 20, 70, 200}, {45, -40, 20, -190, -30, 10}, {100, 60, -60, 5, 95, -300}};
  std::string positions;
  std::vector<Isometry3d> asked;
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    positions += joints(static_cast<int>(i) + 1, drawn[i]);
    asked.push_back(by_kdl(fanuc().chain, urdf_joints(drawn[i])));
  }
  const CompensatedProgram program_of_joints = compensated(found, program(positions));
  const Program written = parsed(program_of_joints.texts.front(), "OUT.LS");
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    const VectorXd q = urdf_joints(values_of(written.points[i]));
    EXPECT_LT(distance(by_kdl(calibrated, q), asked[i]), 5e-5);
    EXPECT_GT(distance(by_kdl(calibrated, urdf_joints(drawn[i])), asked[i]), 1e-3);
    EXPECT_EQ(program_of_joints.positions[i].point.status, CompensationStatus::exact);
  }
  EXPECT_GT(program_of_joints.rounding, 5e-6);
  EXPECT_LT(program_of_joints.rounding, 5e-5);
}

// The controller finds joint values for a commanded pose with its nominal arm: KDL's solver stands for it.
TEST(LsProgram, CommandsPosesThatTheControllerTurnsIntoTheRightOnes) {
  const Calibration found = bent(1e-3);
  const KDL::Chain calibrated = found.urdf_chain();
  const CompensatedProgram result =
      compensated(found, program(cartesian(1, "UF : 0, UT : 0", "N U T, 0, 0, 0", kPose)));
  const Numbers commanded = values_of(parsed(result.texts.front(), "OUT.LS").points.front());
  KDL::ChainIkSolverPos_LMA controller_ik(fanuc().chain, Eigen::Matrix<double, 6, 1>::Ones(), 1e-12);
  KDL::JntArray seed(6);
  seed.data = urdf_joints(kAtPose);
  KDL::JntArray q(6);
  ASSERT_GE(controller_ik.CartToJnt(seed, to_kdl(flange_of(commanded)), q), 0);
  EXPECT_LT(distance(by_kdl(calibrated, q.data), flange_of(kPose)), 3e-5);
  EXPECT_GT(distance(by_kdl(calibrated, urdf_joints(kAtPose)), flange_of(kPose)), 1e-3);
}

TEST(LsProgram, WritesAnglesOfAPoseWithinHalfATurn) {
  const CompensatedProgram result = compensated(
      bent(1e-3), program(cartesian(1, "UF : 0, UT : 0", "N U T, 0, 0, 0", {1500, 0, 360, 179.999, -45, 0}) +
                          cartesian(2, "UF : 0, UT : 0", "N U T, 0, 0, 0", {1500, 0, 360, -179.999, -45, 0})));
  for (const CompensatedPosition& position : result.positions) {
    EXPECT_TRUE(position.written) << position.name;
  }
  const std::vector<ProgramPoint> commanded = parsed(result.texts.front(), "OUT.LS").points;
  EXPECT_LE(std::abs(values_of(commanded[0])[3]), 180.0);
  EXPECT_NEAR(values_of(commanded[0])[3], values_of(commanded[1])[3], 0.01);
}

TEST(LsProgram, ReadsAPositionAtWhichTheControllerStands) {
  const std::string positions = joints(1, kAtPose) + joints(2, kAtPose);
  const std::string lines = "   1:J @P[1] 100% FINE    ;\n   2:L @P[2] 50mm/sec FINE INC    ;\n";
  const CompensatedProgram result = compensated(bent(1e-3), program(positions, lines));
  EXPECT_THAT(result.positions, SizeIs(1));
  EXPECT_THAT(result.texts.front(), HasSubstr(joints(2, kAtPose)));
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("IN.LS:7: INC makes a position an increment")));
  const std::string coordinated = "   1:L P[1] 50mm/sec FINE COORD[2]    ;\n";
  EXPECT_THAT(compensated(bent(1e-3), program(joints(1, kAtPose), coordinated)).warnings,
              ElementsAre(HasSubstr("IN.LS:6: COORD moves relative to another motion group")));
}

// Which position is the increment, the controller finds at run time.
TEST(LsProgram, LeavesPositionsThatMayBeIncrements) {
  const std::string positions = joints(1, kAtPose) + joints(2, kAtPose);
  const std::string step = "   1:J P[1] 100% FINE    ;\n   2:L P[R[1]] 50mm/sec FINE INC    ;\n";
  const CompensatedProgram result = compensated(bent(1e-3), program(positions, step));
  ASSERT_THAT(result.positions, SizeIs(1));
  EXPECT_EQ(result.positions.front().name, "P[1]");
  EXPECT_THAT(result.texts.front(), HasSubstr(joints(2, kAtPose)));
  EXPECT_THAT(result.warnings,
              ElementsAre(HasSubstr("IN.LS:7: P[R[...]] holds a place"),
                          HasSubstr("IN.LS:7: INC makes a position that is known at run time only an increment"),
                          HasSubstr("IN.LS:15: positions that INC may take as increments at run time")));
  for (const std::string& others :
       {step + "   3:L P[2] 50mm/sec FINE    ;\n", std::string("   1:L P[R[1]] 50mm/sec FINE    ;\n"),
        std::string("   1:L PR[1] 50mm/sec FINE INC    ;\n")}) {
    EXPECT_THAT(compensated(bent(1e-3), program(positions, others)).positions, SizeIs(2)) << others;
  }
  const std::string circle = "   1:C P[1]\n    :  P[AR[2]] 50mm/sec FINE INC    ;\n";
  EXPECT_THAT(compensated(bent(1e-3), program(positions, circle)).positions, SizeIs(0));
}

TEST(LsProgram, ChoosesTheTurnsOfTheConfiguration) {
  const Calibration found = bent(1e-3);
  // J4 = 77.661 and J6 = -79.273 without a turn; each also within its limits of +-360 with one.
  const auto change = [&](const std::string& configuration) {
    const CompensatedProgram result = compensated(found, program(cartesian(1, "UF : 0, UT : 0", configuration, kPose)));
    return result.positions.front().change;
  };
  EXPECT_LT((change("N U T, 0, -1, 1") - change("N U T, 0, 0, 0")).norm(), 1e-9);
  // A turn of J1 is beyond its limits of +-185 degrees.
  const std::string beyond = program(cartesian(1, "UF : 0, UT : 0", "N U T, 1, 0, 0", kPose));
  const CompensatedProgram result = compensated(found, beyond);
  EXPECT_EQ(result.positions.front().point.status, CompensationStatus::out_of_limits);
  EXPECT_EQ(result.texts.front(), beyond);
}

TEST(LsProgram, WarnsOfAStraightMotionIntoAnotherConfiguration) {
  const auto warnings = [&](const std::string& motion, const std::string& configuration) {
    const std::string text = program(
        joints(1, {0, -5, -36, 78, -52, -79}) + cartesian(2, "UF : 0, UT : 0", configuration, kPose),
        "   1:J P[1] 100% FINE    ;\n   2:" + motion + " P[2] 50mm/sec FINE    ;\n   3:L P[2] 50mm/sec FINE    ;\n");
    return compensated(bent(1e-4), text).warnings;
  };
  EXPECT_THAT(warnings("L", "N U T, 0, 0, 0"), SizeIs(0));
  EXPECT_THAT(warnings("J", "F U T, 0, 0, 0"), SizeIs(0));
  EXPECT_THAT(warnings("L", "F U T, 0, 0, 0"),
              ElementsAre(AllOf(StartsWith("IN.LS:7: a motion along a path ends in another configuration"),
                                EndsWith("stated"))));
}

TEST(LsProgram, LeavesAPositionAloneThatWouldChangeItsConfiguration) {
  const ErrorModel model = complete_model(fanuc());
  const VectorXd errors = testing::errors_of(model, {{"dq5", 0.01}});
  // The wrist at 0.1 degrees: an offset of 0.57 degrees puts it on the other side of zero.
  const SixJoints near = (SixJoints() << 0.3, 0.2, 0.1, 0.4, 0.1 * kDegree, 0.2).finished();
  const Isometry3d pose = controller().X_BW.inverse() * by_kdl(fanuc().chain, near) * controller().X_FP;
  const SixJoints n = xyzwpr_of(pose, SixJoints::Zero());
  const Numbers numbers = {n[0] * 1e3, n[1] * 1e3, n[2] * 1e3, n[3] / kDegree, n[4] / kDegree, n[5] / kDegree};
  const std::string text = program(cartesian(1, "UF : 0, UT : 0", "F U T, 0, 0, 0", numbers));
  const CompensatedProgram result = compensated(calibration_of(model, errors), text);
  EXPECT_EQ(result.positions.front().point.status, CompensationStatus::branch_changed);
  EXPECT_FALSE(result.positions.front().written);
  EXPECT_EQ(result.texts.front(), text);
}

TEST(LsProgram, WarnsOfWhatIsKnownAtRunTimeOnlyAndOfPaths) {
  const std::string lines =
      "   1:J P[1] 100% FINE    ;\n   2:L P[2] 500mm/sec CNT50 Offset,PR[1]    ;\n   3:L PR[4] 500mm/sec FINE    ;\n"
      "   4:L P[R[5]] 500mm/sec FINE    ;\n   5:  PR[3,1]=10    ;\n   6:L P[4] R[1:INC]mm/sec FINE INC    ;\n"
      "   7:L P[3:Offset INC] R[2:an INC ]mm/sec FINE    ;\n   8:C P[1]    \n    :  P[2] 500mm/sec FINE "
      "Tool_Offset,PR[2]    ;\n"
      "   9:L P[1] 500mm/sec FINE    ;\n  10:L P[2] 500mm/sec FINE    ;\n";
  const std::string increment = cartesian(4, "UF : 1, UT : 2", "N D B, 0, 0, 0", {0, 0, 7, 0, 0, 0});
  const std::string positions = joints(1, {0, -30, 0, 10, -50, 10}) + joints(2, {60, 20, -20, 10, -50, 10}) +
                                joints(3, {0, -29, 0, 10, -50, 10}) + increment;
  const CompensatedProgram result = compensated(bent(3e-3), program(positions, lines));
  EXPECT_THAT(result.warnings,
              ElementsAre(HasSubstr("IN.LS:7: Offset moves positions"), HasSubstr("IN.LS:8: PR[...] holds"),
                          HasSubstr("IN.LS:9: P[R[...]]"), HasSubstr("IN.LS:11: INC makes a position an increment"),
                          HasSubstr("IN.LS:14: Tool_Offset")));
  // An increment is no pose: it stays as it is, even if no joint values reach it.
  EXPECT_THAT(result.positions, SizeIs(3));
  EXPECT_THAT(result.texts.front(), HasSubstr(increment));
  ASSERT_THAT(result.paths, SizeIs(1));  // line 10 of the program alone: the others are short, or start nowhere
  EXPECT_EQ(result.paths.front().line, 16U);
  EXPECT_EQ(result.paths.front().from, "P[1]");
  EXPECT_EQ(result.paths.front().to, "P[2]");
}

// A statement ends at its semicolon, which may stand on a line without a number.
TEST(LsProgram, ReadsAMotionUpToItsSemicolon) {
  const std::string positions = joints(1, {0, -30, 0, 10, -50, 10}) + joints(2, {60, 20, -20, 10, -50, 10});
  const auto of = [&](const std::string& lines) { return compensated(bent(3e-3), program(positions, lines)); };
  for (const std::string end : {" INC    ;\n", "\n    :  INC    ;\n", "\r\n    :  PTH ACC80\r\n    :  INC;\r\n"}) {
    const CompensatedProgram result = of("   1:J P[1] 100% FINE    ;\n   2:L P[2] 9mm/sec FINE" + end);
    EXPECT_THAT(result.warnings, ElementsAre(HasSubstr(": INC makes a position an increment"))) << end;
    EXPECT_THAT(result.texts.front(), HasSubstr(joints(2, {60, 20, -20, 10, -50, 10}))) << end;
    EXPECT_THAT(result.positions, SizeIs(1));
  }
  // Whatever else the motion has.
  for (const std::string options : {"INC Offset,PR[1]", "Offset,PR[1] INC"}) {
    const CompensatedProgram result = of("   1:J P[1] 100% FINE    ;\n   2:L P[2] 9mm/sec FINE " + options + "    ;\n");
    EXPECT_THAT(result.texts.front(), HasSubstr(joints(2, {60, 20, -20, 10, -50, 10}))) << options;
    EXPECT_THAT(result.positions, SizeIs(1)) << options;
  }
  // A bracket that does not close hides no semicolon at a line's end.
  EXPECT_THAT(of("    :  !as PR[5 ;\r\n    :J P[1] 100% FINE INC    ;\n").warnings,
              ElementsAre(StartsWith("IN.LS:7: INC makes a position an increment")));
  const std::string whole =
      "   1:J P[1] 100% CNT5 ACC80 TB .05sec,DO[1:INC]=ON    ;\n   2:L P[2] 9mm/sec FINE PTH\n    :  Skip,LBL[1: INC ;]"
      "    ; ! INC\n    :  INC    ;\n   3:  !L P[1] INC    ;\n   4:  //L P[1] 9mm/sec FINE INC    ;\n";
  const CompensatedProgram result = of(whole);
  EXPECT_THAT(result.warnings, SizeIs(0));
  EXPECT_THAT(result.positions, SizeIs(2));
  ASSERT_THAT(result.paths, SizeIs(1));
  EXPECT_EQ(result.paths.front().line, 7U);
}

TEST(LsProgram, SaysWhatTheControllerDecidesAtRunTime) {
  const std::string positions = joints(1, {0, -30, 0, 10, -50, 10}) + joints(2, {60, 20, -20, 10, -50, 10});
  const Calibration found = bent(3e-3);
  const auto of = [&](const std::string& lines, const std::string& head = "") {
    std::string text = program(positions, lines);
    return compensated(found, text.insert(text.find("/MN"), head));
  };
  // Statement, the warning's beginning, and words that say what becomes of it.
  const std::vector<std::array<std::string, 3>> cases = {
      {"UFRAME[2]=PR[5]", "UFRAME[...] is set at run time", "the frame of --frames"},
      {"UTOOL[1:gun = 2] = PR[5]", "UTOOL[...] is set at run time", "the frame of --frames"},
      {"UFRAME_NUM=R[3]", "UFRAME_NUM is chosen at run time", "their own UF and UT"},
      {"IF (R[1:a]=2),UTOOL_NUM=AR[1]", "UTOOL_NUM is chosen", "their own UF and UT"},
      {"BENUTZER_NUM=R[3]", "BENUTZER_NUM is chosen", "their own UF and UT"},
      {"WKZ_NUM=R[3]", "WKZ_NUM is chosen", "their own UF and UT"},
      {"PR[9:a=b]=P[2]", "PR[...]=P[...] puts a compensated position into a register", "use that"},
      {"PR[R[1]]=PR[2]-P[R[1]]", "PR[...]=P[...] puts", "use that"},
      {"L PAL_1[BTM] 100mm/sec FINE", "PAL_n[...] holds a place", "not compensated"},
      {"J PR[GP1:5] 10% FINE", "PR[...] holds a place", "not compensated"},
      {"JP[AR[1]] 10% FINE", "P[AR[...]] holds a place", "not compensated"},
      {"L P[2] 9mm/sec FINE COORD PTH", "COORD moves relative", "path between them is not checked"},
      {"L P[2] 9mm/sec CNT100 RTCP", "RTCP moves relative", "path between them is not checked"}};
  for (const auto& [statement, warning, consequence] : cases) {
    const CompensatedProgram result =
        of("   1:J P[1] 100% FINE    ;\n   2:  " + statement + " ;\n   3:J P[1] 100% FINE    ;\n");
    EXPECT_THAT(result.warnings, ElementsAre(AllOf(StartsWith("IN.LS:7: " + warning), HasSubstr(consequence))));
    EXPECT_THAT(result.paths, SizeIs(0)) << statement;
    EXPECT_TRUE(result.positions.front().written && result.positions.back().written);
  }
  const std::string tracking = "LINE_TRACK;\n  LINE_TRACK_SCHEDULE_NUMBER      : 1;\n";
  EXPECT_THAT(of("", tracking).warnings,
              ElementsAre(StartsWith("IN.LS:6: LINE_TRACK_SCHEDULE_NUMBER lets positions travel with a conveyor")));
  // What the program states itself is decided beforehand.
  const CompensatedProgram plain =
      of("   1:  UFRAME_NUM=2 ;\n   2:  UTOOL_NUM = 11 ;\n   3:  PR[3]=UFRAME[2]    ;\n   4:  !UFRAME[1]=PR[1] ;\n"
         "   5:  R[1:UTOOL_NUM]=R[2:P[1]]    ;\n   6:J P[1] 100% FINE    ;\n   7:  PR[4,1]=12    ;\n"
         "   8:  //PR[1]=P[1] ;\n   9:L P[2] 9mm/sec FINE    ;\n",
         "LINE_TRACK;\n  LINE_TRACK_SCHEDULE_NUMBER      : 0;\n  LINE_TRACK_BOUNDARY_NUMBER      : 1;\n");
  EXPECT_THAT(plain.warnings, SizeIs(0));
  EXPECT_THAT(plain.paths, SizeIs(1));
}

TEST(LsProgram, LeavesPositionsThatSayNothingOfTheArm) {
  const std::string good = joints(1, kAtPose);
  std::string untaught = cartesian(7, "UF : F, UT : F", "N D B, 0, 0, 0", {});
  for (std::size_t at = 0; (at = untaught.find("   0.000", at)) != std::string::npos;) {
    untaught.replace(at, 8, "********");
  }
  std::string half_taught = joints(8, kAtPose);
  half_taught.replace(half_taught.find("  -51.975"), 9, " ********");
  std::string rail = joints(8, kAtPose);
  rail.insert(rail.find("\n};"), ",\n\tE1= ********  mm");
  std::string remote = cartesian(9, "UF : 1, UT : 2", "F U T, 0, 0, 0", kPose);
  for (const std::string name : {"X =", "Y =", "Z =", "W =", "P =", "R ="}) {
    remote.insert(remote.find("\t" + name) + 1, "R");
  }
  const std::string others = "P[5:\"a\"]{\n   GP2:\n\tUF : 0, UT : 1,\t\n\tJ1=   100.000  mm\n};\n";
  const std::vector<std::pair<std::string, std::string>> cases = {
      {untaught, "IN.LS:14: ******** marks positions that are not taught: left as they are"},
      {half_taught, "IN.LS:14: ******** marks positions that are not taught: left as they are"},
      {rail, "IN.LS:14: ******** marks positions that are not taught: left as they are"},
      {remote, "IN.LS:14: RX RY RZ state positions relative to a tool that stands in the cell (remote TCP): left"},
      {others, "IN.LS:14: positions without GP1 are those of other motion groups: left"}};
  const Calibration found = bent(1e-3);
  for (const auto& [position, warning] : cases) {
    for (const auto& text : {program(good + position), with_crlf(program(good + position))}) {
      const CompensatedProgram result = compensated(found, text);
      EXPECT_THAT(result.warnings, ElementsAre(StartsWith(warning)));
      EXPECT_THAT(result.positions, SizeIs(1));
      EXPECT_THAT(result.texts.front(), HasSubstr(text.substr(text.find(position.substr(0, 4)))));
      EXPECT_NE(result.texts.front(), text);
    }
  }
  const std::string lines = "   1:J P[1] 100% FINE    ;\n   2:C P[1]\n    :  P[7] 9mm/sec FINE    ;\n";
  EXPECT_REFUSED("IN.LS:8: moves to P[7], which is not taught (********), expected a taught position",
                 compensated(found, program(good + untaught, lines)));
  EXPECT_THAT(compensated(found, program(good, lines)).warnings,
              ::testing::Contains(StartsWith("IN.LS:8: a motion is to a position that /POS does not have")));
}

TEST(LsProgram, ReadsConfigurationsInGerman) {
  const std::string english = program(cartesian(1, "UF : 0, UT : 0", "N U T, 0, 0, 0", kPose));
  std::string german = english;
  german.replace(german.find("CONFIG"), 6, "KONFIG");
  const Calibration found = bent(1e-3);
  std::string wanted = compensated(found, english).texts.front();
  EXPECT_NE(wanted, english);
  EXPECT_EQ(compensated(found, german).texts.front(), wanted.replace(wanted.find("CONFIG"), 6, "KONFIG"));
}

// ---- External axes -------------------------------------------------------------------------------------------------

// The arm on a turntable that a rail carries.
const Robot& on_rail() {
  static const Robot robot = [] {
    std::string urdf = fanuc().urdf;
    urdf.insert(urdf.find("</robot>"), R"(<link name="floor"/><link name="carriage"/>
      <joint name="rail" type="prismatic"><parent link="floor"/><child link="carriage"/>
        <origin xyz="0.2 -0.1 0.05" rpy="0.02 0 0.3"/><axis xyz="0 1 0"/>
        <limit lower="-2" upper="2" effort="0" velocity="1"/></joint>
      <joint name="turn" type="continuous"><parent link="carriage"/><child link="base_link"/>
        <origin xyz="0.1 0 0" rpy="0 0.01 -0.3"/><axis xyz="0 0 1"/></joint>)");
    return parse_robot(urdf, {.base = "floor", .tip = "flange"}, "rail.urdf");
  }();
  return robot;
}

Calibration bent_on_rail(double size) { return testing::bent(on_rail(), size, 4); }

CompensatedProgram compensated_on_rail(const Calibration& calibration, const std::string& text,
                                       const std::map<int, ExternalAxis>& axes = {{1, {"turn"}}, {2, {"rail"}}}) {
  Controller with_axes = controller();
  with_axes.external_axes = axes;
  return testing::compensated(on_rail(), Compensator(calibration, {.held = {"rail", "turn"}}), with_axes,
                              {{.source = "IN.LS", .text = text}});
}

std::string with_axes(std::string position, double turn, double rail) {
  return position.insert(position.find("\n};"), fmt::format(",\n\tE1={:10.3f} deg,\tE2={:10.3f}  mm", turn, rail));
}

// Turntable [deg], rail [mm] and the arm's own values.
VectorXd rail_joints(double turn, double rail, const VectorXd& arm) {
  VectorXd q(8);
  q << 1e-3 * rail, turn * kDegree, arm;
  return q;
}

// X Y Z W P R that the controller shows where its nominal arm stands at these values.
Numbers shown_pose(const VectorXd& q) {
  const SixJoints n =
      xyzwpr_of(controller().X_BW.inverse() * by_kdl(on_rail().chain, q) * controller().X_FP, SixJoints::Zero());
  return {n[0] * 1e3, n[1] * 1e3, n[2] * 1e3, n[3] / kDegree, n[4] / kDegree, n[5] / kDegree};
}

TEST(ExternalAxes, CarryTheArmAndStayAsTheyAre) {
  const Calibration found = bent_on_rail(1e-3);
  const KDL::Chain calibrated = found.urdf_chain();
  int checked = 0;
  for (const auto& values : std::vector<std::pair<double, double>>{{0.0, 0.0}, {-20.5, 812.25}, {95.0, -1500.0}}) {
    const double turn = values.first;
    const double rail = values.second;
    const VectorXd asked = rail_joints(turn, rail, urdf_joints(kAtPose));
    const Numbers pose = shown_pose(asked);
    const std::string text = program(with_axes(joints(1, kAtPose), turn, rail) +
                                     with_axes(cartesian(2, "UF : 0, UT : 0", "N U T, 0, 0, 0", pose), turn, rail));
    const CompensatedProgram result = compensated_on_rail(found, text);
    const std::vector<ProgramPoint> written = parsed(result.texts.front(), "OUT.LS").points;
    const Isometry3d goal = by_kdl(on_rail().chain, asked);
    const auto reached = [&](const VectorXd& arm) {
      EXPECT_GT(distance(by_kdl(calibrated, asked), goal), 1e-3);
      ++checked;
      return distance(by_kdl(calibrated, rail_joints(turn, rail, arm)), goal);
    };
    EXPECT_LT(reached(urdf_joints(values_of(written[0]))), 5e-5);
    // The controller finds the arm's values for the commanded pose at these values of its axes.
    Numbers driven = kAtPose;
    for (std::size_t i = 0; i < 6; ++i) {
      driven[i] += result.positions[1].change[static_cast<Eigen::Index>(i)] / kDegree;
    }
    EXPECT_LT(reached(urdf_joints(driven)), 5e-5);
    EXPECT_LT(distance(flange_of(values_of(written[1])),
                       by_kdl(on_rail().chain, rail_joints(turn, rail, urdf_joints(driven)))),
              5e-5);
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_EQ(result.positions[i].point.status, CompensationStatus::exact);
      EXPECT_EQ(written[i].external.at(0).value, turn);
      EXPECT_EQ(written[i].external.at(1).value, rail);
    }
  }
  EXPECT_EQ(checked, 6);
}

TEST(ExternalAxes, MoveEvenlyAlongAPath) {
  const std::string lines = "   1:J P[1] 100% FINE    ;\n   2:L P[2] 500mm/sec FINE    ;\n";
  const Numbers there = {20, 10, -20, 70, -55, -70};
  const std::string text =
      program(with_axes(joints(1, kAtPose), 10, -900) + with_axes(joints(2, there), 25, 700), lines);
  EXPECT_THAT(compensated_on_rail(bent_on_rail(0.0), text).paths, SizeIs(0));
  EXPECT_EQ(compensated_on_rail(bent_on_rail(0.0), text).texts.front(), text);
  const CompensatedProgram result = compensated_on_rail(bent_on_rail(3e-3), text);
  ASSERT_THAT(result.paths, SizeIs(1));
  EXPECT_LT(result.paths.front().deviation.position, 0.02);
}

// The same places, with axes that count the other way.
TEST(ExternalAxes, MayCountTheOtherWay) {
  const Calibration found = bent_on_rail(1e-3);
  const std::string asked = joints(1, kAtPose);
  const auto change = [&](double turn, double rail, bool is_reversed) {
    return compensated_on_rail(found, program(with_axes(asked, turn, rail)),
                               {{1, {"turn", is_reversed}}, {2, {"rail", is_reversed}}})
        .positions.front()
        .change;
  };
  EXPECT_EQ(change(25.0, -700.0, true), change(-25.0, 700.0, false));
  EXPECT_NE(change(25.0, -700.0, true), change(25.0, -700.0, false));
}

TEST(ExternalAxes, AreAllStated) {
  const Calibration found = bent_on_rail(1e-3);
  const std::string position = with_axes(joints(1, kAtPose), 10, 100);
  const std::string text = program(position);
  for (const std::map<int, ExternalAxis>& axes : std::vector<std::map<int, ExternalAxis>>{
           {}, {{1, {"rail"}}}, {{1, {"rail"}}, {2, {"joint_1"}}}, {{1, {"rail"}}, {2, {"turn"}}, {3, {"turn"}}}}) {
    EXPECT_REFUSED("rail.urdf: the joints before the six of the arm are rail, turn, expected --external-axis E1=JOINT",
                   compensated_on_rail(found, text, axes));
  }
  EXPECT_REFUSED("IN.LS:8: P[1]: has no E1 in mm, expected that of joint 'rail'",
                 compensated_on_rail(found, text, {{1, {"rail"}}, {2, {"turn"}}}));
  EXPECT_REFUSED("P[1]: has no E4 in deg, expected that of joint 'turn'",
                 compensated_on_rail(found, text, {{2, {"rail"}}, {4, {"turn"}}}));
  // The values of an arm that stands on no axis are its own: an axis beside them moves something else.
  EXPECT_EQ(compensated(bent(1e-3), text).positions.front().point.status, CompensationStatus::exact);
}

// KUKA's controllers write zeros for axes that there are not, too.
TEST(ExternalAxes, OfKukaMayStandAtZeroEverywhere) {
  const Calibration found = bent_on_rail(1e-3);
  const Compensator compensator(found, {.held = {"rail", "turn"}});
  Controller on_axes = controller_of_links(on_rail());
  on_axes.external_axes = {{1, {"rail"}}, {2, {"turn"}}};
  const std::string rest = "E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}\n";
  const std::string text = "DEF a()\nPTP {A1 10,A2 -10,A3 15,A4 5,A5 30,A6 2," + rest +
                           "PTP {A1 20,A2 -10,A3 15,A4 5,A5 30,A6 2," + rest + "END\n";
  const CompensatedProgram result = testing::compensated(on_rail(), compensator, on_axes, {{"a.src", text}});
  ASSERT_THAT(result.positions, SizeIs(2));
  for (std::size_t i = 0; i < 2; ++i) {
    const VectorXd arm = (VectorXd(6) << (i == 0 ? 10 : 20), -10, 15, 5, 30, 2).finished() * kDegree;
    EXPECT_TRUE(result.positions[i].written);
    EXPECT_LT((result.positions[i].point.joint_values - compensator.solve(rail_joints(0, 0, arm)).joint_values).norm(),
              1e-12);
  }
  EXPECT_THAT(result.texts.front(), AllOf(HasSubstr("," + rest + "PTP"), HasSubstr("," + rest + "END")));
}

TEST(ExternalAxes, StayOutOfItWhereTheyDoNotCarryTheArm) {
  const Calibration found = bent(1e-3);
  const std::string pose = cartesian(1, "UF : 0, UT : 0", "N U T, 0, 0, 0", kPose);
  const auto change = [&](const std::string& position, const std::map<int, ExternalAxis>& axes) {
    Controller with_axes = controller();
    with_axes.external_axes = axes;
    return testing::compensated(fanuc(), Compensator(found), with_axes,
                                {{.source = "IN.LS", .text = program(position)}})
        .positions.front()
        .change;
  };
  const SixJoints alone = change(pose, {});
  EXPECT_EQ(change(with_axes(pose, 0.0, 0.0), {}), alone);
  EXPECT_EQ(change(with_axes(pose, 12.0, 340.0), {{1, {"none"}}, {2, {"none"}}}), alone);
  EXPECT_REFUSED(
      "P[1]: is a pose with an external axis E2, expected --external-axis E2=JOINT of a URDF with that joint, "
      "or E2=none",
      change(with_axes(pose, 12.0, 340.0), {{1, {"none"}}}));
}

TEST(LsProgram, NamesTheFirstLinesOfEachWarning) {
  const auto warnings_of = [](int count) {
    std::string lines;
    for (int i = 0; i < count; ++i) {
      lines += "    :L P[1] 9mm/sec FINE Offset    ;\n";
    }
    return compensated(bent(0.0), program(joints(1, kAtPose), lines)).warnings;
  };
  EXPECT_THAT(warnings_of(1), ElementsAre(EndsWith("without that")));
  EXPECT_THAT(warnings_of(2), ElementsAre(EndsWith("without that (also in line 7)")));
  EXPECT_THAT(
      warnings_of(12),
      ElementsAre("IN.LS:6: Offset moves positions at run time: compensated where they are without that (also in "
                  "lines 7, 8, 9, 10, 11, 12, 13, 14, 15 and 2 more)"));
}

TEST(LsProgram, RefusesWhatItCannotCompensate) {
  const std::string good = cartesian(3, "UF : 0, UT : 0", "N U T, 0, 0, 0", kPose);
  const auto with = [&](const std::string& old, const std::string& now) {
    std::string text = good;
    return program(text.replace(text.find(old), old.size(), now));
  };
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"G00 X1\n", "IN.LS:1: begins with 'G00 X1', expected a program in one of these languages: FANUC LS (.LS), "},
      {with("UF : 0", "UF : 4"), "IN.LS:8: P[3]: UF 4 is not known"},
      {with("UT : 0", "UT : F"), "IN.LS:8: P[3]: UT is not stated"},
      {with("UF : 0, ", ""), "P[3]: UF is not stated"},
      {with("  1500.000", "  nan"), "IN.LS:11: P[3]: X is 'nan  mm', expected a number"},
      {with("  1500.000", "  9500.000"), "P[3]: no joint values reach it with this configuration"},
      {with("N U T", "X U T"), "IN.LS:10: P[3]: CONFIG is 'X U T, 0, 0, 0'"},
      {with("0, 0, 0'", "0, 0'"), "CONFIG is"},
      {with(" mm", " in"), "P[3]: X is in 'in', expected mm"},
      {with("\tX =", "\tQ ="), "P[3]: has 'Q', expected X Y Z W P R"},
      {with("\tY =", "\tX ="), "P[3]: has X twice"},
      {with(" deg\n", " deg,\n\tE1=   100.000  mm\n"),
       "IN.LS:8: P[3]: is a pose with an external axis E1, expected --external-axis E1=JOINT"},
      {with(" deg\n", " deg,\n\tE7=   100.000  mm\n"), "P[3]: has 'E7', expected X Y Z W P R"},
      {with(" deg\n", " deg,\n\tE1=   100.000  in\n"), "IN.LS:13: P[3]: E1 is in 'in', expected mm or deg"},
      {with(" deg\n", " deg,\n\tE1= 1 mm,\tE1= 1 mm\n"), "P[3]: has E1 twice"},
      {with("P[3]", "P[x]"), "IN.LS:8: a position has no number"},
      {with("};", ""), "P[3]: "},
      {"/PROG  T\n/MN\n   1:J P[1] 100% FINE    ;\n", "IN.LS:3: ends here without /POS"},
      {program(good).substr(0, program(good).size() - 5), "IN.LS:14: ends here without /END"},
      {program(good + good), "IN.LS:14: P[3]: is there twice"},
      {with("   GP1:",
            "   GP1:\n\tUF : 0, UT : 0,\t\n\tJ1= 0 deg, J2= 0 deg, J3= 0 deg, J4= 0 deg, J5= 9 deg, J6= 0 deg\n   "
            "GP1:"),
       "IN.LS:12: P[3]: has GP1 twice, expected each group once"},
      {program(good) + program(good),
       "IN.LS:15: goes on after /END with '/PROG  TEST', expected one program in a file"},
      {program(good) + "\r\n \tP[4]{", "IN.LS:16: goes on after /END with 'P[4]{'"},
      {"/PROG  A\n/MN\n" + program(good), "IN.LS:3: has '/PROG  TEST' before /POS, expected one whole program"},
      {"/PROG  A\n/MN\n/END\n" + program(good), "IN.LS:3: has '/END' before /POS"},
      {program(good.substr(0, good.find("\tX")) + "};\n"), "P[3]: has no complete pose"},
      {program(cartesian(1, "UF : 0, UT : 0", "N U T, 0, 0, 0", {1807, 0, 1300, 180, -90, 0})),
       "P[1]: stands in a singularity"}};
  const Calibration found = bent(1e-3);
  for (const auto& each : cases) {
    EXPECT_THAT(testing::refusal([&] { compensated(found, each.first); }), HasSubstr(each.second));
  }
}

// ---- The true robot ------------------------------------------------------------------------------------------------

// A position of a program, with joint values or as a pose in UF 2 and UT 1.
class VirtualProgram {
public:
  VirtualProgram() {
    frames.user["2"] = Eigen::Translation3d(0.4, -0.3, 0.2) * AngleAxisd(0.3, Vector3d(1.0, 2.0, 3.0).normalized());
    frames.tool["1"] = Eigen::Translation3d(0.05, 0.02, 0.3) * AngleAxisd(-0.7, Vector3d::UnitY());
  }

  void add(const VectorXd& q, bool is_pose) {
    const Numbers j = {q[0], -q[1], q[2] + q[1], -q[3], q[4], -q[5]};
    Numbers numbers{};
    if (is_pose) {
      const Isometry3d faceplate = frames.user["2"].inverse() * controller().X_BW.inverse() * by_kdl(fanuc().chain, q) *
                                   controller().X_FP * frames.tool["1"];
      const SixJoints xyzwpr = xyzwpr_of(faceplate, SixJoints::Zero());
      for (std::size_t i = 0; i < 6; ++i) {
        numbers[i] = xyzwpr[static_cast<Eigen::Index>(i)] / (i < 3 ? 1e-3 : kDegree);
      }
    } else {
      std::transform(j.begin(), j.end(), numbers.begin(), [](double value) { return value / kDegree; });
    }
    for (double& number : numbers) {
      number = std::round(number * 1e3) * 1e-3;
    }
    const auto turn = [&](std::size_t i) { return std::ceil(j[i] / (360.0 * kDegree) - 0.5); };
    const ArmPosture posture = arm.posture(q);
    const std::string configuration =
        fmt::format("{} {} {}, {:.0f}, {:.0f}, {:.0f}", j[4] > 0.0 ? 'F' : 'N', posture.elbow_up ? 'U' : 'D',
                    posture.front ? 'T' : 'B', turn(0), turn(3), turn(5));
    const int number = static_cast<int>(asked.size()) + 1;
    text += is_pose ? cartesian(number, "UF : 2, UT : 1", configuration, numbers) : joints(number, numbers);
    asked.push_back(numbers);
  }

  // The flange, as the controller's nominal arm has it at these numbers.
  Isometry3d flange(const ProgramPoint& position, const Numbers& numbers) const {
    return position.branch ? flange_of(numbers, frames.user.at("2"), frames.tool.at("1"))
                           : by_kdl(fanuc().chain, urdf_joints(numbers));
  }

  // The joint values of the controller, which are near `q`.
  VectorXd driven(const ProgramPoint& position, const VectorXd& q) const {
    const Numbers numbers = values_of(position);
    if (!position.branch) {
      return urdf_joints(numbers);
    }
    KDL::ChainIkSolverPos_LMA controller_ik(fanuc().chain, Eigen::Matrix<double, 6, 1>::Ones(), 1e-10);
    KDL::JntArray seed(6);
    seed.data = q;
    KDL::JntArray result(6);
    EXPECT_GE(controller_ik.CartToJnt(seed, to_kdl(flange(position, numbers)), result), 0);
    return result.data;
  }

  // [m^2] of a point of the flange by rounding to the last digit.
  double rounding_variance(const ProgramPoint& position, const Vector3d& point) const {
    const Numbers numbers = values_of(position);
    double variance = 0.0;
    for (std::size_t i = 0; i < 6; ++i) {
      Numbers rounded = numbers;
      rounded[i] += 0.5e-3;
      variance += (flange(position, rounded) * point - flange(position, numbers) * point).squaredNorm() / 3.0;
    }
    return variance;
  }

  ProgramFrames frames;
  WristArm arm{fanuc(), SixJoints::Zero()};
  std::string text;
  std::vector<Numbers> asked;
};

TEST(LsProgramLongRun, BringsTheTrueToolWhereItsUncertaintySays) {
  constexpr int kRobots = 200;
  constexpr int kPoints = 20;
  const CalibrationOptions plain{.priors = {.automatic = false},
                                 .effects = {.automatic = false},
                                 .noise = {.scale_sigma = 0.0},  // the simulated device is exact
                                 .validation = {.held_out = false},
                                 .diagnosis = {.try_readings = false}};
  double ratio = 0.0;
  int count = 0;
  int poses = 0;
  for (std::uint64_t seed = 1; seed <= kRobots; ++seed) {
    const SimulatedExperiment experiment = simulate(
        fanuc(),
        {.test_configurations = kPoints, .noise = 3e-5, .length_error = 1e-3, .angle_error = 1e-3, .seed = seed});
    const Calibration found = calibrate(fanuc(), experiment.measurements, plain);
    const Estimate& estimate = found.parts().estimate;
    const Vector3d target = estimate.frames.targets.front().X_FT.translation();
    const Eigen::MatrixXd drawn = experiment.measurements.joint_values.rightCols(kPoints);
    VirtualProgram virtual_program;
    for (Eigen::Index i = 0; i < kPoints; ++i) {
      // A pose with a straight elbow, or with the wrist on axis 1, may be refused.
      VirtualProgram alone;
      alone.add(drawn.col(i), i % 2 == 1);
      const std::string refused =
          testing::refusal([&] { compensated(found, program(alone.text), virtual_program.frames); });
      virtual_program.add(drawn.col(i), i % 2 == 1 && refused == "nothing was refused");
    }
    const CompensatedProgram result = compensated(found, program(virtual_program.text), virtual_program.frames);
    const Program written = parsed(result.texts.front(), "OUT.LS");
    for (std::size_t i = 0; i < kPoints; ++i) {
      if (result.positions[i].point.status != CompensationStatus::exact) {
        continue;
      }
      const ProgramPoint& position = written.points[i];
      const VectorXd q = virtual_program.driven(position, drawn.col(static_cast<Eigen::Index>(i)));
      const Vector3d wanted =
          estimate.frames.base() * virtual_program.flange(position, virtual_program.asked[i]) * target;
      const Vector3d reached = experiment.truth.predict(q, "A", PredictionFrame::measuring).position;
      ratio += (reached - wanted).squaredNorm() /
               (found.arm().predict(q, "A", PredictionFrame::measuring).covariance.trace() +
                virtual_program.rounding_variance(position, target));
      ++count;
      poses += position.branch ? 1 : 0;
    }
  }
  EXPECT_GT(count, 0.9 * kRobots * kPoints);
  EXPECT_GT(poses, 0.45 * kRobots * kPoints);
  EXPECT_NEAR(ratio / count, 1.0, 0.1);
}

}  // namespace
}  // namespace kdl_calibration::programs_test
