// Measured orientations are weighed by what their residuals say, not by a lever.

#include "noise/orientation_length_estimate.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "measurements/readings.hpp"
#include "planning/simulation.hpp"
#include "record.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::orientation_length_estimate_test {
namespace {

// Mean square of the held-out errors [m^2] of calibrations that state both sigmas, none, or none and weigh by a lever.
struct HeldOut {
  double stated = 0.0;
  double estimated = 0.0;
  double lever = 0.0;
};

HeldOut held_out(double orientation_sigma, std::uint64_t seeds) {
  testing::VirtualExperiment experiment({.targets = testing::as_frames(published_targets(1))});
  const ErrorModel& model = experiment.model;
  constexpr double kSigma = 0.00003;
  HeldOut sums;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    experiment.restart(Random(seed));
    const Measurements train =
        testing::without_sigmas(experiment.measure(30, {.sigma = kSigma, .orientation_sigma = orientation_sigma}));
    const Measurements test = experiment.measure(100, {}, Split::test);
    const auto square = [&](const Estimate& estimate) {
      const double rms = error_statistics(position_errors(model, estimate, joined(train, test), Rows::test)).rms;
      return rms * rms;
    };
    const CalibrationSettings fit_alone{.validation = {.held_out = false}, .diagnosis = {.try_readings = false}};
    CalibrationSettings stated = fit_alone;
    stated.noise.stated.independent.setConstant(kSigma);
    stated.noise.stated.orientation = orientation_sigma;
    sums.stated += square(calibrate(model, train, stated).fit.identification.estimate);
    sums.estimated += square(calibrate(model, train, fit_alone).fit.identification.estimate);
    sums.lever += square(identify_jointly(model, train, nominal_start(model, train), experiment.free).estimate);
  }
  return sums;
}

void expect_as_good_as_stated(std::uint64_t seeds) {
  for (const double sigma : {0.00001, 0.0001, 0.002}) {
    const HeldOut found = held_out(sigma, seeds);
    const std::string over_stated = "held out over stated sigmas, orientations to " + std::to_string(sigma) + " rad, ";
    testing::record(over_stated + "estimated", std::sqrt(found.estimated / found.stated));
    testing::record(over_stated + "by a lever of 0.3 m", std::sqrt(found.lever / found.stated));
    EXPECT_LT(found.estimated, 1.1 * found.stated) << sigma;
    if (sigma > 0.001) {
      EXPECT_LT(found.estimated, 0.5 * found.lever) << sigma;
    }
  }
}

TEST(OrientationLength, AreAsGoodAsStatedSigmas) { expect_as_good_as_stated(2); }

TEST(OrientationLengthLongRun, AreAsGoodAsStatedSigmas) { expect_as_good_as_stated(4); }

TEST(OrientationLength, LeaveExactPosesExact) {
  testing::VirtualExperiment experiment({.targets = testing::as_frames(published_targets(1))});
  const CalibrationResult found = calibrate(experiment.model, experiment.measure(30));
  EXPECT_TRUE(found.trusted()) << found.fit.identification.message;
  EXPECT_LT(found.accuracy.train.after.max, 1e-12);
}

// Poses of one target with these sigmas, and what a fit needs to know.
struct Poses : testing::VirtualExperiment {
  Measurements measured;
  FitOptions fit_options;
  Estimate start;

  Poses(int count, const MeasuringNoise& noise)
      : VirtualExperiment(arm()),
        measured(testing::without_sigmas(measure(count, noise))),
        start(nominal_start(model, measured)) {}

  static const VirtualExperiment& arm() {
    static const VirtualExperiment experiment(
        {.targets = testing::as_frames(published_targets(1)), .random = Random(11)});
    return experiment;
  }

  double length() const {
    return orientation_length_of_residuals(
        {.model = model, .measurements = measured, .start = start, .free = free, .options = fit_options});
  }
};

// Variances of unit weight of positions and orientations at the fit that weighs by a length, and what they rest on.
struct UnitVariances {
  double ratio = 0.0;
  double freedom_p = 0.0;
  double freedom_o = 0.0;

  UnitVariances(const Poses& poses, double length) {
    JointOptions joint;
    joint.residuals.orientation_length = length;
    const Estimate estimate = identify_jointly(poses.model, poses.measured, poses.start, poses.free, joint).estimate;
    const WhitenedSystem system =
        LeastSquaresProblem(poses.model, poses.measured, poses.free, joint.residuals).whitened(estimate);
    const Eigen::VectorXd scale = system.jacobian.colwise().norm().cwiseInverse();
    const Eigen::MatrixXd J = system.jacobian * scale.asDiagonal();
    const Eigen::MatrixXd hat = J * (J.transpose() * J).ldlt().solve(J.transpose());
    double squares_p = 0.0;
    double squares_o = 0.0;
    for (Eigen::Index row = 0; row < hat.rows(); ++row) {  // of each configuration its position, then its orientation
      const bool position = row % 6 < 3;
      (position ? freedom_p : freedom_o) += 1.0 - hat(row, row);
      (position ? squares_p : squares_o) += system.residual[row] * system.residual[row];
    }
    ratio = squares_o / freedom_o / (squares_p / freedom_p);
  }
};

// Weighed by the length that is found, positions and orientations have the same variance of unit weight.
TEST(OrientationLength, LeaveBothKindsTheSameVarianceOfUnitWeight) {
  for (const double orientation : {2e-5, 2e-4, 2e-2}) {
    const Poses poses(20, {.sigma = 3e-5, .orientation_sigma = orientation});
    EXPECT_NEAR(UnitVariances(poses, poses.length()).ratio, 1.0, 0.03) << orientation;
  }
}

TEST(OrientationLength, OfFewDegreesOfFreedomAreNotEstimated) {
  for (const auto& [count, enough] : {std::pair{8, false}, std::pair{9, false}, std::pair{14, true}}) {
    Poses poses(count, {.sigma = 3e-5, .orientation_sigma = 2e-4});
    poses.fit_options.joint.residuals.orientation_length = 0.5;
    const UnitVariances variances(poses, 0.5);
    EXPECT_EQ(std::min(variances.freedom_p, variances.freedom_o) > 10.0, enough) << count;
    EXPECT_EQ(poses.length() != 0.5, enough) << count;
  }
}

TEST(OrientationLength, StayBetweenAMillimetreAndAHundredMetres) {
  EXPECT_DOUBLE_EQ(Poses(20, {.sigma = 1e-3, .orientation_sigma = 1e-6}).length(), 100.0);
  EXPECT_DOUBLE_EQ(Poses(20, {.sigma = 1e-7, .orientation_sigma = 1e-2}).length(), 1e-3);
}

TEST(OrientationLength, ArePresentOnesWhereNothingTellsThem) {
  Poses exact(20, {});
  exact.fit_options.joint.residuals.orientation_length = 0.7;
  EXPECT_EQ(exact.length(), 0.7);
  Poses points(20, {.sigma = 1e-4});
  points.measured = without_orientations(std::move(points.measured));
  points.fit_options.joint.residuals.orientation_length = 0.7;
  EXPECT_EQ(points.length(), 0.7);
}

}  // namespace
}  // namespace kdl_calibration::orientation_length_estimate_test
