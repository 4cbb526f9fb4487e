#include "assessment/same_joint_values.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "kdl_calibration/random.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;

// Few values, so that many columns agree in some joints or in all of them.
TEST(SameJointValues, NamesTheFirstColumnThatALoopOverAllOfThemFinds) {
  Random random(1);
  for (int trial = 0; trial < 60; ++trial) {
    Eigen::MatrixXd values(trial % 5, trial);
    for (double& value : values.reshaped()) {
      value = std::floor(random.uniform(0.0, 3.0)) - 1.0;
    }
    const std::vector<Index> found = first_at_same_values(values);
    ASSERT_EQ(static_cast<Index>(found.size()), values.cols()) << values;
    for (Index c = 0; c < values.cols(); ++c) {
      Index first = 0;
      while (values.col(first) != values.col(c)) {
        ++first;
      }
      EXPECT_EQ(found[static_cast<std::size_t>(c)], first) << "column " << c << " of\n" << values;
    }
  }
}

}  // namespace
}  // namespace kdl_calibration
