// What calibrate writes for others to build on: provenance, residuals, covariance, requirements; and that results are
// read back.

#include "kdl_calibration/calibration.hpp"

#include <cmath>
#include <sstream>

#include "base/sha256.hpp"
#include "cli_support.hpp"
#include "kdl_calibration/calibrated_arm.hpp"
#include "kdl_calibration/measurements_file.hpp"
#include "kdl_calibration/saved_calibration.hpp"
#include "kdl_calibration/simulation.hpp"
#include "printed_text.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing::cli_result_test {
namespace {

using Json = nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using Words = std::vector<std::string>;

class CalibrateResult : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    write("m.csv", measurements_csv(without_sigmas(VirtualExperiment().measure(20, {.sigma = 3e-5}))));
  }

  static Words calibrate(const Words& more = {}) {
    Words words = {"calibrate", "--measurements", "m.csv"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }

  static std::vector<std::vector<std::string>> table_of(const std::string& csv) {
    std::vector<std::vector<std::string>> rows;
    for (const std::string& line : lines_of(csv)) {
      rows.emplace_back();
      std::istringstream fields(line);
      for (std::string field; std::getline(fields, field, ',');) {
        rows.back().push_back(field);
      }
    }
    return rows;
  }
};

TEST_F(CalibrateResult, NamesWhatItWasMadeFromAndWhatElseWasWritten) {
  const Words command = calibrate({"--note", "serial=R 12,5", "--note", "operator=M\u00fcller", "--output", "c.urdf",
                                   "--residuals", "e.csv", "--result", "r.json"});
  ASSERT_EQ(run(command).status, 0);
  const Json provenance = json_of("r.json")["provenance"];
  EXPECT_EQ(provenance["notes"], (Json{{"serial", "R 12,5"}, {"operator", "M\u00fcller"}}));
  const std::string urdf = std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf";
  ASSERT_EQ(provenance["files_read"].size(), 2U);
  EXPECT_EQ(provenance["files_read"][0]["role"], "urdf");
  EXPECT_EQ(provenance["files_read"][0]["sha256"], sha256(content(urdf)));
  EXPECT_EQ(provenance["files_read"][1]["role"], "measurements");
  EXPECT_EQ(provenance["files_read"][1]["path"], "m.csv");
  EXPECT_EQ(provenance["files_read"][1]["sha256"], sha256(text_of("m.csv")));
  ASSERT_EQ(provenance["files_written"].size(), 2U);
  EXPECT_EQ(provenance["files_written"][0]["path"], "c.urdf");
  EXPECT_EQ(provenance["files_written"][0]["sha256"], sha256(text_of("c.urdf")));
  EXPECT_EQ(provenance["files_written"][1]["sha256"], sha256(text_of("e.csv")));
  EXPECT_EQ(json_of("r.json")["exported_urdf"]["sha256"], sha256(text_of("c.urdf")));
  const std::string first = text_of("r.json");
  Words again = command;
  again.emplace_back("--force");
  ASSERT_EQ(run(again).status, 0);
  EXPECT_TRUE(text_of("r.json") == first) << "the same input gave other bytes";
}

TEST_F(CalibrateResult, NamesTheFileThatItsOptionsCameFrom) {
  write("options.toml", "[calibrate]\nnoise = \"equal\"\n");
  Words command = calibrate({"--result", "r.json"});
  command.insert(command.begin(), {"--config", "options.toml"});
  ASSERT_EQ(run(command).status, 0);
  const Json files = json_of("r.json")["provenance"]["files_read"];
  ASSERT_EQ(files.size(), 3U);
  EXPECT_EQ(files[2]["role"], "config");
  EXPECT_EQ(files[2]["sha256"], sha256(text_of("options.toml")));
  EXPECT_EQ(json_of("r.json")["noise"]["model"], "residuals");
}

TEST_F(CalibrateResult, RefusesNotesThatAreNone) {
  expect_refused(calibrate({"--note", "serial"}), {"--note", "'serial'", "key=value"});
  expect_refused(calibrate({"--note", "=5"}), {"--note", "'=5'", "key=value"});
  expect_refused(calibrate({"--note", "a=1", "--note", "a=2"}), {"--note", "'a'", "once"});
}

TEST_F(CalibrateResult, WritesResidualsAndCovarianceAsInTheResult) {
  ASSERT_EQ(run(calibrate({"--residuals", "e.csv", "--covariance", "c.csv", "--result", "r.json"})).status, 0);
  const Json result = json_of("r.json");
  const auto rows = table_of(text_of("e.csv"));
  ASSERT_EQ(rows.size(), 61U);
  EXPECT_THAT(rows[0],
              ElementsAre("configuration", "repeat", "target", "split", "dx[m]", "dy[m]", "dz[m]", "distance[m]"));
  for (std::size_t i = 0; i < 60; ++i) {
    const Json& row = result["residuals"]["rows"][i];
    EXPECT_EQ(rows[i + 1][0], row["configuration"]);
    EXPECT_EQ(rows[i + 1][2], row["target"]);
    EXPECT_EQ(std::stod(rows[i + 1][5]), row["residual"][1]);
    EXPECT_EQ(std::stod(rows[i + 1][7]), row["distance"]);
  }
  const auto matrix = table_of(text_of("c.csv"));
  const Json& names = result["covariance"]["names"];
  ASSERT_EQ(matrix.size(), names.size() + 1);
  for (std::size_t r = 0; r < names.size(); ++r) {
    EXPECT_EQ(matrix[0][r + 1], names[r]);
    EXPECT_EQ(matrix[r + 1][0], names[r]);
    for (std::size_t c = 0; c <= r; ++c) {
      EXPECT_EQ(std::stod(matrix[r + 1][c + 1]), result["covariance"]["lower_triangle"][r][c]);
    }
  }
}

TEST_F(CalibrateResult, HoldsEveryPointThatWasLeftOut) {
  ASSERT_EQ(run(calibrate({"--result", "r.json"})).status, 0);
  const Json result = json_of("r.json");
  const Json& points = result["held_out_points"];
  ASSERT_EQ(points.size(), 60U);
  double squares = 0.0;
  for (const Json& point : points) {
    squares += point["distance"].get<double>() * point["distance"].get<double>();
  }
  EXPECT_NEAR(std::sqrt(squares / 60.0), result["position_error"]["leave_one_out"]["after"]["rms"].get<double>(),
              1e-15);
  EXPECT_EQ(points[0]["configuration"], result["residuals"]["rows"][0]["configuration"]);
  ASSERT_EQ(run(calibrate({"--loss", "huber", "--result", "robust.json"})).status, 0);
  EXPECT_TRUE(json_of("robust.json")["held_out_points"].is_null()) << "each fold was fitted again";
}

TEST_F(CalibrateResult, MustBeWhatIsRequired) {
  const Json result = run_json(calibrate({"--json"}));
  const double rms = result["position_error"]["leave_one_out"]["after"]["rms"].get<double>() * 1e3;
  const auto with = [&](const Words& requirements) {
    Words words = calibrate();
    for (const std::string& requirement : requirements) {
      words.insert(words.end(), {"--require", requirement});
    }
    return run(words);
  };
  const auto around = [&](const std::string& path, const std::string& comparison, double factor) {
    return path + comparison + std::to_string(rms * factor) + "mm";
  };
  Words fulfilled;
  Words not_fulfilled;
  for (const char* path : {"leave_one_out.rms", "leave_one_out.after.rms", "position_error.leave_one_out.after.rms"}) {
    fulfilled.insert(fulfilled.end(), {around(path, "<=", 1.01), around(path, ">=", 0.99)});
    not_fulfilled.insert(not_fulfilled.end(), {around(path, " < ", 0.99), around(path, ">", 1.01)});
  }
  const Outcome met = with(fulfilled);
  EXPECT_EQ(met.status, 0) << met.err;
  const Outcome unmet = with(not_fulfilled);
  EXPECT_EQ(unmet.status, 1);
  for (const std::string& requirement : not_fulfilled) {
    EXPECT_THAT(unmet.err, HasSubstr("'" + requirement + "' is not fulfilled"));
  }
  EXPECT_EQ(with({"rank==33", "parameters.0.std<1 mm", "noise.sigma<50um", "targets.0.position.0<0.2m"}).status, 0);
  const Outcome missed = with({"rank == 33", "rank==32", "test.rms<1mm"});
  EXPECT_EQ(missed.status, 1);
  EXPECT_THAT(lines_of(missed.err), ElementsAre("kdlcal: required: 'rank==32' is not fulfilled: the value is 33",
                                                "kdlcal: required: 'test.rms<1mm' is not fulfilled: the value is not "
                                                "determined"));
  EXPECT_THAT(missed.out, HasSubstr("Calibration converged"));
}

TEST_F(CalibrateResult, SaysWhatBecameOfEveryRequirement) {
  ASSERT_EQ(run(calibrate({"--result", "r.json", "--require", "rank==32,noise.sigma<50um"})).status, 1);
  Json judged = json_of("r.json");
  EXPECT_EQ(
      judged["requirements"],
      Json::array(
          {{{"text", "rank==32"}, {"fulfilled", false}, {"message", "'rank==32' is not fulfilled: the value is 33"}},
           {{"text", "noise.sigma<50um"}, {"fulfilled", true}, {"message", nullptr}}}));
  EXPECT_EQ(judged["trusted"], true) << "which nothing was required of";
  ASSERT_EQ(run(calibrate({"--result", "plain.json"})).status, 0);
  judged.erase("requirements");
  EXPECT_EQ(judged, json_of("plain.json"));
}

TEST_F(CalibrateResult, RefusesRequirementsThatAreNone) {
  for (const char* text : {"rms", "rms=1", "<1", "rms<", "rms<x", "rms<1kg", "a..b<1", "rms<>1"}) {
    expect_refused(calibrate({"--require", text}), {"--require", text});
  }
  expect_refused(calibrate({"--require", "\xff<1"}), {"--require", "UTF-8"});
  expect_refused({"validate", "--measurements", "m.csv", "--require", "rms"}, {"--require", "'rms'"});
}

TEST_F(CalibrateResult, IsValidatedWithItsFullModel) {
  ASSERT_EQ(run(calibrate({"--result", "r.json", "--output", "c.urdf"})).status, 0);
  const double fitted = json_of("r.json")["position_error"]["train"]["after"]["rms"];
  const Json validated = run_json({"validate", "--result", "r.json", "--measurements", "m.csv", "--json"});
  EXPECT_NEAR(validated["position_error"]["all"]["rms"], fitted, 1e-9);
  EXPECT_EQ(run({"validate", "--result", "r.json", "--measurements", "m.csv", "--require", "all.rms<0.1mm"}).status, 0);
  EXPECT_EQ(run({"validate", "--measurements", "m.csv", "--require", "all.rms<0.1mm"}).status, 1);
}

TEST_F(CalibrateResult, IsRefusedWithTheUrdfThatItCorrected) {
  ASSERT_EQ(run(calibrate({"--result", "r.json", "--output", "c.urdf"})).status, 0);
  const Words fk = {"fk", "--joints", "0.1,0.2,0.3,0.4,0.5,0.6", "--json"};
  const Json by_result = run_json({"fk", "--joints", "0.1,0.2,0.3,0.4,0.5,0.6", "--json", "--result", "r.json"});
  const Json by_urdf = run_json({"fk", "--joints", "0.1,0.2,0.3,0.4,0.5,0.6", "--json", "--urdf", "c.urdf"});
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(by_result["frames"].back()["position"][axis], by_urdf["frames"].back()["position"][axis], 1e-12);
  }
  for (const char* subcommand : {"fk", "jacobian"}) {
    expect_refused({subcommand, "--joints", "0,0,0,0,0,0", "--urdf", "c.urdf", "--result", "r.json"},
                   {"r.json: was not made with c.urdf", "hash"});
  }
  expect_refused({"validate", "--urdf", "c.urdf", "--result", "r.json", "--measurements", "m.csv"}, {"r.json", "hash"});
}

TEST_F(CalibrateResult, FkMovesAndTiltsTheJointsAsTheResultSays) {
  for (const char* effect : {"transverse", "gain"}) {
    ASSERT_EQ(run({"simulate", "--configurations", "40", "--targets", "2", "--effects", effect, "--effect-sigma",
                   "0.0005", "--output", "m.csv", "--force"})
                  .status,
              0);
    ASSERT_EQ(run(calibrate({"--effects", effect, "--prior", "none", "--result", "r.json", "--force"})).status, 0);
    const Json fk = run_json({"fk", "--joints", "0.1,0.2,0.3,0.4,0.5,0.6", "--json", "--result", "r.json"});
    const SavedCalibration saved = load_calibration(directory / "r.json", fanuc());
    Eigen::VectorXd q(6);
    q << 0.1, 0.2, 0.3, 0.4, 0.5, 0.6;
    const Eigen::Vector3d expected =
        CalibratedArm(saved.model, saved.estimate.errors, saved.estimate.effects).flange_pose(q).translation();
    const Eigen::Vector3d rigid = CalibratedArm(saved.model, saved.estimate.errors, {}).flange_pose(q).translation();
    const auto found = fk["frames"].back()["position"].get<std::vector<double>>();
    EXPECT_LT((Eigen::Map<const Eigen::Vector3d>(found.data()) - expected).norm(), 1e-9) << effect;
    EXPECT_GT((rigid - expected).norm(), 1e-5) << effect;
  }
}

// ---- Help ----------------------------------------------------------------------------------------------------------

TEST_F(CalibrateResult, HelpIsEightyColumnsWideAndGrouped) {
  for (const char* subcommand : {"model", "fk", "jacobian", "simulate", "calibrate", "validate", "plan"}) {
    for (const std::string& line : lines_of(run({subcommand, "--help"}).out)) {
      if (line.rfind("  kdlcal ", 0) != 0) {  // examples are for copying
        EXPECT_LE(line.size(), 80U) << line;
      }
    }
  }
  const std::string help = run({"calibrate", "--help"}).out;
  std::size_t at = 0;
  for (const char* heading : {"\nInput:\n", "\nOutput:\n", "\nModel:\n", "\nNoise:\n", "\nValidation:\n"}) {
    at = help.find(heading, at);
    ASSERT_NE(at, std::string::npos) << heading << help;
  }
}

TEST_F(CalibrateResult, ANearlyRightOptionIsRecognised) {
  expect_refused({"calibrate", "--measurments", "m.csv"}, {"'--measurments'", "did you mean --measurements?"});
  expect_refused({"calibrate", "--measurements", "m.csv", "--leave-one-otu"}, {"did you mean --leave-one-out?"});
  const Outcome far = run({"calibrate", "--measurements", "m.csv", "--zzzzzzzz"});
  EXPECT_THAT(far.err, Not(HasSubstr("did you mean")));
}

}  // namespace
}  // namespace kdl_calibration::testing::cli_result_test
