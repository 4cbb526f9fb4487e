#pragma once

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace kdl_calibration::testing {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
#elif defined(__has_feature)
constexpr bool kSanitized = __has_feature(address_sanitizer) || __has_feature(thread_sanitizer);
#else
constexpr bool kSanitized = false;
#endif

/// A robot of two joints, of which a calibration is cheap.
inline constexpr const char* kTwoJoints = R"(<robot name="two"><link name="a"/><link name="b"/><link name="c"/>
<link name="d"/><joint name="j1" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0 0.5 0.5"/>
<axis xyz="0 0 1"/></joint><joint name="j2" type="continuous"><parent link="b"/><child link="c"/>
<origin xyz="0 0.5 0.5"/><axis xyz="1 0 0"/></joint><joint name="t" type="fixed"><parent link="c"/><child link="d"/>
</joint></robot>)";

/// q = M c + o of kOddArm with signs, couplings, a factor and offsets; the controller has the slide in front.
inline constexpr const char* kOddArmCoupled = R"({"controller_joints": ["S", "A1", "A2", "A3", "A4"],
  "urdf_joints": ["turn", "slide", "skew", "elbow", "wrist"],
  "matrix": [[0,1,0,0,0], [-1,0,0,0,0], [0,-0.5,1,0,0], [0,0,1,-1,0], [0,0,0,0,2]],
  "offset": [0.1, 0.05, -0.2, 0.3, -0.4]})";

using Words = std::vector<std::string>;

template <class T>
std::vector<T> operator+(std::vector<T> left, const std::vector<T>& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

inline Words words_of(const std::string& line) {
  std::istringstream stream(line);
  return {std::istream_iterator<std::string>(stream), {}};
}

/// What surrounds a run of kdlcal. No run may take more than this: one that does is ended and fails its test, so that
/// a limit which no longer works does not fill the machine.
struct Surroundings {
  std::string out = "/dev/null";                                 ///< where standard output goes
  std::string err = "/dev/null";                                 ///< where standard error goes
  rlim_t largest_file = 0;                                       ///< bytes that a file may have; 0: no limit
  rlim_t stack = 0;                                              ///< bytes, as ulimit -s sets it; 0: that of the test
  rlim_t cpu_seconds = kSanitized ? 1200 : 400;                  ///< far beyond what any takes on a slow machine
  unsigned seconds = kSanitized ? 1200 : 300;                    ///< on the clock, of a machine that has other work
  rlim_t memory = rlim_t{2} << 30U;                              ///< bytes of data; not under the thread sanitizer
  bool for_peak = false;                                         ///< without it, peak() is at least the test's own
  std::vector<std::pair<std::string, std::string>> environment;  ///< what is set beside the test's own
};

/// What the call says on standard error.
template <class Call>
std::string said_by(Call&& call) {
  ::testing::internal::CaptureStderr();
  call();
  return ::testing::internal::GetCapturedStderr();
}

/// A kdlcal that runs beside the test.
class Process {
public:
  Process(const std::filesystem::path& directory, std::vector<std::string> arguments, Surroundings surroundings = {})
      : surroundings_(std::move(surroundings)) {
    arguments.insert(arguments.begin(), KDLCAL_EXECUTABLE);
    command_ = ::testing::PrintToString(arguments);
    std::vector<std::string> variables = environment();
    start(directory.c_str(), pointers(arguments), pointers(variables));
  }
  ~Process() {
    if (child_ > 0 && !waited_for_) {
      send(SIGKILL);
      ::waitpid(child_, nullptr, 0);
    }
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void send(int signal) const { ::kill(child_, signal); }

  bool ended() const {
    siginfo_t info{};
    return ::waitid(P_PID, static_cast<id_t>(child_), &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid != 0;
  }

  /// Sleeps until it has used so much of the processor [s] or has ended: what it has come to by then does not depend on
  /// other work of the machine.
  void let_work(double seconds) const {
    clockid_t clock{};
    timespec used{};
    if (::clock_getcpuclockid(child_, &clock) != 0) {
      return;
    }
    while (!ended() && ::clock_gettime(clock, &used) == 0 &&
           static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec) < seconds) {
      ::usleep(1000);
    }
  }

  /// The status that waitpid gives. The test fails where time ended the process.
  int wait() {
    int status = 0;
    ::wait4(child_, &status, 0, &usage_);
    waited_for_ = true;
    const int signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    if (signal == SIGALRM) {
      ADD_FAILURE() << command_ << " was ended: expected at most " << surroundings_.seconds << " s on the clock";
    } else if (signal == SIGXCPU) {
      ADD_FAILURE() << command_ << " was ended: expected at most " << surroundings_.cpu_seconds << " s of processor";
    }
    return status;
  }

  /// Fails the test where what kdlcal said on standard error shows that the memory ended it.
  void expect_memory_sufficed(const std::string& err) const {
    const bool exhausted =
        err.find("out of memory") != std::string::npos || err.find("hard rss limit exhausted") != std::string::npos;
    EXPECT_FALSE(exhausted) << command_ << " was ended: expected at most " << surroundings_.memory << " bytes";
  }

  /// Largest resident memory [bytes] of one that was started for it, once it was waited for.
  double peak() const { return 1024.0 * static_cast<double>(usage_.ru_maxrss); }

private:
  static std::vector<char*> pointers(std::vector<std::string>& words) {
    std::vector<char*> result;
    std::transform(words.begin(), words.end(), std::back_inserter(result),
                   [](std::string& word) { return word.data(); });
    result.push_back(nullptr);
    return result;
  }

  // NAME=VALUE of the test's own and of what is set beside it.
  std::vector<std::string> environment() const {
    auto set = surroundings_.environment;
    if (kSanitized) {  // whose shadow memory counts as data; the address sanitizer limits what is resident
      const char* given = std::getenv("ASAN_OPTIONS");
      const std::string megabytes = std::to_string(4 * (surroundings_.memory >> 20U));
      set.emplace_back("ASAN_OPTIONS",
                       (given == nullptr ? "" : std::string(given) + ":") + "hard_rss_limit_mb=" + megabytes);
    }
    std::vector<std::string> variables;
    for (const auto& [name, value] : set) {
      variables.push_back(name + "=" + value);
    }
    for (char** variable = environ; *variable != nullptr; ++variable) {
      const std::string text = *variable;
      const bool replaced =
          std::any_of(set.begin(), set.end(), [&](const auto& other) { return text.starts_with(other.first + "="); });
      if (!replaced) {
        variables.push_back(text);
      }
    }
    return variables;
  }

  // The child shares the test's memory until it becomes kdlcal, as a copy of a large test's page tables takes longer
  // than a start of kdlcal: it may change nothing but what belongs to a process. What is shared counts as used by it.
  void start(const char* directory, const std::vector<char*>& argv, const std::vector<char*>& variables) {
    const pid_t child =
        surroundings_.for_peak ? ::fork() : ::vfork();  // NOLINT(clang-analyzer-security.insecureAPI.vfork)
    if (child == 0) {
      become_kdlcal(directory, argv.data(), variables.data());
    }
    child_ = child;
  }

  [[noreturn]] void become_kdlcal(const char* directory, char* const* argv, char* const* variables) const {
    redirect(surroundings_.out.c_str(), STDOUT_FILENO);
    redirect(surroundings_.err.c_str(), STDERR_FILENO);
    std::signal(SIGINT, SIG_DFL);  // which a shell's background jobs ignore
    set_limits();
    if (::chdir(directory) != 0) {
      ::_exit(126);
    }
    ::execve(argv[0], argv, variables);
    ::_exit(127);
  }

  // The alarm and the limits stay with the process when it becomes kdlcal.
  void set_limits() const {
    std::signal(SIGALRM, SIG_DFL);
    std::signal(SIGXCPU, SIG_DFL);
    ::alarm(surroundings_.seconds);
    limit(RLIMIT_CPU, surroundings_.cpu_seconds, surroundings_.cpu_seconds + 5);
    limit(RLIMIT_CORE, 0, 0);
    if (surroundings_.stack > 0) {
      limit(RLIMIT_STACK, surroundings_.stack, surroundings_.stack);
    }
    if (surroundings_.largest_file > 0) {
      limit(RLIMIT_FSIZE, surroundings_.largest_file, surroundings_.largest_file);
    }
    if (!kSanitized) {
      limit(RLIMIT_DATA, surroundings_.memory, surroundings_.memory);
    }
  }

  static void limit(decltype(RLIMIT_CPU) resource, rlim_t soft, rlim_t hard) {
    const rlimit limits{.rlim_cur = soft, .rlim_max = hard};
    ::setrlimit(resource, &limits);
  }

  static void redirect(const char* file, int descriptor) {
    const int opened = ::open(file, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    ::dup2(opened, descriptor);
    ::close(opened);
  }

  Surroundings surroundings_;
  std::string command_;
  pid_t child_ = -1;
  bool waited_for_ = false;
  rusage usage_{};
};

struct Outcome {
  int status = -1;
  std::string out;
  std::string err;  ///< without lines of progress, as those depend on time
  std::string progress;
};

/// A directory of its own for every test, in which kdlcal runs.
class CommandLine : public ::testing::Test {
public:
  static std::string content(const std::filesystem::path& file) {
    if (!std::filesystem::is_regular_file(file)) {  // /dev/full can be read without end
      return {};
    }
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  }

protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::temp_directory_path() / "kdlcal_test_XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    directory = pattern;
  }
  void TearDown() override {
    std::filesystem::remove_all(directory);
    std::filesystem::remove_all(directory.string() + ".streams");
  }

  /// Runs kdlcal in the test's directory. Its streams are kept where `surroundings` send them nowhere.
  Outcome run(const std::vector<std::string>& arguments, Surroundings surroundings = {}) {
    const std::filesystem::path streams = directory.string() + ".streams";
    std::filesystem::create_directory(streams);
    const Surroundings nowhere;
    surroundings.out = surroundings.out == nowhere.out ? (streams / "out").string() : surroundings.out;
    surroundings.err = surroundings.err == nowhere.err ? (streams / "err").string() : surroundings.err;
    Process process(directory, arguments, surroundings);
    const int status = process.wait();
    Outcome outcome{.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1,
                    .out = content(surroundings.out),
                    .err = content(surroundings.err),
                    .progress = {}};
    static const std::regex of_progress("kdlcal: [^\n]*[0-9]( %)? done\n");
    for (std::smatch match; std::regex_search(outcome.err, match, of_progress);) {
      outcome.progress += match.str();
      outcome.err.erase(static_cast<std::size_t>(match.position()), match.str().size());
    }
    process.expect_memory_sufficed(outcome.err);
    return outcome;
  }

  void succeed(const std::vector<std::string>& arguments) {
    const Outcome outcome = run(arguments);
    ASSERT_EQ(outcome.status, 0) << ::testing::PrintToString(arguments) << outcome.err;
  }

  nlohmann::json run_json(const std::vector<std::string>& arguments) {
    const Outcome outcome = run(arguments);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return nlohmann::json::parse(outcome.out, nullptr, false);
  }

  std::string write(const std::string& name, const std::string& text) {
    std::ofstream(directory / name, std::ios::binary) << text;
    return name;
  }
  /// A file of so many bytes that takes no room on the disk; false where the file system has none such.
  bool write_sparse(const std::string& name, std::uintmax_t size) {
    write(name, "");
    std::error_code error;
    std::filesystem::resize_file(directory / name, size, error);
    return !error;
  }
  void write(const std::map<std::string, std::string>& texts) {
    for (const auto& [name, text] : texts) {
      write(name, text);
    }
  }

  /// Leaves m.csv and r.json of a calibrated virtual FANUC without effects, which is made once.
  void write_calibration() {
    write_once("a calibrated FANUC", [this] {
      succeed(words_of("simulate --noise 3e-5 --length-sigma 0.001 --angle-sigma 0.001 --output m.csv"));
      succeed(words_of("calibrate --measurements m.csv --effects none --prior none --result r.json"));
    });
  }

  /// Leaves the files that `make` makes, which is done once for all tests that name them so.
  void write_once(const std::string& what, const std::function<void()>& make) {
    static std::map<std::string, std::map<std::string, std::string>> known;
    if (const auto found = known.find(what); found != known.end()) {
      write(found->second);
      return;
    }
    make();
    if (!::testing::Test::HasFatalFailure()) {
      known[what] = files();
    }
  }

  std::string path(const std::string& name) const { return (directory / name).string(); }
  std::string text_of(const std::string& name) const { return content(directory / name); }
  nlohmann::json json_of(const std::string& name) const { return nlohmann::json::parse(text_of(name)); }

  /// Every file and what it holds.
  std::map<std::string, std::string> files() const {
    std::map<std::string, std::string> result;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(directory)) {
      const bool regular = entry.is_regular_file() && !entry.is_symlink();
      result[entry.path().lexically_relative(directory)] = regular ? content(entry.path()) : "";
    }
    return result;
  }

  /// Bad usage or bad input: status 2, nothing on standard output, one line on standard error with all these facts in
  /// it, no file written or changed.
  void expect_refused(const std::vector<std::string>& arguments, const std::vector<std::string>& facts,
                      const Surroundings& surroundings = {}) {
    const std::string command = ::testing::PrintToString(arguments);
    const auto before = files();
    const Outcome outcome = run(arguments, surroundings);
    EXPECT_EQ(outcome.status, 2) << command << outcome.err;
    EXPECT_EQ(outcome.out, "") << command;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << command << outcome.err;
    EXPECT_TRUE(!outcome.err.empty() && outcome.err.back() == '\n') << command;
    for (const std::string& fact : facts) {
      EXPECT_THAT(outcome.err, ::testing::HasSubstr(fact)) << command;
    }
    EXPECT_TRUE(files() == before) << command << " wrote or changed a file";
  }

  std::filesystem::path directory;
};

}  // namespace kdl_calibration::testing
