#include "planning/places_plan.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <string>
#include <vector>

#include "effects/arm_kinematics.hpp"
#include "estimation/prediction.hpp"
#include "geometry_alone.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/calibrated_arm.hpp"
#include "measurements/stations.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::places_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::refusal;

constexpr double kNoise = 5e-5;  // [m]
const std::vector<Vector3d> kSockets = {{0.0, 0.0, 0.0}, {0.3, 0.0, 0.0}};

DeterminedByRows determined(const Places& places, const std::vector<TargetFrame>& targets) {
  testing::VirtualExperiment experiment({.targets = targets});
  const MatrixXd q = experiment.configurations(40 * places.stations);
  return determined_by(
      rows_at(places, nominal_robot(experiment.model, targets), {.ranges = experiment.ranges}, q, experiment.random));
}

// The theory of each way to measure: a whole point shows all six directions of a base; two sockets hide the rotation
// about their line; two coordinates hide the translation along the third axis; a height above a plane hides the three
// motions of the plane in itself; a distance from an anchor hides the rotations about it.
TEST(Places, DetermineTheArmAndTheirShareOfEachBase) {
  const std::vector<TargetFrame> three = published_targets(3);
  const std::vector<TargetFrame> ball = testing::targets_at({{0.05, 0.2, 0.1}});
  const auto expect = [](const DeterminedByRows& found, int parameters, int of_base, std::size_t stations) {
    EXPECT_EQ(found.arm.columns, parameters);
    EXPECT_EQ(found.arm.rank, parameters);
    EXPECT_THAT(found.arm.tied, IsEmpty());
    EXPECT_EQ(found.bases, std::vector<int>(stations, of_base));
  };
  expect(determined({.stations = 1}, three), 27, 6, 1);
  expect(determined({.stations = 3}, three), 27, 6, 3);
  expect(determined({.stations = 2, .directions = "xz"}, three), 27, 5, 2);
  expect(determined({.stations = 4, .directions = "z"}, three), 27, 3, 4);
  expect(determined({.stations = 1, .directions = "r"}, three), 27, 3, 1);
  expect(determined({.stations = 4, .sockets = kSockets}, ball), 21, 5, 4);
}

// Touches of one socket at one place show the arm only as far as a point that does not move shows it: a larger arm,
// with the socket as much farther, is the same.
TEST(Places, OfOneSocketLeaveTheScale) {
  const DeterminedByRows found =
      determined({.stations = 1, .sockets = {Vector3d::Zero()}}, testing::targets_at({{0.05, 0.2, 0.1}}));
  EXPECT_EQ(found.bases, std::vector<int>{3});
  EXPECT_EQ(found.arm.rank, found.arm.columns - 1);
  ASSERT_EQ(found.arm.tied.size(), 1U);
  EXPECT_THAT(found.arm.tied.front(), ::testing::Contains("Tz2"));
}

PlanRequest request(const Robot& robot, const std::vector<TargetFrame>& targets) {
  PlanRequest request{.robot = robot, .targets = targets};
  request.cell.ranges = limits_of(robot.joints);
  request.noise.sigma = kNoise;
  request.count = 40;
  request.candidates = 400;
  request.starts = 2;
  request.workspace = 200;
  request.threads = 2;
  return request;
}

TEST(PlacesPlan, TouchesReachTheirSocketsPlaceByPlace) {
  const Robot& robot = testing::bundled_robot();
  PlanRequest wanted = request(robot, testing::targets_at({{0.05, 0.2, 0.1}}));
  wanted.cell.height = 0.4;
  const PlacesPlan plan = plan_at_places(wanted, {.stations = 4, .sockets = kSockets});
  ASSERT_EQ(plan.sheet.joint_values.cols(), 40);
  for (std::size_t c = 0; c < 40; ++c) {
    EXPECT_EQ(plan.sheet.stations[c], "P" + std::to_string(c / 10 + 1));
  }
  const VirtualRobot& nominal = plan.rows.robot;
  const ArmKinematics arm(nominal.model, nominal.truth.errors, nominal.truth.effects);
  const Vector3d ball = nominal.truth.frames.targets.front().X_FT.translation();
  for (Index c = 0; c < 40; ++c) {
    const auto i = static_cast<std::size_t>(c);
    const auto station = std::find(plan.rows.measurements.stations.begin(), plan.rows.measurements.stations.end(),
                                   plan.sheet.stations[i]) -
                         plan.rows.measurements.stations.begin();
    const Vector3d in_base = arm.flange_pose(plan.sheet.joint_values.col(c)) * ball;
    EXPECT_GE(in_base.z(), 0.4);
    const Vector3d there = nominal.truth.frames.base(static_cast<std::size_t>(station)) * in_base;
    EXPECT_LT((there - plan.sheet.points.col(c)).norm(), 1e-9) << c;
    EXPECT_LT(std::min((there - kSockets[0]).norm(), (there - kSockets[1]).norm()), 1e-9) << c;
  }
  EXPECT_LT(plan.planned.sigma.mean, plan.random.sigma.mean);
}

// A calibration of the planned touches, with the noise stated, states the uncertainty that the plan promises.
TEST(PlacesPlan, PromisesWhatACalibrationStates) {
  const Robot& robot = testing::bundled_robot();
  PlanRequest wanted = request(robot, testing::targets_at({{0.05, 0.2, 0.1}}));
  testing::VirtualExperiment experiment({.targets = wanted.targets});
  wanted.tasks = experiment.configurations(50);
  const PlacesPlan plan = plan_at_places(wanted, {.stations = 4, .sockets = kSockets});
  CalibrationOptions options = testing::geometry_alone();
  options.noise.stated.independent.setConstant(kNoise);
  const CalibratedArm arm = calibrate(robot, plan.rows.measurements, options).arm();
  double squares = 0.0;
  for (const auto& q : wanted.tasks.colwise()) {
    squares += arm.predict(q, wanted.targets.front().name).covariance.trace();
  }
  const double rms = std::sqrt(squares / static_cast<double>(wanted.tasks.cols()));
  EXPECT_NEAR(rms, plan.planned.sigma.rms, 1e-3 * plan.planned.sigma.rms);
}

TEST(PlacesPlan, DoesNotDependOnThreads) {
  PlanRequest wanted = request(testing::bundled_robot(), published_targets(3));
  wanted.count = 30;
  const PlacesPlan one = plan_at_places(wanted, {.stations = 4, .directions = "z"});
  wanted.threads = 1;
  const PlacesPlan other = plan_at_places(wanted, {.stations = 4, .directions = "z"});
  EXPECT_EQ(one.sheet.joint_values, other.sheet.joint_values);
  EXPECT_EQ(one.planned.sigma.mean, other.planned.sigma.mean);
}

TEST(PlacesPlan, FileIsReadOnceItIsFilledIn) {
  const Robot& robot = testing::bundled_robot();
  const std::vector<TargetFrame> ball = testing::targets_at({{0.05, 0.2, 0.1}});
  const PlacesPlan touches = plan_at_places(request(robot, ball), {.stations = 4, .sockets = kSockets});
  const Measurements read = parse_measurements(robot, plan_csv(touches.sheet, robot.joints));
  EXPECT_THAT(read.stations, ElementsAre("P1", "P2", "P3", "P4"));
  ASSERT_EQ(read.observations.size(), 40U);
  EXPECT_EQ(read.observations[7].position(), touches.sheet.points.col(7));
  const PlacesPlan lengths = plan_at_places(request(robot, ball), {.stations = 2, .directions = "r"});
  std::string csv = plan_csv(lengths.sheet, robot.joints);
  EXPECT_THAT(refusal([&] { return parse_measurements(robot, csv); }), HasSubstr("distance"));
  for (std::size_t end = csv.find(",\n"); end != std::string::npos; end = csv.find(",\n")) {
    csv.insert(end + 1, "1.5");
  }
  std::vector<double> distances;
  for (const Observation& row : parse_measurements(robot, csv).observations) {
    distances.push_back(testing::length_of(row));
  }
  EXPECT_THAT(distances, Each(1.5));
}

TEST(PlacesPlan, SaysWhyThereIsNone) {
  PlanRequest wanted = request(testing::bundled_robot(), testing::targets_at({{0.05, 0.2, 0.1}}));
  EXPECT_THAT(refusal([&] { return plan_at_places(wanted, {.stations = 2, .sockets = {Vector3d::Zero()}}); }),
              HasSubstr("determine 20 of 21 parameters of the arm; not told apart: "));
  EXPECT_THAT(refusal([&] { return plan_at_places(wanted, {.stations = 41, .sockets = kSockets}); }),
              HasSubstr("configurations to choose"));
  wanted.cell.box = {.lower = Vector3d::Constant(-0.01), .upper = Vector3d::Constant(0.01)};
  EXPECT_THAT(refusal([&] { return plan_at_places(wanted, {.stations = 2, .sockets = kSockets}); }),
              HasSubstr("no place of the plate was found where the arm reaches every socket as it may"));
}

}  // namespace
}  // namespace kdl_calibration::places_test
