// Monte Carlo over all ways to measure: the intervals and radii cover, and no unbiased estimate from the same data
// would be better.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <iostream>
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
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::bundled_robot;
using testing::kNoise;
using testing::VirtualExperiment;

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
    const Eigen::Map<const VectorXd> off(errors.data(), std::ssize(errors));
    const MatrixXd least = least_covariance(parts, measurements)(columns, columns);
    squares += off.dot(least.ldlt().solve(off));
    parameters += static_cast<double>(errors.size());
  }
  void add_points(const Calibration& found, VirtualExperiment& experiment) {
    const MatrixXd q = experiment.configurations(9);
    const Eigen::Matrix3Xd truth = testing::points(experiment.robot.model, experiment.robot.truth, q);
    const std::vector<TargetFrame>& targets = experiment.robot.truth.targets;
    for (Index point = 0; point < truth.cols(); ++point) {
      const auto count = static_cast<Index>(targets.size());
      const PredictedPoint predicted =
          found.arm().predict(q.col(point / count), targets[static_cast<std::size_t>(point % count)].name);
      const Vector3d measured = truth.col(point) + kNoise * normal_vector(experiment.random);
      inside_radius += (predicted.position - measured).norm() < predicted.radius_95 ? 1.0 : 0.0;
      points += 1.0;
    }
  }
};

// Runs the experiment so often. The true errors are those of the reduced model, so that their gauge is that of the
// estimate. `known`: the name of an error that is zero and held.
template <class Experiment>
void expect_coverage_and_efficiency(int runs, const std::string& known,
                                    const std::function<Measurements(Experiment&)>& measured) {
  Experiment experiment;
  CalibrationOptions options = testing::geometry_alone();
  if (!known.empty()) {
    options.parameters.fix = {known};
  }
  Statistics sum;
  for (int run = 0; run < runs; ++run) {
    experiment.restart(Random(13, static_cast<std::uint64_t>(run)));
    if (!known.empty()) {
      experiment.robot.truth.errors[static_cast<Index>(parameter_index(experiment.model, known))] = 0.0;
    }
    const Measurements measurements = measured(experiment);
    const Calibration found = calibrate(bundled_robot(), measurements, options);
    sum.add_parameters(found, experiment.robot, measurements);
    sum.add_points(found, experiment);
  }
  const std::string figures = std::to_string(sum.inside / sum.parameters) + " of parameters, " +
                              std::to_string(sum.inside_radius / sum.points) + " of points, efficiency " +
                              std::to_string(sum.parameters / sum.squares);
  SCOPED_TRACE(figures);
  std::cout << figures << "\n";
  const double chance = std::sqrt(2.0 / sum.parameters);                     // 1 sigma of the mean of so many squares
  const double off = 0.005 + 4.0 * std::sqrt(0.95 * 0.05 / sum.parameters);  // they depend on each other
  EXPECT_NEAR(sum.inside / sum.parameters, 0.95, off);
  EXPECT_NEAR(sum.inside_radius / sum.points, 0.95, off);
  EXPECT_GT(sum.parameters / sum.squares, 0.98 - 2.0 * chance);
}

void expect_coverage_and_efficiency_of_each(int runs) {
  expect_coverage_and_efficiency<testing::Tracker>(runs, {}, [](testing::Tracker& experiment) {
    experiment.move();
    return experiment.measured(24, kNoise);
  });
  expect_coverage_and_efficiency<testing::Ball>(
      runs, {}, [](testing::Ball& experiment) { return experiment.touched(4, 40, kNoise); });
  expect_coverage_and_efficiency<testing::Heights>(runs, {}, [](testing::Heights& experiment) {
    experiment.move();
    return experiment.measured(60, kNoise);
  });
  expect_coverage_and_efficiency<testing::Touches>(
      runs, "Tz2", [](testing::Touches& experiment) { return experiment.touched(4, 80, kNoise); });
  // Fewer known anchors than three leave rotations of the base open, as unknown ones do.
  for (const std::pair<int, bool>& anchors : {std::pair(1, false), {2, false}, {3, false}, {3, true}}) {
    expect_coverage_and_efficiency<testing::Distances>(runs, {}, [&](testing::Distances& experiment) {
      return experiment.measured(anchors.first, anchors.second, 60, kNoise);
    });
  }
  expect_coverage_and_efficiency<testing::Distances>(
      runs, {}, [](testing::Distances& experiment) { return experiment.beside_points(6, 60, kNoise); });
}

TEST(WaysToMeasureLongRun, CoverAndAreEfficient) { expect_coverage_and_efficiency_of_each(60); }
TEST(WaysToMeasureCampaign, CoverAndAreEfficient) { expect_coverage_and_efficiency_of_each(1000); }

}  // namespace
}  // namespace kdl_calibration::ways_to_measure_test
