#include "estimation/least_squares.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cstdlib>
#include <thread>

#include "counted_allocations.hpp"
#include "dense_fit.hpp"
#include "effects/arm_kinematics.hpp"
#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/identification.hpp"
#include "estimation/residual_options.hpp"
#include "measurements/drive_signals.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "robot/joint_ranges.hpp"
#include "virtual_experiment.hpp"
#include "whitened_systems.hpp"

namespace kdl_calibration::least_squares_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// What is measured and estimated decides which pass goes over the data: side by side, or block by block.
struct Case {
  const char* name;
  bool effects = false;       // in the model
  bool free_effects = false;  // and to be estimated
  bool orientations = false;
  double common = 0.0;      // [m]
  bool by_axis = false;     // noise of another size along each
  bool tracker = false;     // noise along and across its line of sight
  bool own_sigmas = false;  // stated of some rows
};

constexpr double kSigma = 1e-4;
constexpr double kOrientationSigma = 3e-4;

class LeastSquares : public ::testing::TestWithParam<Case> {
protected:
  LeastSquares() {
    if (GetParam().effects) {
      model.effects = gain_terms(model);
      Random random(11);
      const MatrixXd q = random_configurations(published_ranges(model.joints), 40, random);
      for (const EffectGroup group : {EffectGroup::gravity, EffectGroup::transverse}) {
        const std::vector<EffectTerm> terms = effect_terms(model, group, q);
        model.effects.insert(model.effects.end(), terms.begin(), terms.end());
      }
      for (const char* joint : {"joint_2", "joint_4"}) {  // links that grow with the third joint's value
        const OwnEffect growth{
            .name = joint, .joint = joint, .axis = EffectAxis::along, .columns = [](const MatrixXd& at) {
              return MatrixXd(at.row(2).transpose());
            }};
        const std::vector<EffectTerm> terms = own_terms(model, growth, q);
        model.effects.insert(model.effects.end(), terms.begin(), terms.end());
      }
      for (EffectTerm& term : model.effects) {
        term.sigma = 0.01;
      }
    }
    for (TargetFrame& target : targets) {
      target.with_orientation = GetParam().orientations;
    }
    std::vector<std::string> names = reduced_model(model, targets).kept;
    if (GetParam().free_effects) {
      for (const EffectTerm& effect : model.effects) {
        names.push_back(effect.name);
      }
    }
    free = Unknowns(model, targets, names);
    measured = measured_with(1);
    options.priors = {.length = 0.002, .angle = 0.003};
    options.noise.independent = kSigma * sizes();
    options.noise.common = GetParam().common * (GetParam().by_axis ? Vector3d(2.0, 0.0, 1.0) : Vector3d::Ones());
    options.noise.orientation = GetParam().orientations ? kOrientationSigma : 0.0;
    if (GetParam().tracker) {
      options.noise.tracker = TrackerNoise{.range = kSigma, .transverse = kSigma, .transverse_per_metre = 2.0 * kSigma};
    }
  }

  // Twice each, but for some rows; every seventh configuration is held out, and one point was never seen.
  Measurements measured_with(std::uint64_t seed) {
    testing::VirtualExperiment experiment({.model = model,
                                           .targets = targets,
                                           .sizes = {.length = 0.001, .angle = 0.002},
                                           .ranges = published_ranges,
                                           .random = Random(seed)});
    truth = experiment.robot.truth;
    Measurements all = experiment.measure(40, {.orientation_sigma = kOrientationSigma, .repeats = 2});
    Random& random = experiment.random;
    for (Observation& o : all.observations) {
      o.sigma = GetParam().own_sigmas && o.configuration % 3 == 0 ? kSigma * (1 + o.target + o.repeat) : 0.0;
      o.split = o.configuration % 7 == 3 ? Split::test : Split::train;
      o.position() += kSigma * Vector3d{random.normal(), random.normal(), random.normal()};
    }
    return subset(all, [](const Observation& o) {
      return !(o.repeat == 2 && o.configuration % 5 == 1) && !(o.configuration == 4 && o.target == 1);
    });
  }

  // Of the noise along each axis.
  static Vector3d sizes() { return GetParam().by_axis ? Vector3d(1.0, 0.5, 2.0) : Vector3d::Ones(); }

  Estimate near_nominal() const {
    Estimate estimate{.errors = VectorXd::Constant(static_cast<Index>(model.parameters.size()), 1e-4),
                      .frames = {.targets = targets},
                      .effects = {}};
    if (GetParam().effects) {
      estimate.effects = VectorXd::Constant(static_cast<Index>(model.effects.size()), 1e-3);
    }
    return estimate;
  }

  ErrorModel model = complete_model(testing::fanuc());
  std::vector<TargetFrame> targets = published_targets();
  Unknowns free;
  Estimate truth;
  Measurements measured;
  ResidualOptions options;
};

// Every row by itself, by KDL and central differences. Those know nothing of effects.
TEST_P(LeastSquares, EquationsAreThoseOfTheRowsWrittenOut) {
  if (GetParam().effects) {
    return;
  }
  const LeastSquaresProblem problem(model, measured, free, options);
  const testing::DenseFit dense(
      model, measured, free,
      {.position = [&](const Observation& o) { return point_covariance(options.noise, o); },
       .orientation = [](const Observation&) { return kOrientationSigma * kOrientationSigma; },
       .common = options.noise.common},
      options.priors);
  const MatrixXd J = dense.jacobian(truth);
  const VectorXd e = dense.residuals(truth);
  const NormalEquations equations = problem.linearise(truth);
  EXPECT_EQ(problem.equations(), dense.equations());
  // The derivative of a small rotation vector differs from the identity by half of it.
  const double tolerance = GetParam().orientations ? 1e-3 : 1e-7;
  EXPECT_NEAR(equations.cost, e.squaredNorm(), tolerance * e.squaredNorm());
  const VectorXd scale = (J.transpose() * J).diagonal().cwiseSqrt().cwiseInverse();
  const MatrixXd difference = scale.asDiagonal() * (equations.hessian - J.transpose() * J) * scale.asDiagonal();
  EXPECT_LT(difference.cwiseAbs().maxCoeff(), tolerance);
  const VectorXd gradient = scale.cwiseProduct(equations.gradient - J.transpose() * e);
  EXPECT_LT(gradient.cwiseAbs().maxCoeff(), tolerance * e.norm());
}

TEST_P(LeastSquares, GradientIsTheDerivativeOfTheCost) {
  const LeastSquaresProblem problem(model, measured, free, options);
  const Estimate estimate = near_nominal();
  const VectorXd gradient = problem.linearise(estimate).gradient;
  const MatrixXd slopes = testing::central_differences(free.size(), 1e-6, [&](const VectorXd& step) {
    return VectorXd::Constant(1, problem.cost(free.moved(estimate, step)));
  });
  for (Index column = 0; column < free.size(); ++column) {
    EXPECT_NEAR(-2.0 * gradient[column], slopes(0, column), 1e-5 * gradient.norm())
        << free.names()[static_cast<std::size_t>(column)];
  }
}

// Some points were not measured, so that configurations that are alike are not those next to each other.
TEST_P(LeastSquares, WhitenedRowsStandInTheOrderOfTheConfigurations) {
  const Estimate estimate = near_nominal();
  const WhitenedSystem system = LeastSquaresProblem(model, measured, free, options).whitened(estimate);
  std::size_t place = 0;
  for (std::int32_t c = 0; c < static_cast<std::int32_t>(measured.configurations.size()); ++c) {
    if (c % 7 == 3) {  // held out
      continue;
    }
    Measurements alone = measured;
    for (Observation& o : alone.observations) {
      o.split = o.configuration == c ? Split::train : Split::test;
    }
    const WhitenedSystem expected = LeastSquaresProblem(model, alone, free, options).whitened(estimate);
    const Index rows = system.blocks[place + 1] - system.blocks[place];
    ASSERT_EQ(rows, expected.blocks[1]) << c;
    EXPECT_LT((system.residual.segment(system.blocks[place], rows) - expected.residual.head(rows)).norm(),
              1e-9 * expected.residual.head(rows).norm())
        << c;
    ++place;
  }
  EXPECT_EQ(system.blocks.size(), place + 1);
}

TEST_P(LeastSquares, CostAndWhitenedRowsAgreeWithTheEquations) {
  const LeastSquaresProblem problem(model, measured, free, options);
  const Estimate estimate = near_nominal();
  const NormalEquations equations = problem.linearise(estimate);
  EXPECT_NEAR(problem.cost(estimate), equations.cost, 1e-13 * equations.cost);
  const WhitenedSystem system = problem.whitened(estimate);
  EXPECT_NEAR(system.residual.squaredNorm() + problem.cost_of_repeats(), equations.cost, 1e-11 * equations.cost);
  testing::expect_equations_of(system, equations, 1e-11, 1e-9);
  const MatrixXd information = system.jacobian.transpose() * system.jacobian;
  const MatrixXd sqrt_information = problem.whitened_summary(estimate).sqrt_information;
  EXPECT_LT((sqrt_information.transpose() * sqrt_information - information).norm(), 1e-11 * information.norm());
}

void expect_same_bits(const NormalEquations& a, const NormalEquations& b) {
  EXPECT_EQ(a.hessian, b.hessian);
  EXPECT_EQ(a.gradient, b.gradient);
  EXPECT_EQ(a.cost, b.cost);
}

TEST_P(LeastSquares, TwoThreadsMayAskTheSameProblem) {
  const LeastSquaresProblem problem(model, measured, free, options);
  const Estimate here = near_nominal();
  const Estimate there = free.moved(here, VectorXd::Constant(free.size(), 1e-4));
  const NormalEquations expected_here = problem.linearise(here);
  const NormalEquations expected_there = problem.linearise(there);
  ASSERT_NE(expected_here.cost, expected_there.cost);
  const auto ask = [&](const Estimate& estimate, const NormalEquations& expected) {
    const double cost = problem.cost(estimate);
    const MatrixXd sqrt_information = problem.whitened_summary(estimate).sqrt_information;
    for (int i = 0; i < 20; ++i) {
      expect_same_bits(problem.linearise(estimate), expected);
      EXPECT_EQ(problem.cost(estimate), cost);
      EXPECT_EQ(problem.whitened_summary(estimate).sqrt_information, sqrt_information);
    }
  };
  std::thread other(ask, std::cref(there), std::cref(expected_there));
  ask(here, expected_here);
  other.join();
}

TEST_P(LeastSquares, AWorkspaceRemembersNothingOfTheProblemBefore) {
  const LeastSquaresProblem problem(model, measured, free, options);
  const LeastSquaresProblem another(model, measured_with(2), free.without(UnknownGroup::targets));
  const Estimate estimate = near_nominal();
  LeastSquaresProblem::Workspace workspace;
  NormalEquations equations;
  for (int round = 0; round < 2; ++round) {
    another.linearise(estimate, workspace, equations);
    expect_same_bits(equations, another.linearise(estimate));
    problem.linearise(estimate, workspace, equations);
    expect_same_bits(equations, problem.linearise(estimate));
    EXPECT_EQ(problem.cost(estimate, workspace), problem.cost(estimate));
  }
}

// So many that the pass takes them in parts. Halves of them it takes at once.
TEST(LeastSquaresOfManyConfigurations, AddsUpThePartsOnAnyNumberOfThreads) {
  testing::VirtualExperiment experiment;
  const Measurements all = experiment.measure(8 * 2048 + 37, {.sigma = kSigma});
  const Estimate estimate{.errors = VectorXd::Constant(static_cast<Index>(experiment.model.parameters.size()), 1e-4),
                          .frames = {.targets = experiment.targets},
                          .effects = {}};
  const auto equations_of = [&](const Measurements& measured, int threads) {
    ResidualOptions options;
    options.threads = threads;
    return LeastSquaresProblem(experiment.model, measured, experiment.free, options).linearise(estimate);
  };
  const auto half = [&](int remainder) {
    return subset(all, [=](const Observation& o) { return o.configuration % 2 == remainder; });
  };
  const NormalEquations one = equations_of(all, 1);
  expect_same_bits(one, equations_of(all, 3));
  const NormalEquations even = equations_of(half(0), 1);
  const NormalEquations odd = equations_of(half(1), 1);
  EXPECT_NEAR(one.cost, even.cost + odd.cost, 1e-12 * one.cost);
  EXPECT_LT((one.hessian - even.hessian - odd.hessian).norm(), 1e-12 * one.hessian.norm());
  EXPECT_LT((one.gradient - even.gradient - odd.gradient).norm(), 1e-9 * one.gradient.norm());
}

// Configurations that lack targets; so many of them, and of correlated noise so many rows, that they are taken in
// parts.
TEST(LeastSquaresOfManyConfigurations, SummaryIsThatOfTheStackedRows) {
  const auto lacking = [](const Observation& o) {
    return !(o.configuration % 5 == 1 && o.target == 2) && !(o.configuration % 7 == 2 && o.target != 1) &&
           o.configuration != 4;
  };
  for (const double common : {0.0, 0.0002}) {
    testing::VirtualExperiment experiment({.ranges = published_ranges, .random = Random(8)});
    const int count = common > 0.0 ? 400 : static_cast<int>(LeastSquaresProblem::kManyConfigurations) + 13;
    const Measurements measured = subset(experiment.measure(count, {.sigma = 0.0001}), lacking);
    ResidualOptions options{.priors = {.length = 0.001}};
    options.noise.common.setConstant(common);
    const LeastSquaresProblem problem(experiment.model, measured, experiment.free, options);
    const Estimate estimate = nominal_start(experiment.model, measured);
    const WhitenedSummary found = problem.whitened_summary(estimate);
    EXPECT_GT(found.priors.norm(), 0.0);
    testing::expect_same_summary(found, testing::summarised(problem.whitened(estimate)), 1e-12);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Passes, LeastSquares,
    ::testing::Values(
        Case{.name = "side_by_side"}, Case{.name = "held_effects", .effects = true},
        Case{.name = "effects", .effects = true, .free_effects = true},
        Case{.name = "orientations", .orientations = true},
        Case{.name = "orientations_common_noise", .orientations = true, .common = 2e-4},
        Case{.name = "orientations_by_axis", .orientations = true, .by_axis = true},
        Case{.name = "orientations_common_noise_by_axis", .orientations = true, .common = 2e-4, .by_axis = true},
        Case{.name = "common_noise", .common = 2e-4}, Case{.name = "by_axis", .by_axis = true},
        Case{.name = "common_noise_by_axis", .common = 2e-4, .by_axis = true},
        Case{.name = "own_sigmas", .own_sigmas = true},
        Case{.name = "own_sigmas_common_noise", .common = 2e-4, .own_sigmas = true},
        Case{.name = "own_sigmas_common_noise_by_axis", .common = 2e-4, .by_axis = true, .own_sigmas = true},
        Case{.name = "tracker_common_noise", .common = 2e-4, .tracker = true},
        Case{.name = "tracker_own_sigmas", .common = 2e-4, .tracker = true, .own_sigmas = true},
        Case{.name = "effects_by_axis", .effects = true, .free_effects = true, .common = 2e-4, .by_axis = true}),
    [](const auto& instance) { return std::string(instance.param.name); });

// ---- allocation ----------------------------------------------------------------------------------------------------

#ifdef KDL_CALIBRATION_COUNTS_ALLOCATIONS

long allocations_of_a_pass(int configurations, const ResidualOptions& options) {
  testing::VirtualExperiment experiment({.ranges = published_ranges});
  const Measurements measured = experiment.measure(configurations);
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free, options);
  const Estimate start{.errors = Eigen::VectorXd::Zero(experiment.robot.truth.errors.size()),
                       .frames = {.targets = published_targets()},
                       .effects = {}};
  LeastSquaresProblem::Workspace workspace;
  NormalEquations equations;
  problem.linearise(start, workspace, equations);  // the workspace takes its size
  const long before = allocations;
  problem.linearise(start, workspace, equations);
  return allocations - before;
}

TEST(Allocation, AnIterationTakesNone) {
  const long before = allocations;
  std::free(std::malloc(1));
  ASSERT_GT(allocations, before);  // they are counted
  EXPECT_EQ(allocations_of_a_pass(300, {}), 0);
}

TEST(Allocation, CorrelatedNoiseTakesNonePerConfiguration) {
  ResidualOptions options;
  options.noise.independent.setConstant(1e-5);
  options.noise.common.setConstant(5e-5);
  EXPECT_EQ(allocations_of_a_pass(300, options), allocations_of_a_pass(30, options));
  options.noise.common.z() = 2e-5;  // no longer alike in every direction
  EXPECT_EQ(allocations_of_a_pass(300, options), 0);
  options.noise.tracker = {.range = 1e-5, .transverse = 1e-5};  // one configuration after the other
  EXPECT_EQ(allocations_of_a_pass(300, options), allocations_of_a_pass(30, options));
}

/// Of 40 poses with their Jacobians by an arm that has the effects of these groups.
long allocations_of_poses(ErrorModel model, const std::vector<std::string>& groups) {
  Random random(2);
  const Eigen::MatrixXd q = random_configurations(published_ranges(model.joints), 40, random);
  DriveSignals signals;
  signals.circumstances.resize(kCircumstances, q.cols());
  for (double& value : signals.circumstances.reshaped()) {
    value = random.uniform(0.0, 50.0);
  }
  model.circumstances = {.temperature = 30.0, .payload = 40.0};
  std::vector<EffectTerm> all;
  for (const std::string& name : groups) {
    const std::vector<EffectTerm> terms = effect_terms(model, *effect_group(name), q, signals);
    EXPECT_FALSE(terms.empty() && name != "torque") << name;
    all.insert(all.end(), terms.begin(), terms.end());
  }
  model.effects = all;
  const auto count = static_cast<Eigen::Index>(all.size());
  const ArmKinematics arm(model, testing::random_errors(model, random, 0.001, 0.001),
                          Eigen::VectorXd::Constant(count, 1e-4));
  Matrix6Xd jacobian(6, arm.joints());
  double sum = 0.0;
  const long before = allocations;
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    sum += arm.flange_pose(q.col(c)).translation().x();
    sum += arm.flange_pose(q.col(c), jacobian).translation().x();
  }
  const long taken = allocations - before;
  EXPECT_NE(sum, 0.0);
  return taken;
}

TEST(Allocation, ACalibratedArmIsAskedWithoutAny) {
  EXPECT_EQ(allocations_of_poses(complete_model(testing::fanuc()), effect_group_names()), 0);
}

TEST(Allocation, AsManyJointsAsPromisedAreAskedWithoutAny) {
  Robot snake = testing::fanuc();
  while (snake.joints.size() < 32) {
    snake.joints.push_back(snake.joints[snake.joints.size() - 6]);
    snake.joints.back().name += "_again";
  }
  EXPECT_EQ(allocations_of_poses(complete_model(snake), {"gain", "transverse", "tables"}), 0);
}

#else

TEST(Allocation, IsNotCountedHere) { GTEST_SKIP() << "malloc is not ours"; }

#endif

}  // namespace
}  // namespace kdl_calibration::least_squares_test
