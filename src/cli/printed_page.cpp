#include "cli/printed_page.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "base/text_file.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {
namespace {

namespace fs = std::filesystem;

// A folder that is removed with everything in it.
class TemporaryFolder {
public:
  TemporaryFolder() {
    std::string name = (fs::temp_directory_path() / "kdlcal_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) {
      throw InputError("--pdf: no temporary folder can be made in '" + fs::temp_directory_path().string() +
                       "', expected one for the browser");
    }
    path_ = name;
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  fs::path operator/(const char* name) const { return path_ / name; }

private:
  fs::path path_;
};

// The first browser of the PATH.
std::string browser() {
  const char* path = std::getenv("PATH");
  const std::string folders = path != nullptr ? path : "";
  for (const char* name : {"chromium", "chromium-browser", "google-chrome", "google-chrome-stable"}) {
    for (std::size_t at = 0; at <= folders.size();) {
      const std::size_t end = std::min(folders.find(':', at), folders.size());
      const fs::path file = fs::path(folders.substr(at, end - at)) / name;
      if (end > at && ::access(file.c_str(), X_OK) == 0) {
        return file.string();
      }
      at = end + 1;
    }
  }
  throw InputError(
      "--pdf: there is no browser, expected chromium or google-chrome in the PATH; or print the page of --output in "
      "any browser");
}

// Whether the program ended with status 0 in time. Its output is dropped; it is ended after the time.
bool runs(std::vector<std::string> words, std::chrono::seconds most) {
  std::vector<char*> arguments;
  for (std::string& word : words) {
    arguments.push_back(word.data());
  }
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t silent;
  ::posix_spawn_file_actions_init(&silent);
  for (const int stream : {STDOUT_FILENO, STDERR_FILENO}) {
    ::posix_spawn_file_actions_addopen(&silent, stream, "/dev/null", O_WRONLY, 0);
  }
  pid_t process = 0;
  const bool started = ::posix_spawn(&process, words.front().c_str(), &silent, nullptr, arguments.data(), environ) == 0;
  ::posix_spawn_file_actions_destroy(&silent);
  if (!started) {
    return false;
  }
  const auto end = std::chrono::steady_clock::now() + most;
  int status = 0;
  while (::waitpid(process, &status, WNOHANG) == 0) {
    if (std::chrono::steady_clock::now() > end) {
      ::kill(process, SIGKILL);
      ::waitpid(process, &status, 0);
      return false;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

}  // namespace

std::string printed_page(const std::string& html) {
  const std::string program = browser();
  const TemporaryFolder folder;
  const fs::path page = folder / "page.html";
  const fs::path pdf = folder / "page.pdf";
  std::ofstream(page, std::ios::binary) << html;
  std::vector<std::string> words = {program,
                                    "--headless",
                                    "--disable-gpu",
                                    "--disable-background-networking",
                                    "--no-first-run",
                                    "--user-data-dir=" + (folder / "profile").string(),
                                    "--no-pdf-header-footer",
                                    "--print-to-pdf=" + pdf.string()};
  if (::geteuid() == 0) {
    words.emplace_back("--no-sandbox");  // the browser refuses to run as root otherwise; the page loads nothing
  }
  words.push_back("file://" + page.string());
  std::error_code ignored;
  if (!runs(std::move(words), std::chrono::minutes(2)) || !fs::exists(pdf, ignored)) {
    throw InputError("--pdf: '" + program +
                     "' printed no page, expected a browser that runs without a window; or print "
                     "the page of --output in any browser");
  }
  return read_text_file(pdf);
}

}  // namespace kdl_calibration::cli
