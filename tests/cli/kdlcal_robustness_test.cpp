// Interrupted, full, hostile: what kdlcal answers, and what it leaves behind.

#include <sys/wait.h>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <sstream>
#include <thread>

#include "base/random.hpp"
#include "cli_support.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::testing::kdlcal_robustness_test {
namespace {

using ::testing::HasSubstr;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

class Signals : public CommandLine {
protected:
  /// `arguments` is work for minutes; the signal comes `after` so many seconds of processor time.
  void expect_ended(const std::vector<std::string>& arguments, int signal, double after) {
    const auto before = files();
    Process process(directory, arguments);
    process.let_work(after);
    ASSERT_FALSE(process.ended()) << ::testing::PrintToString(arguments) << " was done before the signal";
    const auto start = Clock::now();
    process.send(signal);
    const int status = process.wait();
    RecordProperty("seconds", std::to_string(seconds_since(start)));
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == signal) << "a shell shows 128 + the signal";
    EXPECT_TRUE(files() == before) << ::testing::PrintToString(arguments) << " left something behind";
    EXPECT_LT(seconds_since(start), 11.0);  // of a machine that has other work
  }
};

TEST_F(Signals, EndAnyLongWorkAndLeaveNothing) {
  for (const int signal : {SIGINT, SIGTERM}) {  // looking for candidates, choosing among some, on virtual robots
    expect_ended({"plan", "--candidates", "1000000", "--configurations", "500", "--starts", "1000"}, signal, 0.05);
    expect_ended(
        words_of("plan --candidates 1000 --workspace 20 --configurations 100 --starts 1000 --monte-carlo 100000"),
        signal, 0.06);
    expect_ended({"simulate", "--monte-carlo", "100000", "--json"}, signal, 0.05);
  }
}

TEST_F(Signals, EndACalibrationOfALongSeriesInEveryPhase) {
  succeed({"simulate", "--configurations", "10000", "--noise", "1e-4", "--output", "m.csv"});
  for (const double after : {0.015, 0.035, 0.06, 0.16}) {  // reading, checking, fitting, leaving out
    expect_ended(words_of("calibrate --measurements m.csv --effects none --prior none --leave-one-out --output c.urdf "
                          "--result r.json"),
                 SIGINT, after);
  }
}

TEST_F(Signals, KilledAtAnyMomentEachFileIsTheOldOrTheNewOne) {
  // More of them with KDL_CALIBRATION_KILLS=500.
  const char* wanted = std::getenv("KDL_CALIBRATION_KILLS");
  const int kills = wanted == nullptr ? 15 : std::atoi(wanted);
  write("r.urdf", kTwoJoints);
  succeed({"simulate", "--urdf", "r.urdf", "--configurations", "8", "--noise", "1e-5", "--output", "in.csv"});
  std::vector<std::vector<std::string>> commands(
      2, words_of("calibrate --urdf r.urdf --measurements in.csv --effects none --output a --result b --force"));
  commands[1].insert(commands[1].end(), {"--fix", "Ry1"});
  std::vector<std::array<std::string, 2>> whole;
  double duration = 0.0;
  for (const auto& command : commands) {
    const auto start = Clock::now();
    ASSERT_NE(run(command).status, 2);
    duration = seconds_since(start);
    whole.push_back({text_of("a"), text_of("b")});
  }
  ASSERT_NE(whole[0], whole[1]);
  Random random(1);
  int killed = 0;
  int replaced = 0;
  int left_behind = 0;
  std::string last = text_of("b");
  int runs = 0;
  for (; killed < kills && runs < 10 * kills; ++runs) {                 // some are done before the signal
    Process process(directory, commands[last == whole[0][1] ? 1 : 0]);  // to replace what is there
    // Half of them over the whole run, half towards its end, where the files are written.
    const double share = runs % 4 < 2 ? random.uniform(0.0, 1.0) : random.uniform(0.8, 1.0);
    std::this_thread::sleep_for(std::chrono::duration<double>(duration * share));
    process.send(SIGKILL);
    const int status = process.wait();
    killed += WIFSIGNALED(status) ? 1 : 0;
    duration *= WIFSIGNALED(status) ? 1.03 : 0.9;  // the machine has other work, now more and now less
    const std::array<std::string, 2> now = {text_of("a"), text_of("b")};
    for (std::size_t f = 0; f < 2; ++f) {
      ASSERT_TRUE(now.at(f) == whole[0].at(f) || now.at(f) == whole[1].at(f)) << "after run " << runs;
    }
    replaced += now[1] != last ? 1 : 0;
    last = now[1];
    for (const auto& entry : std::filesystem::directory_iterator(directory)) {
      if (entry.path().extension() == ".tmp") {
        std::filesystem::remove(entry.path());
        ++left_behind;
      }
    }
  }
  std::printf("%d runs, %d killed, %d times the file was replaced, %d temporary files left by SIGKILL\n", runs, killed,
              replaced, left_behind);
  EXPECT_EQ(killed, kills);
  EXPECT_GT(replaced, 0);
}

class Limits : public CommandLine {
protected:
  /// What calibrate with these options needs more of three times the points.
  void expect_memory_that_grows_with_the_data(int configurations, const std::vector<std::string>& options) {
    if (kSanitized) {
      GTEST_SKIP() << "a sanitizer's memory is its own";
    }
    const auto peak = [&](int count) {
      EXPECT_EQ(run({"simulate", "--configurations", std::to_string(count), "--output", "m.csv", "--force"}).status, 0);
      std::vector<std::string> words =
          Words{"calibrate", "--measurements", "m.csv", "--result", "r.json", "--force"} + options;
      Process process(directory, words, {.for_peak = true});
      EXPECT_EQ(process.wait(), 0);
      return process.peak();
    };
    const double small = peak(configurations);
    const double large = peak(3 * configurations);
    const double further = 3.0 * 2.0 * configurations;  // points: three of each configuration
    std::printf("%.0f and %.0f MB, %.0f bytes for each further point\n", small / 1e6, large / 1e6,
                (large - small) / further);
    EXPECT_GT(large - small, 50.0 * further);   // else something else was measured
    EXPECT_LT(large - small, 800.0 * further);  // each of two threads holds the rows of a fold's rest
  }

  const std::string header = "configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z\n";
};

class LimitsLongRun : public Limits {};

TEST_F(Limits, MemoryGrowsWithTheDataAlone) {
  expect_memory_that_grows_with_the_data(8000, {"--effects", "none", "--prior", "none"});
}

TEST_F(LimitsLongRun, MemoryGrowsWithTheDataAloneBesideAutomaticChoices) {
  expect_memory_that_grows_with_the_data(20000, {});
}

// Of smaller files see options_test.cpp.
TEST_F(Limits, OfFilesOfMeasurementsAre16GiB) {
  if (!write_sparse("huge", 17 * (std::uintmax_t{1} << 30U))) {
    GTEST_SKIP() << "no room for a sparse file";
  }
  for (const std::vector<std::string>& command : {std::vector<std::string>{"validate", "--measurements", "huge"},
                                                  std::vector<std::string>{"simulate", "--plan", "huge"}}) {
    const Outcome outcome = run(command);
    EXPECT_EQ(outcome.status, 2);
    EXPECT_THAT(outcome.err, HasSubstr("huge: larger than the limit of 16 GiB"));
  }
}

TEST_F(Limits, OfWhatAFileHoldsAreStated) {
  std::string targets = header;
  for (int i = 0; i <= 100; ++i) {
    targets += "1,T" + std::to_string(i) + ",0,0,0,0,0,0,1,1,1\n";
  }
  write("targets.csv", targets);
  expect_refused({"calibrate", "--measurements", "targets.csv"}, {"targets.csv:102", "limit of 100"});

  write("deep.json", "{\"controller_joints\": " + std::string(1'000'000, '[') + std::string(1'000'000, ']') + "}");
  expect_refused({"fk", "--joints", "0", "--joint-convention", "deep.json"}, {"deep.json", "deeper", "100"});
  expect_refused({"simulate", "--target-file", "deep.json"}, {"deep.json", "deeper", "100"});

  write("long.urdf", urdf::serial(std::vector<urdf::Part>(101, {"continuous", ""})));
  expect_refused({"model", "--urdf", "long.urdf"}, {"long.urdf", "101 moving joints", "at most 100"});
}

TEST_F(Limits, OptionsOfCalibrateThatContradictEachOther) {
  succeed({"simulate", "--configurations", "12", "--noise", "1e-5", "--output", "m.csv"});
  succeed({"simulate", "--poses", "--configurations", "12", "--noise", "1e-5", "--output", "p.csv"});
  succeed({"simulate", "--repeats", "2", "--truth", "truth.json", "--output", "same.csv"});
  succeed(words_of("simulate --poses --targets 1 --output without_sigma.csv"));
  const auto refused = [&](const Words& more, const Words& facts, const std::string& file = "m.csv") {
    expect_refused(Words{"calibrate", "--measurements", file, "--result", "r.json", "--output", "o.urdf"} + more,
                   facts);
  };
  refused({"--noise-independent", "1e-5,1e-5"}, {"--noise-independent", "2 values", "1 or 3"});
  refused({"--noise-common", "1e-5"}, {"--noise-common", "--noise-independent"});
  refused({"--noise-independent", "1e-5,0,1e-5"}, {"--noise-independent", "above 0 along each"});
  refused({"--noise-independent", "1e-5", "--noise-common", "1000"}, {"m.csv", "configuration '1'", "a millionth"});
  refused({"--noise", "repeats"}, {"--noise: ", "m.csv", "repeats", "more than once"});
  refused({"--noise", "repeats"}, {"--noise: ", "same.csv", "do not vary", "see --noise-independent"}, "same.csv");
  refused({"--method", "two-step", "--loss", "huber"}, {"--method: ", "two-step", "losses"});
  refused({"--method", "two-step", "--fix", "base.Tx"}, {"--fix: ", "base.Tx", "see --known-base"});
  refused({"--method", "two-step"}, {"--method: ", "p.csv", "two-step", "orientations"}, "p.csv");
  refused({"--orientation-sigma", "1e-4", "--noise-independent", "2e-5"},
          {"--orientation-sigma: ", "m.csv", "quaternion"});
  refused({"--orientation-sigma", "1e-4"},
          {"--orientation-sigma: ", "see --noise-independent, --noise-tracker, --noise"}, "without_sigma.csv");
  refused({"--free", "Z*"}, {"--free", "'Z*'"});
  refused({"--fix", "Ry1", "--free", "Ry1"}, {"--free: Ry1 is fixed as well", "see --fix"});
  for (const std::string method : {"joint", "two-step"}) {
    refused({"--fix", "*", "--known-base", "truth.json", "--known-targets", "truth.json", "--method", method},
            {"--fix: ", "nothing to estimate", "validation"});
  }
  refused({"--fix", std::string(1000, '*') + "?"}, {"base"});
  refused({"--loss", "cauchy"}, {"'cauchy'", "none, huber, tukey"});
  refused({"--effects", "gravity,auto"}, {"--effects", "'auto'", "groups alone"});
  refused({"--gravity-direction", "0,0,0"}, {"--gravity-direction", "not all 0"});
  refused({"--gravity-direction", "0,1"}, {"--gravity-direction"});
  refused({"--gravity"}, {"--gravity: no longer an option, expected --effects gravity"});
  refused({"--joint-gain"}, {"--joint-gain: no longer an option, expected --effects gain"});
  refused({"--extras", "auto"}, {"--extras: no longer an option, expected --effects auto"});
  refused({"--prior-deflection", "1e-4"}, {"--prior-deflection: no longer an option"});
  refused({"--method", "two-step", "--effects", "gravity"}, {"two-step", "effects"});
  refused({"--prior", "0.1"}, {"'0.1'", "auto"});
}

class Traps : public CommandLine {
protected:
  /// Calibrates m.csv: an answer, trusted or marked, with no number that is none.
  void expect_answer(const std::vector<std::string>& more, const std::string& what) {
    SCOPED_TRACE(what);
    std::vector<std::string> arguments =
        words_of("calibrate --measurements m.csv --output c.urdf --result r.json --force") + more;
    const Outcome outcome = run(arguments);
    EXPECT_TRUE(outcome.status == 0 || outcome.status == 1) << outcome.status << outcome.err;
    const std::string text = text_of("c.urdf");
    EXPECT_FALSE(text.empty());
    for (const char* none : {"nan", "inf"}) {
      EXPECT_EQ(text.find(std::string("\"") + none), std::string::npos);
      EXPECT_EQ(text.find(std::string(" ") + none), std::string::npos);
      EXPECT_EQ(text.find(std::string("-") + none), std::string::npos);
    }
    const nlohmann::json result = json_of("r.json");
    for (const auto& parameter : result["parameters"]) {
      EXPECT_TRUE(parameter["value"].is_number() && parameter["error"].is_number()) << parameter;
    }
    for (const char* key : {"position", "quaternion_wxyz"}) {
      for (const auto& number : result["base"][key]) {
        EXPECT_TRUE(number.is_number());
      }
    }
    const auto& rms = result["position_error"]["train"]["after"]["rms"];
    EXPECT_TRUE(rms.is_number() || outcome.status == 1);
    EXPECT_EQ(outcome.status == 0, result["doubts"].empty()) << result["doubts"];
    EXPECT_TRUE(outcome.status == 1 || result["termination"] == "converged" || result.contains("reservation"))
        << result["message"];
    last = result;
  }

  /// An arm of four joints whose lengths are about this large.
  static std::string arm(const std::string& length) {
    std::vector<urdf::Part> parts;
    for (const std::string axis : {"0 0 1", "1 0 0", "1 0 0", "0 1 0"}) {
      parts.push_back({"continuous", "<axis xyz='" + axis + "'/><origin xyz='0 " + length + " " + length + "'/>"});
    }
    parts.push_back({"fixed", ""});
    return urdf::serial(parts);
  }

  nlohmann::json last;
};

TEST_F(Traps, RobotsOfANanometreAndOfAThousandKilometres) {
  // The length of its links, of its tool and of its errors, and the noise [m].
  for (const auto& [length, target, sigma, noise] : std::vector<std::array<std::string, 4>>{
           {"1e-9", "0.1", "1e-12", "0"}, {"1e6", "1e5", "1e3", "1e2"}, {"1e-9", "1e-10", "1e-12", "1e-13"}}) {
    write("r.urdf", arm(length));
    write("t.json", R"({"targets": [{"name": "A", "position": [)" + target +
                        R"(, 0, 0]}, {"name": "B", "position": [0, )" + target + ", " + target + "]}]}");
    succeed({"simulate", "--urdf", "r.urdf", "--target-file", "t.json", "--length-sigma", sigma, "--noise", noise,
             "--output", "m.csv", "--force"});
    expect_answer({"--urdf", "r.urdf"}, length);
    expect_answer({"--urdf", "r.urdf", "--method", "two-step", "--iterations", "50"}, length + " two-step");
    expect_answer({"--urdf", "r.urdf", "--effects", "gravity,gain", "--leave-one-out"}, length + " with effects");
    EXPECT_NE(run({"validate", "--urdf", "r.urdf", "--measurements", "m.csv"}).status, 2);
  }
}

TEST_F(Traps, RowsThatAreAllIdentical) {
  std::string rows = "configuration,target,repeat,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z\n";
  for (int i = 0; i < 20'000; ++i) {
    rows += "1,A," + std::to_string(i) + ",0.1,0.2,0.3,0.4,0.5,0.6,1,2,3\n";
  }
  write("m.csv", rows);
  expect_answer({}, "one point");
  EXPECT_EQ(last["termination"], "rank_deficient");
}

TEST_F(Traps, ConditionNumbersUpToWhereTheRankIsLost) {
  write("r.urdf", kTwoJoints);
  std::vector<std::string> terminations;
  for (const std::string width : {"10:50,20:60", "10:10.01,20:20.01", "10:10.00001,20:20.00001",
                                  "10:10.00000001,20:20.00000001", "10:10.0000000001,20:20.0000000001"}) {  // [deg]
    const std::string noise = terminations.size() % 2 == 0 ? "1e-5" : "0";
    succeed({"simulate", "--urdf", "r.urdf", "--configurations", "8", "--joint-ranges", width, "--noise", noise,
             "--output", "m.csv", "--force"});
    expect_answer(words_of("--urdf r.urdf --effects none --prior none"), width + " degrees, noise " + noise);
    terminations.push_back(last["termination"]);
  }
  EXPECT_EQ(terminations.front(), "converged");
  EXPECT_EQ(terminations.back(), "rank_deficient");
}

TEST_F(Traps, SigmasOfEveryOrder) {
  write("r.urdf", kTwoJoints);
  succeed({"simulate", "--urdf", "r.urdf", "--configurations", "8", "--noise", "1e-5", "--output", "m.csv"});
  const std::string text = text_of("m.csv");
  for (const std::string sigma : {"1e-15", "1e-9", "1e6", "1e12"}) {
    std::istringstream lines(text);
    std::string changed;
    int row = 0;
    for (std::string line; std::getline(lines, line); ++row) {
      const std::string rest = line.substr(0, line.rfind(','));  // sigma stands last
      changed += (row == 0 ? line : rest + "," + (row % 7 == 0 ? sigma : "")) + "\n";
    }
    write("m.csv", changed);
    expect_answer({"--urdf", "r.urdf"}, "a sigma of " + sigma);
  }
}

}  // namespace
}  // namespace kdl_calibration::testing::kdlcal_robustness_test
