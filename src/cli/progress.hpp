#pragma once

#include <cstddef>
#include <functional>
#include <string>

namespace kdl_calibration::cli {

/// How far long work has got, on standard error. A terminal gets a bar after a second, which is cleared at the end.
/// Anything else gets a line after ten seconds, and further ones at least ten seconds apart.
class Progress {
public:
  /// `elapsed`: seconds since the work began; empty: since now.
  explicit Progress(std::string label = {}, std::function<double()> elapsed = {});
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `share` of the work is done, 0 to 1. Not from two threads at once.
  void operator()(double share);
  /// So many pieces of what is being done are ready.
  void operator()(const std::string& what, std::size_t done, std::size_t of);

private:
  void say(const std::string& what, int percent, const std::string& amount);

  std::string label_;
  std::function<double()> elapsed_;
  bool terminal_ = false;
  double next_;     // [s]
  int shown_ = -1;  // percent
};

}  // namespace kdl_calibration::cli
