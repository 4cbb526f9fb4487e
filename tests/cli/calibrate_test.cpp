// kdlcal calibrate: each option changes what it should and nothing else (see cli_options_support.hpp), what it reports,
// and what it writes for others to build on.

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <regex>
#include <set>

#include "base/sha256.hpp"
#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "cli/requirements.hpp"
#include "cli_options_support.hpp"
#include "cli_support.hpp"
#include "effects/arm_kinematics.hpp"
#include "estimation/prediction.hpp"
#include "json_support.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "planning/measuring_plan.hpp"
#include "planning/simulation.hpp"
#include "printed_text.hpp"
#include "refusal.hpp"
#include "report_page_support.hpp"
#include "results/result_json.hpp"
#include "results/saved_calibration.hpp"
#include "support.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing::calibrate_test::options {
namespace {

using ::testing::HasSubstr;

using Set = std::function<void(CalibrationSettings& options)>;

std::string library_result(const std::filesystem::path& directory, const std::string& file,
                           const CalibrationSettings& options) {
  const Robot& robot = arm();
  const Measurements measurements =
      parse_measurements(CommandLine::content(directory / file), joint_names(robot), nullptr, file);
  return result_json(robot, measurements, calibrate(complete_model(robot), measurements, options));
}

/// The library does not know which files it was about.
Json without_provenance(Json result) {
  result.erase("provenance");
  return result;
}

/// The result is the one of the library with this option set, to the last digit, and another one than without it. Only
/// messages may name options of kdlcal as well.
Check is_library(const Set& set, const std::string& file = "m.csv") {
  return [=](const Effect& effect) {
    CalibrationSettings options;
    options.threads = 1;
    set(options);
    const Json expected = Json::parse(library_result(effect.directory, file, options));
    EXPECT_THAT(differences(without_provenance(expected), without_provenance(effect.with.json)),
                ::testing::Each(::testing::AnyOf("doubts/*/message", "warnings/*")));
    EXPECT_NE(effect.with.json, effect.without.json);
    EXPECT_TRUE(effect.with.files.empty());
  };
}

/// The rows that this option writes stand in the file, below a header, and nothing else changes.
Check writes_rows(const std::string& file, const std::function<std::size_t(const Json& result)>& rows) {
  return [=](const Effect& effect) {
    EXPECT_THAT(differences(effect.without.json, effect.with.json), ::testing::ElementsAre("provenance/files_written"));
    const std::string csv = effect.with.files.at(file);
    EXPECT_EQ(static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n')), 1 + rows(effect.with.json));
  };
}

/// The result differs at least here, and not there.
Check changes(const std::vector<std::string>& here, const std::vector<std::string>& not_there) {
  return [=](const Effect& effect) {
    const std::set<std::string> found = differences(effect.without.json, effect.with.json);
    for (const std::string& place : here) {
      EXPECT_EQ(found.count(place), 1U) << place << " did not change, but " << ::testing::PrintToString(found);
    }
    for (const std::string& place : found) {
      for (const std::string& fixed : not_there) {
        EXPECT_NE(place.rfind(fixed, 0), 0U) << place << " changed";
      }
    }
  };
}

const Words kOfM = {"--measurements", "m.csv"};
const Words kNoEffects = {"--effects", "none"};
const Words kNoPriors = {"--prior", "none"};
const Words kMeasured = kOfM + kNoEffects + kNoPriors;
const Words kPoses = Words{"--measurements", "poses.csv"} + kNoEffects + kNoPriors;
const Words kStated = kMeasured + Words{"--noise-independent", "2e-5"};

Eigen::Isometry3d known_base() {
  return Eigen::Translation3d(2.001, 1.0, 0.502) * Eigen::Quaterniond(0.6, 0.0, 0.0, 0.8);
}

/// So many parameters of the arm are left, and the other calibration is the one without the option.
Check keeps_axes(const std::string& which, int rank) {
  return [=](const Effect& effect) {
    const Json& kept = effect.with.json["kept_axes"];
    EXPECT_EQ(kept["kept"], which);
    EXPECT_EQ(effect.with.json["rank"], rank);
    EXPECT_FALSE(effect.without.json.contains("kept_axes"));
    for (const auto& [mine, its] : {std::pair{"train", "train"}, std::pair{"held_out", "leave_one_out"}}) {
      EXPECT_EQ(kept["without"][mine]["after"], effect.without.json["position_error"][its]["after"]);
    }
  };
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> geometry_options() {
  return {
      {"MethodTwoStepIsTheOther",
       {"--method", "two-step"},
       is_library([](auto& o) {
         o.estimator.method = Method::two_step;
         o.estimator.iterations = 5;
       }),
       kMeasured + Words{"--iterations", "5"}},
      {"IterationsAreTheLimit",
       {"--iterations", "2"},
       all_checks(is_library([](auto& o) { o.estimator.iterations = 2; }),
                  [](const Effect& effect) {
                    EXPECT_EQ(effect.with.json["iterations"], 2);
                    EXPECT_EQ(effect.with.json["termination"], "iteration_limit");
                    EXPECT_EQ(effect.with.outcome.status, 1);
                    EXPECT_EQ(effect.without.outcome.status, 0);
                  }),
       kMeasured},
      {"ModelCompleteHasEveryParameter",
       {"--model", "complete"},
       is_library([](auto& o) { o.parameters.model = ModelChoice::complete; }),
       kMeasured},
      {"FixHoldsParametersAtZero",
       {"--fix", "dq2,*2"},
       is_library([](auto& o) {
         o.parameters.fix = Words{"dq2", "*2"};
       }),
       kMeasured},
      {"FreeAddsParameters", {"--free", "Rx1"}, is_library([](auto& o) { o.parameters.free = {"Rx1"}; }), kMeasured},
      {"KeepAxesIsForClosedForms", {"--keep-axes"}, keeps_axes("closed_form", 19), kMeasured},
      {"KeepAxesMayKeepAllAngles", {"--keep-axes=angles"}, keeps_axes("angles", 18), kMeasured},
      {"PriorLengthIsOfLengths",
       {"--prior-length", "0.0005"},
       is_library([](auto& o) { o.selection.priors.length = 5e-4; }),
       kMeasured},
      {"PriorAngleIsOfAngles",
       {"--prior-angle", "0.0007"},
       is_library([](auto& o) { o.selection.priors.angle = 7e-4; }),
       kMeasured},
      {"PriorResultHasItsPlaceInTheResult",
       {"--prior-result", "prior.json"},
       changes({"prior_result", "parameters/*/std"}, {"input"}),
       kMeasured},
      {"AutoIsWhatIsDoneWhereNothingIsSaid", {"--prior", "auto", "--effects", "auto"}, changes_nothing(), kOfM},
      {"NothingSaidIsAllAutomatic",
       {"--threads", "1"},
       [](const Effect& effect) {
         CalibrationSettings options{
             .selection = {.automatic_priors = true, .effects = {.groups = {}, .automatic = true}}};
         const Json expected = Json::parse(library_result(effect.directory, "m.csv", options));
         EXPECT_EQ(without_provenance(expected), without_provenance(effect.with.json));
       },
       kOfM},
      {"EffectsOfAGroup",
       {"--effects", "gravity"},
       is_library([](auto& o) { o.selection.effects.groups = {EffectGroup::gravity}; }),
       kOfM + kNoPriors},
      {"GravityDirectionIsThatOfTheSag",
       {"--gravity-direction", "1,2,-2"},
       all_checks(
           changes({"effects/gravity_direction/*", "effects/terms"}, {"input", "findings"}),
           [](const Effect& effect) {
             expect_near(effect.with.json["effects"]["gravity_direction"], {1.0 / 3.0, 2.0 / 3.0, -2.0 / 3.0}, 1e-15);
           }),
       kOfM + kNoPriors + Words{"--effects", "gravity"}},
      {"PayloadCentreIsThatOfTheTorque",
       {"--payload-centre", "0.1,-0.2,0.3"},
       [](const Effect& effect) {
         ASSERT_FALSE(effect.with.json["effects"]["terms"].empty()) << effect.with.outcome.err;
         for (const Json& term : effect.with.json["effects"]["terms"]) {
           EXPECT_EQ(term["function"]["centre"], Json::array({0.1, -0.2, 0.3}));
         }
         EXPECT_EQ(effect.without.json["effects"]["terms"][0]["function"]["centre"], Json::array({0.0, 0.0, 0.0}));
       },
       Words{"--measurements", "loaded.csv"} + kNoPriors + Words{"--effects", "payload"}},
      {"PayloadCentreMayBeThatOfEachMass",
       {"--payload-centre", "5=0.1,-0.2,0.3,10=0,0,0.4"},
       [](const Effect& effect) {
         ASSERT_FALSE(effect.with.json["effects"]["terms"].empty()) << effect.with.outcome.err;
         for (const Json& term : effect.with.json["effects"]["terms"]) {
           EXPECT_EQ(term["function"], Json::parse(R"({"centres": [{"mass": 5.0, "centre": [0.1, -0.2, 0.3]},
                                                                   {"mass": 10.0, "centre": [0.0, 0.0, 0.4]}]})"));
         }
       },
       Words{"--measurements", "loaded.csv"} + kNoPriors + Words{"--effects", "payload"}},
      {"KnownBaseIsHeld",
       {"--known-base", "known.json"},
       is_library([](auto& o) { o.parameters.known.bases = {{.X_WB = known_base()}}; }),
       kMeasured},
      {"KnownTargetsAreHeldAndOthersFree",
       {"--known-targets", "known.json"},
       is_library([](auto& o) {
         o.parameters.known.targets = targets_at({Eigen::Vector3d(0.1, 0.001, 0.0), Eigen::Vector3d(0.0, 0.0, 0.1)});
       }),
       kMeasured},
  };
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> noise_options() {
  const auto stated = [](auto& o) { o.noise.stated.independent = Eigen::Vector3d::Constant(2e-5); };
  return {
      {"LossHuberWeighsOutliersDown",
       {"--loss", "huber"},
       is_library([](auto& o) { o.estimator.loss = Loss::huber; }),
       kMeasured},
      {"LossIsPlainByItself", {"--loss", "huber"}, is_library([](auto& o) { o.estimator.loss = Loss::huber; }), kOfM},
      {"NoiseEqualIsPlainLeastSquares",
       {"--noise", "equal"},
       is_library([](auto& o) { o.noise.weights = Weights::equal; }, "poses.csv"),
       kPoses},
      {"NoiseIndependentIsOneSigmaOfEveryAxis",
       {"--noise-independent", "3e-5"},
       is_library([](auto& o) { o.noise.stated.independent = Eigen::Vector3d::Constant(3e-5); }),
       kMeasured},
      {"NoiseIndependentIsOneSigmaForEachAxis",
       {"--noise-independent", "1e-5,2e-5,4e-5"},
       is_library([](auto& o) { o.noise.stated.independent = Eigen::Vector3d(1e-5, 2e-5, 4e-5); }),
       kMeasured},
      {"NoiseCommonIsSharedAlongEachAxis",
       {"--noise-common", "1e-5,2e-5,3e-5"},
       is_library([=](auto& o) {
         stated(o);
         o.noise.stated.common = {1e-5, 2e-5, 3e-5};
       }),
       kStated},
      {"NoiseTrackerIsRangeThenTransverse",
       {"--noise-tracker", "1e-5,1e-6,2e-5,3e-6"},
       is_library([](auto& o) {
         o.noise.stated.tracker =
             TrackerNoise{.range = 1e-5, .range_per_metre = 1e-6, .transverse = 2e-5, .transverse_per_metre = 3e-6};
       }),
       kMeasured},
      {"ScaleSigmaIsOfAllLengths",
       {"--scale-sigma", "2e-4"},
       is_library([](auto& o) { o.noise.scale_sigma = 2e-4; }),
       kMeasured},
      {"LengthSigmaIsOfStatedDistances",
       {"--length-sigma", "3e-4"},
       is_library([](auto& o) { o.noise.length_sigma = 3e-4; }),
       kMeasured},
      {"OrientationSigmaIsOfMeasuredPoses",
       {"--orientation-sigma", "3e-4"},
       is_library(
           [=](auto& o) {
             stated(o);
             o.noise.stated.orientation = 3e-4;
           },
           "poses.csv"),
       kPoses + Words{"--noise-independent", "2e-5"}},
      {"DetailsAreOfTheTableAlone", {"--details"}, changes_nothing(), kMeasured},
      {"JointsFileHasTheJointValues",
       {"--joints-file", "joints.csv"},
       is_needed(),
       {"--measurements", "points.csv", "--urdf", kArm, "--effects", "none"}},
      {"PointNamesTellConfigurationAndTarget",
       {"--point-names", "C{configuration}_{target}"},
       is_needed(),
       {"--measurements", "named.csv", "--joints-file", "joints.csv", "--urdf", kArm, "--effects", "none"}},
      {"OrientationSaysWhatThreeNumbersAre",
       {"--orientation", "fixed-xyz"},
       is_contradicted_without(),
       Words{"--measurements", "angles.csv"} + kNoEffects + kNoPriors},
      {"ExcludeLeavesAConfigurationAndAPointOut",
       {"--exclude", "2,3:B"},
       [](const Effect& effect) {
         const auto count = [](const Answer& run) {
           return run.json["position_error"]["train"]["after"]["count"].get<long>();
         };
         EXPECT_EQ(count(effect.with), count(effect.without) - 8);  // of two repeats
       },
       kMeasured},
      {"LeaveOneOutAddsAPrediction",
       {"--leave-one-out"},
       is_library([](auto& o) { o.validation = {.leave_one_out = true, .k_fold = 3}; }),
       kMeasured + Words{"--k-fold", "3"}},
      {"NestedAddsOneWithTheChoicesMadeAnew",
       {"--nested"},
       all_checks(
           is_library([](auto& o) {
             o.validation = {.leave_one_out = true, .nested = true};
             o.selection.automatic_priors = true;
           }),
           changes_only({"position_error/nested_leave_one_out", "new_point/compensated", "new_point/urdf_alone"})),
       kOfM + kNoEffects + Words{"--leave-one-out", "--prior", "auto"}},
      {"KFoldAddsAPrediction",
       {"--k-fold", "2"},
       all_checks(is_library([](auto& o) { o.validation = {.leave_one_out = true, .k_fold = 2}; }),
                  changes_only({"position_error/k_fold", "predicted_accuracy/region/largest_variance",
                                "predicted_accuracy/radius_factor", "predicted_accuracy/budget/of_parameters",
                                "predicted_accuracy/budget/total", "predicted_accuracy/budget/expanded",
                                "predicted_accuracy/unseen/mean", "predicted_accuracy/unseen/rms",
                                "predicted_accuracy/unseen/std", "predicted_accuracy/unseen/p95",
                                "predicted_accuracy/unseen/max", "held_out_points/*/configuration",
                                "held_out_points/*/residual/*", "held_out_points/*/distance"})),
       kMeasured + Words{"--leave-one-out"}},
      {"KFoldOfEveryConfigurationIsLeaveOneOut",
       {"--k-fold", "12"},
       [](const Effect& effect) {
         expect_near(effect.with.json["position_error"]["leave_one_out"]["after"],
                     effect.with.json["position_error"]["k_fold"]["after"], 1e-12);
       },
       kMeasured + Words{"--leave-one-out"}},
      {"ThreadsChangeNothing", {"--threads", "3"}, changes_nothing(), kMeasured + Words{"--leave-one-out"}},
  };
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> file_options() {
  const Words threads = {"--threads", "1"};
  return {
      {"MeasurementsAreFitted", kOfM, is_library([](auto&) {}), kNoEffects + kNoPriors},
      {"JointConventionReadsTheControllersValues",
       {"--joint-convention", "coupled.json"},
       is_needed(),  // what it gives: see kdlcal_conventions_test.cpp
       Words{"--measurements", "controller.csv"} + kNoEffects + kNoPriors},
      {"PredictAtIsWhereTheAccuracyIsAsked",
       {"--predict-at", "asked.csv"},
       all_checks(is_library([](auto& o) {
                    o.predict_at.names = {"first", "second"};
                    o.predict_at.joint_values = Eigen::MatrixXd::Zero(3, 2);
                    o.predict_at.joint_values.col(0) << 0.1, 0.2, 0.3;
                    o.predict_at.joint_values.col(1) << -0.1, 0.0, 0.4;
                  }),
                  changes_only({"predicted_accuracy/asked", "provenance/files_read"})),
       kMeasured},
      {"OutputIsTheCalibratedUrdf",
       {"--output", "c.urdf"},
       [](const Effect& effect) {
         EXPECT_EQ(without_provenance(effect.with.json), without_provenance(effect.without.json));
         ASSERT_EQ(effect.with.files.size(), 1U);
         const ErrorModel model = complete_model(arm());
         const Eigen::VectorXd errors = estimate_in(model, effect.with.json).errors;
         const Eigen::VectorXd q = Eigen::Vector3d(0.3, -0.2, 0.5);
         const Robot written = parse_robot(effect.with.files.at("c.urdf"));
         EXPECT_LT(difference(kdl_pose(written.chain, q), kdl_pose(error_chain(model, errors), q)), 1e-12);
       },
       kMeasured},
      {"ResultIsWhatJsonPrints",
       {"--result", "r.json"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
         ASSERT_EQ(effect.with.files.size(), 1U);
         EXPECT_EQ(effect.with.files.at("r.json"), effect.with.outcome.out);
       },
       kMeasured},
      {"ResidualsAreThoseOfTheRows",
       {"--residuals", "e.csv"},
       writes_rows("e.csv", [](const Json& result) { return result["input"]["observations"].get<std::size_t>(); }),
       kMeasured},
      {"CovarianceIsOfTheColumns",
       {"--covariance", "c.csv"},
       writes_rows("c.csv", [](const Json& result) { return result["covariance"]["names"].size(); }),
       kMeasured},
      {"ReportShowsTheResult",
       {"--report", "c.html"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
         const Json page = data_of_page(effect.with.files.at("c.html"));
         EXPECT_EQ(page["result"]["parameters"], effect.with.json["parameters"]);
       },
       kMeasured},
      {"NoteStandsInTheResult", {"--note", "serial=7"}, changes_only({"provenance/notes/serial"}), kMeasured},
      // Of n configurations an RMS is uncertain by rms / sqrt(2 n): twice that is more than the tenth that is free.
      {"GuardKeepsALimitByTheUncertaintyOfTheNumber",
       {"--guard", "2"},
       [](const Effect& effect) {
         const Json& with = effect.with.json["requirements"][0];
         const double rms = effect.with.json["position_error"]["train"]["after"]["rms"];
         EXPECT_GT(with["uncertainty"].get<double>(), rms / std::sqrt(2.0 * 16.0) * 0.99);
         EXPECT_TRUE(effect.without.json["requirements"][0]["fulfilled"].get<bool>());
         EXPECT_EQ(effect.without.outcome.status, 0);
         EXPECT_LT(rms + 2.0 * with["uncertainty"].get<double>(), 1e-3);
         EXPECT_TRUE(with["fulfilled"].get<bool>());
       },
       kMeasured + Words{"--require", "train.rms<=1mm"}},
      {"RequireDecidesTheStatus",
       {"--require", "rank<21"},
       [](const Effect& effect) {
         EXPECT_THAT(differences(effect.without.json, effect.with.json), ::testing::ElementsAre("requirements"));
         EXPECT_EQ(effect.without.outcome.status, 0);
         EXPECT_EQ(effect.with.outcome.status, 1);
       },
       kMeasured},
      {"ForceOverwrites", {"--force"}, overwrites("old.json", "{"), kMeasured + Words{"--result", "old.json"}},
      {"UrdfIsTheRobot",
       {"--urdf", "longer.urdf"},
       changes({"input/sha256", "parameters/*/nominal", "parameters/*/error"}, {"input/base"}),
       Words{"--measurements", "fanuc.csv"} + kNoEffects + kNoPriors},
      {"DhIsTheRobot",
       {"--dh", "arm_dh.json"},
       [](const Effect& effect) {  // without it, the FANUC of six joints, whose values the file does not have
         EXPECT_EQ(effect.without.outcome.status, 2);
         EXPECT_LT(effect.with.json["position_error"]["test"]["after"]["rms"], 1e-4);
         EXPECT_GT(effect.with.json["position_error"]["test"]["before"]["rms"], 5e-4);
         EXPECT_EQ(effect.with.json["input"]["urdf"], "arm_dh.json");
         EXPECT_EQ(effect.with.json["provenance"]["files_read"][0]["role"], "dh");
       },
       kMeasured},
      {"BaseIsTheFirstLink",
       {"--base", "base_link"},
       changes({"input/base", "base/position/*"}, {"input/tip"}),
       kMeasured + Words{"--urdf", "foot.urdf"}},
      {"TipIsTheLastLink",
       {"--tip", "flange"},
       changes({"input/tip", "targets/*/position/*"}, {"input/base"}),
       kMeasured + Words{"--urdf", "hand.urdf"}},
      {"JsonReplacesTheTable", {"--json"}, turns_the_table_into_json(), kMeasured},
  };
}

std::vector<OptionCase> calibrate_options() {
  std::vector<OptionCase> rows = geometry_options();
  for (const auto& more : {noise_options(), file_options()}) {
    rows.insert(rows.end(), more.begin(), more.end());
  }
  return rows;
}

/// The same with loads of 0, 5 and 10 kg, under which the second joint yields.
Measurements loaded(Measurements points) {
  const Eigen::Index count = points.joint_values.cols();
  points.signals.circumstances = Eigen::MatrixXd::Constant(2, count, Circumstances::kUnknown);
  for (Eigen::Index c = 0; c < count; ++c) {
    const double load = 5.0 * static_cast<double>(c % 3);
    points.signals.circumstances(1, c) = load;
    points.joint_values(1, c) += 1e-4 * load * std::cos(points.joint_values(1, c));
  }
  return points;
}

/// What a test begins with, made once.
const std::map<std::string, std::string>& input_files() {
  static const std::map<std::string, std::string> files = [] {
    const Measurements points =
        measured_fanuc({.sigma = 2e-5, .repeats = 2, .common = {1e-5, 1e-5, 1e-5}}, false, arm());
    const std::string& text = arm().urdf;
    std::string longer = CommandLine::content(kFanuc);
    longer.replace(longer.rfind("0 0 1.075"), 9, "0 0 1.076");
    const CalibrationSettings plain;
    return std::map<std::string, std::string>{
        {kArm, text},
        {"arm_dh.json", dh_of(arm())},
        {"m.csv", measurements_csv(points)},
        {"loaded.csv", measurements_csv(loaded(points))},
        {"joints.csv", joints_csv(points)},
        {"points.csv", points_csv(points, false)},
        {"named.csv", points_csv(points, true)},
        {"fanuc.csv", measurements_csv(measured_fanuc({.sigma = 2e-5}, false))},
        {"controller.csv", in_controller_joints(points, kArmCoupled)},
        {"coupled.json", kArmCoupled},
        {"poses.csv", measurements_csv(measured_fanuc({.sigma = 2e-5, .orientation_sigma = 1e-4}, true, arm()))},
        {"angles.csv", angles_csv(measured_fanuc({.sigma = 2e-5, .orientation_sigma = 1e-4}, true, arm()))},
        {"known.json", R"({"base": {"position": [2.001, 1.0, 0.502], "quaternion_wxyz": [0.6, 0, 0, 0.8]},
      "targets": [{"name": "A", "position": [0.1, 0.001, 0]}, {"name": "B", "position": [0, 0, 0.1]}]})"},
        {"asked.csv", "joint_3,configuration,joint_1,joint_2\n0.3,first,0.1,0.2\n0.4,second,-0.1,0\n"},
        {"old.json", "old"},
        {"prior.json", result_json(arm(), points, calibrate(complete_model(arm()), points, plain))},
        {"longer.urdf", longer},
        {"foot.urdf", with_foot(text)},
        {"hand.urdf", with_hand(text)}};
  }();
  return files;
}

class CalibrateOption : public OptionEffect {
protected:
  void SetUp() override {
    OptionEffect::SetUp();
    write(input_files());
  }
};

TEST_P(CalibrateOption, HasItsEffectAndNoOther) {
  const std::string& option = GetParam().option.front();
  Words command = {"calibrate"};
  command = option == "--threads" ? command : command + Words{"--threads", "1"};
  command = option == "--json" ? command : command + Words{"--json"};
  check_effect_on_arm(command, GetParam());
}
INSTANTIATE_TEST_SUITE_P(Options, CalibrateOption, ::testing::ValuesIn(calibrate_options()), behaviour_of);

TEST_F(OptionsOfKdlcal, OfCalibrateAreAllTested) { expect_a_test_of_every_option("calibrate", calibrate_options()); }

}  // namespace
}  // namespace kdl_calibration::testing::calibrate_test::options

// What is reported beyond the fit, and that src/cli/README.md explains all of it.
namespace kdl_calibration::testing::calibrate_test::reports {
namespace {

using Json = nlohmann::json;
using ::testing::HasSubstr;

using CalibrateReport = CommandLine;

std::set<std::string> matches(const std::string& text, const std::regex& pattern) {
  const std::sregex_token_iterator begin(text.begin(), text.end(), pattern);
  return {begin, {}};
}

// The words in code spans of the command line's README.
std::set<std::string> words_in_code() {
  std::ifstream readme(std::string(PROJECT_DIR) + "/src/cli/README.md");
  std::set<std::string> words;
  bool is_code = false;
  for (std::string span; std::getline(readme, span, '`'); is_code = !is_code) {
    if (is_code) {
      words.merge(matches(span, std::regex("[A-Za-z0-9_-]+")));
    }
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

// Whether --require takes each number below the path, either with a unit or without one.
void expect_requirable(const Json& json, const std::string& path) {
  if (json.is_number()) {
    const auto is_taken = [&](const char* value) {
      return refusal([&] { cli::parse_requirement(path + "<" + value); }) == "nothing was refused";
    };
    EXPECT_NE(is_taken("1"), is_taken("1mm")) << path;
  }
  for (const auto& [key, value] : json.items()) {
    if (json.is_structured() && key != "replaced_by") {
      expect_requirable(value, path.empty() ? key : path + "." + key);
    }
  }
}

TEST_F(CalibrateReport, EveryKeyOfTheResultStandsInTheReadmeAndEveryNumberMayBeRequired) {
  const Words noisy = words_of("simulate --noise 2e-5 --length-sigma 0.001 --angle-sigma 0.001");
  succeed(noisy +
          words_of("--poses --targets 2 --repeats 2 --orientation-noise 1e-4 --configurations 12 --test-configurations "
                   "5 --output m.csv"));
  write("asked.csv", "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n0,0,0,0,0,0\n");
  std::set<std::string> keys;
  const auto read = [&](const Json& json) {
    collect_keys(json, keys);
    expect_requirable(json, "");
  };
  read(
      run_json(words_of("calibrate --measurements m.csv --noise repeats --prior auto --effects auto --leave-one-out "
                        "--nested --k-fold 3 --predict-at asked.csv --json")));
  succeed(noisy + Words{"--output", "points.csv"});
  Measurements points = read_measurements(directory / "points.csv", joint_names(fanuc()));
  points.observations[40].position().y() += 0.01;
  write("mistyped.csv", measurements_csv(points));
  const Outcome mistyped = run({"calibrate", "--measurements", "mistyped.csv", "--method", "two-step", "--json"});
  read(Json::parse(mistyped.out));
  read(Json::parse(run({"calibrate", "--measurements", "mistyped.csv", "--loss", "tukey", "--json"}).out));
  read(Json::parse(run({"validate", "--measurements", "mistyped.csv", "--json"}).out));
  read(Json::parse(run({"calibrate", "--measurements", "points.csv", "--keep-axes", "--json"}).out));
  EXPECT_THAT(keys, ::testing::IsSupersetOf({"findings", "convergence_factor", "asked", "cook", "weights", "matrix",
                                             "nested_leave_one_out", "exported_urdf", "amount", "files_read"}));
  EXPECT_THAT(words_in_code(), ::testing::IsSupersetOf(keys));
}

TEST_F(CalibrateReport, EveryOptionStandsInTheReadme) {
  const std::set<std::string> options = matches(run({"calibrate", "--help"}).out, std::regex("--[a-z0-9-]+"));
  EXPECT_GT(options.size(), 30U);
  EXPECT_THAT(words_in_code(), ::testing::IsSupersetOf(options));
}

}  // namespace
}  // namespace kdl_calibration::testing::calibrate_test::reports

// Provenance, residuals, covariance, requirements; and that results are read back.
namespace kdl_calibration::testing::calibrate_test::results {
namespace {

using Json = nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class CalibrateResult : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    write("m.csv", measurements_csv(without_sigmas(VirtualExperiment().measure(20, {.sigma = 3e-5}))));
  }

  static Words calibrate(const Words& more = {}) { return Words{"calibrate", "--measurements", "m.csv"} + more; }
};

TEST_F(CalibrateResult, NamesWhatItWasMadeFromAndWhatElseWasWritten) {
  const Words command = calibrate({"--note", "serial=R 12,5", "--note", "operator=M\u00fcller", "--output", "c.urdf",
                                   "--residuals", "e.csv", "--result", "r.json"});
  succeed(command);
  const Json provenance = json_of("r.json")["provenance"];
  EXPECT_EQ(provenance["notes"], (Json{{"serial", "R 12,5"}, {"operator", "M\u00fcller"}}));
  const auto file = [&](const char* role, const std::string& path) {
    return Json{{"role", role}, {"path", path}, {"sha256", sha256(text_of(path))}};
  };
  ASSERT_EQ(provenance["files_read"].size(), 2U);
  EXPECT_EQ(provenance["files_read"][0]["role"], "urdf");
  EXPECT_EQ(provenance["files_read"][0]["sha256"], sha256(content(kFanuc)));
  EXPECT_EQ(provenance["files_read"][1], file("measurements", "m.csv"));
  EXPECT_EQ(provenance["files_written"], (Json{file("output", "c.urdf"), file("residuals", "e.csv")}));
  EXPECT_EQ(json_of("r.json")["exported_urdf"]["sha256"], sha256(text_of("c.urdf")));
  const std::string first = text_of("r.json");
  succeed(command + Words{"--force"});
  EXPECT_TRUE(text_of("r.json") == first) << "the same input gave other bytes";
}

// Each file of known frames by its own role, whether the other one is given or not.
TEST_F(CalibrateResult, NamesTheFilesOfKnownBaseAndKnownTargets) {
  const std::string base = R"({"base": {"position": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}})";
  const std::string targets = R"({"targets": [{"name": "A", "position": [0.1, 0, 0]}]})";
  write({{"base.json", base}, {"targets.json", targets}});
  const Json of_base = {{"role", "known-base"}, {"path", "base.json"}, {"sha256", sha256(base)}};
  const Json of_targets = {{"role", "known-targets"}, {"path", "targets.json"}, {"sha256", sha256(targets)}};
  for (const auto& files : {std::vector<Json>{of_base}, {of_targets}, {of_base, of_targets}}) {
    Words options = words_of("--effects none --prior none --json");
    for (const Json& file : files) {
      options = options + Words{"--" + file["role"].get<std::string>(), file["path"]};
    }
    const Json read = Json::parse(run(calibrate(options)).out)["provenance"]["files_read"];
    ASSERT_EQ(read.size(), 2 + files.size()) << read;
    EXPECT_TRUE(std::equal(files.begin(), files.end(), read.begin() + 2)) << read;
  }
}

TEST_F(CalibrateResult, NamesTheFileThatItsOptionsCameFrom) {
  write("options.toml", "[calibrate]\nnoise = \"equal\"\n");
  succeed(Words{"--config", "options.toml"} + calibrate({"--result", "r.json"}));
  const Json files = json_of("r.json")["provenance"]["files_read"];
  ASSERT_EQ(files.size(), 3U);
  EXPECT_EQ(files[2]["role"], "config");
  EXPECT_EQ(files[2]["sha256"], sha256(text_of("options.toml")));
  EXPECT_EQ(json_of("r.json")["noise"]["model"], "residuals");
}

TEST_F(CalibrateResult, RefusesCentresThatArePayloadsOfNothing) {
  succeed(words_of("simulate --configurations 12 --effects payload --output loaded.csv"));  // 0, 5 and 10 kg
  const auto with = [](const char* centres) {
    return Words{"calibrate", "--measurements", "loaded.csv", "--payload-centre", centres};
  };
  const char* expected = "expected x,y,z or MASS=x,y,z for each payload, in m and kg";
  expect_refused(with("5=0,0,0.1"), {"--payload-centre", "no centre for the measured payload of 10 kg"});
  expect_refused(with("5=0,0,0.1,5=0,0,0.2"), {"--payload-centre: 5 kg is there twice"});
  expect_refused(with("0,0,0.1,10=0,0,0.2"), {"--payload-centre", "expected a mass before each centre"});
  expect_refused(with("5=0,0,10=0,0,0.2"), {"--payload-centre: has 2 values, expected 3"});
  expect_refused(with("0,0,0.1,0.2"), {"--payload-centre: has 4 values, expected 3"});
  expect_refused(with("five=0,0,0"), {"--payload-centre", expected});
  expect_refused(with("5=0,0,1e9"), {"--payload-centre", expected});
  expect_refused(with("-5=0,0,0.1"), {"--payload-centre", "a mass of -5 kg, expected one above 0"});
}

TEST_F(CalibrateResult, RefusesNotesThatAreNone) {
  expect_refused(calibrate({"--note", "serial"}), {"--note", "'serial'", "key=value"});
  expect_refused(calibrate({"--note", "=5"}), {"--note", "'=5'", "key=value"});
  expect_refused(calibrate({"--note", "a=1", "--note", "a=2"}), {"--note", "'a'", "once"});
}

TEST_F(CalibrateResult, WritesResidualsAndCovarianceAsInTheResult) {
  ASSERT_EQ(run(calibrate({"--residuals", "e.csv", "--covariance", "c.csv", "--result", "r.json"})).status, 0);
  const Json result = json_of("r.json");
  const auto rows = cells_of(text_of("e.csv"));
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
  const auto matrix = cells_of(text_of("c.csv"));
  const Json& names = result["covariance"]["names"];
  ASSERT_EQ(matrix.size(), names.size() + 1);
  for (std::size_t r = 0; r < names.size(); ++r) {
    EXPECT_EQ(matrix[0][r + 1], names[r]);
    EXPECT_EQ(matrix[r + 1][0], names[r]);
    for (std::size_t c = 0; c <= r; ++c) {
      EXPECT_EQ(std::stod(matrix[r + 1][c + 1]), result["covariance"]["matrix"][r][c]);
      EXPECT_EQ(result["covariance"]["matrix"][c][r], result["covariance"]["matrix"][r][c]);
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
      words = words + Words{"--require", requirement};
    }
    return run(words);
  };
  const std::string path = "position_error.leave_one_out.after.rms";
  const std::string least = std::to_string(rms * 0.99) + "mm";
  EXPECT_EQ(with({path + "<=" + std::to_string(rms * 1.01) + "mm", path + ">=" + least, "parameters.0.std<1 mm",
                  "noise.sigma<50um", "targets.0.position.0<0.2m"})
                .status,
            0);
  EXPECT_EQ(with({path + " < " + least}).status, 1);
  const Outcome missed = with({"rank == 33", "rank==32", "test.rms<1mm"});
  EXPECT_EQ(missed.status, 1);
  EXPECT_THAT(lines_of(missed.err), ElementsAre("kdlcal: required: 'rank==32' is not fulfilled: the value is 33",
                                                "kdlcal: required: 'test.rms<1mm' is not fulfilled: the value is not "
                                                "determined, as no rows are marked as test"));
  EXPECT_THAT(missed.out, HasSubstr("Trusted. Calibration of"));
  EXPECT_THAT(missed.out, HasSubstr("required rank == 33: 33, met\nrequired rank==32: 33, NOT met\n"));
}

TEST_F(CalibrateResult, SaysWhatBecameOfEveryRequirement) {
  ASSERT_EQ(run(calibrate({"--result", "r.json", "--require", "rank==32,noise.sigma<50um"})).status, 1);
  Json judged = json_of("r.json");
  EXPECT_EQ(judged["requirements"][0]["fulfilled"], false);
  EXPECT_EQ(judged["requirements"][1]["fulfilled"], true);
  EXPECT_EQ(judged["trusted"], true) << "which nothing was required of";
  ASSERT_EQ(run(calibrate({"--result", "plain.json"})).status, 0);
  Json plain = json_of("plain.json");
  judged.erase("requirements");
  EXPECT_EQ(judged["hashes"].erase("requirements"), 1U);
  EXPECT_NE(judged["hashes"]["hashes"], plain["hashes"]["hashes"]) << "that of the list itself";
  for (Json* each : {&judged, &plain}) {
    (*each)["hashes"].erase("hashes");
  }
  EXPECT_EQ(judged, plain);
}

Json with_cause(const Json& found, Cause cause) {
  const auto first =
      std::find_if(found.begin(), found.end(), [&](const Json& one) { return one["cause"] == to_string(cause); });
  EXPECT_NE(first, found.end()) << to_string(cause) << " is not among " << found;
  return first != found.end() ? *first : Json();
}

Json subject(const char* kind, const std::string& name) { return {{"kind", kind}, {"name", name}}; }

/// Subjects and figures as the file states them, of what is read back.
void expect_read_back(const std::vector<Doubt>& read, const Json& written) {
  ASSERT_EQ(read.size(), written.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    Json subjects = Json::array();
    for (const Subject& one : read[i].subjects) {
      subjects.push_back(subject(to_string(one.kind), one.name));
    }
    Json figures = Json::object();
    for (const NamedFigure& figure : read[i].figures) {
      figures[figure.name] = std::isfinite(figure.value) ? Json(figure.value) : Json(nullptr);
    }
    EXPECT_EQ(to_string(read[i].cause), written[i]["cause"]);
    EXPECT_EQ(subjects, written[i]["subjects"]) << written[i];
    EXPECT_EQ(figures, written[i]["figures"]) << written[i];
  }
}

TEST_F(CalibrateResult, NamesAMistypedCoordinateForPrograms) {
  Measurements mistyped = without_sigmas(VirtualExperiment().measure(20, {.sigma = 3e-5}));
  mistyped.observations[40].position().y() += 0.01;
  write("m.csv", measurements_csv(mistyped));
  const Words require = {"--require", "doubts.0.figures.misfit_without<0.1mm"};
  ASSERT_EQ(run(calibrate(words_of("--effects none --result r.json") + require)).status, 1);
  const Json result = json_of("r.json");
  EXPECT_EQ(result["requirements"][0]["fulfilled"], true);
  const Json gross = with_cause(result["doubts"], Cause::gross_rows);
  EXPECT_EQ(gross["subjects"], (Json{subject("configuration", "14"), subject("target", "B")}));
  EXPECT_NEAR(gross["figures"]["distance"].get<double>(), 0.01, 1e-3);
  EXPECT_THAT(gross["message"].get<std::string>(), ::testing::EndsWith(" leave it out with --exclude '14:B'"));
  const Json wrong = with_cause(result["remarks"], Cause::wrong_rows);
  EXPECT_EQ(wrong["subjects"],
            (Json{subject("configuration", "14"), subject("target", "B"), subject("coordinate", "y")}));
  EXPECT_NEAR(wrong["figures"]["estimate"].get<double>(), 0.01, 1e-3);
  EXPECT_EQ(result["remarks"].size(), result["warnings"].size());
  const CalibrationParts read = read_calibration(directory / "r.json", fanuc());
  expect_read_back(read.doubts, result["doubts"]);
  expect_read_back(read.remarks, result["remarks"]);
  EXPECT_EQ(Json(messages_of(read.remarks)), result["warnings"]);
}

// 2 mm along the flange's x, behind the twelfth configuration.
TEST_F(CalibrateResult, NamesASlippedTargetForPrograms) {
  VirtualExperiment experiment;
  Measurements slipped = without_sigmas(experiment.measure(30, {.sigma = 3e-5}));
  const VirtualRobot& robot = experiment.robot;
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(robot.model, robot.truth, slipped);
  for (Observation& row : slipped.observations) {
    if (row.configuration >= 12 && row.target == 0) {
      row.position() += robot.truth.frames.base().linear() *
                        (X_BF[static_cast<std::size_t>(row.configuration)].linear() * Eigen::Vector3d(0.002, 0.0, 0.0));
    }
  }
  write("m.csv", measurements_csv(slipped));
  const Json result = Json::parse(run(calibrate({"--json"})).out);
  const Json moved = with_cause(result["doubts"], Cause::moved_target);
  EXPECT_EQ(moved["subjects"], (Json{subject("target", "A"), subject("configuration", "12")}));
  const Json& figures = moved["figures"];
  EXPECT_NEAR(figures["estimate"].get<double>(), 0.002, 3.0 * figures["estimate_sigma"].get<double>());
  EXPECT_GT(figures["moves"], figures["radius"]);
}

TEST_F(CalibrateResult, ThatWasEditedIsRefusedWhereverItIsRead) {
  ASSERT_EQ(run(calibrate(words_of("--result r.json --require rank==33 --covariance v.csv --residuals e.csv --note "
                                   "serial=7 --output c.urdf")))
                .status,
            0);
  const std::vector<Words> readers = {
      {"fk", "--joints", "0,0,0,0,0,0", "--result", "r.json"},
      {"jacobian", "--joints", "0,0,0,0,0,0", "--result", "r.json"},
      {"validate", "--measurements", "m.csv", "--result", "r.json"},
      {"validate", "--result", "r.json", "--truth", "r.json"},
      words_of("plan --result r.json --configurations 2 --candidates 50 --workspace 20 --starts 1"),
      {"report", "--result", "r.json", "--output", "p.html", "--force"},
      calibrate({"--known-base", "r.json", "--known-targets", "r.json", "--effects", "none", "--prior", "none"})};
  Json result = json_of("r.json");
  result["provenance"]["notes"]["serial"] = "8";
  write("r.json", result.dump());
  for (const Words& reader : readers) {
    EXPECT_LE(run(reader).status, 1) << ::testing::PrintToString(reader);
  }
  result["targets"][0]["position"][1] = 0.5;
  write("r.json", result.dump());
  for (const Words& reader : readers) {
    expect_refused(reader, {"r.json: targets: was changed after calibrate wrote the file, expected the original"});
  }
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
  expect_near(run_json(fk + Words{"--result", "r.json"})["frames"].back()["position"],
              run_json(fk + Words{"--urdf", "c.urdf"})["frames"].back()["position"], 1e-12);
  for (const char* subcommand : {"fk", "jacobian"}) {
    expect_refused({subcommand, "--joints", "0,0,0,0,0,0", "--urdf", "c.urdf", "--result", "r.json"},
                   {"r.json: was not made with c.urdf", "hash"});
  }
  expect_refused({"validate", "--urdf", "c.urdf", "--result", "r.json", "--measurements", "m.csv"}, {"r.json", "hash"});
}

TEST_F(CalibrateResult, FkMovesAndTiltsTheJointsAsTheResultSays) {
  for (const char* effect : {"transverse", "gain"}) {
    succeed({"simulate", "--configurations", "40", "--targets", "2", "--effects", effect, "--effect-sigma", "0.0005",
             "--output", "m.csv", "--force"});
    ASSERT_EQ(run(calibrate({"--effects", effect, "--prior", "none", "--result", "r.json", "--force"})).status, 0);
    const Json fk = run_json({"fk", "--joints", "0.1,0.2,0.3,0.4,0.5,0.6", "--json", "--result", "r.json"});
    const CalibrationParts saved = read_calibration(directory / "r.json", fanuc());
    const Eigen::VectorXd q{{0.1, 0.2, 0.3, 0.4, 0.5, 0.6}};
    const Eigen::Vector3d expected =
        ArmKinematics(saved.model, saved.estimate.errors, saved.estimate.effects).flange_pose(q).translation();
    const Eigen::Vector3d rigid = ArmKinematics(saved.model, saved.estimate.errors, {}).flange_pose(q).translation();
    EXPECT_LT((vector_of(fk["frames"].back()["position"]) - expected).norm(), 1e-9) << effect;
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

}  // namespace
}  // namespace kdl_calibration::testing::calibrate_test::results
