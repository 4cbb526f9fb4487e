// Files that are written whole or not at all, where a process of its own would show too little: temporary files whose
// names are taken, signals while they exist, and names that no file can have.

#include "cli/output_files.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <system_error>

#include "cli/data_dir.hpp"
#include "cli_support.hpp"
#include "refusal.hpp"

namespace kdl_calibration::testing::cli_output_files_test {
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
}

TEST_F(WrittenFiles, AreNeverTheInputOfAnotherOptionNorTheRobotOfKdlcal) {
  write("in.csv", "input");
  fs::create_hard_link(directory / "in.csv", directory / "same.csv");
  const std::string input = (directory / "in.csv").string();
  cli::protect_inputs({{.option = "--config", .path = "none"}, {.option = "--plan", .path = input}});
  EXPECT_EQ(refusal([&] { cli::require_writable({file("same.csv")}, true); }),
            "--output: '" + file("same.csv").path + "' is the file that --plan reads, expected another one");
  cli::require_writable({file("same.csv", "", "--plan")}, true);
  const cli::OutputFile robot{.option = "--output", .path = cli::default_urdf_path().string(), .text = {}};
  EXPECT_EQ(refusal([&] { cli::require_writable({robot}, true); }),
            "--output: '" + robot.path + "' is the file that kdlcal itself reads, expected another one");
  cli::protect_inputs({});
  cli::require_writable({file("same.csv")}, true);
  EXPECT_EQ(text_of("in.csv"), "input");
}

TEST_F(WrittenFilesDeathTest, DisappearWithTheirTemporariesWhereASignalEndsTheProcess) {
  EXPECT_EXIT(
      {
        cli::remove_temporaries_on_signals();
        break_standard_output();
        cli::write_whole({file("a"), file("b")}, false, "what nobody reads");
        ::_exit(0);
      },
      KilledBySignal(SIGPIPE), "");
  EXPECT_THAT(names(), IsEmpty());
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
  for (const int signal : {SIGHUP, SIGINT, SIGQUIT, SIGPIPE, SIGTERM}) {
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
}  // namespace kdl_calibration::testing::cli_output_files_test
