// kdlcal model, fk and jacobian: each option changes what it should and nothing else (see cli_options_support.hpp), and
// what they print.

#include <array>
#include <cmath>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <kdl/frames.hpp>

#include "cli_options_support.hpp"
#include "json_support.hpp"
#include "model/error_chains.hpp"
#include "model/kinematics.hpp"
#include "printed_text.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::testing::fk_test {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

std::vector<OptionCase> model_options() {
  const auto loses = [](const std::string& joint) {
    return [joint](const Effect& effect) {
      EXPECT_THAT(effect.without.outcome.out, HasSubstr("\"" + joint + "\""));
      EXPECT_THAT(effect.with.outcome.out, Not(HasSubstr("\"" + joint + "\"")));
    };
  };
  const auto base_ranks = [](const std::vector<int>& ranks) {
    return [=](const Effect& effect) {
      const Json& measured = effect.with.json["measured"];
      EXPECT_EQ(measured["base_ranks"], Json(ranks));
      EXPECT_EQ(measured["arm_rank"], measured["arm_parameters"].size());
      EXPECT_EQ(effect.with.json["parameters"], effect.without.json["parameters"]);
    };
  };
  return {
      {"StationsEachHaveABase", {"--stations", "3"}, base_ranks({6, 6, 6})},
      {"SocketsHideTheTurnAboutTheirLine",
       {"--sockets", "sockets.json"},
       base_ranks({5, 5}),
       {"--targets", "1", "--stations", "2"}},
      {"DirectionsLeaveSomeOfEachBase", {"--directions", "z"}, base_ranks({3, 3, 3, 3}), {"--stations", "4"}},
      {"UrdfIsTheRobot", {"--urdf", "odd.urdf"}, loses("joint_2")},
      {"DhIsTheRobot", {"--dh", "odd_dh.json"}, loses("joint_2")},
      {"BaseIsTheFirstLink", {"--base", "link_1"}, loses("joint_1")},
      {"TipIsTheLastLink", {"--tip", "link_5"}, loses("joint_6")},
      {"TargetsAreThree", {"--targets", "3"}, changes_nothing()},
      {"OneTargetShowsLess", {"--targets", "1"}, turns("/rank", 33, 27)},
      {"PosesShowWhatPointsDo",
       {"--poses"},
       all_checks(turns("/rank", 33, 33 + 3 * 3),
                  [](const Effect& effect) {
                    EXPECT_THAT(effect.with.outcome.out, HasSubstr("\"C.Rz\""));
                    EXPECT_THAT(effect.without.outcome.out, Not(HasSubstr("\"C.Rz\"")));
                  })},
      {"JsonReplacesTheTable", {"--json"}, turns_the_table_into_json()},
  };
}

constexpr const char* kSockets = R"({"targets": [{"name": "1", "position": [0, 0, 0]},
                                                {"name": "2", "position": [0.3, 0, 0]}]})";

class ModelOption : public OptionEffect {};

TEST_P(ModelOption, HasItsEffectAndNoOther) {
  write("odd.urdf", kOddArm);
  write("odd_dh.json", dh_of(parse_robot(kOddArm)));
  write("sockets.json", kSockets);
  const bool json = GetParam().option.front() != "--json";
  check_effect(json ? Words{"model", "--json"} : Words{"model"}, GetParam());
}
INSTANTIATE_TEST_SUITE_P(Options, ModelOption, ::testing::ValuesIn(model_options()), behaviour_of);

TEST_F(OptionsOfKdlcal, OfModelAreAllTested) { expect_a_test_of_every_option("model", model_options()); }

/// kOddArm on a plinth, so that its base and its tip can be moved along fixed joints.
std::string arm_on_a_plinth() {
  std::string text = kOddArm;
  const std::string plinth = R"(<link name="floor"/><joint name="bolts" type="fixed"><parent link="floor"/>
    <child link="world"/><origin xyz="0.5 0.6 0.7" rpy="0.1 0.2 0.3"/></joint>)";
  return text.insert(text.find("<link"), plinth);
}

const Words kAtJoints = {"--urdf", "plinth.urdf", "--joints", "0.3,-0.2,0.5,1,-1"};

Eigen::VectorXd at(const std::array<double, 5>& q) { return Eigen::Map<const Eigen::Matrix<double, 5, 1>>(q.data()); }

/// A result as far as fk and jacobian read it.
constexpr const char* kResult = R"({"parameters": [{"name": "base.Tx", "error": 9}, {"name": "dq2", "error": 0.01},
  {"name": "Tz3", "error": 0.002}]})";

KDL::Chain arm(const std::string& base, const std::string& tip, bool calibrated) {
  const ErrorModel model = complete_model(parse_robot(arm_on_a_plinth(), {.base = base, .tip = tip}));
  return folded_chain(model, calibrated ? errors_of(model, {{"dq2", 0.01}, {"Tz3", 0.002}}) : errors_of(model));
}

/// The same result with one effect on the third joint.
std::string result_with(const std::string& term) {
  const std::string joint = complete_model(parse_robot(arm_on_a_plinth())).joints[2].name;
  std::string result = kResult;
  result.back() = ',';
  return result + R"("effects": {"gravity_direction": [0, 0, -1], "circumstances": {"temperature": 20, "payload": 10},
    "terms": [{"joint": ")" +
         joint + R"(", "mean": 0, "scale": 1, "sigma": 1, )" + term + "}]}}";
}

/// The link before the third joint grows by 1e-5 per degC from its length at 0 degC.
KDL::Chain warm_arm(double temperature) {
  ErrorModel model = complete_model(parse_robot(arm_on_a_plinth(), {.base = "floor", .tip = "tool"}));
  model.joints[2].origin.p = model.joints[2].origin.p * (1.0 + 1e-5 * temperature);
  return folded_chain(model, errors_of(model, {{"dq2", 0.01}, {"Tz3", 0.002}}));
}

/// The answer of fk or jacobian is that of this chain, by KDL and by central differences.
Check is_at(const KDL::Chain& chain, const Eigen::VectorXd& q) {
  return [=](const Effect& effect) {
    EXPECT_EQ(effect.with.outcome.status, 0);
    EXPECT_TRUE(effect.with.files.empty());
    EXPECT_NE(effect.with.json, effect.without.json);
    if (effect.with.json.contains("frames")) {
      const KDL::Frame found = to_kdl(placed_as(effect.with.json["frames"].back()));
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
  const Words degrees = {"--urdf", "plinth.urdf", "--joints", "30,-0.2,50,60,-70"};
  const Words controller = {"--urdf", "plinth.urdf", "--joints", "0.2,0.3,0.5,1,-0.5"};
  const Words controller_degrees = {"--urdf", "plinth.urdf", "--joints", "0.2,30,50,60,-30", "--degrees"};
  const ErrorModel fanuc_model = complete_model(fanuc());
  const Eigen::VectorXd longer = errors_of(fanuc_model, {{"Tz2", 0.1}});
  const Eigen::VectorXd six = Eigen::Matrix<double, 6, 1>(0.3, -0.2, 0.5, 1.0, -1.0, 2.0);
  return {
      {"UrdfIsTheRobot",
       {"--urdf", "longer.urdf"},
       is_at(folded_chain(fanuc_model, longer), six),
       {"--joints", "0.3,-0.2,0.5,1,-1,2"}},
      {"DhIsTheRobot",
       {"--dh", "plinth_dh.json"},
       is_at(arm("floor", "tool", false), q),
       {"--joints", "0.3,-0.2,0.5,1,-1"}},
      {"BaseIsTheFirstLink", {"--base", "world"}, is_at(arm("world", "tool", false), q), kAtJoints},
      {"TipIsTheLastLink", {"--tip", "e"}, is_at(arm("floor", "e", false), q), kAtJoints},
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
  const Eigen::VectorXd q = Eigen::Matrix<double, 5, 1>(0.3, -0.2, 0.5, 1.0, -1.0);
  rows.push_back({"TemperatureIsThatOfTheArm",
                  {"--temperature", "40"},
                  is_at(warm_arm(40.0), q),
                  kAtJoints + Words{"--result", "warm.json"}});
  rows.push_back({"TemperatureOfALinkIsItsOwn",
                  {"--temperature", "bracket=40"},
                  is_at(warm_arm(40.0), q),
                  kAtJoints + Words{"--result", "warm.json"}});
  rows.push_back({"TemperatureOfAllLinksIsOneOfEach",
                  {"--temperature", "40"},
                  is_at(warm_arm(40.0), q),
                  kAtJoints + Words{"--result", "links.json"}});
  rows.push_back({"TemperatureOfTheArmAndOfALink",
                  {"--temperature", "50", "--temperature", "b=40"},
                  is_at(warm_arm(40.0), q),
                  kAtJoints + Words{"--result", "links.json"}});
  rows.push_back({"ResultIsAtTheMeanOfEachLink", {"--result", "links.json"}, is_at(warm_arm(33.0), q), kAtJoints});
  rows.push_back({"NoPayloadDoesNotBend",
                  {"--payload", "0"},
                  is_at(arm("floor", "tool", true), q),
                  kAtJoints + Words{"--result", "loaded.json"}});
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
    write("plinth_dh.json", dh_of(parse_robot(arm_on_a_plinth())));
    write("coupled.json", kOddArmCoupled);
    write("r.json", kResult);
    std::string warm = result_with(R"("name": "expansion.3", "group": "expansion", "about": "along",
      "coefficient": 1e-5, "function": {"of": "temperature and length"})");
    write("warm.json", warm);
    warm.insert(warm.find(R"("payload")"), R"("link_temperatures": {"b": 33, "tool": 70}, )");
    write("links.json", warm);
    write("loaded.json", result_with(R"("name": "payload.3", "group": "payload", "coefficient": 1e-4,
      "function": {"centre": [0.1, 0, 0.2]})"));
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

long count_lines(const std::string& text) { return std::count(text.begin(), text.end(), '\n'); }

/// The matrices have a row for each of so many configurations, targets and axes behind the header.
Check has_matrices_of(long without, long with) {
  return [=](const Effect& effect) {
    EXPECT_EQ(count_lines(effect.without.outcome.out), 1 + 3 * without) << effect.without.outcome.err;
    EXPECT_EQ(count_lines(effect.with.outcome.out), 1 + 3 * with) << effect.with.outcome.err;
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
      EXPECT_EQ(count_lines(effect.with.outcome.out), 10);
    };
  };
  return {
      {"IdentificationWritesTheMatrices", {"--identification"}, header_gains("p_base.x"), joints},
      {"ConfigurationsComeFromAFile",
       {"--configuration-file", "plan.csv"},
       [](const Effect& effect) {
         EXPECT_EQ(effect.without.outcome.status, 2);
         EXPECT_EQ(count_lines(effect.with.outcome.out), 1 + 2 * 3 * 3) << effect.with.outcome.err;
       },
       {"--identification"}},
      {"OneTargetHasThreeRows", {"--targets", "1"}, has_matrices_of(3, 1), matrices},
      {"TargetsComeFromAFile",
       {"--target-file", "targets.json"},
       all_checks(has_matrices_of(3, 2),
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
       overwrites("old.csv", "configuration,target,axis,"),
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
  expect_a_test_of_every_option("jacobian", arm_options() + identification_options());
}

TEST_F(OptionsOfKdlcal, ModelListsWhatIsKeptTheGaugeAndWhatReplacesTheRest) {
  const std::vector<std::string> lines = testing::lines_of(run({"model"}).out);
  ASSERT_GT(lines.size(), 9U);
  EXPECT_EQ(lines[0], "fanuc_r2000ic_165f: base_link to flange, 6 joints, 3 measured points on the tool");
  EXPECT_THAT(lines[1], ::testing::MatchesRegex("complete model, [0-9]+ geometric parameters:"));
  const auto words = [](const std::string& line) { return words_of(line).size(); };
  EXPECT_EQ(std::stoul(lines[1].substr(lines[1].find(", ") + 2)), words(lines[2]));
  EXPECT_THAT(lines[3], ::testing::MatchesRegex("irreducible model, rank 33 of [0-9]+ candidates:"));
  EXPECT_EQ(words(lines[4]), 33U);
  EXPECT_EQ(lines[5], "gauge, held at zero:");
  EXPECT_EQ(lines[6], "  dq1     tied to base.Rz");
  EXPECT_THAT(lines[7], ::testing::StartsWith("  dq6     tied to "));
  EXPECT_EQ(lines[8], "dropped, replaced to first order by:");
  EXPECT_THAT(lines, Contains(::testing::StartsWith("  Rx1     1.000 dq2")));
}

TEST_F(OptionsOfKdlcal, ModelSaysWhatMeasurementsFromSeveralPlacesDetermine) {
  write("one.json", R"({"targets": [{"name": "1", "position": [0, 0, 0]}]})");
  const std::string text = run({"model", "--targets", "1", "--sockets", "one.json"}).out;
  EXPECT_THAT(text, HasSubstr("measured like this (touches of sockets from 1 station):\n"
                              "  arm: 20 of 21 parameters determined\n  not told apart: "));
  EXPECT_THAT(text, HasSubstr("Tz2"));
  EXPECT_THAT(text, HasSubstr("each base, directions of 6: 3\n"));
  expect_refused({"model", "--poses", "--stations", "2"}, {"--poses", "expected none with --stations"});
  expect_refused({"model", "--sockets", "one.json"}, {"--sockets: 3 targets, expected one, a ball (--targets 1)"});
}

TEST_F(OptionsOfKdlcal, ModelNamesTheJointsThatFollowOthers) {
  write("odd.urdf", urdf::with_mimic(urdf::with_mimic(kOddArm, "skew", R"(joint="turn")"), "wrist",
                                     R"(joint="elbow" multiplier="-0.5" offset="0.25")"));
  EXPECT_EQ(lines_of(run({"model", "--urdf", "odd.urdf"}).out).at(0),
            "odd: world to tool, 5 joints (skew = 1.0 turn + 0.0, wrist = -0.5 elbow + 0.25), 3 measured points on the "
            "tool");
}

/// Position in millimetres, then roll, pitch and yaw in degrees: R = Rz(yaw) Ry(pitch) Rx(roll).
std::string pose_line(const std::string& name, const KDL::Frame& X) {
  const KDL::Rotation& R = X.M;
  std::string text = name;
  for (int i = 0; i < 3; ++i) {
    text += " " + decimals(X.p[i] * 1e3, 4);
  }
  for (const double angle : {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0))),
                             std::atan2(R(1, 0), R(0, 0))}) {
    text += " " + decimals(angle / kDegree, 5);
  }
  return text;
}

TEST_F(OptionsOfKdlcal, FkShowsMillimetresAndDegreesOfEveryFrame) {
  write("odd.urdf", kOddArm);
  const Robot robot = parse_robot(kOddArm);
  KDL::ChainFkSolverPos_recursive solver(robot.chain);
  KDL::JntArray q(5);
  q.data << 0.7, 0.25, -1.1, 0.9, -0.4;
  const std::string heading = "in world x[mm] y[mm] z[mm] roll[deg] pitch[deg] yaw[deg]";
  std::vector<std::string> lines = {heading};
  for (unsigned s = 0; s < robot.chain.getNrOfSegments(); ++s) {
    KDL::Frame frame;
    solver.JntToCart(q, frame, static_cast<int>(s) + 1);
    lines.push_back(pose_line(robot.chain.getSegment(s).getName(), frame));
  }
  const Words fk = {"fk", "--urdf", "odd.urdf", "--joints", "0.7,0.25,-1.1,0.9,-0.4"};
  expect_lines(run(fk).out, {heading, lines.back()}, "the tip");
  const std::string every = run(fk + Words{"--frames"}).out;
  expect_lines(every, lines, "every frame");
  const std::vector<std::string> printed_lines = testing::lines_of(every);
  for (const std::string& line : printed_lines) {
    EXPECT_EQ(word_ends(line, 6), word_ends(printed_lines.front(), 6)) << every;
  }
}

TEST_F(OptionsOfKdlcal, FkRefusesPayloadsThatHaveNoOrder) {
  write("plinth.urdf", arm_on_a_plinth());
  const auto fk_of = [&](const std::string& centres) {
    write("r.json",
          result_with(R"("name": "payload.3", "group": "payload", "coefficient": 1e-4, "function": {"centres": )" +
                      centres + "}"));
    return run(Words{"fk", "--result", "r.json"} + kAtJoints);
  };
  const std::string light = R"({"mass": 5, "centre": [0.3, 0, 0.2]})";
  const std::string heavy = R"({"mass": 20, "centre": [0, 0, 0.2]})";
  EXPECT_EQ(fk_of("[" + light + "," + heavy + "]").status, 0);
  for (const auto& [centres, expected] :
       {std::pair{"[" + heavy + "," + light + "]", "a larger mass than that of the payload before"},
        {"[" + light + "," + light + "]", "a larger mass than that of the payload before"},
        {std::string("[]"), "expected an array that is not empty"},
        {std::string(R"([{"mass": 0, "centre": [0, 0, 0]}])"), "mass"}}) {
    const Outcome outcome = fk_of(centres);
    EXPECT_EQ(outcome.status, 2) << centres;
    EXPECT_THAT(outcome.err, AllOf(HasSubstr("r.json"), HasSubstr("centres"), HasSubstr(expected))) << centres;
  }
}

TEST_F(OptionsOfKdlcal, JacobianShowsARowForEachVelocityAndAColumnForEachJoint) {
  write("odd.urdf", kOddArm);
  const Robot robot = parse_robot(kOddArm);
  KDL::JntArray q(5);
  q.data << 0.7, 0.25, -1.1, 0.9, -0.4;
  KDL::Jacobian J(5);
  KDL::ChainJntToJacSolver(robot.chain).JntToJac(q, J);
  std::vector<std::string> expected = {"tool in world, per rad (or m) of each joint; m/rad above, rad/rad below",
                                       "turn slide skew elbow wrist"};
  for (unsigned r = 0; r < 6; ++r) {
    expected.emplace_back(std::array{"v_x", "v_y", "v_z", "omega_x", "omega_y", "omega_z"}.at(r));
    for (unsigned c = 0; c < 5; ++c) {
      expected.back() += " " + decimals(J(r, c), 7);
    }
  }
  const std::string said = run({"jacobian", "--urdf", "odd.urdf", "--joints", "0.7,0.25,-1.1,0.9,-0.4"}).out;
  const std::size_t last = said.find("largest difference between KDL's solver, matrix derivatives and");
  ASSERT_NE(last, std::string::npos) << said;
  expect_lines(said.substr(0, last), expected, "jacobian");
}

}  // namespace
}  // namespace kdl_calibration::testing::fk_test
