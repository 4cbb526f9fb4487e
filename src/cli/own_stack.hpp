#pragma once

#include <functional>

namespace kdl_calibration::cli {

/// Calls `work` and returns what it does. Where the process was given less stack than usual (ulimit -s), which a file
/// of documented size might need, that happens on a thread with a stack of its own, and threads started from now on
/// have as much. `work` must not throw. Signals that end the process reach the thread that works.
int with_enough_stack(const std::function<int()>& work);

}  // namespace kdl_calibration::cli
