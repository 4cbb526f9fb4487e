// Values of options: what is read of them, and their limits at the exact value, on both sides. What the readers' own
// tests cover is not repeated: the length of a line (measurements_test.cpp), the number of joints in a URDF and the
// size of measurements (kdlcal_robustness_test.cpp).

#include "cli/options.hpp"

#include <algorithm>
#include <iterator>
#include <memory>

#include "cli/config_file.hpp"
#include "cli/joint_range_option.hpp"
#include "cli/measurement_options.hpp"
#include "cli/text.hpp"
#include "cli_support.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "planning/measuring_plan.hpp"
#include "planning/simulation.hpp"
#include "refusal.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::testing::options_test {
namespace {

using Json = nlohmann::json;
using Eigen::Index;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

TEST(OptionValues, ValuesOfOptionsAreTakenUpToTheirBounds) {
  const auto taken = [](const CLI::Validator& validator, std::string value) { return validator(value); };
  const CLI::Validator between = cli::number_between(-2.0, 3.0, "so much");
  EXPECT_EQ(taken(between, "-2") + taken(between, "3") + taken(between, "0.5"), "");
  for (const char* text : {"-2.0000001", "3.0000001", "", "x", "nan"}) {
    EXPECT_EQ(taken(between, text), "'" + std::string(text) + "' is not accepted, expected so much");
  }
  const CLI::Validator from = cli::number_from(-1.0, "so much");
  EXPECT_EQ(taken(from, "-1") + taken(from, "1e12") + taken(from, "0") + taken(from, "1e-15") + taken(from, "-1e-15"),
            "");
  for (const char* text : {"-1.0000001", "1.0000001e12", "0.99e-15", "-0.99e-15", "y"}) {
    EXPECT_EQ(taken(from, text),
              "'" + std::string(text) + "' is not accepted, expected so much, from 1e-15 to 1e12 if not 0");
  }
  const CLI::Validator whole = cli::whole_number_between(2, 40, "so many");
  EXPECT_EQ(taken(whole, "2") + taken(whole, "40"), "");
  for (const char* text : {"1", "41", "3.5", "3x", "", "99999999999999999999"}) {
    EXPECT_EQ(taken(whole, text), "'" + std::string(text) + "' is not accepted, expected so many");
  }
  EXPECT_EQ(taken(cli::not_empty("a word"), "x"), "");
  EXPECT_EQ(taken(cli::not_empty("a word"), ""), "'' is not accepted, expected a word");
  EXPECT_EQ(taken(cli::one_of({"a", "b"}), "b"), "");
  EXPECT_EQ(taken(cli::one_of({"a", "b"}), "c"), "'c' is not accepted, expected one of a, b");
}

TEST(OptionValues, GroupsOfEffectsStandInTheirOrderEachOnce) {
  const Words others = {"auto", "none"};
  EXPECT_THAT(cli::effect_groups({"harmonics", "gravity"}, others),
              ElementsAre(EffectGroup::gravity, EffectGroup::harmonics));
  EXPECT_THAT(cli::effect_groups({"auto"}, others), IsEmpty());
  EXPECT_THAT(cli::effect_groups({}, others), IsEmpty());
  std::string names;
  for (const std::string& name : effect_group_names()) {
    names += (names.empty() ? "" : ", ") + name;
  }
  const auto refused = [&](const Words& words) { return refusal([&] { cli::effect_groups(words, others); }); };
  EXPECT_EQ(refused({"gravity", "none"}),
            "--effects: 'none' is not accepted in a list, expected groups alone: " + names);
  EXPECT_EQ(refused({"sag"}), "--effects: 'sag' is not accepted, expected auto, none or a list of " + names);
  EXPECT_EQ(refused({"gain", "gravity", "gain"}), "--effects: a group is given more than once, expected each once");
}

/// The controller of kOddArm counts the slide first; its A1 turns two joints.
JointConvention coupled() {
  return {.name = "coupled.json",
          .controller_joints = {"S", "A1", "A2", "A3", "A4"},
          .urdf_joints = {"turn", "slide", "skew", "elbow", "wrist"},
          .matrix =
              (Eigen::MatrixXd(5, 5) << 0, 1, 0, 0, 0, -1, 0, 0, 0, 0, 0, -0.5, 1, 0, 0, 0, 0, 1, -1, 0, 0, 0, 0, 0, 2)
                  .finished(),
          .offset = Eigen::Matrix<double, 5, 1>(0.1, 0.05, -0.2, 0.3, -0.4)};
}

TEST(OptionValues, AValueIsALengthWhereAllThatItMovesSlides) {
  const Robot odd = parse_robot(kOddArm);
  const JointConvention convention = coupled();
  JointConvention mixed = convention;
  mixed.matrix(0, 0) = 0.25;  // S turns a joint as well
  for (Index i = 0; i < 5; ++i) {
    EXPECT_EQ(cli::value_is_length(odd, nullptr, i), i == 1) << i;
    EXPECT_EQ(cli::value_is_length(odd, &convention, i), i == 0) << i;
    EXPECT_FALSE(cli::value_is_length(odd, &mixed, i)) << i;
  }
  EXPECT_FALSE(cli::value_is_length(odd, nullptr, 5)) << "which moves nothing";
}

TEST(OptionValues, JointValuesBeyondTheLimitsByARoundingAreNotNamed) {
  const Robot robot = fanuc();
  const auto warning = [&](double beyond) {
    Words joints(6, "0");
    joints[1] = Json(*robot.joints[1].upper + beyond).dump();
    joints[2] = Json(*robot.joints[2].lower - beyond).dump();
    return said_by([&] { cli::joint_values(robot, {.joints = joints}); });
  };
  EXPECT_EQ(warning(0.9e-9), "");
  EXPECT_EQ(warning(1.1e-9),
            "kdlcal: warning: joint values outside the limits of the URDF (2 of 6): joint_2, joint_3\n");
  const Robot odd = parse_robot(kOddArm);
  const auto refused = [&](const cli::JointArguments& arguments) {
    return refusal([&] { cli::joint_values(odd, arguments); });
  };
  EXPECT_EQ(refused({.joints = {"1"}}), "--joints: has 1 values, expected 5: turn, slide, skew, elbow, wrist");
  EXPECT_EQ(refused({.joints = {"1", "x", "0", "0", "0"}}), "--joints: 'x' for slide is no number, expected metres");
  EXPECT_EQ(refused({.joints = {"x", "0", "0", "0", "0"}}), "--joints: 'x' for turn is no number, expected radians");
  EXPECT_EQ(refused({.joints = {"x", "0", "0", "0", "0"}, .degrees = true}),
            "--joints: 'x' for turn is no number, expected degrees");
  EXPECT_EQ(refused({.joints = {"0", "0", "0", "0", "-1.1e12"}}),
            "--joints: '-1.1e12' for wrist is out of range, expected at most 1e12");
}

TEST(OptionValues, JointRangesOfSimulationsAreOfTheIndependentJoints) {
  const ErrorModel model = complete_model(parse_robot(urdf::with_mimic(kOddArm, "elbow", R"(joint="wrist")")));
  const JointRanges limits = limits_of(model.joints);
  EXPECT_EQ(cli::joint_ranges(model, {"limits"}), limits);
  const JointRanges ranges = cli::joint_ranges(model, {"-10:20", "-50:250", "0:0", "-7.5:30"});
  const std::vector<std::size_t> joints = {0, 1, 2, 4};  // the elbow follows
  const std::vector<double> units = {kDegree, 1e-3, kDegree, kDegree};
  const JointRanges given = {{-10.0, 20.0}, {-50.0, 250.0}, {0.0, 0.0}, {-7.5, 30.0}};
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_DOUBLE_EQ(ranges[joints[i]].first, given[i].first * units[i]) << i;
    EXPECT_DOUBLE_EQ(ranges[joints[i]].second, given[i].second * units[i]) << i;
  }
  EXPECT_EQ(ranges[3], limits[3]);
  const auto refused = [&](const Words& words) { return refusal([&] { cli::joint_ranges(model, words); }); };
  EXPECT_EQ(refused({"1:2"}), "--joint-ranges: has 1 entries, expected limits, published or 4 times lower:upper");
  EXPECT_EQ(refused({"published"}),
            "--joint-ranges: 'published' is for six revolute joints, expected limits or lower:upper of 4 joints");
  for (const std::string text : {"1", "2:1", "a:1", "1:b", ":"}) {
    EXPECT_EQ(refused({"0:1", text, "0:1", "0:1"}),
              "--joint-ranges: '" + text + "' for slide is no range, expected lower:upper in millimetres");
    EXPECT_EQ(refused({text, "0:1", "0:1", "0:1"}),
              "--joint-ranges: '" + text + "' for turn is no range, expected lower:upper in degrees");
  }
  const ErrorModel six = complete_model(fanuc());
  EXPECT_EQ(cli::joint_ranges(six, {"published"}), published_ranges(six.joints));
  EXPECT_NE(cli::joint_ranges(six, {"published"}), limits_of(six.joints));
}

TEST(OptionValues, ATrackersNoiseIsFourNumbers) {
  EXPECT_FALSE(cli::tracker_noise({}));
  const TrackerNoise noise = *cli::tracker_noise({1.0, 2.0, 3.0, 4.0});
  EXPECT_EQ(noise.range, 1.0);
  EXPECT_EQ(noise.range_per_metre, 2.0);
  EXPECT_EQ(noise.transverse, 3.0);
  EXPECT_EQ(noise.transverse_per_metre, 4.0);
  EXPECT_TRUE(cli::tracker_noise({1e-12, 0.0, 1e-12, 0.0}));
  const std::string above = "--noise-tracker: the constants of range and transverse error must be above 0";
  EXPECT_EQ(refusal([] { cli::tracker_noise({0.0, 1.0, 1.0, 1.0}); }), above);
  EXPECT_EQ(refusal([] { cli::tracker_noise({1.0, 1.0, 0.0, 1.0}); }), above);
  for (const std::size_t count : {1U, 3U, 5U}) {
    EXPECT_EQ(refusal([&] { cli::tracker_noise(std::vector<double>(count, 1.0)); }),
              "--noise-tracker: has " + std::to_string(count) +
                  " values, expected 4: range, range per metre, transverse, transverse per metre");
  }
}

using OptionsWithFiles = CommandLine;

TEST_F(OptionsWithFiles, ConventionsAtHandStandBesideTheGivenOneAndTheRobotsOfKdlcal) {
  const std::string text = R"({"controller_joints": ["J"], "urdf_joints": ["j"], "matrix": [[-1]], "offset": [0.5]})";
  const auto names = [](const std::vector<JointConvention>& conventions) {
    Words result;
    std::transform(conventions.begin(), conventions.end(), std::back_inserter(result),
                   [](const JointConvention& convention) { return convention.name; });
    return result;
  };
  EXPECT_FALSE(cli::convention_of(""));
  const Words at_home = names(cli::conventions_at_hand({}));
  const std::string robots = std::string(URDF_DIR) + "/fanuc_r2000ic_165f";
  EXPECT_THAT(at_home, ::testing::IsSupersetOf({robots + "_pendant.json", robots + "_serial.json"}));
  write("given.json", text);
  write("beside.json", text);
  write("beside.txt", text);
  write("other.json", "{}");
  const cli::MeasurementArguments arguments{.joint_convention = path("given.json")};
  EXPECT_THAT(names(cli::conventions_at_hand(arguments)),
              ::testing::UnorderedElementsAreArray(at_home + Words{path("beside.json"), path("given.json")}));
  EXPECT_EQ(cli::convention_of(arguments.joint_convention)->matrix(0, 0), -1.0);
}

TEST_F(OptionsWithFiles, OptionsInAFileAreThoseOfTheSubcommand) {
  CLI::App app;
  app.set_config("--config");
  bool flag = false;
  CLI::App* one = app.add_subcommand("one", "");
  one->add_flag("--flag", flag);
  app.add_subcommand("two", "")->add_flag("--other", flag);
  app.config_formatter(std::make_shared<cli::ConfigFile>(app));
  const auto parsed = [&](const std::string& text) {
    write("o.toml", text);
    flag = false;
    return refusal([&] { app.parse("--config " + path("o.toml") + " one"); });
  };
  const std::string taken = "nothing was refused";
  EXPECT_EQ(parsed("flag = true\n"), taken);
  EXPECT_TRUE(flag);
  EXPECT_EQ(parsed("[one]\nflag = true\n"), taken);
  EXPECT_TRUE(flag);
  EXPECT_EQ(parsed("other = true\n[two]\nother = true\n"), taken);
  EXPECT_FALSE(flag) << "which is another subcommand's";
  const std::string none = path("o.toml") + ": '";
  EXPECT_EQ(parsed("[one]\nother = true\n"), none + "one.other' is no option, expected those that --help lists");
  EXPECT_EQ(parsed("help = true\n"), none + "help' is no option, expected those that --help lists");
  EXPECT_EQ(parsed("[three]\nflag = true\n"), none + "[three]' is no subcommand, expected those that --help lists");
}

class ExactLimits : public CommandLine {
protected:
  /// The command takes all these options, "--name=value": what fails is the robot, which is read later.
  void accepts(const Words& command, const Words& options) {
    Words words = command + options;
    words = words + Words{"--urdf", "none.urdf"};
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.status, 2);
    EXPECT_THAT(outcome.err, AllOf(HasSubstr("none.urdf"), Not(HasSubstr("--")))) << ::testing::PrintToString(options);
  }

  void refuses(const Words& command, const std::string& option, const Words& values) {
    for (const std::string& value : values) {
      expect_refused(command + Words{option + "=" + value, "--urdf", "none.urdf"},
                     {option, "'" + value + "'", "expected"});
    }
  }

  void refuses_beyond(const Words& command, const std::string& option, long least, long most) {
    refuses(command, option, {std::to_string(least - 1), std::to_string(most + 1)});
  }

  /// Sigmas or lengths: 0, or from 1e-15 to 1e12.
  void sigmas(const Words& command, const Words& options) {
    for (const std::string value : {"0", "1e-15", "1e12"}) {
      Words given = options;
      for (std::string& option : given) {
        option += "=" + value;
      }
      accepts(command, given);
    }
    for (const std::string& option : options) {
      refuses(command, option, {"0.99e-15", "-1e-15", "1.000000000001e12"});
    }
  }
};

// The same limit of the same option is looked at in one subcommand.
TEST_F(ExactLimits, OfCounts) {
  const Words simulate = {"simulate"};
  const Words calibrate = {"calibrate", "--measurements", "m.csv"};
  const Words plan = {"plan"};
  struct Count {
    Words command;
    std::string option;
    long least;
    long most;
  };
  for (const Count& count :
       {Count{{"model"}, "--targets", 1, 100}, Count{simulate, "--configurations", 1, 100'000},
        Count{simulate, "--test-configurations", 0, 100'000}, Count{simulate, "--targets", 1, 100},
        Count{simulate, "--repeats", 1, 1'000}, Count{simulate, "--monte-carlo", 0, 1'000'000},
        Count{simulate, "--threads", 0, 1'024}, Count{calibrate, "--iterations", 1, 1'000'000},
        Count{calibrate, "--k-fold", 2, 1'000}, Count{calibrate, "--threads", 0, 1'024},
        Count{plan, "--configurations", 1, 2'000}, Count{plan, "--candidates", 1, 1'000'000},
        Count{plan, "--workspace", 1, 100'000}, Count{plan, "--starts", 1, 1'000}, Count{plan, "--targets", 1, 100},
        Count{plan, "--monte-carlo", 0, 100'000}, Count{{"plan", "--measured", "m.csv"}, "--add", 1, 2'000}}) {
    accepts(count.command, {count.option + "=" + std::to_string(count.least)});
    accepts(count.command, {count.option + "=" + std::to_string(count.most)});
    refuses_beyond(count.command, count.option, count.least, count.most);
  }
  for (const Words& command : {simulate, plan}) {
    accepts(command, {"--seed=9223372036854775807"});
    refuses(command, "--seed", {"-1", "9223372036854775808"});
  }
}

TEST_F(ExactLimits, OfTheDirectionOfGravity) {
  const Words calibrate = {"calibrate", "--measurements", "m.csv"};
  accepts(calibrate, {"--gravity-direction=-1000000,0,1000000"});
  for (const std::string value : {"-1000001", "1000001"}) {
    expect_refused(
        {"calibrate", "--measurements", "m.csv", "--urdf", "none.urdf", "--gravity-direction", "0,0," + value},
        {"--gravity-direction", "'" + value + "'", "expected a number"});
  }
}

TEST_F(ExactLimits, OfSigmas) {
  sigmas({"simulate"},
         {"--noise", "--orientation-noise", "--length-sigma", "--angle-sigma", "--base-sigma", "--target-sigma"});
  sigmas({"simulate"}, {"--angle-sigma-deg"});  // instead of another
  sigmas(
      {"calibrate", "--measurements", "m.csv"},
      words_of("--prior-length --prior-angle --noise-independent --noise-common --noise-tracker --orientation-sigma"));
  sigmas({"plan"}, {"--configuration-noise", "--prior-length", "--prior-angle", "--noise-tracker"});
}

TEST_F(ExactLimits, OfLengthsAndAnglesInPlans) {
  const Words plan = {"plan"};
  accepts(plan, {"--noise=1e-12", "--accuracy=1e-6", "--acceptance-angle=0", "--least-height=-1e6"});
  accepts(plan, {"--noise=1", "--accuracy=1e6", "--acceptance-angle=180", "--least-height=1e12"});
  refuses(plan, "--noise", {"0.99e-12", "1.001"});
  expect_refused({"plan", "--noise", "1e9"}, {"--noise: '1e9' is not accepted, expected metres from 1e-12 to 1,"});
  refuses(plan, "--accuracy", {"0.99e-6", "1000001"});
  refuses(plan, "--acceptance-angle", {"-0.001", "180.001"});
  refuses(plan, "--least-height", {"-1000001", "1.000000000001e12"});
  sigmas(plan, {"--least-radius", "--clearance", "--arm-radius", "--tool-radius"});
}

TEST_F(ExactLimits, OfSimulatedRows) {
  const Words simulate =
      words_of("simulate --configurations 99999 --repeats 100 --targets 1 --plan none.csv --test-configurations");
  const auto with = [&](const std::string& test) {
    Words words = simulate;
    words.push_back(test);
    return words;
  };
  expect_refused(with("1"), {"none.csv", "No such file"});  // 10,000,000
  expect_refused(with("2"), {"10000100 rows, expected at most 10000000"});
}

TEST_F(ExactLimits, OfTextFilesAre64MiB) {
  constexpr std::uintmax_t kLimit = std::uintmax_t{64} << 20U;
  const std::string fact = "larger than the limit of 64 MiB";
  const Words fk = {"fk", "--joints", "0,0,0,0,0,0", "--joint-convention", "huge"};
  const auto said = [&](const Words& command) {
    const Outcome outcome = run(command);
    EXPECT_EQ(outcome.status, 2);
    return outcome.err;
  };
  if (!write_sparse("huge", kLimit + 1)) {
    GTEST_SKIP() << "no room for a sparse file";
  }
  write_calibration();
  for (const Words& command : {Words{"model", "--urdf", "huge"}, Words{"simulate", "--target-file", "huge"}, fk}) {
    EXPECT_THAT(said(command), HasSubstr(fact));
  }
  // What has no size, like a pipe, is read so far.
  EXPECT_THAT(said({"fk", "--joints", "0,0,0,0,0,0", "--joint-convention", "/dev/zero"}), HasSubstr(fact));
  ASSERT_TRUE(write_sparse("huge", kLimit));
  EXPECT_THAT(said(fk), Not(HasSubstr(fact)));  // the same reader for all of them
}

TEST_F(ExactLimits, OfProgramsAre512MiB) {
  write_calibration();  // which also leaves the files that were there when it was made
  if (!write_sparse("huge", (std::uintmax_t{512} << 20U) + 1)) {
    GTEST_SKIP() << "no room for a sparse file";
  }
  const Outcome outcome = run(words_of("compensate --result r.json --program huge --output o"));
  EXPECT_EQ(outcome.status, 2);
  EXPECT_THAT(outcome.err, HasSubstr("larger than the limit of 512 MiB"));
}

TEST_F(ExactLimits, OfOptionFilesAre1MiB) {
  constexpr std::size_t kLimit = std::size_t{1} << 20U;
  const std::string option = "json = true\n";
  write("options.toml", option + std::string(kLimit - option.size(), '#'));
  const Words fk = {"fk", "--joints", "0,0,0,0,0,0", "--config", "options.toml"};
  EXPECT_EQ(run_json(fk)["frames"].size(), 7U);
  write("options.toml", option + std::string(kLimit - option.size() + 1, '#'));
  expect_refused(fk, {"options.toml", "larger than the limit of 1 MiB"});
}

std::string targets_json(int count) {
  std::string list;
  for (int i = 1; i <= count; ++i) {
    list += (i == 1 ? "" : ",") + (R"({"name": "T)" + std::to_string(i)) + R"(", "position": [0, 0, 0.)" +
            std::to_string(i) + "]}";
  }
  return "{\"targets\": [" + list + "]}";
}

TEST_F(ExactLimits, OfKnownTargetsAre100) {
  succeed({"simulate", "--configurations", "4", "--output", "m.csv"});
  const Words validate = {"validate", "--measurements", "m.csv", "--known-targets", "t.json"};
  write("t.json", targets_json(100));
  expect_refused(validate, {"t.json: targets: none was measured", "A, B, C"});
  write("t.json", targets_json(101));
  expect_refused(validate, {"t.json: targets: 101, expected at most 100"});
}

// Other limits of theirs stand in measurements_test.cpp and robot_test.cpp.

TEST(ExactLimitsOfReaders, ValuesInJsonStandInside100Others) {
  const auto nested = [](std::size_t depth) {  // inside arrays and the object
    const std::string inside = std::string(depth - 1, '[') + "0" + std::string(depth - 1, ']');
    return refusal([&] { parse_joint_convention("{\"controller_joints\": " + inside + "}"); });
  };
  EXPECT_THAT(nested(100), Not(HasSubstr("deeper")));
  EXPECT_THAT(nested(101), HasSubstr("nested deeper than the limit of 100"));
}

}  // namespace
}  // namespace kdl_calibration::testing::options_test
