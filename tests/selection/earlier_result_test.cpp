#include "selection/earlier_result.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/degree.hpp"
#include "support.hpp"

namespace kdl_calibration::earlier_result_test {
namespace {

TEST(EarlierResult, NamesChangesInMillimetresAndDegrees) {
  EarlierComparison comparison;
  comparison.changes = {{"dq2", 0.25 * kDegree}, {"Tz4", -1.2345e-3}};
  EXPECT_THAT(in_words(complete_model(testing::fanuc()), comparison),
              ::testing::ElementsAre("dq2 by 0.25000 degrees", "Tz4 by -1.2345 mm"));
}

}  // namespace
}  // namespace kdl_calibration::earlier_result_test
