#include <gmock/gmock.h>

#include <fmt/core.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "kdl_calibration/input_error.hpp"
#include "programs/number_fields.hpp"
#include "programs/rapid_program.hpp"
#include "refusal.hpp"

namespace kdl_calibration::rapid_test {
namespace {

using Eigen::Isometry3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;
using ::testing::UnorderedElementsAre;

constexpr double kQuadrant = 0.5 * std::numbers::pi;
constexpr const char* kNoAxes = "[9E9,9E9,9E9,9E9,9E9,9E9]";

std::string target(const std::string& configuration = "0,0,0,0") {
  return "[[100,20.5,300],[0,0,1,0],[" + configuration + "]," + kNoAxes + "]";
}

// Line 1 is MODULE, then the declarations, PROC main() and the statements.
std::string module(const std::string& declarations, const std::string& statements) {
  return "MODULE test\n" + declarations + "PROC main()\n" + statements + "ENDPROC\nENDMODULE\n";
}

Program parsed(const std::string& text) { return abb_rapid().parse({{.source = "IN.mod", .text = text}}); }

std::vector<std::string> names(const Program& program) {
  std::vector<std::string> result;
  for (const ProgramPoint& point : program.points) {
    result.push_back(point.name);
  }
  return result;
}

std::vector<double> values(const std::vector<NumberField>& fields) {
  std::vector<double> result;
  for (const NumberField& field : fields) {
    result.push_back(field.value);
  }
  return result;
}

// What a program's remarks say, with their lines: "Offs moves ...: 3 5".
std::vector<std::string> remarks(const Program& program) {
  std::vector<std::string> result;
  for (const ProgramRemark& remark : program.remarks) {
    result.push_back(remark.what + ":");
    for (const std::size_t line : remark.lines) {
      result.back() += " " + std::to_string(line);
    }
  }
  return result;
}

std::vector<NumberField> fields_of(const Program& program, std::size_t file = 0) {
  std::vector<NumberField> fields;
  for (const ProgramPoint& point : program.points) {
    if (point.file == file) {
      fields.insert(fields.end(), point.fields.begin(), point.fields.end());
      fields.insert(fields.end(), point.turn_fields.begin(), point.turn_fields.end());
    }
  }
  std::sort(fields.begin(), fields.end(), [](const NumberField& a, const NumberField& b) { return a.begin < b.begin; });
  return fields;
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) {
    text.replace(at, from.size(), to);
  }
  return text;
}

// The structure of modules as controllers and RobotStudio write them.
const std::string kStation =
    "%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\n\nMODULE Station(SYSMODULE,NOSTEPIN)\n"  // 1 to 6
    "  ! \"pens\" [and] cubes; Funci\xF3n\n"                                             // 7
    "  LOCAL PERS tooldata pen:=[TRUE,[[0,0,206],[0.5,0.5,0.5,0.5]],\n"
    "    [1.8,[2.7,0,84.4],[1,0,0,0],0.033,0.034,0.007]];\n"  // 9
    "\tTASK PERS wobjdata Table:=[FALSE,TRUE,\"\",[[1000,0,500],[0,0,0,1]],[[10,20,30],[1,0,0,0]]];\n"
    "  CONST robtarget p10:=[[-312.23,-47.51,+51.50],[0.0710383,-0.193736,-0.955349,-0.211491],"
    "[-1,0,-4,1],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];\n"  // 11
    "  CONST robtarget cube{2}:=[[[24.83,308.61,1E-03],[0,0,-1,0],[0,0,0,0],\n"
    "    [9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]],\n"
    "    [[-51.17,308.79,159.01],[0,0,-1,0],[1,0,0,0],[-1.5,9E+09,700,9E+09,9E+09,9E+09]]];\n"  // 14
    "  VAR num n:=0;\n  RECORD weld\n    robtarget place;\n  ENDRECORD\n"                       // 18
    "  FUNC robtarget Found(robtarget start \\switch fast | \\num x)\n"
    "    TEST n\n      CASE 1, 2: moveL P10, v100, \\T:=n, fine, PEN \\wobj:=table;\n"  // 21
    "      DEFAULT : Stop;\n    ENDTEST\n"
    "    IF n < .2 n  := .2;\n    IF n=1 AND NOT ready{2} MoveC p10, cube{1},\n"  // 25
    "      v500\\V:=20, z10\\Inpos:=inpos50, pen\\WObj:=Table\\TLoad:=load0;\n"
    "    WHILE n < 3 DO Incr n; ENDWHILE\n    FOR i FROM 1 TO 3 DO\n      MoveJ "
    "cube{2}\\ID:=7,v10,z1,pen\\WObj:=Table;\n"
    "    ENDFOR\n    MoveAbsJ [[0,-10.5,0,0,90,-30],[9E9,9E9,9E9,9E9,9E9,9E9]]\\NoEOffs,vmax,fine,pen;\n"  // 31
    "    TPWrite \"a \"\"quoted\"\" text; \"\\Num:=n;\n    %\"Rout\"+ValToStr(n)%;\n"
    "    next: GOTO next;\n    RETURN start;\n  ERROR (ERR_WHLSEARCH)\n    TRYNEXT;\n    <SMT>\n  ENDFUNC\nENDMODULE\n";

TEST(RapidProgram, ReadsPointsMotionsAndFramesOfAModule) {
  const Program program = parsed(kStation);
  EXPECT_THAT(names(program), ElementsAre("p10", "cube{1}", "cube{2}", "target of MoveAbsJ"));
  const ProgramPoint& p10 = program.points[0];
  EXPECT_EQ(p10.line, 11U);
  EXPECT_EQ(p10.notation, PointNotation::quaternion);
  EXPECT_THAT(values(p10.fields), ElementsAre(-312.23, -47.51, 51.5, 0.0710383, -0.193736, -0.955349, -0.211491));
  EXPECT_THAT(values(p10.turn_fields), ElementsAre(-1, 0, -4));
  EXPECT_EQ(p10.user_frame, "table");
  EXPECT_EQ(p10.tool_frame, "pen");
  EXPECT_THAT(p10.external, IsEmpty());
  const ProgramPoint& second = program.points[2];
  EXPECT_EQ(second.line, 14U);
  ASSERT_THAT(second.external, SizeIs(2));
  EXPECT_EQ(second.external[0].axis, 1);
  EXPECT_EQ(second.external[0].value, -1.5);
  EXPECT_EQ(second.external[1].axis, 3);
  EXPECT_EQ(second.external[1].is_length, std::nullopt);
  const ProgramPoint& joints = program.points[3];
  EXPECT_EQ(joints.notation, PointNotation::joints);
  EXPECT_THAT(values(joints.fields), ElementsAre(0, -10.5, 0, 0, 90, -30));
  EXPECT_FALSE(joints.branch);
  EXPECT_EQ(joints.tool_frame, "pen");
  EXPECT_THAT(program.remarks, IsEmpty());

  std::vector<std::string> motions;
  for (const ProgramMotion& motion : program.motions) {
    EXPECT_TRUE(motion.is_known);
    motions.push_back(fmt::format("{} {} {}", motion.line, motion.is_straight ? "straight" : "joints",
                                  program.points.at(motion.point.value()).name));
  }
  EXPECT_THAT(motions, ElementsAre("21 straight p10", "25 straight p10", "25 straight cube{1}", "29 joints cube{2}",
                                   "31 joints target of MoveAbsJ"));

  // Half a turn about z, and the object's frame in that.
  EXPECT_LT((program.frames.user.at("table") * Vector3d(0.1, 0.0, 0.0) - Vector3d(0.89, -0.02, 0.53)).norm(), 1e-12);
  EXPECT_LT((program.frames.tool.at("pen") * Vector3d(0.1, 0.0, 0.0) - Vector3d(0.0, 0.1, 0.206)).norm(), 1e-12);
  EXPECT_TRUE(program.frames.tool.at("tool0").isApprox(Isometry3d::Identity()));
  EXPECT_TRUE(program.frames.user.at("wobj0").isApprox(Isometry3d::Identity()));
}

TEST(RapidProgram, ComesBackByteForByteAndChangesNothingButNumbersOfPoints) {
  for (const std::string& text : {kStation, replaced(kStation, "\n", "\r\n"), "\xEF\xBB\xBF" + kStation,
                                  kStation.substr(0, kStation.size() - 1), kStation + "\r\n\x1A"}) {
    std::vector<NumberField> fields = fields_of(parsed(text));
    ASSERT_THAT(fields, SizeIs(3U * 10U + 6U));
    EXPECT_EQ(with_numbers(text, fields, abb_rapid()), text);
    for (NumberField& field : fields) {
      EXPECT_FALSE(text.substr(field.begin, field.end - field.begin).empty());
      field.value = 77.0;
    }
    std::string changed = with_numbers(text, fields, abb_rapid());
    EXPECT_THAT(changed, HasSubstr("p10:=[[77.000,77.000,77.000],[77.00000000,77.00000000,77.00000000,77.00000000],"
                                   "[77,77,77,1],[9E+09,"));
    EXPECT_THAT(changed, HasSubstr("MoveAbsJ [[77.0000,77.0000,77.0000,77.0000,77.0000,77.0000],[9E9,"));
    for (NumberField& field : fields = fields_of(parsed(changed))) {
      EXPECT_EQ(field.value, 77.0);
    }
  }
}

TEST(RapidProgram, WritesAtLeastTheDigitsThatTheTextHas) {
  const Program program = parsed(
      module("CONST robtarget p:=[[1.23456,2,-1.5E-05],[0.123456789012,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
             "CONST jointtarget j:=[[1,2.34567,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];\n",
             "MoveJ p,v10,fine,tool0;\n"));
  std::vector<int> decimals;
  for (const NumberField& field : fields_of(program)) {
    decimals.push_back(field.decimals);
  }
  EXPECT_THAT(decimals, ElementsAre(5, 3, 6, 12, 8, 8, 8, 0, 0, 0, 4, 5, 4, 4, 4, 4));
}

// ---- Configurations ------------------------------------------------------------------------------------------------

ArmBranch branch_of(const std::string& configuration, const std::string& before = "") {
  return parsed(module("", before + "MoveJ " + target(configuration) + ",v10,fine,tool0;\n"))
      .points.at(0)
      .branch.value();
}

// 3HAC16581-1, confdata: quadrant 1 is 90 to 180 degrees, quadrant -1 is 0 to -90 degrees.
TEST(RapidProgram, TakesQuadrantsAsIntervalsOfAxes1And4And6) {
  const ArmBranch branch = branch_of("1,-1,6,0");
  const std::vector<std::pair<std::size_t, double>> bounds = {{0, 1.0}, {3, -1.0}, {5, 6.0}};
  for (const auto& [axis, quadrant] : bounds) {
    ASSERT_TRUE(branch.turns[axis]);
    EXPECT_NEAR(branch.turns[axis]->lower, quadrant * kQuadrant, 1e-12);
    EXPECT_NEAR(branch.turns[axis]->upper, (quadrant + 1.0) * kQuadrant, 1e-12);
    EXPECT_FALSE(branch.turns[axis]->closed_above);
  }
  EXPECT_FALSE(branch.turns[1] || branch.turns[2] || branch.turns[4]);
}

// The same document's table of cfx: the wrist centre in front of or behind axis 1, the same of the lower arm, axis 5.
TEST(RapidProgram, TakesCfxAsShoulderElbowAndWrist) {
  struct Row {
    int cfx;
    bool front;
    bool elbow_up;
    bool wrist_positive;
  };
  for (const Row& row :
       {Row{1, true, true, false}, Row{2, true, false, true}, Row{3, true, false, false}, Row{4, false, true, true},
        Row{5, false, true, false}, Row{6, false, false, true}, Row{7, false, false, false}}) {
    const ArmBranch branch = branch_of("0,0,0," + std::to_string(row.cfx));
    EXPECT_EQ(branch.front, row.front) << row.cfx;
    EXPECT_EQ(branch.elbow_up, row.elbow_up) << row.cfx;
    EXPECT_EQ(branch.wrist_positive, row.wrist_positive) << row.cfx;
  }
}

// Robots without cfx write 0 also where axis 5 is negative; painting robots write the quadrant of axis 5.
TEST(RapidProgram, LeavesShoulderAndWristToTheQuadrantsWhereCfxIsZero) {
  const ArmBranch zero = branch_of("0,2,-2,0");
  EXPECT_FALSE(zero.front || zero.wrist_positive);
  EXPECT_EQ(zero.elbow_up, true);
  const ArmBranch negative = branch_of("0,0,0,-1");
  EXPECT_FALSE(negative.front || negative.elbow_up || negative.wrist_positive);
  EXPECT_TRUE(negative.turns[0]);
}

TEST(RapidProgram, NumbersTheQuadrantsOfJointValues) {
  const auto turns = [](double q1, double q4, double q6) {
    SixJoints q = SixJoints::Zero();
    constexpr double kDegrees = std::numbers::pi / 180.0;
    q[0] = q1 * kDegrees;
    q[3] = q4 * kDegrees;
    q[5] = q6 * kDegrees;
    return abb_rapid().turns(q);
  };
  EXPECT_THAT(turns(0.0, 0.0, 0.0), ElementsAre(0, 0, 0));
  EXPECT_THAT(turns(110.0, -45.0, 5.0), ElementsAre(1, -1, 0));
  EXPECT_THAT(turns(90.0, -90.0, 180.0), ElementsAre(1, -1, 2));
  EXPECT_THAT(turns(89.999, -90.001, 449.9), ElementsAre(0, -2, 4));
  EXPECT_THAT(turns(-1e-13, 0.0, -360.0), ElementsAre(0, 0, -4));
}

TEST(RapidProgram, TakesPlaceholdersAsNoConfigurationWhileConfLIsOff) {
  const std::string text = module("", "ConfL \\Off;\nMoveL " + target() + ",v10,fine,tool0;\nMoveL " +
                                          target("0,0,-1,0") + ",v10,fine,tool0;\nMoveJ " + target() +
                                          ",v10,fine,tool0;\nConfL \\On;\nMoveL " + target() + ",v10,fine,tool0;\n");
  const Program program = parsed(text);
  std::vector<bool> has_branch;
  for (const ProgramPoint& point : program.points) {
    has_branch.push_back(point.branch.has_value());
  }
  EXPECT_THAT(has_branch, ElementsAre(false, true, true, true));
  EXPECT_THAT(remarks(program),
              ElementsAre(AllOf(StartsWith("ConfL \\Off lets the controller choose"), HasSubstr(": 3"))));
  // The same for all is what an offline system writes that does not know the arm.
  const auto has_branches = [](const std::string& first, const std::string& second) {
    const Program each = parsed(module("", "ConfL\\Off;\nMoveL " + target(first) + ",v10,fine,tool0;\nMoveL " +
                                               target(second) + ",v10,fine,tool0;\n"));
    return std::pair(each.points.at(0).branch.has_value(), each.points.at(1).branch.has_value());
  };
  EXPECT_EQ(has_branches("0,-1,-1,0", "0,-1,-1,0"), std::pair(false, false));
  EXPECT_EQ(has_branches("0,-1,-1,0", "0,-1,-1,1"), std::pair(true, true));
  // A routine that stands before the one that turns the check off.
  const Program before =
      parsed(module("PROC work()\nMoveJ " + target() + ",v10,fine,tool0;\nENDPROC\n", "ConfJ\\Off;\nwork;\n"));
  EXPECT_FALSE(before.points.at(0).branch);
}

// ---- Data ----------------------------------------------------------------------------------------------------------

TEST(RapidProgram, FindsDataByScopeAndWithoutRegardToCase) {
  const Program program = parsed(
      "MODULE a\n"
      "LOCAL CONST robtarget P:=" +
      target("1,0,0,0") +
      ";\n"
      "PROC one()\nCONST robtarget p:=" +
      target("2,0,0,0") +
      ";\nMOVEJ p,v10,fine,TOOL0;\nENDPROC\n"
      "PROC two()\nMoveJ p,v10,fine,tool0;\nMoveJ shared,v10,fine,tool0;\nENDPROC\nENDMODULE\n"
      "MODULE b\nLOCAL CONST robtarget p:=" +
      target("3,0,0,0") + ";\nCONST robtarget Shared:=" + target("4,0,0,0") +
      ";\nPROC three()\nMoveJ P,v10,fine,tool0;\nENDPROC\nENDMODULE\n");
  std::vector<double> quadrants;
  for (const ProgramMotion& motion : program.motions) {
    quadrants.push_back(program.points.at(motion.point.value()).turn_fields.front().value);
  }
  EXPECT_THAT(quadrants, ElementsAre(2, 1, 4, 3));
  EXPECT_THAT(program.remarks, IsEmpty());
  // LOCAL data of a module, and data of a routine, are not known elsewhere.
  const Program hidden =
      parsed("MODULE a\nLOCAL CONST robtarget p:=" + target() + ";\nPROC one()\nCONST robtarget q:=" + target() +
             ";\nENDPROC\nENDMODULE\nMODULE b\nPROC two()\nMoveJ p,v10,fine,tool0;\nMoveJ "
             "q,v10,fine,tool0;\nENDPROC\nENDMODULE\n");
  EXPECT_THAT(remarks(hidden),
              ::testing::Contains(AllOf(StartsWith("a target that the text does not declare"), HasSubstr(": 9 10"))));
}

TEST(RapidProgram, ReadsSeveralFiles) {
  const std::string data = "MODULE data(SYSMODULE)\nCONST robtarget p:=" + target() + ";\nENDMODULE\n";
  const std::string motions = module("CONST robtarget q:=" + target() + ";\n", "MoveL p,v10,fine,tool0;\n");
  const Program program = abb_rapid().parse({{.source = "A.mod", .text = motions}, {.source = "B.sys", .text = data}});
  ASSERT_THAT(names(program), ElementsAre("p"));
  EXPECT_EQ(program.points[0].file, 1U);
  EXPECT_EQ(program.motions.at(0).file, 0U);
  EXPECT_EQ(data.substr(program.points[0].fields[1].begin, 4), "20.5");
  ASSERT_THAT(program.remarks, SizeIs(1));
  EXPECT_EQ(program.remarks[0].file, 0U);
  EXPECT_THAT(program.remarks[0].lines, ElementsAre(2));
}

TEST(RapidProgram, ReadsElementsOfArrays) {
  const std::string row = "[" + target("1,0,0,0") + "," + target("2,0,0,0") + "]";
  const Program fixed =
      parsed(module("CONST robtarget grid{2,2}:=[" + row + "," + row + "];\n", "MoveL grid{2, 1},v10,fine,tool0;\n"));
  ASSERT_THAT(names(fixed), ElementsAre("grid{2,1}"));
  EXPECT_EQ(fixed.points[0].turn_fields.front().value, 1.0);
  EXPECT_THAT(remarks(fixed), ElementsAre("no motion uses a robtarget, its tool is not known: left as it is: 2"));
  const Program computed =
      parsed(module("CONST robtarget path{2}:=" + row + ";\n", "MoveL path{i+1},v10,fine,tool0;\n"));
  EXPECT_THAT(names(computed), ElementsAre("path{1}", "path{2}"));
  ASSERT_THAT(computed.motions, SizeIs(1));
  EXPECT_FALSE(computed.motions[0].point || computed.motions[0].is_known);
  const Program tools =
      parsed(module("PERS tooldata tools{2}:=[[TRUE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]],"
                    "[TRUE,[[0,0,2],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]];\n",
                    "MoveL " + target() + ",v10,fine,tools{2};\n"));
  EXPECT_EQ(tools.points.at(0).tool_frame, "tools{2}");
  EXPECT_NEAR(tools.frames.tool.at("tools{2}").translation().z(), 0.002, 1e-12);
}

TEST(RapidProgram, ReadsConfigurationsAndExternalAxesThatHaveNames) {
  const Program program =
      parsed(module("CONST confdata conf:=[1,-1,0,1];\nVAR extjoint ext:=[9E9,120.5,9E9,9E9,9E9,9E9];\n",
                    "MoveL [[100,20,300],[1,0,0,0],conf,ext],v10,fine,tool0;\n"));
  const ProgramPoint& point = program.points.at(0);
  EXPECT_EQ(point.branch.value().wrist_positive, false);
  EXPECT_THAT(point.turn_fields, IsEmpty());
  ASSERT_THAT(point.external, SizeIs(1));
  EXPECT_EQ(point.external[0].value, 120.5);
}

constexpr const char* kLoad = "[1,[0,0,1],[1,0,0,0],0,0,0]";

TEST(RapidProgram, TakesToolsThatDifferInTheirLoadAsOne) {
  const std::string data = std::string("PERS tooldata empty:=[TRUE,[[0,0,100],[1,0,0,0]],") + kLoad +
                           "];\nPERS tooldata full:=[TRUE,[[0,0,100],[1,0,0,0]],[5,[0,0,9],[1,0,0,0],0,0,0]];\n"
                           "CONST robtarget p:=" +
                           target() + ";\n";
  const std::string motions = "MoveL p,v10,fine,empty;\nMoveL p,v10,fine,full;\n";
  EXPECT_EQ(parsed(module(data, motions)).points.at(0).tool_frame, "empty");
  EXPECT_THAT(parsed(module(data, motions + "full.tframe.trans.z:=n;\n")).points, IsEmpty());
}

TEST(RapidProgram, ReadsFramesOfABackup) {
  const std::string text =
      "MODULE user(SYSMODULE)\nPERS tooldata tGun:=[TRUE,[[10,0,125],[0.7071068,0,0.7071068,0]],[1,[0,0,1],[1,0,0,0],"
      "0,0,0]];\nPERS tooldata tFixed:=[FALSE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
      "PERS wobjdata wPart:=[FALSE,TRUE,\"\",[[0,0,0],[0.7071068,0,0,0.7071068]],[[100,0,0],[1,0,0,0]]];\n"
      "PERS wobjdata wTable:=[FALSE,FALSE,\"STN_1\",[[0,0,0],[1,0,0,0]],[[100,0,0],[1,0,0,0]]];\nENDMODULE\n";
  for (const std::string& each :
       {text, text.substr(text.find('\n') + 1, text.find("ENDMODULE") - text.find('\n') - 1)}) {
    const ProgramFrames frames = abb_rapid().read_frames(each, "user.sys");
    ASSERT_THAT(frames.tool, SizeIs(2));
    ASSERT_THAT(frames.user, SizeIs(2));
    EXPECT_LT((frames.tool.at("tgun") * Vector3d(0.0, 0.0, 0.1) - Vector3d(0.11, 0.0, 0.125)).norm(), 1e-7);
    EXPECT_LT((frames.user.at("wpart") * Vector3d::Zero() - Vector3d(0.0, 0.1, 0.0)).norm(), 1e-7);
    EXPECT_TRUE(frames.tool.contains("tool0") && frames.user.contains("wobj0"));
    EXPECT_THAT(frames.standing_tools, ElementsAre("tfixed"));
    EXPECT_THAT(frames.moving_user, ElementsAre("wtable"));
  }
}

TEST(RapidProgram, TellsModulesFromOtherTexts) {
  for (const std::string& text :
       {kStation, std::string("\xEF\xBB\xBF\r\n! MODULE b\r\n  module x\r\nENDMODULE"), std::string("MODULE x")}) {
    EXPECT_TRUE(abb_rapid().is_written_in(text)) << text;
  }
  for (const std::string& text : {std::string(), std::string("/PROG TEST\n"), std::string("DEF main()\nEND\n"),
                                  std::string("MODULE"), std::string("! MODULE a"), std::string("%%% MODULE a"),
                                  std::string("def p():\n  movej([0])\nend\n"), std::string("M\0O\0D\0", 6)}) {
    EXPECT_FALSE(abb_rapid().is_written_in(text)) << text;
  }
}

TEST(RapidProgram, DrivesSlowlyAndStopsAtEachConfiguration) {
  const std::string text = abb_rapid().drive("test", {{.label = "a\\0A", .joint_values = {1, -2.5, 0, 4, 5, 6}}});
  EXPECT_EQ(text,
            "MODULE Kdlcal_test\n  CONST speeddata vSlow:=[100,20,100,20];\n\n  PROC main()\n"
            "    MoveAbsJ [[1.0000,-2.5000,0.0000,4.0000,5.0000,6.0000],[9E9,9E9,9E9,9E9,9E9,9E9]],vSlow,fine,tool0;\n"
            "    TPWrite \"configuration a_0A\";\n    Stop;\n  ENDPROC\nENDMODULE\n");
}

// ---- What is left, and what the controller decides -----------------------------------------------------------------

struct RemarkRow {
  std::string declarations;  // in line 2
  std::string statements;    // behind PROC main(): line 4, or 3 without declarations
  std::string expected;
  std::size_t points = 0;
};

TEST(RapidProgram, SaysWhyARobtargetIsLeft) {
  const std::string p = "CONST robtarget p:=" + target() + ";\n";
  const std::string tool = std::string("PERS tooldata t:=[TRUE,[[0,0,100],[1,0,0,0]],") + kLoad + "];";
  const std::string held = std::string("PERS wobjdata w:=[TRUE,TRUE,\"\",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];");
  const std::string still = replaced(tool, "TRUE", "FALSE");
  const std::string moved = replaced(held, "[TRUE,TRUE,\"\"", "[FALSE,FALSE,\"STN1\"");
  const std::vector<RemarkRow> rows = {
      {p, "", "no motion uses a robtarget, its tool is not known: left as it is: 2"},
      {tool + p, "MoveL p,v1,fine,t;\nMoveL p,v1,fine,tool0;\n",
       "a robtarget is used with two tools or work objects: left as it is: 2"},
      {held + p, "MoveL p,v1,fine,tool0;\nMoveL p,v1,fine,tool0\\WObj:=other;\n",
       "a robtarget is used with two tools or work objects: left as it is: 2"},
      {still + p, "MoveL p,v1,fine,t;\n",
       "a robtarget is relative to a tool that stands in the cell, or to an object that the robot holds: left as it "
       "is: 2"},
      {held + p, "MoveL p,v1,fine,tool0\\WObj:=w;\n",
       "a robtarget is relative to a tool that stands in the cell, or to an object that the robot holds: left as it "
       "is: 2"},
      {moved + p, "MoveL p,v1,fine,tool0\\WObj:=w;\n",
       "a robtarget is relative to a work object that a mechanical unit moves (ufprog FALSE): left as it is: 2"},
      {p, "MoveL p,v1,fine,CTool();\n",
       "a robtarget is used with a tool or work object that is known at run time only: left as it is: 2"},
      {replaced(p, "CONST", "PERS"), "p.trans.x:=p.trans.x+1;\n",
       "a robtarget or jointtarget is set at run time: left as it is: 2"},
      {"PERS jointtarget j:=[[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n", "j:=CJointT();\n",
       "a robtarget or jointtarget is set at run time: left as it is: 2"},
      {"CONST jointtarget j:=[[0,0,0,0,0,0],[90,9E9,9E9,9E9,9E9,9E9]];\n", "MoveExtJ j,vrot10,fine;\n",
       "a jointtarget moves external axes only: left as it is: 2"},
      {"CONST jointtarget j:=[[9E9,9E9,9E9,9E9,9E9,9E9],[90,9E9,9E9,9E9,9E9,9E9]];\n", "",
       "9E9 stands in place of a coordinate or joint value, a place that is not taught: left as it is: 2"},
      {"CONST robtarget p:=[[0,0,0],[0,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n", "MoveL p,v1,fine,tool0;\n",
       "the quaternion of a robtarget is far from norm 1: left as it is: 2"},
      {"CONST robtarget p:=[[x0+5,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n", "MoveL p,v1,fine,tool0;\n",
       "a robtarget or jointtarget is made of other data or computed: left as it is: 2"},
      {"CONST robtarget p:=[[- 5,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n", "MoveL p,v1,fine,tool0;\n",
       "a robtarget or jointtarget is made of other data or computed: left as it is: 2"},
      {"CONST robtarget p:=[[0x10,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n", "MoveL p,v1,fine,tool0;\n",
       "a robtarget or jointtarget is made of other data or computed: left as it is: 2"},
      {"CONST robtarget p:=[[0,0,0],[1,0,0,0],conf,[9E9,9E9,9E9,9E9,9E9,9E9]];\n", "MoveL p,v1,fine,tool0;\n",
       "a robtarget or jointtarget is made of other data or computed: left as it is: 2"},
      {"VAR confdata c:=[0,0,0,0];\n",
       "c.cf6:=-1;\nMoveJ [[0,0,0],[1,0,0,0],c,[9E9,9E9,9E9,9E9,9E9,9E9]],v1,fine,tool0;\n",
       "a robtarget or jointtarget is made of other data or computed: left as it is: 5"},
      {"VAR extjoint e:=[5,9E9,9E9,9E9,9E9,9E9];\n",
       "e.eax_a:=6;\nMoveJ [[0,0,0],[1,0,0,0],[0,0,0,0],e],v1,fine,tool0;\n",
       "a robtarget or jointtarget is made of other data or computed: left as it is: 5"},
  };
  for (const RemarkRow& row : rows) {
    const Program program = parsed(module(row.declarations, row.statements));
    EXPECT_THAT(remarks(program), ElementsAre(row.expected)) << row.declarations << row.statements;
    EXPECT_THAT(program.points, IsEmpty()) << row.declarations << row.statements;
    for (const ProgramMotion& motion : program.motions) {
      EXPECT_FALSE(motion.point || motion.is_known) << row.statements;
    }
  }
}

TEST(RapidProgram, SaysWhatTheControllerDecides) {
  const std::string p = "CONST robtarget p:=" + target() + ";\n";
  const std::string move = "MoveL p,v1,fine,tool0;\n";
  const std::string shift = " moves positions at run time: compensated where they are without that: 4";
  const std::string unknown = " holds a place that is known at run time only: not compensated here: 4";
  const std::string conveyor = " lets positions travel with a conveyor: compensated where they are while it stands: 4";
  const std::string off_path = " moves the arm off the programmed path at run time: not compensated there: 4";
  const std::string tool =
      "a tool or work object is set at run time: poses are compensated with its value in the program or "
      "in --frames: 4";
  const std::vector<RemarkRow> rows = {
      {p, "MoveL Offs(p,0,0,100),v1,fine,tool0;\n", "Offs" + shift, 1},
      {p, "MoveL RelTool(p,0,0,100\\Rz:=5),v1,fine,tool0;\n", "RelTool" + shift, 1},
      {p, "PDispOn\\Rot\\ExeP:=p,q,tool0;\n" + move, "PDispOn" + shift, 1},
      {p, "PDispSet frame;\n" + move, "PDispSet" + shift, 1},
      {p, "EOffsOn \\ExeP:=p,q;\n" + move, "EOffsOn" + shift, 1},
      {p, "waitwobj w\\RelDist:=10;\n" + move, "WaitWObj" + conveyor, 1},
      {p, "DropWObj w;\n" + move, "DropWObj" + conveyor, 1},
      {p, "CorrCon id;\n" + move, "CorrCon" + off_path, 1},
      {p, "MoveL p,v1,fine,tool0\\Corr;\n", "\\Corr" + off_path, 1},
      {p, "FCPressL p,v1,150,fine,tool0;\n", "FCPressL" + off_path, 1},
      {p, "SoftAct 3,90;\n" + move, "SoftAct makes the arm soft: it yields from where it is commanded: 4", 1},
      {p, "SearchL\\Stop,di1\\PosFlank,found,p,v1,tool0;\n",
       "a search stops where its signal comes: its end is compensated, not the place that it finds: 4", 1},
      {p, "MoveL elsewhere,v1,fine,tool0;\n" + move, "a target that the text does not declare" + unknown, 1},
      {p, "MoveL CRobT(\\Tool:=tool0),v1,fine,tool0;\n" + move, "the result of a function" + unknown, 1},
      {p, "MoveL weld{2}.place,v1,fine,tool0;\n" + move, "a computed target" + unknown, 1},
      {replaced(p, "\n", "VAR robtarget q;\n"), "MoveL q,v1,fine,tool0;\n" + move,
       "a target that is set at run time" + unknown, 1},
      {p, "tool0.tframe.trans.z:=5;\n" + move, tool, 1},
      {replaced(p, "\n", "PERS wobjdata w:=[FALSE,TRUE,\"\",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n"),
       "w.oframe:=[[1,2,3],[1,0,0,0]];\n" + move, tool, 1},
  };
  for (const RemarkRow& row : rows) {
    const Program program = parsed(module(row.declarations, row.statements));
    EXPECT_THAT(remarks(program), ElementsAre(row.expected)) << row.statements;
    EXPECT_THAT(program.points, SizeIs(row.points)) << row.statements;
  }
  // A motion to a target that the program sets, though it has a value before.
  const Program set = parsed(module(replaced(p, "CONST", "PERS"), "MoveL p,v1,fine,tool0;\np:=CRobT();\n"));
  EXPECT_THAT(remarks(set), UnorderedElementsAre("a robtarget or jointtarget is set at run time: left as it is: 2",
                                                 "a target that is set at run time" + unknown));
  // One of the arm's own that moves external axes as well.
  const Program both = parsed(module("CONST jointtarget j:=[[1,2,3,4,5,6],[90,9E9,9E9,9E9,9E9,9E9]];\n",
                                     "MoveExtJ j,vrot10,fine;\nMoveAbsJ j,v1,fine,tool0;\n"));
  EXPECT_THAT(names(both), ElementsAre("j"));
  EXPECT_THAT(both.motions, SizeIs(1));
  // A motion whose end is moved is not known, but its base is a place of this tool.
  const Program offset = parsed(module(p, rows[0].statements));
  EXPECT_FALSE(offset.motions.at(0).point || offset.motions.at(0).is_known);
  EXPECT_EQ(offset.points.at(0).tool_frame, "tool0");
  const Program parameter = parsed(
      "MODULE m\nPROC go(robtarget to \\switch fast|\\PERS wobjdata w)\nMoveL to,v1,fine,tool0;\nENDPROC\nENDMODULE");
  EXPECT_THAT(remarks(parameter), ElementsAre(replaced("a parameter of a routine" + unknown, "4", "3")));
  const Program several =
      parsed(module("", "MoveL Offs(a,0,0,1),v1,fine,tool0;\nx:=1;\nMoveL Offs(a,0,0,1),v1,fine,tool0;\n"));
  EXPECT_EQ(remarks(several).front(), replaced("Offs" + shift, "4", "3 5"));
}

TEST(RapidProgram, FindsTargetsAndToolsByTheOrderOfArguments) {
  const std::vector<std::string> instructions = {
      "MoveL p,v1,fine,t\\WObj:=w;",
      "MoveJ p\\ID:=5,v1\\V:=100,z1\\Inpos:=inpos20,t\\WObj:=w\\TLoad:=l;",
      "MoveL p,[100,500,5000,1000],[FALSE,0.3,0.3,0.3,0.03,0.3,0.03],t\\WObj:=w;",
      "MoveLDO p,v1,fine,t\\WObj:=w,do1,1;",
      "MoveLAO p,v1,fine,t\\WObj:=w,ao1,5;",
      "MoveJAO p,v1,fine,t\\WObj:=w,ao1,5;",
      "MoveJGO p,v1,fine,t\\WObj:=w,go1\\Value:=3;",
      "MoveLSync p,v1,fine,t\\WObj:=w,\"a \"\"routine\"\"\";",
      "TriggL p,v1,t1\\T2:=t2,fine,t\\WObj:=w;",
      "TriggJ \\Conc,p,v1,t1,fine,t\\WObj:=w;",
      "TriggLIOs p,v1\\TriggData1:=data,fine,t\\WObj:=w;",
      "SearchL\\Stop,di1,found,p,v1,t\\WObj:=w;",
      "ArcLStart p,v1,seam1,weld1\\Weave:=weave1,fine,t\\WObj:=w;",
      "ArcL p,v1,seam1,weld1,z1,t\\WObj:=w;",
      "ArcLEnd p,v1,seam1,weld1,fine,t\\WObj:=w;",
      "SpotL p,vmax,gun1,spot10,t\\WObj:=w;",
      "SpotJ p,vmax,gun1,spot10,t\\WObj:=w;",
      "DispL\\On,p,v1,bead1,z1,t\\WObj:=w;",
      "PaintL p,v1,z1,t\\WObj:=w;",
      "CapL p,v1,cap1,z1,t\\WObj:=w;"};
  for (const std::string& instruction : instructions) {
    const Program program = parsed(module("CONST robtarget p:=" + target() + ";\n", instruction + "\n"));
    ASSERT_THAT(names(program), ElementsAre("p")) << instruction;
    EXPECT_EQ(program.points[0].tool_frame, "t") << instruction;
    EXPECT_EQ(program.points[0].user_frame, "w") << instruction;
    ASSERT_THAT(program.motions, SizeIs(1)) << instruction;
    EXPECT_EQ(program.motions[0].is_straight, instruction.find("J") == std::string::npos) << instruction;
  }
  for (const char* circle :
       {"MoveC p,q,v1,z1,t;", "TriggC p,q,v1,t1,z1,t;", "ArcC p,q,v1,seam1,weld1,z1,t;", "SearchC di1,found,p,q,v1,t;",
        "MoveCDO p,q,v1,z1,t,do1,1;", "MoveCAO p,q,v1,z1,t,ao1,5;"}) {
    const Program program =
        parsed(module("CONST robtarget p:=" + target() + ";CONST robtarget q:=" + target() + ";\n", circle));
    ASSERT_THAT(program.motions, SizeIs(2)) << circle;
    EXPECT_EQ(program.motions[0].point, 0U) << circle;
    EXPECT_EQ(program.motions[1].point, 1U) << circle;
    EXPECT_EQ(program.points.at(0).tool_frame, "t") << circle;
    EXPECT_EQ(program.points.at(1).tool_frame, "t") << circle;
  }
  // A routine of the program, and instructions that only look like motions.
  const Program own =
      parsed(module("PROC ArcL(num n)\nENDPROC\n", "ArcL 5;\nTriggIO t1,5\\DOp:=do1,1;\nArcKill;\nMoveOn;\n"));
  EXPECT_THAT(own.motions, IsEmpty());
  EXPECT_THAT(own.remarks, IsEmpty());
}

// ---- Refusals ------------------------------------------------------------------------------------------------------

TEST(RapidProgram, RefusesWhatIsNoProgramWithLineAndExpectation) {
  const std::vector<std::pair<std::string, std::string>> rows = {
      {"PROC main()\nENDPROC\n", "IN.mod:1: 'PROC' is here, expected MODULE: a RAPID program"},
      {"", "IN.mod:1: the text ends, expected MODULE: a RAPID program"},
      {"MODULE a\nVAR num n;\n", "IN.mod:3: the text ends here without ENDMODULE, expected the whole program"},
      {"MODULE a\nENDMODULE\nPROC x()",
       "IN.mod:3: 'PROC' is here behind ENDMODULE, expected the end or another MODULE"},
      {"MODULE a\nMODULE b\n", "IN.mod:2: MODULE is here before ENDMODULE, expected one module after the other"},
      {"%%% VERSION:1\nMODULE a", "IN.mod:1: the header %%% does not end, expected %%% behind it"},
      {"MODULE a\nVAR string s:=\"x;\nENDMODULE",
       "IN.mod:2: the text '\"x;' does not end in its line, expected a quote"},
      {module("CONST robtarget p:=[[1,2,3],[1,0,0,0],[0,0,0,0]];\n", ""),
       "IN.mod:2: p: '[[1,2,3],[1,0,0,0],[0,0,0,0]]' has 3 members, expected "
       "[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],"},
      {module("CONST robtarget p:=[[1,2],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n", ""),
       "IN.mod:2: p: '[1,2]' has 2 members, expected [[x,y,z]"},
      {module("CONST jointtarget j:=[[1,2,3,4,5,6]];\n", ""), "expected [[rax_1,...,rax_6],[eax_a,...,eax_f]]"},
      {module("CONST robtarget p:=" + target("0.5,0,0,0") + ";\n", ""),
       "IN.mod:2: p: the configuration is '[0.5,0,0,0]', expected four whole numbers"},
      {module("CONST robtarget p:=[[1,\"2\",3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n", ""),
       "IN.mod:2: p: '\"2\"' is in '[1,\"2\",3]', expected [[x,y,z]"},
      {module("CONST robtarget p:=[[1 2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n", ""),
       "IN.mod:2: '2' is here, expected ',' or ';' behind the value"},
      {module("CONST robtarget p:=[[1,2,3],[1,0,0,0];\n", ""), "IN.mod:2: ';' is here, expected ']'"},
      {module("CONST robtarget p:=" + target() + "\n", ""),
       "IN.mod:3: 'PROC' is here, expected ',' or ';' behind the value"},
      {module("CONST robtarget p;\nVAR jointtarget P;\n", ""), "IN.mod:3: P is there twice, expected each name once"},
      {module("PERS tooldata t:=[TRUE,[[0,0,1],[1,0,0,0]]];\n", ""),
       "IN.mod:2: t: '[TRUE,[[0,0,1],[1,0,0,0]]]' has 2 members"},
      {module("PERS robtarget p{2}:=[" + target() + ";\n", ""), "IN.mod:2: ';' is here, expected ']'"},
      {module("", "MoveL p,v1;\n"), "IN.mod:3: 'MoveL' has 2 arguments, expected 3 or more: targets, speed and tool"},
      {module("", "MoveL p,v1,z1,tool0\n"), "IN.mod:4: 'ENDPROC' is here, expected ',' or ';' behind the value"},
      {module("", "x:=1\n"), "IN.mod:4: 'ENDPROC' is here, expected ';' behind the statement"},
      {module("", "MoveL p,v1,z1,tool0\nMoveL q,v1,z1,tool0;\n"), "IN.mod:4: 'MoveL' is here, expected ',' or ';'"},
      {module("CONST jointtarget j:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];\n", "MoveL j,v1,z1,tool0;\n"),
       "IN.mod:4: 'MoveL' moves to 'j', expected a robtarget"},
      {module("CONST robtarget p:=" + target() + ";\n", "MoveAbsJ p,v1,z1,tool0;\n"), "expected a jointtarget"},
      {module("CONST robtarget p{1}:=[" + target() + "];\n", "MoveL p{2},v1,z1,tool0;\n"),
       "IN.mod:4: 'p{2}' is no element of p, expected one of its 1"},
      {module("CONST robtarget p:=" + target() + ";\n", "MoveL p,v1,z1,p;\n"),
       "IN.mod:4: 'p' is no tooldata, expected one"},
      {module("", "IF x=1\n"), "a condition has no THEN and no statement, expected one"},
      {module("", "FOR i FROM 1 TO 2;\n"), "IN.mod:3: a loop has no do, expected it before the first statement"},
      {module("", "TEST n;\n"), "IN.mod:3: TEST has no CASE, expected one behind its value"},
      {module("", "CASE 1;\n"), "IN.mod:3: 'CASE' has no colon, expected one behind its values"},
      {module("", "MoveL Offs(p,0,0;\n"), "IN.mod:3: ';' is here, expected a value"},
      {module("", "PROC b()\n"), "IN.mod:3: 'PROC' is here within a routine, expected its end"},
      {"MODULE a\nRECORD r\nnum n;\n", "IN.mod:2: RECORD does not end, expected ENDRECORD"},
      {"MODULE a\nLOCAL num n;\nENDMODULE", "IN.mod:2: 'num' is here, expected CONST, PERS, VAR or a routine"},
  };
  for (const std::pair<std::string, std::string>& row : rows) {
    EXPECT_THAT(testing::refusal([&] { parsed(row.first); }), HasSubstr(row.second)) << row.first;
  }
}

TEST(RapidProgram, RefusesDeepNestingAndSurvivesEveryTruncation) {
  EXPECT_THAT(testing::refusal([] { parsed("MODULE a\nCONST robtarget p:=" + std::string(100000, '[')); }),
              HasSubstr("brackets are within each other"));
  EXPECT_THAT(testing::refusal([] { parsed("MODULE a\nVAR robtarget p{1,1,1,1}:=[[[["); }),
              HasSubstr("has 4 dimensions, expected at most 3"));
  for (std::size_t size = 0; size < kStation.size() - 1; ++size) {
    try {
      parsed(kStation.substr(0, size));
      ADD_FAILURE() << "a part of a program was read: " << size;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), AllOf(StartsWith("IN.mod:"), HasSubstr("expected")));
    }
  }
}

}  // namespace
}  // namespace kdl_calibration::rapid_test
