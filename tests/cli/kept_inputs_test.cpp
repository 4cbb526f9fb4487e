// No output replaces a file that the run reads, whichever option or file names it, and under whichever name.

#include <algorithm>
#include <filesystem>
#include <map>
#include <regex>
#include <set>

#include "cli_options_support.hpp"

namespace kdl_calibration::testing::kept_inputs_test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// An option that names a file to read, that file, and what else has to be given then.
struct Input {
  std::string option;
  std::string file;
  Words beside = {};
};

/// A way to run a subcommand: its inputs come one at a time, but for those that it cannot do without.
struct Way {
  Words words;  ///< with the inputs that are needed
  std::vector<std::string> outputs;
  bool needs_output = false;  ///< the first of them
  std::vector<Input> inputs;
};

const std::vector<Input> kRobots = {{"--urdf", "robot.urdf"}, {"--dh", "table.json"}};
const std::vector<Input> kMeasurements = {{"--joints-file", "joints.csv"},
                                          {"--joint-convention", "serial.json"},
                                          {"--known-base", "truth.json"},
                                          {"--known-targets", "truth.json"}};

std::vector<Way> ways() {
  const Input measurements{"--measurements", "m.csv"};
  return {{.words = words_of("calibrate --measurements m.csv"),
           .outputs = {"--output", "--result", "--residuals", "--covariance", "--report"},
           .inputs = kRobots + kMeasurements +
                     std::vector<Input>{measurements, {"--predict-at", "joints.csv"}, {"--prior-result", "r.json"}}},
          {.words = words_of("validate --measurements m.csv"),
           .outputs = {"--report"},
           .inputs = kRobots + kMeasurements + std::vector<Input>{measurements, {"--result", "r.json"}}},
          {.words = {"validate"}, .outputs = {}, .inputs = {{"--truth", "truth.json"}}},  // writes nothing
          {.words = words_of("report --result r.json"),
           .outputs = {"--output", "--pdf"},
           .inputs = kRobots + kMeasurements + std::vector<Input>{measurements, {"--result", "r.json"}}},
          {.words = {"simulate"},
           .outputs = {"--output", "--truth"},
           .inputs = kRobots + std::vector<Input>{{"--plan", "plan.csv"},
                                                  {"--joint-convention", "serial.json"},
                                                  {"--target-file", "targets.json"},
                                                  {"--sockets", "sockets.json", {"--targets", "1"}}}},
          {.words = words_of("simulate --monte-carlo 2"), .outputs = {"--runs", "--report"}, .inputs = kRobots},
          {.words = words_of("simulate --two-step 2"), .outputs = {"--truth", "--report"}, .inputs = kRobots},
          {.words = {"plan"},
           .outputs = {"--output", "--program", "--report"},
           .inputs = kRobots + std::vector<Input>{{"--measured", "m.csv", {"--add", "1"}},
                                                  {"--joints-file", "joints.csv", {"--measured", "m.csv"}},
                                                  {"--result", "r.json"},
                                                  {"--after", "r.json"},
                                                  {"--tasks", "plan.csv"},
                                                  {"--target-file", "targets.json"},
                                                  {"--joint-convention", "serial.json"}}},
          {.words = words_of("plan --targets 1"), .outputs = {"--output"}, .inputs = {{"--sockets", "sockets.json"}}},
          {.words = words_of("compensate --result r.json --joints joints.csv"),
           .outputs = {"--output", "--predict", "--report"},
           .needs_output = true,
           .inputs = kRobots + std::vector<Input>{{"--result", "r.json"},
                                                  {"--joints", "joints.csv"},
                                                  {"--frames", "frames.json"},
                                                  {"--joint-convention", "serial.json"}}},
          {.words = words_of("compensate --result r.json --poses poses.csv"),
           .outputs = {"--output"},
           .inputs = {{"--poses", "poses.csv"}}},
          {.words = words_of("compensate --result r.json --program IN.LS"),
           .outputs = {"--output"},
           .inputs = {{"--program", "IN.LS"}, {"--controller", "controller.json"}, {"--frames", "frames.json"}}},
          {.words = words_of("frames --tool-touches tip.csv"),
           .outputs = {"--output"},
           .inputs = kRobots + std::vector<Input>{{"--result", "r.json"},
                                                  {"--tool-touches", "tip.csv"},
                                                  {"--user-touches", "user.csv"},
                                                  {"--frames", "frames.json"},
                                                  {"--joint-convention", "serial.json"},
                                                  {"--controller", "controller.json"}}},
          {.words = words_of("export --format urdf"),
           .outputs = {"--output"},
           .inputs = kRobots + std::vector<Input>{{"--result", "r.json"}}},
          {.words = words_of("import --ur-calibration ur.conf"),
           .outputs = {"--output"},
           .inputs = kRobots + std::vector<Input>{{"--ur-calibration", "ur.conf"}}},
          {.words = words_of("compare r.json r2.json"),
           .outputs = {"--report"},
           .inputs = kRobots + std::vector<Input>{{"--joint-convention", "serial.json"}}},
          {.words = words_of("apply --result r.json --mastering-entered entered.csv"),
           .outputs = {"--output", "--output-urdf"},
           .needs_output = true,
           .inputs = kRobots + std::vector<Input>{{"--result", "r.json"},
                                                  {"--mastering-entered", "entered.csv"},
                                                  {"--joint-convention", "serial.json"}}},
          {.words = words_of("jacobian --identification --configuration-file plan.csv"),
           .outputs = {"--output"},
           .inputs = kRobots + std::vector<Input>{{"--configuration-file", "plan.csv"},
                                                  {"--joint-convention", "serial.json"},
                                                  {"--result", "r.json"},
                                                  {"--target-file", "targets.json"}}}};
}

class KeptInputs : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    write_once("inputs of every subcommand", [this] {
      const std::string urdf_dir = URDF_DIR;
      write("robot.urdf", content(urdf_dir + "/fanuc_r2000ic_165f.urdf"));
      write("serial.json", content(urdf_dir + "/fanuc_r2000ic_165f_serial.json"));
      write("fanuc_r2000ic_165f_pendant.json", content(urdf_dir + "/fanuc_r2000ic_165f_pendant.json"));
      write("controller.json", content(urdf_dir + "/fanuc_r2000ic_165f_controller.json"));
      succeed(
          words_of("simulate --noise 3e-5 --length-sigma 0.001 --angle-sigma 0.001 --output m.csv --truth truth.json"));
      succeed(words_of("calibrate --measurements m.csv --effects none --prior none --result r.json"));
      write("r2.json", text_of("r.json"));
      succeed(words_of("export --result r.json --format dh --output table.json"));
      const std::string joints =
          "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n0.1,0.2,0.3,0.4,0.5,0.6\n0.1,0.21,0.3,0.9,0.5,0.6\n"
          "0.1,0.2,0.3,0.4,0.9,0.6\n0.1,0.2,0.35,-0.4,0.5,1.6\n";
      for (const char* name : {"plan.csv", "joints.csv", "tip.csv", "user.csv"}) {
        write(name, joints);
      }
      write("entered.csv", "joint,added,unit\njoint_2,0.01,deg\n");
      write("poses.csv", "x,y,z,qw,qx,qy,qz\n1.5,0,1,1,0,0,0\n");
      write("targets.json", R"({"targets": [{"name": "A", "position": [0.1, 0, 0.2]}]})");
      write("sockets.json", R"({"targets": [{"name": "1", "position": [0, 0, 0]},
        {"name": "2", "position": [0.1, 0, 0]}, {"name": "3", "position": [0, 0.1, 0]}]})");
      write("frames.json", R"({"tool_frames": {"1": {"position": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}}})");
      write("IN.LS", "/PROG  TEST\n/MN\n/POS\n/END\n");
      write("ur.conf", "[mounting]\n");
      write("options.toml", "[model]\njson = true\n");
    });
  }

  static bool is_given(const Words& words, const std::string& option) {
    return std::find(words.begin(), words.end(), option) != words.end();
  }

  /// The command that reads the input and writes the output to this name.
  static Words command(const Way& way, const Input& input, const std::string& output, const std::string& name) {
    Words words = way.words + input.beside;
    if (!is_given(words, input.option)) {
      words = words + Words{input.option, input.file};
    }
    if (way.needs_output && output != way.outputs.front()) {
      words = words + Words{way.outputs.front(), "new"};
    }
    return words + Words{output, name};
  }

  void expect_kept(const Words& words, const std::string& fact) {
    expect_refused(words, {fact, "expected another one"});
    expect_refused(words + Words{"--force"}, {fact, "expected another one"});
  }
};

TEST_F(KeptInputs, OfEveryOptionOfEverySubcommandAreRefusedAsOutput) {
  for (const Way& way : ways()) {
    for (const std::string& output : way.outputs) {
      for (const Input& input : way.inputs) {
        expect_kept(command(way, input, output, input.file), output + ": '" + input.file + "' is the file that " +
                                                                 input.option + " reads as '" + input.file + "'");
      }
      const Input config{"--config", "options.toml"};
      expect_kept(command(way, config, output, config.file), "is the file that --config reads");
    }
  }
  for (const char* name : {"r.json", "r2.json"}) {
    expect_kept({"compare", "r.json", "r2.json", "--report", name},
                std::string("--report: '") + name + "' is the file");
  }
}

// A new option of a file is not to be forgotten here.
TEST_F(KeptInputs, AreThoseOfAllOptionsThatNameAFile) {
  std::map<std::string, std::set<std::string>> known;
  for (const Way& way : ways()) {
    std::set<std::string>& options = known[way.words.front()];
    options.insert(way.outputs.begin(), way.outputs.end());
    for (const Input& input : way.inputs) {
      options.insert(input.option);
    }
  }
  const std::string all = run({"--help"}).out;
  for (const auto& [subcommand, options] : known) {
    EXPECT_THAT(all, HasSubstr(subcommand));
    std::set<std::string> named;
    const std::string help = run({subcommand, "--help"}).out;
    const std::regex option(R"(\n  (--[a-z-]+) (\[STATION=\])?FILE)");
    for (std::sregex_iterator each(help.begin(), help.end(), option), end; each != end; ++each) {
      named.insert((*each)[1]);
    }
    EXPECT_EQ(named, options) << subcommand;
  }
}

// The paths in a result are those of the folder in which calibrate ran.
TEST_F(KeptInputs, OfAResultAreKnownByTheirContent) {
  fs::create_directory(directory / "elsewhere");
  fs::rename(directory / "m.csv", directory / "elsewhere/moved.csv");
  expect_refused({"report", "--result", "r.json", "--output", "elsewhere/moved.csv", "--force"},
                 {"--output: 'elsewhere/moved.csv' holds what r.json was made from as 'm.csv', expected another one"});
}

TEST_F(KeptInputs, AreTheSameUnderOtherNames) {
  fs::create_directory(directory / "folder");
  fs::create_symlink("truth.json", directory / "link.json");
  fs::create_symlink("folder", directory / "other");
  fs::create_hard_link(directory / "truth.json", directory / "folder" / "hard.json");
  for (const std::string& name :
       {std::string("./truth.json"), std::string("folder/../truth.json"), std::string("link.json"),
        std::string("folder/hard.json"), std::string("other/hard.json"), (directory / "truth.json").string()}) {
    for (const char* base : {"truth.json", "link.json", "W=truth.json"}) {
      expect_kept({"calibrate", "--measurements", "m.csv", "--known-base", base, "--result", name},
                  "--result: '" + name + "' is the file that --known-base reads as '");
    }
  }
}

TEST_F(KeptInputs, AreAlsoThoseThatAFileNames) {
  const std::string pendant = "fanuc_r2000ic_165f_pendant.json";
  fs::create_hard_link(directory / pendant, directory / "hard.json");
  for (const std::string& name : {pendant, std::string("hard.json")}) {
    const std::string fact = "--output: '" + name + "' is the file that this run reads as '" + pendant + "'";
    expect_kept({"frames", "--tool-touches", "tip.csv", "--controller", "controller.json", "--output", name}, fact);
    expect_kept(
        {"compensate", "--result", "r.json", "--program", "IN.LS", "--controller", "controller.json", "--output", name},
        fact);
  }
}

TEST_F(KeptInputs, AreAlsoThoseThatAResultWasMadeFrom) {
  expect_refused({"export", "--format", "urdf", "--result", "r.json", "--output", "m.csv", "--force"},
                 {"--output: 'm.csv' is the file that r.json was made from as 'm.csv', expected another one"});
}

// Every JSON file beside a joint convention is tried as another one that the user may have meant.
TEST_F(KeptInputs, AreOfFilesThatNobodyNamedOnlyThoseThatAreConventions) {
  const Words words = words_of("calibrate --effects none --prior none --joint-convention serial.json --force") +
                      Words{"--measurements", "serial.csv", "--result"};
  succeed(
      words_of("simulate --joint-convention serial.json --noise 3e-5 --length-sigma 0.001 --angle-sigma 0.001 "
               "--output serial.csv"));
  expect_refused(words + Words{"fanuc_r2000ic_165f_pendant.json"}, {"is the file that this run reads as"});
  write("old.json", text_of("r.json"));
  succeed(words + Words{"old.json"});
  EXPECT_NE(text_of("old.json"), text_of("r.json"));
}

}  // namespace
}  // namespace kdl_calibration::testing::kept_inputs_test
