// The small parts of kdlcal, called as they are: words in messages and help, numbers, requirements, commands, frames in
// files, joint values, ranges, and what is printed of a comparison with the truth.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <sstream>

#include "cli/config_file.hpp"
#include "cli/frames.hpp"
#include "cli/help.hpp"
#include "cli/identification_csv.hpp"
#include "cli/joint_range_option.hpp"
#include "cli/measurement_options.hpp"
#include "cli/options.hpp"
#include "cli/plan_command.hpp"
#include "cli/requirements.hpp"
#include "cli/text.hpp"
#include "cli/truth_report.hpp"
#include "cli_support.hpp"
#include "kdl_calibration/identification_jacobian.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/simulation.hpp"
#include "printed_text.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::cli_parts_test {
namespace {

using cli::Json;
using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;
using ::testing::ElementsAre;
using ::testing::ElementsAreArray;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Words = std::vector<std::string>;

/// What the call says on standard error.
template <class Call>
std::string said_by(Call&& call) {
  ::testing::internal::CaptureStderr();
  call();
  return ::testing::internal::GetCapturedStderr();
}

// ---- Text ----------------------------------------------------------------------------------------------------------

TEST(PartsOfKdlcal, NumbersAreReadWhole) {
  for (const auto& [text, value] : std::vector<std::pair<std::string, double>>{
           {"1", 1.0}, {"+2.5", 2.5}, {"-2.5", -2.5}, {"+3e-1", 0.3}, {"-0", 0.0}, {"1e300", 1e300}, {".5", 0.5}}) {
    ASSERT_TRUE(cli::parsed_number(text)) << text;
    EXPECT_EQ(*cli::parsed_number(text), value) << text;
  }
  for (const char* text : {"", "+", "-", "+-1", "++1", "-+1", "1 ", " 1", "1x", "0x1", "nan", "inf", "1e999", "1,5"}) {
    EXPECT_FALSE(cli::parsed_number(text)) << text;
  }
  EXPECT_EQ(cli::scientific(0.000012345, 2), "1.23e-05");
  EXPECT_EQ(cli::scientific(-0.0, 1), "0.0e+00");
  EXPECT_EQ(cli::scientific(-1234.5, 3), "-1.234e+03");
  EXPECT_EQ(cli::padded("abc", 5), "  abc");
  EXPECT_EQ(cli::padded("abc", -5), "abc  ");
  EXPECT_EQ(cli::padded("abc", 2), "abc");
  EXPECT_EQ(cli::padded("", -2), "  ");
}

TEST(PartsOfKdlcal, EachSortOfMessageHasItsBeginning) {
  EXPECT_EQ(said_by([] { cli::warn("two\nlines"); }), "kdlcal: warning: two lines\n");
  EXPECT_EQ(said_by([] { cli::doubt_aloud("x"); }), "kdlcal: not to be trusted: x\n");
  EXPECT_EQ(said_by([] { cli::require_aloud("x"); }), "kdlcal: required: x\n");
}

// ---- Help ----------------------------------------------------------------------------------------------------------

/// Letters to add, leave out, change or exchange with their neighbour, by trying all of that.
std::size_t letters_apart(const std::string& a, const std::string& b) {
  if (a.empty() || b.empty()) {
    return a.size() + b.size();
  }
  const std::string a1 = a.substr(1);
  const std::string b1 = b.substr(1);
  std::size_t least =
      std::min({letters_apart(a1, b) + 1, letters_apart(a, b1) + 1, letters_apart(a1, b1) + (a[0] == b[0] ? 0 : 1)});
  if (a.size() > 1 && b.size() > 1 && a[0] == b[1] && a[1] == b[0]) {
    least = std::min(least, letters_apart(a.substr(2), b.substr(2)) + 1);
  }
  return least;
}

TEST(PartsOfKdlcal, TheNearestWordHasTheFewestLettersChanged) {
  Random random(3);
  const auto word = [&] {
    std::string text(random.bits() % 7, ' ');
    std::generate(text.begin(), text.end(), [&] { return static_cast<char>('a' + random.bits() % 3); });
    return text;
  };
  int found = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const std::string mistyped = word();
    const Words words = {word(), word(), word()};
    std::string expected;
    std::size_t least = std::max<std::size_t>(mistyped.size() / 3, 1) + 1;
    for (const std::string& candidate : words) {
      if (letters_apart(mistyped, candidate) < least) {
        least = letters_apart(mistyped, candidate);
        expected = candidate;
      }
    }
    EXPECT_EQ(cli::nearest(mistyped, words), expected) << mistyped << " of " << ::testing::PrintToString(words);
    found += expected.empty() ? 0 : 1;
  }
  EXPECT_GT(found, 50);
  EXPECT_LT(found, 250);
}

TEST(PartsOfKdlcal, HelpPutsDescriptionsInAColumnOrBelowALongName) {
  CLI::App app;
  const auto formatter = std::make_shared<cli::HelpFormatter>();
  const std::string description = "What this is, in so many words that they do not fit into what is left of a line";
  const std::string lines =
      "What this is, in so many words that they do not\n" + std::string(30, ' ') + "fit into what is left of a line\n";
  ASSERT_EQ(formatter->get_column_width(), 30U);
  for (const std::size_t letters : {1U, 24U, 25U, 40U}) {
    const std::string name = "--" + std::string(letters, 'x');
    const std::string shown = formatter->make_option(app.add_flag(name, description), false);
    const std::string gap = letters < 25 ? std::string(26 - letters, ' ') : "\n" + std::string(30, ' ');
    EXPECT_EQ(shown, "  " + name + gap + lines) << letters << " letters";
  }
  EXPECT_EQ(formatter->make_description(&app), "");
  EXPECT_EQ(formatter->make_description(app.description("Few words")), "Few words\n");
  cli::add_group(app, "Letters", {"--x"});
  EXPECT_EQ(app.get_option("--x")->get_group(), "Letters");
  EXPECT_NE(app.get_option("--" + std::string(24, 'x'))->get_group(), "Letters");
}

// ---- Requirements --------------------------------------------------------------------------------------------------

TEST(PartsOfKdlcal, RequirementsHaveAPathAComparisonAndAValueInSi) {
  for (const auto& [unit, factor] : std::vector<std::pair<std::string, double>>{
           {"", 1.0}, {"m", 1.0}, {"mm", 1e-3}, {"um", 1e-6}, {"rad", 1.0}, {"mrad", 1e-3}, {" deg", kDegree}}) {
    const cli::Requirement requirement = cli::parse_requirement(" a.bc.1  <= 2.5" + unit + " ");
    EXPECT_EQ(requirement.text, " a.bc.1  <= 2.5" + unit + " ");
    EXPECT_THAT(requirement.path, ElementsAre("a", "bc", "1"));
    EXPECT_EQ(requirement.comparison, "<=");
    EXPECT_DOUBLE_EQ(requirement.value, 2.5 * factor) << unit;
  }
  EXPECT_THAT(cli::parse_requirement("rms==3.").path, ElementsAre("rms"));
  EXPECT_EQ(cli::parse_requirement("rms>-3e-2mm").value, -3e-5);
  const std::string form = "PATH OP VALUE such as 'leave_one_out.rms<=0.25mm'";
  for (const auto& [text, expected] :
       std::vector<std::pair<std::string, std::string>>{{"rms", form},
                                                        {"<1", form},
                                                        {"a.<1", form},
                                                        {"a..b<1", form},
                                                        {"a=1", "one of < <= > >= =="},
                                                        {"a<<1", "one of < <= > >= =="},
                                                        {"a<", "a number behind <"},
                                                        {"a>=mm", "a number behind >="},
                                                        {"a<x1", "a number behind <"},
                                                        {"a<1kg",
                                                         "a number alone or with the unit m, mm, um, rad, "
                                                         "mrad or deg"}}) {
    EXPECT_EQ(refusal([&, given = text] { cli::parse_requirement(given); }),
              "--require: '" + text + "' is not accepted, expected " + expected);
  }
  EXPECT_THAT(refusal([] { cli::parse_requirement("\xff<1"); }), HasSubstr("expected UTF-8"));
  EXPECT_EQ(cli::parse_requirements({"a<1", "b>2"}).at(1).text, "b>2");
}

TEST(PartsOfKdlcal, RequirementsAreJudgedByTheNumberTheyLeadTo) {
  const Json json = Json::parse(R"({"rank": 33, "list": [1, 2.5], "text": "5", "none": null,
    "fit": {"after": {"rms": 0.5}, "before": {"rms": 9}, "count": 7},
    "position_error": {"train": {"after": {"rms": 0.25}}, "test": {"rms": 3}}})");
  const auto fulfilled = [&](const std::string& text) {
    return cli::judged({cli::parse_requirement(text)}, json).at(0).message.empty();
  };
  for (const char* text : {"rank==33", "rank<=33", "rank>=33", "rank<33.1", "rank>32.9", "list.0==1", "list.1==2.5",
                           "fit.rms==0.5", "fit.after.rms==0.5", "fit.before.rms==9", "fit.count==7", "train.rms==0.25",
                           "position_error.train.rms==0.25", "test.rms==3"}) {
    EXPECT_TRUE(fulfilled(text)) << text;
  }
  for (const char* text : {"rank==32", "rank<33", "rank>33", "rank<=32.9", "rank>=33.1", "list.2>0", "list.-1>0",
                           "list.x>0", "text==5", "none==0", "fit==0", "nothing>0", "rank.after==33", "train.max>0"}) {
    EXPECT_FALSE(fulfilled(text)) << text;
  }
  const std::vector<cli::Judged> judged = cli::judged(cli::parse_requirements({"rank<1", "rank>1", "none<1"}), json);
  const std::string rank = "'rank<1' is not fulfilled: the value is 33";
  const std::string none = "'none<1' is not fulfilled: the value is not determined";
  EXPECT_THAT(cli::unfulfilled(judged), ElementsAre(rank, none));
  EXPECT_EQ(cli::judged_json(judged), Json::array({{{"text", "rank<1"}, {"fulfilled", false}, {"message", rank}},
                                                   {{"text", "rank>1"}, {"fulfilled", true}, {"message", nullptr}},
                                                   {{"text", "none<1"}, {"fulfilled", false}, {"message", none}}}));
}

// ---- The command that plans ----------------------------------------------------------------------------------------

TEST(PartsOfKdlcal, TheCommandThatPlansNamesTheFilesOfTheResult) {
  EXPECT_EQ(cli::shell_word("a/b_C-1.0+x=y:@%,z"), "a/b_C-1.0+x=y:@%,z");
  EXPECT_EQ(cli::shell_word(""), "''");
  EXPECT_EQ(cli::shell_word("it's $HOME"), "'it'\\''s $HOME'");
  const Json full = Json::parse(R"({"input": {"urdf": "r.urdf", "base": "b", "tip": "t", "measurements": "my m.csv"},
    "provenance": {"files_read": [{"role": "urdf", "path": "x"}, {"role": "joint-convention", "path": "c.json"}]}})");
  EXPECT_EQ(cli::plan_command(full),
            "kdlcal plan --urdf r.urdf --base b --tip t --joint-convention c.json --measured 'my m.csv' --add 10 "
            "--output plan.csv");
  const std::string least = "kdlcal plan --measured m.csv --add 10 --output plan.csv";
  for (const char* odd :
       {R"({"input": {"measurements": "m.csv"}})",
        R"({"input": {"measurements": "m.csv", "urdf": 5, "base": null}, "provenance": 7})",
        R"({"input": {"measurements": "m.csv"}, "provenance": {"files_read": {"role": "x"}}})",
        R"({"input": {"measurements": "m.csv"}, "provenance": {"files_read": [3, {"path": "p"}]}})"}) {
    EXPECT_EQ(cli::plan_command(Json::parse(odd)), least) << odd;
  }
  for (const char* none : {"[]", "5", "{}", R"({"input": 5})", R"({"input": {"urdf": "r"}})",
                           R"({"input": {"measurements": ["m.csv"]}})"}) {
    EXPECT_EQ(cli::plan_command(Json::parse(none)), "") << none;
  }
}

// ---- Frames --------------------------------------------------------------------------------------------------------

TEST(PartsOfKdlcal, FramesGoIntoJsonAndBack) {
  Random random(4);
  for (int trial = 0; trial < 20; ++trial) {
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    X.linear() =
        Eigen::AngleAxisd{random.uniform(-3.1, 3.1), Vector3d{random.normal(), random.normal(), 1.0}.normalized()}
            .toRotationMatrix();
    X.translation() = Vector3d{random.normal(), random.normal(), random.normal()};
    const Json json = cli::frame_json(X);
    EXPECT_GE(json["quaternion_wxyz"][0], 0.0);
    EXPECT_EQ(json["position"], (Json{X.translation().x(), X.translation().y(), X.translation().z()}));
    const KDL::Frame kdl(KDL::Rotation::Quaternion(json["quaternion_wxyz"][1], json["quaternion_wxyz"][2],
                                                   json["quaternion_wxyz"][3], json["quaternion_wxyz"][0]),
                         KDL::Vector(json["position"][0], json["position"][1], json["position"][2]));
    EXPECT_LT(difference(kdl, to_kdl(X)), 1e-14);
    for (const Json& base : {json, Json{{"base", json}, {"position", "of something else"}}}) {
      EXPECT_TRUE(cli::base_of(base, "b.json").isApprox(X, 1e-14));
    }
    TargetFrame target{.name = "T", .X_FT = X};
    EXPECT_EQ(cli::target_json(target), (Json{{"name", "T"}, {"position", json["position"]}}));
    target.with_orientation = true;
    const TargetFrame read = cli::targets_of({{"targets", Json::array({cli::target_json(target)})}}, "t.json").at(0);
    EXPECT_TRUE(read.X_FT.isApprox(X, 1e-14) && read.with_orientation && read.name == "T");
  }
  EXPECT_EQ(cli::json_text({{"a", Json::array({1, "\xff"})}}), "{\n  \"a\": [\n    1,\n    \"\xef\xbf\xbd\"\n  ]\n}\n");
}

TEST(PartsOfKdlcal, ATruthOfAnotherRobotIsRefusedFromANanometreOn) {
  const ErrorModel model = complete_model(fanuc());
  const double nominal = model.parameters[parameter_index(model, "Tz2")].nominal;
  const auto refused = [&](const Json& parameters) {
    return refusal([&] { cli::require_same_nominal({{"parameters", parameters}}, "t.json", model); });
  };
  const std::string taken = "nothing was refused";
  for (const double sign : {-1.0, 1.0}) {
    EXPECT_EQ(refused({{{"name", "Tz2"}, {"nominal", nominal + sign * 0.9e-9}}}), taken);
    EXPECT_THAT(refused({{{"name", "dq1"}, {"nominal", 0.0}}, {{"name", "Tz2"}, {"nominal", nominal + sign * 1.1e-9}}}),
                ::testing::AllOf(HasSubstr("t.json: parameters[1]: nominal 1.07"),
                                 HasSubstr(" of 'Tz2' is 1.075 in this URDF, expected the URDF, base and tip that ")));
  }
  EXPECT_EQ(refused({{{"name", "Tz2"}}, {{"name", "unknown"}, {"nominal", 5.0}}}), taken);
}

TEST(PartsOfKdlcal, RangesOfATruthAreThoseOfItsJoints) {
  const ErrorModel model = complete_model(fanuc());
  EXPECT_EQ(cli::ranges_of(Json::object(), "t.json", model).size(), 6U);
  const auto ranges = cli::ranges_of(Json::parse(R"({"joint_ranges": [{"joint": "joint_5", "lower": -1, "upper": 2},
        {"joint": "other", "lower": 0, "upper": 1}, {"joint": "joint_1", "lower": 3, "upper": 3}]})"),
                                     "t.json", model);
  ASSERT_TRUE(ranges[0] && ranges[4]);
  EXPECT_EQ(*ranges[0], std::make_pair(3.0, 3.0));
  EXPECT_EQ(*ranges[4], std::make_pair(-1.0, 2.0));
  EXPECT_FALSE(ranges[1] || ranges[2] || ranges[3] || ranges[5]);
  EXPECT_THAT(refusal([&] {
                cli::ranges_of(Json::parse(R"({"joint_ranges": [{"joint": "joint_5", "lower": 2, "upper": 1}]})"),
                               "t.json", model);
              }),
              HasSubstr("t.json: joint_ranges[0]: expected lower <= upper"));
}

// ---- Options -------------------------------------------------------------------------------------------------------

TEST(PartsOfKdlcal, ValuesOfOptionsAreTakenUpToTheirBounds) {
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

TEST(PartsOfKdlcal, GroupsOfEffectsStandInTheirOrderEachOnce) {
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

TEST(PartsOfKdlcal, AValueIsALengthWhereAllThatItMovesSlides) {
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

TEST(PartsOfKdlcal, JointValuesBeyondTheLimitsByARoundingAreNotNamed) {
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

TEST(PartsOfKdlcal, JointRangesOfSimulationsAreOfTheIndependentJoints) {
  std::string urdf = kOddArm;
  urdf.insert(urdf.find("</joint>", urdf.find("<joint name=\"elbow\"")), R"(<mimic joint="wrist"/>)");
  const ErrorModel model = complete_model(parse_robot(urdf));
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

// ---- Options about measurements ------------------------------------------------------------------------------------

TEST(PartsOfKdlcal, ATrackersNoiseIsFourNumbers) {
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

class PartsWithFiles : public CommandLine {
protected:
  std::string path(const std::string& name) const { return (directory / name).string(); }
};

TEST_F(PartsWithFiles, KnownFramesAreTheBaseAndWhatWasMeasured) {
  write("b.json", R"({"position": [1, 2, 3], "quaternion_wxyz": [0.6, 0, 0.8, 0]})");
  write("t.json", R"({"targets": [{"name": "X", "position": [9, 9, 9]}, {"name": "B", "position": [4, 5, 6]}]})");
  write("x.json", R"({"targets": [{"name": "X", "position": [9, 9, 9]}]})");
  Measurements measurements;
  measurements.targets = {"A", "B"};
  const RegistrationOptions none = cli::known_frames({}, measurements);
  EXPECT_FALSE(none.known_base);
  EXPECT_THAT(none.known_targets, IsEmpty());
  const RegistrationOptions known =
      cli::known_frames({.known_base = path("b.json"), .known_targets = path("t.json")}, measurements);
  const Eigen::Isometry3d X_WB = Eigen::Translation3d(1.0, 2.0, 3.0) * Eigen::Quaterniond(0.6, 0.0, 0.8, 0.0);
  EXPECT_TRUE(known.known_base->isApprox(X_WB, 1e-15));
  ASSERT_EQ(known.known_targets.size(), 1U);
  EXPECT_EQ(known.known_targets[0].name, "B");
  EXPECT_EQ(known.known_targets[0].X_FT.translation(), Vector3d(4.0, 5.0, 6.0));
  EXPECT_EQ(refusal([&] { cli::known_frames({.known_targets = path("x.json")}, measurements); }),
            path("x.json") + ": targets: none was measured, expected some of A, B");
}

TEST_F(PartsWithFiles, ConventionsAtHandStandBesideTheGivenOneAndTheRobotsOfKdlcal) {
  const std::string text = R"({"controller_joints": ["J"], "urdf_joints": ["j"], "matrix": [[-1]], "offset": [0.5]})";
  const auto names = [](const std::vector<JointConvention>& conventions) {
    Words result;
    std::transform(conventions.begin(), conventions.end(), std::back_inserter(result),
                   [](const JointConvention& convention) { return convention.name; });
    return result;
  };
  EXPECT_FALSE(cli::convention_of({}));
  const Words at_home = names(cli::conventions_at_hand({}));
  const std::string robots = std::string(URDF_DIR) + "/fanuc_r2000ic_165f";
  EXPECT_THAT(at_home, ::testing::IsSupersetOf({robots + "_pendant.json", robots + "_serial.json"}));
  write("given.json", text);
  write("beside.json", text);
  write("beside.txt", text);
  write("other.json", "{}");
  Words with_both = at_home;
  with_both.insert(with_both.end(), {path("beside.json"), path("given.json")});
  const cli::MeasurementArguments arguments{.joint_convention = path("given.json")};
  EXPECT_THAT(names(cli::conventions_at_hand(arguments)), ::testing::UnorderedElementsAreArray(with_both));
  EXPECT_EQ(cli::convention_of(arguments)->matrix(0, 0), -1.0);
}

TEST_F(PartsWithFiles, OptionsInAFileAreThoseOfTheSubcommand) {
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

// ---- The published matrices ----------------------------------------------------------------------------------------

TEST(PartsOfKdlcal, TheMatricesOfEachConfigurationStandInTheTableAndInTheJson) {
  cli::IdentificationAt at{.model = complete_model(fanuc())};
  Random random(6);
  at.estimate = {.errors = random_errors(at.model, random, 1e-3, 1e-3), .targets = published_targets(2)};
  at.estimate.targets[1].name = "B, left";
  at.free = Unknowns(at.model, at.estimate.targets, reduced_model(at.model, at.estimate.targets).kept);
  at.configurations = {"first", "2"};
  at.joint_values = Eigen::MatrixXd::Random(6, 2);
  const Json json = cli::identification_json(at);
  const std::vector<std::string> lines = lines_of(cli::identification_csv(at));
  ASSERT_EQ(lines.size(), 13U);
  std::string header = "configuration,target,axis";
  const auto add = [&](const std::string& name, bool length) {
    const std::string heading = name + (length ? "[m/m]" : "[m/rad]");
    header += "," + (name.find(',') == std::string::npos ? heading : "\"" + heading + "\"");
  };
  for (const Unknown& unknown : at.free.columns()) {
    add(unknown.name, unknown.length);
  }
  for (const std::string& name : base_and_tool_names(at.estimate.targets)) {
    add(name, name.rfind("phi_", 0) != 0);
  }
  EXPECT_EQ(lines[0], header);
  ASSERT_EQ(json["configurations"].size(), 2U);
  EXPECT_EQ(json["columns"], Json(at.free.names()));
  EXPECT_EQ(json["A_columns"], Json(base_and_tool_names(at.estimate.targets)));
  EXPECT_EQ(json["targets"][1]["name"], "B, left");
  for (std::size_t c = 0; c < 2; ++c) {
    const VectorXd q = at.joint_values.col(static_cast<Index>(c));
    const Eigen::MatrixXd J = identification_jacobian(at.model, at.estimate, at.free, q);
    const Eigen::MatrixXd A = base_and_tool_matrix(at.model, at.estimate, q);
    const Json& found = json["configurations"][c];
    EXPECT_EQ(found["configuration"], at.configurations[c]);
    for (Index row = 0; row < 6; ++row) {
      const std::string label = at.configurations[c] + (row < 3 ? ",A," : ",\"B, left\",") + "xyz"[row % 3];
      const std::string& line = lines[1 + 6 * c + static_cast<std::size_t>(row)];
      ASSERT_EQ(line.rfind(label + ",", 0), 0U) << line;
      std::istringstream fields(line.substr(label.size() + 1));
      for (const auto& [key, matrix] : {std::pair{"jacobian", &J}, std::pair{"A", &A}}) {
        const Json& numbers = found[key][static_cast<std::size_t>(row)];
        ASSERT_EQ(numbers.size(), static_cast<std::size_t>(matrix->cols()));
        for (Index column = 0; column < matrix->cols(); ++column) {
          EXPECT_EQ(numbers[static_cast<std::size_t>(column)], (*matrix)(row, column)) << key << row << " " << column;
          std::string field;
          std::getline(fields, field, ',');
          EXPECT_EQ(std::stod(field), (*matrix)(row, column)) << key << row << " " << column;
        }
      }
    }
  }
}

// ---- An estimate beside the truth ----------------------------------------------------------------------------------

/// Numbers of every kind, none of which is the sum or a multiple of another.
struct Compared {
  ErrorModel model;
  Estimate estimate;
  Estimate truth;
  TruthComparison comparison;

  explicit Compared(const Robot& robot, const std::string& angle, const std::string& length, const std::string& gauge)
      : model(complete_model(robot)) {
    estimate = {.X_WB = Eigen::Isometry3d(Eigen::Translation3d(1.0, 2.0, 3.0)),
                .targets = targets_at({{0.1, 0.2, 0.3}, {0.4, 0.5, 0.6}})};
    truth = {.X_WB = Eigen::Isometry3d(Eigen::Translation3d(4.0, 5.0, 6.0)),
             .targets = targets_at({{0.11, 0.22, 0.33}, {0.44, 0.55, 0.66}, {7.0, 8.0, 9.0}})};
    std::reverse(truth.targets.begin(), truth.targets.end());
    comparison.truth_in_gauge = {.X_WB = Eigen::Isometry3d(Eigen::Translation3d(1.5, 2.5, 3.5)),
                                 .targets = targets_at({{0.12, 0.23, 0.34}, {0.45, 0.57, 0.68}})};
    comparison.gauge_misfit = 0.9e-9;
    comparison.parameters = {
        {.index = parameter_index(model, angle), .estimated = 0.01, .truth = 0.025, .truth_in_gauge = 0.013},
        {.index = parameter_index(model, length), .estimated = 0.5, .truth = 0.625, .truth_in_gauge = 0.5004},
        {.index = parameter_index(model, gauge),
         .estimated = 0.002,
         .truth = 0.003,
         .truth_in_gauge = 0.07,
         .gauge = true}};
    comparison.base_difference << 1e-4, -2e-4, 3e-4, 4e-3, 5e-3, -6e-3;
    comparison.largest_length = 7e-4;
    comparison.largest_angle = 8e-3;
  }

  std::string table(int joint_width) const {
    std::string text =
        printed("  %*s%15s%15s%15s%13s\n", joint_width + 9, "", "estimated", "true", "true in gauge", "difference");
    for (const ComparedParameter& p : comparison.parameters) {
      const ErrorParameter& parameter = model.parameters[p.index];
      const bool length = parameter.kind == ParameterKind::translation;
      const double unit = length ? 1e-3 : kDegree;
      const std::string difference = p.gauge ? "gauge" : printed("%.2e", (p.estimated - p.truth_in_gauge) / unit);
      text += printed("  %-6s%-*s%-3s%15.6f%15.6f%15.6f%13s\n", parameter.name.c_str(), joint_width,
                      parameter.joint.c_str(), length ? "mm" : "deg", p.estimated / unit, p.truth / unit,
                      p.truth_in_gauge / unit, difference.c_str());
    }
    const auto line = [](const char* label, const char* unit, double x, double y, double z) {
      return printed("  %-28s%-3s%13.2e%13.2e%13.2e\n", label, unit, x, y, z);
    };
    return text + "differences along x, y and z\n" + line("base, position", "mm", 0.1, -0.2, 0.3) +
           line("base, orientation", "deg", 4e-3 / kDegree, 5e-3 / kDegree, -6e-3 / kDegree) +
           line("target A", "mm", -20.0, -30.0, -40.0) + line("target B", "mm", -50.0, -70.0, -80.0) +
           printed("largest difference up to the gauge: 7.00e-01 mm and %.2e deg\n", 8e-3 / kDegree);
  }
};

TEST(PartsOfKdlcal, TheTruthStandsBesideTheEstimateInTheTable) {
  const Compared usual(fanuc(), "dq2", "Tz2", "dq1");
  EXPECT_EQ(cli::truth_table(usual.model, usual.estimate, usual.comparison), usual.table(9));
  std::string urdf = kOddArm;
  urdf.replace(urdf.find("\"elbow\""), 7, "\"el\"");
  const Compared narrow(parse_robot(urdf), "dq4", "Tx4", "dq4");
  EXPECT_EQ(cli::truth_table(narrow.model, narrow.estimate, narrow.comparison), narrow.table(7));
}

TEST(PartsOfKdlcal, TheTruthStandsBesideTheEstimateInTheJson) {
  Compared c(fanuc(), "dq2", "Tz2", "dq1");
  const Json json = cli::truth_json(c.model, c.estimate, c.truth, c.comparison);
  ASSERT_EQ(json["parameters"].size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const ComparedParameter& p = c.comparison.parameters[i];
    const ErrorParameter& parameter = c.model.parameters[p.index];
    EXPECT_EQ(json["parameters"][i],
              (Json{{"name", parameter.name},
                    {"joint", parameter.joint},
                    {"kind", to_string(parameter.kind)},
                    {"axis", i == 0 ? "x" : "z"},
                    {"nominal", parameter.nominal},
                    {"estimated", p.estimated},
                    {"true", p.truth},
                    {"true_in_gauge", p.truth_in_gauge},
                    {"difference", i == 2 ? Json(nullptr) : Json(p.estimated - p.truth_in_gauge)},
                    {"gauge", i == 2}}));
  }
  EXPECT_EQ(json["base"], (Json{{"estimated", cli::frame_json(c.estimate.X_WB)},
                                {"true", cli::frame_json(c.truth.X_WB)},
                                {"true_in_gauge", cli::frame_json(c.comparison.truth_in_gauge.X_WB)},
                                {"difference", {1e-4, -2e-4, 3e-4, 4e-3, 5e-3, -6e-3}}}));
  ASSERT_EQ(json["targets"].size(), 2U);
  const auto position = [](const TargetFrame& target) { return cli::position_json(target.X_FT.translation()); };
  for (std::size_t t = 0; t < 2; ++t) {
    const TargetFrame& in_gauge = c.comparison.truth_in_gauge.targets[t];
    const Vector3d difference = c.estimate.targets[t].X_FT.translation() - in_gauge.X_FT.translation();
    EXPECT_EQ(json["targets"][t], (Json{{"name", t == 0 ? "A" : "B"},
                                        {"estimated", position(c.estimate.targets[t])},
                                        {"true", position(c.truth.targets[2 - t])},
                                        {"true_in_gauge", position(in_gauge)},
                                        {"difference", cli::position_json(difference)}}));
  }
  const Compared skewed(parse_robot(kOddArm), "dq3", "Tx4", "dq1");
  const Json of_skewed = cli::truth_json(skewed.model, skewed.estimate, skewed.truth, skewed.comparison);
  EXPECT_EQ(of_skewed["parameters"][0]["axis"], "") << "along none of the three";
  EXPECT_EQ(json["largest_difference"], (Json{{"length", 7e-4}, {"angle", 8e-3}}));
  EXPECT_EQ(json["gauge_misfit"], 0.9e-9);
  EXPECT_EQ(json["comparable"], true);
  c.comparison.gauge_misfit = 1.1e-9;
  EXPECT_EQ(cli::truth_json(c.model, c.estimate, c.truth, c.comparison)["comparable"], false);
  EXPECT_TRUE(cli::statistics_json({}).is_null());
  const ErrorStatistics statistics{.count = 1, .mean = 2.0, .rms = 3.0, .p95 = 4.0, .max = 5.0, .std = 6.0};
  EXPECT_EQ(cli::statistics_json(statistics),
            (Json{{"count", 1}, {"mean", 2.0}, {"rms", 3.0}, {"p95", 4.0}, {"max", 5.0}, {"std", 6.0}}));
}

TEST(PartsOfKdlcal, TheRoundsOfTheTwoStepProcedureAreListed) {
  TwoStepTrialResult result;
  result.identification.termination = Termination::iteration_limit;
  result.identification.message = "still moving";
  result.floor = 3e-5;
  for (const int number : {1, 2}) {
    const double factor = number == 1 ? 1.0 : 0.5;
    result.rounds.push_back({.round = {.number = number, .change = 1e-3 * factor, .misfit = 2e-3 * factor},
                             .held_out = {.count = 7, .rms = 3e-3 * factor, .max = 4e-3 * factor}});
  }
  const std::string rounds =
      printed("%-7s%15s%15s%15s%15s\n", "round", "change [mm]", "misfit [mm]", "held out, rms", "max [mm]") +
      printed("%5d  %15.4e%15.4e%15.4e%15.4e\n", 1, 1.0, 2.0, 3.0, 4.0) +
      printed("%5d  %15.4e%15.4e%15.4e%15.4e\n", 2, 0.5, 1.0, 1.5, 2.0) + "iteration_limit: still moving\n";
  EXPECT_EQ(cli::rounds_table(result), rounds);
  Json json = cli::rounds_json(result);
  EXPECT_EQ(json["rounds"][1], (Json{{"round", 2},
                                     {"change", 0.5e-3},
                                     {"misfit", 1e-3},
                                     {"held_out", cli::statistics_json(result.rounds[1].held_out)}}));
  json.erase("rounds");
  EXPECT_EQ(json, (Json{{"termination", "iteration_limit"},
                        {"message", "still moving"},
                        {"settled", false},
                        {"convergence_factor", nullptr}}));
  result.settled = true;
  result.factor = 0.65;
  EXPECT_EQ(cli::rounds_table(result), rounds +
                                           "the last change is what noise alone causes, 3.00e-02 mm a round\n"
                                           "each round left 0.650 of the change of the round before\n");
  EXPECT_EQ(cli::rounds_json(result)["convergence_factor"], 0.65);
  EXPECT_EQ(cli::rounds_json(result)["settled"], true);
  result.identification.termination = Termination::converged;
  result.factor = 0.0;
  EXPECT_THAT(cli::rounds_table(result), ::testing::EndsWith("converged: still moving\n"));
}

}  // namespace
}  // namespace kdl_calibration::testing::cli_parts_test
