#pragma once

#include <cstddef>
#include <functional>
#include <string>

namespace kdl_calibration::cli {

/// Reports progress on standard error. A terminal shows a bar after one second, which is cleared at the end. Other
/// outputs get a line after ten seconds, and further ones at least ten seconds apart.
class Progress {
public:
  /// `elapsed`: seconds since the start of the work; empty: since construction.
  explicit Progress(std::string label = {}, std::function<double()> elapsed = {});
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Reports the completed share of the work, 0 to 1. Not from two threads at once.
  void operator()(double share);
  /// Reports the progress of a stage: `done` of `of` pieces.
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
