#pragma once

#include <cstddef>
#include <functional>
#include <string>

namespace kdl_calibration {

/// A thread-safe function to call after each of a stage's `fits`. It reports the count to `progress`, which is also
/// called at once with count 0. Empty if `progress` is empty.
std::function<void()> counted_fits(const std::function<void(const std::string&, std::size_t, std::size_t)>& progress,
                                   const std::string& stage, std::size_t fits);

/// Runs `work` as a stage of one fit and reports its start and end to `progress`.
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
