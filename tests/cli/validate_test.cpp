// kdlcal validate: each option changes what it should and nothing else (see cli_options_support.hpp), and what it
// prints.

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <initializer_list>

#include "cli_options_support.hpp"
#include "json_support.hpp"
#include "kdl_calibration/measurements.hpp"
#include "printed_text.hpp"
#include "report_page_support.hpp"

namespace kdl_calibration::testing::validate_test {
namespace {

using ::testing::HasSubstr;

/// Distances of all rows of m.csv from KDL's prediction with the base and the targets of this answer.
Eigen::VectorXd distances_by_kdl(const Json& answer, const std::filesystem::path& directory) {
  const Robot robot = load_robot(kFanuc);
  const Measurements measurements = read_measurements(directory / "m.csv", joint_names(robot));
  const Estimate stated = estimate_in(complete_model(robot), answer);
  Eigen::VectorXd distances(static_cast<Eigen::Index>(measurements.observations.size()));
  for (Eigen::Index row = 0; row < distances.size(); ++row) {
    const Observation& o = measurements.observations[static_cast<std::size_t>(row)];
    const Eigen::VectorXd q = measurements.joint_values.col(o.configuration);
    distances[row] = (o.position() - kdl_point(robot.chain, stated, q, o.target)).norm();
  }
  return distances;
}

/// Mean, RMS and largest error are those of the base and the targets that the answer states.
Check is_consistent() {
  return [](const Effect& effect) {
    EXPECT_NE(effect.with.outcome.out, effect.without.outcome.out);
    const Eigen::VectorXd distances = distances_by_kdl(effect.with.json, effect.directory);
    const Json& all = effect.with.json["position_error"]["all"];
    EXPECT_EQ(all["count"], distances.size());
    EXPECT_NEAR(all["mean"], distances.mean(), 1e-12);
    EXPECT_NEAR(all["rms"], distances.norm() / std::sqrt(static_cast<double>(distances.size())), 1e-12);
    EXPECT_NEAR(all["max"], distances.maxCoeff(), 1e-12);
  };
}

Check holds(const std::function<void(const Json& answer)>& known) {
  return all_checks(is_consistent(), [=](const Effect& effect) {
    known(effect.with.json);
    EXPECT_GT(effect.with.json["position_error"]["train"]["rms"], effect.without.json["position_error"]["train"]["rms"])
        << "nothing is better than what is free";
  });
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> validate_options() {
  const auto rms = [](const Answer& run) { return run.json["position_error"]["train"]["rms"].get<double>(); };
  const auto position = [](const Json& frame) { return vector_of(frame["position"]); };
  const Words measured = {"--measurements", "m.csv"};
  std::vector<OptionCase> rows = {
      {"UrdfIsTheRobot",
       {"--urdf", "longer.urdf"},
       [rms](const Effect& effect) { EXPECT_GT(rms(effect.with), 10.0 * rms(effect.without)); }},
      {"DhIsTheRobot",
       {"--dh", "fanuc_dh.json"},
       [rms](const Effect& effect) { EXPECT_NEAR(rms(effect.with), rms(effect.without), 1e-12); }},
      {"BaseIsTheFirstLink",
       {"--base", "base_link"},
       [=](const Effect& effect) {
         EXPECT_NEAR(rms(effect.with), rms(effect.without), 1e-12);
         // The foot is 0.3 m below the base.
         EXPECT_NEAR((position(effect.with.json["base"]) - position(effect.without.json["base"])).norm(), 0.3, 1e-9);
         EXPECT_EQ(effect.with.json["targets"].size(), 3U);
       },
       measured + Words{"--urdf", "foot.urdf"}},
      {"TipIsTheLastLink",
       {"--tip", "flange"},
       [=](const Effect& effect) {
         EXPECT_NEAR(rms(effect.with), rms(effect.without), 1e-12);
         for (std::size_t t = 0; t < 3; ++t) {  // the hand is 0.2 m along the flange's y
           const Eigen::Vector3d moved =
               position(effect.with.json["targets"][t]) - position(effect.without.json["targets"][t]);
           EXPECT_LT((moved - Eigen::Vector3d(0.0, 0.2, 0.0)).norm(), 1e-9) << moved.transpose();
         }
       },
       measured + Words{"--urdf", "hand.urdf"}},
      {"MeasurementsAreRegistered", {"--measurements", "m.csv"}, is_consistent()},
      {"JointsFileHasTheJointValues", {"--joints-file", "joints.csv"}, is_needed(), {"--measurements", "points.csv"}},
      {"PointNamesTellConfigurationAndTarget",
       {"--point-names", "C{configuration}_{target}"},
       is_needed(),
       {"--measurements", "named.csv", "--joints-file", "joints.csv"}},
      {"OrientationSaysWhatThreeNumbersAre",
       {"--orientation", "fixed-xyz"},
       is_contradicted_without(),
       {"--measurements", "angles.csv"}},
      {"ExcludeLeavesAConfigurationAndAPointOut",
       {"--exclude", "2,3:B"},
       [](const Effect& effect) {
         const auto count = [](const Answer& run) { return run.json["position_error"]["train"]["count"].get<long>(); };
         EXPECT_EQ(count(effect.with), count(effect.without) - 4);
       }},
      {"JointConventionReadsTheControllersValues",
       {"--joint-convention", "coupled.json"},
       is_consistent(),
       {"--measurements", "controller.csv"}},
      {"KnownBaseIsHeld", {"--known-base", "known.json"}, holds([](const Json& answer) {
         EXPECT_EQ(answer["base"]["position"], (Json{2.001, 1.0, 0.502}));
         EXPECT_NEAR(answer["base"]["quaternion_wxyz"][3], 0.8, 1e-15);
       })},
      {"KnownTargetsAreHeldAndOthersFree", {"--known-targets", "known.json"}, holds([](const Json& answer) {
         EXPECT_EQ(answer["targets"][0]["position"], (Json{0.1, 0.001, 0.0}));
         EXPECT_EQ(answer["targets"][1]["position"], (Json{0.0, 0.0, 0.1}));
         EXPECT_NE(answer["targets"][2]["position"], (Json{0.0, 0.0, 0.0}));
       })},
      {"RequireDecidesTheStatus",
       {"--require", "train.rms<0"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
         EXPECT_EQ(effect.without.outcome.status, 0);
         EXPECT_EQ(effect.with.outcome.status, 1);
       }},
      {"JsonReplacesTheTable", {"--json"}, turns_the_table_into_json()},
      {"ReportShowsThePositionError",
       {"--report", "v.html"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
         const Json page = data_of_page(effect.with.files.at("v.html"));
         EXPECT_EQ(page["result"]["position_error"], effect.with.json["position_error"]);
       }},
      {"ForceReplacesAPage", {"--force"}, overwrites("old.html", "<!"), measured + Words{"--report", "old.html"}},
  };
  for (OptionCase& row : rows) {
    row.base = row.base.empty() && row.option != measured ? measured : row.base;
  }
  return rows;
}

std::vector<OptionCase> truth_options() {
  const Words both = {"--result", "result.json", "--truth", "truth.json"};
  // Found from noise of 20 µm on nominal geometry: off by about that.
  const Check compares = [](const Effect& effect) {
    EXPECT_EQ(effect.without.outcome.status, 2) << "one without the other";
    EXPECT_EQ(effect.with.json["comparable"], true);
    EXPECT_GT(at(effect.with.json, "/position_error/all/rms"), 5e-6);
    EXPECT_LT(at(effect.with.json, "/position_error/all/rms"), 5e-5);
  };
  return {{"ResultIsComparedWithTheTruth", {"--result", "result.json"}, compares, {"--truth", "truth.json"}},
          {"TruthIsWhatTheResultShouldBe", {"--truth", "truth.json"}, compares, {"--result", "result.json"}},
          {"SeedDrawsOtherConfigurations",
           {"--seed", "2"},
           all_checks(turns("/seed", 1, 2),
                      [](const Effect& effect) {
                        const double without = at(effect.without.json, "/position_error/all/rms");
                        const double with = at(effect.with.json, "/position_error/all/rms");
                        EXPECT_NE(with, without);
                        EXPECT_NEAR(with, without, 0.2 * without);
                      }),
           both}};
}

class TruthOption : public OptionEffect {};

TEST_P(TruthOption, HasItsEffectAndNoOther) {
  ASSERT_NO_FATAL_FAILURE(write_once("a result and its truth", [&] {
    succeed({"simulate", "--configurations", "12", "--noise", "2e-5", "--output", "m.csv", "--truth", "truth.json"});
    succeed({"calibrate", "--measurements", "m.csv", "--result", "result.json"});
  }));
  check_effect({"validate", "--json"}, GetParam());
}
INSTANTIATE_TEST_SUITE_P(Options, TruthOption, ::testing::ValuesIn(truth_options()), behaviour_of);

class ValidateOption : public OptionEffect {};

TEST_P(ValidateOption, HasItsEffectAndNoOther) {
  const Measurements measured = measured_fanuc({.sigma = 2e-5}, false);
  write("m.csv", measurements_csv(measured));
  write("joints.csv", joints_csv(measured));
  write("points.csv", points_csv(measured, false));
  write("named.csv", points_csv(measured, true));
  write("old.html", "old");
  write("controller.csv", in_controller_joints(measured, kFanucCoupled));
  write("angles.csv", angles_csv(measured_fanuc({.sigma = 2e-5, .orientation_sigma = 1e-4}, true)));
  write("coupled.json", kFanucCoupled);
  write("known.json", R"({"base": {"position": [2.001, 1.0, 0.502], "quaternion_wxyz": [0.6, 0, 0, 0.8]},
    "targets": [{"name": "A", "position": [0.1, 0.001, 0]}, {"name": "B", "position": [0, 0, 0.1]}]})");
  std::string text = content(kFanuc);
  write("longer.urdf", std::string(text).replace(text.rfind("0 0 1.075"), 9, "0 0 1.175"));
  write("fanuc_dh.json", dh_of(fanuc()));
  write("foot.urdf", with_foot(text));
  write("hand.urdf", with_hand(text));
  const bool json = GetParam().option.front() != "--json";
  check_effect(json ? Words{"validate", "--json"} : Words{"validate"}, GetParam());
}
INSTANTIATE_TEST_SUITE_P(Options, ValidateOption, ::testing::ValuesIn(validate_options()), behaviour_of);

TEST_F(OptionsOfKdlcal, OfValidateAreAllTested) {
  expect_a_test_of_every_option("validate", validate_options() + truth_options());
}

TEST_F(OptionsOfKdlcal, ValidateShowsEachStatisticInMillimetres) {
  write("m.csv", measurements_csv(measured_fanuc({.sigma = 2e-5}, false)));
  const Words command = {"validate", "--urdf", kFanuc, "--measurements", "m.csv"};
  const Json found = run_json(command + Words{"--json"});
  const auto numbers = [](std::initializer_list<double> values) {
    std::string text;
    for (const double value : values) {
      text += " " + decimals(value * 1e3, 3);
    }
    return text;
  };
  const auto row = [&](const std::string& label) {
    const Json& s = found["position_error"][label];
    return label + numbers({s["rms"], s["mean"], s["p95"], s["max"]}) + " " + s["count"].dump();
  };
  const auto place = [&](const std::string& label, const Json& frame) {
    const Json& p = frame["position"];
    return label + numbers({p[0], p[1], p[2]});
  };
  const std::string table = run(command).out;
  expect_lines(table,
               {"position error of " + kFanuc + ", base and targets registered to the train rows",
                "rows [mm] rms mean p95 max points", row("all"), row("train"), row("test"),
                "base and targets took 15 of 108 coordinates: corrected rms " +
                    decimals(found["rms_corrected"].get<double>() * 1e3, 3) + " mm",
                "true errors are with 95 % at most 1.49 times as large", place("base, measured [mm]", found["base"]),
                place("target A", found["targets"][0]), place("target B", found["targets"][1]),
                place("target C", found["targets"][2])},
               "validate");
  const std::vector<std::string> lines = testing::lines_of(table);
  for (std::size_t i = 2; i < 5; ++i) {
    EXPECT_EQ(word_ends(lines[i], 5), word_ends(lines[1], 5)) << table;
  }
  // Of 36 points base and targets took 6 and 3 x 3 coordinates.
  EXPECT_EQ(found["degrees_of_freedom"], 93);
  EXPECT_NEAR(found["rms_corrected"].get<double>(),
              found["position_error"]["train"]["rms"].get<double>() * std::sqrt(108.0 / 93.0), 1e-12);
  // Of 12 configurations 36 coordinates, of which base and tool take 9: the lower 5 % quantile of chi-squared with 27
  // degrees of freedom is 16.151 (a table).
  const double limit = found["position_error"]["train"]["rms_upper_95"].get<double>();
  EXPECT_NEAR(limit, found["position_error"]["train"]["rms"].get<double>() * std::sqrt(36.0 / 16.151), 1e-4 * limit);
  EXPECT_EQ(run(command + Words{"--require", "train.rms<=" + std::to_string(limit * 1.001e3) + "mm"}).status, 0);
  const Outcome missed = run(command + Words{"--require", "train.rms<=" + std::to_string(limit * 0.999e3) + "mm"});
  EXPECT_EQ(missed.status, 1);
  EXPECT_THAT(missed.out, HasSubstr("NOT met"));
}

TEST_F(OptionsOfKdlcal, ValidateComparesTheArmsThatTouchedAPlateAtSeveralPlaces) {
  write("sockets.json", R"({"targets": [{"name": "1", "position": [0, 0, 0]},
                                        {"name": "2", "position": [0.4, 0, 0]}]})");
  const Words touches = words_of(
      "simulate --configurations 40 --targets 1 --stations 4 --sockets sockets.json --noise 3e-5 --output m.csv "
      "--truth t.json");
  succeed(touches);
  const Outcome found = run({"calibrate", "--measurements", "m.csv", "--result", "r.json"});
  EXPECT_EQ(found.status, 0) << found.err;
  EXPECT_THAT(found.err, HasSubstr("held as registered: base[P1]."));
  // The offset of joint 1 turns the base, but not one place beside another.
  std::array<Eigen::Vector3d, 2> true_places;
  std::array<Eigen::Vector3d, 2> places;
  for (std::size_t i = 0; i < 2; ++i) {
    true_places[i] = placed_as(json_of("t.json")["stations"][i]).inverse().translation();
    places[i] = vector_of(json_of("r.json")["stations"][i]["origin_in_base"]);
  }
  EXPECT_NEAR((places[1] - places[0]).norm(), (true_places[1] - true_places[0]).norm(), 1e-3);
  const Outcome compared = run({"validate", "--result", "r.json", "--truth", "t.json", "--json"});
  EXPECT_EQ(compared.status, 0) << compared.err;
  EXPECT_LT(Json::parse(compared.out)["position_error"]["all"]["rms"], 4e-4);
  expect_refused({"plan", "--result", "r.json", "--add", "5"}, {"--result", "without a column station"});
  for (const Words& more : {Words{"--poses"}, Words{"--repeats", "2"}, Words{"--test-configurations", "2"}}) {
    expect_refused(touches + more, {"--sockets", "expected none of"});
  }
}

}  // namespace
}  // namespace kdl_calibration::testing::validate_test
