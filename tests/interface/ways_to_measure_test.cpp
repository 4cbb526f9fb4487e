// Monte Carlo over all ways to measure: the intervals and radii cover, and no unbiased estimate from the same data
// would be better.

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "calibration/parameter_estimates.hpp"
#include "estimation/least_squares.hpp"
#include "geometry_alone.hpp"
#include "interface/calibration_parts.hpp"
#include "interface/ways_to_measure.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration::ways_to_measure_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using testing::Ball;
using testing::Distances;
using testing::Heights;
using testing::kNoise;
using testing::Touches;
using testing::Tracker;

// The inverse of the Fisher information with the true noise: no covariance of an unbiased estimate is below it.
MatrixXd least_covariance(const CalibrationParts& parts, const Measurements& measurements) {
  ResidualOptions residuals;
  residuals.noise.independent.setConstant(kNoise);
  const MatrixXd information =
      LeastSquaresProblem(parts.model, measurements, parts.free, residuals).linearise(parts.estimate).hessian;
  return information.ldlt().solve(MatrixXd::Identity(information.rows(), information.cols()));
}

// Sums over the runs.
struct Statistics {
  double parameters = 0.0;
  double inside = 0.0;   // parameters whose 95 % interval holds the truth
  double squares = 0.0;  // of the errors, in units of the least covariance
  double points = 0.0;
  double inside_radius = 0.0;  // new points within the radius of 95 %

  void add_parameters(const Calibration& found, const VirtualRobot& robot, const Measurements& measurements) {
    const CalibrationParts& parts = found.parts();
    std::vector<Index> columns;
    std::vector<double> errors;
    for (const ParameterEstimate& parameter : found.parameters()) {
      if (parameter.joint.empty() || parameter.gauge || !(parameter.std > 0.0)) {
        continue;
      }
      const double truth = robot.truth.errors[static_cast<Index>(parameter_index(robot.model, parameter.name))];
      columns.push_back(*parts.free.column(parameter.name));
      errors.push_back(parameter.error - truth);
      inside += std::abs(errors.back()) < half_width_95(parameter.std, parameter.degrees_of_freedom) ? 1.0 : 0.0;
    }
    const Eigen::Map<const Eigen::VectorXd> off(errors.data(), std::ssize(errors));
    const MatrixXd least = least_covariance(parts, measurements)(columns, columns);
    squares += off.dot(least.ldlt().solve(off));
    parameters += static_cast<double>(errors.size());
  }
  void add_points(const Calibration& found, testing::VirtualExperiment& experiment) {
    const MatrixXd q = experiment.configurations(9);
    const Eigen::Matrix3Xd truth = testing::points(experiment.robot.model, experiment.robot.truth, q);
    const std::vector<TargetFrame>& targets = experiment.robot.truth.frames.targets;
    for (Index point = 0; point < truth.cols(); ++point) {
      const auto count = static_cast<Index>(targets.size());
      const PredictedPoint predicted =
          found.arm().predict(q.col(point / count), targets[static_cast<std::size_t>(point % count)].name);
      const Eigen::Vector3d measured = truth.col(point) + kNoise * normal_vector(experiment.random);
      inside_radius += (predicted.position - measured).norm() < predicted.radius_95 ? 1.0 : 0.0;
      points += 1.0;
    }
  }
};

// Runs the experiment 300 times. The true errors are those of the reduced model, so that their gauge is that of the
// estimate. `known`: the name of an error that is zero and held.
template <class Experiment, class Measure>
void expect_coverage_and_efficiency(Experiment experiment, const Measure& measured, const std::string& known = {}) {
  CalibrationOptions options = testing::geometry_alone();
  if (!known.empty()) {
    options.parameters.fix = {known};
  }
  Statistics sum;
  for (std::uint64_t run = 0; run < 300; ++run) {
    experiment.restart(Random(13, run));
    if (!known.empty()) {
      experiment.robot.truth.errors[static_cast<Index>(parameter_index(experiment.model, known))] = 0.0;
    }
    const Measurements measurements = measured(experiment);
    const Calibration found = calibrate(testing::bundled_robot(), measurements, options);
    sum.add_parameters(found, experiment.robot, measurements);
    sum.add_points(found, experiment);
  }
  ::testing::Test::RecordProperty("coverage", std::to_string(sum.inside / sum.parameters));
  ::testing::Test::RecordProperty("radius", std::to_string(sum.inside_radius / sum.points));
  ::testing::Test::RecordProperty("efficiency", std::to_string(sum.parameters / sum.squares));
  EXPECT_NEAR(sum.inside / sum.parameters, 0.95, 0.015);
  EXPECT_NEAR(sum.inside_radius / sum.points, 0.95, 0.015);
  const double chance = std::sqrt(2.0 / sum.parameters);  // 1 sigma of the mean of so many squares
  EXPECT_GT(sum.parameters / sum.squares, 0.98 - 2.0 * chance);
}

TEST(WaysToMeasureLongRun, ATrackerThatIsMoved) {
  expect_coverage_and_efficiency(Tracker(), [](Tracker& tracker) {
    tracker.move();
    return tracker.measured(24, kNoise);
  });
}

TEST(WaysToMeasureLongRun, PlacesOfAPlateWithTwoSockets) {
  expect_coverage_and_efficiency(Ball(), [](Ball& ball) { return ball.touched(4, 40, kNoise); });
}

TEST(WaysToMeasureLongRun, OnePlaceOfAPlate) {
  expect_coverage_and_efficiency(Ball(), [](Ball& ball) { return ball.touched(1, 60, kNoise); });
}

// Each place has one pose at either end of a known length.
TEST(WaysToMeasureCampaign, LengthsBetweenTwoPoses) {
  expect_coverage_and_efficiency(Ball(), [](Ball& ball) { return ball.touched(60, 120, kNoise); });
}

TEST(WaysToMeasureLongRun, HeightsAboveFourPlanes) {
  expect_coverage_and_efficiency(Heights(), [](Heights& heights) {
    heights.move();
    return heights.measured(60, kNoise);
  });
}

TEST(WaysToMeasureLongRun, TouchesOfFourPlanesBesideAKnownLength) {
  expect_coverage_and_efficiency(
      Touches(), [](Touches& touches) { return touches.touched(4, 80, kNoise); }, "Tz2");
}

// Known places of fewer than three anchors leave base rotations open: as with unknown anchors.
TEST(WaysToMeasureLongRun, DistancesFromAnchors) {
  for (const auto& [anchors, known] : {std::pair{1, false}, {2, false}, {3, false}, {3, true}}) {
    SCOPED_TRACE(std::to_string(anchors) + (known ? " known" : " unknown"));
    expect_coverage_and_efficiency(Distances(), [anchors = anchors, known = known](Distances& distances) {
      return distances.measured(anchors, known, 60, kNoise);
    });
  }
}

TEST(WaysToMeasureLongRun, WholePointsBesideDistances) {
  expect_coverage_and_efficiency(Distances(),
                                 [](Distances& distances) { return distances.beside_points(6, 60, kNoise); });
}

}  // namespace
}  // namespace kdl_calibration::ways_to_measure_test
