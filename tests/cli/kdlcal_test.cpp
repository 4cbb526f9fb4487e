#include <cmath>
#include <sstream>

#include "calibration/calibrate.hpp"
#include "cli_support.hpp"
#include "kdl_calibration/measurements.hpp"
#include "model/parameters.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::kdlcal_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using Json = nlohmann::json;

const std::string kUrdf = std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf";
const std::string kSerial = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_serial.json";
const std::string kPendant = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json";
const std::string kHeader = "configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z\n";

std::string urdf(const std::string& joints) {
  return R"(<robot name="r"><link name="base"/><link name="arm"/><link name="tool"/><link name="aside"/>)" + joints +
         "</robot>";
}

std::string joint(const std::string& name, const std::string& type, const std::string& parent, const std::string& child,
                  const std::string& more = "") {
  return "<joint name=\"" + name + "\" type=\"" + type + "\"><parent link=\"" + parent + "\"/><child link=\"" + child +
         "\"/><axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" velocity=\"1\" effort=\"1\"/>" + more + "</joint>";
}

// ---- Usage ---------------------------------------------------------------------------------------------------------

class Usage : public CommandLine {};

TEST_F(Usage, HelpShowsAnExampleOfEverySubcommandThatWorksAndNoOther) {
  const Outcome help = run({"--help"});
  EXPECT_EQ(help.status, 0);
  EXPECT_EQ(help.err, "");
  EXPECT_THAT(help.out, HasSubstr("\n  report "));
  for (const std::string name :
       {"model", "fk", "jacobian", "simulate", "calibrate", "validate", "plan", "compensate"}) {
    EXPECT_THAT(help.out, HasSubstr("\n  " + name + " "));
    const Outcome own = run({name, "--help"});
    EXPECT_EQ(own.status, 0) << name;
    EXPECT_EQ(own.err, "") << name;
    EXPECT_THAT(own.out, AllOf(HasSubstr("Example:\n  kdlcal " + name + " "), HasSubstr("--urdf"), HasSubstr("--json"),
                               HasSubstr("--config FILE")));
  }
}

TEST_F(Usage, HelpListsEverySubcommandThatHasATableOfItsOptions) {
  std::istringstream help(run({"--help"}).out);
  std::vector<std::string> names;
  bool subcommands = false;
  for (std::string line; std::getline(help, line);) {
    subcommands = subcommands || line.rfind("Subcommands:", 0) == 0;
    if (subcommands && line.rfind("  ", 0) == 0 && line[2] != ' ') {
      names.push_back(line.substr(2, line.find(' ', 2) - 2));
    }
  }
  EXPECT_THAT(names, ::testing::ElementsAre("model", "fk", "jacobian", "simulate", "calibrate", "validate", "plan",
                                            "compensate", "frames", "report", "export", "import",
                                            "compare"));  // see compensate_test.cpp, report_test.cpp, export_test.cpp
}

TEST_F(Usage, VersionIsOneLine) {
  const Outcome version = run({"--version"});
  EXPECT_EQ(version.status, 0);
  EXPECT_THAT(version.out, ::testing::MatchesRegex("kdlcal [0-9]+\\.[0-9]+\\.[0-9]+\n"));
}

TEST_F(Usage, RefusesWhatTheParserDoesNotKnowOnOneLine) {
  expect_refused({}, {"no subcommand", "calibrate"});
  expect_refused({"calibrat"}, {"'calibrat'", "no subcommand", "calibrate"});
  expect_refused({"frame"}, {"'frame'", "no subcommand"});
  expect_refused({"calibrate"}, {"--measurements", "required"});
  expect_refused({"calibrate", "--mesurements", "a.csv"}, {"'--mesurements'", "not expected"});
  expect_refused({"fk"}, {"--joints", "required"});
  expect_refused({"fk", "--joints", "0,0,0,0,0,0", "jacobian"}, {"'jacobian'", "not expected"});
  expect_refused({"simulate", "--seed"}, {"--seed", "no value"});
  expect_refused({"simulate", "--seed", "1", "--seed", "2"}, {"--seed", "more than once"});
  expect_refused({"simulate", "--seed", "-1"}, {"--seed", "'-1'", "whole number"});
  expect_refused({"simulate", "--configurations", "2.5"}, {"--configurations", "'2.5'", "whole number"});
  expect_refused({"simulate", "--noise", "nan"}, {"--noise", "'nan'", "metres"});
  expect_refused({"simulate", "--noise", "-0.1"}, {"--noise", "'-0.1'", "0 or more"});
  expect_refused({"simulate", "--noise", "0,1"}, {"--noise", "'0,1'", "metres"});
  expect_refused({"simulate", "--angle-sigma", "0.1", "--angle-sigma-deg", "3"},
                 {"--angle-sigma: is given beside --angle-sigma-deg, expected one of the two"});
  for (const std::string given : {"--result", "--measured", "--target-file"}) {
    expect_refused({"plan", given, "none", "--targets", "5"}, {given + ": is given beside --targets"});
  }
  expect_refused({"simulate", "--target-file", "none", "--targets", "5"}, {"--targets: is given beside --target-file"});
  for (const std::vector<std::string>& list :
       std::vector<std::vector<std::string>>{{"fk", "--joints", "0,,0,0,0,0,0"},
                                             {"calibrate", "--fix", "a,,b"},
                                             {"calibrate", "--exclude", ",1"},
                                             {"calibrate", "--noise-independent", "1,"},
                                             {"simulate", "--effects", ""}}) {
    expect_refused(list, {list[1] + ": '" + list[2] + "' has an empty item, expected a value on both sides of each"});
  }
  write("list.toml", "joints = [0, , 0, 0, 0, 0, 0]\n");
  expect_refused({"fk", "--config", "list.toml"}, {"--joints: '' has an empty item"});
  expect_refused({"simulate", "--json"}, {"--json", "--output"});
  expect_refused({"simulate", "--output", ""}, {"--output", "a file name"});
  expect_refused({"model", "--targets", "0"}, {"--targets", "'0'", "from 1"});
  expect_refused({"calibrate", "--measurements", "a.csv", "--method", "best"}, {"'best'", "joint, two-step"});
}

TEST_F(Usage, NamesAnOptionThatNobodyKnows) {
  const auto said = [&](const std::string& option) { return run({"calibrate", option}).err; };
  EXPECT_EQ(said("--zzzzzzzz"), "kdlcal calibrate: '--zzzzzzzz' is not expected here, see kdlcal calibrate --help\n");
  EXPECT_EQ(said("--measurments=m.csv"),
            "kdlcal calibrate: '--measurments=m.csv' is not expected here, did you mean --measurements? See kdlcal "
            "calibrate --help\n");
  const std::string file(500, 'x');
  const std::string longest = "kdlcal: " + file + ": No such file or directory";
  EXPECT_EQ(run({"model", "--urdf", file}).err, longest.substr(0, 400) + "...\n");
}

/// What is wrong with options and files to write is said before a file is read that would take its time.
TEST_F(Usage, RefusesWhatCannotBeWrittenBeforeItReads) {
  write("old", "old");
  for (const std::vector<std::string>& command :
       std::vector<std::vector<std::string>>{{"simulate", "--output", "old"},
                                             {"simulate", "--monte-carlo", "2", "--report", "old"},
                                             {"simulate", "--two-step", "2", "--truth", "old"},
                                             {"simulate", "--two-step", "2", "--report", "old"},
                                             {"plan", "--output", "old"},
                                             {"plan", "--report", "old"},
                                             {"validate", "--measurements", "none.csv", "--report", "old"},
                                             {"jacobian", "--identification", "--joints", "0", "--output", "old"},
                                             {"calibrate", "--measurements", "none.csv", "--covariance", "old"},
                                             {"report", "--result", "none.json", "--output", "old"}}) {
    std::vector<std::string> words = command;
    words.insert(words.end(), {"--urdf", "none.urdf"});
    expect_refused(words, {command[command.size() - 2] + ": 'old' exists, expected a new file name or --force"});
  }
  const std::vector<std::string> calibrate = {"calibrate", "--measurements", "none.csv", "--urdf", "none.urdf"};
  const auto with = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words = calibrate;
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  expect_refused(with({"--note", "serial"}), {"--note: 'serial' is not accepted, expected key=value in UTF-8"});
  expect_refused(with({"--note", "serial=\xff"}), {"--note", "expected key=value in UTF-8"});
  expect_refused(with({"--require", "rms"}), {"--require: 'rms'"});
  expect_refused({"validate", "--measurements", "none.csv", "--require", "rms"}, {"--require: 'rms'"});
  expect_refused({"plan", "--urdf", "none.urdf", "--monte-carlo", "2", "--effects", "gain"},
                 {"--monte-carlo: tries the plan on rigid arms, expected it without --effects"});
  expect_refused({"plan", "--urdf", "none.urdf", "--measured", "m.csv", "--add", "2", "--configurations", "3"},
                 {"--configurations: --add says how many to choose, expected one of the two"});
}

TEST_F(Usage, RefusesJointValuesThatDoNotFitTheRobot) {
  expect_refused({"fk", "--joints", "1,2,3"}, {"--joints", "3 values", "expected 6", "joint_1"});
  expect_refused({"fk", "--joints", "1,2,3,4,5,six"}, {"--joints", "'six'", "joint_6", "radians"});
  expect_refused({"jacobian", "--joints", "1,2,inf,4,5,6", "--degrees"}, {"'inf'", "joint_3", "degrees"});
}

TEST_F(Usage, RefusesJointRangesThatDoNotFitTheRobot) {
  write("slide.urdf", urdf(joint("s", "prismatic", "base", "arm") + joint("f", "fixed", "arm", "tool") +
                           joint("g", "fixed", "base", "aside")));
  expect_refused({"simulate", "--joint-ranges", "1:2,3:4"}, {"--joint-ranges", "2 entries", "6 times lower:upper"});
  expect_refused({"simulate", "--urdf", "slide.urdf", "--tip", "arm", "--joint-ranges", "published"},
                 {"'published'", "six revolute"});
  expect_refused({"simulate", "--urdf", "slide.urdf", "--tip", "arm", "--joint-ranges", "5:-5"},
                 {"'5:-5'", "millimetres"});
}

TEST_F(Usage, TakesOptionsFromAFileAndLetsTheCommandLineWin) {
  write("all.toml",
        "joints = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]\njson = true\nnoise = 0.001\n\n[fk]\nframes = true\n"
        "[simulate]\nconfigurations = 4\n");
  const std::string given = run({"fk", "--joints", "0.1,0.2,0.3,0.4,0.5,0.6", "--json"}).out;
  EXPECT_EQ(run({"fk", "--config", "all.toml"}).out, given);
  EXPECT_EQ(run({"--config", "all.toml", "fk"}).out, given);
  EXPECT_EQ(run({"fk", "--config", "all.toml", "--joints", "0,0,0,0,0,0"}).out,
            run({"fk", "--joints", "0,0,0,0,0,0", "--json"}).out);
  write("simulate.ini", "[simulate]\nconfigurations=4\noutput=m.csv\ntruth=t.json\n");
  EXPECT_EQ(run({"simulate", "--config", "simulate.ini"}).status, 0);
  EXPECT_EQ(json_of("t.json")["configurations"], 4);
}

TEST_F(Usage, RefusesAnOptionFileThatItDoesNotUnderstand) {
  write("key.toml", "jonts = [1]\n");
  write("section.toml", "[calibrat]\nmethod = \"joint\"\n");
  write("blank.toml", "");
  write("mark.toml", "\xef\xbb\xbf\n");
  for (const std::string file : {"blank.toml", "mark.toml"}) {
    expect_refused({"fk", "--config", file, "--joints", "0,0,0,0,0,0"}, {file + ": is empty, expected options"});
  }
  expect_refused({"fk", "--config", "", "--joints", "0,0,0,0,0,0"}, {"--config: '' is not accepted", "a file name"});
  expect_refused({"fk", "--config", "none.toml", "--joints", "0,0,0,0,0,0"}, {"--config", "'none.toml'"});
  expect_refused({"fk", "--config", "key.toml", "--joints", "0,0,0,0,0,0"}, {"key.toml", "'jonts'", "no option"});
  expect_refused({"fk", "--config", "section.toml", "--joints", "0,0,0,0,0,0"},
                 {"section.toml", "[calibrat]", "no subcommand"});
}

TEST_F(Usage, StandardOutputThatIsFullIsAnError) {
  const Outcome outcome = run({"model"}, {.out = "/dev/full"});
  EXPECT_EQ(outcome.status, 2);
  EXPECT_THAT(outcome.err, HasSubstr("standard output"));
}

// ---- Bad robots ----------------------------------------------------------------------------------------------------

class BadRobot : public CommandLine {
protected:
  void refuse(const std::string& text, const std::vector<std::string>& more, const std::vector<std::string>& facts) {
    write("robot.urdf", text);
    std::vector<std::string> arguments = {"model", "--urdf", "robot.urdf"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    std::vector<std::string> all = {"robot.urdf"};
    all.insert(all.end(), facts.begin(), facts.end());
    expect_refused(arguments, all);
  }
};

TEST_F(BadRobot, DoesNotExist) {
  expect_refused({"model", "--urdf", "none.urdf"}, {"none.urdf", "No such file"});
  expect_refused({"calibrate", "--urdf", "none.urdf", "--measurements", "m.csv"}, {"none.urdf", "No such file"});
}

TEST_F(BadRobot, IsMalformed) { refuse("<robot name='r'>\n<link name='a'>\n</robot>", {}, {"robot.urdf:"}); }

TEST_F(BadRobot, HasNoSuchBaseOrTip) {
  const std::string text = urdf(joint("j", "revolute", "base", "arm") + joint("f", "fixed", "arm", "tool") +
                                joint("g", "fixed", "base", "aside"));
  refuse(text, {"--base", "root"}, {"'root'", "base", "arm", "tool", "aside"});
  refuse(text, {"--tip", "hand"}, {"'hand'", "base", "arm", "tool", "aside"});
  refuse(text, {}, {"tool", "aside", "tip"});
}

TEST_F(BadRobot, HasNoPathFromBaseToTip) {
  const std::string text = urdf(joint("j", "revolute", "base", "arm") + joint("f", "fixed", "arm", "tool") +
                                joint("g", "revolute", "base", "aside"));
  refuse(text, {"--base", "aside", "--tip", "tool"}, {"'aside'", "'tool'"});
}

TEST_F(BadRobot, HasNoMovingJoint) {
  const std::string text = urdf(joint("j", "fixed", "base", "arm") + joint("f", "fixed", "arm", "tool") +
                                joint("g", "revolute", "base", "aside"));
  refuse(text, {"--tip", "tool"}, {"no moving joint", "'base'", "'tool'"});
}

// ---- Bad measurements ----------------------------------------------------------------------------------------------

class BadMeasurements : public CommandLine {
protected:
  void refuse(const std::string& csv, const std::vector<std::string>& facts,
              const std::vector<std::string>& more = {}) {
    write("bad.csv", csv);
    std::vector<std::string> all = {"bad.csv"};
    all.insert(all.end(), facts.begin(), facts.end());
    for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
             {"validate", "--measurements", "bad.csv"},
             {"calibrate", "--measurements", "bad.csv", "--output", "o.urdf", "--result", "r.json"}}) {
      std::vector<std::string> arguments = command;
      arguments.insert(arguments.end(), more.begin(), more.end());
      expect_refused(arguments, all);
    }
  }
};

TEST_F(BadMeasurements, DoNotExist) {
  expect_refused({"calibrate", "--measurements", "none.csv"}, {"none.csv", "No such file"});
  expect_refused({"validate", "--measurements", "."}, {"directory"});
}

TEST_F(BadMeasurements, AreEmpty) {
  refuse("", {"expected"});
  refuse(kHeader, {"no rows", "header"});
}

TEST_F(BadMeasurements, LackAColumn) {
  refuse("configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,x,y,z\n1,A,0,0,0,0,0,1,1,1\n", {"joint_6"});
  refuse("configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y\n1,A,0,0,0,0,0,0,1,1\n", {"z"});
}

TEST_F(BadMeasurements, HaveAnUnknownJoint) {
  refuse("configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,joint_7,x,y,z\n", {"joint_7"});
}

TEST_F(BadMeasurements, HaveAnUnknownUnit) {
  refuse("configuration,target,joint_1[grad],joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z\n",
         {"joint_1", "grad", "rad", "deg"});
  refuse("configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x[cm],y,z\n", {"cm", "mm"});
}

TEST_F(BadMeasurements, HoldNoFiniteNumber) {
  for (const std::string value : {"nan", "inf", "-inf", "1e999", "abc", ""}) {
    write("joint.csv", kHeader + "1,A,0,0," + value + ",0,0,0,1,1,1\n");
    expect_refused({"calibrate", "--measurements", "joint.csv"}, {"joint.csv:2", "joint_3", value});
    write("point.csv", kHeader + "1,A,0,0,0,0,0,0," + (value.empty() ? "" : "1") + "," + value + ",\n");
    expect_refused({"validate", "--measurements", "point.csv"}, {"point.csv:2", value.empty() ? "x" : "y", value});
  }
}

TEST_F(BadMeasurements, HaveARaggedRow) {
  refuse(kHeader + "1,A,0,0,0,0,0,0,1,1,1\n2,A,0,0,0,0,0,1,1,1\n", {":3", "10", "11"});
}

TEST_F(BadMeasurements, HaveARowTwice) {
  refuse(kHeader + "7,A,0,0,0,0,0,0,1,1,1\n7,A,0,0,0,0,0,0,1,1,2\n", {":3", "'7'", "'A'"});
}

TEST_F(BadMeasurements, ComeWithABadJointConvention) {
  write("size.json", R"({"controller_joints": ["J1"], "urdf_joints": ["joint_1"], "matrix": [[1, 2]], "offset": [0]})");
  write("singular.json", R"({"controller_joints": ["J1", "J2"], "urdf_joints": ["joint_1", "joint_2"],
                             "matrix": [[1, 2], [2, 4]], "offset": [0, 0]})");
  write("few.json", R"({"controller_joints": ["J1"], "urdf_joints": ["joint_1"], "matrix": [[1]], "offset": [0]})");
  const auto with = [&](const std::string& file, const std::vector<std::string>& facts) {
    write("m.csv", kHeader + "1,A,0,0,0,0,0,0,1,1,1\n");
    expect_refused({"calibrate", "--measurements", "m.csv", "--joint-convention", file}, facts);
    expect_refused({"fk", "--joints", "0,0,0,0,0,0", "--joint-convention", file}, facts);
  };
  with("none.json", {"none.json", "No such file"});
  with("size.json", {"size.json", "matrix"});
  with("singular.json", {"singular.json", "singular"});
  with("few.json", {"few.json", "joint_2"});
}

TEST_F(BadMeasurements, AreTooFew) {
  ASSERT_EQ(run({"simulate", "--configurations", "3", "--output", "few.csv"}).status, 0);
  expect_refused({"calibrate", "--measurements", "few.csv", "--output", "o.urdf", "--result", "r.json"}, {"27", "33"});
}

TEST_F(BadMeasurements, HaveNoRowToFit) {
  refuse(
      "configuration,split,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z\n1,trial,A,0,0,0,0,0,0,1,1,1\n",
      {"trial", "train"});
  write(
      "test.csv",
      "configuration,split,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z\n1,test,A,0,0,0,0,0,0,1,1,1\n");
  expect_refused({"calibrate", "--measurements", "test.csv"}, {"test.csv", "train"});
}

// ---- Known frames --------------------------------------------------------------------------------------------------

class KnownFrames : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    write_once("an arm to know", [&] {
      ASSERT_EQ(run({"simulate", "--noise", "1e-5", "--output", "m.csv", "--truth", "truth.json"}).status, 0);
    });
  }
};

TEST_F(KnownFrames, MayHaveARoundedQuaternion) {
  Json base = json_of("truth.json")["base"];
  const auto answer = [&](double factor) {
    Json scaled = base;
    for (Json& number : scaled["quaternion_wxyz"]) {
      number = number.get<double>() * factor;
    }
    write("base.json", scaled.dump());
    return run_json({"validate", "--measurements", "m.csv", "--known-base", "base.json", "--json"});
  };
  const double exact = answer(1.0)["position_error"]["all"]["rms"];
  EXPECT_GT(exact, 0.0);
  for (const double factor : {1.0009, 0.9991}) {
    EXPECT_NEAR(answer(factor)["position_error"]["all"]["rms"], exact, 1e-12) << factor;
  }
  for (const double factor : {1.0011, 0.9989}) {
    Json scaled = base;
    for (Json& number : scaled["quaternion_wxyz"]) {
      number = number.get<double>() * factor;
    }
    write("base.json", scaled.dump());
    expect_refused({"validate", "--measurements", "m.csv", "--known-base", "base.json"}, {"base.json", "norm 1"});
  }
}

TEST_F(KnownFrames, AreRefusedWithFileAndKeyWhereTheyAreBad) {
  write("text.json", "{\n\"base\": oops}");
  write("empty.json", "{}");
  write("short.json", R"({"position": [1, 2], "quaternion_wxyz": [1, 0, 0, 0]})");
  write("long.json", R"({"base": {"position": [1, 2, 3], "quaternion_wxyz": [1, 1, 0, 0]}})");
  write("huge.json", R"({"position": [1e999, 2, 3], "quaternion_wxyz": [1, 0, 0, 0]})");
  write("word.json", R"({"position": ["1", 2, 3], "quaternion_wxyz": [1, 0, 0, 0]})");
  const auto base = [&](const std::string& file, const std::vector<std::string>& facts) {
    expect_refused({"calibrate", "--measurements", "m.csv", "--known-base", file, "--result", "r.json"}, facts);
    expect_refused({"validate", "--measurements", "m.csv", "--known-base", file}, facts);
  };
  base("none.json", {"none.json", "No such file"});
  base("text.json", {"text.json:2", "JSON"});
  base("empty.json", {"empty.json", "position"});
  base("short.json", {"short.json: position", "3 numbers"});
  base("long.json", {"long.json: base: quaternion_wxyz", "norm 1"});
  base("huge.json", {"huge.json", "finite"});
  base("word.json", {"word.json: position[0]", "number"});

  write("strangers.json", R"({"targets": [{"name": "Z", "position": [0, 0, 0]}]})");
  write("nameless.json", R"({"targets": [{"position": [0, 0, 0]}]})");
  write("twice.json", R"({"targets": [{"name": "A", "position": [0, 0, 0]}, {"name": "A", "position": [0, 0, 0]}]})");
  const auto targets = [&](const std::string& file, const std::vector<std::string>& facts) {
    expect_refused({"calibrate", "--measurements", "m.csv", "--known-targets", file, "--result", "r.json"}, facts);
    expect_refused({"validate", "--measurements", "m.csv", "--known-targets", file}, facts);
  };
  targets("empty.json", {"empty.json", "targets"});
  targets("strangers.json", {"strangers.json", "A, B, C"});
  targets("nameless.json", {"nameless.json: targets[0]", "name"});
  targets("twice.json", {"twice.json: targets[1]", "'A'", "twice"});
}

TEST_F(KnownFrames, OfTheTruthMakeTheGaugeOffsetsIdentifiable) {
  const Json result = run_json({"calibrate", "--measurements", "m.csv", "--known-base", "truth.json", "--known-targets",
                                "truth.json", "--json"});
  // With both ends known the first and the last link have errors of their own as well: 20 + 5 + 5.
  EXPECT_EQ(result["rank"], 30);
  const Json truth = json_of("truth.json");
  int compared = 0;
  for (const Json& parameter : result["parameters"]) {
    for (const Json& expected : truth["parameters"]) {
      if (parameter["name"] == expected["name"]) {
        EXPECT_NEAR(parameter["error"], expected["error"], 6.0 * parameter["std"].get<double>()) << parameter["name"];
        EXPECT_FALSE(parameter["gauge"]) << parameter["name"];
        ++compared;
      }
    }
  }
  EXPECT_EQ(compared, 20);
  EXPECT_EQ(result["base"]["position"], truth["base"]["position"]);
}

TEST_F(KnownFrames, OfAResultAreTakenAsTheyAre) {
  ASSERT_EQ(run({"calibrate", "--measurements", "m.csv", "--output", "c.urdf", "--result", "r.json"}).status, 0);
  const Json free = run_json({"validate", "--urdf", "c.urdf", "--measurements", "m.csv", "--json"});
  const Json held = run_json({"validate", "--urdf", "c.urdf", "--measurements", "m.csv", "--known-base", "r.json",
                              "--known-targets", "r.json", "--json"});
  EXPECT_NEAR(held["position_error"]["all"]["rms"], free["position_error"]["all"]["rms"], 1e-9);
  const Json fit = json_of("r.json");
  EXPECT_NEAR(fit["position_error"]["train"]["after"]["rms"], free["position_error"]["train"]["rms"], 1e-9);
}

// ---- Simulation ----------------------------------------------------------------------------------------------------

class Simulate : public CommandLine {};

TEST_F(Simulate, DrawsTheSameFromTheSameSeedAndOtherwiseFromAnother) {
  const std::string first = run({"simulate", "--seed", "5"}).out;
  EXPECT_EQ(run({"simulate", "--seed", "5"}).out, first);
  EXPECT_NE(run({"simulate", "--seed", "6"}).out, first);
}

TEST_F(Simulate, KeepsTheLimitsOfTheJointsOrTheRangesAskedFor) {
  ASSERT_EQ(run({"simulate", "--configurations", "200", "--output", "limits.csv"}).status, 0);
  const Measurements limits = read_measurements(directory / "limits.csv", joint_names(fanuc()));
  EXPECT_EQ(configurations_outside_limits(complete_model(fanuc()), limits), 0);

  ASSERT_EQ(run({"simulate", "--configurations", "200", "--joint-ranges", "published", "--output", "p.csv"}).status, 0);
  const Eigen::MatrixXd q = read_measurements(directory / "p.csv", joint_names(fanuc())).joint_values;
  for (Eigen::Index i = 0; i < 6; ++i) {
    const double range = (i < 4 ? 90.0 : 180.0) * kDegree;
    EXPECT_LE(q.row(i).cwiseAbs().maxCoeff(), range);
    EXPECT_GE(q.row(i).maxCoeff(), 0.9 * range);
    EXPECT_LE(q.row(i).minCoeff(), -0.9 * range);
  }
}

TEST_F(Simulate, WritesTheTruthThatMadeTheMeasurements) {
  for (const std::string model : {"irreducible", "complete"}) {
    ASSERT_EQ(run({"simulate", "--model", model, "--repeats", "2", "--test-configurations", "7", "--output", "m.csv",
                   "--truth", "t.json", "--force"})
                  .status,
              0);
    const Measurements measurements = read_measurements(directory / "m.csv", joint_names(fanuc()));
    EXPECT_EQ(measurements.observations.size(), (30 + 7) * 3 * 2U);
    const Json truth = json_of("t.json");
    EXPECT_EQ(truth["seed"], 1);
    EXPECT_EQ(truth["noise"], 0.0);
    EXPECT_EQ(truth["parameters"].size(), model == "complete" ? 30U : 20U);
    const ErrorModel complete = complete_model(fanuc());
    Eigen::VectorXd errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(complete.parameters.size()));
    for (const Json& parameter : truth["parameters"]) {
      EXPECT_EQ(parameter["value"].get<double>(),
                parameter["nominal"].get<double>() + parameter["error"].get<double>());
      errors[static_cast<Eigen::Index>(parameter_index(complete, parameter["name"]))] = parameter["error"];
    }
    const KDL::Chain chain = error_chain(complete, errors);
    const auto& base = truth["base"]["position"];
    const auto& turn = truth["base"]["quaternion_wxyz"];
    const KDL::Frame X_WB(KDL::Rotation::Quaternion(turn[1], turn[2], turn[3], turn[0]),
                          KDL::Vector(base[0], base[1], base[2]));
    for (const Observation& observation : measurements.observations) {
      const auto& target = truth["targets"][static_cast<std::size_t>(observation.target)];
      const auto& t = target["position"];
      const KDL::Vector expected = X_WB * kdl_pose(chain, measurements.joint_values.col(observation.configuration)) *
                                   KDL::Vector(t[0], t[1], t[2]);
      EXPECT_LT((to_eigen(expected) - observation.position).norm(), 1e-12);
    }
  }
}

TEST_F(Simulate, MeasuresPosesWhereAskedTo) {
  ASSERT_EQ(run({"simulate", "--poses", "--targets", "1", "--noise", "1e-5", "--orientation-noise", "1e-5",
                 "--test-configurations", "20", "--output", "poses.csv", "--truth", "t.json"})
                .status,
            0);
  EXPECT_THAT(text_of("poses.csv"), HasSubstr("qw,qx,qy,qz"));
  EXPECT_EQ(json_of("t.json")["targets"][0]["quaternion_wxyz"].size(), 4U);
  const Json result = run_json({"calibrate", "--measurements", "poses.csv", "--json"});
  EXPECT_LT(result["position_error"]["test"]["after"]["rms"], 5e-5);
  EXPECT_EQ(result["targets"][0]["quaternion_wxyz"].size(), 4U);
}

// ---- From end to end -----------------------------------------------------------------------------------------------

class EndToEnd : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    write_once("the published experiment", [&] {
      ASSERT_EQ(run({"simulate", "--configurations", "30", "--targets", "3", "--noise", "0.00003", "--seed", "1",
                     "--test-configurations", "100", "--output", "measurements.csv", "--truth", "truth.json"})
                    .status,
                0);
    });
  }

  /// What calibrate says without further options, made once; c.urdf and r.json stand there.
  const Outcome& calibrate() {
    static Outcome outcome;
    write_once("its calibration", [&] {
      outcome = run({"calibrate", "--measurements", "measurements.csv", "--output", "c.urdf", "--result", "r.json"});
    });
    return outcome;
  }
};

TEST_F(EndToEnd, CalibratesTheVirtualRobotToItsNoise) {
  const Outcome& calibrated = calibrate();
  EXPECT_EQ(calibrated.status, 0) << calibrated.err;
  EXPECT_THAT(calibrated.out, AllOf(::testing::StartsWith("Trusted. "), HasSubstr("mm")));

  const Json result = json_of("r.json");
  EXPECT_EQ(result["termination"], "converged");
  EXPECT_EQ(result["rank"], 33);
  for (const char* key : {"software", "input", "message", "iterations", "condition", "parameters", "base", "targets",
                          "position_error", "noise", "warnings"}) {
    EXPECT_TRUE(result.contains(key)) << key;
  }
  EXPECT_GT(result["position_error"]["test"]["before"]["rms"], 0.02);
  EXPECT_LT(result["position_error"]["test"]["after"]["rms"], 1e-4);

  const Json valid = run_json({"validate", "--urdf", "c.urdf", "--measurements", "measurements.csv", "--json"});
  EXPECT_NEAR(valid["position_error"]["train"]["rms"], result["position_error"]["train"]["after"]["rms"], 1e-9);
  EXPECT_NEAR(valid["position_error"]["test"]["rms"], result["position_error"]["test"]["after"]["rms"], 1e-9);
}

TEST_F(EndToEnd, TheResultAndTheCalibratedUrdfGiveTheSameFrames) {
  ASSERT_EQ(calibrate().status, 0);
  const std::string joints = "0.3,-0.2,0.5,1,-1,2";
  const Json from_urdf = run_json({"fk", "--urdf", "c.urdf", "--joints", joints, "--json"});
  EXPECT_EQ(run_json({"fk", "--result", "r.json", "--joints", joints, "--json"}), from_urdf);
  EXPECT_NE(run_json({"fk", "--joints", joints, "--json"}), from_urdf);

  const Json J_urdf = run_json({"jacobian", "--urdf", "c.urdf", "--joints", joints, "--json"});
  const Json J_result = run_json({"jacobian", "--result", "r.json", "--joints", joints, "--json"});
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t column = 0; column < 6; ++column) {
      EXPECT_NEAR(J_urdf["kdl"][row][column], J_result["kdl"][row][column], 1e-12);
    }
  }
}

TEST_F(EndToEnd, TwoStepsReachTheSamePredictions) {
  ASSERT_EQ(calibrate().status, 0);
  const Json joint = json_of("r.json");
  const Outcome outcome = run(
      {"calibrate", "--measurements", "measurements.csv", "--method", "two-step", "--iterations", "5000", "--json"});
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  const Json two_step = Json::parse(outcome.out, nullptr, false);
  EXPECT_NEAR(two_step["position_error"]["test"]["after"]["rms"], joint["position_error"]["test"]["after"]["rms"],
              1e-6);
}

TEST_F(EndToEnd, TooFewIterationsLeaveMarkedFilesAndStatusOne) {
  const Outcome outcome = run({"calibrate", "--measurements", "measurements.csv", "--iterations", "1", "--output",
                               "c.urdf", "--result", "r.json"});
  EXPECT_EQ(outcome.status, 1);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("not to be trusted"), HasSubstr("c.urdf")));
  EXPECT_EQ(json_of("r.json")["termination"], "iteration_limit");
  EXPECT_NE(text_of("c.urdf"), "");
}

TEST_F(EndToEnd, FixedParametersStayAtZero) {
  // Errors of the published size that may not be explained leave a misfit no robot has: the exit status says so.
  const Outcome outcome = run({"calibrate", "--measurements", "measurements.csv", "--fix", "*4,dq2", "--json"});
  EXPECT_EQ(outcome.status, 1);
  const Json result = Json::parse(outcome.out);
  EXPECT_EQ(result["rank"], 33 - 5);
  for (const Json& parameter : result["parameters"]) {
    const std::string name = parameter["name"];
    if (name == "dq2" || (name.size() == 3 && name.back() == '4')) {
      EXPECT_EQ(parameter["error"], 0.0) << name;
    }
  }
  expect_refused({"calibrate", "--measurements", "measurements.csv", "--fix", "nothing*", "--result", "r.json"},
                 {"--fix", "'nothing*'", "dq1"});
}

TEST_F(EndToEnd, ValidatesOnTestRowsAloneAndSaysSo) {
  const std::string all = text_of("measurements.csv");
  std::istringstream lines(all);
  std::string test_rows;
  for (std::string line; std::getline(lines, line);) {
    if (line.find("train") == std::string::npos) {
      test_rows += line + "\n";
    }
  }
  write("test.csv", test_rows);
  const Outcome outcome = run({"validate", "--measurements", "test.csv", "--json"});
  EXPECT_EQ(outcome.status, 0);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("test.csv"), HasSubstr("no train rows")));
  const Json valid = Json::parse(outcome.out);
  EXPECT_EQ(valid["position_error"]["test"]["count"], 300);
  EXPECT_EQ(valid["position_error"]["all"], valid["position_error"]["test"]);
  EXPECT_TRUE(valid["position_error"]["train"].is_null());
}

// ---- Model, forward kinematics, Jacobian ---------------------------------------------------------------------------

class KinematicsOfKdlcal : public CommandLine {};

TEST_F(KinematicsOfKdlcal, ModelJsonIsTheIrreducibleModel) {
  const Json model = run_json({"model", "--targets", "3", "--json"});
  EXPECT_EQ(model["rank"], 33);
  EXPECT_GE(model["candidates"], 45);
  EXPECT_EQ(std::count_if(model["parameters"].begin(), model["parameters"].end(),
                          [](const Json& parameter) { return parameter["gauge"] == false; }),
            33);
  for (const Json& parameter : model["parameters"]) {
    EXPECT_TRUE(parameter.contains("name") && parameter.contains("joint") && parameter.contains("kind") &&
                parameter.contains("axis"));
    EXPECT_FALSE(parameter.contains("value"));
  }
  ASSERT_EQ(model["gauge"].size(), 2U);
  EXPECT_EQ(model["gauge"][0]["name"], "dq1");
  EXPECT_EQ(model["gauge"][0]["tied_to"], Json::array({"base.Rz"}));
  EXPECT_EQ(model["gauge"][1]["name"], "dq6");
  bool found = false;
  for (const Json& dropped : model["dropped"]) {
    if (dropped["name"] == "Rx1") {
      EXPECT_NEAR(dropped["replaced_by"]["dq2"], 1.0, 1e-9);
      found = true;
    }
  }
  EXPECT_TRUE(found);
  EXPECT_EQ(run_json({"model", "--targets", "1", "--json"})["rank"], 27);
  EXPECT_THAT(run({"model"}).out, AllOf(HasSubstr("rank 33"), HasSubstr("tied to base.Rz")));
}

TEST_F(KinematicsOfKdlcal, ErrorsOfAnotherRobotAreRefused) {
  write("other.json", R"({"parameters": [{"name": "dq9", "error": 0.1}]})");
  write("valueless.json", R"({"parameters": [{"name": "dq2"}]})");
  expect_refused({"fk", "--joints", "0,0,0,0,0,0", "--result", "other.json"}, {"other.json: parameters[0]", "'dq9'"});
  expect_refused({"fk", "--joints", "0,0,0,0,0,0", "--result", "valueless.json"},
                 {"valueless.json: parameters[0]", "error"});
}

// ---- Output files --------------------------------------------------------------------------------------------------

class OutputFiles : public CommandLine {
protected:
  std::vector<std::string> simulate(const std::string& output, const std::string& truth,
                                    const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = {"simulate", "--output", output, "--truth", truth};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
};

TEST_F(OutputFiles, ThatExistAreOverwrittenOnlyByForce) {
  write("m.csv", "old");
  write("t.json", "old");
  expect_refused(simulate("m.csv", "new.json"), {"--output", "'m.csv'", "exists", "--force"});
  expect_refused(simulate("new.csv", "t.json"), {"--truth", "'t.json'", "exists", "--force"});
  expect_refused({"calibrate", "--measurements", "absent.csv", "--result", "t.json"},
                 {"--result", "'t.json'", "--force"});
  std::filesystem::permissions(directory / "m.csv", std::filesystem::perms(0640));
  EXPECT_EQ(run(simulate("m.csv", "t.json", {"--force"})).status, 0);
  EXPECT_THAT(text_of("m.csv"), HasSubstr("configuration"));
  EXPECT_THAT(text_of("t.json"), HasSubstr("seed"));
  EXPECT_EQ(std::filesystem::status(directory / "m.csv").permissions(), std::filesystem::perms(0640));
  EXPECT_EQ(files().size(), 2U);
}

TEST_F(OutputFiles, NeedADirectoryThatExists) {
  write("file", "");
  std::filesystem::create_directory(directory / "dir");
  expect_refused(simulate("none/m.csv", "t.json"), {"--output", "'none/m.csv'", "'none'", "directory"});
  expect_refused(simulate("m.csv", "file/t.json"), {"--truth", "'file/t.json'", "'file'", "directory"});
  expect_refused(simulate("dir", "t.json", {"--force"}), {"--output", "'dir'", "is a directory"});
  expect_refused(simulate("m.csv", "none/"), {"--truth", "'none/'", "file name"});
}

TEST_F(OutputFiles, NeedADirectoryThatCanBeWritten) {
  // No file can be created in /proc, whoever asks.
  expect_refused(simulate("/proc/m.csv", "t.json"), {"--output", "'/proc/m.csv'", "cannot be written"});
  expect_refused(simulate("m.csv", "/proc/t.json"), {"--truth", "'/proc/t.json'", "cannot be written"});
}

TEST_F(OutputFiles, MustBeRegularFiles) {
  expect_refused(simulate("/dev/full", "t.json", {"--force"}), {"--output", "'/dev/full'", "no regular file"});
  ASSERT_TRUE(std::filesystem::is_character_file("/dev/full"));
  std::filesystem::create_symlink("nowhere", directory / "dangling");
  expect_refused(simulate("dangling", "t.json", {"--force"}), {"--output", "'dangling'", "leads nowhere"});
}

TEST_F(OutputFiles, MustDiffer) {
  expect_refused(simulate("same", "./same"), {"--truth", "'./same'", "same file", "--output"});
}

TEST_F(OutputFiles, BehindALinkAreReplacedThere) {
  write("real.csv", "old");
  std::filesystem::create_symlink("real.csv", directory / "link.csv");
  expect_refused(simulate("link.csv", "t.json"), {"'link.csv'", "--force"});
  EXPECT_EQ(run(simulate("link.csv", "t.json", {"--force"})).status, 0);
  EXPECT_TRUE(std::filesystem::is_symlink(directory / "link.csv"));
  EXPECT_THAT(text_of("real.csv"), HasSubstr("configuration"));
}

TEST_F(OutputFiles, LeaveNothingBehindOnAFullDisk) {
  const Surroundings little = {.largest_file = 4096};
  expect_refused(simulate("m.csv", "t.json"), {"--output", "'m.csv'", "cannot be written"}, little);
  // The first file fits, the second does not: neither appears.
  expect_refused(simulate("m.csv", "t.json", {"--configurations", "2"}), {"--truth", "'t.json'", "cannot be written"},
                 little);
  write("m.csv", "old");
  write("t.json", "old");
  expect_refused(simulate("m.csv", "t.json", {"--force"}), {"--output", "cannot be written"}, little);
  EXPECT_EQ(text_of("m.csv"), "old");
}

TEST_F(OutputFiles, AreOnlyTheOnesAskedFor) {
  const Outcome outcome = run({"simulate", "--configurations", "2"});
  EXPECT_EQ(outcome.status, 0);
  EXPECT_EQ(outcome.err, "");
  EXPECT_EQ(std::count(outcome.out.begin(), outcome.out.end(), '\n'), 1 + 2 * 3);
  EXPECT_TRUE(files().empty());
}

// ---- Real measurements ---------------------------------------------------------------------------------------------

class CommandLineOnRealData : public CommandLine {
protected:
  const std::string measurements = std::string(SHARED_DATA_DIR) + "/r2000ic_165f_tracker/measurements.csv";
};

TEST_F(CommandLineOnRealData, CalibratesTheR2000) {
  const Outcome outcome =
      run({"calibrate", "--measurements", measurements, "--joint-convention", kSerial, "--noise", "equal", "--effects",
           "none", "--prior", "none", "--leave-one-out", "--output", "c.urdf", "--result", "r.json"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  const Json result = json_of("r.json");
  EXPECT_EQ(result["rank"], 33);
  const Json& train = result["position_error"]["train"];
  EXPECT_EQ(train["after"]["count"], 720);
  EXPECT_NEAR(train["after"]["rms"], 0.161e-3, 0.001e-3);
  EXPECT_NEAR(train["after"]["max"], 0.327e-3, 0.001e-3);
  EXPECT_NEAR(train["before"]["rms"], 0.62e-3, 0.002e-3);
  EXPECT_LE(result["position_error"]["leave_one_out"]["after"]["rms"], 0.235e-3);
  EXPECT_GT(result["position_error"]["leave_one_out"]["after"]["rms"], 0.2e-3);

  const Json valid = run_json(
      {"validate", "--urdf", "c.urdf", "--measurements", measurements, "--joint-convention", kSerial, "--json"});
  EXPECT_NEAR(valid["position_error"]["all"]["rms"], train["after"]["rms"], 1e-9);
  EXPECT_NEAR(valid["position_error"]["all"]["max"], train["after"]["max"], 1e-7);
}

TEST_F(CommandLineOnRealData, SaysWhichJointConventionFits) {
  const Outcome outcome =
      run({"calibrate", "--measurements", measurements, "--joint-convention", kPendant, "--result", "r.json"});
  EXPECT_EQ(outcome.status, 1);
  EXPECT_THAT(outcome.err, HasSubstr("with the convention fanuc_r2000ic_165f_serial.json it is 0.161 mm"));
  EXPECT_THAT(json_of("r.json")["doubts"].dump(), HasSubstr("_serial.json it is 0.161 mm"));
  const Outcome valid = run({"validate", "--measurements", measurements, "--joint-convention", kPendant});
  EXPECT_EQ(valid.status, 1);
  EXPECT_THAT(valid.err, HasSubstr("with the convention fanuc_r2000ic_165f_serial.json it is 0.161 mm"));
  const Outcome right = run({"calibrate", "--measurements", measurements, "--joint-convention", kSerial, "--effects",
                             "none", "--prior", "none"});
  EXPECT_EQ(right.status, 0);
  EXPECT_THAT(right.err, ::testing::Not(HasSubstr("convention")));
}

// A figure of the terminal's table of errors [mm].
double printed(const std::string& text, const std::string& row, std::size_t column) {
  const std::size_t line = text.find("\n" + row + "  ");
  EXPECT_NE(line, std::string::npos) << row << "\n" << text;
  return line == std::string::npos ? 0.0 : std::stod(text.substr(line + 27 + 12 * column, 12));
}

// One figure, one name: terminal, result and validation.
TEST_F(CommandLineOnRealData, ErrorsAreTheSameWhereverTheyStand) {
  ASSERT_EQ(run({"simulate", "--noise", "3e-5", "--length-sigma", "0.001", "--angle-sigma", "0.001", "--repeats", "3",
                 "--test-configurations", "5", "--output", "virtual.csv"})
                .status,
            0);
  const std::string folder = std::string(SHARED_DATA_DIR) + "/ur10_tracker_poses";
  for (const std::vector<std::string>& data : std::vector<std::vector<std::string>>{
           {"--measurements", "virtual.csv"},
           {"--measurements", measurements, "--joint-convention", kSerial},
           {"--urdf", folder + "/ur10.urdf", "--tip", "tool0", "--measurements", folder + "/measurements.csv",
            "--effects", "gravity", "--prior", "none", "--k-fold", "10"}}) {
    std::vector<std::string> calibrate = {"calibrate", "--result", "r.json", "--force"};
    calibrate.insert(calibrate.end(), data.begin(), data.end());
    const Outcome outcome = run(calibrate);
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_LE(std::count(outcome.out.begin(), outcome.out.end(), '\n'), 40) << outcome.out;
    const Json& result = json_of("r.json");
    const Json& errors = result["position_error"];
    const auto expect_row = [&](const std::string& row, const Json& pair, const char* figure) {
      EXPECT_NEAR(printed(outcome.out, row, 0), pair["before"][figure].get<double>() * 1e3, 5.1e-4) << row;
      EXPECT_NEAR(printed(outcome.out, row, 1), pair["after"][figure].get<double>() * 1e3, 5.1e-4) << row;
      if (pair.contains("exported_urdf")) {
        EXPECT_NEAR(printed(outcome.out, row, 2), pair["exported_urdf"][figure].get<double>() * 1e3, 5.1e-4) << row;
      }
    };
    expect_row("fitted", errors["train"], "rms");
    const Json& held_out = errors.contains("k_fold") ? errors["k_fold"] : errors["leave_one_out"];
    expect_row(errors.contains("k_fold")           ? "10-fold"
               : errors["train"].contains("means") ? "left out, means of repeats"
                                                   : "left out",
               held_out, "rms");
    expect_row("largest, left out", held_out, "max");
    std::vector<std::string> validate = {"validate", "--result", "r.json", "--json"};
    const auto end = data[0] == "--urdf" ? data.end() - 6 : data.end();
    validate.insert(validate.end(), data.begin(), end);
    const Json valid = run_json(validate)["position_error"];
    for (const std::string set : {"train", "test"}) {
      if (!errors.contains(set)) {
        continue;
      }
      expect_row(set == "train" ? "fitted" : "test", errors[set], "rms");
      // Base and targets are registered, not fitted with the noise's weights.
      EXPECT_NEAR(valid[set]["rms"].get<double>() / errors[set]["after"]["rms"].get<double>(), 1.0, 0.02) << set;
      ASSERT_EQ(errors[set].contains("means"), valid[set].contains("means"));
      if (errors[set].contains("means")) {
        expect_row(set == "train" ? "fitted, means of repeats" : "test, means of repeats", errors[set]["means"], "rms");
        EXPECT_NEAR(valid[set]["means"]["rms"].get<double>() / errors[set]["means"]["after"]["rms"].get<double>(), 1.0,
                    0.02)
            << set;
      }
    }
    EXPECT_EQ(result.contains("joint_offsets"), data.size() == 4);
  }
}

class CommandLineOnRealDataLongRun : public CommandLineOnRealData {};

const std::vector<std::string> kUr10FromPoses = {
    "calibrate", "--urdf",         std::string(SHARED_DATA_DIR) + "/ur10_tracker_poses/ur10.urdf",        "--tip",
    "tool0",     "--measurements", std::string(SHARED_DATA_DIR) + "/ur10_tracker_poses/measurements.csv", "--json"};

void expect_ur10_predicted(const Json& result) {
  EXPECT_LE(result["position_error"]["test"]["after"]["rms"], 0.47e-3);
  EXPECT_NEAR(result["position_error"]["test"]["before"]["rms"], 0.95e-3, 0.05e-3);
}

TEST_F(CommandLineOnRealData, CalibratesTheUr10FromPoses) {
  std::vector<std::string> words = kUr10FromPoses;
  words.insert(words.end(), {"--effects", "none", "--prior", "none"});
  expect_ur10_predicted(run_json(words));
}

TEST_F(CommandLineOnRealDataLongRun, CalibratesTheUr10FromPosesByAutomaticChoices) {
  expect_ur10_predicted(run_json(kUr10FromPoses));
}

}  // namespace
}  // namespace kdl_calibration::testing::kdlcal_test
