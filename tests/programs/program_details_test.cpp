// What programs of each language state beside their taught points.

#include <gmock/gmock.h>

#include <numbers>
#include <string>

#include "programs/krl_program.hpp"
#include "programs/ls_program.hpp"
#include "programs/rapid_program.hpp"
#include "programs/ur_program.hpp"

namespace kdl_calibration::program_details_test {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

Program ur(const std::string& text) { return ur_script().parse({{.source = "in.script", .text = text}}); }

TEST(ProgramDetails, OfVariablesInUrScriptFollowTheText) {
  EXPECT_EQ(ur("movej([0.1,0,0,0,0,0])\n").points.at(0).fields.at(1).decimals, 6);
  const std::string pose = "p[0.3,0.2,0.4,0,3,0]";
  const Program near = ur("q=[0.5,0,0,0,0,0]\nmovej(get_inverse_kin(" + pose + ", q))\nq=[2,0,0,0,0,0]\n");
  EXPECT_EQ(near.points.at(0).near.value()[0], 0.5);
  EXPECT_FALSE(ur("w=[0.5,0,0,0,0,0]\nw=get_actual_joint_positions()\nmovej(w)\n").motions.at(0).point);
  EXPECT_THAT(ur("movec(" + pose + ", p[0.4,0.2,0.4,0,3,0])\n").points, SizeIs(2));
}

TEST(ProgramDetails, OfFanucPositionsAndOptions) {
  const std::string pose =
      "\tUF : 0, UT : 0,\tCONFIG : 'N U T, 0, 0, 0',\n\tX = 1.0 mm,\tY = 2.0 mm,\tZ = 3.0 mm,\n\tW = 4.0 deg,\tP = 5.0 "
      "deg,\tR = 6.0 deg\n";
  const Program program = fanuc_ls().parse(
      {{.source = "IN.LS",
        .text = "/PROG  A\n/MN\n   1:C P[1]\n    :  P[2] 100mm/sec FINE Offset,PR[1] ;\n/POS\nP[1]{\n   GP1:\n" + pose +
                "   GP2:\n\tUF : 0, UT : 0,\n\tJ1= 1.0 deg\n};\nP[2]{\n   GP1:\n" + pose + "};\n/END\n"}});
  ASSERT_THAT(program.motions, SizeIs(2));
  EXPECT_FALSE(program.motions[0].is_known || program.motions[1].is_known);
  EXPECT_EQ(program.points.at(1).line, 15U);
  const JointInterval& turn = program.points.at(0).branch.value().turns[0].value();
  EXPECT_TRUE(turn.contains(std::numbers::pi));
  EXPECT_FALSE(turn.contains(-std::numbers::pi));
  EXPECT_EQ(fanuc_ls().write("1.0", -1234.5, 3), " -1234.500");
}

TEST(ProgramDetails, OfKukaPointsThatHaveTwoValuesOrAnUnknownTool) {
  const auto points = [](const std::string& lines) {
    return kuka_krl()
        .parse({{.source = "a.src", .text = "DEF A()\nBAS(#INITMOV,0)\n" + lines + "PTP XP1\nEND\n"},
                {.source = "a.dat",
                 .text = "DEFDAT A\nE6POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}\nFDAT FP1={TOOL_NO 1,BASE_NO "
                         "1,IPO_FRAME #TCP}\nENDDAT\n"}})
        .points;
  };
  EXPECT_THAT(points(""), SizeIs(1));
  EXPECT_THAT(points("XP1={X 9,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}\n"), IsEmpty());
  EXPECT_THAT(points("$IPO_MODE=MODE\n"), IsEmpty()) << "#TCP of its FDAT";
}

TEST(ProgramDetails, OfRapidToolsThatAreParameters) {
  const std::string target = "[[100,20.5,300],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]";
  EXPECT_THAT(abb_rapid()
                  .parse({{.source = "IN.mod",
                           .text = "MODULE m\nPROC go(PERS tooldata t)\nMoveL " + target +
                                   ",v1,fine,t;\nENDPROC\nENDMODULE\n"}})
                  .points,
              IsEmpty());
}

}  // namespace
}  // namespace kdl_calibration::program_details_test
