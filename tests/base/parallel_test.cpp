#include "base/parallel.hpp"

#include <gmock/gmock.h>

#include <stdexcept>
#include <string>

namespace kdl_calibration::parallel_test {
namespace {

TEST(Parallel, DoesEachIndexOnceOnAnyNumberOfThreads) {
  for (const int threads : {0, 1, 2, 5}) {
    for (const std::size_t count : {0U, 1U, 3U, 100U}) {
      std::vector<int> calls(count, 0);
      parallel_for(count, threads, [&](std::size_t i) { ++calls.at(i); });
      EXPECT_EQ(calls, std::vector<int>(count, 1)) << threads << " threads";
    }
  }
}

TEST(Parallel, UsesAsManyThreadsAsAreWantedAndNoMoreThanThereIsWork) {
  const auto threads_of = [](std::size_t count, int threads) {
    std::mutex mutex;
    std::vector<std::thread::id> ids;
    std::atomic<std::size_t> waiting{0};
    parallel_for(count, threads, [&](std::size_t /*i*/) {
      {
        const std::lock_guard lock(mutex);
        ids.push_back(std::this_thread::get_id());
      }
      ++waiting;
      while (waiting < count) {  // so that none does the work of two
        std::this_thread::yield();
      }
    });
    std::sort(ids.begin(), ids.end());
    return std::unique(ids.begin(), ids.end()) - ids.begin();
  };
  EXPECT_EQ(threads_of(3, 3), 3);
  EXPECT_EQ(threads_of(2, 7), 2);
  EXPECT_EQ(thread_count(7), 7);
  EXPECT_GE(thread_count(0), 1);
}

TEST(Parallel, StartsNoThreadsInsideWorkThatSeveralShare) {
  const auto is_alone = [](int outer, int inner) {
    std::atomic<bool> alone{true};
    parallel_for(4, outer, [&](std::size_t /*i*/) {
      const std::thread::id own = std::this_thread::get_id();
      std::atomic<int> calls{0};
      parallel_for(3, inner, [&](std::size_t /*k*/) {
        ++calls;
        alone = alone && std::this_thread::get_id() == own;
        while (outer == 1 && calls < 3) {  // so that none does the work of two
          std::this_thread::yield();
        }
      });
      EXPECT_EQ(calls, 3);
    });
    return alone.load();
  };
  EXPECT_TRUE(is_alone(2, 3));
  EXPECT_TRUE(is_alone(5, 0));
  EXPECT_FALSE(is_alone(1, 3)) << "one thread shares nothing, and what it shared before is over";
}

TEST(Parallel, PassesOnWhatTheLowestIndexThrewAfterAllWereTried) {
  for (const int threads : {1, 4}) {
    std::atomic<int> calls{0};
    try {
      parallel_for(50, threads, [&](std::size_t i) {
        ++calls;
        if (i % 10 == 7) {
          throw std::runtime_error(std::to_string(i));
        }
      });
      ADD_FAILURE() << "expected an exception";
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "7") << threads << " threads";
    }
    EXPECT_EQ(calls, 50) << threads << " threads";
  }
}

TEST(Parallel, BlocksCoverTheRangeWithoutOverlap) {
  for (const std::size_t count : {0U, 1U, 7U, 8U, 9U}) {
    std::vector<int> calls(count, 0);
    parallel_blocks(count, 4, 3, [&](std::size_t first, std::size_t end) {
      EXPECT_EQ(first % 4, 0U);
      EXPECT_TRUE(first < end && end <= std::min(count, first + 4)) << first << " to " << end;
      for (std::size_t i = first; i < end; ++i) {
        ++calls.at(i);
      }
    });
    EXPECT_EQ(calls, std::vector<int>(count, 1)) << count;
  }
}

}  // namespace
}  // namespace kdl_calibration::parallel_test
