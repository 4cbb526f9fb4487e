#include <algorithm>

#include "calibration/calibration_result.hpp"
#include "cli_support.hpp"
#include "json_support.hpp"
#include "kdl_calibration/measurements.hpp"
#include "printed_text.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing::kdlcal_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using Json = nlohmann::json;

const std::string kSerial = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_serial.json";
const std::string kHeader = "configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z\n";

class Usage : public CommandLine {};

TEST_F(Usage, HelpShowsAnExampleOfEverySubcommandThatWorksAndNoOther) {
  const Outcome help = run({"--help"});
  EXPECT_EQ(help.status, 0);
  EXPECT_EQ(help.err, "");
  for (const std::string name : {"frames", "report", "export", "import", "compare"}) {
    EXPECT_THAT(help.out, HasSubstr("\n  " + name + " "));
  }
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

TEST_F(Usage, TheNextStepThatCalibrateNamesRuns) {
  succeed(words_of("simulate --noise 3e-5 --output m.csv"));
  write("NEW.csv", text_of("m.csv"));
  for (const std::string written : {"--output c.urdf", "--result r.json", "--result s.json --tip flange"}) {
    std::string text = run(words_of("calibrate --measurements m.csv --effects none " + written)).out;
    std::replace(text.begin(), text.end(), '\n', ' ');
    text = squeezed(text);
    const std::size_t begin = text.find("Next: kdlcal ");
    const std::size_t end = text.find(", with points of other days and places");
    ASSERT_NE(begin, std::string::npos) << text;
    ASSERT_NE(end, std::string::npos) << text;
    const std::string command = text.substr(begin, end - begin).substr(std::string("Next: kdlcal ").size());
    EXPECT_THAT(command, AllOf(HasSubstr("validate"), HasSubstr("--measurements NEW.csv")));
    succeed(words_of(command));
  }
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
    expect_refused(command + Words{"--urdf", "none.urdf"},
                   {command[command.size() - 2] + ": 'old' exists, expected a new file name or --force"});
  }
  const auto with = [](const Words& more) {
    return words_of("calibrate --measurements none.csv --urdf none.urdf") + more;
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

TEST_F(Usage, TakesOptionsFromAFileAndLetsTheCommandLineWin) {
  write("all.toml",
        "joints = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]\njson = true\nnoise = 0.001\n\n[fk]\nframes = true\n"
        "[simulate]\nconfigurations = 4\n");
  const std::string given = run({"fk", "--joints", "0.1,0.2,0.3,0.4,0.5,0.6", "--json"}).out;
  EXPECT_EQ(run({"fk", "--config", "all.toml"}).out, given);
  EXPECT_EQ(run({"--config", "all.toml", "fk"}).out, given);
  EXPECT_EQ(run({"fk", "--config", "all.toml", "--joints", "0,0,0,0,0,0"}).out,
            run({"fk", "--joints", "0,0,0,0,0,0", "--json"}).out);
}

TEST_F(Usage, RefusesAnOptionFileThatItDoesNotUnderstand) {
  write("blank.toml", "");
  write("mark.toml", "\xef\xbb\xbf\n");
  for (const std::string file : {"blank.toml", "mark.toml"}) {
    expect_refused({"fk", "--config", file, "--joints", "0,0,0,0,0,0"}, {file + ": is empty, expected options"});
  }
  expect_refused({"fk", "--config", "", "--joints", "0,0,0,0,0,0"}, {"--config: '' is not accepted", "a file name"});
  expect_refused({"fk", "--config", "none.toml", "--joints", "0,0,0,0,0,0"}, {"--config", "'none.toml'"});
  write("key.toml", "jonts = [1]\n");
  expect_refused({"fk", "--config", "key.toml", "--joints", "0,0,0,0,0,0"}, {"key.toml", "'jonts'", "no option"});
}

// What is wrong with a file, and where: see robot_test.cpp and measurements_test.cpp.
TEST_F(Usage, RefusesFilesThatItCannotReadByTheirNameAndLine) {
  expect_refused({"model", "--urdf", "none.urdf"}, {"none.urdf", "No such file"});
  expect_refused({"calibrate", "--urdf", "none.urdf", "--measurements", "m.csv"}, {"none.urdf", "No such file"});
  write("bad.urdf", "<robot name='r'>\n<link name='a'>\n</robot>");
  expect_refused({"model", "--urdf", "bad.urdf"}, {"bad.urdf:2"});
  write("ragged.csv", kHeader + "1,A,0,0,0,0,0,0,1,1,1\n2,A,0,0,0,0,0,1,1,1\n");
  const std::string header = "configuration,split," + kHeader.substr(14);
  write("trial.csv", header + "1,trial,A,0,0,0,0,0,0,1,1,1\n");
  for (const std::string subcommand : {"validate", "calibrate"}) {
    expect_refused({subcommand, "--measurements", "none.csv"}, {"none.csv", "No such file"});
    expect_refused({subcommand, "--measurements", "."}, {"directory"});
    expect_refused({subcommand, "--measurements", "ragged.csv"}, {"ragged.csv:3", "10", "11"});
    expect_refused({subcommand, "--measurements", "trial.csv"}, {"trial.csv:2", "trial", "train"});
  }
  write("test.csv", header + "1,test,A,0,0,0,0,0,0,1,1,1\n");
  expect_refused({"calibrate", "--measurements", "test.csv"}, {"test.csv", "train"});
  succeed({"simulate", "--configurations", "3", "--output", "few.csv"});
  expect_refused({"calibrate", "--measurements", "few.csv", "--output", "o.urdf", "--result", "r.json"}, {"27", "33"});
}

class Simulate : public CommandLine {};

TEST_F(Simulate, WritesTheTruthThatMadeTheMeasurements) {
  for (const std::string model : {"irreducible", "complete"}) {
    succeed({"simulate", "--model", model, "--repeats", "2", "--test-configurations", "7", "--output", "m.csv",
             "--truth", "t.json", "--force"});
    const Measurements measurements = read_measurements(directory / "m.csv", joint_names(fanuc()));
    EXPECT_EQ(measurements.observations.size(), (30 + 7) * 3 * 2U);
    EXPECT_EQ(configurations_outside_limits(complete_model(fanuc()), measurements), 0);
    EXPECT_GT(measurements.joint_values.row(3).maxCoeff(), 200.0 * kDegree) << "the limits of joint 4 are 360 degrees";
    const Json truth = json_of("t.json");
    EXPECT_EQ(truth["seed"], 1);
    EXPECT_EQ(truth["noise"], 0.0);
    EXPECT_EQ(truth["parameters"].size(), model == "complete" ? 30U : 20U);
    const ErrorModel complete = complete_model(fanuc());
    for (const Json& parameter : truth["parameters"]) {
      EXPECT_EQ(parameter["value"].get<double>(),
                parameter["nominal"].get<double>() + parameter["error"].get<double>());
    }
    const Estimate stated = estimate_in(complete, truth);
    const KDL::Chain chain = error_chain(complete, stated.errors);
    for (const Observation& o : measurements.observations) {
      const Eigen::VectorXd q = measurements.joint_values.col(o.configuration);
      EXPECT_LT((kdl_point(chain, stated, q, o.target) - o.position()).norm(), 1e-12);
    }
  }
}

class OutputFiles : public CommandLine {
protected:
  std::vector<std::string> simulate(const std::string& output, const std::string& truth,
                                    const std::vector<std::string>& more = {}) const {
    return Words{"simulate", "--output", output, "--truth", truth} + more;
  }
};

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

class CommandLineOnRealData : public CommandLine {
protected:
  const std::string measurements = std::string(SHARED_DATA_DIR) + "/r2000ic_165f_tracker/measurements.csv";
};

TEST_F(CommandLineOnRealData, CalibratesTheR2000) {
  const Outcome outcome =
      run({"calibrate", "--measurements", measurements, "--joint-convention", kSerial, "--noise", "equal", "--effects",
           "none", "--prior", "none", "--leave-one-out", "--output", "c.urdf", "--result", "r.json"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  // Its other figures: see CalibrationOnRealData.
  const Json result = json_of("r.json");
  const Json& train = result["position_error"]["train"];
  EXPECT_NEAR(train["after"]["rms"], 0.161e-3, 0.001e-3);
  EXPECT_NEAR(train["before"]["rms"], 0.62e-3, 0.002e-3);
  EXPECT_GT(result["position_error"]["leave_one_out"]["after"]["rms"], 0.2e-3);
  const Json valid = run_json(
      {"validate", "--urdf", "c.urdf", "--measurements", measurements, "--joint-convention", kSerial, "--json"});
  EXPECT_NEAR(valid["position_error"]["all"]["rms"], train["after"]["rms"], 1e-9);
  EXPECT_NEAR(valid["position_error"]["all"]["max"], train["after"]["max"], 1e-7);
}

}  // namespace
}  // namespace kdl_calibration::testing::kdlcal_test
