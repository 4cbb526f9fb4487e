#include "planning/plate.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "estimation/prediction.hpp"
#include "measurements/stations.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::plate_test {
namespace {

using ::testing::HasSubstr;
using testing::refusal;

testing::VirtualExperiment ball() {
  return testing::VirtualExperiment({.targets = testing::targets_at({{0.05, 0.2, 0.1}})});
}

const Plate kPlate{.sockets = {{0.0, 0.0, 0.0}, {0.3, 0.0, 0.0}}, .places = 4};

TEST(Plate, TheBallIsInTheSockets) {
  testing::VirtualExperiment experiment = ball();
  const Measurements touches = touch(kPlate, experiment.ranges, 24, experiment.random, experiment.robot);
  EXPECT_EQ(touches.stations.size(), 4U);
  EXPECT_EQ(experiment.robot.model.stations, touches.stations);
  const auto X_BF = flange_poses(experiment.robot.model, experiment.robot.truth, touches);
  for (const Observation& o : touches.observations) {
    EXPECT_LT((o.position() - predicted_point(experiment.robot.truth, X_BF, o)).norm(), 1e-11);
    for (std::size_t i = 0; i < experiment.ranges.size(); ++i) {
      const double q = touches.joint_values(static_cast<Eigen::Index>(i), o.configuration);
      EXPECT_TRUE(q >= experiment.ranges[i].first && q <= experiment.ranges[i].second);
    }
  }
}

TEST(Plate, IsRefusedWhereTheArmReachesNone) {
  testing::VirtualExperiment experiment = ball();
  const Plate far{.sockets = {{0.0, 0.0, 0.0}, {30.0, 0.0, 0.0}}, .places = 1};
  EXPECT_THAT(refusal([&] { return touch(far, experiment.ranges, 4, experiment.random, experiment.robot); }),
              HasSubstr("no place of the plate was found"));
  testing::VirtualExperiment several;
  EXPECT_THAT(refusal([&] { return touch(kPlate, several.ranges, 4, several.random, several.robot); }),
              HasSubstr("targets of a robot that touches a plate"));
}

}  // namespace
}  // namespace kdl_calibration::plate_test
