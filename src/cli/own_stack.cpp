#include "cli/own_stack.hpp"

#include <pthread.h>
#include <sys/resource.h>

#include <csignal>
#include <cstddef>

namespace kdl_calibration::cli {
namespace {

constexpr std::size_t kUsualStack = std::size_t{8} << 20U;

bool has_usual_stack() {
  struct rlimit limit = {};
  return ::getrlimit(RLIMIT_STACK, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY || limit.rlim_cur >= kUsualStack;
}

struct Call {
  const std::function<int()>& work;
  sigset_t signals;  // that are held
  int status = 0;
};

void* serve(void* argument) {
  auto& call = *static_cast<Call*>(argument);
  ::pthread_sigmask(SIG_SETMASK, &call.signals, nullptr);
  call.status = call.work();
  return nullptr;
}

}  // namespace

int with_enough_stack(const std::function<int()>& work) {
  if (has_usual_stack()) {
    return work();
  }
  pthread_attr_t attributes;
  ::pthread_attr_init(&attributes);
  ::pthread_attr_setstacksize(&attributes, kUsualStack);
  ::pthread_setattr_default_np(&attributes);
  // The thread that waits takes no signal: where the one that works holds them they have to wait.
  Call call{.work = work, .signals = {}};
  sigset_t all;
  ::sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, &call.signals);
  pthread_t thread{};
  const bool started = ::pthread_create(&thread, &attributes, serve, &call) == 0;
  ::pthread_attr_destroy(&attributes);
  if (started) {
    ::pthread_join(thread, nullptr);
  }
  ::pthread_sigmask(SIG_SETMASK, &call.signals, nullptr);
  return started ? call.status : work();
}

}  // namespace kdl_calibration::cli
