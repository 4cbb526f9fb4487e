#include "results/calibrated_urdf.hpp"

#include <gmock/gmock.h>

#include <limits>

#include "model/error_chains.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::calibrated_urdf_test {
namespace {

using testing::errors_of;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(CalibratedUrdf, EachErrorCorrectsTheOriginOfItsJointHoweverSmall) {
  const ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  EXPECT_THAT(origin_corrections(model, errors_of(model)), IsEmpty());
  int of_the_tip = 0;
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    Eigen::VectorXd errors = errors_of(model);
    errors[static_cast<Eigen::Index>(p)] = 1e-9;
    const std::vector<OriginCorrection> corrections = origin_corrections(model, errors);
    const int frame = model.parameters[p].frame;
    ASSERT_EQ(corrections.size(), 1U) << model.parameters[p].name;
    EXPECT_EQ(corrections[0].joint, frame == 5 ? "mount" : model.joints[static_cast<std::size_t>(frame)].name);
    EXPECT_LT(testing::difference(corrections[0].correction, frame_correction(model, errors, frame)), 1e-15);
    of_the_tip += frame == 5 ? 1 : 0;
  }
  EXPECT_GT(of_the_tip, 0);
}

TEST(CalibratedUrdf, WhatNoJointCarriesIsRefused) {
  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  model.tip_joint.clear();
  Eigen::VectorXd errors = errors_of(model);
  errors[0] = 1e-3;
  EXPECT_EQ(origin_corrections(model, errors).size(), 1U) << "of the first joint";
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    errors[static_cast<Eigen::Index>(p)] = model.parameters[p].frame == 5 ? 1e-3 : 0.0;
  }
  EXPECT_THAT(testing::refusal([&] { origin_corrections(model, errors); }),
              HasSubstr("no fixed joint between joint 'wrist' and the tip carries them"));
  EXPECT_THAT(testing::refusal([&] { origin_corrections(model, errors.head(3)); }), HasSubstr("errors"));
  errors[2] = std::numeric_limits<double>::infinity();
  EXPECT_THAT(testing::refusal([&] { origin_corrections(model, errors); }), HasSubstr("an error"));
}

}  // namespace
}  // namespace kdl_calibration::calibrated_urdf_test
