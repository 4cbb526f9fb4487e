#pragma once

// Long work without Python's lock. Ctrl-C stops it.

#include <pybind11/pybind11.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <exception>
#include <functional>
#include <future>
#include <mutex>
#include <utility>

namespace kdl_calibration::python {

namespace py = pybind11;

/// Thrown through the library to end work that nobody wants any more.
struct Stopped : std::exception {
  const char* what() const noexcept override { return "stopped"; }
};

/// Whether to stop, and the Python exception that is the reason.
class Interruption {
public:
  void stop(std::exception_ptr reason) {
    const std::lock_guard lock(mutex_);
    if (!reason_) {
      reason_ = std::move(reason);
    }
    stopped_ = true;
  }
  bool is_stopped() const { return stopped_; }
  /// Throws Stopped if the work is to stop.
  void check() const {
    if (stopped_) {
      throw Stopped();
    }
  }
  void rethrow_reason() const {
    if (reason_) {
      std::rethrow_exception(reason_);
    }
  }

private:
  std::atomic<bool> stopped_ = false;
  std::mutex mutex_;
  std::exception_ptr reason_;
};

/// Returns work(interruption), called in a thread of its own without Python's lock. This thread looks for signals
/// meanwhile. The work has to call Interruption::check(), for example as often as it reports progress.
template <class Work>
auto interruptible(const Work& work) {
  Interruption interruption;
  auto result = std::async(std::launch::async, [&] { return work(interruption); });
  const auto is_running = [&] { return result.wait_for(std::chrono::milliseconds(50)) != std::future_status::ready; };
  {
    const py::gil_scoped_release without_lock;
    while (is_running()) {
      const py::gil_scoped_acquire lock;
      if (!interruption.is_stopped() && PyErr_CheckSignals() != 0) {
        interruption.stop(std::make_exception_ptr(py::error_already_set()));
      }
    }
  }
  try {
    auto value = result.get();
    interruption.rethrow_reason();  // a signal that came at the end
    return value;
  } catch (...) {
    interruption.rethrow_reason();  // rather than what the work met meanwhile
    throw;
  }
}

/// Calls a Python callable, or nothing if it is None, with these arguments from any thread. Throws Stopped if it raises
/// or the work is to stop.
template <class... Arguments>
std::function<void(Arguments...)> progress_hook(const py::object& callable, Interruption& interruption) {
  return [function = py::handle(callable), &interruption](Arguments... arguments) {
    interruption.check();
    if (function.is_none()) {
      return;
    }
    const py::gil_scoped_acquire lock;
    try {
      function(arguments...);
    } catch (py::error_already_set&) {
      interruption.stop(std::current_exception());
      throw Stopped();
    }
  };
}

}  // namespace kdl_calibration::python
