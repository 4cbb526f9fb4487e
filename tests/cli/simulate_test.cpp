// kdlcal simulate: each option changes what it should and nothing else (see cli_options_support.hpp).

#include <algorithm>
#include <string>
#include <vector>

#include "cli_options_support.hpp"
#include "json_support.hpp"
#include "kdl_calibration/measurements.hpp"
#include "measurements/readings.hpp"
#include "planning/measuring_plan.hpp"
#include "printed_text.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::simulate_test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

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
      sum += (with.observations[i].position() - without.observations[i].position()).squaredNorm() / 3.0;
    }
    const double found = std::sqrt(sum / static_cast<double>(with.observations.size()));
    EXPECT_NEAR(found, sigma, 0.25 * sigma);  // 108 numbers: four times the 1 sigma of their scatter
  };
}

/// The same points, and orientations that differ by turns of this sigma about each axis.
Check turns_orientations(double sigma) {
  return [=](const Effect& effect) {
    const Measurements without = rows_of(effect.without);
    const Measurements with = rows_of(effect.with);
    ASSERT_EQ(with.observations.size(), 36U);
    double sum = 0.0;
    for (std::size_t i = 0; i < 36; ++i) {
      const Observation& one = with.observations[i];
      const Observation& other = without.observations[i];
      EXPECT_EQ(one.position(), other.position());
      sum += std::pow(testing::orientation_of(one).angularDistance(testing::orientation_of(other)), 2) / 3.0;
    }
    EXPECT_NEAR(std::sqrt(sum / 36.0), sigma, 0.25 * sigma);
  };
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

/// The numbers of the truth in this list are `factor` times what they were.
Check grows(const Json::json_pointer& list, const std::string& key, double factor) {
  return [=](const Effect& effect) {
    const Json without = effect.without.file("t.json")[list];
    const Json with = effect.with.file("t.json")[list];
    for (std::size_t i = 0; i < with.size(); ++i) {
      const auto number = [&](const Json& entry) { return (entry.is_object() ? entry[key] : entry).get<double>(); };
      EXPECT_NEAR(number(with[i]), factor * number(without[i]), 1e-15) << with[i];
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
       truth_changes({"orientation_noise"}, turns_orientations(1e-3)),
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
       truth_changes({"base/position/*"}, grows(Json::json_pointer("/base/position"), "", 2.0))},
      {"TargetSigmaIsOfTheLengthOfTools",
       {"--target-sigma", "0.005"},
       truth_changes({"targets/*/position/*"},
                     [](const Effect& effect) {
                       for (std::size_t t = 0; t < 3; ++t) {
                         const double nominal = t < 2 ? 0.1 : std::hypot(0.0707, 0.0707);
                         const auto error = [&](const Answer& answer) {
                           return vector_of(answer.file("t.json")["targets"][t]["position"]).norm() - nominal;
                         };
                         EXPECT_NEAR(error(effect.with), 2.0 * error(effect.without), 1e-12);
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
                       const Measurements without = rows_of(effect.without);
                       const Measurements with = rows_of(effect.with);
                       EXPECT_EQ(with.joint_values, without.joint_values);
                       double largest = 0.0;
                       for (std::size_t i = 0; i < with.observations.size(); ++i) {
                         const Observation& o = with.observations[i];
                         largest = std::max(largest, (o.position() - without.observations.at(i).position()).norm());
                       }
                       EXPECT_GT(largest, 1e-4);
                       EXPECT_LT(largest, 2e-2);
                     })},
      {"OrderGivesBacklashADirection",
       {"--order"},
       truth_changes({"effects/terms"},
                     [](const Effect& effect) {
                       const Measurements with = rows_of(effect.with);
                       EXPECT_TRUE(testing::order_of(rows_of(effect.without)).empty());
                       ASSERT_EQ(testing::order_of(with).size(), with.observations.size());
                       for (std::size_t i = 0; i < with.observations.size(); ++i) {
                         EXPECT_EQ(with.observations[i].order, static_cast<std::int64_t>(i) + 1);
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
                     all_checks(grows(Json::json_pointer("/effects/terms"), "coefficient", 2.0),
                                grows(Json::json_pointer("/effects/terms"), "sigma", 2.0))),
       {"--effects", "backlash"}},
      {"SeedDrawsOthers",
       {"--seed", "2"},
       truth_changes({"seed", "base/position/*", "parameters/*/error", "parameters/*/value", "targets/*/position/*"},
                     [](const Effect& effect) {
                       EXPECT_NE(rows_of(effect.with).joint_values, rows_of(effect.without).joint_values);
                     })},
      {"ThreadsChangeNothing",
       {"--threads", "3"},
       changes_nothing(),
       {"--monte-carlo", "3", "--targets", "1", "--noise", "1e-5", "--json"}},
      {"RunRangeIsAPartOfTheRuns",
       {"--run-range", "2:3"},
       [](const Effect& effect) {
         const std::string& whole = effect.without.files.at("runs.csv");
         const std::string& part = effect.with.files.at("runs.csv");
         EXPECT_EQ(effect.with.outcome.out.find("2 runs"), 0U);
         EXPECT_EQ(part.rfind("2,", 0), 0U);
         ASSERT_GT(whole.size(), part.size());
         EXPECT_EQ(whole.substr(whole.size() - part.size()), part);
         EXPECT_EQ(std::count(whole.begin(), whole.end(), '\n'), 4);
         EXPECT_EQ(whole.rfind("run,mean[m],rms[m],p95[m],max[m],trusted\n1,", 0), 0U);
       },
       {"--monte-carlo", "3", "--noise", "1e-5", "--runs", "runs.csv"}},
      {"RunsAreRowsOfAFile",
       {"--runs", "runs.csv"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
         const std::vector<Words> rows = cells_of(effect.with.files.at("runs.csv"));
         ASSERT_EQ(rows.size(), 3U);
         ASSERT_EQ(rows[0].at(4), "max[m]");
         EXPECT_EQ(std::max(std::stod(rows[1].at(4)), std::stod(rows[2].at(4))),
                   effect.with.json["held_out_error"]["all"]["max"]);
       },
       {"--monte-carlo", "2", "--noise", "1e-5", "--json"}},
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
const Words kPlate = {"--targets", "1", "--stations", "2", "--sockets", "sockets.json"};

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
         expect_near(targets, Json::parse(R"([{"name": "P", "position": [0, 0.2, 0]},
                                              {"name": "Q", "position": [0.3, 0, -0.4]}])"),
                     1e-15);
       },
       {"--target-sigma", "0"}},
      {"StationsShareTheConfigurations",
       {"--stations", "2"},
       [](const Effect& effect) {
         const Measurements without = rows_of(effect.without);
         const Measurements with = rows_of(effect.with);
         EXPECT_EQ(with.joint_values, without.joint_values);
         EXPECT_EQ(with.stations, (std::vector<std::string>{"S1", "S2"}));
         EXPECT_EQ(effect.with.file("t.json")["stations"].size(), 2U);
         for (std::size_t i = 0; i < 36; ++i) {
           EXPECT_EQ(with.observations[i].station, i < 18 ? 0 : 1);
           EXPECT_EQ(with.observations[i].position() == without.observations[i].position(), i < 18) << i;
         }
       }},
      {"SocketsAreTouchedInTurn",
       {"--sockets", "targets.json"},
       [](const Effect& effect) {
         const Measurements touches = rows_of(effect.with);
         ASSERT_EQ(touches.observations.size(), 12U);
         for (std::size_t i = 0; i < 12; ++i) {
           EXPECT_EQ(touches.observations[i].position(),
                     i % 2 == 0 ? Eigen::Vector3d(0.0, 0.2, 0.0) : Eigen::Vector3d(0.3, 0.0, -0.4));
         }
       },
       {"--targets", "1"}},
      {"PlateHorizontalLeavesATurnAboutTheVertical",
       {"--plate-horizontal"},
       [](const Effect& effect) {
         const auto level = [](const Json& base) {
           return std::hypot(base["quaternion_wxyz"][1].get<double>(), base["quaternion_wxyz"][2].get<double>());
         };
         EXPECT_LT(level(effect.with.file("t.json")["stations"][0]), 1e-9);
         EXPECT_GT(level(effect.without.file("t.json")["stations"][0]), 1e-3);
       },
       kPlate},
      {"PlateHeightsAreOfItsOrigin",
       {"--plate-heights", "1.5:1.6"},
       [](const Effect& effect) {
         const auto height = [](const Json& base) { return -base["position"][2].get<double>(); };  // it is level
         EXPECT_GE(height(effect.with.file("t.json")["stations"][0]), 1.5);
         EXPECT_LE(height(effect.with.file("t.json")["stations"][0]), 1.6);
       },
       kPlate + Words{"--plate-horizontal"}},
      {"DirectionsKeepTheirCoordinates",
       {"--directions", "xz"},
       [](const Effect& effect) {
         const Measurements without = rows_of(effect.without);
         const Measurements with = rows_of(effect.with);
         for (std::size_t i = 0; i < with.observations.size(); ++i) {
           const Eigen::Vector3d& whole = without.observations[i].position();
           const auto& found = std::get<Coordinates>(with.observations[i].reading);
           EXPECT_EQ(found.position, Eigen::Vector3d(whole.x(), 0.0, whole.z())) << i;
           EXPECT_EQ(found.normal, Eigen::Vector3d::UnitY()) << i;
           EXPECT_EQ(found.count, 2) << i;
         }
       }},
      {"PosesHaveOrientations",
       {"--poses"},
       [](const Effect& effect) {
         EXPECT_FALSE(has_orientations(rows_of(effect.without)));
         const std::vector<Observation> with = rows_of(effect.with).observations;
         EXPECT_EQ(with.size(), 36U);
         EXPECT_TRUE(std::all_of(with.begin(), with.end(), has_orientation));
         EXPECT_EQ(effect.with.file("t.json")["targets"][0]["quaternion_wxyz"].size(), 4U);
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
      {"JointConventionIsThatOfPlanAndMeasurements",
       {"--joint-convention", "coupled.json"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.outcome.status, 2);
         const JointConvention coupled = parse_joint_convention(kFanucCoupled);
         const std::string& csv = effect.with.files.at("m.csv");
         EXPECT_THAT(csv, HasSubstr(",A6[rad],A5[rad]"));
         EXPECT_THAT(csv, Not(HasSubstr("joint_1")));
         const Eigen::MatrixXd q = parse_measurements(csv, joint_names(fanuc()), &coupled).joint_values;
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
                       const Eigen::VectorXd lower{{10, -5, 1, 3, -8, 90}};
                       const Eigen::VectorXd upper{{20, 5, 2, 4, -7, 100}};
                       EXPECT_TRUE((q.rowwise().minCoeff().array() >= lower.array()).all());
                       EXPECT_TRUE((q.rowwise().maxCoeff().array() <= upper.array()).all());
                       for (std::size_t i = 0; i < 6; ++i) {
                         EXPECT_NEAR(effect.with.file("t.json")["joint_ranges"][i]["lower"].get<double>(),
                                     lower[static_cast<Eigen::Index>(i)] * kDegree, 1e-15);
                       }
                     })},
  };
}

/// The truth says so, and the odd arm was measured.
Check is_of_robot(const std::string& key, const std::string& value) {
  return [=](const Effect& effect) {
    EXPECT_EQ(effect.with.file("t.json")[key], value);
    EXPECT_THAT(effect.with.files.at("m.csv"), HasSubstr("slide"));
  };
}

Check has_no_more(const std::string& joint) {
  return [=](const Effect& effect) {
    EXPECT_THAT(effect.without.files.at("m.csv"), HasSubstr(joint));
    EXPECT_THAT(effect.with.files.at("m.csv"), Not(HasSubstr(joint)));
  };
}

std::vector<OptionCase> simulate_file_options() {
  return {
      {"UrdfIsTheRobot", {"--urdf", "odd.urdf"}, is_of_robot("urdf", "odd.urdf")},
      {"DhIsTheRobot", {"--dh", "odd_dh.json"}, is_of_robot("urdf", "odd_dh.json")},
      {"BaseIsTheFirstLink",
       {"--base", "a"},
       all_checks(is_of_robot("base_link", "a"), has_no_more("turn")),
       {"--urdf", "odd.urdf"}},
      {"TipIsTheLastLink",
       {"--tip", "d"},
       all_checks(is_of_robot("tip_link", "d"), has_no_more("wrist")),
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
      {"ForceOverwrites", {"--force"}, overwrites("old.csv", "configuration,"), {"--output", "old.csv"}},
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
  return {
      {"TwoStepRunsTheProcedureForSoManyRounds",
       {"--two-step", "3"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.json["rounds"].size(), 3U);
         EXPECT_EQ(effect.with.outcome.status, 1) << "three rounds do not arrive";
       },
       {"--json"}},
      {"RecordedMeasuresTheSameConfigurationsInEveryRound",
       {"--recorded"},
       all_checks(turns("/recorded", false, true), keeps("/rounds/0/misfit"),
                  [](const Effect& effect) {
                    EXPECT_NE(at(effect.with.json, "/rounds/1/misfit"), at(effect.without.json, "/rounds/1/misfit"));
                  }),
       {"--json", "--two-step", "3"}},
      {"ReportShowsTheRounds", {"--report", "t.html"}, writes_page_of_json("t.html"), {"--json", "--two-step", "3"}}};
}

std::vector<OptionCase> simulate_options() {
  return draw_options() + experiment_options() + simulate_file_options() + procedure_options();
}

class SimulateOption : public OptionEffect {};

TEST_P(SimulateOption, HasItsEffectAndNoOther) {
  write("odd.urdf", kOddArm);
  write("odd_dh.json", dh_of(parse_robot(kOddArm)));
  write("old.csv", "old");
  write("coupled.json", kFanucCoupled);
  write("targets.json", R"({"targets": [{"name": "P", "position": [0, 0.2, 0]},
    {"name": "Q", "position": [0.3, 0, -0.4]}]})");
  write("sockets.json",
        R"({"targets": [{"name": "1", "position": [0, 0, 0]}, {"name": "2", "position": [0.1, 0, 0]}]})");
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

TEST_F(OptionsOfKdlcal, SimulateSaysWhatItDrew) {
  const std::string said =
      run(words_of("simulate --configurations 40 --test-configurations 7 --targets 2 --noise 4e-5 --length-sigma 0.002 "
                   "--angle-sigma 0.003 --effects gain --effect-sigma 0.0005 --seed 5 --output m.csv --truth t.json"))
          .out;
  EXPECT_EQ(said,
            "40 configurations to fit and 7 to test, 2 targets, 94 rows\n"
            "noise 0.0400 mm; 20 true errors, lengths 2.000 mm, angles 0.1719 deg (1 sigma); 6 effects, 0.500 mrad; "
            "seed 5\n");
  EXPECT_EQ(json_of("t.json")["parameters"].size(), 20U);
  EXPECT_EQ(json_of("t.json")["effects"]["terms"].size(), 6U);
  EXPECT_EQ(run(words_of("simulate --configurations 5 --poses --output p.csv")).out,
            "5 configurations to fit, 3 poses, 15 rows\n"
            "noise 0.0000 mm; 20 true errors, lengths 2.500 mm, angles 3.0000 deg (1 sigma); seed 1\n");
}

TEST_F(OptionsOfKdlcal, SimulateCountsManyRunsAndShowsTheirErrors) {
  const Words command = words_of("simulate --monte-carlo 2 --noise 1e-5 --threads 1 --test-configurations 10");
  const Json errors = run_json(command + Words{"--json"})["held_out_error"];
  EXPECT_EQ(errors["all"]["count"], 2 * 10 * 3);
  EXPECT_EQ(errors["mean_of_run"]["count"], 2);
  EXPECT_EQ(errors["max_of_run"]["max"], errors["all"]["max"]);
  const std::string table = run(command).out;
  EXPECT_THAT(table, ::testing::StartsWith("2 runs, 0 of them not to be trusted\nheld-out error [mm]"));
  for (const auto& [label, key] : {std::pair{"all points", "all"}, std::pair{"mean of a run", "mean_of_run"},
                                   std::pair{"largest of a run", "max_of_run"}}) {
    EXPECT_THAT(squeezed(table),
                HasSubstr(std::string(label) + " " + decimals(errors[key]["rms"].get<double>() * 1e3, 3) + " "));
  }
}

TEST_F(OptionsOfKdlcal, SimulateRefusesRunsThatAreNone) {
  for (const char* range : {"0:2", "2:1", "1:4", "1", "a:b", "1.5:2"}) {
    expect_refused(words_of("simulate --monte-carlo 3 --run-range") + Words{range}, {"--run-range", "FIRST:LAST"});
  }
  expect_refused(words_of("simulate --runs r.csv"), {"--monte-carlo"});
}

TEST_F(OptionsOfKdlcal, OfSimulateAreAllTested) { expect_a_test_of_every_option("simulate", simulate_options()); }

}  // namespace
}  // namespace kdl_calibration::testing::simulate_test
