#pragma once

#include <chrono>
#include <cstddef>
#include <string>

namespace kdl_calibration::cli {

/// A bar on standard error for work that takes more than a second, where that is a terminal. Cleared at the end.
class Progress {
public:
  explicit Progress(std::string label = {});
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `share` of the work is done, 0 to 1. Not from two threads at once.
  void operator()(double share);
  /// So many pieces of what is being done are ready.
  void operator()(const std::string& what, std::size_t done, std::size_t of);

private:
  std::string label_;
  std::chrono::steady_clock::time_point start_;
  bool terminal_ = false;
  bool due() const;
  void show(int percent, const std::string& behind);

  int shown_ = -1;  // percent
};

}  // namespace kdl_calibration::cli
