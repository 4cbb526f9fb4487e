// Folds predicted from sums against Gauss-Newton steps written out.

#include "kdl_calibration/fold_sums.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <atomic>
#include <cmath>

#include "kdl_calibration/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Folds = std::vector<std::vector<Index>>;

const Folds kFolds = {{0, 3, 6, 9, 12, 15, 18}, {1, 4, 7, 10, 13, 16, 19}, {2, 5, 8, 11, 14, 17}};

// What so many Gauss-Newton steps without a fold leave of its points, and how far each moved the others' [m].
struct Stepped {
  std::vector<double> distances;
  std::vector<double> effects;

  Stepped(const FitProblem& problem, const std::vector<Index>& fold, int steps) {
    const auto in_fold = [&](const Observation& o) {
      return std::find(fold.begin(), fold.end(), o.configuration) != fold.end();
    };
    const Measurements others = subset(problem.measurements, [&](const Observation& o) { return !in_fold(o); });
    const LeastSquaresProblem equations(problem.model, others, problem.free, problem.options.joint.residuals);
    Estimate estimate = problem.start;
    for (int step = 0; step < steps; ++step) {
      const WhitenedSystem system = equations.whitened(estimate);
      const VectorXd scale = system.jacobian.colwise().norm().cwiseInverse();
      const MatrixXd scaled = system.jacobian * scale.asDiagonal();
      const VectorXd move = scale.cwiseProduct(scaled.householderQr().solve(system.residual));
      effects.push_back((system.jacobian * move).norm() / std::sqrt(equations.total_weight()));
      estimate = problem.free.moved(estimate, move);
    }
    distances = position_errors(problem.model, estimate, averaged(subset(problem.measurements, in_fold)));
  }
};

// Measurements that are off by up to `size` [m] whatever the arm is, from the nominal start.
struct Problem {
  Measurements measured;
  FitProblem problem;

  explicit Problem(double size)
      : measured(off_by(size)),
        problem{.model = arm().model,
                .measurements = measured,
                .start = nominal_start(arm().model, measured),
                .free = arm().free} {}
  Problem(const Problem&) = delete;
  Problem& operator=(const Problem&) = delete;

private:
  static const testing::VirtualExperiment& arm() {
    static const testing::VirtualExperiment experiment;
    return experiment;
  }

  static Measurements off_by(double size) {
    testing::VirtualExperiment again = arm();
    Measurements result = testing::without_sigmas(again.measure(20));
    for (Observation& o : result.observations) {
      for (double& coordinate : o.position) {
        coordinate += size * again.random.uniform(-1.0, 1.0);
      }
    }
    return result;
  }
};

void expect_steps(const FitProblem& problem, double noise, int steps, bool settled) {
  const HoldOut found = cross_validate_by_sums(problem, kFolds, noise, 1);
  std::vector<double> expected;
  for (const std::vector<Index>& fold : kFolds) {
    const std::vector<double> own = Stepped(problem, fold, steps).distances;
    expected.insert(expected.end(), own.begin(), own.end());
  }
  ASSERT_EQ(found.distances.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_NEAR(found.distances[i], expected[i], 1e-9) << i;
  }
  EXPECT_EQ(found.refits, 3);
  EXPECT_EQ(found.not_converged, settled ? 0 : 3);
}

TEST(FoldSums, StepUntilPointsMoveByLessThanAThousandthOfTheNoise) {
  const Problem p(1e-3);
  double least = 1.0;
  double largest = 0.0;
  for (const std::vector<Index>& fold : kFolds) {
    const Stepped twice(p.problem, fold, 2);
    least = std::min(least, twice.effects[0]);
    largest = std::max(largest, twice.effects[0]);
    EXPECT_GT(twice.effects[1], 1e-7) << "a second step can be seen";
    EXPECT_LT(twice.effects[1], 0.01 * twice.effects[0]);
  }
  expect_steps(p.problem, 1.05 * largest / 1e-3, 1, true);
  expect_steps(p.problem, 0.95 * least / 1e-3, 2, true);
}

// Beside noise of a millimetre they are what decides.
TEST(FoldSums, HavePriorsOnce) {
  Problem p(1e-3);
  p.problem.options.joint.residuals.noise.independent.setConstant(1e-3);
  const std::vector<double> without = Stepped(p.problem, kFolds[0], 1).distances;
  p.problem.options.joint.residuals.priors = {.length = 1e-4, .angle = 2e-4};
  const std::vector<double> with = Stepped(p.problem, kFolds[0], 1).distances;
  EXPECT_GT(std::abs(with[0] - without[0]), 1e-5);
  expect_steps(p.problem, 1e3, 1, true);
  p.problem.start.errors.setConstant(1e-4);
  expect_steps(p.problem, 1e3, 1, true);
}

TEST(FoldSums, StepAtMostTenTimes) {
  const Problem p(0.3);  // so wrong that every step is a tenth of the one before, or more
  const Stepped steps(p.problem, kFolds[0], 11);
  ASSERT_GT(steps.effects[10], 1e-8);
  ASSERT_LT(steps.effects[10], 1e-2);
  expect_steps(p.problem, 1e-6, 10, false);
}

// The size of the errors is sought with which the tenth step moves points by this [m].
double size_whose_tenth_step_is(double wanted) {
  double below = 1e-3;
  double above = 0.3;
  for (int halving = 0; halving < 14; ++halving) {
    const double middle = std::sqrt(below * above);
    (Stepped(Problem(middle).problem, kFolds[1], 10).effects.back() < wanted ? below : above) = middle;
  }
  return std::sqrt(below * above);
}

TEST(FoldSums, SettleAtAHundredthOfANanometreWithoutNoise) {
  for (const double tenth : {0.6e-11, 1.7e-11}) {
    const Problem p(size_whose_tenth_step_is(tenth));
    const Folds fold = {kFolds[1]};
    const double effect = Stepped(p.problem, kFolds[1], 10).effects.back();
    ASSERT_NEAR(effect / tenth, 1.0, 0.3);
    const Folds both = {kFolds[1], {0, 2, 3, 5, 6, 8, 9, 11, 12, 14, 15, 17, 18}};
    const HoldOut found = cross_validate_by_sums(p.problem, both, 0.0, 1);
    const int other = Stepped(p.problem, both[1], 10).effects.back() > 1e-11 ? 1 : 0;
    EXPECT_EQ(found.not_converged - other, tenth > 1e-11 ? 1 : 0) << tenth;
  }
}

TEST(FoldSums, CallBehindEachFold) {
  Problem p(1e-3);
  std::atomic<int> fits = 0;
  p.problem.options.after_fit = [&] { ++fits; };
  cross_validate_by_sums(p.problem, kFolds, 1e-3, 2);
  EXPECT_EQ(fits, 3);
}

TEST(FoldSums, OfOneFoldKnowNothingAndSaySo) {
  const Problem p(1e-3);
  Folds all(1);
  for (Index c = 0; c < 20; ++c) {
    all[0].push_back(c);
  }
  const HoldOut found = cross_validate_by_sums(p.problem, all, 1e-3, 1);
  EXPECT_EQ(found.refits, 1);
  EXPECT_EQ(found.not_converged, 1);
  EXPECT_EQ(found.distances, position_errors(p.problem.model, p.problem.start, p.measured)) << "from the start";
}

}  // namespace
}  // namespace kdl_calibration
