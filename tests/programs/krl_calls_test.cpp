#include "programs/krl_calls.hpp"

#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "programs/krl_program.hpp"

namespace kdl_calibration::krl_calls_test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

Program parsed(const std::string& lines, const std::string& routines) {
  return kuka_krl().parse(
      {{.source = "a.src",
        .text = "DEF MAIN()\nBAS(#INITMOV,0)\n" + lines + "PTP XP1\nPTP XP2\nPTP XL[1]\nEND\n" + routines},
       {.source = "a.dat",
        .text = "DEFDAT MAIN\nE6POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}\nE6POS XP2={X 2,Y 2,Z 3,A 4,B 5,C 6,S 2,T "
                "2}\nE6POS XL[2]\nXL[1]={X 2,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}\nENDDAT\n"}});
}

std::vector<std::string> left(const std::string& lines, const std::string& routines) {
  const Program program = parsed(lines, routines);
  std::vector<std::string> names = {"XP1", "XP2", "XL[1]"};
  for (const ProgramPoint& point : program.points) {
    std::erase(names, point.name);
  }
  return names;
}

std::string routine(const std::string& parameters, const std::string& lines) {
  return "DEF CHANGE(" + parameters + ")\n" + lines + "END\n";
}

TEST(KrlCalls, ChangeWhatTheyTakeByReference) {
  const std::string raise = "DECL E6POS P\nP.Z=P.Z+10\n";
  EXPECT_THAT(left("CHANGE(XP1)\n", routine("P:OUT", raise)), ElementsAre("XP1"));
  EXPECT_THAT(left("Change ( xp1 )\n", routine("p :out", raise)), ElementsAre("XP1"));
  EXPECT_THAT(left("CHANGE(XP1)\n", routine("P", raise)), ElementsAre("XP1")) << "OUT if nothing is said";
  EXPECT_THAT(left("CHANGE(XP1)\n", routine("P:IN", raise)), IsEmpty());
  EXPECT_THAT(left("CHANGE(XP1)\n", routine("P:OUT", "DECL E6POS P\nPTP P\n")), IsEmpty());
  EXPECT_THAT(left("CHANGE(XP2,XP1)\n", routine("N:IN,P:OUT", raise)), ElementsAre("XP1"));
  EXPECT_THAT(left("CHANGE(XP2)\n", routine("P:OUT", "DECL E6POS P\nP={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}\n")),
              ElementsAre("XP2"));
  EXPECT_THAT(left("CHANGE(XL[1])\n", routine("P:OUT", raise)), ElementsAre("XL[1]"));
  EXPECT_THAT(left("CHANGE(XL[])\n", routine("P[]:OUT", "DECL E6POS P[]\nP[1].Z=0\n")), ElementsAre("XL[1]"));
  EXPECT_THAT(left("CHANGE(XP1:XP2)\n", routine("P:OUT", raise)), IsEmpty()) << "a value";
  EXPECT_THAT(left("", routine("XP1:OUT", "XP1.Z=9\n")), IsEmpty()) << "a parameter of this name";
}

TEST(KrlCalls, AreFoundWhereverTheyStand) {
  const std::string raise = "DECL E6POS P\nP.Z=P.Z+10\n";
  const std::string function = "DEFFCT BOOL CHANGED(P:OUT)\n" + raise + "RETURN TRUE\nENDFCT\n";
  EXPECT_THAT(left("IF CHANGED(XP1) THEN\nENDIF\n", function), ElementsAre("XP1"));
  EXPECT_THAT(left("DONE=NOT CHANGED(XP2)\n", function), ElementsAre("XP2"));
  EXPECT_THAT(left("PTP ABOVE(CHANGED(XP2))\n", function), ElementsAre("XP2"));
  EXPECT_THAT(left("HAND(XP1)\n", "DEF HAND(Q:OUT)\nDECL E6POS Q\nCHANGE(Q)\nEND\n" + routine("P:OUT", raise)),
              ElementsAre("XP1"));
}

TEST(KrlCalls, OfOtherFilesMayChangePoints) {
  std::vector<std::size_t> lines;
  for (const ProgramRemark& remark : parsed("ELSEWHERE(3,XP1)\nELSEWHERE(XP1.X)\nELSEWHERE()\n", "").remarks) {
    if (remark.what.find("hands a point to a routine that is not here") != std::string::npos) {
      lines.insert(lines.end(), remark.lines.begin(), remark.lines.end());
    }
  }
  EXPECT_THAT(lines, ElementsAre(3U));
}

}  // namespace
}  // namespace kdl_calibration::krl_calls_test
