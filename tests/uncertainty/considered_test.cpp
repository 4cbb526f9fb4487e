#include "uncertainty/considered.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <functional>
#include <utility>

#include "estimation/identification.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/prediction.hpp"
#include "interface/ways_to_measure.hpp"
#include "uncertainty/covariance.hpp"

namespace kdl_calibration::considered_test {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// A fit at its end.
struct Ended {
  Measurements measurements;
  Unknowns free;
  FitProblem problem;

  Ended(const testing::VirtualExperiment& experiment, Measurements rows, const ErrorModel& model)
      : measurements(std::move(rows)),
        free(model, nominal_start(model, measurements).frames.targets, experiment.reduction.kept),
        problem{
            .model = model, .measurements = measurements, .start = nominal_start(model, measurements), .free = free} {
    problem.start = fit(problem).estimate;
  }
  MatrixXd steps(const AssumedSigmas& sigmas) const {
    const WhitenedSummary system =
        LeastSquaresProblem(problem.model, measurements, free, {}).whitened_summary(problem.start);
    return considered_steps(problem, covariance(system.sqrt_information, 1.0), sigmas);
  }
  // By how much a fit to other rows ends elsewhere.
  VectorXd refitted(const std::function<void(Observation&)>& disturb) const {
    Measurements rows = measurements;
    for (Observation& row : rows.observations) {
      disturb(row);
    }
    const Estimate end = fit(with_measurements(problem, rows)).estimate;
    VectorXd step = free.values(end) - free.values(problem.start);
    // A base moves in its own frame.
    const Eigen::Isometry3d motion = problem.start.frames.base().inverse() * end.frames.base();
    const Eigen::AngleAxisd turn(motion.linear());
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      step[free.base_columns(0)[static_cast<std::size_t>(axis)]] = motion.translation()[axis];
      step[free.base_columns(0)[static_cast<std::size_t>(3 + axis)]] = turn.angle() * turn.axis()[axis];
    }
    return step;
  }
};

// The oracle is a fit to disturbed rows.
TEST(Considered, AScaleMovesTheEstimateAsAFitToScaledPointsDoes) {
  testing::VirtualExperiment experiment;
  const Ended ended(experiment, testing::without_sigmas(experiment.measure(30, {.sigma = 2e-5})), experiment.model);
  Vector3d middle = Vector3d::Zero();
  for (const Observation& row : ended.measurements.observations) {
    middle += row.position() / static_cast<double>(ended.measurements.observations.size());
  }
  const double sigma = 2e-5;
  const MatrixXd steps = ended.steps({.scale = sigma, .length = 1e-3});
  ASSERT_EQ(steps.cols(), 1) << "measured places are not stated ones";
  const VectorXd expected =
      ended.refitted([&](Observation& row) { row.position() += sigma * (row.position() - middle); });
  EXPECT_LT((steps.col(0) - expected).norm(), 2e-3 * expected.norm());
}

// Each distance is that of its point, moved about the middle of all points, from the anchor.
TEST(Considered, AScaleMovesTheEstimateAsDistancesOfScaledPointsDo) {
  testing::Distances experiment(2);
  const Ended ended(experiment, experiment.measured(3, true, 80, 1e-5), experiment.model);
  const Estimate& end = ended.problem.start;
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(ended.problem.model, end, ended.measurements);
  std::vector<Vector3d> points;
  Vector3d middle = Vector3d::Zero();
  for (const Observation& row : ended.measurements.observations) {
    points.push_back(predicted_point(end, X_BF, row));
    middle += points.back() / static_cast<double>(ended.measurements.observations.size());
  }
  const double sigma = 2e-5;
  const MatrixXd steps = ended.steps({.scale = sigma});
  ASSERT_EQ(steps.cols(), 1);
  std::size_t next = 0;
  const VectorXd expected = ended.refitted([&](Observation& row) {
    const Vector3d& point = points[next++];
    auto& distance = std::get<Distance>(row.reading);
    distance.length += (point + sigma * (point - middle) - distance.anchor).norm() - (point - distance.anchor).norm();
  });
  EXPECT_LT((steps.col(0) - expected).norm(), 5e-3 * expected.norm());
}

TEST(Considered, EachSocketIsOffAlongEachAxisInAllItsPlaces) {
  testing::Ball ball(2);
  const Measurements touched = ball.touched(1, 60, 1e-5, {{0.0, 0.0, 0.0}, {0.4, 0.0, 0.0}, {0.1, 0.5, 0.2}});
  const Ended ended(ball, touched, ball.model);
  const double length = 3e-5;
  const MatrixXd steps = ended.steps({.length = length});
  ASSERT_EQ(steps.cols(), 9);
  const double of_place = length / std::sqrt(2.0);
  const VectorXd expected = ended.refitted(
      [&](Observation& row) { row.position().y() += row.position() == Vector3d(0.1, 0.5, 0.2) ? of_place : 0.0; });
  double nearest = 1.0;
  for (const auto& step : steps.colwise()) {
    nearest = std::min(nearest, (step - expected).norm() / expected.norm());
  }
  EXPECT_LT(nearest, 5e-3);
  EXPECT_EQ(ended.steps({}).cols(), 0);
}

// Whole points have no zero, and distances from one have one column.
TEST(Considered, TheZeroOfDistancesMovesTheEstimateAsLongerOnesDo) {
  testing::Distances experiment(2);
  const Measurements rows = experiment.measured(3, true, 80, 1e-5);
  const Ended ended(experiment, rows, experiment.model);
  const double zero = 2e-5;
  const MatrixXd steps = ended.steps({.zero = zero});
  ASSERT_EQ(steps.cols(), 1);
  const VectorXd expected = ended.refitted([&](Observation& row) { std::get<Distance>(row.reading).length += zero; });
  EXPECT_LT((steps.col(0) - expected).norm(), 5e-3 * expected.norm());
}

}  // namespace
}  // namespace kdl_calibration::considered_test
