// Files that are written whole or not at all, where a process of its own would show too little: temporary files whose
// names are taken, signals while they exist, and names that no file can have. System calls that fail meanwhile, and
// where progress shows beside them (see faults.cpp, which is preloaded).

#include <pty.h>
#include <sys/stat.h>
#include <unistd.h>
#include <array>
#include <cerrno>
#include <csignal>
#include <regex>
#include <system_error>

#include "base/text_file.hpp"
#include "cli/data_dir.hpp"
#include "cli/output_files.hpp"
#include "cli_support.hpp"
#include "kdl_calibration/input_error.hpp"
#include "refusal.hpp"

namespace kdl_calibration::testing::output_files_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ExitedWithCode;
using ::testing::IsEmpty;
using ::testing::KilledBySignal;
using ::testing::UnorderedElementsAre;

class WrittenFiles : public CommandLine {
protected:
  cli::OutputFile file(const std::string& name, const std::string& text = "new",
                       const std::string& option = "--output") const {
    return {.option = option, .path = (directory / name).string(), .text = text};
  }
  static std::string temporary(int attempt) {
    return ".kdlcal-" + std::to_string(::getpid()) + "-" + std::to_string(attempt) + ".tmp";
  }
  std::vector<std::string> names() const {
    std::vector<std::string> result;
    for (const auto& [name, text] : files()) {
      result.push_back(name);
    }
    return result;
  }
  /// A death test's process: its standard output leads to a pipe that nobody reads.
  static void break_standard_output() {
    std::array<int, 2> ends{};
    ASSERT_EQ(::pipe(ends.data()), 0);
    ::dup2(ends[1], STDOUT_FILENO);
    ::close(ends[0]);
    ::close(ends[1]);
  }
};
using WrittenFilesDeathTest = WrittenFiles;

constexpr std::array kEndingSignals = {SIGHUP,  SIGINT,    SIGQUIT, SIGABRT, SIGPIPE, SIGALRM,   SIGTERM, SIGUSR1,
                                       SIGUSR2, SIGSTKFLT, SIGPOLL, SIGPROF, SIGPWR,  SIGVTALRM, SIGXCPU};

TEST_F(WrittenFiles, AreThereTogetherUnderTheirNames) {
  const mode_t mask = ::umask(027);
  cli::write_whole({file("a", "first"), file("b", "", "--truth")}, false);
  ::umask(mask);
  EXPECT_EQ(files(), (std::map<std::string, std::string>{{"a", "first"}, {"b", ""}}));
  EXPECT_EQ(fs::status(directory / "a").permissions(), fs::perms(0640));
  fs::permissions(directory / "a", fs::perms(0751));
  cli::write_whole({file("a", "second")}, true);
  EXPECT_EQ(text_of("a"), "second");
  EXPECT_EQ(fs::status(directory / "a").permissions(), fs::perms(0751));
}

TEST_F(WrittenFiles, PassByNamesOfTemporaryFilesThatAreTaken) {
  write(temporary(0), "of somebody");
  write(temporary(1), "of somebody else");
  cli::require_writable({file("a")}, false);
  cli::write_whole({file("a"), file("b")}, false);
  EXPECT_EQ(files(),
            (std::map<std::string, std::string>{
                {"a", "new"}, {"b", "new"}, {temporary(0), "of somebody"}, {temporary(1), "of somebody else"}}));
}

TEST_F(WrittenFiles, GiveUpWhereAThousandNamesAreTaken) {
  for (int attempt = 0; attempt <= 1000; ++attempt) {
    write(temporary(attempt), "");
  }
  cli::write_whole({file("a")}, false);
  EXPECT_EQ(text_of("a"), "new");
  write(temporary(1001), "");
  EXPECT_EQ(refusal([&] { cli::require_writable({file("b")}, false); }),
            "--output: '" + (directory / "b").string() + "' cannot be written: File exists");
}

TEST_F(WrittenFiles, HaveNamesThatAFileCanHave) {
  const std::string name(300, 'n');
  EXPECT_EQ(refusal([&] { cli::require_writable({file(name)}, false); }),
            "--output: '" + (directory / name).string() + "' cannot be written: File name too long");
  const std::vector<cli::OutputFile> all = {file("a", "", "--output"), file("b", "", "--result"),
                                            file("./b", "", "--report"), file("c/../a", "", "--truth")};
  fs::create_directory(directory / "c");
  EXPECT_EQ(refusal([&] {
              cli::require_writable({all[0], all[1], all[2]}, false);
            }),
            "--report: '" + all[2].path + "' is the same file as that of --result, expected another one");
  EXPECT_EQ(refusal([&] {
              cli::require_writable({all[0], all[1], all[3]}, false);
            }),
            "--truth: '" + all[3].path + "' is the same file as that of --output, expected another one");
  EXPECT_THAT(names(), UnorderedElementsAre("c"));
  write("old", "old");
  fs::create_hard_link(directory / "old", directory / "c" / "linked");
  EXPECT_EQ(refusal([&] {
              cli::require_writable({file("old"), file("c/linked", "", "--result")}, true);
            }),
            "--result: '" + file("c/linked").path + "' is the same file as that of --output, expected another one");
}

TEST_F(WrittenFiles, AreNeverTheInputOfAnotherOptionNorTheRobotOfKdlcal) {
  write("in.csv", "input");
  fs::create_hard_link(directory / "in.csv", directory / "same.csv");
  const std::string input = (directory / "in.csv").string();
  cli::protect_inputs({{.option = "--config", .path = "none"}, {.option = "--plan", .path = input}});
  EXPECT_EQ(refusal([&] { cli::require_writable({file("same.csv")}, true); }),
            "--output: '" + file("same.csv").path + "' is the file that --plan reads as '" + input +
                "', expected another one");
  cli::require_writable({file("same.csv", "", "--plan")}, true);
  const cli::OutputFile robot{.option = "--output", .path = cli::default_urdf_path().string(), .text = {}};
  EXPECT_EQ(refusal([&] { cli::require_writable({robot}, true); }), "--output: '" + robot.path +
                                                                        "' is the file that kdlcal itself reads as '" +
                                                                        robot.path + "', expected another one");
  cli::protect_inputs({});
  cli::require_writable({file("same.csv")}, true);
  cli::read_on_trial([&] {
    read_text_file(input);
    throw InputError("no such file");
  });
  cli::require_writable({file("same.csv")}, true);
  cli::read_on_trial([&] { read_text_file(input); });
  EXPECT_EQ(refusal([&] { cli::require_writable({file("same.csv")}, true); }),
            "--output: '" + file("same.csv").path + "' is the file that this run reads as '" + input +
                "', expected another one");
  cli::protect_inputs({});
  EXPECT_EQ(text_of("in.csv"), "input");
}

TEST_F(WrittenFilesDeathTest, DisappearWithTheirTemporariesWhereASignalEndsTheProcess) {
  static volatile int ending = 0;
  for (const int signal : kEndingSignals) {
    EXPECT_EXIT(
        {
          cli::remove_temporaries_on_signals();
          ending = signal;
          if (signal != SIGPIPE) {
            std::signal(SIGPIPE, [](int) { std::raise(ending); });
          }
          break_standard_output();
          cli::write_whole({file("a"), file("b")}, false, "what nobody reads");
          ::_exit(0);
        },
        KilledBySignal(signal), "");
    EXPECT_THAT(names(), IsEmpty()) << "signal " << signal;
  }
  EXPECT_EXIT(
      {
        break_standard_output();
        cli::write_whole({file("a"), file("b")}, false, "what nobody reads");
        ::_exit(0);
      },
      KilledBySignal(SIGPIPE), "");
  EXPECT_EQ(names().size(), 2U) << "else there was nothing to take away";
}

TEST_F(WrittenFilesDeathTest, LeaveSignalsIgnoredThatWereIgnored) {
  for (const int signal : kEndingSignals) {
    const auto raised = [=](void (*before)(int)) {
      std::signal(signal, before);
      cli::remove_temporaries_on_signals();
      std::raise(signal);
      ::_exit(0);
    };
    EXPECT_EXIT(raised(SIG_DFL), KilledBySignal(signal), "");
    EXPECT_EXIT(raised(SIG_IGN), ExitedWithCode(0), "");
  }
}

}  // namespace
}  // namespace kdl_calibration::testing::output_files_test

namespace kdl_calibration::testing::output_files_test::faults {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

struct Fault {
  std::string call;
  std::string number;  ///< which of the calls, "2+" from the second on
  int error = 0;
  std::string path = ".kdlcal-";  ///< part of the name of the files concerned: the temporary ones
};

class Faults : public CommandLine {
protected:
  static Surroundings with_library() {
    Surroundings surroundings;
    surroundings.environment = {{"LD_PRELOAD", FAULTS_LIBRARY}};
    if (kSanitized) {  // which otherwise insists on being loaded first
      const char* given = std::getenv("ASAN_OPTIONS");
      surroundings.environment.emplace_back(
          "ASAN_OPTIONS", (given == nullptr ? "" : std::string(given) + ":") + "verify_asan_link_order=0");
    }
    return surroundings;
  }

  static Surroundings with(const Fault& fault) {
    Surroundings surroundings = with_library();
    surroundings.environment.insert(surroundings.environment.end(), {{"FAULT_CALL", fault.call},
                                                                     {"FAULT_NUMBER", fault.number},
                                                                     {"FAULT_ERROR", std::to_string(fault.error)},
                                                                     {"FAULT_PATH", fault.path}});
    return surroundings;
  }

  static std::vector<std::string> simulate(const std::vector<std::string>& more = {}) {
    return words_of("simulate --configurations 20 --seed 7 --noise 0.00003 --output m.csv --truth t.json") + more;
  }

  static std::string words_for(int error) { return std::generic_category().message(error); }

  // Status 2 and one line that names option, file and error; nothing on standard output, every file as it was before,
  // none left behind.
  void expect_nothing_written(const std::vector<std::string>& arguments, const Fault& fault, const std::string& option,
                              const std::string& file) {
    SCOPED_TRACE("call " + fault.number + " of " + fault.call + ": " + words_for(fault.error));
    expect_refused(arguments, {option + ": '" + file + "' cannot be written: " + words_for(fault.error) + "\n"},
                   with(fault));
  }
};

// The calls on the temporary files of two outputs: a file each is opened and closed to see whether that is possible,
// then each is opened, written, flushed, closed; then both are renamed.
struct Place {
  std::string call;
  std::string of_first;
  std::string of_second;
};
const std::vector<Place> kPlaces = {
    {"open", "1", "2"},  {"open", "3", "4"},  {"write", "1", "2"},
    {"fsync", "1", "2"}, {"close", "3", "4"}, {"rename", "1", "2"},
};

TEST_F(Faults, FilesAreBothTheNewOnesOrBothAsTheyWere) {
  for (const std::vector<std::string>& old : {std::vector<std::string>{}, {"m.csv", "t.json"}, {"m.csv"}, {"t.json"}}) {
    std::filesystem::remove(directory / "m.csv");
    std::filesystem::remove(directory / "t.json");
    for (const std::string& name : old) {
      write(name, "old " + name);
    }
    for (const Place& place : kPlaces) {
      expect_nothing_written(simulate({"--force"}), {place.call, place.of_first, EACCES}, "--output", "m.csv");
      expect_nothing_written(simulate({"--force"}), {place.call, place.of_second, EIO}, "--truth", "t.json");
    }
    EXPECT_EQ(files().size(), old.size());
  }
}

TEST_F(Faults, WritesThatAreInterruptedOrShortGoOn) {
  ASSERT_EQ(run(simulate()).status, 0);
  const auto expected = files();
  const std::vector<std::pair<std::string, int>> faults = {{"1", EINTR}, {"2", EINTR}, {"1", 0}, {"1+", 0}};
  for (const auto& [number, error] : faults) {
    const Outcome outcome = run(simulate({"--force"}), with({"write", number, error}));
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_TRUE(files() == expected) << "write " << number << " with error " << error;
  }
}

TEST_F(Faults, ADirectoryThatCannotBeFlushedIsNoFailure) {
  std::vector<std::string> arguments = simulate({"--force"});
  for (std::string& word : arguments) {  // so that the directory has a name
    word = word == "m.csv" || word == "t.json" ? (directory / word).string() : word;
  }
  succeed(arguments);
  const auto expected = files();
  // Behind the probes and the temporary files; the second of these finds the first one's name taken.
  for (const auto& [call, number] : std::vector<std::pair<std::string, std::string>>{{"open", "6"}, {"fsync", "3"}}) {
    const Outcome outcome = run(arguments, with({call, number, EINVAL, directory.filename()}));
    EXPECT_EQ(outcome.status, 0) << call << ": " << outcome.err;
    EXPECT_TRUE(files() == expected) << call;
  }
}

TEST_F(Faults, AFileSystemWithoutFlagsOfRenamingIsRenamedOnPlainly) {
  for (const int error : {EINVAL, ENOSYS}) {
    const Outcome outcome = run(simulate({"--force"}), with({"rename", "1", error}));
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_EQ(files().size(), 2U);
  }
}

// The second renaming fails, and all that would restore the first file.
TEST_F(Faults, AFileThatCannotBeRestoredIsNamed) {
  write("m.csv", "old");
  const Outcome outcome = run(simulate({"--force"}), with({"rename", "2+", EIO}));
  EXPECT_EQ(outcome.status, 2);
  EXPECT_EQ(outcome.out, "");
  EXPECT_EQ(outcome.err,
            "kdlcal: --truth: 't.json' cannot be written: " + words_for(EIO) + "; written all the same: 'm.csv'\n");
  EXPECT_THAT(text_of("m.csv"), HasSubstr("configuration"));
  EXPECT_EQ(files().size(), 1U);
}

// Work that takes long by a clock that runs fast.
class ProgressBar : public Faults {
protected:
  static Surroundings by_clock(const std::string& rate) {
    Surroundings surroundings = with_library();
    surroundings.environment.emplace_back("CLOCK_RATE", rate);
    return surroundings;
  }
  static Surroundings hurried() { return by_clock("100000"); }

  std::vector<std::string> calibrate_long() {
    write("two.urdf", kTwoJoints);
    EXPECT_EQ(run(simulate({"--urdf", "two.urdf"})).status, 0);
    return {"calibrate", "--urdf", "two.urdf", "--measurements", "m.csv", "--leave-one-out", "--threads", "1"};
  }

  // What a terminal gets to see of it.
  std::string seen_on_a_terminal(const std::vector<std::string>& arguments, Surroundings surroundings,
                                 bool both_streams = false, int expected = 0) {
    int terminal = -1;
    int other = -1;
    std::array<char, 256> name{};
    EXPECT_EQ(::openpty(&terminal, &other, name.data(), nullptr, nullptr), 0);
    surroundings.err = name.data();
    surroundings.out = both_streams ? surroundings.err : surroundings.out;
    Process process(directory, arguments, surroundings);
    ::close(other);
    std::string text;
    std::array<char, 4096> part{};
    for (ssize_t count = 0; (count = ::read(terminal, part.data(), part.size())) > 0;) {  // fails once kdlcal is gone
      text.append(part.data(), static_cast<std::size_t>(count));
    }
    ::close(terminal);
    const int status = process.wait();
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == expected) << text;
    return text;
  }
};

TEST_F(ProgressBar, IsNotForFilesWhichGetLinesOnStandardErrorAlone) {
  const std::vector<std::string> arguments = calibrate_long();
  const Outcome usual = run(arguments);
  const Outcome outcome = run(arguments, hurried());
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.progress, ::testing::ContainsRegex("^kdlcal: [a-z -]+: [0-9]+/[0-9]+ done\n"));
  EXPECT_EQ(outcome.err, usual.err);
  EXPECT_EQ(outcome.out, usual.out);
  EXPECT_THAT(outcome.err + outcome.out, Not(HasSubstr("\r")));
}

TEST_F(ProgressBar, GrowsOnATerminalAndIsWipedAway) {
  const std::string text = seen_on_a_terminal(calibrate_long(), hurried());
  const std::regex bar("\r([^\\[\r]*) \\[(#*)( *)\\] (\\d+)/(\\d+)\033\\[K");
  int last = -1;
  int bars = 0;
  std::vector<std::string> stages;
  for (std::sregex_iterator at(text.begin(), text.end(), bar), end; at != end; ++at, ++bars) {
    const int percent = 100 * std::stoi((*at)[4]) / std::stoi((*at)[5]);
    if (stages.empty() || stages.back() != (*at)[1]) {
      stages.push_back((*at)[1]);
      last = -1;
    }
    EXPECT_GT(percent, last) << "goes back or repeats itself";
    EXPECT_LE(percent, 100);
    EXPECT_EQ((*at)[2].length(), percent * 40 / 100) << at->str();
    EXPECT_EQ((*at)[2].length() + (*at)[3].length(), 40) << at->str();
    last = percent;
  }
  EXPECT_GE(bars, 20) << text;
  EXPECT_THAT(stages, ::testing::IsSupersetOf({"trying geometry alone", "leave-one-out"}));
  EXPECT_EQ(stages.front(), "screening the measurements");
  EXPECT_EQ(last, 100);
  const std::size_t wiped = text.find("\r\033[K");
  ASSERT_NE(wiped, std::string::npos) << text;
  EXPECT_THAT(text.substr(wiped), Not(HasSubstr("leave-one-out ["))) << "wiped before its end";
}

TEST_F(ProgressBar, ShowsTheShareOfAPlanThatIsDone) {
  const std::string text = seen_on_a_terminal(
      words_of("plan --configurations 12 --candidates 60 --workspace 20 --starts 4 --monte-carlo 2 --threads 1"),
      hurried());
  const std::regex bar("\r([^\\[\r]*) \\[(#*)( *)\\] (\\d+) %\033\\[K");
  std::vector<std::string> shown;
  for (std::sregex_iterator at(text.begin(), text.end(), bar), end; at != end; ++at) {
    EXPECT_EQ((*at)[2].length(), std::stoi((*at)[4]) * 40 / 100) << at->str();
    EXPECT_EQ((*at)[2].length() + (*at)[3].length(), 40) << at->str();
    shown.push_back((*at)[1].str() + " " + (*at)[4].str());
  }
  EXPECT_THAT(shown, ::testing::ElementsAre("choosing 20", "choosing 40", "choosing 60", "choosing 80",
                                            "Monte Carlo 50", "Monte Carlo 100"));
}

TEST_F(ProgressBar, StandsBesideDoubtsThatATerminalShowsOnce) {
  write("two.urdf", kTwoJoints);
  ASSERT_EQ(run(simulate({"--urdf", "two.urdf"})).status, 0);
  std::vector<std::string> arguments =
      words_of("calibrate --urdf two.urdf --measurements m.csv --iterations 1 --effects none --prior none");
  const std::string line = "kdlcal: not to be trusted: the fit did not converge";
  const Surroundings usual = with_library();
  EXPECT_THAT(seen_on_a_terminal(arguments, usual, false, 1), HasSubstr(line)) << "the table went elsewhere";
  const std::string table = seen_on_a_terminal(arguments, usual, true, 1);
  EXPECT_THAT(table, ::testing::AllOf(HasSubstr("the fit did not converge"), Not(HasSubstr(line))));
  arguments.emplace_back("--json");
  EXPECT_THAT(seen_on_a_terminal(arguments, usual, true, 1), HasSubstr(line)) << "the JSON is not for people";
}

TEST_F(ProgressBar, DoesNotShowForWorkOfLessThanASecond) {
  EXPECT_THAT(seen_on_a_terminal(calibrate_long(), by_clock("0")), Not(HasSubstr("leave-one-out [")));
}

}  // namespace
}  // namespace kdl_calibration::testing::output_files_test::faults
