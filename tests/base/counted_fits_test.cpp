#include "base/counted_fits.hpp"

#include <gtest/gtest.h>

#include <string>
#include <tuple>
#include <vector>

namespace kdl_calibration::counted_fits_test {
namespace {

TEST(CountedFits, TellHowManyOfAStageAreDone) {
  std::vector<std::tuple<std::string, std::size_t, std::size_t>> told;
  const auto progress = [&](const std::string& what, std::size_t done, std::size_t of) {
    told.emplace_back(what, done, of);
  };
  const std::function<void()> first = counted_fits(progress, "leave-one-out", 2);
  const std::function<void()> second = counted_fits(progress, "5-fold", 5);
  first();
  const std::function<void()> copy = first;  // goes on with the same count
  copy();
  second();
  const std::vector<std::tuple<std::string, std::size_t, std::size_t>> expected = {
      {"leave-one-out", 0, 2}, {"5-fold", 0, 5}, {"leave-one-out", 1, 2}, {"leave-one-out", 2, 2}, {"5-fold", 1, 5}};
  EXPECT_EQ(told, expected);
}

TEST(CountedFits, AreNotCountedWhereNobodyAsks) { EXPECT_FALSE(counted_fits({}, "leave-one-out", 2)); }

}  // namespace
}  // namespace kdl_calibration::counted_fits_test
