// kdlcal compensate --program, and frames for it: kdlcal frames --controller.

#include <fmt/core.h>
#include <Eigen/Core>
#include <set>
#include <utility>

#include "base/sha256.hpp"
#include "cli_options_support.hpp"
#include "json_support.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/result_file.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::compensate_program_test {
namespace {

using Eigen::Vector3d;
using ::testing::AllOf;
using ::testing::HasSubstr;

const std::string kController = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_controller.json";

std::string program(const std::string& frames, const Vector3d& p) {
  return fmt::format(
      "/PROG  TEST\r\n/MN\r\n   1:L P[1] 100mm/sec FINE Offset,PR[1]    ;\r\n/POS\r\nP[1:\"a\"]{{\r\n   GP1:\r\n"
      "\t{},\t\tCONFIG : 'N U T, 0, 0, 0',\r\n\tX ={:10.3f}  mm,\tY ={:10.3f}  mm,\tZ ={:10.3f}  mm,\r\n"
      "\tW =   135.000 deg,\tP =   -45.000 deg,\tR =     0.000 deg\r\n}};\r\n/END\r\n",
      frames, p.x(), p.y(), p.z());
}

const Words kCompensate = {"compensate", "--result", "r.json", "--program", "IN.LS", "--output", "OUT.LS", "--json"};

class ProgramFiles : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    write_calibration();
    write("IN.LS", program("UF : 0, UT : 0", Vector3d(1500, 0, 360)));
  }
};

TEST_F(ProgramFiles, KeepEverythingButTheNumbersBesideARecord) {
  const Outcome outcome = run(kCompensate);
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("IN.LS:3: Offset moves positions at run time"));
  const std::string before = text_of("IN.LS");
  const std::string after = text_of("OUT.LS");
  EXPECT_NE(after, before);
  const auto without_numbers = [](const std::string& text) {
    return std::regex_replace(text, std::regex("= *-?[0-9]*\\.[0-9]{3}"), "=");
  };
  EXPECT_EQ(without_numbers(after), without_numbers(before));
  const Json record = json_of("OUT.LS.kdlcal.json");
  EXPECT_EQ(record, Json::parse(outcome.out));
  EXPECT_EQ(record["result_sha256"], sha256(text_of("r.json")));
  EXPECT_EQ(record["program_sha256"], sha256(after));
  ASSERT_EQ(record["positions"].size(), 1U);
  EXPECT_EQ(record["positions"][0]["status"], "exact");
  EXPECT_EQ(record["positions"][0]["change"].size(), 6U);
}

TEST_F(ProgramFiles, OfACompensatedProgramAndAnotherRobotAreRefused) {
  succeed(kCompensate);
  Words again = kCompensate + Words{"--force"};
  again[4] = "OUT.LS";
  again[6] = "OUT2.LS";
  expect_refused(again, {"OUT.LS", "compensated already"});
  expect_refused(kCompensate, {"OUT.LS", "--force"});
  // The tip of another chain: the bundled controller has other frames.
  std::string urdf = fanuc().urdf;
  urdf.replace(urdf.find("</robot>"), 8,
               "<link name='plate'/><joint name='plate' type='fixed'><parent link='flange'/><child link='plate'/>"
               "</joint></robot>");
  write("other.urdf", urdf);
  succeed(words_of("calibrate --urdf other.urdf --measurements m.csv --effects none --prior none --result o.json"));
  Words other = kCompensate + Words{"--force", "--urdf", "other.urdf"};
  other[2] = "o.json";
  expect_refused(other, {"other.urdf", "--controller"});
  EXPECT_EQ(run(other + Words{"--controller", kController}).status, 0);
}

TEST_F(ProgramFiles, SayWhichStraightLinesTheToolLeaves) {
  const auto position = [](int number, int first) {
    return fmt::format(
        "P[{}]{{\n GP1:\n UF : 0, UT : 0,\n J1={} deg, J2=-20 deg, J3=-10 deg,\n J4=20 deg, J5=-60 deg, "
        "J6=30 deg\n}};\n",
        number, first);
  };
  write(
      "IN.LS",
      "/PROG  T\n/MN\n   1:J P[1] 9% FINE    ;\n   2:L P[2] 9mm/sec FINE    ;\n   3:L P[1] 9mm/sec FINE    ;\n/POS\n" +
          position(1, -40) + position(2, 40) + "/END\n");
  const Outcome fine = run(kCompensate + Words{"--linear=0.001"});
  EXPECT_EQ(fine.status, 0) << fine.err;
  EXPECT_THAT(fine.err,
              AllOf(HasSubstr("the tool leaves the straight line by "),
                    HasSubstr("; 2 of 2 straight lines are off by more than 0.001 mm, next those in lines ")));
  const Json json = Json::parse(fine.out);
  EXPECT_EQ(json["lines"]["tried"], 2);
  EXPECT_EQ(json["lines"]["above_tolerance"], 2);
  EXPECT_EQ(json["lines"]["tolerance"], 1e-6);
  ASSERT_EQ(json["paths"].size(), 2U);
  EXPECT_EQ(json["paths"][0]["deviation"], json["lines"]["largest_deviation"]);
  EXPECT_GE(json["paths"][0]["deviation"], json["paths"][1]["deviation"]);
  const Outcome coarse = run(kCompensate + Words{"--force", "--linear=1000"});
  EXPECT_EQ(coarse.err.find("straight line"), std::string::npos) << coarse.err;
  EXPECT_EQ(Json::parse(coarse.out)["lines"]["largest_deviation"], json["lines"]["largest_deviation"]);
  EXPECT_EQ(run_json(kCompensate + Words{"--force"}), run_json(kCompensate + Words{"--force", "--linear"}));
  expect_refused(kCompensate + Words{"--force", "--linear=0"}, {"--linear", "0.001 to 1000"});
}

TEST_F(ProgramFiles, WithAnExternalAxisNeedItsJoint) {
  std::string urdf = fanuc().urdf;
  urdf.insert(urdf.find("</robot>"), R"(<link name="floor"/><joint name="rail" type="prismatic">
    <parent link="floor"/><child link="base_link"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" effort="0" velocity="1"/></joint>)");
  write("rail.urdf", urdf);
  succeed(
      words_of("simulate --urdf rail.urdf --noise 3e-5 --length-sigma 0.001 --angle-sigma 0.001 --output rail.csv"));
  succeed(
      words_of("calibrate --urdf rail.urdf --measurements rail.csv --effects none --prior none --result rail.json"));
  std::string text = program("UF : 0, UT : 0", Vector3d(1500, -300, 360));
  text.insert(text.find("\r\n};"), ",\r\n\tE1=   300.000  mm");
  write("IN.LS", text);
  expect_refused(kCompensate, {"IN.LS:5: P[1]", "E1", "--external-axis E1=JOINT"});
  Words with_rail = kCompensate + Words{"--urdf", "rail.urdf", "--controller", kController};
  with_rail[2] = "rail.json";
  expect_refused(with_rail, {"rail.urdf", "rail", "--external-axis E1=JOINT"});
  expect_refused(with_rail + Words{"--external-axis", "E1=slide"}, {"--external-axis", "'slide'", "rail, joint_1"});
  expect_refused(with_rail + Words{"--external-axis", "E1=-none"}, {"--external-axis", "'-none'", "rail, joint_1"});
  expect_refused(with_rail + Words{"--external-axis", "E7=rail"}, {"--external-axis", "'E7'", "E1 to E6"});
  expect_refused(with_rail + Words{"--external-axis", "rail"}, {"--external-axis", "'rail'"});
  expect_refused(words_of("compensate --result r.json --joints m.csv --output o --external-axis E1=joint_1"),
                 {"--external-axis", "--program"});
  // The rail runs along the base's x, which is against the world's y: the arm is where y is 0 without it.
  const Json on_rail = run_json(with_rail + Words{"--external-axis", "E1=rail"});
  EXPECT_EQ(on_rail["positions"][0]["status"], "exact");
  EXPECT_EQ(on_rail["positions"][0]["change"].size(), 6U);
  EXPECT_THAT(text_of("OUT.LS"), HasSubstr(",\r\n\tE1=   300.000  mm\r\n};"));
  EXPECT_NE(text_of("OUT.LS"), text);
}

// A pair of KUKA's files has one record, beside the file that was named.
TEST_F(ProgramFiles, OfKukaAreNotCompensatedAgainByTheOtherFile) {
  write("k.src", "DEF k()\nBAS(#INITMOV,0)\nPTP XP1\nEND\n");
  write("k.dat", "DEFDAT k\nDECL E6AXIS XP1={A1 10.0,A2 -10.0,A3 15.0,A4 5.0,A5 30.0,A6 2.0}\nENDDAT\n");
  const Words first = words_of("compensate --result r.json --program k.src --output one.src");
  const Outcome outcome = run(first);
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_NE(text_of("one.dat"), text_of("k.dat"));
  EXPECT_EQ(text_of("one.src"), text_of("k.src"));
  for (const char* again : {"one.src", "one.dat"}) {
    expect_refused({"compensate", "--result", "r.json", "--program", again, "--output", "two.src"},
                   {"compensated already"});
  }
  // One of both files alone is enough: the routine was edited, the points are the compensated ones.
  write("one.src", text_of("one.src") + "; edited\n");
  expect_refused({"compensate", "--result", "r.json", "--program", "one.src", "--output", "two.src"},
                 {"one.dat: this program is compensated already, expected the original"});
}

TEST_F(ProgramFiles, AreCompensatedForThePayloadAndTheTemperature) {
  succeed(
      words_of("simulate --configurations 30 --noise 3e-5 --length-sigma 0.001 --angle-sigma 0.001 --effects "
               "payload,expansion --output e.csv"));
  succeed(words_of("calibrate --measurements e.csv --effects payload,expansion --prior none --result e.json"));
  write("k.src", "DEF k()\nPTP {A1 10.0,A2 -10.0,A3 15.0,A4 5.0,A5 30.0,A6 2.0}\nEND\n");
  const Calibration found = load_calibration(directory / "e.json", fanuc());
  const Eigen::VectorXd asked = (Eigen::VectorXd(6) << 10.0, -10.0, 15.0, 5.0, 30.0, 2.0).finished() * kDegree;
  std::set<std::string> written;
  for (const auto& [options, circumstances] : std::vector<std::pair<std::string, Circumstances>>{
           {"", {}},
           {" --payload 10", {.payload = 10.0}},
           {" --temperature 25", {.temperature = 25.0}},
           {" --payload 0 --temperature 30", {.temperature = 30.0, .payload = 0.0}}}) {
    const Json record =
        run_json(words_of("compensate --result e.json --program k.src --output out.src --force --json" + options));
    const Eigen::VectorXd commanded = Compensator(found.at(circumstances)).solve(asked).joint_values;
    for (std::size_t i = 0; i < 6; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      EXPECT_NEAR(record["positions"][0]["change"][i], commanded[k] - asked[k], 1e-9) << options << i;
      EXPECT_THAT(text_of("out.src"), HasSubstr(fmt::format("A{} {:.4f}", i + 1, commanded[k] / kDegree))) << options;
    }
    written.insert(text_of("out.src"));
  }
  EXPECT_EQ(written.size(), 4U);
}

// At zero the faceplate's x, y and z point along the flange's z, x and y: so do the numbers of UTOOL.
TEST_F(ProgramFiles, TakeTheTargetsOfTheCalibrationAsTools) {
  const Words frames = words_of("frames --result r.json --tool-number 4 --output f.json --controller " + kController);
  const Outcome outcome = run(frames);
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("UTOOL[4] X Y Z [mm]"), HasSubstr("UTOOL[6] W P R [deg]"),
                                 HasSubstr("UTOOL[5]: target B")));
  const Json tools = json_of("f.json")["tool_frames"];
  ASSERT_EQ(tools.size(), 3U);
  for (std::size_t k = 0; k < 3; ++k) {
    const Json target = json_of("r.json")["targets"][k];
    const Json tool = tools[std::to_string(k + 4)];
    EXPECT_EQ(tool["target"], target["name"]);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(tool["position"][(i + 1) % 3], target["position"][i], 1e-12);
      EXPECT_NEAR(tool["std"][(i + 1) % 3], target["std"][i], 1e-12);
    }
  }
  // A pose of the tool means the same as that of the faceplate.
  const Json faceplate = run_json(kCompensate);
  const Eigen::Matrix3d R =
      (Eigen::AngleAxisd(-45.0 * kDegree, Vector3d::UnitY()) * Eigen::AngleAxisd(135.0 * kDegree, Vector3d::UnitX()))
          .toRotationMatrix();
  write("IN.LS", program("UF : 0, UT : 5", Vector3d(1500, 0, 360) + 1e3 * R * vector_of(tools["5"]["position"])));
  const Outcome of_tool = run(kCompensate + Words{"--force", "--frames", "f.json"});
  ASSERT_EQ(of_tool.status, 0) << of_tool.err;
  EXPECT_EQ(of_tool.err.find("f.json"), std::string::npos);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_NEAR(Json::parse(of_tool.out)["positions"][0]["change"][i], faceplate["positions"][0]["change"][i], 1e-7);
  }
  // Those of another result are not meant.
  Json others = json_of("f.json");
  others["calibration"] = nullptr;
  write("f.json", others.dump());
  EXPECT_THAT(run(kCompensate + Words{"--force", "--frames", "f.json"}).err, HasSubstr("found with the nominal robot"));
  write("F.JSON", others.dump());
  const Outcome in_capitals = run(kCompensate + Words{"--force", "--frames", "F.JSON"});
  EXPECT_EQ(in_capitals.status, 0);
  EXPECT_THAT(in_capitals.err, HasSubstr("found with the nominal robot"));
  expect_refused(words_of("frames --output g.json --controller " + kController), {"--tool-touches", "--result"});
  expect_refused(words_of("frames --result r.json --output g.json --user-number 2"),
                 {"--user-touches", "--controller"});
}

// The world stands 0.67 m above the base with x along the base's y.
TEST_F(ProgramFiles, TakeFramesThatWereTouched) {
  const std::string joints = "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n";
  write("tip.csv", joints +
                       "0.1,0.2,0.3,0.4,0.5,0.6\n0.1,0.21,0.3,0.9,0.5,0.6\n0.1,0.2,0.3,0.4,0.9,0.6\n"
                       "0.1,0.2,0.35,-0.4,0.5,1.6\n0.15,0.2,0.3,0.4,-0.5,0.1\n");
  write("fixture.csv", joints + "0.1,0.2,0.3,0.4,0.5,0.6\n0.3,0.2,0.3,0.4,0.5,0.6\n0.1,0.4,0.3,0.4,0.5,0.6\n");
  const Outcome outcome =
      run(words_of("frames --result r.json --tool-touches tip.csv --user-touches fixture.csv "
                   "--tool-number 2 --user-number 3 --output f.json --controller " +
                   kController));
  ASSERT_EQ(outcome.status, 1) << outcome.err;  // arbitrary places are not touches of one point
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("UFRAME[3] W P R [deg]"), HasSubstr("UTOOL[2] X Y Z [mm]")));
  const Json json = json_of("f.json");
  const Vector3d base = vector_of(json["user"]["position"]);
  const Vector3d world = vector_of(json["user_frames"]["3"]["position"]);
  EXPECT_LT((world - Vector3d(base.y(), -base.x(), base.z() - 0.67)).norm(), 1e-12);
  for (std::size_t i = 0; i < 6; ++i) {
    const std::size_t of_base = i < 3 ? (i == 2 ? 2 : 1 - i) : (i == 5 ? 5 : 7 - i);
    EXPECT_NEAR(json["user_frames"]["3"]["std"][i], json["user"]["std"][of_base], 1e-12);
  }
  EXPECT_NEAR(json["tool_frames"]["2"]["position"][0], json["tool"]["position"][2], 1e-12);
  // Nothing says how the tool is turned: as the faceplate.
  EXPECT_NEAR(json["tool_frames"]["2"]["quaternion_wxyz"][0], 1.0, 1e-12);
  EXPECT_EQ(json["tool_frames"]["2"]["orientation"], "not measured");
  EXPECT_THAT(outcome.out, HasSubstr("UTOOL[2] W P R: not measured"));
  // Without a description these are the frames of the controller that comes with the robot.
  const std::string touches =
      "frames --result r.json --tool-touches tip.csv --user-touches fixture.csv --tool-number 2 --user-number 3 ";
  const Outcome bare = run(words_of(touches + "--output bare.json"));
  EXPECT_THAT(bare.out, AllOf(::testing::Not(HasSubstr("UFRAME")), HasSubstr("tool in flange, user in base_link")));
  EXPECT_EQ(json_of("bare.json")["user_frames"], json["user_frames"]);
  // kdlcal frames and compensate read the file. A tool that touches found is not turned by reading it again.
  EXPECT_EQ(run(words_of("frames --user-touches fixture.csv --frames f.json --output g.json")).status, 0);
  run(words_of(touches + "--frames f.json --output h.json"));
  EXPECT_EQ(json_of("h.json")["tool_frames"]["2"]["orientation"], "not measured");
  write("IN.LS", program("UF : 3, UT : 2", Vector3d(100, 100, 100)));
  const Outcome compensated = run(kCompensate + Words{"--frames", "f.json"});
  EXPECT_EQ(compensated.err.find("is not known"), std::string::npos) << compensated.err;
  EXPECT_THAT(compensated.err, HasSubstr("f.json: UT 2 is turned as the flange, because touches find only its origin"));
  EXPECT_THAT(run(words_of("compensate --result r.json --poses none.csv --output o.csv --frames f.json")).err,
              ::testing::Not(HasSubstr("is turned")));
  write("poses.csv", "x,y,z,qw,qx,qy,qz\n1,1,1,1,0,0,0\n");
  EXPECT_THAT(run(words_of("compensate --result r.json --poses poses.csv --output o.csv --frames f.json")).err,
              HasSubstr("f.json: the tool is turned as the flange"));
  // The tool of the controller's backup, or of a file in its frames, has the orientation: about the flange's y and x as
  // the faceplate's x and z say.
  write("SYSFRAME.VA",
        "[*SYSTEM*]$MNUTOOL  Storage: CMOS  Access: RW  : ARRAY[1,10] OF POSITION\n [1,2] =\n"
        "   Group: 1   Config: N D B, 0, 0, 0\n   X:   100.000   Y:    20.000   Z:   400.000\n"
        "   W:     0.000   P:    30.000   R:     0.000\n");
  write(
      "tools.json",
      R"({"tool_frames": {"2": {"position": [0.1, 0.02, 0.4], "quaternion_wxyz": [0.9659258262890683, 0, 0.25881904510252074, 0]}}})");
  for (const char* known : {"SYSFRAME.VA", "tools.json"}) {
    const Outcome turned =
        run(words_of(touches + "--force --output t.json --frames " + known + " --controller " + kController));
    ASSERT_EQ(turned.status, 1) << turned.err;
    EXPECT_THAT(turned.out, ::testing::Not(HasSubstr("not measured")));
    const Json tool = json_of("t.json")["tool_frames"]["2"];
    EXPECT_FALSE(tool.contains("orientation"));
    EXPECT_NEAR(tool["quaternion_wxyz"][0], std::cos(15.0 * kDegree), 1e-9) << known;
    EXPECT_NEAR(tool["quaternion_wxyz"][2], std::sin(15.0 * kDegree), 1e-9) << known;
    EXPECT_EQ(tool["position"], json["tool_frames"]["2"]["position"]) << known;
  }
  expect_refused(words_of("frames --tool-touches tip.csv --output u.json --frames tools.json"),
                 {"--frames: tools.json has no tool 1", "--tool-number"});
}

}  // namespace
}  // namespace kdl_calibration::testing::compensate_program_test
