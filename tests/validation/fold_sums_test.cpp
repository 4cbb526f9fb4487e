#include "validation/fold_sums.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

#include "planning/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::fold_sums_test {
namespace {

using Eigen::Index;
using Folds = std::vector<std::vector<Index>>;

const Folds kFolds = {{0, 3, 6, 9, 12, 15, 18}, {1, 4, 7, 10, 13, 16, 19}, {2, 5, 8, 11, 14, 17}};

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
      for (double& coordinate : o.position()) {
        coordinate += size * again.random.uniform(-1.0, 1.0);
      }
    }
    return result;
  }
};

// Refits without each fold are the oracle.
TEST(FoldSums, PredictFoldsAsRefitsDo) {
  testing::VirtualExperiment arm;
  const Measurements measured = arm.measure(20, {.sigma = 0.00003, .repeats = 2});
  std::vector<FitOptions> ways(3);
  ways[1].joint.residuals.priors = {.length = 1e-3, .angle = 1e-3};
  ways[2].joint.residuals.noise = {.independent = Eigen::Vector3d(1e-5, 2e-5, 3e-5),
                                   .common = Eigen::Vector3d::Constant(2e-5)};
  for (const FitOptions& way : ways) {
    FitProblem problem{.model = arm.model,
                       .measurements = measured,
                       .start = nominal_start(arm.model, measured),
                       .free = arm.free,
                       .options = way};
    problem.start = fit(problem).estimate;
    Folds without_some = kFolds;  // which every fold's fit keeps
    without_some[1].resize(4);
    for (const Folds& folds : {kFolds, without_some}) {
      const HoldOut refitted = cross_validate(problem, folds, 1);
      const HoldOut summed = cross_validate_by_sums(problem, folds, 3e-5, 2);
      EXPECT_EQ(summed.refits, 3);
      EXPECT_EQ(summed.not_converged, 0);
      ASSERT_EQ(summed.distances.size(), refitted.distances.size());
      for (std::size_t i = 0; i < summed.distances.size(); ++i) {
        EXPECT_NEAR(summed.distances[i], refitted.distances[i], 1e-9);
      }
      const std::vector<double> fitted = position_errors(arm.model, problem.start, averaged(measured));
      EXPECT_GT(error_statistics(summed.distances).rms, 1.2 * error_statistics(fitted).rms);
    }
  }
}

TEST(FoldSums, SayWhereTheyDoNotSettle) {
  const Problem close(1e-3);
  EXPECT_EQ(cross_validate_by_sums(close.problem, kFolds, 1e-3, 1).not_converged, 0);
  const Problem far(0.3);  // so wrong that steps hardly become smaller
  EXPECT_EQ(cross_validate_by_sums(far.problem, kFolds, 1e-6, 1).not_converged, 3);
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
}  // namespace kdl_calibration::fold_sums_test
