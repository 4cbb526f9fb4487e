// Preloaded into kdlcal by the tests: lets a system call fail, and time fly. Asked for by environment variables:
//   FAULT_CALL    open, write, fsync, close or rename
//   FAULT_PATH    part of the path of the files it is about; all files where it is absent
//   FAULT_NUMBER  which of these calls, counted from 1; with a + behind it this one and all that follow
//   FAULT_ERROR   the number of the error; 0: a write that takes half of what it should
//   CLOCK_RATE    how many times as fast the steady clock runs; 0: it stands
// The calls are made directly, so that it does not matter what else is loaded.
#include <fcntl.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdlib>
#include <cstring>
#include <ctime>

namespace {

const char* environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

std::atomic<long> calls{0};

bool is_due(const char* call, const char* path) {
  if (std::strcmp(environment("FAULT_CALL"), call) != 0 || std::strstr(path, environment("FAULT_PATH")) == nullptr) {
    return false;
  }
  const char* number = environment("FAULT_NUMBER");
  char* end = nullptr;
  const long wanted = std::strtol(number, &end, 10);
  const long made = ++calls;
  return made == wanted || (made > wanted && *end == '+');
}

int error() { return std::atoi(environment("FAULT_ERROR")); }

// Whether it is this call on an open file that has to fail.
bool is_due(const char* call, int descriptor) {
  std::array<char, 64> link{};
  std::array<char, 4096> path{};
  char* end = link.data() + link.size() - 1;
  do {
    *--end = static_cast<char>('0' + descriptor % 10);
    descriptor /= 10;
  } while (descriptor > 0);
  constexpr char kDirectory[] = "/proc/self/fd/";
  char* begin = end - (sizeof(kDirectory) - 1);
  std::memcpy(begin, kDirectory, sizeof(kDirectory) - 1);
  ::syscall(SYS_readlinkat, AT_FDCWD, begin, path.data(), path.size() - 1);
  return is_due(call, path.data());
}

int open_at(int directory, const char* path, int flags, mode_t mode) {
  if (is_due("open", path)) {
    errno = error();
    return -1;
  }
  return static_cast<int>(::syscall(SYS_openat, directory, path, flags, mode));
}

int rename_at(int from, const char* old_path, int to, const char* new_path, unsigned flags) {
  if (is_due("rename", old_path)) {
    errno = error();
    return -1;
  }
  return static_cast<int>(::syscall(SYS_renameat2, from, old_path, to, new_path, flags));
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  return open_at(AT_FDCWD, path, flags, mode);
}

int open64(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  return open_at(AT_FDCWD, path, flags, mode);
}

ssize_t write(int descriptor, const void* data, size_t count) {
  if (is_due("write", descriptor)) {
    if (error() != 0) {
      errno = error();
      return -1;
    }
    count = count > 1 ? count / 2 : count;
  }
  return ::syscall(SYS_write, descriptor, data, count);
}

int fsync(int descriptor) {
  if (is_due("fsync", descriptor)) {
    errno = error();
    return -1;
  }
  return static_cast<int>(::syscall(SYS_fsync, descriptor));
}

// The file is closed all the same, as on Linux.
int close(int descriptor) {
  const bool due = is_due("close", descriptor);
  const int result = static_cast<int>(::syscall(SYS_close, descriptor));
  if (due) {
    errno = error();
    return -1;
  }
  return result;
}

int rename(const char* old_path, const char* new_path) noexcept {
  return rename_at(AT_FDCWD, old_path, AT_FDCWD, new_path, 0);
}

int renameat2(int from, const char* old_path, int to, const char* new_path, unsigned flags) noexcept {
  return rename_at(from, old_path, to, new_path, flags);
}

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  const int result = static_cast<int>(::syscall(SYS_clock_gettime, clock, time));
  if (std::getenv("CLOCK_RATE") != nullptr && clock == CLOCK_MONOTONIC) {
    const long rate = std::atol(environment("CLOCK_RATE"));
    constexpr long kBillion = 1'000'000'000;
    time->tv_sec = time->tv_sec % 1'000'000 * rate + time->tv_nsec * rate / kBillion;
    time->tv_nsec = time->tv_nsec * rate % kBillion;
  }
  return result;
}

}  // extern "C"
