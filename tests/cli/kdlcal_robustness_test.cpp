// Interrupted, full, hostile: what kdlcal answers, and what it leaves behind.

#include <gtest/gtest-spi.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <sstream>
#include <thread>

#include "base/random.hpp"
#include "cli_support.hpp"
#include "german_locale.hpp"

namespace kdl_calibration::testing::kdlcal_robustness_test {
namespace {

using ::testing::HasSubstr;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

// ---- Signals -------------------------------------------------------------------------------------------------------

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
    EXPECT_LT(seconds_since(start), 1.0 + 10.0 * kSlack);
  }

private:
  // Of a machine that has other work.
  static constexpr double kSlack = 1.0;
};

TEST_F(Signals, EndAnyLongWorkAndLeaveNothing) {
  for (const int signal : {SIGINT, SIGTERM}) {  // looking for candidates, choosing among some, on virtual robots
    expect_ended({"plan", "--candidates", "1000000", "--configurations", "500", "--starts", "1000"}, signal, 0.05);
    expect_ended({"plan", "--candidates", "1000", "--workspace", "20", "--configurations", "100", "--starts", "1000",
                  "--monte-carlo", "100000"},
                 signal, 0.06);
    expect_ended({"simulate", "--monte-carlo", "100000", "--json"}, signal, 0.05);
  }
}

TEST_F(Signals, EndACalibrationOfALongSeriesInEveryPhase) {
  ASSERT_EQ(run({"simulate", "--configurations", "10000", "--noise", "1e-4", "--output", "m.csv"}).status, 0);
  for (const double after : {0.015, 0.035, 0.06, 0.16}) {  // reading, checking, fitting, leaving out
    expect_ended({"calibrate", "--measurements", "m.csv", "--effects", "none", "--prior", "none", "--leave-one-out",
                  "--output", "c.urdf", "--result", "r.json"},
                 SIGINT, after);
  }
}

TEST_F(Signals, KilledAtAnyMomentEachFileIsTheOldOrTheNewOne) {
  // More of them with KDL_CALIBRATION_KILLS=500.
  const char* wanted = std::getenv("KDL_CALIBRATION_KILLS");
  const int kills = wanted == nullptr ? 15 : std::atoi(wanted);
  write("r.urdf", kTwoJoints);
  ASSERT_EQ(
      run({"simulate", "--urdf", "r.urdf", "--configurations", "8", "--noise", "1e-5", "--output", "in.csv"}).status,
      0);
  std::vector<std::vector<std::string>> commands(2, {"calibrate", "--urdf", "r.urdf", "--measurements", "in.csv",
                                                     "--effects", "none", "--output", "a", "--result", "b", "--force"});
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

// ---- Files that cannot be written ----------------------------------------------------------------------------------

TEST_F(Signals, AFolderWithoutWritePermissionIsRefusedAndUntouched) {
  constexpr unsigned kNobody = 65534;
  write("old.csv", "old");
  std::filesystem::permissions(directory, std::filesystem::perms(0555));
  std::filesystem::permissions(directory / "old.csv", std::filesystem::perms(0444));
  const auto before = files();
  for (const std::string name : {"new.csv", "old.csv"}) {
    Process process(directory, {"simulate", "--output", name, "--force"}, {.user = ::getuid() == 0 ? kNobody : 0});
    const int status = process.wait();
    if (WIFEXITED(status) && WEXITSTATUS(status) >= 126) {
      GTEST_SKIP() << "another user cannot run kdlcal here";
    }
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 2);
  }
  EXPECT_TRUE(files() == before);
  std::filesystem::permissions(directory, std::filesystem::perms(0755));
}

// ---- Limits --------------------------------------------------------------------------------------------------------

class Limits : public CommandLine {
protected:
  /// A file of so many bytes that takes no room on the disk; false where the file system has none such.
  bool sparse(const std::string& name, std::uintmax_t size) {
    write(name, "");
    std::error_code error;
    std::filesystem::resize_file(directory / name, size, error);
    return !error;
  }

  static std::string chain(int joints, const std::string& type) {
    std::string text = "<robot name='r'><link name='l0'/>";
    for (int i = 1; i <= joints; ++i) {
      const std::string n = std::to_string(i);
      text += "<link name='l" + n + "'/><joint name='j" + n + "' type='" + type + "'><parent link='l" +
              std::to_string(i - 1) + "'/><child link='l" + n + "'/></joint>";
    }
    return text + "</robot>";
  }

  /// What calibrate with these options needs more of three times the points.
  void expect_memory_that_grows_with_the_data(int configurations, const std::vector<std::string>& options) {
    if (kSanitized) {
      GTEST_SKIP() << "a sanitizer's memory is its own";
    }
    const auto peak = [&](int count) {
      EXPECT_EQ(run({"simulate", "--configurations", std::to_string(count), "--output", "m.csv", "--force"}).status, 0);
      std::vector<std::string> words = {"calibrate", "--measurements", "m.csv", "--result", "r.json", "--force"};
      words.insert(words.end(), options.begin(), options.end());
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

TEST_F(Limits, OfTheTestsThemselvesEndARunThatTakesTooMuch) {
  ASSERT_EQ(::mkfifo((directory / "nobody_writes").c_str(), 0600), 0);
  const std::vector<std::string> waits = {"validate", "--measurements", "nobody_writes"};
  EXPECT_NONFATAL_FAILURE(run(waits, {.seconds = 1}), "at most 1 s on the clock");
  // Of the processor's time the system is told, and what it does then is done here.
  Process process(directory, waits, {.cpu_seconds = 1});
  int opened = -1;
  while (!process.ended() && opened < 0) {  // until kdlcal reads
    opened = ::open((directory / "nobody_writes").c_str(), O_WRONLY | O_NONBLOCK);
    ::usleep(1000);
  }
  EXPECT_EQ(process.cpu_limit(), 1U);
  process.send(SIGXCPU);
  EXPECT_NONFATAL_FAILURE(process.wait(), "at most 1 s of processor");
  ::close(opened);
  if (kSanitized) {
    GTEST_SKIP() << "a sanitizer's memory is its own";
  }
  EXPECT_NONFATAL_FAILURE(run({"simulate", "--configurations", "100000"}, {.memory = rlim_t{16} << 20U}),
                          "at most 16777216 bytes");
}

class LimitsLongRun : public Limits {};

TEST_F(Limits, MemoryGrowsWithTheDataAlone) {
  expect_memory_that_grows_with_the_data(8000, {"--effects", "none", "--prior", "none"});
}

TEST_F(LimitsLongRun, MemoryGrowsWithTheDataAloneBesideAutomaticChoices) {
  expect_memory_that_grows_with_the_data(20000, {});
}

TEST_F(Limits, OfFileSizesAreStated) {
  constexpr std::uintmax_t kMiB = std::uintmax_t{1} << 20U;
  const auto refuse = [&](const std::vector<std::string>& arguments, const std::string& fact) {
    const Outcome outcome = run(arguments);
    EXPECT_EQ(outcome.status, 2);
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1);
    EXPECT_THAT(outcome.err, HasSubstr(fact));
  };
  write("m.csv", header + "1,A,0,0,0,0,0,0,1,1,1\n");
  write("options.toml", std::string(kMiB + 1, '#'));
  refuse({"fk", "--config", "options.toml", "--joints", "0,0,0,0,0,0"}, "options.toml: larger than the limit of 1 MiB");
  if (!sparse("huge", 17 * (kMiB << 10U))) {
    GTEST_SKIP() << "no room for a sparse file";
  }
  refuse({"validate", "--measurements", "huge"}, "huge: larger than the limit of 16 GiB");
  refuse({"simulate", "--plan", "huge"}, "huge: larger than the limit of 16 GiB");
  // Of other files with text see options_test.cpp.
  refuse({"calibrate", "--measurements", "m.csv", "--known-base", "huge"}, "huge: larger than the limit of 64 MiB");
}

TEST_F(Limits, OfWhatAFileHoldsAreStated) {
  write("line.csv", header + "1,A,0,0,0,0,0,0,1,1," + std::string(std::size_t{2} << 20U, '1') + "\n");
  expect_refused({"validate", "--measurements", "line.csv"}, {"line.csv:2", "limit of 1 MiB"});
  std::string targets = header;
  for (int i = 0; i <= 100; ++i) {
    targets += "1,T" + std::to_string(i) + ",0,0,0,0,0,0,1,1,1\n";
  }
  write("targets.csv", targets);
  expect_refused({"calibrate", "--measurements", "targets.csv"}, {"targets.csv:102", "limit of 100"});

  expect_refused({"simulate", "--configurations", "100000", "--repeats", "1000"}, {"rows, expected at most 10000000"});
  std::string points;
  for (int i = 0; i <= 100; ++i) {
    points += (i == 0 ? "" : ",") + (R"({"name": "T)" + std::to_string(i)) + R"(", "position": [0, 0, 0]})";
  }
  write("targets.json", "{\"targets\": [" + points + "]}");
  expect_refused({"plan", "--target-file", "targets.json"}, {"targets.json", "101", "at most 100"});

  std::string deep = "<robot name='r'>";
  for (int i = 0; i < 200; ++i) {
    deep += "<a>";
  }
  write("deep.urdf", deep);
  expect_refused({"model", "--urdf", "deep.urdf"}, {"deep.urdf:1", "nested too deeply", "100"});
  write("deep.json", "{\"controller_joints\": " + std::string(1'000'000, '[') + std::string(1'000'000, ']') + "}");
  expect_refused({"fk", "--joints", "0", "--joint-convention", "deep.json"}, {"deep.json", "deeper", "100"});
  expect_refused({"simulate", "--target-file", "deep.json"}, {"deep.json", "deeper", "100"});

  write("long.urdf", chain(101, "continuous"));
  expect_refused({"model", "--urdf", "long.urdf"}, {"long.urdf", "101 moving joints", "at most 100"});
  write("longer.urdf", chain(2'001, "fixed"));
  expect_refused({"model", "--urdf", "longer.urdf"}, {"longer.urdf", "more joints than the limit of 2000"});
  write("long_enough.urdf", chain(2'000, "fixed"));
  expect_refused({"model", "--urdf", "long_enough.urdf"}, {"long_enough.urdf", "no moving joint"});
}

// ---- Bad input: what the tables of the issues list and no other test shows through the executable
// --------------------

class BadTable : public CommandLine {
protected:
  const std::string header = "configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z";

  void refuse(const std::string& csv, const std::vector<std::string>& facts) {
    write("bad.csv", csv);
    std::vector<std::string> all = {"bad.csv"};
    all.insert(all.end(), facts.begin(), facts.end());
    expect_refused({"validate", "--measurements", "bad.csv"}, all);
    expect_refused({"calibrate", "--measurements", "bad.csv", "--output", "o.urdf", "--result", "r.json"}, all);
  }
};

TEST_F(BadTable, SpreadsheetsWithDecimalCommasAreRefusedAndNeverHalfRead) {
  std::string semicolons = header;
  std::replace(semicolons.begin(), semicolons.end(), ',', ';');
  refuse("\xef\xbb\xbf" + semicolons + "\r\n1;A;0,5;0;0;0;0;0;1;1;1.5\r\n", {":2", "z", "'1.5'", "decimal commas"});
  refuse(header + "\n1,A,0,5,0,0,0,0,0,1,1,1\n", {":2", "12 fields", "decimal commas are not read"});
  refuse(header + "\n1,A,\"0,5\",0,0,0,0,0,1,1,1\n", {":2", "joint_1", "'0,5'", "decimal comma"});
  refuse(semicolons + "\n1;A;1.234,5;0;0;0;0;0;1;1;1\n", {"'1.234,5'", "decimal comma"});
}

TEST_F(BadTable, TextThatIsNoUtf8IsRefused) {
  refuse(std::string("\xff\xfe"
                     "c\0o\0",
                     6),
         {"UTF-16", "UTF-8"});
  refuse(header + "\nL\xe4nge,A,0,0,0,0,0,0,1,1,1\n", {":2", "not UTF-8"});
  refuse(header + std::string("\n1,A\0,0,0,0,0,0,0,1,1,1\n", 24), {":2", "NUL"});
}

TEST_F(BadTable, RowsThatContradictThemselvesAreRefused) {
  const std::string more = header + ",sigma,repeat,qw,qx,qy,qz\n";
  refuse(more + "1,A,0,0,0,0,0,0,1,1,1,-1,,,,,\n", {":2", "sigma", "'-1'"});
  refuse(more + "1,A,0,0,0,0,0,0,1,1,1,0,,,,,\n", {":2", "sigma", "'0'"});
  refuse(more + "1,A,0,0,0,0,0,0,1,1,1,1e-16,,,,,\n", {":2", "sigma", "'1e-16'", "1e-15"});
  refuse(more + "1,A,0,0,0,0,0,0,1,1e13,1,,,,,,\n", {":2", "y", "'1e13'", "at most 1e12"});
  refuse(more + "1,A,0,0,0,0,0,0,1,1,1,,1.5,,,,\n", {":2", "repeat", "'1.5'"});
  refuse(more + "1,A,0,0,0,0,0,0,1,1,1,,,1,1,0,0\n", {":2", "norm of the quaternion", "1.41"});
  refuse(more + "1,A,0,0,0,0,0,0,1,1,1,,,1,,,\n", {":2", "quaternion", "empty"});
  refuse(header + "\n1,A,0,0,0,0,0,0,1,1,1\n1,B,0,0,0,1,0,0,1,1,1\n", {":3", "joint_4", "line 2", "one joint values"});
  refuse(header + "\n1,\"A,0,0,0,0,0,0,1,1,1\n", {":2", "closing quote"});
  refuse(header + "\n1,A,0,0,0,0,0,0,1,1,1,,9\n", {":2", "13 fields, expected 11"});
  refuse(header + ",x\n", {":1", "'x' repeats 'x'"});
  refuse(header + ",\"a\"b\n", {":1", "quote"});
}

TEST_F(BadTable, ConventionsThatAreNoneAreRefused) {
  const auto refused = [&](const std::string& text, const std::vector<std::string>& facts) {
    write("c.json", text);
    expect_refused({"fk", "--joints", "0,0,0,0,0,0", "--joint-convention", "c.json"}, facts);
  };
  refused("", {"c.json:1", "malformed JSON"});
  refused("{\n\"matrix\": [1,}", {"c.json:2", "malformed JSON"});
  refused("[]", {"c.json", "no JSON object"});
  refused(R"({"controller_joints": ["a"], "urdf_joints": ["b"]})", {"missing key 'matrix'"});
  refused(R"({"controller_joints": ["a"], "urdf_joints": ["b"], "matrix": [[1e999]]})", {"range of a double"});
  refused(R"({"controller_joints": ["a"], "urdf_joints": ["b"], "matrix": [[NaN]]})", {"malformed JSON"});
  refused(R"({"controller_joints": ["a", "a"], "urdf_joints": ["b", "c"], "matrix": [[1]]})", {"'a' appears twice"});
}

TEST_F(BadTable, RobotsThatUrdfdomOrTheChainRefuse) {
  const auto refused = [&](const std::string& text, const std::vector<std::string>& facts) {
    write("r.urdf", text);
    expect_refused({"model", "--urdf", "r.urdf"}, facts);
  };
  const auto joint = [](const std::string& type, const std::string& inside) {
    return "<robot name='r'><link name='a'/><link name='b'/><joint name='j' type='" + type +
           "'><parent link='a'/><child link='b'/>" + inside + "</joint></robot>";
  };
  refused("", {"r.urdf", "empty"});
  refused("<model/>", {"r.urdf", "no <robot>"});
  refused(joint("revolute", ""), {"r.urdf", "not a valid URDF", "does not specify limits"});
  refused(joint("floating", ""), {"'j'", "floating"});
  refused(joint("planar", ""), {"'j'", "planar"});
  refused(joint("continuous", "<axis xyz='0 0 0'/>"), {"'j'", "axis"});
  refused(joint("continuous", "<axis xyz='0,0,1'/>"), {"r.urdf", "not a valid URDF"});
  refused(joint("continuous", "<origin xyz='1 2'/>"), {"r.urdf", "not a valid URDF"});
  refused(joint("continuous", "<origin xyz='nan 0 0'/>"), {"r.urdf", "not a valid URDF"});
  refused(joint("continuous", "<origin rpy='inf 0 0'/>"), {"r.urdf", "not a valid URDF"});
  refused(joint("continuous", "<origin xyz='1e13 0 0'/>"), {"'j'", "out of range", "1e12"});
  refused(joint("revolute", "<limit lower='2' upper='1' velocity='1' effort='1'/>"), {"'j'", "lower limit 2"});
  refused(
      "<robot name='r'><link name='a'/><link name='b'/><joint name='j' type='fixed'><parent link='a'/><child "
      "link='b'/></joint><joint name='k' type='fixed'><parent link='b'/><child link='a'/></joint></robot>",
      {"loop"});
}

TEST_F(BadTable, OptionsOfCalibrateThatContradictEachOther) {
  ASSERT_EQ(run({"simulate", "--configurations", "12", "--noise", "1e-5", "--output", "m.csv"}).status, 0);
  ASSERT_EQ(run({"simulate", "--poses", "--configurations", "12", "--noise", "1e-5", "--output", "p.csv"}).status, 0);
  ASSERT_EQ(run({"simulate", "--repeats", "2", "--truth", "truth.json", "--output", "same.csv"}).status, 0);
  const auto refused = [&](std::vector<std::string> more, const std::vector<std::string>& facts,
                           const std::string& file = "m.csv") {
    more.insert(more.begin(), {"calibrate", "--measurements", file, "--result", "r.json", "--output", "o.urdf"});
    expect_refused(more, facts);
  };
  refused({"--noise-independent", "1e-5,1e-5"}, {"--noise-independent", "2 values", "1 or 3"});
  refused({"--noise-tracker", "1,2"}, {"--noise-tracker", "expected 4"});
  refused({"--noise-tracker", "0,0,1e-5,0"}, {"--noise-tracker", "above 0"});
  refused({"--noise-common", "1e-5"}, {"--noise-common", "--noise-independent"});
  refused({"--noise-independent", "1e-5,0,1e-5"}, {"--noise-independent", "above 0 along each"});
  refused({"--noise-independent", "1e-5", "--noise-common", "1000"}, {"m.csv", "configuration '1'", "a millionth"});
  refused({"--noise", "repeats"}, {"--noise: ", "m.csv", "repeats", "more than once"});
  refused({"--noise", "repeats"}, {"--noise: ", "same.csv", "do not vary", "see --noise-independent"}, "same.csv");
  refused({"--method", "two-step", "--loss", "huber"}, {"--method: ", "two-step", "losses"});
  refused({"--method", "two-step", "--fix", "base.Tx"}, {"--fix: ", "base.Tx", "see --known-base"});
  refused({"--method", "two-step"}, {"--method: ", "p.csv", "two-step", "orientations"}, "p.csv");
  refused({"--free", "Z*"}, {"--free", "'Z*'"});
  refused({"--fix", "Ry1", "--free", "Ry1"}, {"--free: Ry1 is fixed as well", "see --fix"});
  for (const std::string method : {"joint", "two-step"}) {
    refused({"--fix", "*", "--known-base", "truth.json", "--known-targets", "truth.json", "--method", method},
            {"--fix: ", "nothing to estimate", "validation"});
  }
  refused({"--fix", std::string(1000, '*') + "?"}, {"base"});
  refused({"--loss", "cauchy"}, {"'cauchy'", "none, huber, tukey"});
  refused({"--effects", "sag"}, {"--effects", "'sag'", "gravity", "tables"});
  refused({"--effects", "gravity,gravity"}, {"--effects", "more than once"});
  refused({"--effects", "gravity,auto"}, {"--effects", "'auto'", "groups alone"});
  refused({"--gravity-direction", "0,0,0"}, {"--gravity-direction", "not all 0"});
  refused({"--gravity-direction", "0,1"}, {"--gravity-direction"});
  refused({"--gravity"}, {"--gravity: no longer an option, expected --effects gravity"});
  refused({"--joint-gain"}, {"--joint-gain: no longer an option, expected --effects gain"});
  refused({"--extras", "auto"}, {"--extras: no longer an option, expected --effects auto"});
  refused({"--prior-deflection", "1e-4"}, {"--prior-deflection: no longer an option"});
  refused({"--method", "two-step", "--effects", "gravity"}, {"two-step", "effects"});
  refused({"--prior", "0.1"}, {"'0.1'", "auto"});
  refused({"--prior-length", "-1"}, {"--prior-length", "'-1'"});
  refused({"--prior-angle", "1e-200"}, {"--prior-angle", "'1e-200'", "from 1e-15 to 1e12"});
  refused({"--k-fold", "1"}, {"--k-fold", "'1'", "from 2"});
  refused({"--threads", "2000"}, {"--threads", "'2000'"});
  refused({"--iterations", "0"}, {"--iterations", "'0'"});
}

TEST_F(BadTable, ConstraintsThatLeaveTooFewCandidatesSayWhichRemovesHowMany) {
  const std::vector<std::string> plan = {"plan", "--candidates", "100",  "--workspace", "20", "--starts",
                                         "1",    "--output",     "p.csv"};
  write("r.urdf", kTwoJoints);
  const auto refused = [&](std::vector<std::string> more, const std::vector<std::string>& facts) {
    more.insert(more.begin(), plan.begin(), plan.end());
    expect_refused(more, facts);
  };
  const std::string left = "the constraints leave 0 of";
  // Each of these removes every sample.
  const std::string all = " removes 124000 (0 alone)";
  refused({"--box", "9,9,9,10,10,10", "--least-radius", "50", "--keep-out-sphere", "0,0,0,50", "--keep-out-box",
           "-9,-9,-9,9,9,9", "--joint-range", "joint_2+joint_3=900:950"},
          {left, "workspace box" + all, "least radius 50000 mm" + all, "keep-out sphere 1" + all,
           "keep-out box 1" + all, "range of joint_2+joint_3" + all});
  refused({"--clearance", "0.8"}, {"the constraints leave", "clearance 800 mm removes"});
  refused({"--clearance", "9"}, {"clearance 9000 mm", "ever so far apart"});
  refused({"--urdf", "r.urdf", "--arm-radius", "0.01", "--tracker", "4,2,1", "--distance-range", "100:200"},
          {left, "distance from the tracker removes"});
  refused({"--box", "1,1,1,0,0,0"}, {"--box", "xmin"});
  refused({"--box", "1,1,1"}, {"--box", "xmin"});
  refused({"--keep-out-sphere", "1,2,3,nan"}, {"--keep-out-sphere", "radius"});
  refused({"--tracker", "1;2;3"}, {"--tracker", "x,y,z"});
  refused({"--target-file", "none.json"}, {"none.json", "No such file"});
  refused({"--measured", "none.csv", "--add", "2"}, {"none.csv", "No such file"});
  write("facing.json", R"({"targets": [{"name": "A", "position": [0, 0, 0], "facing": [0, 0, 0]}]})");
  refused({"--target-file", "facing.json"}, {"facing.json", "targets[0]", "facing"});
}

// ---- Legal, but extreme --------------------------------------------------------------------------------------------

class Traps : public CommandLine {
protected:
  /// Calibrates m.csv: an answer, trusted or marked, with no number that is none.
  void expect_answer(const std::vector<std::string>& more, const std::string& what) {
    SCOPED_TRACE(what);
    std::vector<std::string> arguments = {"calibrate", "--measurements", "m.csv",  "--output",
                                          "c.urdf",    "--result",       "r.json", "--force"};
    arguments.insert(arguments.end(), more.begin(), more.end());
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

  /// Of each: the length of its links, of its tool and of its errors, and the noise [m].
  void expect_answers_of_robots(const std::vector<std::array<std::string, 4>>& robots);

  /// An arm of four joints whose lengths are about this large.
  static std::string arm(const std::string& length) {
    std::string text = "<robot name='r'><link name='l0'/>";
    const std::vector<std::string> axes = {"0 0 1", "1 0 0", "1 0 0", "0 1 0"};
    for (std::size_t i = 1; i <= 4; ++i) {
      const std::string n = std::to_string(i);
      text += "<link name='l" + n + "'/><joint name='j" + n + "' type='continuous'><parent link='l" +
              std::to_string(i - 1) + "'/><child link='l" + n + "'/><axis xyz='" + axes[i - 1] + "'/><origin xyz='0 " +
              length + " " + length + "'/></joint>";
    }
    return text +
           "<link name='tip'/><joint name='t' type='fixed'><parent link='l4'/><child link='tip'/></joint></robot>";
  }

  /// The range of each joint begins at one of these [deg]; options of simulate and of calibrate.
  void expect_answers_until_the_rank_is_lost(const std::vector<double>& lower,
                                             const std::vector<std::string>& simulated,
                                             const std::vector<std::string>& calibrated);

  nlohmann::json last;
};

class TrapsLongRun : public Traps {};

void Traps::expect_answers_of_robots(const std::vector<std::array<std::string, 4>>& robots) {
  for (const auto& [length, target, sigma, noise] : robots) {
    write("r.urdf", arm(length));
    write("t.json", R"({"targets": [{"name": "A", "position": [)" + target +
                        R"(, 0, 0]}, {"name": "B", "position": [0, )" + target + ", " + target + "]}]}");
    ASSERT_EQ(run({"simulate", "--urdf", "r.urdf", "--target-file", "t.json", "--length-sigma", sigma, "--noise", noise,
                   "--output", "m.csv", "--force"})
                  .status,
              0);
    expect_answer({"--urdf", "r.urdf"}, length);
    expect_answer({"--urdf", "r.urdf", "--method", "two-step", "--iterations", "50"}, length + " two-step");
    expect_answer({"--urdf", "r.urdf", "--effects", "gravity,gain", "--leave-one-out"}, length + " with effects");
    EXPECT_NE(run({"validate", "--urdf", "r.urdf", "--measurements", "m.csv"}).status, 2);
  }
}

TEST_F(Traps, RobotsOfANanometreAndOfAThousandKilometres) {
  expect_answers_of_robots({{"1e-9", "0.1", "1e-12", "0"}, {"1e6", "1e5", "1e3", "1e2"}});
}

TEST_F(TrapsLongRun, RobotsOfANanometreAndOfAThousandKilometresWithSmallAndLargeTools) {
  expect_answers_of_robots({{"1e-9", "1e-10", "1e-12", "1e-13"},
                            {"1e-9", "0.1", "1e-12", "0"},
                            {"1e6", "1e5", "1e3", "1e2"},
                            {"1e6", "0.1", "1", "1e-5"}});
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

void Traps::expect_answers_until_the_rank_is_lost(const std::vector<double>& lower,
                                                  const std::vector<std::string>& simulated,
                                                  const std::vector<std::string>& calibrated) {
  std::vector<std::string> terminations;
  for (const double width : {40.0, 1e-2, 1e-5, 1e-8, 1e-10}) {  // [deg] of every joint's range
    std::string ranges;
    for (const double at : lower) {
      ranges += (ranges.empty() ? "" : ",") + nlohmann::json(at).dump() + ":" + nlohmann::json(at + width).dump();
    }
    const std::string noise = terminations.size() % 2 == 0 ? "1e-5" : "0";
    std::vector<std::string> simulate = {"simulate", "--joint-ranges", ranges,  "--noise",
                                         noise,      "--output",       "m.csv", "--force"};
    simulate.insert(simulate.end(), simulated.begin(), simulated.end());
    ASSERT_EQ(run(simulate).status, 0);
    expect_answer(calibrated, "ranges of " + ranges + " degrees, noise " + noise);
    terminations.push_back(last["termination"]);
  }
  EXPECT_EQ(terminations.front(), "converged");
  EXPECT_EQ(terminations.back(), "rank_deficient");
}

TEST_F(Traps, ConditionNumbersUpToWhereTheRankIsLost) {
  write("r.urdf", kTwoJoints);
  expect_answers_until_the_rank_is_lost({10, 20}, {"--urdf", "r.urdf", "--configurations", "8"},
                                        {"--urdf", "r.urdf", "--effects", "none", "--prior", "none"});
}

TEST_F(TrapsLongRun, ConditionNumbersUpToWhereTheRankIsLostBesideAutomaticChoices) {
  expect_answers_until_the_rank_is_lost({10, 20, 30, 40, 50, 10}, {}, {});
}

TEST_F(Traps, SigmasOfEveryOrder) {
  write("r.urdf", kTwoJoints);
  ASSERT_EQ(
      run({"simulate", "--urdf", "r.urdf", "--configurations", "8", "--noise", "1e-5", "--output", "m.csv"}).status, 0);
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

// ---- Locale --------------------------------------------------------------------------------------------------------

TEST_F(CommandLine, WritesTheSameBytesUnderADecimalComma) {
  const GermanLocaleFolder german;
  if (!german) {
    GTEST_SKIP() << "no locale with a decimal comma: localedef cannot make it here";
  }
  write("r.urdf", kTwoJoints);
  const auto everything = [&] {
    std::string text;
    for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
             {"simulate", "--urdf", "r.urdf", "--configurations", "8", "--noise", "1e-5", "--test-configurations", "3",
              "--output", "m.csv", "--truth", "t.json", "--force"},
             {"calibrate", "--urdf", "r.urdf", "--measurements", "m.csv", "--output", "c.urdf", "--result", "r.json",
              "--force"},
             {"calibrate", "--urdf", "r.urdf", "--measurements", "m.csv", "--method", "two-step"},
             {"validate", "--urdf", "c.urdf", "--measurements", "m.csv"},
             {"fk", "--urdf", "c.urdf", "--joints", "0.1,0.2"},
             {"jacobian", "--joints", "0.1,0.2,0.3,0.4,0.5,0.6", "--json"},
             {"plan", "--configurations", "12", "--candidates", "60", "--workspace", "20", "--starts", "1"}}) {
      const Outcome outcome = run(arguments);
      EXPECT_NE(outcome.status, 2) << outcome.err;
      text += outcome.out + outcome.err;
    }
    for (const auto& [name, content] : files()) {
      text += name + content;
    }
    return text;
  };
  const std::string plain = everything();
  ::setenv("LOCPATH", german.path().c_str(), 1);
  ::setenv("LC_ALL", "de_DE", 1);
  const std::string comma = everything();
  ::unsetenv("LC_ALL");
  ::unsetenv("LOCPATH");
  EXPECT_EQ(plain, comma);
}

}  // namespace
}  // namespace kdl_calibration::testing::kdlcal_robustness_test
