#include "estimation/descent.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "dense_fit.hpp"
#include "model/parameters.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::descent_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::VirtualExperiment;

double stretched(const ErrorModel& model) {
  double length = 0.0;
  for (const MovingJoint& joint : model.joints) {
    length += joint.origin.p.Norm();
  }
  return length + model.tip_origin.p.Norm();
}

/// The arm with errors of this many millimetres and milliradians, as large as `scale` makes it.
struct Case {
  double size;
  double noise;
  int configurations;
  double scale = 1.0;
  bool wrong = false;  // one joint measured with the opposite sign
};

/// What was measured of such an arm, on odd seeds of points, on even ones of frames.
struct Task {
  VirtualExperiment experiment;
  Measurements measured;
  Estimate start;
  LeastSquaresProblem problem;

  Task(const Case& how, unsigned seed)
      : experiment(arm(how, seed)),
        measured(measured_by(experiment, how)),
        start(nominal_start(experiment.model, measured)),
        problem(experiment.model, measured, experiment.free) {}
  Task(const Task&) = delete;
  Task& operator=(const Task&) = delete;

private:
  static VirtualExperiment arm(const Case& how, unsigned seed) {
    ErrorModel model = complete_model(testing::fanuc());
    for (MovingJoint& joint : model.joints) {
      joint.origin.p = how.scale * joint.origin.p;
    }
    return VirtualExperiment({.model = model,
                              .targets = seed % 2 == 0 ? testing::as_frames(testing::targets_at({{0.1, 0.2, 0.05}}))
                                                       : testing::circle_of_targets(),
                              .sizes = {.length = 1e-3 * how.size * how.scale, .angle = 1e-3 * how.size},
                              .X_WB = Eigen::Isometry3d(Eigen::Translation3d(3.0, 0.5, 0.2)),
                              .random = Random(seed)});
  }
  static Measurements measured_by(VirtualExperiment& experiment, const Case& how) {
    const bool frames = experiment.targets.front().with_orientation;
    Measurements measured = experiment.measure(
        how.configurations, {.sigma = how.noise, .orientation_sigma = frames ? 10.0 * how.noise : 0.0});
    if (how.wrong) {
      measured.joint_values.row(2) *= -1.0;
    }
    return measured;
  }
};

const std::vector<Case>& cases() {
  static const std::vector<Case> all = {{.size = 0.5, .noise = 3e-5, .configurations = 12},
                                        {.size = 5.0, .noise = 0.0, .configurations = 20},
                                        {.size = 30.0, .noise = 2e-3, .configurations = 15},
                                        {.size = 100.0, .noise = 2e-2, .configurations = 16},
                                        {.size = 200.0, .noise = 1e-4, .configurations = 20},
                                        {.size = 300.0, .noise = 1e-4, .configurations = 14},
                                        {.size = 50.0, .noise = 1e-4, .configurations = 14, .scale = 15.0},
                                        {.size = 5.0, .noise = 1e-3, .configurations = 16, .wrong = true}};
  return all;
}

/// How far a Gauss-Newton step would move the predicted points [m], root mean square: the gradient as a length.
double gradient_as_motion(const LeastSquaresProblem& problem, const Estimate& estimate) {
  const NormalEquations at = problem.linearise(estimate);
  const VectorXd scale = at.hessian.diagonal().cwiseSqrt().cwiseInverse();
  const MatrixXd scaled = scale.asDiagonal() * at.hessian * scale.asDiagonal();
  const VectorXd gradient = scale.cwiseProduct(at.gradient);
  return std::sqrt(gradient.dot(scaled.completeOrthogonalDecomposition().solve(gradient)) / problem.total_weight());
}

TEST(Descent, CostNeverRisesAndTheGradientVanishesAtTheEnd) {
  int converged = 0;
  unsigned seed = 0;
  for (const Case& how : cases()) {
    for (int frames = 0; frames < 2; ++frames) {
      const Task task(how, ++seed);
      for (const Steps steps : {Steps::any, Steps::plain, Steps::prior}) {
        SCOPED_TRACE("seed " + std::to_string(seed) + ", steps " + std::to_string(static_cast<int>(steps)));
        const Identification found = descend(task.problem, task.start, {}, steps);
        const double start = std::sqrt(task.problem.cost(task.start) / task.problem.total_weight());
        double before = start;
        ASSERT_EQ(found.iterations, static_cast<int>(found.rms_history.size()));
        for (const double rms : found.rms_history) {
          EXPECT_LE(rms, before * (1.0 + 1e-9) + 1e-12);
          before = rms;
        }
        EXPECT_LE(found.rms, before * (1.0 + 1e-9) + 1e-12);
        EXPECT_NEAR(found.rms, std::sqrt(task.problem.cost(found.estimate) / task.problem.total_weight()),
                    1e-9 * found.rms + 1e-12);
        EXPECT_FALSE(found.message.empty());
        if (steps == Steps::any && found.termination == Termination::converged) {
          ++converged;
          EXPECT_LT(gradient_as_motion(task.problem, found.estimate), 1e-8 * how.scale);
        }
      }
    }
  }
  EXPECT_GT(converged, 10) << "no fair test";
}

TEST(Descent, ReachesTheTruthWithoutNoiseAndTheOptimumOfTheDenseFitWithIt) {
  const Task exact({.size = 100.0, .noise = 0.0, .configurations = 20}, 1);
  const Identification found = descend(exact.problem, exact.start, {});
  EXPECT_EQ(found.termination, Termination::converged) << found.message;
  EXPECT_LT(exact.experiment.free.difference(exact.experiment.robot.truth, found.estimate).cwiseAbs().maxCoeff(), 1e-8);
  const Task noisy({.size = 5.0, .noise = 1e-4, .configurations = 16}, 1);
  const Measurements plain = testing::without_sigmas(noisy.measured);
  const LeastSquaresProblem problem(noisy.experiment.model, plain, noisy.experiment.free);
  const testing::DenseFit dense(
      noisy.experiment.model, plain, noisy.experiment.free,
      {.position = [](const Observation&) { return Eigen::Matrix3d::Identity().eval(); }, .orientation = {}});
  const Estimate optimum = dense.fit(noisy.experiment.robot.truth);
  const Estimate ours = descend(problem, noisy.start, {}).estimate;
  EXPECT_LT(noisy.experiment.free.difference(optimum, ours).cwiseAbs().maxCoeff(), 1e-7);
}

// Turned and moved together, tracker and base are the same experiment.
TEST(Descent, DoesNotDependOnWhereTheTrackerStands) {
  const Task task({.size = 30.0, .noise = 1e-4, .configurations = 16}, 3);
  const Eigen::Isometry3d X = Eigen::Translation3d(-2.0, 5.0, 1.0) * Eigen::AngleAxisd(2.0, Vector3d(1, 2, 2) / 3.0);
  Measurements moved = task.measured;
  for (Observation& o : moved.observations) {
    o.position() = X * o.position();
  }
  const LeastSquaresProblem elsewhere(task.experiment.model, moved, task.experiment.free);
  const Identification here = descend(task.problem, task.start, {});
  const Identification there = descend(elsewhere, nominal_start(task.experiment.model, moved), {});
  EXPECT_EQ(there.termination, here.termination);
  EXPECT_EQ(there.message, here.message);
  EXPECT_NEAR(there.rms, here.rms, 1e-9 * here.rms);
  EXPECT_LT((there.estimate.errors - here.estimate.errors).cwiseAbs().maxCoeff(), 1e-8);
  EXPECT_LT((there.estimate.frames.base().matrix() - (X * here.estimate.frames.base()).matrix()).cwiseAbs().maxCoeff(),
            1e-8);
}

TEST(Descent, GivesUpOnAGoalThatItCannotReachAndIgnoresOneThatTheStartMeets) {
  const Task task({.size = 5.0, .noise = 1e-3, .configurations = 16, .wrong = true}, 1);
  const Identification plain = descend(task.problem, task.start, {});
  const Identification in_vain =
      descend(task.problem, task.start, {.max_iterations = 50, .goal = 0.01 * plain.rms, .residuals = {}});
  EXPECT_LT(in_vain.iterations, plain.iterations);
  EXPECT_GT(in_vain.rms, 0.01 * plain.rms);
  EXPECT_NE(in_vain.message.find("goal"), std::string::npos) << in_vain.message;
  const Identification met = descend(task.problem, task.start,
                                     {.max_iterations = 50, .goal = 2.0 * plain.rms_history.front(), .residuals = {}});
  EXPECT_EQ(met.message, plain.message);
  EXPECT_EQ(met.rms_history, plain.rms_history);
}

// How many steps that takes is up to the rounding itself.
TEST(Descent, EndsAtItsRoundingWhereNoMotionIsSmallEnough) {
  VirtualExperiment experiment({.random = Random(5)});
  const Measurements measured = experiment.measure(16, {.sigma = 1e-4});
  const Estimate start = nominal_start(experiment.model, measured);
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free);
  const Identification usual = descend(problem, start, {});
  const Identification found = descend(problem, start, {.max_iterations = 50, .step_tolerance = 0.0, .residuals = {}});
  EXPECT_EQ(found.message, "no step can reduce the misfit by more than its rounding");
  EXPECT_EQ(found.termination, Termination::converged);
  EXPECT_LT(found.iterations, usual.iterations + 6);
  EXPECT_NEAR(found.rms, usual.rms, 1e-14);
}

TEST(Descent, PromisesAllOfTheCostWhereErrorsAreUsualAndNothingAtTheOptimum) {
  const Task exact({.size = 0.5, .noise = 0.0, .configurations = 20}, 1);
  EXPECT_NEAR(predicted_share(exact.problem, exact.start), 1.0, 0.05);
  const Task noisy({.size = 0.5, .noise = 1e-4, .configurations = 20}, 1);
  const double promised = predicted_share(noisy.problem, noisy.start);
  const Identification found = descend(noisy.problem, noisy.start, {});
  const double taken = 1.0 - noisy.problem.cost(found.estimate) / noisy.problem.cost(noisy.start);
  EXPECT_LE(promised, taken + 1e-3) << "a prior holds back";
  EXPECT_GT(promised, taken - 0.2);
  EXPECT_NEAR(predicted_share(noisy.problem, found.estimate), 0.0, 1e-2);
}

// A radian, and half of the arm as it is stretched out, its slides included; of a small one half a metre.
TEST(Descent, RunsAwayBeyondWhatNoRobotIsOffBy) {
  for (const double scale : {1.0, 0.1}) {
    ErrorModel model = complete_model(parse_robot(testing::kOddArm));
    for (MovingJoint& joint : model.joints) {
      joint.origin.p = scale * joint.origin.p;
    }
    VirtualExperiment experiment({.model = model, .sizes = {.length = 0.0, .angle = 0.0}});
    const double half = 0.5 * (stretched(experiment.model) + 0.5);
    for (const std::size_t p : experiment.free.geometric()) {
      const bool length = is_length(experiment.model, experiment.model.parameters[p]);
      const double limit = length ? std::max(half, 0.5) : 1.0;
      for (const double share : {-1.001, -0.999, 0.999, 1.001}) {
        experiment.robot.truth.errors.setZero();
        experiment.robot.truth.errors[static_cast<Index>(p)] = share * limit;
        const Measurements measured = experiment.measure(20);
        const LeastSquaresProblem problem(experiment.model, measured, experiment.free);
        const Identification found = descend(problem, experiment.robot.truth, {});
        const bool beyond = std::abs(share) > 1.0;
        EXPECT_EQ(found.termination, beyond ? Termination::diverged : Termination::converged)
            << experiment.model.parameters[p].name << " " << share << " " << found.message;
        if (beyond) {
          EXPECT_EQ(found.message, length ? "the fit ran away: a length is off by more than half the arm"
                                          : "the fit ran away: an angle is off by more than a radian");
        }
      }
    }
  }
}

}  // namespace
}  // namespace kdl_calibration::descent_test
