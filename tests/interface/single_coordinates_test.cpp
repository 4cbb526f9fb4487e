// Measurements of single coordinates: heights above planes, touches of planes, coordinates along lines; and of
// distances.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "calibration/parameter_estimates.hpp"
#include "estimation/least_squares.hpp"
#include "geometry_alone.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/result_file.hpp"
#include "kdl_calibration/validation.hpp"
#include "planning/plate.hpp"
#include "refusal.hpp"
#include "support.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::single_coordinates_test {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using testing::bundled_robot;
using ::testing::Contains;
using testing::geometry_alone;
using ::testing::HasSubstr;
using testing::refusal;

// The coordinates along these directions only.
Measurements along(Measurements measurements, const Matrix3d& P) {
  for (Observation& observation : measurements.observations) {
    observation.position = P * observation.position;
  }
  measurements.coordinates.assign(measurements.observations.size(), {.directions = P});
  if (measurements.stations.empty()) {
    measurements.stations = {"W"};
  }
  return measurements;
}

constexpr double kNoise = 3e-5;  // [m]
const Matrix3d kHeight = Vector3d::UnitZ().asDiagonal();

// Each point as three rows, along the axes of a frame of its own.
Measurements in_three_rows(const Measurements& points, Random& random) {
  Measurements result = points;
  result.observations.clear();
  result.stations = {"W"};
  for (const Observation& observation : points.observations) {
    Matrix3d R = Matrix3d::Identity();
    if (observation.target > 0) {
      R = Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal())
              .normalized()
              .toRotationMatrix();
    }
    for (const auto& n : R.colwise()) {
      result.observations.push_back(observation);
      result.coordinates.push_back({.directions = n * n.transpose()});
      result.observations.back().position = result.coordinates.back().directions * observation.position;
    }
  }
  return result;
}

double distance_up_to_gauge(const Calibration& found, const VirtualRobot& robot, const MatrixXd& q) {
  const CalibrationParts& parts = found.parts();
  return testing::distance_up_to_gauge(testing::points(parts.model, parts.estimate, q),
                                       testing::points(robot.model, robot.truth, q));
}

// Heights of three targets above four planes that are tilted against each other.
struct Heights : testing::VirtualExperiment {
  explicit Heights(std::uint64_t seed = 1) : VirtualExperiment({.random = Random(seed)}) { move(); }

  void move() { robot = at_stations(robot, 4, random); }
  Measurements measured(int count, double noise = 0.0) {
    return along(testing::without_sigmas(measure(count, {.sigma = noise})), kHeight);
  }
};

// A ball that touches the planes of a plate at several places.
struct Touches : testing::VirtualExperiment {
  explicit Touches(std::uint64_t seed = 1)
      : VirtualExperiment({.targets = testing::targets_at({{0.05, 0.2, 0.1}}), .random = Random(seed)}) {}

  Measurements touched(int places, int count, double noise = 0.0) {
    std::vector<Vector3d> spots;
    for (int i = 0; i < 20; ++i) {
      spots.emplace_back(0.3 * random.normal(), 0.3 * random.normal(), 0.0);
    }
    const Plate plate{.sockets = spots, .places = places, .sigma = noise};
    return along(testing::without_sigmas(touch(plate, ranges, count, random, robot)), kHeight);
  }
};

// Distances from anchors that stand around the robot, one in each configuration.
struct Distances : testing::VirtualExperiment {
  explicit Distances(std::uint64_t seed = 1) : VirtualExperiment({.random = Random(seed)}) {}

  // Anchors at known places in W, or at unknown ones: then the first `anchors` are stations.
  Measurements measured(int anchors, bool known, int count, double noise = 0.0) {
    const std::vector<Vector3d> places = {{2.1, 1.4, 0.3}, {-1.2, 2.3, 1.1}, {1.0, -2.2, 0.6}};
    Measurements result = testing::without_sigmas(measure(count));
    for (int i = 0; i < (known ? 1 : anchors); ++i) {
      result.stations.push_back("A" + std::to_string(i + 1));
    }
    for (Observation& observation : result.observations) {
      const int anchor = observation.configuration % anchors;
      const Vector3d& place = places[static_cast<std::size_t>(anchor)];
      result.coordinates.push_back({.distance = (observation.position - place).norm() + noise * random.normal()});
      observation.station = static_cast<std::int16_t>(known ? 0 : anchor);
      observation.position = known ? place : Vector3d::Zero();
    }
    return result;
  }
};

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
  EXPECT_LT((a.X_WB.matrix() - b.X_WB.matrix()).cwiseAbs().maxCoeff(), 1e-9);
  for (std::size_t i = 0; i < one.parameters().size(); ++i) {
    const double ratio = other.parameters()[i].std / one.parameters()[i].std;  // NaN for gauges
    EXPECT_FALSE(std::abs(ratio - 1.0) > 1e-5) << one.parameters()[i].name << ratio;
    EXPECT_EQ(one.parameters()[i].degrees_of_freedom, other.parameters()[i].degrees_of_freedom);
  }
}

// A height z = n p + d above a plane has three numbers of the plane in the base frame: two of its normal n, and d. So
// each of the four stations determines three of its six, and the arm is determined as by whole points.
TEST(SingleCoordinates, HeightsAboveFourPlanesAreExactWithoutNoise) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    Heights experiment(seed);
    const Calibration found = calibrate(bundled_robot(), experiment.measured(80), geometry_alone());
    EXPECT_TRUE(found.trusted()) << seed;
    EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() - 6U + 4U * 3U);
    EXPECT_LT(distance_up_to_gauge(found, experiment.robot, experiment.configurations(50)), 1e-9) << seed;
    EXPECT_TRUE(found.arm().predict(experiment.configurations(1).col(0), "A").covariance.allFinite());
    EXPECT_THAT(found.warnings(), Contains(HasSubstr("held as registered: base[S1]")));
    EXPECT_THAT(found.warnings(), Contains(HasSubstr("lengths along the measured directions")));
  }
}

// On a plane n p + d = 0 for all touches. This equation is homogeneous: an arm that is larger by a factor, with the
// plane as much farther, fits as well. So planes that are touched leave one direction of arm and planes undetermined,
// the scale, and a length that is known determines it.
TEST(SingleCoordinates, TouchesOfFourPlanesLeaveTheScale) {
  Touches experiment(4);
  experiment.robot.truth.errors[static_cast<Index>(parameter_index(experiment.model, "Tz2"))] = 0.0;
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
  EXPECT_LT(distance_up_to_gauge(found, experiment.robot, experiment.configurations(50)), 1e-9);
}

TEST(SingleCoordinates, HelpFewWholePoints) {
  Heights experiment(5);
  Measurements mixed = experiment.measured(60);
  const Measurements whole = testing::without_sigmas(experiment.measure(mixed.joint_values));
  for (std::size_t row = 0; row < mixed.observations.size(); ++row) {
    if (mixed.observations[row].configuration < 4) {
      mixed.observations[row] = whole.observations[row];
      mixed.coordinates[row].directions.setIdentity();
    }
  }
  const Calibration found = calibrate(bundled_robot(), mixed, geometry_alone());
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() + 3U * 3U);
  EXPECT_LT(distance_up_to_gauge(found, experiment.robot, experiment.configurations(50)), 1e-9);
}

// Distances |X_WB p - a| from an anchor at an unknown place do not change if the arm turns about the anchor. So each of
// these determines three numbers, its place in the base frame, and one anchor is enough for the arm.
TEST(DistancesFromAnchors, FromUnknownAnchorsAreExactWithoutNoise) {
  for (const int anchors : {1, 2, 3}) {
    for (const std::uint64_t seed : {1U, 2U, 3U, 4U, 5U}) {
      Distances experiment(seed);
      const Calibration found = calibrate(bundled_robot(), experiment.measured(anchors, false, 80), geometry_alone());
      EXPECT_TRUE(found.trusted()) << anchors << seed;
      EXPECT_EQ(static_cast<int>(found.estimated().size()),
                static_cast<int>(experiment.reduction.kept.size()) - 6 + 3 * anchors);
      EXPECT_LT(distance_up_to_gauge(found, experiment.robot, experiment.configurations(50)), 1e-9) << anchors << seed;
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
    EXPECT_LT((estimate.X_WB.matrix() - experiment.robot.truth.X_WB.matrix()).cwiseAbs().maxCoeff(), 1e-9) << seed;
    EXPECT_LT(distance_up_to_gauge(found, experiment.robot, experiment.configurations(50)), 1e-9) << seed;
  }
}

TEST(DistancesFromAnchors, HelpFewWholePoints) {
  Distances experiment(6);
  Measurements points = testing::without_sigmas(experiment.measure(6));
  Measurements mixed = experiment.measured(1, false, 80);
  points.stations = mixed.stations = {"tracker", "A1"};
  for (std::string& label : points.configurations) {
    label = "whole " + label;
  }
  for (Observation& observation : mixed.observations) {
    observation.station = 1;
  }
  const Calibration found = calibrate(bundled_robot(), joined(points, mixed), geometry_alone());
  EXPECT_TRUE(found.trusted());
  EXPECT_EQ(found.estimated().size(), experiment.reduction.kept.size() + 3U);
  EXPECT_LT(distance_up_to_gauge(found, experiment.robot, experiment.configurations(50)), 1e-9);
}

// The distance from a point on the axis of joint 1 does not depend on joint 1, and hardly on other errors.
TEST(DistancesFromAnchors, UnderTheRobotAreNotTrusted) {
  Distances experiment(8);
  Measurements measurements = testing::without_sigmas(experiment.measure(80, {.sigma = kNoise}));
  measurements.stations = {"A1"};
  for (Observation& observation : measurements.observations) {
    measurements.coordinates.push_back({.distance = observation.position.norm()});
    observation.position.setZero();
  }
  const Calibration found = calibrate(bundled_robot(), measurements);
  EXPECT_EQ(found.verdict(), Verdict::not_trusted);
  EXPECT_LT(found.accuracy().leave_one_out->after.rms, 2.0 * kNoise);
}

TEST(DistancesFromAnchors, ABlunderIsNamed) {
  Distances experiment(9);
  Measurements measurements = experiment.measured(3, false, 60, kNoise);
  EXPECT_TRUE(calibrate(bundled_robot(), measurements).trusted());
  measurements.coordinates[60].distance += 0.01;
  const Calibration found = calibrate(bundled_robot(), measurements);
  ASSERT_FALSE(found.doubts().empty());
  EXPECT_THAT(found.doubts().front().message, HasSubstr("--exclude '" + measurements.configurations[20] + ":A'"));
}

TEST(DistancesFromAnchors, AreLeftOutSavedAndValidated) {
  Distances experiment(7);
  const Measurements measurements = experiment.measured(3, true, 60, 3e-5);
  const Calibration found = calibrate(bundled_robot(), measurements);
  EXPECT_TRUE(found.trusted());
  EXPECT_LT(found.accuracy().leave_one_out->after.rms, 6e-5);
  EXPECT_THAT(found.warnings(), Contains(HasSubstr("180 of 180 rows are single coordinates or distances")));
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

// ---- Monte Carlo ---------------------------------------------------------------------------------------------------

// Coverage of the 95 % intervals, and the errors' squares against the bound of the information with the true noise.
template <class Measure>
void expect_coverage_and_efficiency(testing::VirtualExperiment& experiment, Measure measure) {
  double inside = 0.0;
  double parameters = 0.0;
  double squares = 0.0;
  double bound = 0.0;
  for (std::uint64_t run = 0; run < 300; ++run) {
    experiment.restart(Random(13, run));
    const Measurements measurements = measure();
    const Calibration found = calibrate(bundled_robot(), measurements, geometry_alone());
    ResidualOptions residuals;
    residuals.noise.independent.setConstant(kNoise);
    const CalibrationParts& parts = found.parts();
    const MatrixXd information =
        LeastSquaresProblem(parts.model, measurements, parts.free, residuals).linearise(parts.estimate).hessian;
    const MatrixXd least = information.ldlt().solve(MatrixXd::Identity(information.rows(), information.cols()));
    std::vector<Index> columns;
    std::vector<double> errors;
    for (const ParameterEstimate& parameter : found.parameters()) {
      if (parameter.joint.empty() || parameter.gauge || !(parameter.std > 0.0)) {
        continue;
      }
      const VirtualRobot& robot = experiment.robot;
      const double truth = robot.truth.errors[static_cast<Index>(parameter_index(robot.model, parameter.name))];
      const double off = parameter.error - truth;
      inside += std::abs(off) < half_width_95(parameter.std, parameter.degrees_of_freedom) ? 1 : 0;
      parameters += 1.0;
      columns.push_back(*parts.free.column(parameter.name));
      errors.push_back(off);
    }
    const Eigen::Map<const Eigen::VectorXd> off(errors.data(), std::ssize(errors));
    const double normalised = off.dot(MatrixXd(least(columns, columns)).ldlt().solve(off));
    EXPECT_LT(normalised, 4.0 * static_cast<double>(errors.size())) << run << " " << found.trusted();
    squares += normalised;
    bound += static_cast<double>(errors.size());
  }
  ::testing::Test::RecordProperty("coverage", std::to_string(inside / parameters));
  ::testing::Test::RecordProperty("efficiency", std::to_string(bound / squares));
  EXPECT_GT(inside / parameters, 0.935);
  EXPECT_LT(inside / parameters, 0.965);
  EXPECT_GT(bound / squares, 0.98);
}

TEST(SingleCoordinatesLongRun, IntervalsOfHeightsCoverAndTheEstimateIsEfficient) {
  Heights experiment;
  expect_coverage_and_efficiency(experiment, [&] {
    experiment.move();
    return experiment.measured(60, kNoise);
  });
}

TEST(SingleCoordinatesLongRun, IntervalsOfDistancesCoverAndTheEstimateIsEfficient) {
  Distances experiment;
  expect_coverage_and_efficiency(experiment, [&] { return experiment.measured(2, false, 60, kNoise); });
}

}  // namespace
}  // namespace kdl_calibration::single_coordinates_test
