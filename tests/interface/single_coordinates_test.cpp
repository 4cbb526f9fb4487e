// Measurements of single coordinates: heights above planes, touches of planes, coordinates along lines; and of
// distances.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "geometry_alone.hpp"
#include "interface/calibration_parts.hpp"
#include "interface/ways_to_measure.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/result_file.hpp"
#include "kdl_calibration/validation.hpp"
#include "measurements/readings.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::single_coordinates_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using testing::along;
using testing::bundled_robot;
using ::testing::Contains;
using testing::distance_from_truth;
using testing::Distances;
using ::testing::EndsWith;
using ::testing::Field;
using testing::geometry_alone;
using ::testing::HasSubstr;
using testing::Heights;
using testing::kHeight;
using testing::kNoise;
using testing::refusal;

/// A doubt of this configuration alone, with all its targets.
::testing::Matcher<const Doubt&> is_gross_row(const std::string& configuration) {
  return ::testing::AllOf(
      Field(&Doubt::cause, Cause::gross_rows),
      Field(&Doubt::subjects, ::testing::ElementsAre(Subject{SubjectKind::configuration, configuration})));
}

// Each point as three rows, along the axes of a frame of its own.
Measurements in_three_rows(const Measurements& points, Random& random) {
  Measurements result = points;
  result.observations.clear();
  for (const Observation& observation : points.observations) {
    Matrix3d R = Matrix3d::Identity();
    if (observation.target > 0) {
      R = Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal())
              .normalized()
              .toRotationMatrix();
    }
    for (const auto& n : R.colwise()) {
      result.observations.push_back(observation);
      testing::keep_coordinate_along(result.observations.back(), n);
    }
  }
  return result;
}

// ---- Without noise -------------------------------------------------------------------------------------------------

TEST(SingleCoordinates, ThreeRowsOfAPointAreThePoint) {
  testing::VirtualExperiment experiment;
  const Measurements whole = testing::without_sigmas(experiment.measure(20, {.sigma = 3e-5}));
  const Measurements rows = in_three_rows(whole, experiment.random);
  const Calibration one = calibrate(bundled_robot(), whole, geometry_alone());
  const Calibration other = calibrate(bundled_robot(), rows, geometry_alone());
  ASSERT_EQ(one.estimated().size(), other.estimated().size());
  EXPECT_EQ(one.verdict(), other.verdict());
  const Estimate& a = one.parts().estimate;
  const Estimate& b = other.parts().estimate;
  EXPECT_LT((a.errors - b.errors).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_LT((a.frames.base().matrix() - b.frames.base().matrix()).cwiseAbs().maxCoeff(), 1e-9);
  for (std::size_t i = 0; i < one.parameters().size(); ++i) {
    const double ratio = other.parameters()[i].std / one.parameters()[i].std;  // NaN for gauges
    EXPECT_FALSE(std::abs(ratio - 1.0) > 1e-5) << one.parameters()[i].name << ratio;
    EXPECT_EQ(one.parameters()[i].degrees_of_freedom, other.parameters()[i].degrees_of_freedom);
  }
}

// A height z = n p + d above a plane has three numbers of the plane in the base frame: two of its normal n, and d. So
// each of the four stations determines three of its six, and the arm is determined as by whole points.
TEST(SingleCoordinates, HeightsAboveFourPlanesAreExactWithoutNoise) {
  for (const std::uint64_t seed : {1U, 2U}) {
    Heights experiment(seed);
    const Calibration found = calibrate(bundled_robot(), experiment.measured(80), geometry_alone());
    EXPECT_TRUE(found.trusted()) << seed;
    EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() - 6U + 4U * 3U);
    EXPECT_LT(distance_from_truth(found, experiment), 1e-9) << seed;
    EXPECT_TRUE(found.arm().predict(experiment.configurations(1).col(0), "A").covariance.allFinite());
    EXPECT_THAT(found.warnings(), Contains(HasSubstr("held as registered: base[S1]")));
    EXPECT_THAT(found.warnings(), Contains(HasSubstr("lengths along the measured directions")));
  }
}

// On a plane n p + d = 0 for all touches. This equation is homogeneous: an arm that is larger by a factor, with the
// plane as much farther, fits as well. So planes that are touched leave one direction of arm and planes undetermined,
// the scale, and a length that is known determines it.
TEST(SingleCoordinates, TouchesOfFourPlanesLeaveTheScale) {
  testing::Touches experiment(4);
  experiment.robot.truth.errors[static_cast<Eigen::Index>(parameter_index(experiment.model, "Tz2"))] = 0.0;
  const Measurements measurements = experiment.touched(4, 80);
  const std::size_t all = experiment.reduction.kept.size() - 6U + 4U * 3U;
  const Calibration open = calibrate(bundled_robot(), measurements, geometry_alone());
  EXPECT_EQ(open.estimated().size(), all - 1U);
  EXPECT_EQ(open.verdict(), Verdict::not_trusted);
  CalibrationOptions options = geometry_alone();
  options.parameters.fix = {"Tz2"};
  const Calibration found = calibrate(bundled_robot(), measurements, options);
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), all - 1U);
  EXPECT_LT(distance_from_truth(found, experiment), 1e-9);
}

TEST(SingleCoordinates, HelpFewWholePoints) {
  Heights experiment(5);
  Measurements mixed = experiment.measured(60);
  const Measurements whole = testing::without_sigmas(experiment.measure(mixed.joint_values));
  for (std::size_t row = 0; row < mixed.observations.size(); ++row) {
    if (mixed.observations[row].configuration < 4) {
      mixed.observations[row] = whole.observations[row];
    }
  }
  const Calibration found = calibrate(bundled_robot(), mixed, geometry_alone());
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() + 3U * 3U);
  EXPECT_LT(distance_from_truth(found, experiment), 1e-9);
}

// Distances |X_WB p - a| from an anchor at an unknown place do not change if the arm turns about the anchor. So each of
// these determines three numbers, its place in the base frame, and one anchor is enough for the arm.
TEST(DistancesFromAnchors, FromUnknownAnchorsAreExactWithoutNoise) {
  for (const int anchors : {1, 2, 3}) {
    for (const std::uint64_t seed : {1U, 2U}) {
      Distances experiment(seed);
      const Calibration found = calibrate(bundled_robot(), experiment.measured(anchors, false, 80), geometry_alone());
      EXPECT_TRUE(found.trusted()) << anchors << seed;
      EXPECT_EQ(static_cast<int>(found.estimated().size()),
                static_cast<int>(experiment.reduction.kept.size()) - 6 + 3 * anchors);
      EXPECT_LT(distance_from_truth(found, experiment), 1e-9) << anchors << seed;
    }
  }
}

TEST(DistancesFromAnchors, FromKnownAnchorsAreExactWithTheBase) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    Distances experiment(seed);
    const Calibration found = calibrate(bundled_robot(), experiment.measured(3, true, 80), geometry_alone());
    EXPECT_TRUE(found.trusted()) << seed;
    EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size());
    const Estimate& estimate = found.parts().estimate;
    EXPECT_LT((estimate.frames.base().matrix() - experiment.robot.truth.frames.base().matrix()).cwiseAbs().maxCoeff(),
              1e-9)
        << seed;
    EXPECT_LT(distance_from_truth(found, experiment), 1e-9) << seed;
  }
}

TEST(DistancesFromAnchors, HelpFewWholePoints) {
  Distances experiment(6);
  const Calibration found = calibrate(bundled_robot(), experiment.beside_points(6, 80), geometry_alone());
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() + 3U);
  EXPECT_LT(distance_from_truth(found, experiment), 1e-9);
}

// The distance from a point on the axis of joint 1 does not depend on joint 1, and hardly on other errors.
TEST(DistancesFromAnchors, UnderTheRobotAreNotTrusted) {
  Distances experiment(8);
  Measurements measurements = testing::without_sigmas(experiment.measure(80, {.sigma = kNoise}));
  measurements.stations = {"A1"};
  for (Observation& observation : measurements.observations) {
    testing::keep_distance(observation, Vector3d::Zero());
  }
  const Calibration found = calibrate(bundled_robot(), measurements);
  EXPECT_EQ(found.verdict(), Verdict::not_trusted);
  EXPECT_LT(found.accuracy().leave_one_out->after.rms, 2.0 * kNoise);
}

TEST(DistancesFromAnchors, TwoPerCentTooLongAreDoubted) {
  Distances experiment(4);
  Measurements measurements = experiment.measured(3, false, 60, kNoise);
  for (Observation& observation : measurements.observations) {
    std::get<Distance>(observation.reading).length *= 1.02;
  }
  const Calibration found = calibrate(bundled_robot(), measurements);
  EXPECT_LT(found.accuracy().leave_one_out->after.rms, 2e-4);
  EXPECT_THAT(found.doubts(), Contains(Field(&Doubt::cause, Cause::scale)));
}

// What shows a unit needs neither priors nor effects nor left-out rows. The long runs choose all of these as well.
CalibrationOptions readings_alone() {
  CalibrationOptions options = geometry_alone();
  options.diagnosis.try_readings = true;
  return options;
}

// The anchors keep their stated places. The zero of the instrument takes the mean error, which is up to 40 mm.
TEST(DistancesFromAnchors, FromStatedAnchorsAreDoubtedByTheirScale) {
  for (const double factor : {1.0, 1.005, 0.995, 1.02, 0.98}) {
    Distances experiment(4);
    Measurements measurements = experiment.measured(3, true, 60, kNoise);
    for (Observation& observation : measurements.observations) {
      std::get<Distance>(observation.reading).length *= factor;
    }
    const std::vector<Doubt> doubts = calibrate(bundled_robot(), measurements, readings_alone()).doubts();
    if (factor == 1.0) {
      EXPECT_THAT(doubts, ::testing::IsEmpty());
      continue;
    }
    ASSERT_FALSE(doubts.empty()) << factor;
    EXPECT_EQ(doubts.front().cause, Cause::scale) << factor;
    EXPECT_THAT(doubts.front().message, HasSubstr("all measured distances "));
    EXPECT_NEAR(doubts.front().figures.front().value, factor - 1.0, 0.05 * std::abs(factor - 1.0)) << factor;
  }
}

// Stations at places that another instrument measured: the same, but for where the places are stated.
TEST(DistancesFromAnchors, FromStationsOfKnownBasesAreDoubtedByTheirScale) {
  const std::vector<Vector3d> places = {{2.1, 1.4, 0.3}, {-1.2, 2.3, 1.1}, {1.0, -2.2, 0.6}};  // those of Distances
  for (const double factor : {1.0, 1.002, 0.98}) {
    Distances experiment(4);
    Measurements measurements = experiment.measured(3, false, 60, kNoise);
    CalibrationOptions options = readings_alone();
    for (std::size_t i = 0; i < places.size(); ++i) {
      options.parameters.known.bases.push_back(
          {measurements.stations[i], Eigen::Translation3d(-places[i]) * experiment.robot.truth.frames.base()});
    }
    for (Observation& observation : measurements.observations) {
      std::get<Distance>(observation.reading).length *= factor;
    }
    const std::vector<Doubt> doubts = calibrate(bundled_robot(), measurements, options).doubts();
    if (factor == 1.0) {
      EXPECT_THAT(doubts, ::testing::IsEmpty());
      continue;
    }
    ASSERT_FALSE(doubts.empty()) << factor;
    EXPECT_EQ(doubts.front().cause, Cause::scale) << factor;
    EXPECT_NEAR(doubts.front().figures.front().value, factor - 1.0, 0.05 * std::abs(factor - 1.0)) << factor;
  }
}

// `factors` on ways to measure, by turns.
void expect_another_unit_of_all_lengths_is_named(const CalibrationOptions& options,
                                                 const std::vector<double>& factors) {
  const std::vector<Measurements> ways = {Distances(4).measured(3, false, 60, kNoise),
                                          Distances(4).beside_points(6, 60, kNoise), Heights(4).measured(60, kNoise),
                                          testing::Ball(4).touched(4, 40, kNoise)};
  for (std::size_t way = 0; way < ways.size(); ++way) {
    for (std::size_t i = way % 2; i < factors.size(); i += 2) {
      const double factor = factors[i];
      Measurements measurements = ways[way];
      for (Observation& observation : measurements.observations) {
        testing::scale_lengths(observation, factor);
      }
      const std::vector<Doubt> doubts = calibrate(bundled_robot(), measurements, options).doubts();
      ASSERT_FALSE(doubts.empty());
      EXPECT_EQ(doubts.front().cause, Cause::length_unit) << factor << ' ' << doubts.front().message;
    }
  }
}

// All lengths times 0.001 leave a thousandth of what errors and noise leave, where little holds the points.
void expect_no_other_unit_where_few_rows_leave_little(const CalibrationOptions& options, std::uint64_t seeds) {
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    testing::VirtualExperiment experiment({.random = Random(seed)});
    experiment.robot = robot_at_stations(experiment.robot, 8, experiment.random);
    const Measurements rows =
        along(testing::without_sigmas(experiment.measure(14, {.sigma = kNoise})), Vector3d(1.0, 1.0, 0.0).asDiagonal());
    const std::vector<Doubt> doubts = calibrate(bundled_robot(), rows, options).doubts();
    EXPECT_THAT(doubts, ::testing::Not(Contains(Field(&Doubt::cause, Cause::length_unit)))) << seed;
  }
}

TEST(AnotherUnit, OfAllLengthsIsNamed) { expect_another_unit_of_all_lengths_is_named(readings_alone(), {1e3, 1e-3}); }
TEST(AnotherUnitLongRun, OfAllLengthsIsNamed) {
  expect_another_unit_of_all_lengths_is_named({}, {1e3, 1e3, 1e-3, 1e-3});
}

TEST(AnotherUnit, IsNotNamedWhereFewRowsLeaveLittle) {
  expect_no_other_unit_where_few_rows_leave_little(readings_alone(), 3);
}
TEST(AnotherUnitLongRun, IsNotNamedWhereFewRowsLeaveLittle) { expect_no_other_unit_where_few_rows_leave_little({}, 8); }

TEST(DistancesFromAnchors, WithAConstantErrorAreSaidToHaveOne) {
  testing::VirtualExperiment experiment({.targets = testing::targets_at({{0.05, 0.2, 0.1}}), .random = Random(2)});
  experiment.robot = robot_at_stations(experiment.robot, 3, experiment.random);
  Measurements measurements = experiment.measure(80, {.sigma = kNoise});
  for (Observation& observation : measurements.observations) {
    testing::keep_distance(observation, Vector3d::Zero(), 0.01);
  }
  const std::vector<Doubt> doubts = calibrate(bundled_robot(), measurements).doubts();
  ASSERT_FALSE(doubts.empty());
  EXPECT_EQ(doubts.front().cause, Cause::distance_zero);
  EXPECT_THAT(doubts.front().message, HasSubstr("all distances 10"));
}

// Three directions of each base are open, so that 21 + 4 x 3 unknowns are left for 40 coordinates.
TEST(SingleCoordinates, AreEnoughWhereThoseThatAreShownAreFewer) {
  testing::VirtualExperiment experiment({.targets = testing::targets_at({{0.05, 0.2, 0.1}}), .random = Random(6)});
  experiment.robot = robot_at_stations(experiment.robot, 4, experiment.random);
  const Measurements heights = along(testing::without_sigmas(experiment.measure(40)), kHeight);
  const Calibration found = calibrate(bundled_robot(), heights, geometry_alone());
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), 33U);
  EXPECT_LT(distance_from_truth(found, experiment), 1e-9);
  const Measurements few = subset(heights, [](const Observation& o) { return o.configuration % 5 != 0; });
  EXPECT_THAT(refusal([&] { calibrate(bundled_robot(), few, geometry_alone()); }),
              HasSubstr("32 measured coordinates for 33 unknowns"));
}

TEST(DistancesFromAnchors, ABlunderIsNamed) {
  Distances experiment(9);
  Measurements measurements = experiment.measured(3, false, 60, kNoise);
  EXPECT_TRUE(calibrate(bundled_robot(), measurements).trusted());
  const auto expect_named = [](const Measurements& wrong, const std::vector<std::string>& targets) {
    const Calibration found = calibrate(bundled_robot(), wrong);
    ASSERT_FALSE(found.doubts().empty());
    EXPECT_EQ(found.doubts().front().cause, Cause::gross_rows);
    EXPECT_EQ(found.doubts().front().names(SubjectKind::configuration), std::vector{wrong.configurations[20]});
    EXPECT_EQ(found.doubts().front().names(SubjectKind::target), targets);
  };
  for (const double off : {0.001, 0.01, 0.3}) {
    Measurements wrong = measurements;
    std::get<Distance>(wrong.observations[60].reading).length += off;
    expect_named(wrong, {"A"});
  }
  Measurements wrong = measurements;
  for (std::size_t row = 60; row < 63; ++row) {
    wrong.observations[row].station = 0;  // instead of 2
  }
  expect_named(wrong, {});
}

// One target, so that the distances are not many more than the unknowns.
TEST(DistancesFromAnchors, ABlunderOfOneTargetIsNamed) {
  Distances experiment(3);
  experiment.robot.truth.frames.targets.resize(1);
  Measurements measurements = experiment.measured(2, false, 60, kNoise);
  EXPECT_TRUE(calibrate(bundled_robot(), measurements).trusted());
  for (const double off : {0.001, 0.1}) {
    Measurements wrong = measurements;
    std::get<Distance>(wrong.observations[8].reading).length += off;
    EXPECT_THAT(calibrate(bundled_robot(), wrong).doubts(), Contains(is_gross_row(wrong.configurations[8])));
  }
}

TEST(DistancesFromAnchors, AreLeftOutSavedAndValidated) {
  Distances experiment(7);
  const Measurements measurements = experiment.measured(3, true, 60, 3e-5);
  const Calibration found = calibrate(bundled_robot(), measurements);
  EXPECT_TRUE(found.trusted());
  EXPECT_LT(found.accuracy().leave_one_out->after.rms, 6e-5);
  EXPECT_THAT(found.warnings(), Contains(HasSubstr("180 of 180 rows are single coordinates or distances")));
  EXPECT_THAT(found.parts().fitted->selection.not_tried,
              Contains(::testing::FieldsAre(EndsWith("other readings of the joints"), "single coordinates")));
  const Measurements fresh = experiment.measured(3, true, 20, 3e-5);
  EXPECT_LT(validate(found, fresh).all.rms, 6e-5);
  EXPECT_GT(validate(bundled_robot(), fresh).all.rms, 3e-4);
}

// ---- The whole calibration -----------------------------------------------------------------------------------------

TEST(SingleCoordinates, AutomaticChoicesAndLeftOutRowsWork) {
  Heights experiment(6);
  Measurements measurements = experiment.measured(80, 3e-5);
  for (Observation& observation : measurements.observations) {
    observation.split = observation.configuration % 10 == 9 ? Split::test : Split::train;
  }
  const Calibration found = calibrate(bundled_robot(), measurements);
  EXPECT_TRUE(found.trusted());
  ASSERT_TRUE(found.accuracy().leave_one_out);
  EXPECT_GT(found.accuracy().leave_one_out->before.rms, 5e-4);
  EXPECT_LT(found.accuracy().leave_one_out->after.rms, 6e-5);
  EXPECT_LT(found.accuracy().test->after.rms, 6e-5);
  CalibrationOptions folds = geometry_alone();
  folds.validation = {.k_fold = 4};
  EXPECT_LT(calibrate(bundled_robot(), measurements, folds).accuracy().k_fold->after.rms, 8e-5);
}

// A tracker that lost one coordinate of one point. All other rows are checked as if it had not.
TEST(SingleCoordinates, AnEmptyCellLeavesTheChecksOfWholePoints) {
  testing::VirtualExperiment experiment;
  Measurements measurements = along(experiment.measure(30, {.sigma = kNoise}), Matrix3d::Identity());
  testing::lose_coordinate(measurements.observations[16], 2);
  EXPECT_TRUE(calibrate(bundled_robot(), measurements).trusted());
  Measurements mistyped = measurements;
  mistyped.observations[34].position().y() += 0.004;
  EXPECT_THAT(calibrate(bundled_robot(), mistyped).warnings(),
              Contains(HasSubstr("target B in configuration 12, repeat 1: y is off by about 4.0 mm")));
  Measurements moved = measurements;
  moved.joint_values(2, 20) += 0.01;
  const std::vector<Doubt> doubts = calibrate(bundled_robot(), moved).doubts();
  EXPECT_THAT(doubts, Contains(is_gross_row(moved.configurations[20])));
  EXPECT_EQ(doubts.size(), calibrate(bundled_robot(), whole_points(moved)).doubts().size());
  // Of the configuration with the empty cell one target alone may not be what is wrong.
  Measurements swapped = measurements;
  std::swap(swapped.observations[15].position(), swapped.observations[17].position());
  EXPECT_THAT(calibrate(bundled_robot(), swapped).doubts(), Contains(is_gross_row(swapped.configurations[5])));
}

TEST(SingleCoordinates, ASavedResultPredictsTheSameAndIsValidated) {
  testing::VirtualExperiment experiment;
  Measurements measurements =
      along(testing::without_sigmas(experiment.measure(40, {.sigma = 3e-5})), Vector3d(1.0, 0.0, 1.0).asDiagonal());
  const Calibration found = calibrate(bundled_robot(), measurements, geometry_alone());
  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / "kdl_calibration_single_coordinates_test.json";
  write_result(file, bundled_robot(), measurements, found);
  const Calibration again = load_calibration(file, bundled_robot());
  std::filesystem::remove(file);
  const Eigen::VectorXd q = experiment.configurations(1).col(0);
  const PredictedPoint one = found.arm().predict(q, "B");
  const PredictedPoint other = again.arm().predict(q, "B");
  EXPECT_LT((one.position - other.position).norm(), 1e-12);
  EXPECT_NEAR(one.radius_95, other.radius_95, 1e-12);
  const Measurements fresh = along(testing::without_sigmas(experiment.measure(20, {.sigma = 3e-5})), kHeight);
  EXPECT_LT(validate(again, fresh).all.rms, 6e-5);
  EXPECT_GT(validate(bundled_robot(), fresh).all.rms, 3e-4);
}

TEST(SingleCoordinates, WhatNeedsWholePointsIsRefused) {
  Heights experiment;
  const Measurements measurements = experiment.measured(60, 3e-5);
  const auto refused = [&](const auto& change) {
    CalibrationOptions options = geometry_alone();
    change(options);
    return refusal([&] { return calibrate(bundled_robot(), measurements, options); });
  };
  EXPECT_THAT(refused([](CalibrationOptions& o) { o.estimator.method = Method::two_step; }),
              HasSubstr("the two-step procedure fits whole points"));
  EXPECT_THAT(refused([](CalibrationOptions& o) { o.estimator.loss = Loss::huber; }),
              HasSubstr("robust losses judge whole points"));
  EXPECT_THAT(refused([](CalibrationOptions& o) { o.validation.nested = true; }),
              HasSubstr("nested folds compare whole points"));
  EXPECT_THAT(refused([](CalibrationOptions& o) { o.noise.weights = Weights::repeats; }),
              HasSubstr("noise by repeats needs whole points"));
  EXPECT_THAT(refused([](CalibrationOptions& o) { o.noise.stated.independent = Vector3d(1e-5, 1e-5, 2e-5); }),
              HasSubstr("expected one sigma for all coordinates"));
  EXPECT_THAT(refused([](CalibrationOptions& o) { o.noise.stated.tracker = TrackerNoise{.range = 1e-5}; }),
              HasSubstr("expected one sigma for all coordinates"));
}

}  // namespace
}  // namespace kdl_calibration::single_coordinates_test
