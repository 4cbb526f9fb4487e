// What kdlcal leaves where its output has nowhere to go, and which files it reads.

#include <filesystem>

#include "base/sha256.hpp"
#include "base/text.hpp"
#include "cli_support.hpp"
#include "kdl_calibration/measurements.hpp"
#include "mistakes_support.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::testing::kdlcal_files_test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class Files : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    write("robot.urdf", content(std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf"));
    write("m.csv", measurements_csv(kMeasured.data));
  }

  static const Measured kMeasured;
};

const Measured Files::kMeasured = measured(complete_model(fanuc()), 1);

TEST_F(Files, NothingIsWrittenWhereStandardOutputIsFull) {
  const auto before = files();
  for (const Words& command : {words_of("calibrate --measurements m.csv --output c.urdf --result r.json"),
                               words_of("simulate --output s.csv --truth t.json"),
                               words_of("export --format urdf --output c.urdf"), Words{"model"}}) {
    const Outcome outcome = run(command, {.out = "/dev/full"});
    EXPECT_EQ(outcome.status, 2) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr("standard output cannot be written"));
    EXPECT_TRUE(files() == before) << command.front() << " left a file";
  }
}

// Whose files stand there in the end is open; that they do not belong together shows.
TEST_F(Files, TwoRunsIntoTheSameFilesLeaveWholeOnesAndHashesThatTellThemApart) {
  write("two.urdf", kTwoJoints);
  const auto command = [](const std::string& measurements) {
    return std::vector<std::string>{"calibrate", "--urdf", "two.urdf", "--measurements", measurements,
                                    "--output",  "c.urdf", "--result", "r.json",         "--force"};
  };
  std::map<std::string, nlohmann::json> alone;  // by the hash of the URDF
  for (const std::string name : {"m1.csv", "m2.csv"}) {
    succeed({"simulate", "--urdf", "two.urdf", "--configurations", "8", "--noise", "1e-5", "--seed", name.substr(1, 1),
             "--output", name});
    ASSERT_EQ(run(command(name)).status, 0);
    const nlohmann::json result = json_of("r.json");
    EXPECT_EQ(result["exported_urdf"]["sha256"], sha256(text_of("c.urdf")));
    alone[sha256(text_of("c.urdf"))] = result["parameters"];
  }
  ASSERT_EQ(alone.size(), 2U);
  const std::size_t before = files().size();
  for (int attempt = 0; attempt < 5; ++attempt) {
    fs::remove(directory / "c.urdf");
    fs::remove(directory / "r.json");
    Process first(directory, command("m1.csv"));
    Process second(directory, command("m2.csv"));
    const int statuses = WEXITSTATUS(first.wait()) + WEXITSTATUS(second.wait());
    EXPECT_TRUE(statuses == 0 || statuses == 2) << statuses;  // a name that the other took meanwhile is refused
    EXPECT_EQ(files().size(), before);
    // Either URDF is one of the two, whole; so is the result, which says which one it belongs to.
    EXPECT_EQ(alone.count(sha256(text_of("c.urdf"))), 1U);
    const nlohmann::json result = json_of("r.json");
    const std::string named = result["exported_urdf"]["sha256"];
    ASSERT_EQ(alone.count(named), 1U);
    EXPECT_EQ(result["parameters"], alone[named]);
  }
}

TEST_F(Files, AMebibyteOfStackSufficesAndLessIsRefused) {
  if (kSanitized) {
    GTEST_SKIP() << "a sanitizer needs more stack by itself";
  }
  expect_refused({"model"}, {"kdlcal: the stack is limited to 1023 KiB, expected at least 1024 KiB: ulimit -s 1024"},
                 {.stack = 1023 << 10U});
  std::vector<urdf::Part> joints(2'000, {"fixed", ""});  // as many as a URDF may have
  std::fill_n(joints.begin(), 6, urdf::Part{"continuous", ""});
  write("deep.urdf", urdf::serial(joints));
  const Surroundings small{.stack = 1 << 20U};
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"fk", "--joints", "0,0,0,0,0,0"},
           {"fk", "--urdf", "deep.urdf", "--joints", "0,0,0,0,0,0"},
           {"model"},
           {"calibrate", "--measurements", "m.csv", "--effects", "auto"},
           {"validate", "--measurements", "m.csv", "--json"},
           {"simulate", "--monte-carlo", "2", "--configurations", "12"},
           {"plan", "--configurations", "12", "--candidates", "60", "--workspace", "20", "--starts", "2"}}) {
    const Outcome usual = run(command);
    const Outcome outcome = run(command, small);
    EXPECT_EQ(outcome.status, usual.status) << command.front() << ": " << outcome.err;
    EXPECT_EQ(outcome.out, usual.out) << command.front();
  }
  expect_refused({"calibrate", "--measurements", "none.csv"}, {"none.csv"}, small);
}

TEST_F(Files, AConfigMayBeginWithAByteOrderMark) {
  write("options.toml", "\xef\xbb\xbf[simulate]\nseed = 3\n");
  write("plain.toml", "[simulate]\nseed = 3\n");
  EXPECT_EQ(run({"simulate", "--config", "options.toml"}).out, run({"simulate", "--config", "plain.toml"}).out);
}

TEST_F(Files, MessagesAreShort) {
  write("brackets.toml", std::string(100'000, '['));
  const Outcome outcome = run({"simulate", "--config", "brackets.toml"});
  EXPECT_EQ(outcome.status, 2);
  EXPECT_LT(outcome.err.size(), 420U);
}

TEST_F(Files, ControlCharactersInNamesAreWrittenOut) {
  const Outcome outcome = run({"calibrate", "--measurements", "\x1b[31mred.csv"});
  EXPECT_EQ(outcome.status, 2);
  EXPECT_THAT(outcome.err, HasSubstr("\\x1b[31mred.csv"));
  EXPECT_EQ(outcome.err.find('\x1b'), std::string::npos);
}

// Such as those that come from a disk of Windows: Latin-1, a lone byte, half a character.
TEST_F(Files, NamesThatAreNotUtf8AreOpenedAsTheyStandAndShownEscaped) {
  using Words = std::vector<std::string>;
  for (const std::string odd : {"gr\xfc\xdf", "\xff", "\xe2\x82"}) {
    const auto name = [&](const char* end) { return odd + end; };
    const auto done = [&](const Words& words) {
      const Outcome outcome = run(words);
      EXPECT_EQ(outcome.status, 0) << ::testing::PrintToString(words) << outcome.err;
      EXPECT_TRUE(is_utf8(outcome.out) && is_utf8(outcome.err)) << outcome.out << outcome.err;
      return outcome.out;
    };
    write(name(".urdf"), kTwoJoints);
    write(name(".toml"), "[calibrate]\neffects = \"none\"\nprior = \"none\"\n");
    done({"simulate", "--urdf", name(".urdf"), "--configurations", "20", "--length-sigma", "0.001", "--angle-sigma",
          "0.001", "--noise", "3e-5", "--output", name(".csv"), "--truth", name(".truth")});
    const std::string printed =
        done({"--config",       name(".toml"),       "calibrate",   "--urdf",        name(".urdf"),
              "--measurements", name(".csv"),        "--output",    name(".out"),    "--result",
              name(".json"),    "--report",          name(".html"), "--residuals",   name(".residuals"),
              "--covariance",   name(".covariance"), "--require",   "train.rms<1mm", "--json"});
    EXPECT_EQ(printed, text_of(name(".json")));
    const nlohmann::json result = json_of(name(".json"));
    EXPECT_EQ(result["exported_urdf"]["sha256"], sha256(text_of(name(".out"))));
    const std::string shown_name = nlohmann::json::parse(
        nlohmann::json(name(".csv")).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
    EXPECT_EQ(result["input"]["measurements"], shown_name);
    EXPECT_EQ(result["provenance"]["files_read"][1]["path"], shown_name);
    done({"fk", "--urdf", name(".urdf"), "--joints", "0,0", "--result", name(".json"), "--json"});
    done({"report", "--urdf", name(".urdf"), "--measurements", name(".csv"), "--result", name(".json"), "--output",
          name(".again")});
    EXPECT_EQ(text_of(name(".again")), text_of(name(".html")));
    done({"validate", "--urdf", name(".urdf"), "--measurements", name(".csv"), "--result", name(".json"), "--report",
          name(".valid"), "--json"});
    done({"validate", "--urdf", name(".urdf"), "--result", name(".json"), "--truth", name(".truth"), "--json"});
    done({"plan", "--urdf", name(".urdf"), "--result", name(".json"), "--configurations", "4", "--candidates", "50",
          "--workspace", "20", "--starts", "1", "--output", name(".plan"), "--report", name(".page"), "--json"});
    EXPECT_TRUE(is_utf8(text_of(name(".html"))) && is_utf8(text_of(name(".valid"))) && is_utf8(text_of(name(".page"))));
    for (const Words& words :
         {Words{"model", "--urdf", name(".none")},
          Words{"calibrate", "--urdf", name(".urdf"), "--measurements", name(".none")},
          Words{"calibrate", "--urdf", name(".urdf"), "--measurements", name(".csv"), "--result", name(".json")},
          Words{"--config", name(".none"), "model"}}) {
      expect_refused(words, {escaped(odd)});
    }
  }
}

TEST_F(Files, ValidateNeedsMoreCoordinatesThanBaseAndTargetsTake) {
  write("one.csv", measurements_csv(subset(kMeasured.data, [](const Observation& o) { return o.configuration == 0; })));
  expect_refused({"validate", "--measurements", "one.csv"},
                 {"9 coordinates in 1 configurations", "take 9 of them", "at least 2 configurations"});
}

}  // namespace
}  // namespace kdl_calibration::testing::kdlcal_files_test
