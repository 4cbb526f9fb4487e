// Each option of calibrate changes what it should and nothing else; see cli_options_support.hpp.

#include <Eigen/Geometry>

#include "cli_options_support.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/measurements_file.hpp"
#include "kdl_calibration/measuring_plan.hpp"
#include "kdl_calibration/result_json.hpp"
#include "report_page_support.hpp"

namespace kdl_calibration::testing::cli_calibrate_options_test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

using Set = std::function<void(CalibrationOptions& options)>;

std::string library_result(const std::filesystem::path& directory, const std::string& file,
                           const CalibrationOptions& options) {
  const Robot& robot = arm();
  const Measurements measurements =
      parse_measurements(CommandLine::content(directory / file), joint_names(robot), nullptr, file);
  return result_json(robot, measurements, options, calibrate(complete_model(robot), measurements, options));
}

/// The library does not know which files it was about.
Json without_provenance(Json result) {
  result.erase("provenance");
  return result;
}

/// The result is the one of the library with this option set, to the last digit, and another one than without it.
Check is_library(const Set& set, const std::string& file = "m.csv") {
  return [=](const Effect& effect) {
    CalibrationOptions options;
    options.threads = 1;
    set(options);
    const Json expected = Json::parse(library_result(effect.directory, file, options));
    EXPECT_THAT(differences(without_provenance(expected), without_provenance(effect.with.json)), ::testing::IsEmpty());
    EXPECT_NE(effect.with.json, effect.without.json);
    EXPECT_TRUE(effect.with.files.empty());
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

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> geometry_options() {
  const auto error_of = [](const Answer& run, const std::string& name) {
    for (const Json& parameter : run.json["parameters"]) {
      if (parameter["name"] == name) {
        return parameter["error"].get<double>();
      }
    }
    return std::numeric_limits<double>::quiet_NaN();
  };
  return {
      {"MethodTwoStepIsTheOther",
       {"--method", "two-step"},
       both_checks(is_library([](auto& o) {
                     o.method = Method::two_step;
                     o.iterations = 5;
                   }),
                   [](const Effect& effect) { EXPECT_EQ(effect.with.json["iterations"], 5); }),
       kMeasured + Words{"--iterations", "5"}},
      {"MethodTwoStepIsPlainByItself",
       {"--method", "two-step"},
       is_library([](auto& o) {
         o.method = Method::two_step;
         o.iterations = 5;
       }),
       kOfM + Words{"--iterations", "5"}},
      {"IterationsAreTheLimit",
       {"--iterations", "2"},
       both_checks(is_library([](auto& o) { o.iterations = 2; }),
                   [](const Effect& effect) {
                     EXPECT_EQ(effect.with.json["iterations"], 2);
                     EXPECT_EQ(effect.with.json["termination"], "iteration_limit");
                     EXPECT_EQ(effect.with.outcome.status, 1);
                     EXPECT_EQ(effect.without.outcome.status, 0);
                   }),
       kMeasured},
      {"ModelCompleteHasEveryParameter",
       {"--model", "complete"},
       is_library([](auto& o) { o.model = ModelChoice::complete; }),
       kMeasured},
      {"ModelCompleteIsPlainByItself",
       {"--model", "complete"},
       is_library([](auto& o) { o.model = ModelChoice::complete; }),
       kOfM},
      {"FixHoldsParametersAtZero",
       {"--fix", "dq2,*2"},
       both_checks(is_library([](auto& o) {
                     o.fix = {"dq2", "*2"};
                   }),
                   [=](const Effect& effect) {
                     for (const char* name : {"dq2", "Tz2", "Rz2", "Ry2"}) {
                       EXPECT_NE(error_of(effect.without, name), 0.0) << name;
                       EXPECT_FALSE(error_of(effect.with, name) != 0.0 && !std::isnan(error_of(effect.with, name)))
                           << name;
                     }
                     EXPECT_NE(error_of(effect.with, "Ty1"), 0.0);
                   }),
       kMeasured},
      {"FreeAddsParameters", {"--free", "Rx1"}, is_library([](auto& o) { o.free = {"Rx1"}; }), kMeasured},
      {"PriorLengthIsOfLengths",
       {"--prior-length", "0.0005"},
       both_checks(is_library([](auto& o) { o.priors.length = 5e-4; }),
                   changes({"priors/length"}, {"priors/angle", "input"})),
       kMeasured},
      {"PriorAngleIsOfAngles",
       {"--prior-angle", "0.0007"},
       both_checks(is_library([](auto& o) { o.priors.angle = 7e-4; }),
                   changes({"priors/angle"}, {"priors/length", "input"})),
       kMeasured},
      {"PriorsThatAreStatedAreNotChosen",
       {"--prior-length", "0.0005"},
       is_library([](auto& o) { o.priors.length = 5e-4; }),
       kOfM + kNoEffects},
      {"PriorsOfAnglesThatAreStatedAreNotChosen",
       {"--prior-angle", "0.0007"},
       is_library([](auto& o) { o.priors.angle = 7e-4; }),
       kOfM + kNoEffects},
      {"AutoIsWhatIsDoneWhereNothingIsSaid", {"--prior", "auto", "--effects", "auto"}, changes_nothing(), kOfM},
      {"PriorNoneIsNone", {"--prior", "none"}, is_library([](auto&) {}), kOfM + kNoEffects},
      {"NothingSaidIsAllAutomatic",
       {"--threads", "1"},
       [](const Effect& effect) {
         CalibrationOptions options{.automatic_priors = true, .effects = {.groups = {}, .automatic = true}};
         const Json expected = Json::parse(library_result(effect.directory, "m.csv", options));
         EXPECT_EQ(without_provenance(expected), without_provenance(effect.with.json));
       },
       kOfM},
      {"EffectsOfAGroup",
       {"--effects", "gravity"},
       is_library([](auto& o) { o.effects.groups = {EffectGroup::gravity}; }),
       kOfM + kNoPriors},
      {"EffectsOfSomeGroups",
       {"--effects", "harmonics,gain"},
       is_library([](auto& o) {
         o.effects.groups = {EffectGroup::gain, EffectGroup::harmonics};
       }),
       kOfM + kNoPriors},
      {"EffectsNoneAreNone", {"--effects", "none"}, is_library([](auto&) {}), kOfM + kNoPriors},
      {"GravityDirectionIsThatOfTheSag",
       {"--gravity-direction", "1,2,-2"},
       both_checks(changes({"effects/gravity_direction/*", "effects/terms"}, {"input", "findings"}),
                   [](const Effect& effect) {
                     const Json& direction = effect.with.json["effects"]["gravity_direction"];
                     for (std::size_t axis = 0; axis < 3; ++axis) {
                       EXPECT_NEAR(direction[axis], (axis == 0 ? 1.0 : axis == 1 ? 2.0 : -2.0) / 3.0, 1e-15) << axis;
                     }
                   }),
       kOfM + kNoPriors + Words{"--effects", "gravity"}},
      {"KnownBaseIsHeld",
       {"--known-base", "known.json"},
       is_library([](auto& o) { o.known_base = known_base(); }),
       kMeasured},
      {"KnownTargetsAreHeldAndOthersFree",
       {"--known-targets", "known.json"},
       is_library([](auto& o) {
         o.known_targets = targets_at({Eigen::Vector3d(0.1, 0.001, 0.0), Eigen::Vector3d(0.0, 0.0, 0.1)});
       }),
       kMeasured},
  };
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> noise_options() {
  const auto stated = [](auto& o) { o.noise.independent = Eigen::Vector3d::Constant(2e-5); };
  return {
      {"LossHuberWeighsOutliersDown",
       {"--loss", "huber"},
       is_library([](auto& o) { o.loss = Loss::huber; }),
       kMeasured},
      {"LossIsPlainByItself", {"--loss", "huber"}, is_library([](auto& o) { o.loss = Loss::huber; }), kOfM},
      {"LossTukeyWeighsOutliersDown",
       {"--loss", "tukey"},
       is_library([](auto& o) { o.loss = Loss::tukey; }),
       kMeasured},
      {"NoiseEqualIsPlainLeastSquares",
       {"--noise", "equal"},
       is_library([](auto& o) { o.weights = Weights::equal; }, "poses.csv"),
       kPoses},
      {"NoiseIndependentIsOneSigmaOfEveryAxis",
       {"--noise-independent", "3e-5"},
       both_checks(is_library([](auto& o) { o.noise.independent = Eigen::Vector3d::Constant(3e-5); }),
                   [](const Effect& effect) {
                     EXPECT_NEAR(effect.with.json["noise"]["independent"][1].get<double>(), 3e-5, 1e-15);
                   }),
       kMeasured},
      {"NoiseIndependentIsOneSigmaForEachAxis",
       {"--noise-independent", "1e-5,2e-5,4e-5"},
       both_checks(is_library([](auto& o) {
                     o.noise.independent = {1e-5, 2e-5, 4e-5};
                   }),
                   [](const Effect& effect) {
                     const Json ratio = effect.with.json["noise"]["independent"];
                     EXPECT_NEAR(ratio[1].get<double>() / ratio[0].get<double>(), 2.0, 1e-9);
                     EXPECT_NEAR(ratio[2].get<double>() / ratio[0].get<double>(), 4.0, 1e-9);
                   }),
       kMeasured},
      {"NoiseCommonIsSharedAlongEachAxis",
       {"--noise-common", "1e-5,2e-5,3e-5"},
       is_library([=](auto& o) {
         stated(o);
         o.noise.common = {1e-5, 2e-5, 3e-5};
       }),
       kStated},
      {"NoiseCommonGoesWithThatOfATracker",
       {"--noise-common", "1e-5"},
       is_library([](auto& o) {
         o.noise.tracker = TrackerNoise{.range = 1e-5, .range_per_metre = 0.0, .transverse = 2e-5};
         o.noise.common = {1e-5, 1e-5, 1e-5};
       }),
       kMeasured + Words{"--noise-tracker", "1e-5,0,2e-5,0"}},
      {"NoiseTrackerIsRangeThenTransverse",
       {"--noise-tracker", "1e-5,1e-6,2e-5,3e-6"},
       is_library([](auto& o) {
         o.noise.tracker =
             TrackerNoise{.range = 1e-5, .range_per_metre = 1e-6, .transverse = 2e-5, .transverse_per_metre = 3e-6};
       }),
       kMeasured},
      {"OrientationSigmaIsOfMeasuredPoses",
       {"--orientation-sigma", "3e-4"},
       is_library(
           [=](auto& o) {
             stated(o);
             o.noise.orientation = 3e-4;
           },
           "poses.csv"),
       kPoses + Words{"--noise-independent", "2e-5"}},
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
       both_checks(
           is_library([](auto& o) {
             o.leave_one_out = true;
             o.k_fold = 3;
           }),
           changes({"position_error/leave_one_out", "exported_urdf/position_error/held_out/rms"},
                   {"parameters", "position_error/train", "position_error/k_fold", "exported_urdf/parameters"})),
       kMeasured + Words{"--k-fold", "3"}},
      {"NestedAddsOneWithTheChoicesMadeAnew",
       {"--nested"},
       both_checks(is_library([](auto& o) {
                     o.leave_one_out = true;
                     o.nested = true;
                     o.automatic_priors = true;
                   }),
                   changes_only({"position_error/nested_leave_one_out"})),
       kOfM + kNoEffects + Words{"--leave-one-out", "--prior", "auto"}},
      {"NestedLeavesOneOutAsWell",
       {"--nested"},
       both_checks(is_library([](auto& o) {
                     o.leave_one_out = true;
                     o.nested = true;
                     o.automatic_priors = true;
                     o.k_fold = 3;
                   }),
                   changes({"position_error/leave_one_out", "position_error/nested_leave_one_out"},
                           {"parameters", "position_error/train", "position_error/k_fold"})),
       kOfM + kNoEffects + Words{"--k-fold", "3", "--prior", "auto"}},
      {"KFoldAddsAPrediction",
       {"--k-fold", "2"},
       both_checks(is_library([](auto& o) {
                     o.leave_one_out = true;
                     o.k_fold = 2;
                   }),
                   changes_only({"position_error/k_fold", "held_out_points/*/configuration",
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
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.outcome.status, 2);
         CalibrationOptions options;
         options.threads = 1;
         Json expected = Json::parse(library_result(effect.directory, "m.csv", options));
         expected["input"]["measurements"] = "controller.csv";
         for (const char* part : {"parameters", "base", "targets", "position_error", "input", "rank"}) {
           expect_near(expected[part], effect.with.json[part], 1e-9, part);
         }
       },
       Words{"--measurements", "controller.csv"} + kNoEffects + kNoPriors},
      {"PredictAtIsWhereTheAccuracyIsAsked",
       {"--predict-at", "asked.csv"},
       both_checks(is_library([](auto& o) {
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
         Eigen::VectorXd errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
         for (const Json& parameter : effect.with.json["parameters"]) {
           const std::string name = parameter["name"];
           if (name.find('.') == std::string::npos) {
             errors[static_cast<Eigen::Index>(parameter_index(model, name))] = parameter["error"];
           }
         }
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
       [](const Effect& effect) {
         EXPECT_THAT(differences(effect.without.json, effect.with.json),
                     ::testing::UnorderedElementsAre("provenance/files_written"));
         const std::string csv = effect.with.files.at("e.csv");
         EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 1 + effect.with.json["input"]["observations"].get<long>());
       },
       kMeasured},
      {"CovarianceIsOfTheColumns",
       {"--covariance", "c.csv"},
       [](const Effect& effect) {
         EXPECT_THAT(differences(effect.without.json, effect.with.json),
                     ::testing::UnorderedElementsAre("provenance/files_written"));
         const std::string csv = effect.with.files.at("c.csv");
         EXPECT_EQ(static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n')),
                   1 + effect.with.json["covariance"]["names"].size());
       },
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
      {"RequireDecidesTheStatus",
       {"--require", "rank<21"},
       [](const Effect& effect) {
         EXPECT_THAT(differences(effect.without.json, effect.with.json), ::testing::ElementsAre("requirements"));
         EXPECT_EQ(effect.without.outcome.status, 0);
         EXPECT_EQ(effect.with.outcome.status, 1);
       },
       kMeasured},
      {"ForceOverwrites",
       {"--force"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.outcome.status, 2);
         EXPECT_TRUE(effect.without.files.empty());
         EXPECT_EQ(effect.with.outcome.status, 0);
         EXPECT_EQ(effect.with.files.at("old.json"), effect.with.outcome.out);
       },
       kMeasured + Words{"--result", "old.json"}},
      {"UrdfIsTheRobot",
       {"--urdf", "longer.urdf"},
       [](const Effect& effect) {  // what is longer in the file is found the shorter
         const auto find = [](const Json& parameters) {
           return *std::find_if(parameters.begin(), parameters.end(), [](const Json& p) { return p["name"] == "Tz2"; });
         };
         const Json without = find(effect.without.json["parameters"]);
         const Json with = find(effect.with.json["parameters"]);
         EXPECT_NEAR(without["nominal"], 1.075, 1e-15);
         EXPECT_NEAR(with["nominal"], 1.076, 1e-15);
         EXPECT_NEAR(with["value"], without["value"], 1e-8);
         EXPECT_NE(effect.with.json["input"]["sha256"], effect.without.json["input"]["sha256"]);
       },
       Words{"--measurements", "fanuc.csv"} + kNoEffects + kNoPriors},
      {"BaseIsTheFirstLink",
       {"--base", "base_link"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.json["input"]["base"], "foot");
         EXPECT_EQ(effect.with.json["input"]["base"], "base_link");
         expect_near(effect.without.json["position_error"]["train"], effect.with.json["position_error"]["train"], 1e-9);
         const Json& foot = effect.without.json["base"]["position"];
         const Json& base = effect.with.json["base"]["position"];
         EXPECT_NEAR(
             std::hypot(foot[0].get<double>() - base[0].get<double>(), foot[1].get<double>() - base[1].get<double>(),
                        foot[2].get<double>() - base[2].get<double>()),
             0.3, 1e-7);
       },
       kMeasured + Words{"--urdf", "foot.urdf"}},
      {"TipIsTheLastLink",
       {"--tip", "flange"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.json["input"]["tip"], "hand");
         EXPECT_EQ(effect.with.json["input"]["tip"], "flange");
         EXPECT_NEAR(effect.with.json["targets"][0]["position"][1].get<double>() -
                         effect.without.json["targets"][0]["position"][1].get<double>(),
                     0.2, 1e-7);
       },
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

/// Files of options. Each option shows in what is written with one of them, but for --threads.
std::vector<Words> files_of_options() {
  return {
      words_of("--measurements m.csv --urdf foot.urdf --base base_link --effects none --fix dq2,*2 --free Rx1 "
               "--prior-length 0.0005 --prior-angle 0.0007 --known-base known.json --known-targets known.json "
               "--noise-tracker 1e-5,1e-6,2e-5,3e-6 --noise-common 1e-5,2e-5,3e-5 --predict-at asked.csv "
               "--loss huber --leave-one-out --k-fold 3 --output c.urdf --result old.json --force --residuals e.csv "
               "--covariance c.csv --report c.html --note serial=7 --require rank<21 --json"),
      words_of(
          "--measurements poses.csv --urdf hand.urdf --tip flange --effects none --nested --noise-independent 3e-5 "
          "--noise-common 1e-5 --orientation-sigma 3e-4 --json"),
      words_of("--measurements controller.csv --urdf arm.urdf --joint-convention coupled.json --effects gravity "
               "--gravity-direction 1,2,-2 --noise-independent 1e-5,2e-5,4e-5 --json"),
      words_of(
          "--measurements m.csv --urdf arm.urdf --method two-step --iterations 2 --model complete --threads 1 --json"),
      words_of("--measurements poses.csv --urdf arm.urdf --effects none --noise equal --prior none "
               "--exclude 2,3:B --json"),
  };
}

/// What a test begins with, made once.
const std::map<std::string, std::string>& input_files() {
  static const std::map<std::string, std::string> files = [] {
    const Measurements points =
        measured_fanuc({.sigma = 2e-5, .repeats = 2, .common = {1e-5, 1e-5, 1e-5}}, false, arm());
    const std::string& text = arm().urdf;
    std::string longer = CommandLine::content(kFanuc);
    longer.replace(longer.rfind("0 0 1.075"), 9, "0 0 1.076");
    return std::map<std::string, std::string>{
        {kArm, text},
        {"m.csv", measurements_csv(points)},
        {"fanuc.csv", measurements_csv(measured_fanuc({.sigma = 2e-5}, false))},
        {"controller.csv", in_controller_joints(points, kArmCoupled)},
        {"coupled.json", kArmCoupled},
        {"poses.csv", measurements_csv(measured_fanuc({.sigma = 2e-5, .orientation_sigma = 1e-4}, true, arm()))},
        {"known.json", R"({"base": {"position": [2.001, 1.0, 0.502], "quaternion_wxyz": [0.6, 0, 0, 0.8]},
      "targets": [{"name": "A", "position": [0.1, 0.001, 0]}, {"name": "B", "position": [0, 0, 0.1]}]})"},
        {"asked.csv", "joint_3,configuration,joint_1,joint_2\n0.3,first,0.1,0.2\n0.4,second,-0.1,0\n"},
        {"old.json", "old"},
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

TEST_F(OptionsOfKdlcal, OfCalibrateDoTheSameInAFile) {
  write(input_files());
  expect_the_same_from_files("calibrate", files_of_options());
}

TEST_F(OptionsOfKdlcal, OfCalibrateAreAllTested) {
  expect_a_test_of_every_option("calibrate", calibrate_options());
  expect_a_test_of_every_option("calibrate", options_of(files_of_options()));
}

}  // namespace
}  // namespace kdl_calibration::testing::cli_calibrate_options_test
