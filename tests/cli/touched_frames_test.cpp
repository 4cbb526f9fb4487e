// kdlcal frames: its file, which compensate reads, its table, and what it refuses.

#include "interface/touched_frames.hpp"

#include <array>

#include "base/sha256.hpp"
#include "cli_options_support.hpp"
#include "kdl_calibration/result_file.hpp"
#include "printed_text.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::touched_frames_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr const char* kJoints = "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6";

// Touches of the flange's origin at arbitrary places: what is found from them is the library's matter.
constexpr const char* kTip =
    "0.1,0.2,0.3,0.4,0.5,0.6\n0.1,0.21,0.3,0.9,0.5,0.6\n0.1,0.2,0.3,0.4,0.9,0.6\n"
    "0.1,0.2,0.35,-0.4,0.5,1.6\n0.15,0.2,0.3,0.4,-0.5,0.1\n";
constexpr const char* kFixture = "0.1,0.2,0.3,0.4,0.5,0.6\n0.3,0.2,0.3,0.4,0.5,0.6\n0.1,0.4,0.3,0.4,0.5,0.6\n";

class Frames : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    write("tip.csv", std::string(kJoints) + "\n" + kTip);
    write("fixture.csv", std::string(kJoints) + "\n" + kFixture);
  }
};

TEST_F(Frames, OfTheNominalRobotAreThoseOfTheLibrary) {
  const Words words = {"frames", "--tool-touches", "tip.csv", "--user-touches", "fixture.csv", "--output", "f.json"};
  const Outcome outcome = run(words);
  EXPECT_EQ(outcome.status, 1);
  EXPECT_THAT(outcome.err, HasSubstr("the touches of the tool frame are off by "));
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("tool origin [mm]"), HasSubstr("user roll pitch yaw [deg]"),
                                 HasSubstr("tool: the touches are off by ")));
  const Json json = json_of("f.json");
  const TouchedFrames expected = touched_frames(
      nominal_basis(fanuc()), {.tool = read_configurations(fanuc(), directory / "tip.csv").joint_values,
                               .user = read_configurations(fanuc(), directory / "fixture.csv").joint_values,
                               .user_points = {}});
  for (std::size_t i = 0; i < 3; ++i) {
    const auto index = static_cast<Eigen::Index>(i);
    EXPECT_NEAR(json["tool"]["position"][i], expected.tool->frame.translation()[index], 1e-15);
    EXPECT_NEAR(json["tool"]["std"][i], expected.tool->std()[index], 1e-15);
    EXPECT_NEAR(json["user"]["position"][i], expected.user->frame.translation()[index], 1e-15);
    EXPECT_NEAR(json["user"]["std"][i + 3], expected.user->std()[index + 3], 1e-15);
  }
  EXPECT_NEAR(json["tool"]["rms"], *expected.tool->rms, 1e-15);
  EXPECT_TRUE(json["user"]["rms"].is_null());
  EXPECT_THAT(outcome.err, HasSubstr("three touches of the user frame leave no check"));
  EXPECT_NEAR(json["touch_sigma"], *expected.touch_sigma, 1e-15);
  EXPECT_TRUE(json["calibration"].is_null());
  EXPECT_EQ(json.dump(), Json::parse(run(words + Words{"--json", "--force"}).out).dump());
}

// One point of the fixture is the same in all files: with its coordinates, with a known tool, of a calibrated robot.
TEST_F(Frames, UseCoordinatesAKnownToolAndACalibration) {
  write("points.csv", std::string(kJoints) +
                          ",x[mm],y,z\n0.1,0.2,0.3,0.4,0.5,0.6,0,0,0\n0.3,0.2,0.3,0.4,0.5,0.6,400,0,0\n"
                          "0.1,0.4,0.3,0.4,0.5,0.6,0,0.35,0\n");
  ASSERT_EQ(run({"frames", "--user-touches", "points.csv", "--output", "points.json"}).status, 1);
  EXPECT_GT(json_of("points.json")["user"]["largest"], 1e-3);
  write("tool.json", R"({"tool": {"position": [0, -0.1, 0], "quaternion_wxyz": [1, 0, 0, 0]}})");
  succeed({"frames", "--user-touches", "fixture.csv", "--frames", "tool.json", "--output", "a.json"});
  const Eigen::Vector3d tip = to_eigen(kdl_pose(fanuc().chain, Eigen::VectorXd{{0.1, 0.2, 0.3, 0.4, 0.5, 0.6}})) *
                              Eigen::Vector3d(0.0, -0.1, 0.0);
  EXPECT_NEAR(json_of("a.json")["user"]["position"][2], tip.z(), 1e-12);
  succeed({"simulate", "--noise", "3e-5", "--length-sigma", "0.001", "--output", "m.csv"});
  succeed({"calibrate", "--measurements", "m.csv", "--effects", "none", "--prior", "none", "--result", "r.json"});
  succeed({"frames", "--result", "r.json", "--user-touches", "fixture.csv", "--output", "c.json"});
  const Json json = json_of("c.json");
  EXPECT_EQ(json["calibration"], sha256(text_of("r.json")));
  EXPECT_TRUE(json["user"]["std"][0].is_null());
  const Eigen::Isometry3d X_BF = load_calibration(directory / "r.json", fanuc())
                                     .arm()
                                     .flange_pose(Eigen::VectorXd{{0.1, 0.2, 0.3, 0.4, 0.5, 0.6}});
  EXPECT_NEAR(json["user"]["position"][2], X_BF.translation().z(), 1e-12);
  write("p.csv", std::string(kJoints) + "\n" + kFixture);
  const Words compensate = {"compensate", "--result", "r.json", "--joints", "p.csv", "--output", "o.csv", "--force"};
  EXPECT_EQ(run(compensate + Words{"--frames", "c.json"}).err, "");
  EXPECT_THAT(run(compensate + Words{"--frames", "points.json"}).err, HasSubstr("found with the nominal robot"));
}

// The tool points to the part, so the flange is above it; with the rows in another order z points into the part.
TEST_F(Frames, BelowWhichTheFlangeIsAreDoubted) {
  write("tool.json", R"({"tool": {"position": [0, 0.3, 0], "quaternion_wxyz": [1, 0, 0, 0]}})");
  const std::vector<std::string> rows = lines_of(kFixture);
  int doubted = 0;
  for (const auto& order : {std::array{0, 1, 2}, std::array{1, 0, 2}}) {
    std::string text = std::string(kJoints) + "\n";
    for (const int i : order) {
      text += rows.at(static_cast<std::size_t>(i)) + "\n";
    }
    write("order.csv", text);
    const Outcome outcome =
        run({"frames", "--user-touches", "order.csv", "--frames", "tool.json", "--output", "o.json", "--force"});
    const bool said = outcome.err.find("below the x-y plane of the user frame") != std::string::npos;
    EXPECT_EQ(outcome.status, said ? 1 : 0) << outcome.err;
    doubted += said ? 1 : 0;
  }
  EXPECT_EQ(doubted, 1);
}

TEST_F(Frames, RefuseWhatDeterminesNone) {
  write("three.csv", std::string(kJoints) + "\n" + kFixture);
  expect_refused({"frames", "--output", "f.json"}, {"--tool-touches", "--user-touches"});
  expect_refused({"frames", "--tool-touches", "three.csv", "--output", "f.json"}, {"3 touches of a tool", "4"});
  expect_refused({"frames", "--tool-touches", "none.csv", "--output", "f.json"}, {"none.csv"});
  expect_refused({"frames", "--user-touches", "fixture.csv", "--output", "fixture.csv", "--force"}, {"fixture.csv"});
}

}  // namespace
}  // namespace kdl_calibration::testing::touched_frames_test
