#pragma once

// Not installed.

#include <cstddef>
#include <functional>
#include <string>

namespace kdl_calibration {

/// A function to be called after each of a stage's `fits`, from any thread. It passes the count on to `progress`, which
/// hears of the stage at once. Empty if `progress` is.
std::function<void()> counted_fits(const std::function<void(const std::string&, std::size_t, std::size_t)>& progress,
                                   const std::string& stage, std::size_t fits);

/// The result of `work`, a stage whose fits are not counted.
template <class Work>
auto with_progress(const std::function<void(const std::string&, std::size_t, std::size_t)>& progress,
                   const std::string& stage, const Work& work) {
  const std::function<void()> done = counted_fits(progress, stage, 1);
  auto result = work();
  if (done) {
    done();
  }
  return result;
}

}  // namespace kdl_calibration
