#pragma once

// Parallel loops whose results do not depend on the number of threads.

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace kdl_calibration {

/// The number of threads to use: `wanted`, or one per core if it is 0.
inline int thread_count(int wanted) {
  return wanted > 0 ? wanted : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

/// Whether this thread runs inside a parallel loop.
inline thread_local bool shares_work = false;

/// Calls work(0) … work(count - 1), in any order and each once, on `threads` threads (0: one per core). Each call may
/// write only to data of its index. Of several exceptions that of the lowest index is rethrown. Nested loops start no
/// further threads.
template <class Work>
void parallel_for(std::size_t count, int threads, const Work& work) {
  const bool is_inside = shares_work;
  const std::size_t workers = is_inside ? 1 : std::min(static_cast<std::size_t>(thread_count(threads)), count);
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr failure;
  std::size_t failed = count;
  const auto serve = [&] {
    shares_work = is_inside || workers > 1;
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        work(i);
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (i < failed) {
          failed = i;
          failure = std::current_exception();
        }
      }
    }
  };
  std::vector<std::thread> pool;
  pool.reserve(workers);
  try {
    for (std::size_t i = 1; i < workers; ++i) {
      pool.emplace_back(serve);
    }
  } catch (const std::system_error&) {  // no more threads available: the existing ones do the work
  }
  serve();
  shares_work = is_inside;
  for (std::thread& thread : pool) {
    thread.join();
  }
  if (failure) {
    std::rethrow_exception(failure);
  }
}

/// The same for ranges of at most `block` indices: work(first, end). The ranges do not depend on the threads.
template <class Work>
void parallel_blocks(std::size_t count, std::size_t block, int threads, const Work& work) {
  parallel_for((count + block - 1) / block, threads,
               [&](std::size_t b) { work(b * block, std::min(count, (b + 1) * block)); });
}

}  // namespace kdl_calibration
