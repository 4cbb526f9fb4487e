#include "estimation/input_check.hpp"

#include <gmock/gmock.h>

#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "calibration/calibration_settings.hpp"
#include "every_header.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "mistakes_support.hpp"
#include "refusal.hpp"

namespace kdl_calibration::input_check_test {
namespace {

using testing::Measured;
using ::testing::Ne;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

const Measured& sound() {
  static const Measured instance = testing::measured(complete_model(testing::fanuc()), 1);
  return instance;
}

Estimate rigid_truth() {
  Estimate estimate = sound().truth;
  estimate.effects.resize(0);
  return estimate;
}

using Spoil = std::function<void(Measurements&)>;

Reading along(const Eigen::Vector3d& normal, std::int8_t count) {
  return Coordinates{.position = Eigen::Vector3d::Zero(), .normal = normal, .count = count};
}
Reading distance_of(double length) { return Distance{.length = length, .anchor = Eigen::Vector3d::Zero()}; }
Reading pose_of(const Orientation& orientation) { return Pose{Eigen::Vector3d::Zero(), orientation}; }
Spoil has(const Reading& reading) {
  return [reading](Measurements& m) { m.observations[3].reading = reading; };
}

/// Measurements that no reader makes, and the rule that the message names.
std::vector<std::pair<Spoil, std::string>> spoilt() {
  return {
      {[](Measurements& m) { m.observations[3].configuration = 30; }, "configuration 30 is not there"},
      {[](Measurements& m) { m.observations[3].configuration = -1; }, "configuration -1 is not there"},
      {[](Measurements& m) { m.observations[3].target = 3; }, "target 3 is not there"},
      {[](Measurements& m) { m.observations[3].target = -1; }, "target -1 is not there"},
      {[](Measurements& m) { m.observations[3].position().y() = kNaN; }, "coordinate is not finite"},
      {[](Measurements& m) { m.observations[3].sigma = -1.0; }, "sigma is negative"},
      {[](Measurements& m) { m.observations[3].sigma = kNaN; }, "sigma is negative or not finite"},
      {[](Measurements& m) { m.observations[3].position().y() = -1.1e12; }, "beyond 1e12"},
      {[](Measurements& m) { m.joint_values(2, 4) = kNaN; }, "joint value is not finite"},
      {[](Measurements& m) { m.joint_values(2, 4) = -1.1e12; }, "joint value is not finite or beyond 1e12"},
      {[](Measurements& m) {
         for (int i = 0; i < 100; ++i) {
           m.targets.push_back("T" + std::to_string(i));
         }
       },
       "103 targets, expected at most 100"},
      {[](Measurements& m) {
         for (int i = 0; i < 100; ++i) {
           m.stations.push_back("S" + std::to_string(i));
         }
       },
       "101 stations, expected at most 100"},
      {[](Measurements& m) { m.joint_values.conservativeResize(6, 29); }, "30 configurations, expected 29"},
      {[](Measurements& m) { m.observations[3].order = 1; },
       "observation 3: some rows have a place in the order and others have none"},
      {[](Measurements& m) { testing::set_orientations(m, Orientation(2.0, 0.0, 0.0, 0.0)); }, "no unit quaternion"},
      {has(pose_of(Orientation(kNaN, kNaN, kNaN, kNaN))), "observation 3: the orientation is no unit quaternion"},
      {has(along({0.6, 0.0, 0.9}, 1)),
       "observation 3: its directions are none, expected 1 or 2 coordinates and a unit vector"},
      {has(along({kNaN, 0.0, 1.0}, 1)), "its directions are none"},
      {has(along({0.6, 0.0, 0.8}, 0)), "its directions are none"},
      {has(along({0.6, 0.0, 0.8}, 3)), "its directions are none"},
      {has(distance_of(0.0)), "observation 3: a distance of 0, expected one above 0"},
      {has(distance_of(-1.0)), "a distance of -1"},
      {has(distance_of(1.1e12)), "a distance of 1100000000000, expected one above 0 up to 1e12"},
      {has(distance_of(kNaN)), "a distance of nan"},
      {has(distance_of(1.0)), "rows of several anchors"},
      {[](Measurements& m) { m.joint_units.resize(2); }, "2 units of joints"}};
}

TEST(InputCheck, AcceptsWhatTheReaderMakes) {
  EXPECT_NO_THROW(check(sound().data, sound().model));
  EXPECT_NO_THROW(check(rigid_truth(), sound().model, sound().data));
  EXPECT_NO_THROW(check(sound().free, sound().model, sound().data.targets.size()));
  EXPECT_NO_THROW(check(ResidualOptions{}, sound().data));
  EXPECT_NO_THROW(check(RegistrationOptions{}));
}

TEST(InputCheck, NamesWhatDoesNotHoldTogether) {
  for (const auto& [spoil, words] : spoilt()) {
    Measurements wrong = sound().data;
    spoil(wrong);
    EXPECT_REFUSED(words, check(wrong));
  }
}

using TakesMeasurements = std::pair<std::string, std::function<void(const Measurements&)>>;

/// A call of measurements named d, which stand in it.
#define TAKES(...) TakesMeasurements(#__VA_ARGS__, [&](const Measurements& d) { static_cast<void>(__VA_ARGS__); })

void expect_all_refuse(const std::vector<TakesMeasurements>& functions) {
  for (const TakesMeasurements& function : functions) {
    for (const auto& [spoil, words] : spoilt()) {
      Measurements wrong = sound().data;
      spoil(wrong);
      EXPECT_REFUSED_WITH(Ne("nothing was refused"), function.second(wrong)) << function.first << ": " << words;
    }
  }
}

TEST(InputCheck, FunctionsOfMeasurementsAloneRefuseThoseThatDoNotHoldTogether) {
  const Measured& m = sound();
  const std::vector<Eigen::Isometry3d> X_BF(m.data.configurations.size(), Eigen::Isometry3d::Identity());
  expect_all_refuse({
      TAKES(register_base_and_targets(X_BF, d)),
      TAKES(make_folds(d, 3)),
      TAKES(averaged(d)),
      TAKES(trained_ranges(d)),
      TAKES(training_sample(d, 5)),
      TAKES(joined(m.data, d)),
      TAKES(joined(d, m.data)),
      {"subset", [&](const Measurements& d) { subset(d, [](const Observation&) { return true; }); }},
      TAKES(measurements_csv(d)),
  });
}

TEST(InputCheck, FunctionsOfAModelRefuseMeasurementsThatDoNotHoldTogether) {
  const Measured& m = sound();
  const Estimate estimate = rigid_truth();
  const Experiment experiment = nominal_experiment(m.model, m.truth.frames.targets);
  expect_all_refuse({
      TAKES(calibrate(m.model, d)),
      TAKES(nominal_start(m.model, d)),
      TAKES(registered(m.model, estimate.errors, d)),
      TAKES(information(experiment, d)),
  });
}

TEST(InputCheck, RefusesModelsWhosePartsAreNotThere) {
  ErrorModel beyond = sound().model;
  beyond.parameters[0].frame = 6;
  EXPECT_REFUSED("the frame of a parameter 6 is not there", calibrate(beyond, sound().data));
  ErrorModel elastic = sound().model;
  elastic.effects = load_terms(elastic);
  elastic.effects[0].index = -1;
  EXPECT_REFUSED("the joint of an effect -1 is not there", check(elastic));
  elastic.effects[0].index = 1;
  elastic.effects[0].scale = 0.0;
  EXPECT_REFUSED("an effect has a value that is not finite", check(elastic));
}

TEST(InputCheck, RefusesDataOfAnotherRobot) {
  Measurements other = sound().data;
  other.joints[2] = "elbow";
  EXPECT_REFUSED("another robot", check(other, sound().model));
  Measurements shorter = sound().data;
  shorter.joints.resize(5);
  shorter.joint_units.clear();
  shorter.joint_values.conservativeResize(5, Eigen::NoChange);
  EXPECT_REFUSED("5 joints, expected the robot's 6", calibrate(sound().model, shorter));
}

TEST(InputCheck, RefusesEstimatesAndParametersThatDoNotFit) {
  const Measured& m = sound();
  Estimate few = rigid_truth();
  few.errors.conservativeResize(3);
  EXPECT_REFUSED("3 errors of an estimate", identify_jointly(m.model, m.data, few, m.free));
  Estimate one = rigid_truth();
  one.frames.targets.resize(1);
  EXPECT_REFUSED("1 targets of an estimate", position_errors(m.model, one, m.data));
  Estimate nan = rigid_truth();
  nan.errors[0] = kNaN;
  EXPECT_REFUSED("not finite", iso_9283(m.model, nan, m.data));
  ErrorModel longer = m.model;
  longer.parameters.push_back(longer.parameters.back());
  longer.parameters.back().name += " again";
  const Unknowns beyond = m.free.with(longer, UnknownGroup::geometric, {m.model.parameters.size()});
  const std::size_t targets = m.data.targets.size();
  EXPECT_REFUSED("the free geometric parameter", check(beyond, m.model, targets));
  ErrorModel elastic = m.model;
  elastic.effects = load_terms(m.model);
  const Unknowns with_effect = m.free.with(elastic, UnknownGroup::effects, {0});
  EXPECT_REFUSED("the free effect 0 is not there", check(with_effect, m.model, targets));
  EXPECT_REFUSED("2 errors", origin_corrections(m.model, Eigen::VectorXd::Zero(2)));
}

TEST(InputCheck, RefusesSigmasAndPriorsThatAreNegativeOrNotFinite) {
  for (const double value : {-1.0, kNaN, std::numeric_limits<double>::infinity()}) {
    const std::vector<std::function<void(CalibrationSettings&)>> changes = {
        [&](CalibrationSettings& o) { o.selection.priors.length = value; },
        [&](CalibrationSettings& o) { o.selection.priors.angle = value; },
        [&](CalibrationSettings& o) { o.noise.stated.independent.y() = value; },
        [&](CalibrationSettings& o) { o.noise.stated.common.z() = value; },
        [&](CalibrationSettings& o) { o.noise.stated.orientation = value; },
        [&](CalibrationSettings& o) { o.noise.stated.misfit = value; },
        [&](CalibrationSettings& o) { o.noise.stated.target_misfit = value; },
        [&](CalibrationSettings& o) { o.noise.stated.tracker = TrackerNoise{.range = value}; }};
    for (std::size_t i = 0; i < changes.size(); ++i) {
      CalibrationSettings options;
      changes[i](options);
      EXPECT_REFUSED("0 or more", calibrate(sound().model, sound().data, options)) << i;
    }
  }
  const ResidualOptions weights{.row_weights = {1.0, 1.0}};
  EXPECT_REFUSED("2 weights of rows", check(weights, sound().data));
}

}  // namespace
}  // namespace kdl_calibration::input_check_test
