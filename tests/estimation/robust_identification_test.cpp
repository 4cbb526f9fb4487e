#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/prediction.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Vector3d;

/// Base and targets of an arm whose errors are known; every seventh point is off by up to five millimetres.
struct Spoilt {
  Spoilt() : measured(testing::without_sigmas(arm.measure(20, {.sigma = 5e-5}))) {
    for (std::size_t row = 0; row < measured.observations.size(); ++row) {
      Observation& o = measured.observations[row];
      o.sigma = row % 2 == 0 ? 0.0 : 4e-5;
      o.position.y() += row % 7 == 3 ? 8e-5 * static_cast<double>(row) : 0.0;
    }
    noise.independent = Vector3d(5e-5, 7e-5, 4e-5);
    noise.common = Vector3d(2e-5, 0.0, 3e-5);
  }

  RobustIdentification fitted(Loss loss) const {
    FitProblem problem{.model = arm.model, .measurements = measured, .start = arm.robot.truth, .free = free};
    problem.options.loss = loss;
    problem.options.joint.residuals.noise = noise;
    return identify_robustly(problem);
  }

  std::vector<double> distances(const Estimate& estimate) const {
    const std::vector<Eigen::Isometry3d> X_BF = flange_poses(arm.model, estimate, measured);
    std::vector<double> all;
    for (const Observation& o : measured.observations) {
      const Vector3d e = o.position - predicted_point(estimate, X_BF, o);
      const Vector3d own = o.sigma > 0.0 ? Vector3d::Constant(o.sigma) : noise.independent;
      const Vector3d variance = own.cwiseAbs2() + noise.common.cwiseAbs2();
      all.push_back(std::sqrt(e.cwiseAbs2().cwiseQuotient(variance).sum()));
    }
    return all;
  }

  testing::VirtualExperiment arm;
  Measurements measured;
  NoiseModel noise;
  Unknowns free = Unknowns(arm.model, arm.targets, {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz"});
};

double weight_by_formula(Loss loss, double r) {
  if (loss == Loss::huber) {
    return std::min(1.0, 2.5 / r);
  }
  return loss == Loss::tukey && r < 7.0 ? std::pow(1.0 - r * r / 49.0, 2) : loss == Loss::tukey ? 0.0 : 1.0;
}

TEST(RobustIdentification, WeightsAreThoseOfTheDistancesThatItLeaves) {
  const Spoilt spoilt;
  for (const Loss loss : {Loss::none, Loss::huber, Loss::tukey}) {
    const RobustIdentification found = spoilt.fitted(loss);
    const std::vector<double> expected = spoilt.distances(found.fit.estimate);
    std::vector<double> sorted = expected;
    std::sort(sorted.begin(), sorted.end());
    const double median = 0.5 * (sorted[sorted.size() / 2 - 1] + sorted[sorted.size() / 2]);
    ASSERT_EQ(sorted.size() % 2, 0U);
    EXPECT_NEAR(found.scale, median / 1.5381722544550522, 1e-9 * median);
    double least = 1.0;
    for (std::size_t row = 0; row < expected.size(); ++row) {
      const double r = expected[row] / found.scale;
      EXPECT_NEAR(found.distances[row], r, 1e-6 * (1.0 + r)) << row;
      EXPECT_NEAR(found.weights[row], weight_by_formula(loss, r), 1e-5) << row;
      least = std::min(least, found.weights[row]);
    }
    EXPECT_LT(least, loss == Loss::none ? 1.1 : loss == Loss::huber ? 0.2 : 1e-9);
    EXPECT_EQ(static_cast<int>(found.fit.rms_history.size()), found.fit.iterations);
  }
}

// A row without weight keeps a trace of it.
JointOptions with_weights_of(const RobustIdentification& found, const NoiseModel& noise = {}) {
  JointOptions options{.residuals = {.noise = noise, .row_weights = found.weights}};
  for (double& weight : options.residuals.row_weights) {
    weight = std::max(weight, 1e-9);
  }
  return options;
}

TEST(RobustIdentification, IsTheWeightedFitOfItsOwnWeights) {
  const Spoilt spoilt;
  for (const Loss loss : {Loss::huber, Loss::tukey}) {
    const RobustIdentification found = spoilt.fitted(loss);
    const Identification plain = identify_jointly(spoilt.arm.model, spoilt.measured, spoilt.arm.robot.truth,
                                                  spoilt.free, with_weights_of(found, spoilt.noise));
    EXPECT_LT((plain.estimate.X_WB.matrix() - found.fit.estimate.X_WB.matrix()).cwiseAbs().maxCoeff(), 1e-9);
  }
}

// One step more, by no looser tolerance, leads nowhere, however far off some points are.
TEST(RobustIdentification, FollowsItsLastWeightsToTheEnd) {
  testing::VirtualExperiment arm({.sizes = {.length = 0.003, .angle = 0.02}, .random = Random(7)});
  // All others have full weight, and these so little that the weights settle before the fit does.
  Measurements measured = testing::without_sigmas(arm.measure(20));
  for (Observation& o : measured.observations) {
    for (double& coordinate : o.position) {
      coordinate += arm.random.uniform(-5e-5, 5e-5);
    }
  }
  for (const auto& [row, off] : {std::pair<std::size_t, double>{17, 1e3}, {30, 3e3}, {45, 1e4}}) {
    measured.observations[row].position.y() += off;
  }
  FitProblem problem{.model = arm.model,
                     .measurements = measured,
                     .start = nominal_start(arm.model, measured),
                     .free = arm.free,
                     .options = {}};
  for (const Loss loss : {Loss::huber, Loss::tukey}) {
    problem.options.loss = loss;
    const RobustIdentification found = identify_robustly(problem);
    EXPECT_EQ(found.fit.termination, Termination::converged) << found.fit.message;
    const Identification further =
        identify_jointly(arm.model, measured, found.fit.estimate, arm.free, with_weights_of(found));
    EXPECT_LT(arm.free.difference(found.fit.estimate, further.estimate).cwiseAbs().maxCoeff(), 1e-8);
    const double error = (found.fit.estimate.errors - arm.robot.truth.errors).cwiseAbs().maxCoeff();
    EXPECT_LT(error, loss == Loss::tukey ? 3e-4 : 1e-3);
  }
}

TEST(RobustIdentification, LeavesAsideWhatIsFarOff) {
  const Spoilt spoilt;
  const auto off = [&](Loss loss) {
    const Estimate found = spoilt.fitted(loss).fit.estimate;
    return (found.X_WB.translation() - spoilt.arm.robot.truth.X_WB.translation()).norm();
  };
  EXPECT_LT(off(Loss::tukey), 1e-4);
  EXPECT_GT(off(Loss::none), 3e-4);
}

TEST(RobustIdentification, IsTheFitWhereThereIsALossAndElseTheJointOneIs) {
  const Spoilt spoilt;
  FitProblem problem{
      .model = spoilt.arm.model, .measurements = spoilt.measured, .start = spoilt.arm.robot.truth, .free = spoilt.free};
  problem.options.joint.residuals.noise = spoilt.noise;
  int fits = 0;
  problem.options.after_fit = [&] { ++fits; };
  const Identification joint =
      identify_jointly(spoilt.arm.model, spoilt.measured, spoilt.arm.robot.truth, spoilt.free, problem.options.joint);
  EXPECT_EQ(fit(problem).estimate.X_WB.matrix(), joint.estimate.X_WB.matrix());
  for (const Loss loss : {Loss::huber, Loss::tukey}) {
    problem.options.loss = loss;
    const Eigen::Matrix4d reweighted = spoilt.fitted(loss).fit.estimate.X_WB.matrix();
    EXPECT_EQ(fit(problem).estimate.X_WB.matrix(), reweighted);
    EXPECT_GT((reweighted - joint.estimate.X_WB.matrix()).norm(), 1e-5);
  }
  EXPECT_EQ(fits, 3);
}

TEST(ConvergenceFactor, IsTheGeometricMeanOfTheRatiosBehindTheFirst) {
  EXPECT_NEAR(convergence_factor({50.0, 1.0, 0.2, 0.01}), 0.1, 1e-15);
  EXPECT_NEAR(convergence_factor({50.0, 1.0, 0.2, 0.01, 0.9e-12, 1e-14}), 0.1, 1e-15);
  EXPECT_NEAR(convergence_factor({50.0, 1.0, 0.25}), 0.25, 1e-15);
  EXPECT_NEAR(convergence_factor({50.0, 1.0, 0.25, 1e-3}, 1e-2), 0.25, 1e-15);
  EXPECT_EQ(convergence_factor({50.0, 1.0}), 0.0);
  EXPECT_EQ(convergence_factor({50.0, 1.0, 1e-13}), 0.0);
  EXPECT_EQ(convergence_factor({}), 0.0);
}

}  // namespace
}  // namespace kdl_calibration
