// kdlcal plan: each option changes what it should and nothing else (see cli_options_support.hpp), and what a plan does.

#include <cmath>

#include "cli_options_support.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/stations.hpp"
#include "planning/experiment.hpp"
#include "planning/measuring_plan.hpp"
#include "printed_text.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::plan_test::options {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

/// Chosen joint values, one column each.
Eigen::MatrixXd chosen(const Answer& answer) {
  const Json& configurations = answer.json["configurations"];
  Eigen::MatrixXd q(static_cast<Eigen::Index>(configurations.at(0)["joints"].size()),
                    static_cast<Eigen::Index>(configurations.size()));
  for (std::size_t c = 0; c < configurations.size(); ++c) {
    const std::vector<double> joints = configurations[c]["joints"];
    q.col(static_cast<Eigen::Index>(c)) = Eigen::Map<const Eigen::VectorXd>(joints.data(), q.rows());
  }
  return q;
}

/// More, or other, samples are refused by the constraint of this name than without the option.
Check refuses_more(const std::string& constraint) {
  return [=](const Effect& effect) {
    const auto share = [&](const Answer& answer) {
      for (const Json& entry : answer.json["candidates"]["refused"]) {
        if (entry["constraint"] == constraint) {
          return entry["samples"].get<double>() / answer.json["candidates"]["samples"].get<double>();
        }
      }
      return 0.0;
    };
    EXPECT_GT(share(effect.with), share(effect.without)) << effect.with.json["candidates"];
    EXPECT_EQ(effect.with.json["candidates"]["count"], effect.without.json["candidates"]["count"]);
  };
}

/// A row of joint values, or a sum of them, stays in a range [deg or m] that it leaves without the option.
Check stays(const Eigen::RowVectorXd& weights, double lower, double upper) {
  return [=](const Effect& effect) {
    const Eigen::RowVectorXd with = weights * chosen(effect.with);
    const Eigen::RowVectorXd without = weights * chosen(effect.without);
    EXPECT_GE(with.minCoeff(), lower - 1e-9);
    EXPECT_LE(with.maxCoeff(), upper + 1e-9);
    EXPECT_GT(with.maxCoeff() - with.minCoeff(), 0.5 * (upper - lower)) << "the range is used";
    EXPECT_TRUE(without.minCoeff() < lower && without.maxCoeff() > upper);
  };
}

Eigen::MatrixXd tasks() {
  Eigen::MatrixXd q(3, 2);
  q.col(0) << 10.0, 20.0, -30.0;
  q.col(1) << -20.0, 0.0, 10.0;
  return q * kDegree;
}

/// The promised sigma is what the library predicts at the tasks for the chosen configurations, noise and priors.
Check promises(const PointNoise& noise, const Priors& priors = {}) {
  return [=](const Effect& effect) {
    const Experiment experiment = nominal_experiment(complete_model(arm()), published_targets(3), noise, priors);
    const Eigen::MatrixXd total = prior_information(experiment) + information(experiment, chosen(effect.with));
    const Prediction expected = predicted(experiment, total, tasks(), 1);
    const Json& found = effect.with.json["sigma"]["plan"];
    EXPECT_NEAR(found["mean"], expected.sigma.mean, 1e-9 * expected.sigma.mean);
    EXPECT_NEAR(found["p95"], expected.sigma.p95, 1e-9 * expected.sigma.p95);
    EXPECT_NEAR(found["max"], expected.sigma.max, 1e-9 * expected.sigma.max);
    EXPECT_NE(found["mean"], effect.without.json["sigma"]["plan"]["mean"]);
  };
}

/// The way starts there: the same configurations in another order.
Check starts_at(const Robot& robot, const Eigen::VectorXd& home) {
  return [=](const Effect& effect) {
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(home.size());
    EXPECT_NEAR(effect.without.json["travel_seconds"], way_time(robot.joints, zero, chosen(effect.without)), 1e-9);
    EXPECT_NEAR(effect.with.json["travel_seconds"], way_time(robot.joints, home, chosen(effect.with)), 1e-9);
    EXPECT_NE(effect.with.json["travel_seconds"], effect.without.json["travel_seconds"]);
    EXPECT_NEAR(chosen(effect.with).sum(), chosen(effect.without).sum(), 1e-9);
    for (const std::string& place : differences(effect.without.json, effect.with.json)) {
      EXPECT_TRUE(place == "travel_seconds" || place.rfind("configurations", 0) == 0 ||
                  place.rfind("observability", 0) == 0)
          << place;
    }
  };
}

const std::string kMean = "/sigma/plan/mean";
const std::string kLargest = "/sigma/plan/max";

/// With the option there is no lower bound for any plan.
Check has_no_floor() {
  return [](const Effect& effect) {
    EXPECT_TRUE(at(effect.with.json, "/sigma/floor").is_null());
    EXPECT_FALSE(at(effect.without.json, "/sigma/floor").is_null());
  };
}

Check keeps_choice() {
  return [](const Effect& effect) { EXPECT_EQ(chosen(effect.with), chosen(effect.without)); };
}

const Words kTasks = {"--tasks", "tasks.csv"};
const Words kPlate = {"--targets", "1", "--stations", "4", "--configurations", "40", "--sockets", "sockets.json"};
const Words kTracker = {"--tracker", "4,2,1"};
const Eigen::Vector3d kStand(4.0, 2.0, 1.0);
const Words kTable = {"--arm-radius", "0.1", "--keep-out-box", "1,-3,-1,3,3,0.8"};

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> number_options() {
  return {
      {"ConfigurationsAreChosen",
       {"--configurations", "7"},
       all_checks(counts("/configurations", 30, 7), keeps("/candidates"))},
      {"ResultIsPlannedOn",
       {"--result", "r.json"},
       all_checks(lowers(kMean, 0.8), has_no_floor(), counts("/configurations", 8, 8))},
      {"AfterACalibrationErrorsAreSmall", {"--after", "r.json"}, all_checks(lowers(kMean), has_no_floor())},
      {"SuspectIsAllThatMayHaveChanged", {"--suspect", "joint_3"}, lowers(kMean, 0.95), {"--after", "r.json"}},
      {"MeasuredIsPlannedOn",
       {"--measured", "m.csv"},
       all_checks(lowers(kMean), has_no_floor(),
                  [](const Effect& effect) {
                    std::set<std::string> labels;
                    for (const Json& configuration : effect.with.json["configurations"]) {
                      labels.insert(configuration["configuration"]);
                    }
                    EXPECT_EQ(labels.size(), 8U);
                    const Measurements measured = read_measurements(effect.directory / "m.csv", joint_names(arm()));
                    labels.insert(measured.configurations.begin(), measured.configurations.end());
                    EXPECT_EQ(labels.size(), 8U + measured.configurations.size()) << "a label is taken";
                  })},
      {"OrientationSaysWhatThreeNumbersAre",
       {"--orientation", "fixed-xyz"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.outcome.status, 0) << effect.with.outcome.err;
         EXPECT_NE(at(effect.with.json, kMean), at(effect.without.json, kMean));
       },
       {"--measured", "angles.csv"}},
      {"JointsFileHasTheJointValues", {"--joints-file", "joints.csv"}, is_needed(), {"--measured", "points.csv"}},
      {"PointNamesTellConfigurationAndTarget",
       {"--point-names", "C{configuration}_{target}"},
       is_needed(),
       {"--measured", "named.csv", "--joints-file", "joints.csv"}},
      {"ExcludeLeavesConfigurationsOut", {"--exclude", "1,2,3,4"}, raises(kMean), {"--measured", "m.csv"}},
      {"AddIsHowManyMore", {"--add", "5"}, counts("/configurations", 30, 5), {"--measured", "m.csv"}},
      {"AccuracyIsReachedWithAsFewAsPossible",
       {"--accuracy", "0.04"},
       [](const Effect& effect) {
         EXPECT_LE(at(effect.with.json, kMean), 4e-5);
         EXPECT_GT(at(effect.with.json, kMean), 3.2e-5) << "more than were needed";
         EXPECT_LT(effect.with.json["configurations"].size(), 8U);
       }},
      {"AccuracyOfTheWorst",
       {"--accuracy-of", "max"},
       [](const Effect& effect) {
         EXPECT_GT(at(effect.without.json, kLargest), 4e-5);
         EXPECT_LE(at(effect.with.json, kLargest), 4e-5);
         EXPECT_GT(at(effect.with.json, kLargest), 3.2e-5);
       },
       {"--accuracy", "0.04"}},
      {"CandidatesAreChosenFrom",
       {"--candidates", "500"},
       all_checks(turns("/candidates/count", 5000, 500), lowers("/candidates/samples"),
                  counts("/configurations", 8, 8))},
      {"WorkspaceIsWhereToPredict",
       {"--workspace", "100"},
       all_checks(
           keeps_choice(), keeps("/d_efficiency"), turns("/candidates/count", 100, 100),
           [](const Effect& effect) { EXPECT_NE(at(effect.with.json, kMean), at(effect.without.json, kMean)); })},
      {"TasksAreWhereToPredict",
       {"--tasks", "tasks.csv"},
       all_checks(promises({}), keeps_choice(), keeps("/observability"))},
      {"CriterionGIsTheWorstVariance",
       {"--criterion", "G"},
       all_checks(turns("/criterion", "D", "G"), lowers(kLargest)),
       kTasks},
      {"CriterionIIsTheMeanVariance",
       {"--criterion", "I"},
       all_checks(turns("/criterion", "D", "I"), lowers(kMean)),
       kTasks},
      {"StartsAreSearched",
       {"--starts", "4"},
       all_checks(keeps("/candidates"),
                  [](const Effect& effect) {
                    EXPECT_LE(effect.with.json["d_efficiency"], effect.without.json["d_efficiency"]);  // of 8 starts
                    EXPECT_NE(effect.with.json["exchanges"], effect.without.json["exchanges"]);
                  })},
      {"SeedDrawsOtherCandidates",
       {"--seed", "2"},
       all_checks(turns("/candidates/count", 100, 100),
                  [](const Effect& effect) { EXPECT_NE(chosen(effect.with).sum(), chosen(effect.without).sum()); })},
      {"ThreadsChangeNothing", {"--threads", "3"}, changes_nothing()},
      {"MonteCarloTriesThePlan",
       {"--monte-carlo", "2"},
       all_checks(changes_only({"monte_carlo"}), turns("/monte_carlo/runs", nullptr, 2),
                  [](const Effect& effect) {
                    EXPECT_GT(effect.with.json["monte_carlo"]["held_out_error"]["mean"], 1e-5);
                    EXPECT_LT(effect.with.json["monte_carlo"]["held_out_error"]["mean"], 1e-4);
                  })},
  };
}

std::vector<OptionCase> promise_options() {
  const PointNoise tracker{
      .tracker = TrackerNoise{.range = 1e-5, .range_per_metre = 2e-6, .transverse = 4e-5, .transverse_per_metre = 5e-6},
      .tracker_position = kStand};
  return {
      {"TargetsAreCounted",
       {"--targets", "2"},
       all_checks(turns("/targets", 3, 2),
                  [](const Effect& effect) { EXPECT_EQ(effect.with.json["parameters"], 18); })},
      {"TargetFileHasTheTargets",
       {"--target-file", "targets.json"},
       all_checks(turns("/targets", 3, 2), raises(kMean))},
      {"NoiseIsOfEveryCoordinate", {"--noise", "6e-5"}, promises({.sigma = 6e-5}), kTasks},
      {"ConfigurationNoiseIsShared",
       {"--configuration-noise", "5e-5"},
       all_checks(promises({.configuration_sigma = 5e-5}), has_no_floor()),
       kTasks},
      {"NoiseTrackerIsRangeThenTransverseFromWhereItStands",
       {"--noise-tracker", "1e-5,2e-6,4e-5,5e-6"},
       promises(tracker),
       kTasks + kTracker},
      {"EffectsAreToBeLearntAsWell",
       {"--effects", "gravity"},
       all_checks(counts("/effects", 0, 6), raises(kMean), has_no_floor(),  // two a link beyond, at joints 2 and 3
                  [](const Effect& effect) {
                    EXPECT_THAT(effect.with.json["effects"].get<Words>(),
                                ::testing::Each(::testing::StartsWith("gravity.")));
                    EXPECT_EQ(effect.with.json["parameters"], effect.without.json["parameters"].get<int>() + 6);
                  }),
       kTasks},
      {"PriorLengthIsOfLengths", {"--prior-length", "0.0002"}, promises({}, {.length = 2e-4}), kTasks},
      {"PriorAngleIsOfAngles", {"--prior-angle", "0.0001"}, promises({}, {.angle = 1e-4}), kTasks},
  };
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> cell_options() {
  const Eigen::RowVectorXd first = Eigen::RowVectorXd::Unit(3, 0) / kDegree;
  const Eigen::RowVectorXd sum = (Eigen::RowVectorXd::Unit(3, 1) + Eigen::RowVectorXd::Unit(3, 2)) / kDegree;
  return {
      {"JointRangeIsInDegrees", {"--joint-range", "joint_1=-20:30"}, stays(first, -20.0, 30.0)},
      {"JointRangeOfASumIsRefusedOutside", {"--joint-range", "joint_2+joint_3=-70:40"}, stays(sum, -70.0, 40.0)},
      {"JointRangeOfASlideIsInMillimetres",
       {"--joint-range", "slide=-100:250"},
       stays(Eigen::RowVectorXd::Unit(5, 1), -0.1, 0.25),
       {"--urdf", "odd.urdf"}},
      {"FrameIsTheControllersWorld",
       {"--frame", "world"},
       [](const Effect& effect) {
         // It stands 0.67 m above the base, with x along the base's y.
         const Json with = Json::parse(effect.with.outcome.out)["frame"];
         EXPECT_EQ(with["position"], Json::parse("[0.0, 0.0, 0.67]"));
         EXPECT_NEAR(with["quaternion_wxyz"][3].get<double>(), std::sqrt(0.5), 1e-12);
         EXPECT_EQ(Json::parse(effect.without.outcome.out)["frame"]["position"], Json::parse("[0.0, 0.0, 0.0]"));
       },
       {"--urdf", "six.urdf", "--keep-out-box", "1.8,-5,-1,5,5,5", "--arm-radius", "0.1"}},
      {"BoxHoldsTheTargets", {"--box", "-2.5,-2,0.1,2,2.5,3"}, refuses_more("workspace box")},
      {"LeastHeightIsOfTheTargets", {"--least-height", "0.4"}, refuses_more("least height 400 mm")},
      {"LeastRadiusIsFromTheFirstAxis", {"--least-radius", "1.2"}, refuses_more("least radius 1200 mm")},
      {"KeepOutSphereIsLeftFree", {"--keep-out-sphere", "0.8,1.4,2,0.4"}, refuses_more("keep-out sphere 1")},
      {"KeepOutBoxIsLeftFree", {"--keep-out-box", "0.5,-3,0,3,3,1.5"}, refuses_more("keep-out box 1")},
      {"ClearanceIsKeptByTheArm", {"--clearance", "0.2"}, refuses_more("clearance 200 mm")},
      {"ArmRadiusMakesTheArmThick",
       {"--arm-radius", "0.5"},
       refuses_more("keep-out box 1"),
       {"--keep-out-box", "1,-3,-1,3,3,0.8"}},
      {"ToolRadiusMakesTheToolThick", {"--tool-radius", "0.4"}, refuses_more("keep-out box 1"), kTable},
      {"TrackerSeesEveryTarget", {"--tracker", "4,2,1"}, refuses_more("line of sight")},
      {"DistanceRangeIsFromTheTracker",
       {"--distance-range", "2:4.5"},
       refuses_more("distance from the tracker"),
       kTracker},
      {"AcceptanceAngleIsBetweenBeamAndFacing",
       {"--acceptance-angle", "50"},
       refuses_more("acceptance angle 50 deg"),
       kTracker + Words{"--target-file", "targets.json"}},
  };
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> robot_options() {
  const Eigen::VectorXd home = Eigen::Vector3d(90.0, 30.0, -20.0) * kDegree;
  return {
      {"UrdfIsTheRobot", {"--urdf", "odd.urdf"}, counts("/configurations/0/joints", 6, 5)},
      {"DhIsTheRobot", {"--dh", "arm_dh.json"}, counts("/configurations/0/joints", 6, 3)},
      {"BaseIsWhereHeightsAreMeasured",
       {"--base", "base_link"},
       refuses_more("least height 1000 mm"),
       {"--urdf", "foot.urdf", "--least-height", "1"}},
      {"TipIsTheLastLink", {"--tip", "d"}, counts("/configurations/0/joints", 5, 4), {"--urdf", "odd.urdf"}},
      {"HomeIsWhereTheWayStarts", {"--home", "90,30,-20"}, starts_at(arm(), home)},
      {"JointConventionIsThatOfFiles",
       {"--joint-convention", "coupled.json"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.json, effect.without.json);
         EXPECT_THAT(effect.with.files.at("p.csv"), HasSubstr("configuration,target,A3[deg],A2[deg]"));
         const JointConvention convention = parse_joint_convention(kArmCoupled);
         const Measurements read = parse_configurations(effect.with.files.at("p.csv"), joint_names(arm()), &convention);
         EXPECT_LT((read.joint_values - chosen(effect.with)).cwiseAbs().maxCoeff(), 1e-10);
       },
       {"--output", "p.csv"}},
      {"StationsEachHaveTheirPlace",
       {"--stations", "3"},
       all_checks(counts("/stations", 0, 3), counts("/configurations", 8, 8),
                  [](const Effect& effect) {
                    EXPECT_LT(at(effect.with.json, kMean), at(effect.with.json, "/sigma/random/mean"));
                  })},
      {"SocketsAreTouched",
       {"--sockets", "sockets.json", "--output", "p.csv"},
       [](const Effect& effect) {
         const Measurements read = parse_measurements(effect.with.files.at("p.csv"), joint_names(arm()));
         for (const Observation& o : read.observations) {
           EXPECT_TRUE(o.position().isZero() || o.position() == Eigen::Vector3d(0.1, 0.0, 0.0));
         }
         EXPECT_EQ(read.configurations.size(), 40U);
       },
       {"--targets", "1", "--stations", "4", "--configurations", "40"}},
      {"PlateHorizontalLeavesATurnAboutTheVertical",
       {"--plate-horizontal"},
       [](const Effect& effect) {
         const auto is_level = [](const Json& place) {
           return std::hypot(place["quaternion_wxyz"][1].get<double>(), place["quaternion_wxyz"][2].get<double>()) <
                  1e-9;
         };
         const Json with = effect.with.json["stations"];
         const Json without = effect.without.json["stations"];
         EXPECT_TRUE(std::all_of(with.begin(), with.end(), is_level));
         EXPECT_TRUE(std::none_of(without.begin(), without.end(), is_level));
       },
       kPlate},
      {"PlateHeightsAreOfItsOrigin",
       {"--plate-heights", "0.9:1.1"},
       [](const Effect& effect) {
         const auto is_there = [](const Json& place) {
           const double height = place["position"][2].get<double>();
           return height >= 0.9 && height <= 1.1;
         };
         const Json with = effect.with.json["stations"];
         const Json without = effect.without.json["stations"];
         EXPECT_TRUE(std::all_of(with.begin(), with.end(), is_there));
         EXPECT_FALSE(std::all_of(without.begin(), without.end(), is_there));
       },
       kPlate},
      {"DirectionsHideSomeOfTheBase", {"--directions", "xz"}, turns("/stations/0/determined_directions", nullptr, 5)},
      {"OutputIsThePlan",
       {"--output", "p.csv"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
         const Measurements read = parse_configurations(effect.with.files.at("p.csv"), joint_names(arm()));
         EXPECT_LT((read.joint_values - chosen(effect.with)).cwiseAbs().maxCoeff(), 1e-10);
         EXPECT_EQ(read.targets.size(), 3U);
       }},
      {"DecimalCommaIsForSpreadsheets",
       {"--decimal-comma"},
       [](const Effect& effect) {
         const std::string& text = effect.with.files.at("p.csv");
         EXPECT_THAT(text, HasSubstr("configuration;target;joint_1[deg];"));
         EXPECT_THAT(text.substr(text.find("\n1;")), Not(HasSubstr(".")));
         const Measurements with = parse_configurations(text, joint_names(arm()));
         const Measurements without = parse_configurations(effect.without.files.at("p.csv"), joint_names(arm()));
         EXPECT_EQ(with.joint_values, without.joint_values);
         EXPECT_EQ(with.targets, without.targets);
       },
       {"--output", "p.csv"}},
      {"ReportShowsThePlan",
       {"--report", "p.html"},
       all_checks(writes_page_of_json("p.html"),
                  [](const Effect& effect) {
                    EXPECT_EQ(data_of_page(effect.with.files.at("p.html"))["setup"],
                              Json::parse(R"([["noise", "0.0300 mm of a coordinate, 1 sigma"], ["seed", "1"]])"));
                  })},
      {"ProgramDrivesToThePlan",
       {"--program", "p.script"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
         const Json planned = Json::parse(effect.with.outcome.out)["configurations"];
         const std::string text = effect.with.files.at("p.script");
         std::size_t found = 0;
         for (std::size_t at = text.find("movej(["); at != std::string::npos; at = text.find("movej([", at + 1)) {
           EXPECT_NEAR(std::stod(text.substr(at + 7)), planned[found++]["joints"][0].get<double>(), 1e-6);
         }
         EXPECT_EQ(found, 8U);
       },
       {"--urdf", "six.urdf"}},
      {"ForceOverwrites", {"--force"}, overwrites("old.csv", "# "), {"--output", "old.csv"}},
      {"JsonReplacesTheTable", {"--json"}, turns_the_table_into_json()},
  };
}

std::vector<OptionCase> plan_options() {
  return number_options() + promise_options() + cell_options() + robot_options();
}

/// What a test begins with, made once.
const std::map<std::string, std::string>& input_files() {
  static const std::map<std::string, std::string> files = {
      {kArm, arm().urdf},
      {"odd.urdf", kOddArm},
      {"six.urdf", fanuc().urdf},
      {"arm_dh.json", dh_of(arm())},
      {"foot.urdf", with_foot(arm().urdf)},
      {"old.csv", "old"},
      {"sockets.json",
       R"({"targets": [{"name": "1", "position": [0, 0, 0]}, {"name": "2", "position": [0.1, 0, 0]}]})"},
      {"coupled.json", kArmCoupled},
      {"m.csv", measurements_csv(measured_fanuc({.sigma = 3e-5}, false, arm()))},
      {"joints.csv", joints_csv(measured_fanuc({.sigma = 3e-5}, false, arm()))},
      {"points.csv", points_csv(measured_fanuc({.sigma = 3e-5}, false, arm()), false)},
      {"named.csv", points_csv(measured_fanuc({.sigma = 3e-5}, false, arm()), true)},
      {"angles.csv", angles_csv(measured_fanuc({.sigma = 3e-5, .orientation_sigma = 1e-4}, true, arm()))},
      {"targets.json", R"({"targets": [{"name": "P", "position": [0.1, 0.2, 0], "facing": [0, 1, 0]},
    {"name": "Q", "position": [-0.1, 0.2, 0.1]}]})"},
      {"tasks.csv", "joint_1[deg],joint_2[deg],joint_3[deg]\n10,20,-30\n-20,0,10\n"}};
  return files;
}

class PlanOption : public OptionEffect {
protected:
  void SetUp() override {
    OptionEffect::SetUp();
    write(input_files());
  }
};

TEST_P(PlanOption, HasItsEffectAndNoOther) {
  const std::string& option = GetParam().option.front();
  if (option == "--result" || option == "--after" || option == "--suspect") {
    succeed({"calibrate", "--urdf", kArm, "--measurements", "m.csv", "--result", "r.json"});
  }
  Words command = {"plan"};
  for (const auto& [name, value] : std::vector<std::pair<std::string, std::string>>{{"--configurations", "8"},
                                                                                    {"--candidates", "100"},
                                                                                    {"--workspace", "40"},
                                                                                    {"--starts", "1"},
                                                                                    {"--threads", "1"}}) {
    const Words& base = GetParam().base;
    const bool counts = (option == "--add" || option == "--sockets" ||
                         std::find(base.begin(), base.end(), "--configurations") != base.end()) &&
                        name == "--configurations";
    command = option == name || counts ? command : command + Words{name, value};
  }
  command = option == "--json" ? command : command + Words{"--json"};
  check_effect_on_arm(command, GetParam());
}
INSTANTIATE_TEST_SUITE_P(Options, PlanOption, ::testing::ValuesIn(plan_options()), behaviour_of);

TEST_F(OptionsOfKdlcal, OfPlanAreAllTested) { expect_a_test_of_every_option("plan", plan_options()); }

}  // namespace
}  // namespace kdl_calibration::testing::plan_test::options

namespace kdl_calibration::testing::plan_test::commands {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class PlanCommand : public CommandLine {
protected:
  static Words with(const Words& more) { return words_of("plan --candidates 100 --workspace 50 --starts 2") + more; }
};

TEST_F(PlanCommand, PlansAnExperimentThatCalibrates) {
  const std::string convention = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json";
  const Outcome plan = run(with({"--configurations", "20", "--least-height", "0.2", "--least-radius", "0.7",
                                 "--joint-range", "J3=-80:90", "--joint-range", "joint_5=-100:100",
                                 "--joint-convention", convention, "--output", "plan.csv", "--program", "plan.LS"}));
  ASSERT_EQ(plan.status, 0) << plan.err;
  // The program and the table state the same joint values, of the pendant.
  const std::string of_program = text_of("plan.LS");
  std::istringstream rows(text_of("plan.csv"));
  for (std::string row; std::getline(rows, row);) {
    if (row.rfind("1,A,", 0) == 0) {
      EXPECT_NEAR(std::stod(of_program.substr(of_program.find("J1=") + 3)), std::stod(row.substr(4)), 6e-4);
    }
  }
  EXPECT_THAT(of_program, AllOf(HasSubstr("/PROG  PLAN\n"), HasSubstr("J P[20] 10% FINE"), HasSubstr("P[20]{")));
  EXPECT_THAT(plan.out, HasSubstr(" exchanges"));
  EXPECT_THAT(plan.out, HasSubstr("range of J3 removes "));
  EXPECT_THAT(plan.out, HasSubstr("lower bound for any plan"));
  EXPECT_THAT(text_of("plan.csv"), HasSubstr("configuration,target,J1[deg],J2[deg]"));
  EXPECT_THAT(text_of("plan.csv"), HasSubstr("home pose"));
  expect_refused({"calibrate", "--measurements", "plan.csv", "--joint-convention", convention},
                 {"plan.csv:5: x[m]", "empty"});

  // Drive the plan on a virtual robot, and calibrate it.
  const Outcome simulated = run({"simulate", "--plan", "plan.csv", "--joint-convention", convention, "--noise", "3e-5",
                                 "--test-configurations", "20", "--output", "m.csv"});
  ASSERT_EQ(simulated.status, 0) << simulated.err;
  EXPECT_THAT(simulated.out, HasSubstr("20 configurations to fit"));
  const Outcome calibrated =
      run({"calibrate", "--measurements", "m.csv", "--joint-convention", convention, "--result", "result.json"});
  ASSERT_EQ(calibrated.status, 0) << calibrated.err;
  EXPECT_LT(json_of("result.json")["position_error"]["test"]["after"]["mean"].get<double>(), 1e-4);

  // And plan what to measure on top of that.
  const nlohmann::json added = run_json(
      with({"--measured", "m.csv", "--joint-convention", convention, "--add", "5", "--noise", "3e-5", "--json"}));
  ASSERT_EQ(added["configurations"].size(), 5U);
  EXPECT_TRUE(added["sigma"]["floor"].is_null());
  EXPECT_EQ(added["configurations"][0]["configuration"], "41");
}

// The cell is written into the plan, read from the measurements and named in the command on the page.
TEST_F(PlanCommand, TheCellOfAPlanComesBackInTheCommandThatPlansMore) {
  const Words cell = words_of(
      "--frame base --least-height 0.2 --keep-out-box -5,2.2,-1,5,5,5 --keep-out-box "
      "-5,-5,-1,-2.2,5,5 --arm-radius 0.1 --joint-range joint_5=-100:100");
  ASSERT_EQ(run(with(Words{"--configurations", "16", "--output", "plan.csv"} + cell)).status, 0);
  EXPECT_THAT(text_of("plan.csv"),
              HasSubstr("# Cell: --frame base --joint-range joint_5=-100:100 --least-height 0.2 --keep-out-box "
                        "-5,2.2,-1,5,5,5 --keep-out-box -5,-5,-1,-2.2,5,5 --arm-radius 0.1\n"));
  succeed(words_of("simulate --plan plan.csv --noise 3e-5 --output bare.csv"));
  // A spreadsheet fills up the line, and the user has written the points below it.
  const std::string plan = text_of("plan.csv");
  const std::string note = plan.substr(plan.find("# Cell"), plan.find('\n', plan.find("# Cell")) - plan.find("# Cell"));
  write("m.csv", note + ",,,,\n" + text_of("bare.csv"));
  succeed(
      words_of("calibrate --measurements m.csv --effects none --prior none --noise equal --result r.json "
               "--report r.html"));
  const std::string command = data_of_page(text_of("r.html"))["plan_command"];
  EXPECT_THAT(command, HasSubstr(note.substr(8) + " --add 10"));
  // It works as it stands, and without the cell there is a warning.
  Words again = words_of(command.substr(std::string("kdlcal ").size()));
  again[again.size() - 1] = "more.csv";
  const Outcome more = run(again + words_of("--candidates 100 --workspace 50 --starts 2"));
  EXPECT_EQ(more.status, 0) << more.err;
  EXPECT_THAT(more.err, Not(HasSubstr("was planned with")));
  const Outcome bare = run(with(words_of("--measured m.csv --add 10")));
  EXPECT_THAT(bare.err, HasSubstr("m.csv was planned with " + note.substr(8)));
  for (const char* option : {"--result", "--after"}) {
    const Words of_result = {option, "r.json"};
    EXPECT_THAT(run(with(of_result)).err, HasSubstr("r.json was planned with " + note.substr(8)));
    EXPECT_THAT(run(with(of_result + words_of("--least-height 0.2"))).err, HasSubstr("r.json was planned with"));
    EXPECT_THAT(run(with(of_result + cell)).err, Not(HasSubstr("was planned with")));
  }
}

TEST_F(PlanCommand, APlanOfTouchesOrSingleCoordinatesIsRehearsedAsPlanned) {
  write("sockets.json",
        R"({"targets": [{"name": "1", "position": [0, 0, 0]}, {"name": "2", "position": [0.4, 0, 0]}]})");
  ASSERT_EQ(
      run(with(words_of("--configurations 40 --targets 1 --stations 4 --sockets sockets.json --output t.csv"))).status,
      0);
  succeed(words_of("simulate --plan t.csv --noise 2e-5 --length-sigma 1e-3 --angle-sigma 1e-3 --output m.csv"));
  const Measurements touches = read_measurements(fanuc(), directory / "m.csv");
  const Measurements planned = read_measurements(fanuc(), directory / "t.csv");
  ASSERT_EQ(touches.observations.size(), 40U);
  EXPECT_EQ(touches.stations, planned.stations);
  for (std::size_t i = 0; i < 40; ++i) {
    EXPECT_EQ(touches.observations[i].position(), planned.observations[i].position());
    EXPECT_EQ(touches.observations[i].station, planned.observations[i].station);
  }
  EXPECT_LT((touches.joint_values - planned.joint_values).cwiseAbs().maxCoeff(), 0.1);
  expect_refused(words_of("simulate --plan t.csv --repeats 2"), {"--plan", "each once"});
  ASSERT_EQ(run(with(words_of("--configurations 40 --stations 3 --directions z --output z.csv"))).status, 0);
  succeed(words_of("simulate --plan z.csv --output zm.csv"));
  expect_refused(with({"--measured", "zm.csv", "--add", "3"}), {"--measured: zm.csv is of 3 stations, expected one"});
  const Measurements heights = read_measurements(fanuc(), directory / "zm.csv");
  EXPECT_EQ(heights.stations.size(), 3U);
  EXPECT_EQ(dimension(heights.observations.front().reading), 1);
}

// A wall in front of the robot: x of the pendant, y of the URDF.
TEST_F(PlanCommand, KeepsOutOfTheWallThatThePendantsFrameStates) {
  const std::string convention = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json";
  const Words wall = with({"--configurations", "12", "--arm-radius", "0.15", "--keep-out-box", "1.2,-5,-2,5,5,5"});
  const auto most_in_front = [&](const Words& words) {
    const Json plan = run_json(words + Words{"--json"});
    double most = 0.0;
    for (const Json& configuration : plan["configurations"]) {
      const std::vector<double> q = configuration["joints"].get<std::vector<double>>();
      const KDL::Frame flange = kdl_pose(fanuc().chain, Eigen::Map<const Eigen::VectorXd>(q.data(), 6));
      most = std::max(most, flange.p.y());
    }
    return most;
  };
  EXPECT_LT(most_in_front(wall + Words{"--joint-convention", convention}), 1.2);
  EXPECT_LT(most_in_front(wall + Words{"--frame", "world"}), 1.2);
  EXPECT_GT(most_in_front(wall + Words{"--joint-convention", convention, "--frame", "base"}), 1.2);
  EXPECT_GT(most_in_front(wall), 1.2);
  const std::string text = run(wall + Words{"--frame", "world", "--least-height", "0.2"}).out;
  EXPECT_THAT(text, HasSubstr("least height            in base_link: z 0.870 m\n"));
  EXPECT_THAT(text, HasSubstr("the controller's world: its origin at 0.000, 0.000, 0.670 m in base_link, its x along "
                              "y there\n"));
  EXPECT_THAT(text, HasSubstr("keep-out box 1          in base_link: x -5.000 to 5.000, y 1.200 to 5.000, z -1.330 to "
                              "5.670 m"));
}

TEST_F(PlanCommand, EightConfigurationsTellWhatHasChanged) {
  write(kArm, arm().urdf);
  succeed({"simulate", "--urdf", kArm, "--configurations", "20", "--noise", "3e-5", "--output", "m.csv"});
  succeed({"calibrate", "--urdf", kArm, "--measurements", "m.csv", "--result", "r.json"});
  const Words after = {"plan", "--urdf", kArm, "--after", "r.json", "--output", "few.csv", "--json"};
  EXPECT_EQ(run_json(after)["configurations"].size(), 8U);
  EXPECT_THAT(text_of("few.csv"), HasSubstr("# Filled in, it is for kdlcal calibrate --prior-result r.json."));
  const Outcome unseen = run(after + Words{"--force", "--suspect", "joint_1,joint_2,joint_3"});
  EXPECT_THAT(unseen.err, AllOf(HasSubstr("zero of joint_1 cannot show"), HasSubstr("zero of joint_3 cannot show"),
                                Not(HasSubstr("joint_2"))));
  expect_refused(after + Words{"--force", "--suspect", "joint_1,joint_9"},
                 {"--suspect", "no joint 'joint_9'", "joint_1, joint_2"});
  // The controller's J3 turns two joints of the URDF, its J2 the second alone.
  write("c.json", R"({"controller_joints": ["J1", "J2", "J3"], "urdf_joints": ["joint_1", "joint_2", "joint_3"],
      "matrix": [[1, 0, 0], [0, 1, 1], [0, 0, -1]], "offset": [0, 0, 0]})");
  const auto plan_of = [&](const std::string& suspects, Words convention) {
    return run_json(after + Words{"--force", "--suspect", suspects} + std::move(convention))["configurations"].size();
  };
  const auto sheet_of = [&](const std::string& suspects) {
    EXPECT_EQ(plan_of(suspects, {"--joint-convention", "c.json"}), 8U);
    return text_of("few.csv");
  };
  const std::string of_both = sheet_of("joint_2,joint_3");
  const std::string of_one = sheet_of("joint_2");
  EXPECT_NE(of_both, of_one);
  EXPECT_EQ(sheet_of("J3"), of_both);
  EXPECT_EQ(sheet_of("joint_3,J2,J3"), of_both);
  EXPECT_EQ(sheet_of("J2"), of_one);
}

TEST_F(PlanCommand, RefusesWhatItCannotPlan) {
  write(kArm, arm().urdf);
  expect_refused(with({"--urdf", kArm, "--accuracy", "0.001", "--configurations", "12"}),
                 {"accuracy cannot be reached", "12 config"});
  expect_refused(with({"--configurations", "3"}), {"expected at least 4 configurations"});
  expect_refused(with({"--least-height", "9", "--output", "plan.csv"}),
                 {"the constraints leave 0 of", "least height 9000 mm removes"});
  for (const auto& [option, millimetres] : {std::pair{"--keep-out-box", "1900,-5000,-1000,5000,5000,5000"},
                                            {"--box", "1000,-1000,0,2000,1000,1000"},
                                            {"--tracker", "4000,-1000,1200"},
                                            {"--keep-out-sphere", "0,3000,0,500"},
                                            {"--least-height", "-200"}}) {
    expect_refused(with({option, millimetres}), {option, "a place within 100 m of the robot, in metres"});
  }
  ASSERT_EQ(run(with(words_of("--keep-out-box 60,-900,-900,900,900,900 --arm-radius 0.1 --tracker 80,0,0"))).status, 0);
  expect_refused(with({"--keep-out-sphere", "1,2,3"}), {"--keep-out-sphere", "1,2,3", "x,y,z,radius"});
  expect_refused(with({"--add", "3"}), {"--add", "--measured"});
  expect_refused(with({"--measured", "m.csv", "--result", "r.json"}), {"--result", "--measured", "one of the two"});
  expect_refused(with({"--result", "r.json", "--monte-carlo", "2"}), {"--monte-carlo", "--measured FILE"});
  expect_refused(with({"--after", "r.json", "--monte-carlo", "2"}), {"--monte-carlo", "instead of --after"});
  expect_refused(with({"--after", "r.json", "--result", "r.json"}), {"--after", "--result"});
  expect_refused(with({"--suspect", "joint_3"}), {"--suspect", "--after"});
  expect_refused(with({"--noise-tracker", "1e-5,0,3e-5,8e-6"}), {"--noise-tracker", "--tracker x,y,z"});
  expect_refused(with({"--criterion", "A"}), {"--criterion", "D, G, I"});
  expect_refused(with({"--home", "1,2"}), {"--home", "6 joint values"});
  expect_refused(with({"--program", "p.LS"}), {"--program", "FANUC LS", "--joint-convention"});
  expect_refused(with({"--program", "p.txt"}), {"p.txt", "FANUC LS (.LS)"});
  for (const Words& more : {Words{"--accuracy", "0.1"}, Words{"--criterion", "G"}, Words{"--effects", "gravity"},
                            Words{"--report", "p.html"}, Words{"--monte-carlo", "2"}}) {
    expect_refused(with(Words{"--stations", "2"} + more), {more.front(), "whole points from one station"});
  }
}

TEST_F(PlanCommand, ForAPlateSaysWhereItStandsAndIsMeasuredFromThere) {
  write("sockets.json",
        R"({"targets": [{"name": "1", "position": [0, 0, 0]}, {"name": "2", "position": [0.4, 0, 0]}]})");
  const auto plan = [&](const Words& stations) {
    return run(Words{"plan", "--targets", "1", "--sockets", "sockets.json", "--workspace", "50", "--starts", "2",
                     "--output", "p.csv", "--force"} +
               stations);
  };
  const std::string alone = plan({"--configurations", "25"}).out;
  EXPECT_THAT(alone, HasSubstr("25 configurations shared evenly by 1 station, the best of 2 draws of stations;"));
  EXPECT_THAT(alone, HasSubstr("\n  P1  "));
  const std::string several = plan({"--configurations", "30", "--stations", "4"}).out;
  EXPECT_THAT(several, HasSubstr("30 configurations shared evenly by 4 stations,"));
  EXPECT_THAT(several, HasSubstr("\n  P4  "));

  for (const char* command : {"plan", "simulate"}) {
    expect_refused({command, "--sockets", "sockets.json"}, {"--sockets: 3 targets, expected one, a ball"});
  }
  expect_refused(
      {"simulate", "--sockets", "sockets.json", "--targets", "1", "--stations", "4", "--configurations", "3"},
      {"--stations: 4 of 3 configurations, expected at least one for each station"});
}

TEST_F(PlanCommand, ForATrackerThatIsMovedIsMeasuredFromItsStations) {
  const char* anywhere = "a tracker may stand anywhere that sees the targets";
  EXPECT_THAT(run(with({"--stations", "4", "--configurations", "30", "--output", "p.csv"})).out, HasSubstr(anywhere));
  EXPECT_THAT(run(with({"--stations", "4", "--directions", "z", "--configurations", "48"})).out,
              Not(HasSubstr(anywhere)));
  succeed({"simulate", "--plan", "p.csv", "--output", "m.csv"});
  const Measurements planned = read_configurations(directory / "p.csv", joint_names(fanuc()));
  const Measurements measured = read_measurements(directory / "m.csv", joint_names(fanuc()));
  EXPECT_EQ(measured.stations, planned.stations);
  EXPECT_EQ(stations_of_configurations(measured), stations_of_configurations(planned));
  EXPECT_EQ(run({"calibrate", "--measurements", "m.csv"}).status, 0);
  for (const Words& more : {Words{"--stations", "4"}, Words{"--two-step", "3"}, Words{"--monte-carlo", "3"}}) {
    expect_refused(Words{"simulate", "--plan", "p.csv"} + more, {"p.csv has 4 stations"});
  }
}

// The table and the JSON of the same plan.
TEST_F(PlanCommand, TheTableShowsTheNumbersOfTheJson) {
  const auto both = [&](std::vector<std::string> more, bool floor, bool refuses) {
    const std::string table = run(with(more)).out;
    more.emplace_back("--json");
    const nlohmann::json plan = run_json(with(more));
    for (const char* choice : {"plan", "random"}) {
      for (const char* figure : {"mean", "p95", "max", "worst_configuration_rms"}) {
        const nlohmann::json& value = plan["sigma"][choice][figure];
        EXPECT_THAT(table, HasSubstr(value.is_null() ? "   -" : " " + decimals(value.get<double>() * 1e3, 4)));
      }
    }
    EXPECT_THAT(table, HasSubstr(" " + plan["exchanges"].dump() + " exchanges; seed 1"));
    EXPECT_THAT(table, HasSubstr(" " + plan["candidates"]["samples"].dump() + " drawn"));
    EXPECT_THAT(table, HasSubstr("O1 " + decimals(plan["observability"]["O1"], 4)));
    EXPECT_THAT(table, HasSubstr("at least " + decimals(plan["d_efficiency"], 3) + "\n"));
    EXPECT_THAT(table, HasSubstr(" " + decimals(plan["travel_seconds"], 0) + " s at full speed"));
    EXPECT_EQ(table.find("lower bound for any plan") != std::string::npos, floor);
    EXPECT_EQ(table.find(" removes ") != std::string::npos, refuses);
    return table;
  };
  const std::string tried = both({"--configurations", "12", "--monte-carlo", "2"}, true, false);
  EXPECT_THAT(tried, HasSubstr("12 configurations of 100 candidates, D-optimal; 3 targets, 33 parameters, noise 0.0300 "
                               "mm\n"));
  EXPECT_THAT(tried, HasSubstr("2 runs, 0 not to be trusted; held-out error [mm] mean 0.0"));
  EXPECT_THAT(both(words_of("--configurations 14 --targets 2 --criterion I --least-height 0.3 --noise-tracker "
                            "1e-5,0,3e-5,8e-6 --tracker 4,1,0.5"),
                   false, true),
              HasSubstr("I-optimal; 2 targets, 30 parameters, noise of the tracker\n"));
  // Joint 4 has but two values: random choices of one of them determine nothing.
  both({"--configurations", "6", "--joint-range", "joint_4=0:0.001"}, true, false);
}

}  // namespace
}  // namespace kdl_calibration::testing::plan_test::commands
