#include "programs/krl_frames.hpp"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <string>
#include <utility>
#include <vector>

#include "programs/krl_program.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::krl_frames_test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using testing::kDegree;

using Lines = std::vector<std::size_t>;

Program parsed(const std::string& lines, const std::string& data = "") {
  std::vector<ProgramText> texts = {{"IN.src", "DEF MAIN()\n" + lines}};
  if (!lines.ends_with("END\n")) {
    texts[0].text += "END\n";
  }
  if (!data.empty()) {
    texts.push_back({"IN.dat", "DEFDAT MAIN\n" + data + "ENDDAT\n"});
  }
  return kuka_krl().parse(texts);
}

// "tool base" of each pose.
std::vector<std::string> frames(const Program& program) {
  std::vector<std::string> result;
  for (const ProgramPoint& point : program.points) {
    result.push_back(point.tool_frame.value_or("none") + " " + point.user_frame.value_or("none"));
  }
  return result;
}

std::vector<std::string> frames(const std::string& lines, const std::string& data = "") {
  return frames(parsed(lines, data));
}

// Lines of poses whose frames the flow of the program does not settle.
Lines uncertain(const std::string& lines, const std::string& data = "") {
  for (const ProgramRemark& remark : parsed(lines, data).remarks) {
    if (remark.what.starts_with("tool or base depend on a branch")) {
      return remark.lines;
    }
  }
  return {};
}

const std::string kPose = "LIN {X 1,Y 2,Z 3,A 4,B 5,C 6}\n";
const std::string kTool1 = "BAS(#INITMOV,0)\n";
const std::string kTool2 = "BAS(#TOOL,2)\n";

TEST(KrlFrames, ReadsEveryNotation) {
  for (const auto& [lines, expected] : std::vector<std::pair<std::string, std::string>>{
           {"BAS(#INITMOV,0)\n", "1 0"},
           {"bas ( #tool, 3 )\nBAS(#BASE,4)\n", "3 4"},
           {"BAS(#TOOL,0)\nBAS(#BASE,0)\n", "0 0"},
           {"$TOOL=TOOL_DATA[3]\n$BASE=BASE_DATA[T]\n", "3 5"},
           {"$TOOL = $NULLFRAME\n$base=$world ; cell\n", "0 0"},
           {"$TOOL={X 0,Y 0,Z 0,A 0,B 0,C 0}\n$BASE = {FRAME: X 1,Y 0,Z 0,A 90,B 0.5,C 0}\n",
            "0 {X 1,Y 0,Z 0,A 90,B 0.5,C 0}"},
           {"$TOOL=TORCH\n$BASE=TABLES[2]\n", "{X 0,Y 0,Z 250,A 0,B 0,C 0} {X 9,Y 0,Z 0,A 0,B 0,C 0}"},
           {"FDAT_ACT=F1\nBAS(#FRAMES)\n", "6 7"},
           {"FDAT_ACT = {TOOL_NO 8,BASE_NO 9,IPO_FRAME #BASE}\nBAS (#PTP_PARAMS,100 )\n", "8 9"},
           {"FDAT_ACT=F1\nFDAT_ACT.BASE_NO=3\nBAS(#CP_PARAMS,2)\n", "6 3"},
           {"$TOOL=STOOL2(F1)\n$BASE=SBASE(F1.BASE_NO)\n", "6 7"},
           {"$TOOL=STOOL(T)\n$BASE=SBASE(0)\n", "5 0"},
           {"BAS(#TOOL,1)\nBAS(#PTP_DAT)\nBAS(#VEL_PTP,30)\n", "1 none"}}) {
    const Program program = parsed(lines + kPose,
                                   "CONST INT T=5\nDECL FDAT F1={TOOL_NO 6,BASE_NO 7,IPO_FRAME #BASE}\n"
                                   "FRAME TORCH={X 0,Y 0,Z 250,A 0,B 0,C 0}\nFRAME TABLES[2]\n"
                                   "TABLES[2]={X 9,Y 0,Z 0,A 0,B 0,C 0}\n");
    EXPECT_THAT(frames(program), ElementsAre(expected)) << lines;
    EXPECT_THAT(program.remarks, IsEmpty()) << lines;
  }
}

// Rz(A) Ry(B) Rx(C).
TEST(KrlFrames, StatesFramesOfTheProgram) {
  const Program program = parsed("$BASE={X 100,Y -200,Z 300,A 30,B 20,C 10}\n$TOOL=TOOL_DATA[2]\n" + kPose,
                                 "TOOL_DATA[2]={X 0,Y 0,Z 250,A 0,B 90,C 0}\nTOOL_DATA[3]={X 1,Y 0,Z 0,A 0,B 0,C 0}\n");
  ASSERT_THAT(frames(program), ElementsAre("2 {X 100,Y -200,Z 300,A 30,B 20,C 10}"));
  const Eigen::Isometry3d expected = Eigen::Translation3d(0.1, -0.2, 0.3) *
                                     Eigen::AngleAxisd(30 * kDegree, Eigen::Vector3d::UnitZ()) *
                                     Eigen::AngleAxisd(20 * kDegree, Eigen::Vector3d::UnitY()) *
                                     Eigen::AngleAxisd(10 * kDegree, Eigen::Vector3d::UnitX());
  EXPECT_TRUE(program.frames.user.at(*program.points[0].user_frame).isApprox(expected, 1e-12));
  EXPECT_NEAR(program.frames.tool.at("2").translation().z(), 0.25, 1e-12);
  EXPECT_FALSE(program.frames.tool.contains("3")) << "nothing uses it";
}

TEST(KrlFrames, KnowsNoFrameThatIsComputed) {
  for (const char* lines : {"$TOOL=TOOL_DATA[N]\n", "$TOOL=BASE_DATA[1]\n", "$TOOL=TOOL_DATA[1]:OFFSET\n",
                            "$TOOL={X 1}\n", "$TOOL={X 1,Y 0,Z 0,A 0,B 0,C N}\n", "$TOOL.Z=100\n", "BAS(#TOOL,N)\n",
                            "$TOOL=GETTOOL(1)\n", "$TOOL=CHANGED\n", "$TOOL={X 1,Y 0,Z 0,A 0,B 0,C 0}:OFFSET\n",
                            "FDAT_ACT=FHOME\nBAS(#FRAMES)\n", "FDAT_ACT={BASE_NO 1}\nBAS(#FRAMES)\n",
                            "FDAT_ACT=F1\nFDAT_ACT.TOOL_NO=N\nBAS(#FRAMES)\n", "$TOOL=TOOL_DATA[4]\n"}) {
    EXPECT_THAT(frames("BAS(#BASE,1)\n" + std::string(lines) + kPose + "CHANGED.X=3\nTOOL_DATA[4].X=3\n",
                       "DECL FDAT F1={TOOL_NO 6,BASE_NO 7}\nFRAME CHANGED={X 0,Y 0,Z 250,A 0,B 0,C 0}\n"
                       "TOOL_DATA[4]={X 0,Y 0,Z 250,A 0,B 0,C 0}\n"),
                IsEmpty())
        << lines;
  }
}

TEST(KrlFrames, OfAMotionHoldForThatMotion) {
  EXPECT_THAT(frames(kTool1 +
                     "SLIN {X 1,Y 2,Z 3,A 4,B 5,C 6} WITH $VEL=SVEL_CP(2.0, , L1), $TOOL=STOOL(3), "
                     "$BASE=SBASE(4) C_Spl\n" +
                     kPose),
              ElementsAre("3 4", "1 0"));
}

TEST(KrlFrames, OfASplineHoldForItsBlock) {
  EXPECT_THAT(frames(kTool1 + "SPLINE WITH $TOOL=TOOL_DATA[3], $BASE=BASE_DATA[2] C_SPL\n" + kPose +
                     "SPL {X 1,Y 2,Z 3,A 4,B 5,C 6} WITH $BASE=BASE_DATA[5]\n" + kPose + "ENDSPLINE C_SPL\n" + kPose),
              ElementsAre("3 2", "3 5", "3 2", "1 0"));
}

// ---- Flow of control -----------------------------------------------------------------------------------------------

TEST(KrlFrames, FollowBranches) {
  const std::string in_both =
      kTool1 + "IF A==1 THEN\n" + kTool2 + kPose + "ELSE\n" + kPose + kTool2 + "ENDIF\n" + kPose;
  EXPECT_THAT(frames(in_both), ElementsAre("2 0", "1 0", "2 0"));
  EXPECT_THAT(uncertain(in_both), IsEmpty());
  const std::string in_one = kTool1 + "IF A==1 THEN\n" + kTool2 + "ENDIF\n" + kPose;
  EXPECT_THAT(frames(in_one), ElementsAre("2 0"));
  EXPECT_THAT(uncertain(in_one), ElementsAre(6));
  EXPECT_THAT(uncertain(in_one + kTool1 + kPose), ElementsAre(6)) << "what is set again is certain";
  EXPECT_THAT(uncertain(kTool1 + "IF A==1 THEN\n" + kTool2 + "RETURN\nENDIF\n" + kPose), IsEmpty());
  EXPECT_THAT(frames(kTool1 + "IF A==1 THEN\n" + kTool2 + "RETURN\nENDIF\n" + kPose), ElementsAre("1 0"));
}

TEST(KrlFrames, FollowCases) {
  const std::string some =
      kTool1 + "SWITCH N\nCASE 1,2\n" + kTool2 + kPose + "CASE 3\n" + kPose + kTool2 + "ENDSWITCH\n" + kPose;
  EXPECT_THAT(frames(some), ElementsAre("2 0", "1 0", "2 0"));
  EXPECT_THAT(uncertain(some), ElementsAre(11)) << "no case may hold";
  const std::string all = kTool1 + "SWITCH N\nCASE 1\n" + kTool2 + "DEFAULT\n" + kTool2 + "ENDSWITCH\n" + kPose;
  EXPECT_THAT(uncertain(all), IsEmpty());
}

TEST(KrlFrames, FollowLoops) {
  EXPECT_THAT(uncertain(kTool1 + "LOOP\n" + kPose + kTool2 + kPose + "ENDLOOP\n"), ElementsAre(4))
      << "the second round begins with the tool of the first";
  EXPECT_THAT(uncertain(kTool1 + "LOOP\n" + kPose + kTool2 + kPose + kTool1 + "ENDLOOP\n"), IsEmpty());
  EXPECT_THAT(uncertain(kTool1 + "FOR I=1 TO 3\n" + kTool2 + kPose + "ENDFOR\n" + kPose), ElementsAre(7))
      << "a loop may have no round";
  EXPECT_THAT(uncertain(kTool1 + "REPEAT\n" + kTool2 + "UNTIL A==1\n" + kPose), IsEmpty());
  const std::string left = kTool1 + "LOOP\n" + kTool2 + "IF A==1 THEN\nEXIT\nENDIF\nBAS(#TOOL,3)\nENDLOOP\n" + kPose;
  EXPECT_THAT(frames(left), ElementsAre("2 0"));
  EXPECT_THAT(uncertain(left), IsEmpty());
  EXPECT_THAT(uncertain(kTool1 + "WHILE A==1\n" + kTool2 + "ENDWHILE\n" + kPose), ElementsAre(6));
}

TEST(KrlFrames, FollowJumps) {
  const std::string forward = kTool1 + "IF A==1 THEN\nGOTO L\nENDIF\n" + kTool2 + "L:\n" + kPose;
  EXPECT_THAT(frames(forward), ElementsAre("2 0"));
  EXPECT_THAT(uncertain(forward), ElementsAre(8));
  EXPECT_THAT(uncertain(kTool1 + "L:\n" + kPose + kTool2 + "GOTO L\n"), ElementsAre(4));
  EXPECT_THAT(frames(kTool1 + "GOTO L\n" + kTool2 + "L:\n" + kPose), ElementsAre("1 0"));
  EXPECT_THAT(uncertain(kTool1 + "GOTO L\n" + kTool2 + "L:\n" + kPose), IsEmpty());
}

TEST(KrlFrames, FollowCalls) {
  const std::string sub = "END\nDEF SUB()\n" + kPose + "END\n";
  EXPECT_THAT(frames(kTool1 + "SUB()\n" + sub), ElementsAre("1 0"));
  EXPECT_THAT(frames("END\nDEF SUB()\n" + kPose + "END\nDEF LAST()\n" + kTool1 + "SUB()\nEND\n"), ElementsAre("1 0"));
  EXPECT_THAT(uncertain(kTool1 + "SUB()\n" + kTool2 + "sub()\n" + sub), ElementsAre(8)) << "two tools";
  EXPECT_THAT(uncertain(kTool1 + "SUB()\n" + kPose + sub), IsEmpty()) << "sets no frame";
  const std::string setting =
      kTool1 + "SUB()\n" + kPose + "END\nDEF SUB()\nDEEPER()\nEND\nDEF DEEPER()\n" + kTool2 + "END\n";
  EXPECT_THAT(frames(setting), ElementsAre("2 0"));
  EXPECT_THAT(uncertain(setting), IsEmpty());
  EXPECT_THAT(frames("END\nDEF NEVER()\n" + kPose + "END\n"), ElementsAre("none none"));
}

TEST(KrlFrames, MayBeSetByRoutinesElsewhere) {
  EXPECT_THAT(uncertain(kTool1 + "GRIP(1)\n" + kPose + kTool1 + kPose), ElementsAre(4));
  EXPECT_THAT(frames(kTool1 + "GRIP(1)\n" + kPose), ElementsAre("1 0"));
  EXPECT_THAT(uncertain(kTool1 + "DEEP()\n" + kPose + "END\nDEF DEEP()\nGRIP(1)\nEND\n"), ElementsAre(4))
      << "through a routine that is here";
  EXPECT_THAT(uncertain(kTool1 + "PULSE($OUT[1],TRUE,0.5)\nIF (A==1) THEN\nWAIT FOR ($IN[1])\nENDIF\n" + kPose),
              IsEmpty());
  EXPECT_THAT(uncertain(kTool1 + "INTERRUPT DECL 4 WHEN $IN[1]==TRUE DO STOPPED(1)\nEND\nDEF STOPPED(N:IN)\n" + kPose +
                        "END\n"),
              ElementsAre(6));
}

// What the flow does not settle, the FDAT of a taught point does.
TEST(KrlFrames, AreThoseOfTheFdatWhereTheFlowDoesNotSettleThem) {
  const std::string data = "POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6}\nDECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE}\n";
  const auto own = [&](const std::string& lines) {
    const Program program = parsed(lines, data);
    EXPECT_THAT(frames(program), ElementsAre("1 0")) << lines;
    for (const ProgramRemark& remark : program.remarks) {
      if (remark.what.starts_with("tool or base are not known here")) {
        return remark.lines;
      }
    }
    return Lines();
  };
  EXPECT_THAT(own(kTool1 + "GRIP()\nLIN XP1\n"), IsEmpty()) << "both say the same";
  EXPECT_THAT(own(kTool1 + "IF A==1 THEN\n" + kTool2 + "ENDIF\nLIN XP1\n"), ElementsAre(6));
  EXPECT_THAT(own("LIN XP1\n"), ElementsAre(2));
  EXPECT_THAT(own("BAS(#TOOL,N)\nBAS(#BASE,0)\nLIN XP1\n"), ElementsAre(4));
  EXPECT_THAT(frames(kTool2 + "BAS(#BASE,3)\nLIN XP1\n", data), ElementsAre("2 3")) << "the program sets others";
  EXPECT_THAT(frames("$BASE=EK(R,#EASYS,BASE_DATA[1])\nLIN XP1\n", data), IsEmpty());
}

TEST(KrlFrames, SurviveFlowWithoutBeginOrEnd) {
  EXPECT_THAT(frames("ELSE\nENDIF\nCASE 1\nENDSWITCH\nENDLOOP\nUNTIL A\nEXIT\nENDSPLINE\n" + kTool1 +
                     "IF A THEN\nLOOP\nENDIF\nENDSWITCH\n" + kPose),
              ElementsAre("1 0"));
}

// ---- $config.dat ---------------------------------------------------------------------------------------------------

const std::string kConfig =
    "&ACCESS  RV\r\nDEFDAT  $CONFIG\r\nINT MAX_TOOL=16\r\nDECL FRAME TOOL_DATA[16]\r\n"
    "TOOL_DATA[1]={X 10.0,Y 0.0,Z 775.0,A 0.0,B 90.0,C 0.0} ; gripper\r\n"
    "TOOL_NAME[1,]=\"VACUUM;{\"\r\nLOAD_DATA[1]={M -1.0,CM {X 0.0,Y 0.0,Z 775.0,A 0.0,B 0.0,C 0.0}}\r\n"
    "DECL FRAME BASE_DATA[32]\r\nBASE_DATA[1]={X 1161.70398,Y -1836.93604,Z -984.64209,A 1.42569995,B 0.6,C 0.4}\r\n"
    "BASE_DATA[2]={X 1.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}\r\nBASE_DATA[3]={X 2.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}\r\n"
    "MACHINE_DEF[1]={NAME[] \"Robot\",COOP_KRC_INDEX 1,PARENT[] \"WORLD\",MECH_TYPE #ROBOT,GEOMETRY[] \" \"}\r\n"
    "MACHINE_DEF[2]={NAME[] \"Table\",COOP_KRC_INDEX 1,PARENT[] \"WORLD\",MECH_TYPE #EASYS,GEOMETRY[] \" \"}\r\n"
    "MACHINE_FRAME_DAT[1]={MACH_DEF_INDEX 0,PARENT[] \"WORLD\",GEOMETRY[] \" \"}\r\n"
    "MACHINE_FRAME_DAT[2]={MACH_DEF_INDEX 2,PARENT[] \"Table\",GEOMETRY[] \" \"}\r\n"
    "MACHINE_FRAME_DAT[3]={MACH_DEF_INDEX 1,PARENT[] \"Robot\",GEOMETRY[] \" \"}\r\nENDDAT\r\n";

TEST(KrlFrames, ReadsToolsAndBasesOfAController) {
  const ProgramFrames frames = kuka_krl().read_frames(kConfig, "$config.dat");
  ASSERT_TRUE(frames.tool.contains("1"));
  EXPECT_TRUE(frames.tool.at("1").isApprox(
      Eigen::Translation3d(0.01, 0, 0.775) * Eigen::AngleAxisd(90 * kDegree, Eigen::Vector3d::UnitY()), 1e-12));
  EXPECT_NEAR(frames.user.at("1").translation().y(), -1.83693604, 1e-12);
  EXPECT_FALSE(frames.user.contains("2")) << "a turntable moves it";
  EXPECT_THAT(frames.moving_user, ::testing::ElementsAre("2"));
  EXPECT_TRUE(frames.user.contains("3"));
}

TEST(KrlFrames, ReadsToolsAndBasesThatAreSystemVariables) {
  const ProgramFrames frames = kuka_krl().read_frames(
      "DEFDAT $CONFIG\n$BASE_DATA[1]={X 0,Y 500,Z 0,A 90,B 0,C 0}\n$TOOL_DATA[1]={X 0,Y 0,Z 100,A 0,B 0,C 0}\n"
      "$TOOL_DATA[2]={X 20,Y 0,Z 0,A 0,B 90,C 0}\nENDDAT\n",
      "$config.dat");
  ASSERT_EQ(frames.tool.size(), 2U);
  ASSERT_EQ(frames.user.size(), 1U);
  const auto moved = [](double x, double y, double z) { return Eigen::Isometry3d(Eigen::Translation3d(x, y, z)); };
  EXPECT_TRUE(frames.tool.at("1").isApprox(moved(0, 0, 0.1), 1e-12));
  EXPECT_TRUE(frames.tool.at("2").isApprox(
      moved(0.02, 0, 0) * Eigen::AngleAxisd(90 * kDegree, Eigen::Vector3d::UnitY()), 1e-12));
  EXPECT_TRUE(frames.user.at("1").isApprox(moved(0, 0.5, 0) * Eigen::AngleAxisd(90 * kDegree, Eigen::Vector3d::UnitZ()),
                                           1e-12));
}

TEST(KrlFrames, RefusesFilesWithoutFrames) {
  EXPECT_REFUSED("c.dat:2: holds no TOOL_DATA and no BASE_DATA, expected $config.dat of a controller",
                 kuka_krl().read_frames("DEFDAT A\nENDDAT\n", "c.dat"));
  EXPECT_REFUSED("c.dat:1: TOOL_DATA[1] is '{X 1,Y 2}', expected {X ..,Y ..,Z ..,A ..,B ..,C ..}",
                 kuka_krl().read_frames("TOOL_DATA[1]={X 1,Y 2}\n", "c.dat"));
  EXPECT_REFUSED("c.dat:1: BASE_DATA[1] is 'F', expected", kuka_krl().read_frames("BASE_DATA[1]=F\n", "c.dat"));
}

}  // namespace
}  // namespace kdl_calibration::krl_frames_test
