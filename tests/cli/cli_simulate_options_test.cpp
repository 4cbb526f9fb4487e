// Each option of simulate changes what it should and nothing else; see cli_options_support.hpp.

#include <Eigen/Geometry>

#include "cli_options_support.hpp"
#include "kdl_calibration/drive_signals.hpp"
#include "kdl_calibration/measurements_file.hpp"
#include "kdl_calibration/measuring_plan.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/result_json.hpp"
#include "kdl_calibration/two_step_trial.hpp"
#include "report_page_support.hpp"

namespace kdl_calibration::testing::cli_simulate_options_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::UnorderedElementsAre;

Measurements rows_of(const Answer& answer) {
  return parse_measurements(answer.files.at("m.csv"), joint_names(fanuc()));
}

/// The truth differs in just these places; what was measured is checked by `then`.
Check truth_changes(const std::vector<std::string>& places, const Check& then) {
  return [=](const Effect& effect) {
    EXPECT_EQ(effect.with.outcome.status, 0) << effect.with.outcome.err;
    EXPECT_THAT(differences(effect.without.file("t.json"), effect.with.file("t.json")),
                ::testing::UnorderedElementsAreArray(places));
    then(effect);
  };
}

/// The same joint values, and coordinates that differ by normal numbers of this sigma.
Check scatters(double sigma) {
  return [=](const Effect& effect) {
    const Measurements without = rows_of(effect.without);
    const Measurements with = rows_of(effect.with);
    EXPECT_EQ(with.joint_values, without.joint_values);
    ASSERT_EQ(with.observations.size(), without.observations.size());
    double sum = 0.0;
    for (std::size_t i = 0; i < with.observations.size(); ++i) {
      sum += (with.observations[i].position - without.observations[i].position).squaredNorm() / 3.0;
    }
    const double found = std::sqrt(sum / static_cast<double>(with.observations.size()));
    EXPECT_NEAR(found, sigma, 0.25 * sigma);  // 108 numbers: four times the 1 sigma of their scatter
  };
}

double largest_shift(const Effect& effect) {
  const Measurements without = rows_of(effect.without);
  const Measurements with = rows_of(effect.with);
  double largest = 0.0;
  for (std::size_t i = 0; i < with.observations.size(); ++i) {
    largest = std::max(largest, (with.observations[i].position - without.observations.at(i).position).norm());
  }
  return largest;
}

/// The errors of these kinds are `factor` times what they were, the others as they were.
Check errors_grow(bool lengths, double factor) {
  return [=](const Effect& effect) {
    const Json without = effect.without.file("t.json")["parameters"];
    const Json with = effect.with.file("t.json")["parameters"];
    ASSERT_EQ(with.size(), 20U);
    for (std::size_t p = 0; p < with.size(); ++p) {
      const bool of_them = (with[p]["kind"] == "translation") == lengths;
      const double expected = without[p]["error"].get<double>() * (of_them ? factor : 1.0);
      EXPECT_NEAR(with[p]["error"], expected, 1e-15) << with[p];
    }
  };
}

Check has_configurations(const std::string& key, int count, std::size_t rows) {
  return [=](const Effect& effect) {
    EXPECT_EQ(effect.with.file("t.json")[key], count);
    EXPECT_EQ(rows_of(effect.with).observations.size(), rows);
  };
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> draw_options() {
  return {
      {"NoiseIsOfEveryCoordinate", {"--noise", "1e-4"}, truth_changes({"noise"}, scatters(1e-4))},
      {"OrientationNoiseIsOfOrientationsAlone",
       {"--orientation-noise", "1e-3"},
       truth_changes({"orientation_noise"},
                     [](const Effect& effect) {
                       const Measurements without = rows_of(effect.without);
                       const Measurements with = rows_of(effect.with);
                       ASSERT_EQ(with.orientations.size(), 36U);
                       double sum = 0.0;
                       for (std::size_t i = 0; i < 36; ++i) {
                         EXPECT_EQ(with.observations[i].position, without.observations[i].position);
                         const double angle = with.orientations[i].angularDistance(without.orientations[i]);
                         sum += angle * angle / 3.0;
                       }
                       EXPECT_NEAR(std::sqrt(sum / 36.0), 1e-3, 0.25e-3);
                     }),
       {"--poses"}},
      {"LengthSigmaIsOfLengths",
       {"--length-sigma", "0.005"},
       truth_changes({"parameters/*/error", "parameters/*/value"}, errors_grow(true, 2.0))},
      {"AngleSigmaIsOfAngles",
       {"--angle-sigma", "0.01"},
       truth_changes({"parameters/*/error", "parameters/*/value"}, errors_grow(false, 0.01 / (3.0 * kDegree)))},
      {"AngleSigmaInDegreesIsOfAngles",
       {"--angle-sigma-deg", "1.5"},
       truth_changes({"parameters/*/error", "parameters/*/value"}, errors_grow(false, 0.5))},
      {"BaseSigmaIsOfTheBase",
       {"--base-sigma", "0.004"},
       truth_changes({"base/position/*"},
                     [](const Effect& effect) {
                       for (std::size_t i = 0; i < 3; ++i) {
                         EXPECT_NEAR(effect.with.file("t.json")["base"]["position"][i].get<double>(),
                                     2.0 * effect.without.file("t.json")["base"]["position"][i].get<double>(), 1e-15);
                       }
                     })},
      {"TargetSigmaIsOfTheLengthOfTools",
       {"--target-sigma", "0.005"},
       truth_changes({"targets/*/position/*"},
                     [](const Effect& effect) {
                       const auto length = [](const Answer& answer, std::size_t t) {
                         const Json p = answer.file("t.json")["targets"][t]["position"];
                         return Eigen::Vector3d(p[0], p[1], p[2]).norm();
                       };
                       for (std::size_t t = 0; t < 3; ++t) {
                         const double nominal = t < 2 ? 0.1 : std::hypot(0.0707, 0.0707);
                         EXPECT_NEAR(length(effect.with, t) - nominal, 2.0 * (length(effect.without, t) - nominal),
                                     1e-12);
                       }
                     })},
      {"ModelCompleteHasErrorsEverywhere",
       {"--model", "complete"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.file("t.json")["parameters"].size(), 20U);
         EXPECT_EQ(effect.with.file("t.json")["parameters"].size(), 30U);
       }},
      {"EffectsBendTheArm",
       {"--effects", "harmonics,gain"},
       truth_changes({"effects"},
                     [](const Effect& effect) {
                       const Json terms = effect.with.file("t.json")["effects"]["terms"];
                       EXPECT_EQ(terms.size(), 30U);
                       EXPECT_EQ(terms[0]["group"], "gain");
                       EXPECT_EQ(rows_of(effect.with).joint_values, rows_of(effect.without).joint_values);
                       EXPECT_GT(largest_shift(effect), 1e-4);
                       EXPECT_LT(largest_shift(effect), 2e-2);
                     })},
      {"OrderGivesBacklashADirection",
       {"--order"},
       truth_changes({"effects/terms"},
                     [](const Effect& effect) {
                       const Measurements with = rows_of(effect.with);
                       EXPECT_TRUE(rows_of(effect.without).order.empty());
                       ASSERT_EQ(with.order.size(), with.observations.size());
                       for (std::size_t i = 0; i < with.order.size(); ++i) {
                         EXPECT_EQ(with.order[i], static_cast<std::int64_t>(i) + 1);
                       }
                       const Json terms = effect.with.file("t.json")["effects"]["terms"];
                       EXPECT_EQ(terms.size(), effect.without.file("t.json")["effects"]["terms"].size() + 6);
                       EXPECT_EQ(terms[0]["name"], "backlash.1.approach");
                       EXPECT_EQ(with.joint_values, rows_of(effect.without).joint_values);
                     }),
       {"--effects", "backlash"}},
      {"EffectSigmaIsOfTheirCoefficients",
       {"--effect-sigma", "6e-4"},
       truth_changes({"effects/terms/*/coefficient", "effects/terms/*/sigma"},
                     [](const Effect& effect) {
                       const Json with = effect.with.file("t.json")["effects"]["terms"];
                       const Json without = effect.without.file("t.json")["effects"]["terms"];
                       for (std::size_t i = 0; i < with.size(); ++i) {
                         EXPECT_EQ(with[i]["sigma"], 6e-4);
                         EXPECT_NEAR(with[i]["coefficient"], 2.0 * without[i]["coefficient"].get<double>(), 1e-15);
                       }
                     }),
       {"--effects", "backlash"}},
      {"SeedDrawsOthers",
       {"--seed", "2"},
       truth_changes({"seed", "base/position/*", "parameters/*/error", "parameters/*/value", "targets/*/position/*"},
                     [](const Effect& effect) {
                       EXPECT_NE(rows_of(effect.with).joint_values, rows_of(effect.without).joint_values);
                     })},
      {"SeedDrawsOtherRobotsInMonteCarlo",
       {"--seed", "2"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.json["runs"], 2);
         EXPECT_NE(effect.with.json["held_out_error"]["all"]["rms"],
                   effect.without.json["held_out_error"]["all"]["rms"]);
         EXPECT_EQ(effect.with.json["held_out_error"]["all"]["count"],
                   effect.without.json["held_out_error"]["all"]["count"]);
       },
       {"--monte-carlo", "2", "--targets", "1", "--noise", "1e-5", "--threads", "1", "--json"}},
      {"ThreadsChangeNothing",
       {"--threads", "3"},
       changes_nothing(),
       {"--monte-carlo", "3", "--targets", "1", "--noise", "1e-5", "--json"}},
      {"MonteCarloStatesHeldOutErrors",
       {"--monte-carlo", "2"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.outcome.status, 2);  // --json alone
         EXPECT_EQ(effect.with.json["runs"], 2);
         EXPECT_EQ(effect.with.json["held_out_error"]["all"]["count"], 2 * 5 * 3);
         EXPECT_GT(effect.with.json["held_out_error"]["all"]["rms"], 1e-6);
         EXPECT_LT(effect.with.json["held_out_error"]["all"]["rms"], 1e-3);
       },
       {"--json", "--noise", "1e-5", "--test-configurations", "5", "--threads", "1"}},
  };
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> experiment_options() {
  return {
      {"ConfigurationsAreToFit",
       {"--configurations", "7"},
       truth_changes({"configurations"}, has_configurations("configurations", 7, 21))},
      {"TestConfigurationsAreMarkedSo",
       {"--test-configurations", "4"},
       truth_changes({"test_configurations"},
                     [](const Effect& effect) {
                       const Measurements with = rows_of(effect.with);
                       ASSERT_EQ(with.observations.size(), 36U + 12U);
                       for (std::size_t i = 0; i < 48; ++i) {
                         EXPECT_EQ(with.observations[i].split == Split::test, i >= 36) << i;
                       }
                       EXPECT_EQ(with.joint_values.leftCols(12), rows_of(effect.without).joint_values);
                     })},
      {"RepeatsAreRows", {"--repeats", "3"}, truth_changes({"repeats"}, has_configurations("repeats", 3, 108))},
      {"TargetsAreCounted",
       {"--targets", "5"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.file("t.json")["targets"].size(), 5U);
         EXPECT_EQ(rows_of(effect.with).observations.size(), 60U);
       }},
      {"TargetFileHasTheTargets",
       {"--target-file", "targets.json"},
       [](const Effect& effect) {
         const Json targets = effect.with.file("t.json")["targets"];
         ASSERT_EQ(targets.size(), 2U);
         EXPECT_EQ(targets[0]["name"], "P");
         EXPECT_EQ(targets[1]["name"], "Q");
         EXPECT_NEAR(targets[1]["position"][0].get<double>(), 0.3, 1e-15);
         EXPECT_NEAR(targets[1]["position"][2].get<double>(), -0.4, 1e-15);
       },
       {"--target-sigma", "0"}},
      {"PosesHaveOrientations",
       {"--poses"},
       [](const Effect& effect) {
         EXPECT_TRUE(rows_of(effect.without).orientations.empty());
         EXPECT_EQ(rows_of(effect.with).orientations.size(), 36U);
         EXPECT_EQ(rows_of(effect.with).joint_values.cols(), 12);
       }},
      {"PlanIsMeasured",
       {"--plan", "plan.csv"},
       [](const Effect& effect) {
         const Eigen::MatrixXd q = rows_of(effect.with).joint_values;
         ASSERT_EQ(q.cols(), 2);
         const Eigen::VectorXd second = Eigen::Matrix<double, 6, 1>(10.0, -20.0, 30.0, -40.0, 50.0, -60.0) * kDegree;
         EXPECT_LT((q.col(1) - second).cwiseAbs().maxCoeff(), 1e-15);
         EXPECT_EQ(effect.with.file("t.json")["configurations"], 2);
       }},
      {"JointConventionIsThatOfThePlan",
       {"--joint-convention", "coupled.json"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.outcome.status, 2);
         const Eigen::MatrixXd q = rows_of(effect.with).joint_values;
         // By hand: A6 ... A1 are 0.1 0.2 0.3 0.4 0.5 0.6.
         const Eigen::VectorXd expected = Eigen::Matrix<double, 6, 1>(0.6 + 0.1, -0.5 - 0.2, 0.4 + 0.5 + 0.3,
                                                                      -0.3 - 0.4, 0.2 + 0.15 + 0.5, -0.2 - 0.6);
         EXPECT_LT((q.col(0) - expected).cwiseAbs().maxCoeff(), 1e-15) << q.transpose();
       },
       {"--plan", "controller.csv"}},
      {"JointRangesAreDrawnFrom",
       {"--joint-ranges", "10:20,-5:5,1:2,3:4,-8:-7,90:100"},
       truth_changes({"joint_ranges/*/lower", "joint_ranges/*/upper"},
                     [](const Effect& effect) {
                       const Eigen::MatrixXd q = rows_of(effect.with).joint_values / kDegree;
                       const std::vector<std::pair<double, double>> expected = {{10, 20}, {-5, 5},  {1, 2},
                                                                                {3, 4},   {-8, -7}, {90, 100}};
                       for (std::size_t i = 0; i < 6; ++i) {
                         EXPECT_GE(q.row(static_cast<Eigen::Index>(i)).minCoeff(), expected[i].first);
                         EXPECT_LE(q.row(static_cast<Eigen::Index>(i)).maxCoeff(), expected[i].second);
                         EXPECT_NEAR(effect.with.file("t.json")["joint_ranges"][i]["lower"].get<double>(),
                                     expected[i].first * kDegree, 1e-15);
                       }
                     })},
      {"JointRangesOfASlideAreInMillimetres",
       {"--joint-ranges", "0:90,-100:250,0:0,0:1,0:1"},
       truth_changes({"joint_ranges/*/lower", "joint_ranges/*/upper"},
                     [](const Effect& effect) {
                       const Json ranges = effect.with.file("t.json")["joint_ranges"];
                       EXPECT_EQ(ranges[1]["joint"], "slide");
                       EXPECT_NEAR(ranges[1]["lower"], -0.1, 1e-15);
                       EXPECT_NEAR(ranges[1]["upper"], 0.25, 1e-15);
                       const Robot odd = parse_robot(kOddArm);
                       const Measurements with = parse_measurements(effect.with.files.at("m.csv"), joint_names(odd));
                       EXPECT_GE(with.joint_values.row(1).minCoeff(), -0.1);
                       EXPECT_LE(with.joint_values.row(1).maxCoeff(), 0.25);
                       EXPECT_GT(with.joint_values.row(1).maxCoeff(), 0.1);
                     }),
       {"--urdf", "odd.urdf"}},
  };
}

std::vector<OptionCase> simulate_file_options() {
  return {
      {"UrdfIsTheRobot",
       {"--urdf", "odd.urdf"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.file("t.json")["urdf"], "odd.urdf");
         EXPECT_THAT(effect.with.files.at("m.csv"), HasSubstr("slide"));
       }},
      {"BaseIsTheFirstLink",
       {"--base", "a"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.file("t.json")["base_link"], "a");
         EXPECT_THAT(effect.without.files.at("m.csv"), HasSubstr("turn"));
         EXPECT_THAT(effect.with.files.at("m.csv"), Not(HasSubstr("turn")));
       },
       {"--urdf", "odd.urdf"}},
      {"TipIsTheLastLink",
       {"--tip", "d"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.file("t.json")["tip_link"], "d");
         EXPECT_THAT(effect.without.files.at("m.csv"), HasSubstr("wrist"));
         EXPECT_THAT(effect.with.files.at("m.csv"), Not(HasSubstr("wrist")));
       },
       {"--urdf", "odd.urdf"}},
      {"TruthIsWritten",
       {"--truth", "other.json"},
       [](const Effect& effect) {
         ASSERT_EQ(effect.without.files.size(), 1U);
         ASSERT_EQ(effect.with.files.size(), 2U);
         EXPECT_EQ(effect.with.file("other.json")["seed"], 1);
         EXPECT_EQ(effect.with.files.at("m.csv"), effect.without.files.at("m.csv"));
         EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
       },
       {"--output", "m.csv"}},
      {"OutputHasTheMeasurementsInsteadOfStandardOutput",
       {"--output", "other.csv"},
       [](const Effect& effect) {
         EXPECT_TRUE(effect.without.files.empty());
         EXPECT_EQ(effect.with.files.at("other.csv"), effect.without.outcome.out);
         EXPECT_THAT(effect.with.outcome.out, HasSubstr("12 configurations"));
       }},
      {"ForceOverwrites",
       {"--force"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.outcome.status, 2);
         EXPECT_TRUE(effect.without.files.empty());
         EXPECT_THAT(effect.with.files.at("old.csv"), HasSubstr("configuration,"));
       },
       {"--output", "old.csv"}},
      {"JsonPrintsTheTruth",
       {"--json"},
       [](const Effect& effect) {
         EXPECT_TRUE(effect.with.files == effect.without.files);
         EXPECT_EQ(effect.with.outcome.out, effect.with.files.at("t.json"));
         EXPECT_TRUE(effect.without.json.is_null());
       },
       {"--output", "m.csv", "--truth", "t.json"}},
  };
}

/// The published procedure instead of measurements to write.
std::vector<OptionCase> procedure_options() {
  return {{"TwoStepRunsTheProcedureForSoManyRounds",
           {"--two-step", "3"},
           [](const Effect& effect) {
             EXPECT_FALSE(effect.without.json.contains("rounds"));
             ASSERT_EQ(effect.with.json["rounds"].size(), 3U);
             EXPECT_EQ(effect.with.json["recorded"], false);
             EXPECT_EQ(effect.with.outcome.status, 1) << "three rounds do not arrive";
           },
           {"--json"}},
          {"RecordedMeasuresTheSameConfigurationsInEveryRound",
           {"--recorded"},
           [](const Effect& effect) {
             const Json& fresh = effect.without.json["rounds"];
             const Json& recorded = effect.with.json["rounds"];
             EXPECT_EQ(effect.with.json["recorded"], true);
             EXPECT_EQ(recorded[0]["misfit"], fresh[0]["misfit"]);
             EXPECT_NE(recorded[1]["misfit"], fresh[1]["misfit"]);
           },
           {"--json", "--two-step", "3"}},
          {"ReportShowsTheRounds",
           {"--report", "t.html"},
           [](const Effect& effect) {
             EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
             EXPECT_EQ(data_of_page(effect.with.files.at("t.html"))["result"], effect.with.json);
           },
           {"--json", "--two-step", "3"}}};
}

std::vector<OptionCase> simulate_options() {
  std::vector<OptionCase> rows = draw_options();
  for (const auto& more : {experiment_options(), simulate_file_options(), procedure_options()}) {
    rows.insert(rows.end(), more.begin(), more.end());
  }
  return rows;
}

class SimulateOption : public OptionEffect {};

TEST_P(SimulateOption, HasItsEffectAndNoOther) {
  write("odd.urdf", kOddArm);
  write("old.csv", "old");
  write("coupled.json", kFanucCoupled);
  write("targets.json", R"({"targets": [{"name": "P", "position": [0, 0.2, 0]},
    {"name": "Q", "position": [0.3, 0, -0.4]}]})");
  write("plan.csv",
        "joint_1[deg],joint_2[deg],joint_3[deg],joint_4[deg],joint_5[deg],joint_6[deg]\n0,0,0,0,0,0\n"
        "10,-20,30,-40,50,-60\n");
  write("controller.csv", "A1,A2,A3,A4,A5,A6\n0.6,0.5,0.4,0.3,0.2,0.1\n");
  const std::string& option = GetParam().option.front();
  const Words& base = GetParam().base;
  const auto given = [&](const std::string& word) {
    return option == word || std::find(base.begin(), base.end(), word) != base.end();
  };
  Words command = {"simulate"};
  command = option == "--configurations" ? command : command + Words{"--configurations", "12"};
  const bool files = !given("--output") && !given("--truth") && !given("--monte-carlo") && !given("--two-step");
  check_effect(files ? command + Words{"--output", "m.csv", "--truth", "t.json"} : command, GetParam());
}
INSTANTIATE_TEST_SUITE_P(Options, SimulateOption, ::testing::ValuesIn(simulate_options()), behaviour_of);

// ---- Against the library -------------------------------------------------------------------------------------------

class SimulatedByTheLibrary : public CommandLine {
protected:
  void expect_parameters(const Json& parameters, const std::vector<std::size_t>& with_errors,
                         const Eigen::VectorXd& errors, const Reduction& reduction) const {
    std::set<std::string> gauges;
    for (const GaugeParameter& gauge : reduction.gauge) {
      gauges.insert(gauge.name);
    }
    ASSERT_EQ(parameters.size(), with_errors.size());
    for (std::size_t i = 0; i < with_errors.size(); ++i) {
      const ErrorParameter& parameter = model.parameters[with_errors[i]];
      const double error = errors[static_cast<Eigen::Index>(with_errors[i])];
      EXPECT_EQ(parameters[i], (Json{{"name", parameter.name},
                                     {"joint", parameter.joint},
                                     {"kind", to_string(parameter.kind)},
                                     {"axis", std::string(1, parameter.axis)},
                                     {"nominal", parameter.nominal},
                                     {"value", parameter.nominal + error},
                                     {"error", error},
                                     {"gauge", gauges.count(parameter.name) > 0}}));
    }
  }

  ErrorModel model = complete_model(fanuc());
  std::vector<TargetFrame> targets = published_targets(2);
  Eigen::MatrixXd draw(int count, Random& random) const {
    return random_configurations(model.joints, limits_of(model.joints), count, random);
  }
};

TEST_F(SimulatedByTheLibrary, IsTheSameRobotWithTheSameMeasurements) {
  ASSERT_EQ(run({"simulate",    "--urdf",
                 kFanuc,        "--configurations",
                 "6",           "--test-configurations",
                 "3",           "--targets",
                 "2",           "--repeats",
                 "2",           "--noise",
                 "2e-5",        "--poses",
                 "--order",     "--orientation-noise",
                 "1e-4",        "--effects",
                 "torque,gain", "--effect-sigma",
                 "4e-4",        "--seed",
                 "9",           "--output",
                 "m.csv",       "--truth",
                 "t.json"})
                .status,
            0);
  targets = as_frames(targets);
  const Reduction reduction = reduced_model(model, targets);
  const std::vector<std::size_t> with_errors = with_true_errors(model, reduction, false);
  const ToldByDrives told{.approach = true, .torques = true, .seed = 9};
  const MeasuringNoise noise{.sigma = 2e-5, .orientation_sigma = 1e-4, .repeats = 2};
  Random random(9);
  VirtualRobot robot = virtual_robot(model, with_errors, targets, {}, random);
  Random of_effects(9, 1);
  const DrivenConfigurations some = driven_to(model, draw(500, of_effects), {}, told);
  add_effects(robot, {EffectGroup::gain, EffectGroup::torque}, some, 4e-4, of_effects);
  const Eigen::MatrixXd train = draw(6, random);
  Measurements measured = measure(robot, driven_to(model, train, {}, told), noise, random);
  const Eigen::MatrixXd test = draw(3, random);
  measured = joined(measured, measure(robot, driven_to(model, test, train, told), noise, random, Split::test));
  for (std::size_t row = 0; row < measured.observations.size(); ++row) {
    measured.order.push_back(static_cast<std::int64_t>(row) + 1);
  }
  EXPECT_TRUE(text_of("m.csv") == measurements_csv(measured)) << text_of("m.csv");

  const Json truth = json_of("t.json");
  EXPECT_EQ(truth["effects"], Json::parse(effects_json(robot.model, robot.truth.effects)));
  EXPECT_EQ(truth["targets"].size(), 2U);
  EXPECT_EQ(truth["targets"][1]["quaternion_wxyz"].size(), 4U);
  EXPECT_EQ(truth["urdf"], kFanuc);
  EXPECT_EQ(truth["base_link"], "base_link");
  EXPECT_EQ(truth["tip_link"], "flange");
  EXPECT_EQ(truth["orientation_noise"], 1e-4);
  expect_parameters(truth["parameters"], with_errors, robot.truth.errors, reduction);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(
        truth["joint_ranges"][i],
        (Json{{"joint", model.joints[i].name}, {"lower", *model.joints[i].lower}, {"upper", *model.joints[i].upper}}));
  }
}

TEST_F(SimulatedByTheLibrary, TakesTheSameRoundsOfTheTwoStepProcedure) {
  const Words command = {"simulate", "--targets", "2", "--noise",        "2e-5",  "--test-configurations",
                         "15",       "--seed",    "3", "--length-sigma", "0.001", "--angle-sigma",
                         "0.002"};
  const Outcome outcome = run(command + Words{"--configurations", "20", "--two-step", "3", "--json"});
  const Json found = Json::parse(outcome.out);
  Random random(3);
  Random elsewhere(3, 1);
  TwoStepTrial trial{.configurations = [this](Random& numbers) { return draw(20, numbers); },
                     .noise = {.sigma = 2e-5},
                     .rounds = 3,
                     .held_out = draw(15, elsewhere)};
  trial.robot = virtual_robot(model, with_true_errors(model, reduced_model(model, targets), false), targets,
                              {.length = 0.001, .angle = 0.002}, random);
  const TwoStepTrialResult expected = run_two_step_trial(trial, random);
  EXPECT_EQ(outcome.status, 1) << "three rounds do not settle";
  EXPECT_EQ(found["seed"], 3);
  ASSERT_EQ(found["rounds"].size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(found["rounds"][i]["change"], expected.rounds[i].round.change);
    EXPECT_EQ(found["rounds"][i]["misfit"], expected.rounds[i].round.misfit);
    EXPECT_EQ(found["rounds"][i]["held_out"]["rms"], expected.rounds[i].held_out.rms);
  }
  EXPECT_EQ(found["largest_difference"]["length"], expected.truth.largest_length);
  const auto heading = [&](const Words& more) {
    const std::string text = run(command + Words{"--two-step", "1"} + more).out;
    return text.substr(0, text.find('\n'));
  };
  const std::string procedure = "the two-step procedure against a virtual robot: in every round ";
  const std::string rest = ", 2 targets, noise 0.0200 mm; held out 15 configurations; seed 3";
  EXPECT_EQ(heading({"--configurations", "20"}), procedure + "20 fresh configurations" + rest);
  EXPECT_EQ(heading({"--configurations", "20", "--recorded"}), procedure + "the same 20 configurations" + rest);
  std::string plan = "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n";
  const Eigen::MatrixXd planned = draw(8, random);
  for (const auto& q : planned.colwise()) {
    for (Eigen::Index i = 0; i < 6; ++i) {
      plan += Json(q[i]).dump() + (i < 5 ? "," : "\n");
    }
  }
  write("plan.csv", plan);
  EXPECT_EQ(heading({"--plan", "plan.csv"}), procedure + "8 fresh configurations" + rest);
}

TEST_F(OptionsOfKdlcal, OfSimulateAreAllTested) { expect_a_test_of_every_option("simulate", simulate_options()); }

}  // namespace
}  // namespace kdl_calibration::testing::cli_simulate_options_test
