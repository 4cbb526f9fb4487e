#include "base/whole_files.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <system_error>
#include <utility>

#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const OutputFile& file, const std::string& what) {
  const std::string path = file.path.find('\0') == std::string::npos ? file.path : one_line(file.path);
  throw InputError((file.option.empty() ? "'" : file.option + ": '") + path + "' " + what);
}

[[noreturn]] void fail_to_write(const OutputFile& file, int error) {
  fail(file, "cannot be written: " + std::generic_category().message(error));
}

// Signals that end a program by default, without those of program faults except SIGABRT. Batch systems send several of
// them.
constexpr std::array kEndingSignals = {SIGHUP,  SIGINT,    SIGQUIT, SIGABRT, SIGPIPE, SIGALRM,   SIGTERM, SIGUSR1,
                                       SIGUSR2, SIGSTKFLT, SIGPOLL, SIGPROF, SIGPWR,  SIGVTALRM, SIGXCPU};

// Blocks the signals that end the process during its lifetime.
class SignalsHeld {
public:
  SignalsHeld() {
    sigset_t held;
    ::sigemptyset(&held);
    for (const int signal : kEndingSignals) {
      ::sigaddset(&held, signal);
    }
    ::pthread_sigmask(SIG_BLOCK, &held, &before_);
  }
  ~SignalsHeld() { ::pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  SignalsHeld(const SignalsHeld&) = delete;
  SignalsHeld& operator=(const SignalsHeld&) = delete;

private:
  sigset_t before_{};
};

// The file's path with symbolic links resolved, and the permissions of the replaced file (0 if there is none).
struct Target {
  fs::path path;
  fs::path directory;
  mode_t mode = 0;
  bool exists = false;
};

class Temporary;

// Files to undo on a signal.
constexpr std::size_t kMostTemporaries = 8;
std::array<std::atomic<Temporary*>, kMostTemporaries> temporaries_at_risk{};

// A temporary file, removed by its destructor unless it was renamed. A signal that ends the process undoes it.
class Temporary {
public:
  Temporary(const OutputFile& file, const Target& target) : file_(file), target_(target) {
    const SignalsHeld held;
    for (int attempt = 0; descriptor_ < 0; ++attempt) {
      path_ = target.directory / (".kdlcal-" + std::to_string(::getpid()) + "-" + std::to_string(attempt) + ".tmp");
      descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
      if (descriptor_ < 0 && (errno != EEXIST || attempt > 1000)) {
        fail_to_write(file_, errno);
      }
    }
    for (std::atomic<Temporary*>& slot : temporaries_at_risk) {
      Temporary* none = nullptr;
      if (slot.compare_exchange_strong(none, this)) {
        break;
      }
    }
  }
  ~Temporary() {
    const SignalsHeld held;
    if (descriptor_ >= 0) {
      ::close(descriptor_);
    }
    if (state_ == State::temporary || state_ == State::exchanged) {
      ::unlink(path_.c_str());
    }
    for (std::atomic<Temporary*>& slot : temporaries_at_risk) {
      Temporary* own = this;
      slot.compare_exchange_strong(own, nullptr);
    }
  }
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;

  void write() {
    const TextSink sink = [this](std::string_view piece) { write(piece); };
    if (file_.pieces) {
      file_.pieces(sink);
    } else {
      sink(file_.text);
    }
    const bool permitted = target_.mode == 0 || ::fchmod(descriptor_, target_.mode) == 0;
    if (!permitted || ::fsync(descriptor_) != 0) {
      fail_to_write(file_, errno);
    }
    const int descriptor = std::exchange(descriptor_, -1);
    if (::close(descriptor) != 0) {
      fail_to_write(file_, errno);
    }
  }

  // Gives the file the target's name. A replaced file gets the temporary's name, so that it can be restored.
  void rename(bool force) {
    const bool replaces = target_.exists;
    const unsigned flags = replaces ? RENAME_EXCHANGE : force ? 0U : RENAME_NOREPLACE;
    if (::renameat2(AT_FDCWD, path_.c_str(), AT_FDCWD, target_.path.c_str(), flags) == 0) {
      state_ = replaces ? State::exchanged : State::renamed;
      return;
    }
    const bool unknown = errno == EINVAL || errno == ENOSYS;  // the file system supports no flags
    const bool vanished = errno == ENOENT && replaces;
    if (!(unknown || vanished) || ::rename(path_.c_str(), target_.path.c_str()) != 0) {
      fail_to_write(file_, errno);
    }
    state_ = replaces ? State::replaced : State::renamed;
  }

  // Restores the target from before the renaming and removes the temporary file. False if that is impossible. Makes
  // only calls that a signal handler may make.
  bool undo() noexcept {
    const char* target = target_.path.c_str();
    const bool undone =
        state_ == State::temporary ||
        (state_ == State::exchanged && ::renameat2(AT_FDCWD, path_.c_str(), AT_FDCWD, target, RENAME_EXCHANGE) == 0) ||
        (state_ == State::renamed && ::rename(target, path_.c_str()) == 0);
    if (undone) {
      ::unlink(path_.c_str());
      state_ = State::temporary;
    }
    return undone;
  }

private:
  enum class State { temporary, renamed, exchanged, replaced };

  void write(std::string_view piece) const {
    while (!piece.empty()) {
      const ssize_t written = ::write(descriptor_, piece.data(), piece.size());
      if (written < 0 && errno != EINTR) {
        fail_to_write(file_, errno);
      }
      piece.remove_prefix(static_cast<std::size_t>(std::max<ssize_t>(written, 0)));
    }
  }

  const OutputFile& file_;
  const Target& target_;
  fs::path path_;
  int descriptor_ = -1;
  State state_ = State::temporary;
};

void end_by_signal(int signal) {
  for (const std::atomic<Temporary*>& slot : temporaries_at_risk) {
    if (Temporary* temporary = slot.load(); temporary != nullptr) {
      temporary->undo();
    }
  }
  std::signal(signal, SIG_DFL);
  std::raise(signal);  // the parent sees the signal: status 130 for Ctrl-C
}

Target checked_target(const OutputFile& file, bool force) {
  std::error_code error;
  fs::path path = file.path;
  if (file.path.find('\0') != std::string::npos) {  // the system would write the file named by the part before it
    fail(file, "has a NUL byte, expected a file name");
  }
  if (fs::is_directory(path, error)) {
    fail(file, "is a directory, expected a file name");
  }
  if (path.filename().empty()) {
    fail(file, "is no file name, expected one");
  }
  if (fs::is_symlink(path, error)) {
    path = fs::canonical(path, error);
    if (error) {
      fail(file, "is a symbolic link that leads nowhere, expected a file name");
    }
  }
  const fs::path parent = path.parent_path().empty() ? fs::path(".") : path.parent_path();
  if (!fs::is_directory(parent, error)) {
    fail(file, "cannot be written: '" + parent.string() + "' is no directory that exists");
  }
  Target target{.path = path, .directory = parent};
  struct stat status = {};
  if (::lstat(path.c_str(), &status) != 0) {
    if (errno != ENOENT) {
      fail_to_write(file, errno);
    }
    return target;
  }
  if (!S_ISREG(status.st_mode)) {
    fail(file, "exists and is no regular file, expected a file name");
  }
  if (!force) {
    fail(file, "exists, expected a new file name or --force to overwrite it");
  }
  target.mode = status.st_mode & 07777U;
  target.exists = true;
  return target;
}

// Whether both names refer to the same existing file, also through links.
bool are_same_file(const fs::path& one, const fs::path& other) {
  std::error_code error;
  return fs::equivalent(one, other, error) && !error;
}

// Empty if there is no such file. Unlike sha256_of_file, this makes it no input.
std::string hash_of_existing(const std::string& path) {
  std::error_code error;
  const File file(fs::is_regular_file(path, error) ? std::fopen(path.c_str(), "rb") : nullptr);
  return file ? sha256_of(file.get(), path) : std::string();
}

// Options of outputs are among those that name files, but are no inputs.
void require_no_input(const OutputFile& file, const std::vector<OutputFile>& files,
                      const std::vector<NamedFile>& inputs) {
  const bool any_hash =
      std::any_of(inputs.begin(), inputs.end(), [](const NamedFile& input) { return !input.sha256.empty(); });
  const std::string hash = any_hash ? hash_of_existing(file.path) : std::string();
  for (const NamedFile& input : inputs) {
    const bool is_output = std::any_of(files.begin(), files.end(),
                                       [&](const OutputFile& output) { return output.option == input.option; });
    if (!is_output && are_same_file(file.path, input.path)) {
      fail(file, "is the file that " + input.reason + " as '" + input.path + "', expected another one");
    }
    if (!hash.empty() && input.sha256 == hash) {
      fail(file, "holds what " + input.reason + " as '" + input.path + "', expected another one");
    }
  }
}

std::vector<Target> checked_targets(const std::vector<OutputFile>& files, const std::vector<NamedFile>& inputs,
                                    bool force) {
  std::vector<Target> targets;
  targets.reserve(files.size());
  for (const OutputFile& file : files) {
    require_no_input(file, files, inputs);  // first, as --force is no way out
    targets.push_back(checked_target(file, force));
  }
  for (std::size_t i = 0; i < files.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const auto whole = [](const Target& target) { return fs::weakly_canonical(fs::absolute(target.path)); };
      if (are_same_file(targets[i].path, targets[j].path) || whole(targets[i]) == whole(targets[j])) {
        fail(files[i], "is the same file as that of " + files[j].option + ", expected another one");
      }
    }
  }
  return targets;
}

using Temporaries = std::vector<std::unique_ptr<Temporary>>;

void rename(const Temporaries& temporaries, bool force) {
  const SignalsHeld held;  // a signal undoes all files or none
  for (const std::unique_ptr<Temporary>& temporary : temporaries) {
    temporary->rename(force);
  }
}

// Gives the files that stay, as the file system cannot restore the replaced ones.
std::string undo(const Temporaries& temporaries, const std::vector<OutputFile>& files) {
  const SignalsHeld held;
  std::vector<std::string> left;
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (!temporaries[i]->undo()) {
      left.push_back("'" + files[i].path + "'");
    }
  }
  return comma_separated(left);
}

// The name then survives a power cut. Not every file system supports that.
void sync_directory(const Target& target) {
  const int directory = ::open(target.directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (directory >= 0) {
    ::fsync(directory);
    ::close(directory);
  }
}

}  // namespace

void remove_temporaries_on_signals() {
  for (const int signal : kEndingSignals) {
    if (std::signal(signal, end_by_signal) == SIG_IGN) {
      std::signal(signal, SIG_IGN);  // as under nohup
    }
  }
}

void require_writable(const std::vector<OutputFile>& files, const std::vector<NamedFile>& inputs, bool force) {
  const std::vector<Target> targets = checked_targets(files, inputs, force);
  for (std::size_t i = 0; i < files.size(); ++i) {
    const Temporary probe(files[i], targets[i]);
  }
}

void write_whole(const std::vector<OutputFile>& files, const std::vector<NamedFile>& inputs, bool force,
                 const std::function<void()>& after_renaming) {
  const std::vector<Target> targets = checked_targets(files, inputs, force);
  Temporaries temporaries;
  for (std::size_t i = 0; i < files.size(); ++i) {
    temporaries.push_back(std::make_unique<Temporary>(files[i], targets[i]));
    temporaries.back()->write();
  }
  try {
    rename(temporaries, force);
    std::for_each(targets.begin(), targets.end(), sync_directory);
    if (after_renaming) {
      after_renaming();
    }
  } catch (const std::exception& error) {
    const std::string left = undo(temporaries, files);
    if (left.empty()) {
      throw;
    }
    throw InputError(std::string(error.what()) + "; written all the same: " + left);
  }
  const SignalsHeld held;  // a signal before this undoes all files, one after it none
  temporaries.clear();
}

}  // namespace kdl_calibration
