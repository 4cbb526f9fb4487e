// Frames, nominal values and ranges in files of JSON.

#include "cli/frames.hpp"

#include <Eigen/Geometry>

#include "cli/measurement_options.hpp"
#include "cli_support.hpp"
#include "json_support.hpp"
#include "model/parameters.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::frames_test {
namespace {

using cli::Json;
using Eigen::Vector3d;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(FramesInFiles, GoIntoJsonAndBack) {
  Random random(4);
  for (int trial = 0; trial < 20; ++trial) {
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    X.linear() =
        Eigen::AngleAxisd{random.uniform(-3.1, 3.1), Vector3d{random.normal(), random.normal(), 1.0}.normalized()}
            .toRotationMatrix();
    X.translation() = Vector3d{random.normal(), random.normal(), random.normal()};
    const Json json = cli::frame_json(X);
    EXPECT_GE(json["quaternion_wxyz"][0], 0.0);
    EXPECT_EQ(json["position"], (Json{X.translation().x(), X.translation().y(), X.translation().z()}));
    EXPECT_LT(difference(to_kdl(placed_as(json)), to_kdl(X)), 1e-14);
    for (const Json& base : {json, Json{{"base", json}, {"position", "of something else"}}}) {
      EXPECT_TRUE(cli::base_of(base, "b.json").isApprox(X, 1e-14));
    }
    TargetFrame target{.name = "T", .X_FT = X};
    EXPECT_EQ(cli::target_json(target), (Json{{"name", "T"}, {"position", json["position"]}}));
    target.with_orientation = true;
    const TargetFrame read = cli::targets_of({{"targets", Json::array({cli::target_json(target)})}}, "t.json").at(0);
    EXPECT_TRUE(read.X_FT.isApprox(X, 1e-14) && read.with_orientation && read.name == "T");
  }
  EXPECT_EQ(cli::json_text({{"a", Json::array({1, "\xff"})}}), "{\n  \"a\": [\n    1,\n    \"\xef\xbf\xbd\"\n  ]\n}\n");
}

TEST(FramesInFiles, OfTheWrongFormAreRefusedWithFileAndKey) {
  const std::string of_target = R"({"targets": [{"name": "A", "position": [0, 0, 0]}, )";
  for (const auto& [text, words] : std::vector<std::pair<std::string, std::string>>{
           {"{\n\"base\": oops}", "f.json:2: malformed JSON"},
           {"{}", "position"},
           {R"({"position": [1, 2], "quaternion_wxyz": [1, 0, 0, 0]})",
            "f.json: position: expected an array of 3 numbers"},
           {R"({"base": {"position": [1, 2, 3], "quaternion_wxyz": [1, 1, 0, 0]}})",
            "f.json: base: quaternion_wxyz: expected a quaternion of norm 1"},
           {R"({"position": [0, 0, 0], "quaternion_wxyz": [1.0011, 0, 0, 0]})", "norm 1"},
           {R"({"position": [0, 0, 0], "quaternion_wxyz": [0.9989, 0, 0, 0]})", "norm 1"},
           {R"({"position": [1e999, 2, 3], "quaternion_wxyz": [1, 0, 0, 0]})", "f.json"},
           {R"({"position": ["1", 2, 3], "quaternion_wxyz": [1, 0, 0, 0]})",
            "f.json: position[0]: expected a finite "}}) {
    EXPECT_THAT(refusal([&, given = text] { cli::base_of(cli::json_of(given, "f.json"), "f.json"); }),
                HasSubstr(words));
  }
  for (const auto& [text, words] : std::vector<std::pair<std::string, std::string>>{
           {"{}", "targets"},
           {of_target + R"({"position": [0, 0, 0]}]})", "targets[1]: the key \"name\" is missing"},
           {of_target + R"({"name": "A", "position": [0, 0, 0]}]})", "targets[1]: target 'A' is there twice"}}) {
    EXPECT_THAT(refusal([&, given = text] { cli::targets_of(cli::json_of(given, "f.json"), "f.json"); }),
                HasSubstr(words));
  }
  for (const char* rounded : {"1.0009", "0.9991"}) {
    const std::string text = R"({"position": [0, 0, 0], "quaternion_wxyz": [)" + std::string(rounded) + ", 0, 0, 0]}";
    EXPECT_TRUE(cli::base_of(cli::json_of(text, "f.json"), "f.json").isApprox(Eigen::Isometry3d::Identity(), 1e-15));
  }
}

TEST(FramesInFiles, ATruthOfAnotherRobotIsRefusedFromANanometreOn) {
  const ErrorModel model = complete_model(fanuc());
  const double nominal = model.parameters[parameter_index(model, "Tz2")].nominal;
  const auto refused = [&](const Json& parameters) {
    return refusal([&] { cli::require_same_nominal({{"parameters", parameters}}, "t.json", model); });
  };
  const std::string taken = "nothing was refused";
  for (const double sign : {-1.0, 1.0}) {
    EXPECT_EQ(refused({{{"name", "Tz2"}, {"nominal", nominal + sign * 0.9e-9}}}), taken);
    EXPECT_THAT(refused({{{"name", "dq1"}, {"nominal", 0.0}}, {{"name", "Tz2"}, {"nominal", nominal + sign * 1.1e-9}}}),
                ::testing::AllOf(HasSubstr("t.json: parameters[1]: nominal 1.07"),
                                 HasSubstr(" of 'Tz2' is 1.075 in this URDF, expected the URDF, base and tip that ")));
  }
  EXPECT_EQ(refused({{{"name", "Tz2"}}, {{"name", "unknown"}, {"nominal", 5.0}}}), taken);
}

TEST(FramesInFiles, RangesOfATruthAreThoseOfItsJoints) {
  const ErrorModel model = complete_model(fanuc());
  EXPECT_EQ(cli::ranges_of(Json::object(), "t.json", model).size(), 6U);
  const auto ranges = cli::ranges_of(Json::parse(R"({"joint_ranges": [{"joint": "joint_5", "lower": -1, "upper": 2},
        {"joint": "other", "lower": 0, "upper": 1}, {"joint": "joint_1", "lower": 3, "upper": 3}]})"),
                                     "t.json", model);
  ASSERT_TRUE(ranges[0] && ranges[4]);
  EXPECT_EQ(*ranges[0], std::make_pair(3.0, 3.0));
  EXPECT_EQ(*ranges[4], std::make_pair(-1.0, 2.0));
  EXPECT_FALSE(ranges[1] || ranges[2] || ranges[3] || ranges[5]);
  EXPECT_THAT(refusal([&] {
                cli::ranges_of(Json::parse(R"({"joint_ranges": [{"joint": "joint_5", "lower": 2, "upper": 1}]})"),
                               "t.json", model);
              }),
              HasSubstr("t.json: joint_ranges[0]: expected lower <= upper"));
}

using KnownFramesInFiles = CommandLine;

TEST_F(KnownFramesInFiles, AreTheBaseAndWhatWasMeasured) {
  write("b.json", R"({"position": [1, 2, 3], "quaternion_wxyz": [0.6, 0, 0.8, 0]})");
  write("t.json", R"({"targets": [{"name": "X", "position": [9, 9, 9]}, {"name": "B", "position": [4, 5, 6]}]})");
  write("x.json", R"({"targets": [{"name": "X", "position": [9, 9, 9]}]})");
  Measurements measurements;
  measurements.targets = {"A", "B"};
  const KnownFrames none = cli::known_frames({}, measurements);
  EXPECT_THAT(none.bases, IsEmpty());
  EXPECT_THAT(none.targets, IsEmpty());
  const KnownFrames known =
      cli::known_frames({.known_bases = {path("b.json")}, .known_targets = path("t.json")}, measurements);
  const Eigen::Isometry3d X_WB = Eigen::Translation3d(1.0, 2.0, 3.0) * Eigen::Quaterniond(0.6, 0.0, 0.8, 0.0);
  ASSERT_EQ(known.bases.size(), 1U);
  EXPECT_TRUE(known.bases[0].X_WB.isApprox(X_WB, 1e-15));
  ASSERT_EQ(known.targets.size(), 1U);
  EXPECT_EQ(known.targets[0].name, "B");
  EXPECT_EQ(known.targets[0].X_FT.translation(), Vector3d(4.0, 5.0, 6.0));
  EXPECT_EQ(refusal([&] { cli::known_frames({.known_targets = path("x.json")}, measurements); }),
            path("x.json") + ": targets: none was measured, expected some of A, B");
}

TEST_F(KnownFramesInFiles, AreThoseOfTheNamedStations) {
  write("b.json", R"({"position": [1, 2, 3], "quaternion_wxyz": [1, 0, 0, 0]})");
  write("r.json", R"({"stations": [{"name": "E", "position": [7, 7, 7], "quaternion_wxyz": [1, 0, 0, 0]},
                                   {"name": "W", "position": [4, 5, 6], "quaternion_wxyz": [1, 0, 0, 0]}]})");
  Measurements measurements;
  measurements.targets = {"A"};
  measurements.stations = {"W", "N"};
  const auto known = [&](const std::vector<std::string>& given) {
    return cli::known_frames({.known_bases = given}, measurements);
  };
  const std::vector<StationBase> bases = known({"W=" + path("r.json"), "N=" + path("b.json")}).bases;
  ASSERT_EQ(bases.size(), 2U);
  EXPECT_EQ(bases[0].X_WB.translation(), Vector3d(4.0, 5.0, 6.0));
  EXPECT_EQ(bases[1].X_WB.translation(), Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(refusal([&] { known({"N=" + path("r.json")}); }),
            path("r.json") + ": stations: none is 'N', expected that station or a file of one base");
  EXPECT_EQ(refusal([&] { known({path("b.json")}); }),
            "--known-base: no station, expected STATION=FILE with one of W, N");
  EXPECT_EQ(refusal([&] {
              known({"W=" + path("b.json"), "W=" + path("r.json")});
            }),
            "--known-base: station 'W' is there twice, expected each once");
  measurements.stations = {"W"};
  EXPECT_EQ(known({"W=" + path("b.json")}).bases.size(), 1U) << "as a station is called without a name";
  EXPECT_EQ(refusal([&] { known({"N=" + path("b.json")}); }),
            "--known-base: station 'N', expected a file alone, as the measurements have no column station");
}

}  // namespace
}  // namespace kdl_calibration::testing::frames_test
