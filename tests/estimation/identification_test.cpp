#include "estimation/identification.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "estimation/prediction.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/kinematics.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "record.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"
#include "whitened_systems.hpp"

namespace kdl_calibration::identification_test {
namespace {

using testing::held_out_rms;
using testing::published_experiment;
using testing::VirtualExperiment;

TEST(Identification, RecoversThePublishedExperimentToRounding) {
  VirtualExperiment experiment = published_experiment();
  int most_iterations = 0;
  double worst = 0.0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    experiment.restart(Random(seed));
    const Measurements measured = experiment.measure(30);
    const Identification found = joint_fit(experiment, measured);
    ASSERT_EQ(found.termination, Termination::converged) << seed << ": " << found.message;
    ASSERT_LE(found.iterations, 8) << seed;
    const double held_out = held_out_rms(experiment, found.estimate, 100);
    ASSERT_LE(held_out, 1e-12) << seed;
    most_iterations = std::max(most_iterations, found.iterations);
    worst = std::max(worst, held_out);
  }
  testing::record("most iterations", most_iterations);
  testing::record("worst held out [m]", worst);
}

TEST(Identification, AveragesNoiseAsTheoryPredicts) {
  // sigma sqrt(33 / 90) = 0.0182 mm is the floor; random configurations come to 0.0207 mm +- 4 %.
  VirtualExperiment experiment = published_experiment();
  double sum = 0.0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    experiment.restart(Random(seed));
    const Measurements measured = experiment.measure(30, {.sigma = 0.00003});
    const Identification found = joint_fit(experiment, measured);
    ASSERT_EQ(found.termination, Termination::converged) << seed << ": " << found.message;
    sum += held_out_rms(experiment, found.estimate, 100);
  }
  const double mean = sum / 200.0;
  testing::record("mean held out [m]", mean);
  EXPECT_NEAR(mean, 0.0000207, 0.04 * 0.0000207);
}

// The normal equations square the condition number, but their gradient comes from the residuals: each step refines what
// the one before left, and the end is where an orthogonal factorisation of the stacked Jacobian would go no further.
TEST(Identification, ReachesTheOptimumOfAnOrthogonalFactorisation) {
  VirtualExperiment experiment = published_experiment(21, {.length = 0.001, .angle = 0.002});
  for (const double range : {1.5, 0.2, 0.05}) {
    experiment.ranges.assign(experiment.model.joints.size(), {0.3 - range, 0.3 + range});
    experiment.restart(Random(21));
    const Measurements measured = experiment.measure(60, {.sigma = 0.00003});
    const Identification found = joint_fit(experiment, measured);
    ASSERT_EQ(found.termination, Termination::converged) << range << ": " << found.message;
    const WhitenedSystem system =
        LeastSquaresProblem(experiment.model, measured, experiment.free).whitened(found.estimate);
    const Eigen::VectorXd scale = system.jacobian.colwise().norm().cwiseInverse();
    const Eigen::MatrixXd scaled = system.jacobian * scale.asDiagonal();
    const Eigen::VectorXd step = Eigen::HouseholderQR<Eigen::MatrixXd>(scaled).solve(system.residual);
    const Eigen::VectorXd singular = Eigen::BDCSVD<Eigen::MatrixXd>(scaled).singularValues();
    const Eigen::VectorXd std = (scaled.transpose() * scaled).inverse().diagonal().cwiseSqrt();
    const double motion = 0.00003 * (scaled * step).norm() / std::sqrt(static_cast<double>(scaled.rows()) / 3.0);
    const double in_sigmas = step.cwiseQuotient(std).cwiseAbs().maxCoeff();
    const std::string of_range = "range " + std::to_string(range);
    testing::record(of_range + ", condition", singular[0] / singular.tail<1>()[0]);
    testing::record(of_range + ", motion [m]", motion);
    testing::record(of_range + ", parameters [sigma]", in_sigmas);
    EXPECT_LT(motion, 1e-13);
    EXPECT_LT(in_sigmas, 1e-6);
  }
}

TEST(Identification, TheOrderOfTheRowsDoesNotMatter) {
  VirtualExperiment experiment = published_experiment(17, {.length = 0.001, .angle = 0.001});
  Measurements sorted = experiment.measure(40, {.sigma = 0.001, .repeats = 2});
  for (Observation& observation : sorted.observations) {
    observation.split = observation.configuration == 5 ? Split::test : Split::train;
  }
  std::erase_if(sorted.observations, [](const Observation& o) {
    return o.configuration == 9 || (o.configuration % 3 == 0 && o.target == 1);  // nothing, and two targets of three
  });
  Measurements mixed = sorted;
  for (std::size_t i = mixed.observations.size(); i > 1; --i) {
    std::swap(mixed.observations[i - 1], mixed.observations[experiment.random.bits() % i]);
  }
  const LeastSquaresProblem problem(experiment.model, mixed, experiment.free);
  const LeastSquaresProblem expected(experiment.model, sorted, experiment.free);
  EXPECT_EQ(problem.equations(), expected.equations());
  EXPECT_NEAR(problem.cost_of_repeats(), expected.cost_of_repeats(), 1e-12 * expected.cost_of_repeats());
  const NormalEquations a = problem.linearise(experiment.robot.truth);
  const NormalEquations b = expected.linearise(experiment.robot.truth);
  EXPECT_NEAR(a.cost, b.cost, 1e-12 * b.cost);
  EXPECT_LT((a.hessian - b.hessian).norm(), 1e-12 * b.hessian.norm());
  EXPECT_LT((a.gradient - b.gradient).norm(), 1e-12 * b.hessian.norm());
  const Eigen::MatrixXd jacobian = problem.whitened(experiment.robot.truth).jacobian;
  EXPECT_LT((jacobian.transpose() * jacobian - a.hessian).norm(), 1e-12 * a.hessian.norm());
}

TEST(Identification, WhatManyCorrelatedPointsSayIsWhatTheirRowsSay) {
  VirtualExperiment experiment = published_experiment(21, {.length = 0.001, .angle = 0.001});
  const int count = static_cast<int>(LeastSquaresProblem::kManyConfigurations) + 13;
  Measurements measured = experiment.measure(count);
  std::erase_if(measured.observations, [](const Observation& o) { return o.configuration % 7 == 3 && o.target == 1; });
  NoiseModel noise;
  noise.independent.setConstant(3e-5);
  noise.misfit = 2e-4;
  noise.target_misfit = 4e-5;
  const Estimate estimate = nominal_start(experiment.model, measured);
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free, {.noise = noise});
  const WhitenedSystem rows = problem.whitened(estimate);
  const NormalEquations found = problem.linearise(estimate);
  testing::expect_equations_of(rows, found, 1e-11, 1e-9);
  EXPECT_NEAR(found.cost, rows.residual.squaredNorm(), 1e-10 * found.cost);
  EXPECT_NEAR(problem.cost(estimate), found.cost, 1e-12 * found.cost);
  testing::expect_same_summary(problem.whitened_summary(estimate), testing::summarised(rows), 1e-10);
  // Of single repeats the configurations' misfit is one common to a repeat, the targets' one of the points.
  NoiseModel as_repeats;
  as_repeats.independent.setConstant(5e-5);
  as_repeats.common.setConstant(2e-4);
  const NormalEquations same =
      LeastSquaresProblem(experiment.model, measured, experiment.free, {.noise = as_repeats}).linearise(estimate);
  EXPECT_LT((found.hessian - same.hessian).norm(), 1e-10 * same.hessian.norm());
  EXPECT_NEAR(found.cost, same.cost, 1e-10 * same.cost);
}

TEST(Identification, RowsOfNoWeightAreAsGoodAsNotThere) {
  VirtualExperiment experiment = published_experiment(17);
  const Measurements all = experiment.measure(12, {.sigma = 0.001, .repeats = 2});
  const auto left_out = [](const Observation& o) { return o.configuration == 4 || o.configuration % 5 == o.target; };
  Measurements some = all;
  std::erase_if(some.observations, left_out);
  ResidualOptions weighted;
  for (const Observation& observation : all.observations) {
    weighted.row_weights.push_back(left_out(observation) ? 0.0 : 1.0);
  }
  // Equal weights of configurations that are alike; of ones that are not; with noise shared by a repeat's points.
  for (const bool alike : {true, false}) {
    for (const double common : {0.0, 0.002}) {
      ResidualOptions plain;
      plain.noise.independent.setConstant(0.001);
      plain.noise.common.setConstant(common);
      weighted.noise = plain.noise;
      Measurements a = all;
      Measurements b = some;
      for (Measurements* m : {&a, &b}) {
        for (Observation& o : m->observations) {
          o.sigma = alike ? 0.001 : 0.001 + 1e-6 * (3 * o.configuration + o.target);
        }
      }
      const LeastSquaresProblem problem(experiment.model, a, experiment.free, weighted);
      const LeastSquaresProblem expected(experiment.model, b, experiment.free, plain);
      const NormalEquations found = problem.linearise(experiment.robot.truth);
      const NormalEquations known = expected.linearise(experiment.robot.truth);
      EXPECT_EQ(problem.equations(), expected.equations());
      EXPECT_NEAR(problem.total_weight(), expected.total_weight(), 1e-12 * expected.total_weight());
      EXPECT_NEAR(found.cost, known.cost, 1e-12 * known.cost);
      EXPECT_LT((found.hessian - known.hessian).norm(), 1e-12 * known.hessian.norm());
    }
  }
}

TEST(Identification, RefusesNoiseThatIsNoCovariance) {
  VirtualExperiment experiment = published_experiment(18);
  const Measurements m = testing::without_sigmas(experiment.measure(30, {.sigma = 1e-4}));
  const auto equations = [&](const Eigen::Vector3d& independent, double common) {
    ResidualOptions options;
    options.noise.independent = independent;
    options.noise.common.setConstant(common);
    return LeastSquaresProblem(experiment.model, m, experiment.free, options).linearise(experiment.robot.truth);
  };
  EXPECT_THROW(equations({1e-4, 0.0, 1e-4}, 0.0), InputError);
  EXPECT_THROW(equations({1e-4, 0.0, 1e-4}, 1e-3), InputError);
  EXPECT_THROW(equations(Eigen::Vector3d::Zero(), 1e-3), InputError);
  EXPECT_THROW(equations(Eigen::Vector3d::Constant(1e-10), 1e-3), InputError);
  EXPECT_TRUE(equations(Eigen::Vector3d::Constant(1e-8), 1e-3).hessian.allFinite());
  EXPECT_TRUE(equations({1e-4, 1e-9, 1e-4}, 0.0).hessian.allFinite());
}

TEST(Identification, ResidualAndGradientVanishAtTheTruth) {
  VirtualExperiment experiment = published_experiment(12);
  const Measurements measured = experiment.measure(10);
  const NormalEquations equations =
      LeastSquaresProblem(experiment.model, measured, experiment.free).linearise(experiment.robot.truth);
  EXPECT_LT(equations.cost, 1e-26);
  EXPECT_LT(equations.gradient.norm(), 1e-12);
}

VirtualExperiment odd_arm_with_a_measured_frame(std::uint64_t seed, const ErrorSizes& sizes) {
  return VirtualExperiment({.model = complete_model(parse_robot(testing::kOddArm)),
                            .targets = testing::as_frames(generic_targets(1)),
                            .sizes = sizes,
                            .random = Random(seed)});
}

TEST(Identification, RecoversMeasuredFramesOfAnOddArm) {
  VirtualExperiment arm = odd_arm_with_a_measured_frame(13, {.length = 0.0025, .angle = 0.02});
  arm.X_WB.translation() = Eigen::Vector3d(5.0, -3.0, 1.0);
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::Vector3d turn = 2.0 * Eigen::Vector3d::NullaryExpr([&] { return arm.random.normal(); });
    arm.X_WB.linear() = rotation_exp(turn);
    arm.draw_robot();
    const Measurements measured = arm.measure(40);
    const Identification found = joint_fit(arm, measured);
    ASSERT_EQ(found.termination, Termination::converged) << found.message;
    ASSERT_LE(held_out_rms(arm, found.estimate, 100), 1e-12);
  }
}

TEST(Identification, RepeatedOrientationsCountWithTheirMean) {
  VirtualExperiment arm = odd_arm_with_a_measured_frame(16, {.length = 0.001, .angle = 0.01});
  const Measurements repeated = arm.measure(20, {.orientation_sigma = 1e-4, .repeats = 3});
  Measurements apart = repeated;  // every repeat as a configuration of its own
  apart.joint_values.resize(repeated.joint_values.rows(), 60);
  apart.configurations.resize(60);
  for (Observation& observation : apart.observations) {
    const Eigen::Index column = 3 * observation.configuration + observation.repeat - 1;
    apart.joint_values.col(column) = repeated.joint_values.col(observation.configuration);
    observation.configuration = static_cast<std::int32_t>(column);
    observation.repeat = 1;
  }
  const Estimate start = nominal_start(arm.model, repeated);
  const Eigen::VectorXd gradient = LeastSquaresProblem(arm.model, repeated, arm.free).linearise(start).gradient;
  const Eigen::VectorXd expected = LeastSquaresProblem(arm.model, apart, arm.free).linearise(start).gradient;
  EXPECT_LT((gradient - expected).norm(), 1e-6 * expected.norm());  // the mean is exact to the square of the noise
}

// Which parameters that leaves open is told by their rank, not by the fit.
TEST(Identification, ArrivesAlsoWhereTheMeasurementsDoNotDetermineAllParameters) {
  VirtualExperiment experiment = published_experiment(14, {.length = 0.001, .angle = 0.001});
  Eigen::MatrixXd q = experiment.configurations(30);
  q.row(4).setZero();  // the fifth joint never moves
  const Measurements measured = experiment.measure(q, {.sigma = 0.00003});
  const Identification found = joint_fit(experiment, measured);
  EXPECT_EQ(found.termination, Termination::converged) << found.message;
  EXPECT_LT(found.rms, 0.0001);
}

TEST(Identification, RefusesFewerEquationsThanUnknowns) {
  VirtualExperiment experiment = published_experiment(15);
  const Measurements measured = experiment.measure(3);
  EXPECT_REFUSED_WITH(::testing::AllOf(::testing::HasSubstr("27"), ::testing::HasSubstr("33")),
                      joint_fit(experiment, measured));
}

TEST(Identification, StopsAtTheIterationLimit) {
  VirtualExperiment experiment = published_experiment(16);
  const Measurements measured = experiment.measure(30);
  const Identification found = joint_fit(experiment, measured, {.max_iterations = 2});
  EXPECT_EQ(found.termination, Termination::iteration_limit);
  EXPECT_EQ(found.iterations, 2);
}

TEST(Identification, StrongPriorsKeepTheNominalGeometry) {
  VirtualExperiment experiment = published_experiment(17, {.length = 0.001, .angle = 0.001});
  const Measurements measured = experiment.measure(30, {.sigma = 0.00003});
  const auto errors = [&](const Priors& priors) {
    return joint_fit(experiment, measured, {.residuals = {.priors = priors}}).estimate.errors;
  };
  EXPECT_LT(errors({.length = 1e-12, .angle = 1e-12}).norm(), 1e-9);
  EXPECT_LT((errors({.length = 10.0, .angle = 10.0}) - errors({})).norm(), 1e-7);
}

// ---- robust --------------------------------------------------------------------------------------------------------

/// Base and targets of an arm whose errors are known; every seventh point is off by up to five millimetres.
struct Spoilt {
  Spoilt() : measured(testing::without_sigmas(arm.measure(20, {.sigma = 5e-5}))) {
    for (std::size_t row = 0; row < measured.observations.size(); ++row) {
      Observation& o = measured.observations[row];
      o.sigma = row % 2 == 0 ? 0.0 : 4e-5;
      o.position().y() += row % 7 == 3 ? 8e-5 * static_cast<double>(row) : 0.0;
    }
    noise.independent = Eigen::Vector3d(5e-5, 7e-5, 4e-5);
    noise.common = Eigen::Vector3d(2e-5, 0.0, 3e-5);
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
      const Eigen::Vector3d e = o.position() - predicted_point(estimate, X_BF, o);
      const Eigen::Vector3d own = o.sigma > 0.0 ? Eigen::Vector3d::Constant(o.sigma) : noise.independent;
      const Eigen::Vector3d variance = own.cwiseAbs2() + noise.common.cwiseAbs2();
      all.push_back(std::sqrt(e.cwiseAbs2().cwiseQuotient(variance).sum()));
    }
    return all;
  }

  VirtualExperiment arm;
  Measurements measured;
  NoiseModel noise;
  Unknowns free = Unknowns(arm.model, arm.targets, {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz"});
};

/// Of Huber's (1964) and Tukey's (Beaton and Tukey 1974) functions.
double published_weight(Loss loss, double r) {
  if (loss == Loss::huber) {
    return std::min(1.0, 2.5 / r);
  }
  return loss == Loss::tukey ? std::pow(std::max(1.0 - r * r / 49.0, 0.0), 2) : 1.0;
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
      EXPECT_NEAR(found.weights[row], published_weight(loss, r), 1e-5) << row;
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
    EXPECT_LT((plain.estimate.frames.base().matrix() - found.fit.estimate.frames.base().matrix()).cwiseAbs().maxCoeff(),
              1e-9);
  }
}

// One step more, by no looser tolerance, leads nowhere, however far off some points are.
TEST(RobustIdentification, FollowsItsLastWeightsToTheEnd) {
  VirtualExperiment arm({.sizes = {.length = 0.003, .angle = 0.02}, .random = Random(7)});
  // All others have full weight, and these so little that the weights settle before the fit does.
  Measurements measured = testing::without_sigmas(arm.measure(20));
  for (Observation& o : measured.observations) {
    for (double& coordinate : o.position()) {
      coordinate += arm.random.uniform(-5e-5, 5e-5);
    }
  }
  for (const auto& [row, off] : {std::pair<std::size_t, double>{17, 1e3}, {30, 3e3}, {45, 1e4}}) {
    measured.observations[row].position().y() += off;
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
    return (found.frames.base().translation() - spoilt.arm.robot.truth.frames.base().translation()).norm();
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
  EXPECT_EQ(fit(problem).estimate.frames.base().matrix(), joint.estimate.frames.base().matrix());
  for (const Loss loss : {Loss::huber, Loss::tukey}) {
    problem.options.loss = loss;
    const Eigen::Matrix4d reweighted = spoilt.fitted(loss).fit.estimate.frames.base().matrix();
    EXPECT_EQ(fit(problem).estimate.frames.base().matrix(), reweighted);
    EXPECT_GT((reweighted - joint.estimate.frames.base().matrix()).norm(), 1e-5);
  }
  EXPECT_EQ(fits, 3);
}

}  // namespace
}  // namespace kdl_calibration::identification_test
