// What `kdlcal calibrate` reports beyond the fit, and that the README explains all of it.

#include <Eigen/Dense>
#include <algorithm>
#include <cctype>
#include <set>

#include "cli_support.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/measurements_file.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::cli_calibrate_test {
namespace {

using Json = nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;

const std::string kPendant = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json";

class CalibrateReport : public CommandLine {
protected:
  std::string readme() const {
    std::ifstream stream(std::string(URDF_DIR) + "/../README.md", std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
};

// The README with every word of its code spans.
std::set<std::string> words_in_code(const std::string& text) {
  std::set<std::string> words;
  bool code = false;
  std::string word;
  for (const char c : text) {
    const bool part = std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-';
    if (code && part) {
      word += c;
    } else {
      words.insert(word);
      word.clear();
    }
    code = c == '`' ? !code : code;
  }
  return words;
}

void collect_keys(const Json& json, std::set<std::string>& keys) {
  for (const auto& [key, value] : json.items()) {
    if (json.is_object()) {
      keys.insert(key);
    }
    if (value.is_structured() && key != "replaced_by") {  // whose keys are parameters
      collect_keys(value, keys);
    }
  }
}

TEST_F(CalibrateReport, EveryKeyOfTheResultStandsInTheReadme) {
  const std::vector<std::string> noisy = {"simulate", "--noise",       "2e-5", "--length-sigma",
                                          "0.001",    "--angle-sigma", "0.001"};
  const auto simulate = [&](std::vector<std::string> more) {
    more.insert(more.begin(), noisy.begin(), noisy.end());
    ASSERT_EQ(run(more).status, 0);
  };
  simulate({"--poses", "--targets", "2", "--repeats", "2", "--orientation-noise", "1e-4", "--configurations", "12",
            "--test-configurations", "5", "--output", "m.csv"});
  write("asked.csv", "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n0,0,0,0,0,0\n");
  std::set<std::string> keys;
  collect_keys(
      run_json({"calibrate", "--measurements", "m.csv", "--noise", "repeats", "--prior", "auto", "--effects", "auto",
                "--leave-one-out", "--nested", "--k-fold", "3", "--predict-at", "asked.csv", "--json"}),
      keys);
  simulate({"--output", "points.csv"});
  Measurements points = read_measurements(directory / "points.csv", joint_names(fanuc()));
  points.observations[40].position.y() += 0.01;
  write("mistyped.csv", measurements_csv(points));
  const Outcome mistyped = run({"calibrate", "--measurements", "mistyped.csv", "--method", "two-step", "--json"});
  collect_keys(Json::parse(mistyped.out), keys);
  collect_keys(Json::parse(run({"calibrate", "--measurements", "mistyped.csv", "--loss", "tukey", "--json"}).out),
               keys);
  EXPECT_TRUE(keys.count("findings") == 1 && keys.count("convergence_factor") == 1 && keys.count("asked") == 1 &&
              keys.count("cook") == 1 && keys.count("weights") == 1 && keys.count("nested_leave_one_out") == 1 &&
              keys.count("exported_urdf") == 1 && keys.count("amount") == 1 && keys.count("lower_triangle") == 1 &&
              keys.count("files_read") == 1);
  const std::set<std::string> known = words_in_code(readme());
  for (const std::string& key : keys) {
    EXPECT_EQ(known.count(key), 1U) << key;
  }
}

TEST_F(CalibrateReport, EveryOptionStandsInTheReadme) {
  const std::string help = run({"calibrate", "--help"}).out;
  const std::set<std::string> known = words_in_code(readme());
  for (std::size_t at = help.find("--"); at != std::string::npos; at = help.find("--", at + 2)) {
    std::size_t end = at + 2;
    while (std::isalnum(static_cast<unsigned char>(help[end])) != 0 || help[end] == '-') {
      ++end;
    }
    const std::string option = help.substr(at, end - at);
    EXPECT_EQ(known.count(option), 1U) << option;
  }
}

TEST_F(CalibrateReport, PredictsAtConfigurationsOfAFile) {
  ASSERT_EQ(run({"simulate", "--noise", "2e-5", "--length-sigma", "0.001", "--angle-sigma", "0.001", "--output",
                 "m.csv", "--truth", "truth.json"})
                .status,
            0);
  write("asked.csv",
        "# where the tool will work\njoint_2[deg],joint_1[deg],joint_3[deg],joint_4,joint_5,joint_6\n"
        "20,10,30,0.1,0.2,0.3\n-20,-10,0,0,0.5,0\n");
  const std::vector<std::string> command = {"calibrate", "--measurements", "m.csv", "--predict-at", "asked.csv"};
  std::vector<std::string> with_files = command;
  with_files.insert(with_files.end(), {"--result", "r.json"});
  const Outcome table = run(with_files);
  EXPECT_EQ(table.status, 0) << table.err;
  EXPECT_THAT(table.out, AllOf(HasSubstr("predicted, in the base"), HasSubstr("most influential"),
                               HasSubstr("Calibration converged: 30 configurations, 90 points, 33 parameters."),
                               HasSubstr("at unseen configurations"), HasSubstr("\nWritten: r.json\n")));
  const Json asked = json_of("r.json")["predicted_accuracy"]["asked"];
  ASSERT_EQ(asked.size(), 6U);
  EXPECT_EQ(asked[0]["configuration"], "1");
  EXPECT_EQ(asked[4]["configuration"], "2");
  EXPECT_EQ(asked[4]["target"], "B");
  // The flange by another subcommand, the target from the result.
  const Json frames = run_json({"fk", "--joints", "10,20,30,5.729577951308232,11.459155902616464,17.188733853924695",
                                "--degrees", "--result", "r.json", "--json"})["frames"];
  const Json& flange = frames.back();
  const Json target = json_of("r.json")["targets"][0]["position"];
  const auto& q = flange["quaternion_wxyz"];
  const Eigen::Vector3d expected =
      Eigen::Vector3d(flange["position"][0], flange["position"][1], flange["position"][2]) +
      Eigen::Quaterniond(q[0], q[1], q[2], q[3]) * Eigen::Vector3d(target[0], target[1], target[2]);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(asked[0]["position"][static_cast<std::size_t>(axis)], expected[axis], 1e-9);
  }
  EXPECT_GT(asked[0]["sigma"], 5e-6);
  EXPECT_LT(asked[0]["sigma"], 2e-4);
  EXPECT_GT(asked[0]["radius_95"], asked[0]["sigma"]);

  // The controller's joint values mean the same; a file of measurements will do.
  Measurements measured = read_measurements(directory / "m.csv", joint_names(fanuc()));
  const JointConvention pendant = matched_convention(read_joint_convention(kPendant), measured.joints);
  measured.joint_values = pendant.matrix.inverse() * measured.joint_values;
  std::string csv = measurements_csv(measured);
  for (int i = 1; i <= 6; ++i) {
    const std::string name = "joint_" + std::to_string(i);
    csv.replace(csv.find(name), name.size(), "J" + std::to_string(i));
  }
  write("controller.csv", csv);
  const Json here = run_json({"calibrate", "--measurements", "m.csv", "--predict-at", "m.csv", "--json"});
  const Json there = run_json({"calibrate", "--measurements", "controller.csv", "--predict-at", "controller.csv",
                               "--joint-convention", kPendant, "--json"});
  ASSERT_EQ(here["predicted_accuracy"]["asked"].size(), 90U);
  for (std::size_t i = 0; i < 90; ++i) {
    EXPECT_NEAR(here["predicted_accuracy"]["asked"][i]["position"][2],
                there["predicted_accuracy"]["asked"][i]["position"][2], 1e-9);
  }

  write("bad.csv", "joint_1,joint_2\n0,0\n");
  expect_refused({"calibrate", "--measurements", "m.csv", "--predict-at", "bad.csv", "--result", "x.json"},
                 {"bad.csv", "joint_3"});
  expect_refused({"calibrate", "--measurements", "m.csv", "--predict-at", "none.csv"}, {"none.csv"});
}

TEST_F(CalibrateReport, OrientationSigmaNeedsOrientationsAndPositionsToCompareWith) {
  ASSERT_EQ(run({"simulate", "--output", "m.csv"}).status, 0);
  expect_refused({"calibrate", "--measurements", "m.csv", "--orientation-sigma", "1e-4", "--noise-independent", "2e-5"},
                 {"--orientation-sigma: ", "m.csv", "quaternion"});
  ASSERT_EQ(run({"simulate", "--poses", "--targets", "1", "--output", "poses.csv"}).status, 0);
  expect_refused({"calibrate", "--measurements", "poses.csv", "--orientation-sigma", "1e-4"},
                 {"--orientation-sigma: ", "see --noise-independent, --noise-tracker, --noise"});
  expect_refused({"calibrate", "--measurements", "poses.csv", "--orientation-sigma", "-1"}, {"--orientation-sigma"});
  Measurements poses = read_measurements(directory / "poses.csv", joint_names(fanuc()));
  poses.observations.back().sigma = 2e-5;
  write("one.csv", measurements_csv(poses));
  expect_refused({"calibrate", "--measurements", "one.csv", "--orientation-sigma", "1e-4"},
                 {"--orientation-sigma: ", "sigma in every row"});
}

TEST_F(CalibrateReport, TakesATrackersOwnNoise) {
  ASSERT_EQ(run({"simulate", "--length-sigma", "0.001", "--angle-sigma", "0.001", "--output", "m.csv"}).status, 0);
  const auto sigma = [&](const std::string& noise) {
    const Json result =
        run_json({"calibrate", "--measurements", "m.csv", "--noise", "equal", "--noise-tracker", noise, "--json"});
    EXPECT_EQ(result["noise"]["model"], "stated");
    return result["noise"]["sigma"].get<double>();
  };
  EXPECT_NEAR(sigma("2e-5,0,2e-5,0"), 2e-5, 1e-15);  // the same in every direction
  // Mean information of a coordinate: a third of it along the line of sight.
  EXPECT_NEAR(sigma("1e-5,0,2e-5,0"), 1.0 / std::sqrt((1e10 + 2.0 * 0.25e10) / 3.0), 1e-12);
  EXPECT_GT(sigma("1e-5,0,2e-5,1e-5"), sigma("1e-5,0,2e-5,0"));
  expect_refused({"calibrate", "--measurements", "m.csv", "--noise-tracker", "1e-5,0,2e-5"}, {"--noise-tracker", "4"});
}

TEST_F(CalibrateReport, NamesWhatIsFixedByGauge) {
  ASSERT_EQ(run({"simulate", "--joint-ranges", "-90:90,-60:50,-60:60,40:40,-90:90,-180:180", "--noise", "1e-5",
                 "--length-sigma", "0.001", "--angle-sigma", "0.001", "--output", "m.csv"})
                .status,
            0);
  const Outcome outcome = run({"calibrate", "--measurements", "m.csv", "--result", "r.json"});
  EXPECT_EQ(outcome.status, 1);
  const Json result = json_of("r.json");
  ASSERT_FALSE(result["fixed_by_gauge"].empty());
  EXPECT_LT(result["position_error"]["train"]["after"]["rms"], 2e-5);
  for (const Json& parameter : result["parameters"]) {
    const auto& held = result["fixed_by_gauge"];
    if (std::find(held.begin(), held.end(), parameter["name"]) != held.end()) {
      EXPECT_EQ(parameter["error"], 0.0) << parameter;
      EXPECT_EQ(parameter["gauge"], true) << parameter;
    }
  }
  EXPECT_THAT(outcome.err,
              AllOf(HasSubstr("fixed by gauge"), HasSubstr(result["fixed_by_gauge"].front().get<std::string>())));
}

}  // namespace
}  // namespace kdl_calibration::testing::cli_calibrate_test
