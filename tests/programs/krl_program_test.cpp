#include "programs/krl_program.hpp"

#include <gmock/gmock.h>

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "programs/number_fields.hpp"
#include "refusal.hpp"

namespace kdl_calibration::krl_program_test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Optional;
using ::testing::SizeIs;
using ::testing::StartsWith;

using Lines = std::vector<std::size_t>;

Program parsed(const std::string& src, const std::string& dat = "") {
  std::vector<ProgramText> texts;
  if (!src.empty() || dat.empty()) {
    texts.push_back({"IN.src", src});
  }
  if (!dat.empty()) {
    texts.push_back({"IN.dat", dat});
  }
  return kuka_krl().parse(texts);
}

// A routine with these lines, the first of which is line 2.
std::string routine(const std::string& lines) { return "DEF TEST()\n" + lines + "END\n"; }
std::string data(const std::string& lines) { return "DEFDAT TEST\n" + lines + "ENDDAT\n"; }

const ProgramPoint& point(const Program& program, const std::string& name) {
  const auto found = std::find_if(program.points.begin(), program.points.end(),
                                  [&](const ProgramPoint& each) { return each.name == name; });
  EXPECT_NE(found, program.points.end()) << name;
  static const ProgramPoint none;
  return found == program.points.end() ? none : *found;
}

std::vector<std::string> names(const Program& program) {
  std::vector<std::string> result;
  for (const ProgramPoint& each : program.points) {
    result.push_back(each.name);
  }
  return result;
}

// "tool base" of a point.
std::string frames(const ProgramPoint& point) {
  return point.tool_frame.value_or("none") + " " + point.user_frame.value_or("none");
}

// Lines of the remark with these words; none without such a remark.
Lines remarked(const Program& program, const std::string& words) {
  for (const ProgramRemark& remark : program.remarks) {
    if (remark.what.find(words) != std::string::npos) {
      return remark.lines;
    }
  }
  return {};
}

std::vector<double> values(const ProgramPoint& point) {
  std::vector<double> result;
  for (const NumberField& field : point.fields) {
    result.push_back(field.value);
  }
  return result;
}

std::string ends(const Program& program) {
  std::string result;
  for (const ProgramMotion& motion : program.motions) {
    result += fmt::format("{}{}{} ", motion.is_straight ? "-" : "~",
                          motion.point ? program.points[*motion.point].name : "?", motion.is_known ? "" : "!");
  }
  return result;
}

// Both texts with the numbers that `change` makes of each point.
template <class Change>
std::vector<std::string> rewritten(const std::vector<ProgramText>& texts, const Change& change) {
  Program program = kuka_krl().parse(texts);
  std::vector<std::vector<NumberField>> fields(texts.size());
  for (ProgramPoint& each : program.points) {
    change(each);
    fields[each.file].insert(fields[each.file].end(), each.fields.begin(), each.fields.end());
    fields[each.file].insert(fields[each.file].end(), each.turn_fields.begin(), each.turn_fields.end());
  }
  std::vector<std::string> result;
  for (std::size_t i = 0; i < texts.size(); ++i) {
    std::sort(fields[i].begin(), fields[i].end(),
              [](const NumberField& a, const NumberField& b) { return a.begin < b.begin; });
    result.push_back(with_numbers(texts[i].text, fields[i], kuka_krl()));
  }
  return result;
}

void keep(ProgramPoint&) {}

// As controllers write it.
const std::string& taught_src() {
  static const std::string text =
      "&ACCESS RVP\n&REL 7\n&PARAM EDITMASK = *\nDEF  weld( )\n;FOLD INI;%{PE}\n  ;FOLD BASISTECH INI\n"
      "    GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )\n    INTERRUPT ON 3 \n"
      "    BAS (#INITMOV,0 )\n  ;ENDFOLD (BASISTECH INI)\n;ENDFOLD (INI)\n\n"
      ";FOLD PTP HOME Vel=100 % DEFAULT;%{PE}%R 8.3.44,%MKUKATPBASIS,%CMOVE,%VPTP,%P 1:PTP, 2:HOME, 3:, 5:100\n"
      "$BWDSTART=FALSE\nPDAT_ACT=PDEFAULT\nFDAT_ACT=FHOME\nBAS(#PTP_PARAMS,100)\n$H_POS=XHOME\nPTP XHOME \n;ENDFOLD\n"
      ";FOLD PTP P1 Vel=50 % PDAT1 Tool[3]:torch Base[2]:table;%{PE}%R 8.3.44,%MKUKATPBASIS,%CMOVE,%VPTP\n"
      "$BWDSTART=FALSE\nPDAT_ACT=PPDAT1\nFDAT_ACT=FP1\nBAS(#PTP_PARAMS,50)\nPTP XP1 \n;ENDFOLD\n"
      ";FOLD CIRC P2 P3 CONT Vel=0.2 m/s CPDAT1 Tool[3]:torch Base[2]:table;%{PE}\n"
      "$BWDSTART=FALSE\nLDAT_ACT=LCPDAT1\nFDAT_ACT=FP3\nBAS(#CP_PARAMS,0.2)\nCIRC XP2, XP3 C_DIS C_DIS\n;ENDFOLD\n"
      ";FOLD SLIN P4 CONT Vel=2 m/s CPDAT2 Tool[3]:torch Base[0] ;%{PE}\n"
      "SLIN XP4 WITH $VEL = SVEL_CP(2.0, , LCPDAT2), $TOOL = STOOL2(FP4), $BASE = SBASE(FP4.BASE_NO), $IPO_MODE = "
      "SIPO_MODE(FP4.IPO_FRAME), $LOAD = SLOAD(FP4.TOOL_NO), $ACC = SACC_CP(LCPDAT2) C_Spl\n;ENDFOLD\nEND\n";
  return text;
}

const std::string& taught_dat() {
  static const std::string text =
      "&ACCESS RVP\n&REL 7\nDEFDAT  weld PUBLIC\n;FOLD EXTERNAL DECLARATIONS;%{PE}%MKUKATPBASIS,%CEXT,%VCOMMON,%P\n"
      "EXT  BAS (BAS_COMMAND  :IN,REAL  :IN )\nDECL INT SUCCESS\n;ENDFOLD (EXTERNAL DECLARATIONS)\n"
      "DECL BASIS_SUGG_T LAST_BASIS={POINT1[] \"P4;{      \",POINT2[] \"P4\",CONT[] \"C_DIS C_DIS\"}\n"
      "DECL E6POS XP1={X 1120.5,Y -310.25,Z 870.125,A 92.7829285,B 45.5,C -179.75,S 6,T 50,E1 0.0,E2 0.0,E3 0.0,E4 0.0,"
      "E5 0.0,E6 0.0}\nDECL FDAT FP1={TOOL_NO 3,BASE_NO 2,IPO_FRAME #BASE,POINT2[] \" \",TQ_STATE FALSE}\n"
      "DECL PDAT PPDAT1={VEL 100.000,ACC 100.000,APO_DIST 100.000,GEAR_JERK 50.0000,EXAX_IGN 0}\n"
      "DECL E6POS XP2={X 1.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0,S 2,T 35,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}\n"
      "DECL E6POS XP3={X 7.0,Y 8.0,Z 9.0,A 4.0,B 5.0,C 6.0,S 2,T 35,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}\n"
      "DECL FDAT FP3={TOOL_NO 3,BASE_NO 2,IPO_FRAME #BASE,POINT2[] \"XP2\",TQ_STATE FALSE}\n"
      "DECL E6POS XP4={X 17.0,Y 8.0,Z 9.0,A 4.0,B 5.0,C 6.0,S 2,T 35,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}\n"
      "DECL FDAT FP4={TOOL_NO 3,BASE_NO 0,IPO_FRAME #BASE,POINT2[] \" \",TQ_STATE FALSE}\nENDDAT\n";
  return text;
}

TEST(KrlProgram, ReadsTaughtPointsInTheFramesOfTheirMotions) {
  const Program program = parsed(taught_src(), taught_dat());
  EXPECT_THAT(names(program), ElementsAre("XP1", "XP2", "XP3", "XP4"));
  EXPECT_EQ(ends(program), "~?! ~XP1 -XP2 -XP3 -XP4 ");
  for (const char* name : {"XP1", "XP2", "XP3"}) {
    EXPECT_EQ(frames(point(program, name)), "3 2") << name;
  }
  EXPECT_EQ(frames(point(program, "XP4")), "3 0");
  const ProgramPoint& first = point(program, "XP1");
  EXPECT_EQ(first.file, 1);
  EXPECT_EQ(first.line, 9);
  EXPECT_EQ(first.notation, PointNotation::moving_zyx);
  EXPECT_THAT(values(first), ElementsAre(1120.5, -310.25, 870.125, 92.7829285, 45.5, -179.75));
  EXPECT_EQ(first.fields[0].decimals, 3);
  EXPECT_EQ(first.fields[3].decimals, 7);
  EXPECT_EQ(first.fields[4].decimals, 4);
  EXPECT_THAT(first.external, SizeIs(6));
  EXPECT_THAT(remarked(program, "another file declares"), ElementsAre(19)) << "XHOME is in $config.dat";
  EXPECT_THAT(program.remarks, SizeIs(1));
  EXPECT_TRUE(program.frames.user.at("0").isApprox(Eigen::Isometry3d::Identity()));
  EXPECT_TRUE(program.frames.tool.at("0").isApprox(Eigen::Isometry3d::Identity()));
}

TEST(KrlProgram, ReadsADataListAloneInTheFramesOfItsFdat) {
  const Program program = parsed("", taught_dat());
  EXPECT_THAT(names(program), ElementsAre("XP1", "XP3", "XP4"));
  EXPECT_EQ(frames(point(program, "XP1")), "3 2");
  EXPECT_EQ(frames(point(program, "XP4")), "3 0");
  EXPECT_THAT(remarked(program, "have no FDAT: left"), ElementsAre(12));
}

TEST(KrlProgram, ReadsARoutineAlone) {
  const Program program = parsed(taught_src());
  EXPECT_THAT(program.points, IsEmpty());
  EXPECT_EQ(ends(program), "~?! ~?! -?! -?! -?! ");
  EXPECT_THAT(remarked(program, "another file declares"), ElementsAre(19, 26, 33, 36));
}

TEST(KrlProgram, ReadsPositionsThatStandInMotions) {
  const Program program =
      parsed(routine("$TOOL=TOOL_DATA[1]\n$BASE = BASE_DATA[2] ; table\n"
                     "PTP {A1 0, A2 -90, A3 90, A4 0, A5 0, A6 0}\n"
                     "ptp{E6Axis: a1 +3,a2 -.5,a3 1.5E-3,a4 0,a5 10.12345,a6 1e1,e1 0} C_PTP\n"
                     "LIN {E6POS: X 1, Y 2, Z 3, A 4, B 5, C 6, E1 0} C_DIS\n"
                     "CIRC {X 1,Y 2,Z 3,A 4,B 5,C 6}, {X 7,Y 8,Z 9,A 10,B 11,C 12} C_ORI\n"
                     "SPL {X 1,Y 2,Z 3,A 4,B 5,C 6,S 'B010',T 'H23'} C_VEL\n"));
  ASSERT_THAT(program.points, SizeIs(6));
  EXPECT_EQ(
      ends(program),
      "~PTP {...} in line 4 ~ptp {...} in line 5 -LIN {...} in line 6 -CIRC {...} in line 7 -CIRC {...} in line 7 "
      "-SPL {...} in line 8 ");
  EXPECT_EQ(program.points[1].notation, PointNotation::joints);
  EXPECT_THAT(values(program.points[1]), ElementsAre(3, -0.5, 0.0015, 0, 10.12345, 10));
  EXPECT_EQ(program.points[1].fields[2].decimals, 4);
  EXPECT_EQ(program.points[1].fields[4].decimals, 5);
  EXPECT_EQ(frames(program.points[2]), "1 2");
  EXPECT_FALSE(program.points[2].branch.has_value()) << "LIN stays in the branch where the arm is";
  EXPECT_THAT(values(program.points[4]), ElementsAre(7, 8, 9, 10, 11, 12));
  EXPECT_EQ(program.points[5].turn_fields.at(0).value, 35);
  EXPECT_EQ(program.points[5].branch->front, true);
  EXPECT_EQ(program.points[5].branch->elbow_up, true);
  EXPECT_THAT(program.remarks, IsEmpty());
}

TEST(KrlProgram, FindsComponentsByTheirNames) {
  const Program program = parsed(routine("BAS(#BASE,1)\nBAS(#TOOL,1)\nLIN {C 6,A 4,B 5,T 35,Z 3,X 1,S 2,Y 2}\n"));
  EXPECT_THAT(values(program.points.at(0)), ElementsAre(1, 2, 3, 4, 5, 6));
}

// The branch that S and T of a pose state.
ArmBranch branch(const std::string& words) {
  const Program program = parsed(routine("BAS(#INITMOV,0)\nPTP {X 1,Y 2,Z 3,A 4,B 5,C 6" + words + "}\n"));
  return program.points.at(0).branch.value_or(ArmBranch());
}

// KUKA's "Status": bit 0 behind axis 1, bit 1 axis 3 above its stretched position, bit 2 axis 5 below zero.
TEST(KrlProgram, ReadsShoulderElbowAndWristFromStatus) {
  struct Case {
    int status;
    bool front;
    bool elbow_up;
    bool wrist_positive;
  };
  for (const Case& each : {Case{2, true, true, true}, Case{0, true, false, true}, Case{3, false, true, true},
                           Case{6, true, true, false}, Case{7, false, true, false}, Case{18, true, true, true}}) {
    const ArmBranch found = branch(fmt::format(",S {}", each.status));
    EXPECT_THAT(found.front, Optional(each.front)) << each.status;
    EXPECT_THAT(found.elbow_up, Optional(each.elbow_up)) << each.status;
    EXPECT_THAT(found.wrist_positive, Optional(each.wrist_positive)) << each.status;
    EXPECT_FALSE(found.turns[0].has_value());
  }
  EXPECT_FALSE(branch("").front.has_value());
}

TEST(KrlProgram, ReadsSignsOfAxesFromTurn) {
  const ArmBranch found = branch(",T 50");  // A2, A5 and A6 are negative
  const std::vector<bool> negative = {false, true, false, false, true, true};
  for (std::size_t i = 0; i < 6; ++i) {
    ASSERT_TRUE(found.turns[i].has_value());
    const JointInterval& interval = *found.turns[i];
    EXPECT_EQ(interval.contains(-6.0), negative[i]) << i;
    EXPECT_EQ(interval.contains(6.0), !negative[i]) << i;
    EXPECT_EQ(interval.contains(0.0), !negative[i]) << i;
  }
  EXPECT_FALSE(found.front.has_value());
}

// At {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0} controllers show S 2 and T 2; S has bit 2 where T has bit 4.
TEST(KrlProgram, StatusAndTurnAgreeAboutAxisFive) {
  for (const auto& [status, turn] : std::vector<std::pair<int, int>>{{2, 2}, {2, 35}, {2, 43}, {6, 50}, {6, 19}}) {
    const ArmBranch found = branch(fmt::format(",S {},T {}", status, turn));
    EXPECT_EQ(found.turns[4]->contains(0.5), found.wrist_positive.value()) << turn;
  }
}

TEST(KrlProgram, CountsNegativeAxesAsTurn) {
  SixJoints q;
  q << 0.0, -1.6, 1.6, 0.0, 0.0, 0.0;
  EXPECT_THAT(kuka_krl().turns(q), ElementsAre(2));
  q << -0.1, -1.6, 1.6, 3.0, -0.2, -5.0;
  EXPECT_THAT(kuka_krl().turns(q), ElementsAre(1 + 2 + 16 + 32));
}

TEST(KrlProgram, WritesTurnInItsNotation) {
  EXPECT_EQ(kuka_krl().write("35", 2, 0), "2");
  EXPECT_EQ(kuka_krl().write("'B100011'", 2, 0), "'B000010'");
  EXPECT_EQ(kuka_krl().write("'b10'", 35, 0), "'b100011'");
  EXPECT_EQ(kuka_krl().write("'H23'", 43, 0), "'H2B'");
  EXPECT_EQ(kuka_krl().write("'H2b'", 43, 0), "'H2b'");
  EXPECT_EQ(kuka_krl().write("+3", 3.25, 3), "3.250");
}

TEST(KrlProgram, WritesATurnThatBecomesZero) {
  const std::string src = routine("BAS(#INITMOV,0)\nPTP {X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 'B000010'}\n");
  const auto result = rewritten({{"IN.src", src}}, [](ProgramPoint& each) { each.turn_fields[0].value = 0; });
  EXPECT_THAT(result[0], HasSubstr("C 6,S 2,T 'B000000'}"));
}

TEST(KrlProgram, ChangesNoOtherByteThanNumbersOfPoints) {
  std::string src = "\xEF\xBB\xBF" + taught_src() +
                    "; Gr\xFC\xDF"
                    "e \xC3\xA4\n";
  std::string dat = taught_dat();
  for (std::string* text : {&src, &dat}) {
    for (std::size_t at = text->find('\n'); at != std::string::npos; at = text->find('\n', at + 2)) {
      text->insert(at, "\r");
    }
  }
  const std::vector<ProgramText> texts = {{"IN.src", src}, {"IN.dat", dat}};
  EXPECT_THAT(rewritten(texts, keep), ElementsAre(src, dat));
  std::string expected = dat;
  expected.replace(expected.find("Y -310.25"), 9, "Y 12.346");
  expected.replace(expected.find("T 50"), 4, "T 18");
  const auto changed = rewritten(texts, [](ProgramPoint& each) {
    if (each.name == "XP1") {
      each.fields[1].value = 12.3456;
      each.turn_fields[0].value = 18;
    }
  });
  EXPECT_THAT(changed, ElementsAre(src, expected));
}

// Whether one that is zero everywhere is there, the user says.
TEST(KrlProgram, ReadsExternalAxes) {
  const Program program = parsed("", data("E6AXIS XA={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0,E1 250.5,E2 0.0}\n"
                                          "E6AXIS XB={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0,E1 0.0,E2 0.0}\n"));
  for (const auto& [name, value] : {std::pair("XA", 250.5), std::pair("XB", 0.0)}) {
    const ProgramPoint& each = point(program, name);
    ASSERT_THAT(each.external, SizeIs(2)) << name;
    for (const int axis : {1, 2}) {
      const ExternalValue& external = each.external[static_cast<std::size_t>(axis - 1)];
      EXPECT_EQ(external.axis, axis);
      EXPECT_EQ(external.value, axis == 1 ? value : 0.0);
      EXPECT_FALSE(external.is_length.has_value());
    }
  }
}

TEST(KrlProgram, ReadsVariablesOfDataListsAndRoutines) {
  const Program program = parsed(
      routine("DECL AXIS HOME\nDECL INT N\nHOME={AXIS:A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\nPTP HOME\nBAS(#INITMOV,0)\n"
              "LIN xp[2]\nLIN XP [ 1 ]\nLIN XP[N]\nLIN XQ[1,FIRST]\n"),
      data("DECL GLOBAL CONST INT FIRST=1\nDECL GLOBAL POS XP[2]\nXP[1]={X 1,Y 2,Z 3,A 4,B 5,C 6}\n"
           "XP[2]={X 2,Y 2,Z 3,A 4,B 5,C 6} ; second\nPOS XQ[1,2]\nXQ[1,1]={X 3,Y 2,Z 3,A 4,B 5,C 6}\n"
           "DECL FRAME OFFSET={X 0,Y 0,Z 100,A 0,B 0,C 0}\n"));
  EXPECT_THAT(names(program), ElementsAre("HOME", "XP[1]", "XP[2]", "XQ[1,1]"));
  EXPECT_EQ(ends(program), "~HOME -XP[2] -XP[1] -?! -XQ[1,1] ");
  EXPECT_THAT(remarked(program, "known at run time only: not compensated"), ElementsAre(9));
  EXPECT_THAT(program.remarks, SizeIs(1)) << "a frame that no motion ends in is none of a point";
}

TEST(KrlProgram, TellsVariablesOfRoutinesApart) {
  const Program program = parsed(
      "DEF A()\nDECL AXIS H\nH={A1 1,A2 -90,A3 90,A4 0,A5 0,A6 0}\nPTP H\nEND\n"
      "DEF B()\nDECL AXIS H\nH={A1 2,A2 -90,A3 90,A4 0,A5 0,A6 0}\nPTP H\nEND\n");
  EXPECT_THAT(names(program), ElementsAre("H", "H"));
  EXPECT_EQ(program.motions.at(0).point, 0);
  EXPECT_FALSE(program.motions.at(1).is_known) << "between routines";
  EXPECT_EQ(program.motions.at(2).point, 1);
}

// ---- Points that stay as they are ----------------------------------------------------------------------------------

const std::string kPoints =
    "E6POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}\nE6POS XP2={X 2,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}\n"
    "E6POS XP3={X 3,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}\n";

TEST(KrlProgram, LeavesPointsThatTheProgramChanges) {
  const Program program = parsed(routine("BAS(#INITMOV,0)\nXP1.Z=XP1.Z+10\nPTP XP1\nXP2=XP3\nPTP XP2\nPTP XP3\n"
                                         "XA[I]={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\n"),
                                 data(kPoints + "AXIS XA[1]\nXA[1]={A1 1,A2 -90,A3 90,A4 0,A5 0,A6 0}\n"));
  EXPECT_THAT(names(program), ElementsAre("XP3"));
  EXPECT_EQ(ends(program), "~?! ~?! ~XP3 ");
  EXPECT_THAT(remarked(program, "changes at run time, or uses"), ElementsAre(2, 3, 6));
  EXPECT_THAT(remarked(program, "copies a compensated point"), ElementsAre(3, 5));
}

TEST(KrlProgram, LeavesPointsThatAreFramesAsWell) {
  const Program program = parsed(routine("BAS(#INITMOV,0)\nLIN XP1\n$BASE=XP1\n"), data(kPoints));
  EXPECT_THAT(names(program), IsEmpty());
  EXPECT_THAT(remarked(program, "or uses as a frame"), ElementsAre(2));
}

TEST(KrlProgram, KnowsConstantsOfTheDataListInRoutines) {
  const Program program = parsed(routine("XQ[FIRST]={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\nPTP XQ[3]\n"),
                                 data("CONST INT FIRST=3\nAXIS XQ[4]\n"));
  EXPECT_EQ(ends(program), "~XQ[FIRST] ");
}

TEST(KrlProgram, LeavesPartialAndComputedPositions) {
  const Program program =
      parsed(routine("BAS(#INITMOV,0)\nPTP {A1 10}\nLIN {Z 100} C_DIS\nPTP {E1 0}\nLIN {X H,Y 2,Z 3,A 4,B 5,C 6}\n"
                     "LIN {X 1,Y 2,Z 3,A 4,B 5,C -(H+1)}\n"));
  EXPECT_THAT(program.points, IsEmpty());
  EXPECT_EQ(ends(program), "~?! -?! ~?! -?! -?! ");
  EXPECT_THAT(remarked(program, "some of six components"), ElementsAre(3, 4, 5));
  EXPECT_THAT(remarked(program, "component that is computed"), ElementsAre(6, 7));
}

TEST(KrlProgram, LeavesPlacesOfAToolInTheCell) {
  const Program program = parsed(
      routine("FDAT_ACT=FP1\nBAS(#FRAMES)\nPTP XP1\n$IPO_MODE=#BASE\nPTP XP2\n$IPO_MODE = #TCP\nPTP {X 3,Y 2,Z 3,A 4,B "
              "5,C 6}\nSLIN XP3 WITH $TOOL=STOOL(1), $BASE=SBASE(1), $IPO_MODE=#BASE\n"),
      data(kPoints + "FDAT FP1={TOOL_NO 1,BASE_NO 1,IPO_FRAME #TCP}\n"));
  EXPECT_THAT(names(program), ElementsAre("XP2", "XP3"));
  for (const ProgramRemark& remark : program.remarks) {
    EXPECT_THAT(remark.what, HasSubstr("#TCP"));
    EXPECT_THAT(remark.lines, remark.file == 0 ? ElementsAre(8) : ElementsAre(2));
  }
  const Program untold = parsed(routine("PTP XP1\n"), data("POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6}\n"
                                                           "FDAT FP1={TOOL_NO 0,BASE_NO 0,IPO_FRAME #TCP}\n"));
  EXPECT_THAT(names(untold), IsEmpty()) << "the text has no $IPO_MODE: that of the FDAT";
  EXPECT_THAT(remarked(untold, "#TCP states points relative to a tool that stands in the cell"), ElementsAre(2));
}

TEST(KrlProgram, LeavesPointsThatAreUsedWithTwoToolsOrBases) {
  const Program program = parsed(routine("BAS(#INITMOV,0)\nPTP XP1\nPTP XP2\nPTP XP3\nBAS(#TOOL,2)\nPTP XP1\nBAS(#TOOL,"
                                         "1)\nPTP XP3\nBAS(#BASE,1)\nPTP XP2\n"),
                                 data(kPoints));
  EXPECT_THAT(names(program), ElementsAre("XP3"));
  EXPECT_THAT(remarked(program, "two tools or bases"), ElementsAre(2, 3));
}

TEST(KrlProgram, LeavesPointsInFramesThatAreSetAtRunTime) {
  const Program program = parsed(routine("BAS(#INITMOV,0)\n$BASE=BASE_DATA[2]:OFFSET\nPTP XP1\nBAS(#BASE,N)\nPTP XP2\n"
                                         "$BASE=EK(ROOT,#EASYS,BASE_DATA[2])\nLIN {X 3,Y 2,Z 3,A 4,B 5,C 6}\n"
                                         "BAS(#BASE,2)\nPTP XP3\n$TOOL.X=3\nPTP {X 3,Y 2,Z 3,A 4,B 5,C 6}\n"
                                         "PTP {A1 1,A2 -90,A3 90,A4 0,A5 0,A6 0}\n"),
                                 data(kPoints));
  EXPECT_THAT(names(program), ElementsAre("PTP {...} in line 13", "XP3"));
  EXPECT_EQ(program.points[0].notation, PointNotation::joints) << "needs no frame";
  EXPECT_THAT(remarked(program, "$TOOL or $BASE is set at run time"), ElementsAre(3, 5, 11));
  EXPECT_THAT(remarked(program, "couples the base"), ElementsAre(7));
  EXPECT_THAT(remarked(program, "tool or base is known at run time only"), ElementsAre(8, 12));
}

TEST(KrlProgram, TakesNoNumberOfAnFdatThatTheProgramChanges) {
  const Program program =
      parsed(routine("BAS(#INITMOV,0)\n$BASE=$NULLFRAME\nFP1.TOOL_NO=2\nBAS(#TOOL,FP1.TOOL_NO)\nPTP XP1\n"),
             data("POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6}\nFDAT FP1={TOOL_NO 0,BASE_NO 0,IPO_FRAME #BASE}\n"));
  EXPECT_THAT(names(program), IsEmpty());
  EXPECT_THAT(remarked(program, "$TOOL or $BASE is set at run time"), ElementsAre(5));
  EXPECT_THAT(remarked(program, "tool or base is known at run time only"), ElementsAre(2));
}

TEST(KrlProgram, KeepsNoFramesOfTheFdatBeforeOneOfAnotherFile) {
  const Program program = parsed(routine("BAS(#INITMOV,0)\nFDAT_ACT=FP1\nBAS(#PTP_PARAMS,100)\nPTP XP1\n"
                                         "FDAT_ACT=FHOME\nBAS(#PTP_PARAMS,100)\nPTP {X 3,Y 2,Z 3,A 4,B 5,C 6}\n"),
                                 data("POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6}\n"
                                      "FDAT FP1={TOOL_NO 4,BASE_NO 5,IPO_FRAME #BASE}\n"));
  EXPECT_THAT(names(program), ElementsAre("XP1"));
  EXPECT_EQ(frames(point(program, "XP1")), "4 5");
  EXPECT_THAT(remarked(program, "tool or base is known at run time only"), ElementsAre(8));
}

TEST(KrlProgram, StatesNoFrameWhereTheTextSetsNone) {
  const Program program = parsed(routine("PTP XP1\nBAS(#TOOL,4)\nPTP XP2\n"), data(kPoints));
  EXPECT_EQ(frames(point(program, "XP1")), "none none");
  EXPECT_EQ(frames(point(program, "XP2")), "4 none");
  EXPECT_THAT(remarked(program, "nothing here moves to"), ElementsAre(4));
}

// ---- What is known at run time only --------------------------------------------------------------------------------

TEST(KrlProgram, SaysWhichMotionsEndElsewhere) {
  const Program program = parsed(
      routine("DECL FRAME F\nBAS(#INITMOV,0)\nLIN XP1:{X 10}\nLIN {X 1,Y 2,Z 3,A 4,B 5,C 6}:F\nLIN ABOVE(XP1)\nLIN F\n"
              "PTP $POS_ACT\nPTP $POS_INT\nPTP STATION.P\nLIN_REL {X 150}#TOOL\nPTP_REL {A1 10}\nPTP XP1\n"
              "CIRC XP2,XP3,CA 360 C_DIS\nCIRC_REL {X 1},{Y 2}\n"),
      data(kPoints));
  EXPECT_EQ(ends(program), "-?! -?! -?! -?! ~?! ~?! ~?! -?! ~?! ~XP1 -XP2 -XP3! -?! -?! ");
  EXPECT_THAT(remarked(program, "known at run time only: not compensated"), ElementsAre(4, 5, 6, 7, 9));
  EXPECT_THAT(remarked(program, "another file declares"), ElementsAre(10));
  EXPECT_THAT(remarked(program, "by an increment"), ElementsAre(11, 12, 15));
  EXPECT_THAT(remarked(program, "CA ends a circle"), ElementsAre(14));
  EXPECT_THAT(names(program), ElementsAre("XP1", "XP2", "XP3"));
}

TEST(KrlProgram, SaysWhatMovesPointsAtRunTime) {
  const Program program = parsed(
      routine("BAS(#INITMOV,0)\nBASE_CORR_ON=TRUE\nTOOL_CORR_ON = FALSE\nRSI_MOVECORR()\nBASE_DATA[N]=F\nPTP XP1\n"
              "SHIFTED=XP1\nHEIGHT=XP1.Z+3\n"),
      data("E6POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6,S 18,T 2}\n"));
  EXPECT_THAT(remarked(program, "BASE_CORR_ON"), ElementsAre(3));
  EXPECT_THAT(remarked(program, "a sensor corrects"), ElementsAre(5));
  EXPECT_THAT(remarked(program, "BASE_DATA is set at run time"), ElementsAre(6));
  EXPECT_THAT(remarked(program, "copies a compensated point"), ElementsAre(8, 9));
  EXPECT_THAT(remarked(program, "absolutely accurate robot"), ElementsAre(2));
  EXPECT_THAT(names(program), ElementsAre("XP1"));
}

TEST(KrlProgram, KnowsItsTexts) {
  for (const std::string& text :
       {taught_src(), taught_dat(), std::string("\xEF\xBB\xBF; x\r\n\r\nglobal def a ( )\r\n"),
        std::string("DEFFCT INT F(A:IN)\n")}) {
    EXPECT_TRUE(kuka_krl().is_written_in(text)) << text;
  }
  for (const char* text : {"", "/PROG  TEST\n/ATTR\n", "MODULE m\n  PROC main()\n", "def prog():\n  movej()\nend\n",
                           "END\n", "; DEF\n", "#!/usr/bin/python3\ndef f(x):\n", "DEFINE\n"}) {
    EXPECT_FALSE(kuka_krl().is_written_in(text)) << text;
  }
}

TEST(KrlProgram, RefusesTextsThatAreNoProgram) {
  struct Case {
    std::string text;
    const char* message;
  };
  for (const Case& each : std::vector<Case>{
           {"", "IN.src:1: holds no DEF, no DEFFCT and no DEFDAT, expected a program in KRL"},
           {"X=1\n", "IN.src:1: has 'X=1' before DEF, DEFFCT or DEFDAT, expected a program in KRL"},
           {"DEF A()\nPTP HOME\n", "IN.src:2: ends without END, expected the whole routine"},
           {"DEFDAT A\nINT X=1\n", "IN.src:2: ends without ENDDAT, expected the whole data list"},
           {"DEF A()\nDEF B()\nEND\n",
            "IN.src:2: has 'DEF B()' inside of another routine or data list, expected its end before"},
           {"DEFDAT A\nEND\n", "IN.src:2: has 'END', expected ENDDAT"},
           {"DEF A()\nENDDAT\n", "IN.src:2: has 'ENDDAT', expected END"},
           {routine("PTP\n"), "IN.src:2: has 'PTP' without its end, expected a point"},
           {routine("LIN ,XP1\n"), "IN.src:2: has 'LIN' without its end, expected a point"},
           {routine("CIRC XP1\n"), "IN.src:2: has 'CIRC' without two points, expected both"},
           {routine("PTP 'x'\n"), "IN.src:2: has ''x'' as the end of a motion, expected a point"},
           {routine("PTP {A1 0,A2 -90\n"), "IN.src:2: has '{A1 0,A2 -90' without its end, expected } in the same line"},
           {routine("PTP {A1 0,X 1}\n"),
            "IN.src:2: PTP {...}: has components of a pose and of joint values, expected one of both"},
           {routine("PTP {A1 0,Q 1}\n"),
            "IN.src:2: PTP {...}: has 'Q', expected X Y Z A B C S T or A1 to A6, and E1 to E6"},
           {data("POS XP={X 1,Y 1,x 2}\n"), "IN.src:2: XP: has x twice"},
           {data("POS XP={X 1,S 2,S 2}\n"), "IN.src:2: XP: has S twice"},
           {data("POS XP={X 1,E1 2,E1 2}\n"), "IN.src:2: XP: has E1 twice"},
           {data("POS XP={X 1.2.3}\n"), "IN.src:2: XP: X is '1.2.3', expected a number"},
           {data("POS XP={X }\n"), "IN.src:2: XP: X is '', expected a number"},
           {data("POS XP={X 1e300}\n"), "IN.src:2: XP: X is '1e300', expected a number"},
           {data("POS XP={X 1,S -1}\n"), "IN.src:2: XP: S is '-1', expected 0 to 63"},
           {data("POS XP={X 1,T 64}\n"), "IN.src:2: XP: T is '64', expected 0 to 63"},
           {data("POS XP={X 1,T 2.5}\n"), "IN.src:2: XP: T is '2.5', expected 0 to 63"},
           {data("POS XP={X 1}\nINT I=1\nPOS xp={X 1}\n"),
            "IN.src:4: xp is declared twice, expected each variable once"},
       }) {
    EXPECT_EQ(testing::refusal([&] { static_cast<void>(parsed(each.text)); }), each.message);
  }
}

TEST(KrlProgram, ReadsOrRefusesEveryBeginning) {
  for (std::size_t i = 0; i + 1 < taught_src().size(); ++i) {
    EXPECT_REFUSED("IN.src:", parsed(taught_src().substr(0, i)));
  }
  const std::string whole = data("E6POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 'B11'}\nFDAT FP1={TOOL_NO 1,BASE_NO 2}\n");
  for (std::size_t i = 1; i + 1 < whole.size(); ++i) {
    EXPECT_REFUSED("IN.dat:", parsed("", whole.substr(0, i)));
  }
}

}  // namespace
}  // namespace kdl_calibration::krl_program_test
