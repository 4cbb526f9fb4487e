#include "base/counted_fits.hpp"

#include <memory>
#include <mutex>

namespace kdl_calibration {

std::function<void()> counted_fits(const std::function<void(const std::string&, std::size_t, std::size_t)>& progress,
                                   const std::string& stage, std::size_t fits) {
  if (!progress) {
    return {};
  }
  struct Count {
    std::mutex mutex;
    std::size_t done = 0;
  };
  progress(stage, 0, fits);
  return [count = std::make_shared<Count>(), stage, fits, progress] {
    const std::lock_guard lock(count->mutex);
    ++count->done;
    progress(stage, count->done, fits);
  };
}

}  // namespace kdl_calibration
