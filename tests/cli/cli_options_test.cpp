// Each option of model, fk, jacobian and validate changes what it should and nothing else; see cli_options_support.hpp.

#include <Eigen/Geometry>
#include <kdl/frames.hpp>

#include "cli_options_support.hpp"
#include "kdl_calibration/measurements_file.hpp"
#include "kdl_calibration/registration.hpp"
#include "kdl_calibration/validation.hpp"
#include "report_page_support.hpp"

namespace kdl_calibration::testing::cli_options_test {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

TEST_F(OptionsOfKdlcal, EverySubcommandHasATable) {
  std::istringstream help(run({"--help"}).out);
  std::vector<std::string> names;
  bool subcommands = false;
  for (std::string line; std::getline(help, line);) {
    subcommands = subcommands || line.rfind("Subcommands:", 0) == 0;
    if (subcommands && line.rfind("  ", 0) == 0 && line[2] != ' ') {
      names.push_back(line.substr(2, line.find(' ', 2) - 2));
    }
  }
  EXPECT_THAT(names, ElementsAre("model", "fk", "jacobian", "simulate", "calibrate", "validate", "plan",
                                 "report"));  // of which cli_report_test tells
}

// ---- model ---------------------------------------------------------------------------------------------------------

std::vector<OptionCase> model_options() {
  const auto rank = [](int without, int with) {
    return [=](const Effect& effect) {
      EXPECT_EQ(effect.without.json["rank"], without);
      EXPECT_EQ(effect.with.json["rank"], with);
    };
  };
  const auto loses = [](const std::string& joint) {
    return [joint](const Effect& effect) {
      EXPECT_THAT(effect.without.outcome.out, HasSubstr("\"" + joint + "\""));
      EXPECT_THAT(effect.with.outcome.out, Not(HasSubstr("\"" + joint + "\"")));
    };
  };
  return {
      {"UrdfIsTheRobot", {"--urdf", "odd.urdf"}, loses("joint_2")},
      {"BaseIsTheFirstLink", {"--base", "link_1"}, loses("joint_1")},
      {"TipIsTheLastLink", {"--tip", "link_5"}, loses("joint_6")},
      {"TargetsAreThree", {"--targets", "3"}, changes_nothing()},
      {"OneTargetShowsLess", {"--targets", "1"}, rank(33, 27)},
      {"PosesShowWhatPointsDo",
       {"--poses"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.json["rank"], 33 + 3 * 3);
         EXPECT_THAT(effect.with.outcome.out, HasSubstr("\"C.Rz\""));
         EXPECT_THAT(effect.without.outcome.out, Not(HasSubstr("\"C.Rz\"")));
       }},
      {"JsonReplacesTheTable", {"--json"}, turns_the_table_into_json()},
  };
}

class ModelOption : public OptionEffect {};

TEST_P(ModelOption, HasItsEffectAndNoOther) {
  write("odd.urdf", kOddArm);
  const bool json = GetParam().option.front() != "--json";
  check_effect(json ? Words{"model", "--json"} : Words{"model"}, GetParam());
}
INSTANTIATE_TEST_SUITE_P(Options, ModelOption, ::testing::ValuesIn(model_options()), behaviour_of);

TEST_F(OptionsOfKdlcal, OfModelAreAllTested) { expect_a_test_of_every_option("model", model_options()); }

// ---- fk and jacobian -----------------------------------------------------------------------------------------------

/// kOddArm on a plinth, so that its base and its tip can be moved along fixed joints.
std::string arm_on_a_plinth() {
  std::string text = kOddArm;
  const std::string plinth = R"(<link name="floor"/><joint name="bolts" type="fixed"><parent link="floor"/>
    <child link="world"/><origin xyz="0.5 0.6 0.7" rpy="0.1 0.2 0.3"/></joint>)";
  return text.insert(text.find("<link"), plinth);
}

const Words kAtJoints = {"--urdf", "plinth.urdf", "--joints", "0.3,-0.2,0.5,1,-1"};

Eigen::VectorXd at(const std::array<double, 5>& q) { return Eigen::Map<const Eigen::Matrix<double, 5, 1>>(q.data()); }

/// q = M c + o with couplings, signs, offsets, and the slide in front.
constexpr const char* kCoupled = R"({"controller_joints": ["S", "A1", "A2", "A3", "A4"],
  "urdf_joints": ["turn", "slide", "skew", "elbow", "wrist"],
  "matrix": [[0,1,0,0,0], [-1,0,0,0,0], [0,-0.5,1,0,0], [0,0,1,-1,0], [0,0,0,0,2]],
  "offset": [0.1, 0.05, -0.2, 0.3, -0.4]})";

/// A result as far as fk and jacobian read it.
constexpr const char* kResult = R"({"parameters": [{"name": "base.Tx", "error": 9}, {"name": "dq2", "error": 0.01},
  {"name": "Tz3", "error": 0.002}]})";

KDL::Chain arm(const std::string& base, const std::string& tip, bool calibrated) {
  const ErrorModel model = complete_model(parse_robot(arm_on_a_plinth(), {.base = base, .tip = tip}));
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  if (calibrated) {
    errors[static_cast<Eigen::Index>(parameter_index(model, "dq2"))] = 0.01;
    errors[static_cast<Eigen::Index>(parameter_index(model, "Tz3"))] = 0.002;
  }
  return folded_chain(model, errors);
}

/// The answer of fk or jacobian is that of this chain, by KDL and by central differences.
Check is_at(const KDL::Chain& chain, const Eigen::VectorXd& q) {
  return [=](const Effect& effect) {
    EXPECT_EQ(effect.with.outcome.status, 0);
    EXPECT_TRUE(effect.with.files.empty());
    EXPECT_NE(effect.with.json, effect.without.json);
    if (effect.with.json.contains("frames")) {
      const Json& tip = effect.with.json["frames"].back();
      const Json& p = tip["position"];
      const Json& w = tip["quaternion_wxyz"];
      const KDL::Frame found(KDL::Rotation::Quaternion(w[1], w[2], w[3], w[0]), KDL::Vector(p[0], p[1], p[2]));
      EXPECT_LT(difference(found, kdl_pose(chain, q)), 1e-12) << effect.with.outcome.out;
      return;
    }
    const Eigen::MatrixXd expected = central_differences(q.size(), 1e-5, [&](const Eigen::VectorXd& step) {
      const KDL::Twist motion = KDL::diff(kdl_pose(chain, q), kdl_pose(chain, q + step));
      return Eigen::VectorXd{{motion[0], motion[1], motion[2], motion[3], motion[4], motion[5]}};
    });
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      for (Eigen::Index row = 0; row < 6; ++row) {
        for (const char* route : {"kdl", "matrix_derivative", "cross_product"}) {
          const Json& J = effect.with.json[route];
          EXPECT_NEAR(J[static_cast<std::size_t>(row)][static_cast<std::size_t>(i)], expected(row, i), 1e-8)
              << route << " row " << row << " column " << i;
        }
      }
    }
  };
}

std::vector<OptionCase> arm_options() {
  const Eigen::VectorXd q = at({0.3, -0.2, 0.5, 1.0, -1.0});
  const Words with_result = kAtJoints + Words{"--result", "r.json"};
  const Words degrees = {"--urdf", "plinth.urdf", "--joints", "30,-0.2,50,60,-70"};
  const Words controller = {"--urdf", "plinth.urdf", "--joints", "0.2,0.3,0.5,1,-0.5"};
  const Words controller_degrees = {"--urdf", "plinth.urdf", "--joints", "0.2,30,50,60,-30", "--degrees"};
  const ErrorModel fanuc_model = complete_model(fanuc());
  Eigen::VectorXd longer = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(fanuc_model.parameters.size()));
  longer[static_cast<Eigen::Index>(parameter_index(fanuc_model, "Tz2"))] = 0.1;
  const Eigen::VectorXd six = Eigen::Matrix<double, 6, 1>(0.3, -0.2, 0.5, 1.0, -1.0, 2.0);
  return {
      {"UrdfIsTheRobot",
       {"--urdf", "longer.urdf"},
       is_at(folded_chain(fanuc_model, longer), six),
       {"--joints", "0.3,-0.2,0.5,1,-1,2"}},
      {"BaseIsTheFirstLink", {"--base", "world"}, is_at(arm("world", "tool", false), q), kAtJoints},
      {"TipIsTheLastLink", {"--tip", "e"}, is_at(arm("floor", "e", false), q), kAtJoints},
      {"BaseIsThatOfTheResultToo", {"--base", "world"}, is_at(arm("world", "tool", true), q), with_result},
      {"TipIsThatOfTheResultToo", {"--tip", "e"}, is_at(arm("floor", "e", true), q), with_result},
      {"ResultCorrectsTheGeometry", {"--result", "r.json"}, is_at(arm("floor", "tool", true), q), kAtJoints},
      {"JointsAreWhereTheArmIs",
       {"--joints", "0.3,-0.2,0.5,1,-1"},
       is_at(arm("floor", "tool", false), q),
       {"--urdf", "plinth.urdf"}},
      {"DegreesAreOfAnglesAlone",
       {"--degrees"},
       is_at(arm("floor", "tool", false), at({30 * kDegree, -0.2, 50 * kDegree, 60 * kDegree, -70 * kDegree})),
       degrees},
      {"JointConventionTurnsTheControllersValues",
       {"--joint-convention", "coupled.json"},
       // By hand from S = 0.2, A1 = 0.3, A2 = 0.5, A3 = 1, A4 = -0.5.
       is_at(arm("floor", "tool", false), at({0.3 + 0.1, -0.2 + 0.05, 0.5 - 0.15 - 0.2, 0.5 - 1.0 + 0.3, -1.0 - 0.4})),
       controller},
      {"JointConventionInDegreesHasOffsetsInRadians",
       {"--joint-convention", "coupled.json"},
       is_at(arm("floor", "tool", false),
             at({30 * kDegree + 0.1, -0.2 + 0.05, 35 * kDegree - 0.2, -10 * kDegree + 0.3, -60 * kDegree - 0.4})),
       controller_degrees},
      {"JsonReplacesTheTable", {"--json"}, turns_the_table_into_json(), kAtJoints},
  };
}

std::vector<OptionCase> fk_options() {
  std::vector<OptionCase> rows = arm_options();
  rows.push_back({"FramesShowEveryLink",
                  {"--frames"},
                  [](const Effect& effect) {
                    const std::string& one = effect.without.outcome.out;
                    const std::string& all = effect.with.outcome.out;
                    EXPECT_EQ(std::count(one.begin(), one.end(), '\n'), 2);
                    EXPECT_EQ(std::count(all.begin(), all.end(), '\n'), 9);
                    for (const char* link : {"\nworld ", "\na ", "\nb ", "\nbracket ", "\nc ", "\nd ", "\ne "}) {
                      EXPECT_THAT(all, HasSubstr(link));
                      EXPECT_THAT(one, Not(HasSubstr(link)));
                    }
                    EXPECT_EQ(all.substr(all.find("\ntool ")), one.substr(one.find("\ntool ")));
                  },
                  kAtJoints});
  return rows;
}

class ArmOption : public OptionEffect {
protected:
  void check(const std::string& subcommand) {
    write("plinth.urdf", arm_on_a_plinth());
    write("coupled.json", kCoupled);
    write("r.json", kResult);
    std::string text = content(kFanuc);
    const std::size_t length = text.rfind("0 0 1.075");  // of joint 3's origin
    ASSERT_NE(length, std::string::npos);
    write("longer.urdf", text.replace(length, 9, "0 0 1.175"));
    const std::string& option = GetParam().option.front();
    const bool table = option == "--json" || option == "--frames";
    check_effect(table ? Words{subcommand} : Words{subcommand, "--json"}, GetParam());
  }
};
class FkOption : public ArmOption {};
class JacobianOption : public ArmOption {};

TEST_P(FkOption, HasItsEffectAndNoOther) { check("fk"); }
INSTANTIATE_TEST_SUITE_P(Options, FkOption, ::testing::ValuesIn(fk_options()), behaviour_of);

TEST_P(JacobianOption, HasItsEffectAndNoOther) { check("jacobian"); }
INSTANTIATE_TEST_SUITE_P(Options, JacobianOption, ::testing::ValuesIn(arm_options()), behaviour_of);

// ---- jacobian --identification -------------------------------------------------------------------------------------

long lines_of(const std::string& text) { return std::count(text.begin(), text.end(), '\n'); }

/// The matrices have a row for each of so many configurations, targets and axes behind the header.
Check has_matrices_of(long without, long with) {
  return [=](const Effect& effect) {
    EXPECT_EQ(lines_of(effect.without.outcome.out), 1 + 3 * without) << effect.without.outcome.err;
    EXPECT_EQ(lines_of(effect.with.outcome.out), 1 + 3 * with) << effect.with.outcome.err;
    EXPECT_EQ(effect.with.outcome.status, 0);
    EXPECT_TRUE(effect.with.files.empty());
  };
}

std::vector<OptionCase> identification_options() {
  const Words joints = {"--joints", "0.1,-0.2,0.3,-0.4,0.5,-0.6"};
  const Words matrices = joints + Words{"--identification"};
  const auto header_gains = [](const std::string& column) {
    return [column](const Effect& effect) {
      EXPECT_THAT(effect.with.outcome.out, HasSubstr("," + column + "["));
      EXPECT_THAT(effect.without.outcome.out, Not(HasSubstr("," + column + "[")));
      EXPECT_EQ(lines_of(effect.with.outcome.out), 10);
    };
  };
  return {
      {"IdentificationWritesTheMatrices", {"--identification"}, header_gains("p_base.x"), joints},
      {"ConfigurationsComeFromAFile",
       {"--configuration-file", "plan.csv"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.outcome.status, 2);
         EXPECT_EQ(lines_of(effect.with.outcome.out), 1 + 2 * 3 * 3) << effect.with.outcome.err;
       },
       {"--identification"}},
      {"OneTargetHasThreeRows", {"--targets", "1"}, has_matrices_of(3, 1), matrices},
      {"TargetsComeFromAFile",
       {"--target-file", "targets.json"},
       both_checks(has_matrices_of(3, 2),
                   [](const Effect& effect) { EXPECT_THAT(effect.with.outcome.out, HasSubstr(",Q,z,")); }),
       matrices},
      {"TheCompleteModelHasEveryError", {"--model", "complete"}, header_gains("Tz0"), matrices},
      {"OutputHoldsWhatWasPrinted",
       {"--output", "matrices.csv"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.files.at("matrices.csv"), effect.without.outcome.out);
         EXPECT_EQ(effect.with.files.size(), 1U);
       },
       matrices},
      {"ForceReplacesAFile",
       {"--force"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.outcome.status, 2);
         EXPECT_EQ(lines_of(effect.with.files.at("old.csv")), 10);
       },
       matrices + Words{"--output", "old.csv"}},
  };
}

class IdentificationOption : public OptionEffect {};

TEST_P(IdentificationOption, HasItsEffectAndNoOther) {
  write("old.csv", "old");
  write("targets.json", R"({"targets": [{"name": "P", "position": [0, 0.2, 0]},
    {"name": "Q", "position": [0.3, 0, -0.4]}]})");
  write("plan.csv",
        "joint_1[deg],joint_2[deg],joint_3[deg],joint_4[deg],joint_5[deg],joint_6[deg]\n0,0,0,0,0,0\n"
        "10,-20,30,-40,50,-60\n");
  check_effect({"jacobian"}, GetParam());
}
INSTANTIATE_TEST_SUITE_P(Options, IdentificationOption, ::testing::ValuesIn(identification_options()), behaviour_of);

TEST_F(OptionsOfKdlcal, OfFkAndJacobianAreAllTested) {
  expect_a_test_of_every_option("fk", fk_options());
  std::vector<OptionCase> rows = arm_options();
  const std::vector<OptionCase> more = identification_options();
  rows.insert(rows.end(), more.begin(), more.end());
  expect_a_test_of_every_option("jacobian", rows);
}

// ---- validate ------------------------------------------------------------------------------------------------------

/// The answer of validate is the registration of m.csv by the library.
Check is_registered(const std::function<RegistrationOptions(const std::filesystem::path&)>& known) {
  return [=](const Effect& effect) {
    EXPECT_NE(effect.with.outcome.out, effect.without.outcome.out);
    const ErrorModel model = complete_model(load_robot(kFanuc));
    const Measurements measurements = read_measurements(effect.directory / "m.csv", joint_names(fanuc()));
    const Eigen::VectorXd none = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
    const Registration registration = register_base_and_targets(
        flange_poses(folded(model, none), measurements.joint_values), measurements, known(effect.directory));
    const Estimate estimate{.errors = none, .X_WB = registration.X_WB, .targets = registration.targets, .effects = {}};
    const auto rms = [&](Rows rows) {
      return error_statistics(position_errors(model, estimate, measurements, rows)).rms;
    };
    const Json& found = effect.with.json["position_error"];
    EXPECT_NEAR(found["train"]["rms"], rms(Rows::train), 1e-12);
    EXPECT_NEAR(found["test"]["rms"], rms(Rows::test), 1e-12);
    EXPECT_NEAR(found["all"]["rms"], rms(Rows::all), 1e-12);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<Eigen::Index>(axis);
      EXPECT_NEAR(effect.with.json["base"]["position"][axis], registration.X_WB.translation()[i], 1e-12);
      EXPECT_NEAR(effect.with.json["targets"][1]["position"][axis], registration.targets[1].X_FT.translation()[i],
                  1e-12);
    }
  };
}

Eigen::Isometry3d known_base() {
  return Eigen::Translation3d(2.001, 1.0, 0.502) * Eigen::Quaterniond(0.6, 0.0, 0.0, 0.8);
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<OptionCase> validate_options() {
  const auto rms = [](const Answer& run) { return run.json["position_error"]["train"]["rms"].get<double>(); };
  const auto position = [](const Json& frame) {
    return Eigen::Vector3d(frame["position"][0], frame["position"][1], frame["position"][2]);
  };
  const auto as_it_is = [](const std::filesystem::path&) { return RegistrationOptions{}; };
  const Words measured = {"--measurements", "m.csv"};
  return {
      {"UrdfIsTheRobot",
       {"--urdf", "longer.urdf"},
       [rms](const Effect& effect) { EXPECT_GT(rms(effect.with), 10.0 * rms(effect.without)); },
       measured},
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
      {"MeasurementsAreRegistered", {"--measurements", "m.csv"}, is_registered(as_it_is)},
      {"ExcludeLeavesAConfigurationAndAPointOut",
       {"--exclude", "2,3:B"},
       [](const Effect& effect) {
         const auto count = [](const Answer& run) { return run.json["position_error"]["train"]["count"].get<long>(); };
         EXPECT_EQ(count(effect.with), count(effect.without) - 4);
       },
       measured},
      {"JointConventionReadsTheControllersValues",
       {"--joint-convention", "coupled.json"},
       is_registered(as_it_is),
       {"--measurements", "controller.csv"}},
      {"KnownBaseIsHeld",
       {"--known-base", "known.json"},
       is_registered([](const std::filesystem::path&) {
         return RegistrationOptions{.known_base = known_base(), .known_targets = {}};
       }),
       measured},
      {"KnownTargetsAreHeldAndOthersFree",
       {"--known-targets", "known.json"},
       is_registered([](const std::filesystem::path&) {
         std::vector<TargetFrame> targets = targets_at({Eigen::Vector3d(0.1, 0.001, 0.0), Eigen::Vector3d(0, 0, 0.1)});
         return RegistrationOptions{.known_base = std::nullopt, .known_targets = targets};
       }),
       measured},
      {"RequireDecidesTheStatus",
       {"--require", "train.rms<0"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
         EXPECT_EQ(effect.without.outcome.status, 0);
         EXPECT_EQ(effect.with.outcome.status, 1);
       },
       measured},
      {"JsonReplacesTheTable", {"--json"}, turns_the_table_into_json(), measured},
      {"ReportShowsThePositionError",
       {"--report", "v.html"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
         const Json page = data_of_page(effect.with.files.at("v.html"));
         EXPECT_EQ(page["result"]["position_error"], effect.with.json["position_error"]);
       },
       measured},
      {"ForceReplacesAPage",
       {"--force"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.outcome.status, 2);
         EXPECT_EQ(data_of_page(effect.with.files.at("old.html"))["kind"], "validation");
       },
       measured + Words{"--report", "old.html"}},
  };
}

std::vector<OptionCase> truth_options() {
  const Words both = {"--result", "result.json", "--truth", "truth.json"};
  // Found from noise of 20 µm on nominal geometry: off by about that.
  const Check compares = [](const Effect& effect) {
    EXPECT_EQ(effect.without.outcome.status, 2) << "one without the other";
    EXPECT_EQ(effect.with.json["comparable"], true);
    EXPECT_GT(effect.with.json["position_error"]["all"]["rms"], 5e-6);
    EXPECT_LT(effect.with.json["position_error"]["all"]["rms"], 5e-5);
  };
  return {{"ResultIsComparedWithTheTruth", {"--result", "result.json"}, compares, {"--truth", "truth.json"}},
          {"TruthIsWhatTheResultShouldBe", {"--truth", "truth.json"}, compares, {"--result", "result.json"}},
          {"SeedDrawsOtherConfigurations",
           {"--seed", "2"},
           [](const Effect& effect) {
             EXPECT_EQ(effect.without.json["seed"], 1);
             EXPECT_EQ(effect.with.json["seed"], 2);
             const Json& without = effect.without.json["position_error"]["all"];
             const Json& with = effect.with.json["position_error"]["all"];
             EXPECT_NE(with["rms"], without["rms"]);
             EXPECT_NEAR(with["rms"], without["rms"], 0.2 * without["rms"].get<double>());
           },
           both}};
}

class TruthOption : public OptionEffect {};

TEST_P(TruthOption, HasItsEffectAndNoOther) {
  ASSERT_NO_FATAL_FAILURE(write_once("a result and its truth", [&] {
    ASSERT_EQ(
        run({"simulate", "--configurations", "12", "--noise", "2e-5", "--output", "m.csv", "--truth", "truth.json"})
            .status,
        0);
    ASSERT_EQ(run({"calibrate", "--measurements", "m.csv", "--result", "result.json"}).status, 0);
  }));
  check_effect({"validate", "--json"}, GetParam());
}
INSTANTIATE_TEST_SUITE_P(Options, TruthOption, ::testing::ValuesIn(truth_options()), behaviour_of);

class ValidateOption : public OptionEffect {};

TEST_P(ValidateOption, HasItsEffectAndNoOther) {
  const Measurements measured = measured_fanuc({.sigma = 2e-5}, false);
  write("m.csv", measurements_csv(measured));
  write("old.html", "old");
  write("controller.csv", in_controller_joints(measured, kFanucCoupled));
  write("coupled.json", kFanucCoupled);
  write("known.json", R"({"base": {"position": [2.001, 1.0, 0.502], "quaternion_wxyz": [0.6, 0, 0, 0.8]},
    "targets": [{"name": "A", "position": [0.1, 0.001, 0]}, {"name": "B", "position": [0, 0, 0.1]}]})");
  std::string text = content(kFanuc);
  write("longer.urdf", std::string(text).replace(text.rfind("0 0 1.075"), 9, "0 0 1.175"));
  write("foot.urdf", with_foot(text));
  write("hand.urdf", with_hand(text));
  const bool json = GetParam().option.front() != "--json";
  check_effect(json ? Words{"validate", "--json"} : Words{"validate"}, GetParam());
}
INSTANTIATE_TEST_SUITE_P(Options, ValidateOption, ::testing::ValuesIn(validate_options()), behaviour_of);

TEST_F(OptionsOfKdlcal, OfValidateAreAllTested) {
  std::vector<OptionCase> rows = validate_options();
  const std::vector<OptionCase> more = truth_options();
  rows.insert(rows.end(), more.begin(), more.end());
  expect_a_test_of_every_option("validate", rows);
}

}  // namespace
}  // namespace kdl_calibration::testing::cli_options_test
