#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "programs/rapid_program.hpp"

namespace kdl_calibration::rapid_calls_test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

const std::string kNumbers = "[[100,20.5,300],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]";
const std::string kPoints = "PERS robtarget p1:=" + kNumbers + ";\nPERS robtarget p2:=" + kNumbers +  // lines 2, 3
                            ";\nPERS robtarget pp{2}:=[" + kNumbers + ",\n" + kNumbers + "];\n";      // 4, 5
const std::string kMoves =
    "MoveL p1,v1,fine,tool0;\nMoveL p2,v1,fine,tool0;\nMoveL pp{1},v1,fine,tool0;\nMoveL pp{2},v1,fine,tool0;\n";

Program parsed(const std::string& statements, const std::string& routines) {
  return abb_rapid().parse({{.source = "IN.mod",
                             .text = "MODULE m\n" + kPoints + "PROC main()\n" + statements + kMoves + "ENDPROC\n" +
                                     routines + "ENDMODULE\n"}});
}

std::vector<std::string> left(const std::string& statements, const std::string& routines) {
  const Program program = parsed(statements, routines);
  std::vector<std::string> names = {"p1", "p2", "pp{1}", "pp{2}"};
  for (const ProgramPoint& point : program.points) {
    std::erase(names, point.name);
  }
  return names;
}

std::string procedure(const std::string& parameters, const std::string& statements) {
  return "PROC Change(" + parameters + ")\n" + statements + "ENDPROC\n";
}

const std::string kRaise = "at.trans.z:=at.trans.z+10;\n";

TEST(RapidCalls, ChangeWhatTheyTakeByReference) {
  for (const std::string mode : {"INOUT", "VAR", "PERS", "inout"}) {
    EXPECT_THAT(left("Change p1;\n", procedure(mode + " robtarget at", kRaise)), ElementsAre("p1")) << mode;
    EXPECT_THAT(left("Change p1;\n", procedure(mode + " robtarget at", "MoveL at,v1,fine,tool0;\n")), IsEmpty())
        << mode;
  }
  EXPECT_THAT(left("Change p1;\n", procedure("robtarget at", kRaise)), IsEmpty()) << "a copy of its own";
  EXPECT_THAT(left("Change 5,p1;\n", procedure("num n,INOUT robtarget at", kRaise)), ElementsAre("p1"));
  EXPECT_THAT(left("Change p2,p1;\n", procedure("robtarget other,INOUT robtarget at", kRaise)), ElementsAre("p1"));
  EXPECT_THAT(left("Change p2\\at:=p1;\n", procedure("robtarget other\\INOUT robtarget at", kRaise)),
              ElementsAre("p1"));
  EXPECT_THAT(left("Change\\fast,p1;\n", procedure("\\switch fast,INOUT robtarget at", kRaise)), ElementsAre("p1"));
  EXPECT_THAT(left("Change p1.trans;\n", procedure("INOUT pos at", "at.z:=0;\n")), ElementsAre("p1"));
  EXPECT_THAT(left("Change pp{2};\n", procedure("INOUT robtarget at", kRaise)), ElementsAre("pp{1}", "pp{2}"));
  EXPECT_THAT(left("Change Offs(p1,0,0,9);\n", procedure("INOUT robtarget at", kRaise)), IsEmpty()) << "a value";
  EXPECT_THAT(left("Change p1;\n", procedure("INOUT robtarget at", "SearchL sen,at,p2,v1,tool0;\n")),
              ElementsAre("p1"));
}

TEST(RapidCalls, AreFoundWhereverTheyStand) {
  const std::string change = procedure("INOUT robtarget at", kRaise);
  const std::string function = "FUNC bool Changed(num n,INOUT robtarget at)\n" + kRaise + "RETURN TRUE;\nENDFUNC\n";
  EXPECT_THAT(left("IF n=1 Change p1;\n", change), ElementsAre("p1"));
  EXPECT_THAT(left("WHILE n<3 DO\nCHANGE p1;\nENDWHILE\n", change), ElementsAre("p1"));
  EXPECT_THAT(left("IF Changed(1,p1) THEN\nENDIF\n", function), ElementsAre("p1"));
  EXPECT_THAT(left("done:=NOT Changed(1,p2);\n", function), ElementsAre("p2"));
  EXPECT_THAT(left("n:=Twice(Changed(n,p2));\n", function), ElementsAre("p2"));
  // Through another routine, which hands its parameter on and stands before.
  EXPECT_THAT(left("Hand p1;\n", "PROC Hand(INOUT robtarget it)\nChange it;\nENDPROC\n" + change), ElementsAre("p1"));
  EXPECT_THAT(left("Hand p1;\n", "PROC Hand(robtarget it)\nChange it;\nENDPROC\n" + change), IsEmpty());
  // A variable of the routine has the name of the point.
  EXPECT_THAT(left("", "PROC Own()\nVAR robtarget p1;\nChange p1;\nENDPROC\n" + change), IsEmpty());
}

TEST(RapidCalls, OfOtherFilesMayChangePointsThatAreNoConstants) {
  const auto lines = [](const std::string& statements, const std::string& routines) {
    std::vector<std::size_t> result;
    for (const ProgramRemark& remark : parsed(statements, routines).remarks) {
      EXPECT_THAT(remark.what, ::testing::HasSubstr("is handed to a routine that is not here"));
      result.insert(result.end(), remark.lines.begin(), remark.lines.end());
    }
    return result;
  };
  EXPECT_THAT(lines("Elsewhere p1;\nElsewhere 3,p2\\Slow;\n", ""), ElementsAre(7U, 8U));
  EXPECT_THAT(lines("TEST n\nCASE 1: Elsewhere p1;\nENDTEST\nagain: Elsewhere p2;\n", ""), ElementsAre(8U, 10U));
  EXPECT_THAT(lines("Elsewhere Offs(p1,0,0,9);\nElsewhere p1.trans;\nSet do1;\nElsewhere;\n", ""), IsEmpty());
  EXPECT_THAT(lines("Here p1;\n", "PROC Here(robtarget it)\nENDPROC\n"), IsEmpty());
  EXPECT_THAT(lines("Elsewhere fixed;\nMoveL fixed,v1,fine,tool0;\n", "CONST robtarget fixed:=" + kNumbers + ";\n"),
              IsEmpty());
  EXPECT_THAT(lines("RETURN p1;\n", ""), IsEmpty());
}

}  // namespace
}  // namespace kdl_calibration::rapid_calls_test
