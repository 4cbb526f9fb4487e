// Measurements from several stations: a tracker that is moved, and a plate with sockets that is put at several places.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "geometry_alone.hpp"
#include "interface/calibration_parts.hpp"
#include "interface/ways_to_measure.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/result_file.hpp"
#include "kdl_calibration/validation.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::stations_interface_test {
namespace {

using testing::Ball;
using testing::bundled_robot;
using ::testing::Contains;
using testing::distance_from_truth;
using ::testing::Field;
using testing::geometry_alone;
using ::testing::HasSubstr;
using testing::Lengths;
using testing::points;
using testing::refusal;
using testing::Tracker;

TEST(StationsOfATracker, AreExactWithoutNoise) {
  Tracker experiment;
  const Measurements measurements = experiment.measured(30);
  const Calibration found = calibrate(bundled_robot(), measurements, geometry_alone());
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), 27U + 3U * 6U);
  const Eigen::MatrixXd q = experiment.configurations(50);
  const VirtualRobot& robot = experiment.robot;
  EXPECT_LT(distance_from_truth(found, experiment), 1e-9);
  // Points in the frame of a station have no gauge.
  const CalibratedArm arm = found.arm();
  EXPECT_THAT(arm.stations(), ::testing::ElementsAre("S1", "S2", "S3"));
  for (std::size_t s = 0; s < 3; ++s) {
    const PredictedPoint point = arm.predict(q.col(0), "A", PredictionFrame::measuring, arm.stations()[s]);
    EXPECT_LT((point.position - robot.truth.frames.base(s) * points(robot.model, robot.truth, q).col(0)).norm(), 1e-9);
    EXPECT_LT((arm.base(arm.stations()[s]) * arm.predict(q.col(0), "A").position - point.position).norm(), 1e-12);
  }
}

// Two sockets leave the rotation of the plate about their line undetermined: five directions of each place. The ball is
// one target. One socket leaves all three rotations.
TEST(PlacesOfAPlate, AreExactWithoutNoiseAndDetermineFiveDirectionsEach) {
  for (const int places : {4, 6, 9}) {
    Ball experiment(static_cast<std::uint64_t>(places));
    const Measurements measurements = experiment.touched(places, 72);
    const Calibration found = calibrate(bundled_robot(), measurements, geometry_alone());
    EXPECT_TRUE(found.trusted()) << places;
    EXPECT_TRUE(found.doubts().empty());
    const auto arm = static_cast<int>(experiment.reduction.kept.size()) - 6;
    EXPECT_EQ(found.estimated().size(), static_cast<std::size_t>(arm + 5 * places));
    EXPECT_LT(distance_from_truth(found, experiment), 1e-9) << places;
    EXPECT_TRUE(found.arm().predict(experiment.configurations(1).col(0), "A").covariance.allFinite());
  }
}

// The residuals alone would let the predicted points show these rotations.
TEST(PlacesOfAPlate, WithNoiseDetermineNoMore) {
  Ball experiment(8);
  const Calibration found = calibrate(bundled_robot(), experiment.touched(4, 40, 3e-5), geometry_alone());
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() - 6 + 5 * 4);
  EXPECT_LT(distance_from_truth(found, experiment), 6e-4);
}

// The other coordinates of a socket on the line say nothing of the rotation about it either.
TEST(PlacesOfAPlate, WithAnEmptyCellDetermineNoMore) {
  Ball experiment(9);
  Measurements touches = experiment.touched(4, 60, 3e-5);
  testing::lose_coordinate(*std::find_if(touches.observations.begin(), touches.observations.end(),
                                         [](const Observation& o) { return o.position().x() > 0.1; }),
                           0);
  const Calibration found = calibrate(bundled_robot(), touches, geometry_alone());
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() - 6 + 5 * 4);
}

// A poor choice of the rotation to hold would let a base wander, and errors take its place that nothing moves back.
TEST(PlacesOfAPlate, WithSocketsOnALineHoldTheRotationAboutIt) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    Ball experiment(seed);
    const Measurements touches = experiment.touched(4, 40, 3e-5, {{0.0, 0.0, 0.0}, {0.1, 0.1, 0.1}, {0.3, 0.3, 0.3}});
    const Calibration found = calibrate(bundled_robot(), touches, geometry_alone());
    const std::vector<std::string> estimated = found.estimated();
    EXPECT_EQ(estimated.size(), experiment.reduction.kept.size() - 6 + 5 * 4) << seed;
    for (const ParameterEstimate& parameter : found.parameters()) {
      if (!parameter.joint.empty() &&
          std::find(estimated.begin(), estimated.end(), parameter.name) == estimated.end()) {
        EXPECT_EQ(parameter.error, 0.0) << seed << ' ' << parameter.name;
      }
    }
  }
}

TEST(LengthsBetweenTwoTargets, InTwoConfigurationsEachAreExactWithoutNoise) {
  Lengths experiment(11);
  const Measurements lengths = experiment.measured(120);
  ASSERT_EQ(lengths.stations.size(), 60U);
  CalibrationOptions options = geometry_alone();
  options.validation.held_out = true;
  const Calibration found = calibrate(bundled_robot(), lengths, options);
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() - 6 + 5 * 60);
  EXPECT_LT(distance_from_truth(found, experiment), 1e-9);
  // One end of a length says nothing of where the other is.
  EXPECT_FALSE(found.accuracy().leave_one_out);
  EXPECT_THAT(found.warnings(), Contains(HasSubstr("nothing is known of unseen configurations")));
}

TEST(LengthsBetweenTwoTargets, AreCalibratedByDefaultOptions) {
  Lengths experiment(12);
  const Calibration found = calibrate(bundled_robot(), experiment.measured(120, 3e-5));
  EXPECT_TRUE(found.trusted());
  EXPECT_LT(distance_from_truth(found, experiment), 4e-4);
}

// Nineteen lengths are fewer than the parameters of the arm.
TEST(LengthsBetweenTwoTargets, AreRefusedWhereTheyAreTooFew) {
  Lengths experiment(11);
  const Measurements lengths = experiment.measured(38);
  EXPECT_THAT(refusal([&] { return calibrate(bundled_robot(), lengths, geometry_alone()); }),
              HasSubstr("too few measurements: 114 measured coordinates for"));
}

// The last station has one configuration, each other one ten.
TEST(Stations, OfOneConfigurationAreNotLeftOut) {
  for (const int stations : {2, 3}) {
    Tracker experiment(7, stations);
    const int last = 10 * stations - 1;
    const Measurements few = subset(experiment.measured(10 * stations, 3e-5), [&](const Observation& o) {
      return o.station < stations - 1 || o.configuration == last;
    });
    CalibrationOptions options = geometry_alone();
    options.validation.held_out = true;
    const Calibration found = calibrate(bundled_robot(), few, options);
    EXPECT_EQ(found.accuracy().leave_one_out->after.count, static_cast<std::size_t>(3 * (last - 9)));
    EXPECT_THAT(found.warnings(), Contains(HasSubstr("has configuration " + std::to_string(last + 1) + " alone")));
  }
}

// Eleven points are 33 coordinates, as many as the unknowns.
TEST(Stations, WithoutASurplusOfCoordinatesAreDoubted) {
  testing::VirtualExperiment experiment({.targets = testing::targets_at({{0.05, 0.2, 0.1}}), .random = Random(3)});
  experiment.robot = robot_at_stations(experiment.robot, 2, experiment.random);
  const Calibration found =
      calibrate(bundled_robot(), testing::without_sigmas(experiment.measure(11, {.sigma = 3e-5})), geometry_alone());
  EXPECT_THAT(found.doubts(), Contains(Field(&Doubt::message, HasSubstr("as many unknowns as measured"))));
}

TEST(Stations, CopiedTestRowsAreNamed) {
  Measurements rows = Tracker(7).measured(30, 3e-5);
  Measurements copies = subset(rows, [](const Observation& o) { return o.configuration < 3; });
  copies.configurations = {"T1", "T2", "T3"};
  copies.stations = rows.stations;
  for (Observation& observation : copies.observations) {
    observation.split = Split::test;
  }
  CalibrationOptions options = geometry_alone();
  options.diagnosis.try_readings = true;
  const Calibration found = calibrate(bundled_robot(), joined(rows, copies), options);
  EXPECT_THAT(found.warnings(), Contains(HasSubstr("has the very points of train configuration")));
}

TEST(Stations, OfTestRowsAloneAreRefused) {
  Tracker experiment(8);
  Measurements measurements = experiment.measured(30, 3e-5);
  for (Observation& observation : measurements.observations) {
    observation.split = observation.station == 2 ? Split::test : Split::train;
  }
  EXPECT_THAT(refusal([&] { return calibrate(bundled_robot(), measurements, geometry_alone()); }),
              HasSubstr("station 'S3' has test rows alone"));
}

// The frame of the plate turns about its line as it likes, and nothing in the base frame depends on it.
TEST(PlacesOfAPlate, OneAloneDeterminesFiveDirections) {
  Ball experiment(12);
  Measurements touches = experiment.touched(1, 80, 3e-5);
  const Calibration found = calibrate(bundled_robot(), touches, geometry_alone());
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() - 1);
  EXPECT_LT(distance_from_truth(found, experiment), 1e-3);
  EXPECT_LT(distance_from_truth(calibrate(bundled_robot(), touches), experiment), 1e-3) << "with every check";
  touches.stations = {"W"};
  const Calibration unnamed = calibrate(bundled_robot(), touches, geometry_alone());
  EXPECT_TRUE(unnamed.trusted());
  EXPECT_LT(distance_from_truth(unnamed, experiment), 1e-3);
}

TEST(PlacesOfAPlate, OneAloneShowsAJointThatTurnsFartherThanItSays) {
  Measurements touches = Ball(13).touched(1, 60, 3e-5);
  touches.joint_values.row(5) *= 1.012;
  EXPECT_THAT(calibrate(bundled_robot(), touches).doubts(), Contains(Field(&Doubt::cause, Cause::joint_gain)));
}

TEST(PlacesOfAPlate, WithOneSocketAloneShowNoLength) {
  Ball experiment(6);
  const Calibration found =
      calibrate(bundled_robot(), experiment.touched(4, 60, 1e-5, {{0.0, 0.0, 0.0}}), geometry_alone());
  EXPECT_FALSE(found.trusted());
  EXPECT_THAT(found.doubts(), Contains(Field(&Doubt::message, HasSubstr("measure a second socket"))));
}

TEST(PlacesOfAPlate, WithOneSocketHoldThreeRotationsBesideATracker) {
  Ball experiment(5);
  Measurements tracker = testing::without_sigmas(experiment.measure(30));  // from one place
  Measurements beside = experiment.touched(2, 20, 0.0, {{0.0, 0.0, 0.0}});
  beside.stations = {"tracker", "P1", "P2"};
  for (Observation& observation : beside.observations) {
    ++observation.station;
  }
  tracker.stations = beside.stations;
  const Measurements both = joined(tracker, beside);
  const Calibration found = calibrate(bundled_robot(), both, geometry_alone());
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() + 2U * 3U);
  EXPECT_LT(distance_from_truth(found, experiment), 1e-9);
}

TEST(Stations, AKnownBaseMakesTheFirstOffsetDetermined) {
  Tracker experiment(3);
  experiment.robot.truth.errors[static_cast<Eigen::Index>(parameter_index(experiment.model, "dq1"))] = 2e-3;
  const Measurements measurements = experiment.measured(30);
  CalibrationOptions options = geometry_alone();
  options.parameters.known.bases = {{"S2", experiment.robot.truth.frames.base(1)}};
  const Calibration found = calibrate(bundled_robot(), measurements, options);
  EXPECT_NEAR(found.error("dq1"), 2e-3, 1e-9);
  EXPECT_EQ(found.std("base[S2].Tx"), 0.0);
  EXPECT_GT(found.std("base[S1].Tx"), 0.0);
  options.parameters.known.bases = {{"S4", experiment.robot.truth.frames.base(1)}};
  EXPECT_THAT(refusal([&] { return calibrate(bundled_robot(), measurements, options); }), HasSubstr("station 'S4'"));
  options.parameters.known.bases = {{.X_WB = experiment.robot.truth.frames.base()}};
  EXPECT_THAT(refusal([&] { return calibrate(bundled_robot(), measurements, options); }),
              HasSubstr("a known base without its station"));
  options.parameters.known.bases.assign(2, {"S2", experiment.robot.truth.frames.base(1)});
  EXPECT_THAT(refusal([&] { return calibrate(bundled_robot(), measurements, options); }),
              HasSubstr("two known bases of station 'S2', expected one for each"));
}

TEST(Stations, ASavedResultPredictsTheSame) {
  Tracker experiment(2);
  const Measurements measurements = experiment.measured(30, 3e-5);
  const Calibration found = calibrate(bundled_robot(), measurements, geometry_alone());
  const std::filesystem::path file = std::filesystem::temp_directory_path() / "kdl_calibration_stations_test.json";
  write_result(file, bundled_robot(), measurements, found);
  const Calibration again = load_calibration(file, bundled_robot());
  std::filesystem::remove(file);
  EXPECT_EQ(again.estimated(), found.estimated());
  const Eigen::VectorXd q = experiment.configurations(1).col(0);
  for (const PredictionFrame frame : {PredictionFrame::base, PredictionFrame::measuring}) {
    const PredictedPoint one = found.arm().predict(q, "B", frame, "S3");
    const PredictedPoint other = again.arm().predict(q, "B", frame, "S3");
    EXPECT_LT((one.position - other.position).norm(), 1e-12);
    EXPECT_NEAR(one.radius_95, other.radius_95, 1e-12);
    EXPECT_TRUE(one.covariance.isApprox(other.covariance, 1e-6));
  }
  EXPECT_THAT(refusal([&] { return found.arm().predict(q, "B", PredictionFrame::measuring); }),
              HasSubstr("the measuring frame without its station, expected one of S1, S2, S3"));
  EXPECT_THAT(refusal([&] { return found.arm().base("S4"); }), HasSubstr("station 'S4' was not measured"));
  const PositionErrors errors = validate(again, experiment.measured(10, 3e-5));
  EXPECT_LT(errors.all.rms, 2e-4);
  ASSERT_EQ(errors.frames.bases.size(), 3U);
  EXPECT_LT((errors.frames.base(1).translation() - experiment.robot.truth.frames.base(1).translation()).norm(), 1e-3);
}

TEST(Stations, AutomaticChoicesAndFoldsWorkWithSeveral) {
  Tracker experiment(6);
  const Calibration found = calibrate(bundled_robot(), experiment.measured(36, 3e-5));
  EXPECT_TRUE(found.trusted());
  EXPECT_THAT(found.parts().fitted->selection.not_tried,
              Contains(::testing::FieldsAre("other readings of the joints", "several stations")));
  ASSERT_TRUE(found.accuracy().leave_one_out);
  const double before = found.accuracy().leave_one_out->before.rms;
  const double after = found.accuracy().leave_one_out->after.rms;
  EXPECT_GT(before, 1e-3);
  EXPECT_LT(after, 1.2e-4);
  CalibrationOptions folds = geometry_alone();
  folds.validation = {.k_fold = 4};
  EXPECT_LT(calibrate(bundled_robot(), experiment.measured(36, 3e-5), folds).accuracy().k_fold->after.rms, 1.5e-4);
}

// No fit to the others predicts the only configuration of a station, whose name may be mistyped. All others count.
TEST(Stations, OfOneConfigurationLeaveTheAutomaticChoices) {
  Tracker experiment(8);
  add_effects(experiment.robot, {EffectGroup::gravity}, {.joint_values = experiment.configurations(60)}, 1e-3,
              experiment.random);
  Measurements measurements = experiment.measured(60, 3e-5);
  measurements.stations.emplace_back("S4");
  for (Observation& observation : measurements.observations) {
    observation.station = observation.configuration == 20 ? 3 : observation.station;
  }
  const Calibration found = calibrate(bundled_robot(), measurements);
  EXPECT_TRUE(found.trusted()) << found.doubts().front().message;
  EXPECT_LT(found.accuracy().leave_one_out->after.rms, 1e-4);
  EXPECT_THAT(found.warnings(), ::testing::Not(Contains(HasSubstr("neighbours"))));
}

// The fit absorbs a wrong distance of the sockets in the lengths of the links.
TEST(PlacesOfAPlate, WithSocketsAPerCentOffAreDoubted) {
  Ball experiment(4);
  Measurements measurements = experiment.touched(4, 40, 3e-5);
  EXPECT_TRUE(calibrate(bundled_robot(), measurements).trusted());
  for (Observation& observation : measurements.observations) {
    observation.position() *= 1.01;
  }
  const Calibration found = calibrate(bundled_robot(), measurements);
  EXPECT_LT(found.accuracy().leave_one_out->after.rms, 2e-4);
  EXPECT_THAT(found.doubts(), Contains(Field(&Doubt::cause, Cause::scale)));
}

TEST(Stations, TwoStepIsRefused) {
  Tracker experiment(1);
  CalibrationOptions options;
  options.estimator.method = Method::two_step;
  EXPECT_THAT(refusal([&] { return calibrate(bundled_robot(), experiment.measured(12), options); }),
              HasSubstr("has several stations"));
}

}  // namespace
}  // namespace kdl_calibration::stations_interface_test
