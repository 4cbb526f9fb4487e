#include "model/parameters.hpp"

#include <gtest/gtest.h>

#include "support.hpp"

namespace kdl_calibration::parameters_test {
namespace {

// The travel of a slide without limits is unknown.
TEST(Parameters, OnlySlidesWithBothLimitsAddToTheReach) {
  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  const double whole = reach(model);
  model.joints[1].upper = 0.7;
  EXPECT_NEAR(reach(model), whole + 0.2, 1e-12);
  model.joints[1].upper.reset();
  EXPECT_NEAR(reach(model), whole - 1.0, 1e-12);
  model.joints[1].upper = 0.5;
  model.joints[1].lower.reset();
  EXPECT_NEAR(reach(model), whole - 1.0, 1e-12);
  model.joints[0].origin.p = KDL::Vector(7.0, 0.0, 0.0);  // where it stands
  EXPECT_NEAR(reach(model), whole - 1.0, 1e-12);
}

}  // namespace
}  // namespace kdl_calibration::parameters_test
