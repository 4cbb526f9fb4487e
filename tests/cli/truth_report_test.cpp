#include "cli/truth_report.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "cli_support.hpp"
#include "json_support.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "planning/two_step_trial.hpp"
#include "printed_text.hpp"
#include "robot/joint_ranges.hpp"
#include "two_step/identification_jacobian.hpp"
#include "urdf_text.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing::truth_report_test {
namespace {

using Json = nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;

using TwoStep = CommandLine;

TEST_F(TwoStep, TooFewRoundsAreNotToBeTrusted) {
  const Outcome outcome = run({"simulate", "--joint-ranges", "published", "--two-step", "5"});
  EXPECT_EQ(outcome.status, 1);
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("iteration_limit"), HasSubstr("    5  "), HasSubstr("30 fresh"),
                                 HasSubstr("dq6"), HasSubstr("gauge"), HasSubstr("largest difference")));
}

TEST_F(TwoStep, SettlesWithNoise) {
  const Outcome outcome =
      run({"simulate", "--joint-ranges", "published", "--noise", "0.00003", "--two-step", "40", "--seed", "2"});
  EXPECT_EQ(outcome.status, 0) << outcome.out;
  EXPECT_THAT(outcome.out, HasSubstr("noise alone"));
}

TEST_F(TwoStep, WritesTheTruthThatItComparesWith) {
  const Json found = Json::parse(run(words_of("simulate --two-step 3 --truth truth.json --json")).out);
  const Json truth = json_of("truth.json");
  ASSERT_EQ(truth["parameters"].size(), found["parameters"].size());
  for (const Json& parameter : truth["parameters"]) {
    const auto beside = std::find_if(found["parameters"].begin(), found["parameters"].end(),
                                     [&](const Json& p) { return p["name"] == parameter["name"]; });
    ASSERT_NE(beside, found["parameters"].end()) << parameter;
    EXPECT_EQ((*beside)["true"], parameter["value"]);
  }
}

TEST_F(TwoStep, RefusesWhatDoesNotGoWithIt) {
  expect_refused({"simulate", "--two-step", "5", "--output", "m.csv"}, {"--two-step", "--output"});
  expect_refused({"simulate", "--two-step", "5", "--monte-carlo", "5"}, {"--two-step", "--monte-carlo"});
  expect_refused({"simulate", "--two-step", "5", "--poses"}, {"--two-step", "--poses"});
  expect_refused({"simulate", "--two-step", "-1"}, {"--two-step"});
  expect_refused({"simulate", "--two-step", "5", "--configurations", "1"}, {"too few", "9 measured", "18 unknowns"});
  expect_refused({"simulate", "--recorded"}, {"--recorded", "--two-step"});
}

class Truth : public CommandLine {
protected:
  void calibrate(const std::vector<std::string>& options) {
    std::vector<std::string> simulate =
        words_of("simulate --joint-ranges published --output m.csv --truth truth.json --seed 4 --force") + options;
    write_once(::testing::PrintToString(options), [&] {
      succeed(simulate);
      succeed({"calibrate", "--measurements", "m.csv", "--result", "result.json", "--force"});
    });
  }
};

TEST_F(Truth, StatesTheDistancesOfPointsThatKdlGives) {
  calibrate({"--noise", "0.0001"});
  const Json found =
      run_json({"validate", "--result", "result.json", "--truth", "truth.json", "--seed", "9", "--json"});
  const ErrorModel model = complete_model(fanuc());
  Random random(9);
  const Eigen::MatrixXd q = random_configurations(published_ranges(model.joints), 1000, random);
  const Estimate result = estimate_in(model, json_of("result.json"));
  const Estimate truth = estimate_in(model, json_of("truth.json"));
  const KDL::Chain found_chain = error_chain(model, result.errors);
  const KDL::Chain true_chain = error_chain(model, truth.errors);
  Eigen::MatrixXd distances(3, 1000);
  for (Eigen::Index c = 0; c < 1000; ++c) {
    for (Eigen::Index t = 0; t < 3; ++t) {
      distances(t, c) =
          (kdl_point(found_chain, result, q.col(c), t) - kdl_point(true_chain, truth, q.col(c), t)).norm();
    }
  }
  EXPECT_NEAR(found["position_error"]["all"]["rms"], distances.norm() / std::sqrt(3000.0), 1e-12);
  EXPECT_NEAR(found["position_error"]["all"]["max"], distances.maxCoeff(), 1e-12);
  for (const Json& parameter : found["parameters"]) {  // the irreducible truth differs in base and targets alone
    EXPECT_NEAR(parameter["true_in_gauge"], parameter["gauge"] ? parameter["estimated"] : parameter["true"], 1e-10)
        << parameter;
  }
  const Outcome table = run({"validate", "--result", "result.json", "--truth", "truth.json"});
  EXPECT_EQ(table.status, 0);
  EXPECT_THAT(table.out, AllOf(HasSubstr("1000 configurations"), HasSubstr("estimated"), HasSubstr("true in gauge"),
                               HasSubstr("joint_2"), HasSubstr("target C")));
}

TEST_F(Truth, HasTheEffectsThatBendTheArm) {
  succeed(
      words_of("simulate --configurations 40 --noise 3e-5 --length-sigma 0.001 --angle-sigma 0.001 --seed 5 --effects "
               "gravity --output m.csv --truth truth.json"));
  const auto rms_of = [&](const std::string& result, const std::vector<std::string>& options) {
    EXPECT_EQ(run(Words{"calibrate", "--measurements", "m.csv", "--result", result} + options).status, 0);
    return run_json({"validate", "--result", result, "--truth", "truth.json", "--json"})["position_error"]["all"]["rms"]
        .get<double>();
  };
  EXPECT_LT(rms_of("result.json", {"--effects", "gravity"}), 5e-5);
  EXPECT_GT(rms_of("rigid.json", {"--effects", "none"}), 2e-4);
  const Json terms = json_of("result.json")["effects"]["terms"];
  EXPECT_EQ(terms.size(), json_of("truth.json")["effects"]["terms"].size());
}

TEST_F(Truth, HasNoEffectsWhereRunsKnowOfNone) {
  expect_refused({"simulate", "--effects", "gravity", "--monte-carlo", "2"}, {"--effects", "--monte-carlo"});
  expect_refused({"simulate", "--effects", "gravity", "--two-step", "2"}, {"--effects", "--two-step"});
  expect_refused({"simulate", "--effects", "sagging", "--output", "n.csv"}, {"--effects", "'sagging'", "gravity"});
  succeed({"simulate", "--effects", "gain", "--effect-sigma", "0", "--output", "m.csv", "--truth", "t.json"});
  EXPECT_FALSE(json_of("t.json").contains("effects")) << "of no size";
  expect_refused({"simulate", "--effects", "none,gain", "--output", "n.csv"}, {"--effects", "'none'"});
}

TEST_F(Truth, RefusesWhatDoesNotBelongTogether) {
  calibrate({"--model", "irreducible"});
  expect_refused({"validate", "--result", "result.json"}, {"--truth"});
  expect_refused({"validate", "--truth", "truth.json"}, {"--result"});
  expect_refused({"validate"}, {"--measurements"});
  expect_refused({"validate", "--result", "result.json", "--truth", "truth.json", "--measurements", "m.csv"},
                 {"--measurements", "--truth"});
  expect_refused({"validate", "--result", "result.json", "--truth", "m.csv"}, {"m.csv"});
  write("odd.urdf", kOddArm);
  expect_refused({"validate", "--urdf", "odd.urdf", "--result", "result.json", "--truth", "truth.json"},
                 {"result.json"});
  Json truth = json_of("truth.json");
  truth["targets"].erase(1);
  write("fewer.json", truth.dump());
  expect_refused({"validate", "--result", "result.json", "--truth", "fewer.json"}, {"target 'B'"});
  truth = json_of("truth.json");
  truth["parameters"][1]["nominal"] = 0.5;
  write("other.json", truth.dump());
  expect_refused({"validate", "--result", "result.json", "--truth", "other.json"}, {"other.json", "nominal 0.5"});
}

using Matrices = CommandLine;

TEST_F(Matrices, AreWrittenForEveryConfigurationOfAFile) {
  succeed({"simulate", "--configurations", "7", "--targets", "2", "--output", "m.csv"});
  const std::vector<std::string> command = {
      "jacobian", "--identification", "--configuration-file", "m.csv", "--targets", "4", "--model", "complete"};
  const Json json = run_json(command + Words{"--output", "j.csv", "--json"});
  EXPECT_EQ(text_of("j.csv"), run(command).out);
  const auto rows = cells_of(text_of("j.csv"));
  const std::size_t columns = 6 + complete_model(fanuc()).parameters.size() + 12;
  ASSERT_EQ(rows.size(), 1U + 7U * 12U);
  EXPECT_THAT(text_of("j.csv"), ::testing::StartsWith("configuration,target,axis,base.Tx[m/m],"));
  for (const char* column : {",base.Rz[m/rad],", ",dq2[m/rad],", ",Tz2[m/m],", ",D.x[m/m],", ",p_base.x[m/m],",
                             ",phi_base.z[m/rad],u_A.x[m/m],"}) {
    EXPECT_THAT(text_of("j.csv"), HasSubstr(column));
  }
  EXPECT_EQ(json["columns"].size(), columns);
  EXPECT_EQ(json["A_columns"].size(), 18U);
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const Json& configuration = json["configurations"].at((i - 1) / 12);
    const std::size_t row = (i - 1) % 12;
    EXPECT_EQ(rows[i][0], std::to_string(1 + (i - 1) / 12));
    EXPECT_EQ(rows[i][1], std::string(1, static_cast<char>('A' + row / 3)));
    EXPECT_EQ(rows[i][2], std::string(1, static_cast<char>('x' + row % 3)));
    ASSERT_EQ(rows[i].size(), 3U + columns + 18U);
    for (std::size_t c = 0; c < columns + 18; ++c) {
      EXPECT_EQ(std::stod(rows[i][c + 3]),
                c < columns ? configuration["jacobian"][row][c] : configuration["A"][row][c - columns]);
    }
  }
}

TEST_F(Matrices, OfAResultAreAtItsErrorsBaseAndTargets) {
  write("r.json", R"({"parameters": [{"name": "dq2", "error": 0.002}, {"name": "Tz3", "error": -0.01}],
    "base": {"position": [1, 2, 3], "quaternion_wxyz": [0.6, 0, 0.8, 0]},
    "targets": [{"name": "A", "position": [0.1, 0.2, 0], "quaternion_wxyz": [1, 0, 0, 0]},
                {"name": "B", "position": [0, 0.2, 0.3]}]})");
  write("t.json", R"({"targets": [{"name": "Q", "position": [0.3, 0.1, -0.2]}]})");
  const ErrorModel model = complete_model(fanuc());
  Estimate estimate{.errors = errors_of(model, {{"dq2", 0.002}, {"Tz3", -0.01}}),
                    .frames = {.bases = {Eigen::Translation3d(1.0, 2.0, 3.0) * Eigen::Quaterniond(0.6, 0.0, 0.8, 0.0)},
                               .targets = targets_at({{0.1, 0.2, 0.0}, {0.0, 0.2, 0.3}})}};
  Eigen::VectorXd q(6);
  q << 0.1, 0.2, -0.3, 0.4, 0.5, 0.6;
  const std::vector<std::string> command =
      words_of("jacobian --identification --joints 0.1,0.2,-0.3,0.4,0.5,0.6 --result r.json");
  const auto expect = [&](const std::vector<std::string>& words) {
    const Json found = run_json(words)["configurations"][0];
    const Unknowns free = Unknowns(model, estimate.frames.targets, reduced_model(model, estimate.frames.targets).kept);
    for (const auto& [key, matrix] : {std::pair{"jacobian", identification_jacobian(model, estimate, free, q)},
                                      std::pair{"A", base_and_tool_matrix(model, estimate, q)}}) {
      const std::vector<std::vector<double>> rows = found[key];
      ASSERT_EQ(rows.size(), static_cast<std::size_t>(matrix.rows())) << key;
      for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
        const std::vector<double>& row = rows[static_cast<std::size_t>(r)];
        ASSERT_EQ(row.size(), static_cast<std::size_t>(matrix.cols())) << key;
        EXPECT_LT((Eigen::Map<const Eigen::RowVectorXd>(row.data(), matrix.cols()) - matrix.row(r)).norm(), 1e-12);
      }
    }
  };
  expect(command + Words{"--json"});
  estimate.frames.targets = targets_at({{0.3, 0.1, -0.2}});
  expect(command + Words{"--json", "--target-file", "t.json"});
  const std::size_t columns = reduced_model(model, estimate.frames.targets).kept.size();
  EXPECT_EQ(
      run(command + Words{"--target-file", "t.json", "--output", "j.csv"}).out,
      "1 configurations, in each the identification Jacobian, 3 x " + std::to_string(columns) + ", and A, 3 x 9\n");
}

TEST_F(Matrices, RefuseBadUsage) {
  write("old.csv", "");
  write("m.csv", "configuration,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n1,0,0,0,0,0,0\n");
  expect_refused({"jacobian"}, {"--joints is required"});
  expect_refused({"jacobian", "--identification"}, {"--joints is required", "--configuration-file"});
  expect_refused({"jacobian", "--configuration-file", "m.csv"}, {"--identification"});
  expect_refused({"jacobian", "--joints", "0,0,0,0,0,0", "--output", "j.csv"}, {"--output", "--identification"});
  expect_refused({"jacobian", "--identification", "--joints", "0,0,0,0,0,0", "--configuration-file", "m.csv"},
                 {"one of the two"});
  expect_refused({"jacobian", "--identification", "--configuration-file", "m.csv", "--output", "old.csv"},
                 {"old.csv", "exists"});
}

using History = CommandLine;
using MimicCommands = CommandLine;

TEST_F(History, OfTheMisfitStandsInTheResultOfBothEstimators) {
  succeed({"simulate", "--joint-ranges", "published", "--noise", "0.00003", "--output", "m.csv"});
  const std::vector<std::vector<std::string>> variants = {{"--method", "joint"},
                                                          {"--method", "two-step", "--iterations", "40"},
                                                          {"--loss", "huber", "--effects", "none", "--prior", "none"}};
  for (const auto& options : variants) {
    const Json result = Json::parse(run(Words{"calibrate", "--measurements", "m.csv", "--json"} + options).out);
    const std::vector<double> history = result["history"];
    const std::string what = ::testing::PrintToString(options);
    ASSERT_EQ(history.size(), result["iterations"].get<std::size_t>()) << what;
    EXPECT_GT(history.front(), 1e-3) << what << " starts with nominal geometry";
    EXPECT_LT(history.back(), history.front()) << what;
    EXPECT_NEAR(history.back(), result["position_error"]["train"]["after"]["rms"], 2e-6) << what;
  }
}

// joint_3 keeps the upper arm's angle against the horizontal, as a parallelogram does.
TEST_F(MimicCommands, TakeTheIndependentJointsAlone) {
  write("p.urdf", urdf::with_mimic(content(std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf"), "joint_3",
                                   R"(joint="joint_2" multiplier="-1" offset="0.1")"));
  const Json tip = run_json({"fk", "--urdf", "p.urdf", "--joints", "0.1,0.2,0.3,0.4,0.5", "--json"})["frames"].back();
  const Json same = run_json({"fk", "--joints", "0.1,0.2,-0.1,0.3,0.4,0.5", "--json"})["frames"].back();
  EXPECT_LT((vector_of(tip["position"]) - vector_of(same["position"])).cwiseAbs().maxCoeff(), 1e-14);
  const Json jacobian = run_json({"jacobian", "--urdf", "p.urdf", "--joints", "0.1,0.2,0.3,0.4,0.5", "--json"});
  EXPECT_EQ(jacobian["kdl"][0].size(), 6U) << "every joint has its column";
  expect_refused({"fk", "--urdf", "p.urdf", "--joints", "0,0,0,0,0,0"},
                 {"expected 5", "joint_1, joint_2, joint_4, joint_5, joint_6"});
}

struct ValidationTask {
  ErrorModel model = complete_model(fanuc());
  Estimate estimate{.frames = {.bases = {Eigen::Isometry3d(Eigen::Translation3d(1.0, 2.0, 3.0))},
                               .targets = targets_at({{0.1, 0.2, 0.3}, {0.4, 0.5, 0.6}})}};
  Estimate truth{.frames = {.bases = {Eigen::Isometry3d(Eigen::Translation3d(4.0, 5.0, 6.0))},
                            .targets = targets_at({{0.11, 0.22, 0.33}, {0.44, 0.55, 0.66}, {7.0, 8.0, 9.0}})}};
  TruthComparison comparison;

  ValidationTask() {
    std::reverse(truth.frames.targets.begin(), truth.frames.targets.end());
    comparison.truth_in_gauge = {.frames = {.bases = {Eigen::Isometry3d(Eigen::Translation3d(1.5, 2.5, 3.5))},
                                            .targets = targets_at({{0.12, 0.23, 0.34}, {0.45, 0.57, 0.68}})}};
    comparison.gauge_misfit = 1e-12;
    comparison.parameters = {
        {.index = parameter_index(model, "dq2"),
         .estimated = 1.0 * kDegree,
         .truth = 2.5 * kDegree,
         .truth_in_gauge = 1.25 * kDegree},
        {.index = parameter_index(model, "Tz2"), .estimated = 0.5, .truth = 0.625, .truth_in_gauge = 0.5004},
        {.index = parameter_index(model, "dq1"),
         .estimated = 0.25 * kDegree,
         .truth = 0.5 * kDegree,
         .truth_in_gauge = 7.0 * kDegree,
         .gauge = true}};
    comparison.base_difference << 1e-4, -2e-4, 3e-4, 0.1 * kDegree, 0.2 * kDegree, -0.3 * kDegree;
    comparison.largest_length = 7e-4;
    comparison.largest_angle = 0.5 * kDegree;
  }
};

TEST(TruthReport, TheTruthStandsBesideTheEstimateInTheTable) {
  const ValidationTask c;
  expect_lines(
      cli::truth_table(c.model, c.estimate, c.comparison),
      {"estimated true true in gauge difference", "dq2 joint_2 deg 1.000000 2.500000 1.250000 -2.50e-01",
       "Tz2 joint_3 mm 500.000000 625.000000 500.400000 -4.00e-01", "dq1 joint_1 deg 0.250000 0.500000 7.000000 gauge",
       "differences along x, y and z", "base, position mm 1.00e-01 -2.00e-01 3.00e-01",
       "base, orientation deg 1.00e-01 2.00e-01 -3.00e-01", "target A mm -2.00e+01 -3.00e+01 -4.00e+01",
       "target B mm -5.00e+01 -7.00e+01 -8.00e+01", "largest difference up to the gauge: 7.00e-01 mm and 5.00e-01 deg"},
      "truth");
}

TEST(TruthReport, TheTruthStandsBesideTheEstimateInTheJson) {
  const ValidationTask c;
  const Json json = cli::truth_json(c.model, c.estimate, c.truth, c.comparison);
  ASSERT_EQ(json["parameters"].size(), 3U);
  Json length = json["parameters"][1];
  EXPECT_NEAR(length["difference"], -4e-4, 1e-15);
  length.erase("difference");
  EXPECT_EQ(length, Json::parse(R"({"name": "Tz2", "joint": "joint_3", "kind": "translation", "axis": "z",
      "nominal": 1.075, "estimated": 0.5, "true": 0.625, "true_in_gauge": 0.5004, "gauge": false})"));
  EXPECT_TRUE(json["parameters"][2]["difference"].is_null()) << "of the gauge";
  EXPECT_EQ(json["base"]["estimated"]["position"], (Json{1.0, 2.0, 3.0}));
  EXPECT_EQ(json["base"]["true"]["position"], (Json{4.0, 5.0, 6.0}));
  EXPECT_EQ(json["base"]["true_in_gauge"]["position"], (Json{1.5, 2.5, 3.5}));
  EXPECT_EQ(json["base"]["difference"][1], -2e-4);
  ASSERT_EQ(json["targets"].size(), 2U);
  EXPECT_EQ(json["targets"][1]["name"], "B");
  EXPECT_EQ(json["targets"][1]["estimated"], (Json{0.4, 0.5, 0.6}));
  EXPECT_EQ(json["targets"][1]["true"], (Json{0.44, 0.55, 0.66})) << "found by its name";
  EXPECT_NEAR(json["targets"][1]["difference"][1], -0.07, 1e-15);
  EXPECT_EQ(json["largest_difference"]["length"], 7e-4);
  EXPECT_EQ(json["comparable"], true);
}

TEST(TruthReport, TheRoundsOfTheTwoStepProcedureAreListed) {
  TwoStepTrialResult result;
  result.identification.termination = Termination::iteration_limit;
  result.identification.message = "still moving";
  result.floor = 3e-5;
  for (const int number : {1, 2}) {
    const double factor = number == 1 ? 1.0 : 0.5;
    result.rounds.push_back({.round = {.number = number, .change = 1e-3 * factor, .misfit = 2e-3 * factor},
                             .held_out = {.count = 7, .rms = 3e-3 * factor, .max = 4e-3 * factor}});
  }
  std::vector<std::string> lines = {"round change [mm] misfit [mm] held out, rms max [mm]",
                                    "1 1.0000e+00 2.0000e+00 3.0000e+00 4.0000e+00",
                                    "2 5.0000e-01 1.0000e+00 1.5000e+00 2.0000e+00", "iteration_limit: still moving"};
  expect_lines(cli::rounds_table(result), lines, "rounds");
  EXPECT_TRUE(cli::rounds_json(result)["convergence_factor"].is_null());
  EXPECT_EQ(cli::rounds_json(result)["settled"], false);
  EXPECT_EQ(cli::rounds_json(result)["rounds"][1]["misfit"], 1e-3);
  result.settled = true;
  result.factor = 0.65;
  lines.emplace_back("the last change is what noise alone causes, 3.00e-02 mm a round");
  lines.emplace_back("each round left 0.650 of the change of the round before");
  expect_lines(cli::rounds_table(result), lines, "settled");
  EXPECT_EQ(cli::rounds_json(result)["convergence_factor"], 0.65);
}

}  // namespace
}  // namespace kdl_calibration::testing::truth_report_test
