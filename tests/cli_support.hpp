#pragma once

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace kdl_calibration::testing {

struct Outcome {
  int status = -1;
  std::string out;
  std::string err;
};

/// A directory of its own for every test, in which kdlcal runs.
class CommandLine : public ::testing::Test {
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

  /// Runs kdlcal in the test's directory. `largest_file`: bytes that a file may have, 0 for no limit.
  Outcome run(const std::vector<std::string>& arguments, rlim_t largest_file = 0) {
    const std::filesystem::path streams = directory.string() + ".streams";
    std::filesystem::create_directory(streams);
    const std::string out = streams / "out";
    const std::string err = streams / "err";
    std::vector<std::string> words = {KDLCAL_EXECUTABLE};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    std::transform(words.begin(), words.end(), std::back_inserter(argv), [](std::string& word) { return word.data(); });
    argv.push_back(nullptr);
    const pid_t child = ::fork();
    if (child == 0) {
      redirect(out, STDOUT_FILENO);
      redirect(err, STDERR_FILENO);
      if (::chdir(directory.c_str()) != 0) {
        ::_exit(126);
      }
      if (largest_file > 0) {
        const rlimit limit{.rlim_cur = largest_file, .rlim_max = largest_file};
        ::setrlimit(RLIMIT_FSIZE, &limit);
      }
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    return {.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1, .out = content(out), .err = content(err)};
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
                      rlim_t largest_file = 0) {
    const std::string command = ::testing::PrintToString(arguments);
    const auto before = files();
    const Outcome outcome = run(arguments, largest_file);
    EXPECT_EQ(outcome.status, 2) << command << outcome.err;
    EXPECT_EQ(outcome.out, "") << command;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << command << outcome.err;
    EXPECT_TRUE(!outcome.err.empty() && outcome.err.back() == '\n') << command;
    for (const std::string& fact : facts) {
      EXPECT_THAT(outcome.err, ::testing::HasSubstr(fact)) << command;
    }
    EXPECT_TRUE(files() == before) << command << " wrote or changed a file";
  }

  static std::string content(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  }

  std::filesystem::path directory;

private:
  static void redirect(const std::string& file, int descriptor) {
    const int opened = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    ::dup2(opened, descriptor);
    ::close(opened);
  }
};

}  // namespace kdl_calibration::testing
