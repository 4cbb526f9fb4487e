#include "planning/plate.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "estimation/prediction.hpp"
#include "measurements/stations.hpp"
#include "planning/places.hpp"
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

TEST(Plate, LiesWhereItMay) {
  testing::VirtualExperiment experiment = ball();
  Plate plate = kPlate;
  plate.sockets = {{0.0, 0.0, 0.05}, {0.3, 0.0, 0.05}};
  plate.horizontal = true;
  plate.lowest = 0.6;
  plate.highest = 0.9;
  touch(plate, experiment.ranges, 16, experiment.random, experiment.robot);
  std::set<double> turns;
  for (const Eigen::Isometry3d& X_WB : experiment.robot.truth.frames.bases) {
    const Eigen::Isometry3d X_BW = X_WB.inverse();
    EXPECT_NEAR(X_BW.linear()(2, 2), 1.0, 1e-12);
    EXPECT_GE(X_BW.translation().z(), 0.6);
    EXPECT_LE(X_BW.translation().z(), 0.9);
    turns.insert(X_BW.linear()(0, 0));
  }
  EXPECT_EQ(turns.size(), 4U);
}

// A plan of the nominal robot, driven by one with errors.
TEST(Plate, APlanIsTouchedAtItsPlaces) {
  testing::VirtualExperiment experiment = ball();
  VirtualRobot nominal = nominal_robot(experiment.robot.model, testing::targets_at({{0.05, 0.2, 0.1}}));
  Measurements plan = touch(kPlate, experiment.ranges, 24, experiment.random, nominal);
  plan.targets = {"ball"};
  VirtualRobot& robot = experiment.robot;
  const Measurements touches = touch_as_planned(
      plan, {.name = "ball", .X_FT = nominal.truth.frames.targets.front().X_FT}, 0.0, experiment.random, robot);
  const auto X_BF = flange_poses(robot.model, robot.truth, touches);
  for (std::size_t i = 0; i < touches.observations.size(); ++i) {
    const Observation& o = touches.observations[i];
    EXPECT_EQ(o.position(), plan.observations[i].position());
    EXPECT_LT((o.position() - predicted_point(robot.truth, X_BF, o)).norm(), 1e-11);
  }
  const double change = (touches.joint_values - plan.joint_values).cwiseAbs().maxCoeff();
  EXPECT_GT(change, 1e-4) << "the robot has errors";
  EXPECT_LT(change, 0.1);
  for (std::size_t s = 0; s < 4; ++s) {  // the sockets are where the plan has them; their line leaves a rotation open
    for (const Eigen::Vector3d& socket : kPlate.sockets) {
      EXPECT_LT(
          (robot.truth.frames.bases[s].inverse() * socket - nominal.truth.frames.bases[s].inverse() * socket).norm(),
          1e-9);
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
