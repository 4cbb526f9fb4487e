#include "kdl_calibration/least_squares.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <thread>

#include "dense_fit.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
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
  double common = 0.0;   // [m]
  bool by_axis = false;  // noise of another size along each
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
    options.noise.common = GetParam().common * sizes().reverse();
    options.noise.orientation = GetParam().orientations ? kOrientationSigma : 0.0;
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
      o.sigma = 0.0;
      o.split = o.configuration % 7 == 3 ? Split::test : Split::train;
      o.position += kSigma * Vector3d{random.normal(), random.normal(), random.normal()};
    }
    return subset(all, [](const Observation& o) {
      return !(o.repeat == 2 && o.configuration % 5 == 1) && !(o.configuration == 4 && o.target == 1);
    });
  }

  // Of the noise along each axis.
  static Vector3d sizes() { return GetParam().by_axis ? Vector3d(1.0, 0.5, 2.0) : Vector3d::Ones(); }

  Estimate near_nominal() const {
    Estimate estimate{.errors = VectorXd::Constant(static_cast<Index>(model.parameters.size()), 1e-4),
                      .targets = targets};
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
      {.position = [](const Observation&) { return Eigen::Matrix3d((kSigma * sizes()).cwiseAbs2().asDiagonal()); },
       .orientation = [](const Observation&) { return kOrientationSigma * kOrientationSigma; },
       .common = GetParam().common * sizes().reverse()},
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
  const MatrixXd information = system.jacobian.transpose() * system.jacobian;
  EXPECT_LT((information - equations.hessian).norm(), 1e-11 * information.norm());
  const VectorXd gradient = system.jacobian.transpose() * system.residual;
  EXPECT_LT((gradient - equations.gradient).norm(), 1e-9 * gradient.norm());
  const MatrixXd triangle = problem.whitened_summary(estimate).triangle;
  EXPECT_LT((triangle.transpose() * triangle - information).norm(), 1e-11 * information.norm());
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
    const MatrixXd triangle = problem.whitened_summary(estimate).triangle;
    for (int i = 0; i < 20; ++i) {
      expect_same_bits(problem.linearise(estimate), expected);
      EXPECT_EQ(problem.cost(estimate), cost);
      EXPECT_EQ(problem.whitened_summary(estimate).triangle, triangle);
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
                          .targets = experiment.targets};
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

INSTANTIATE_TEST_SUITE_P(
    Passes, LeastSquares,
    ::testing::Values(
        Case{.name = "side_by_side"}, Case{.name = "held_effects", .effects = true},
        Case{.name = "effects", .effects = true, .free_effects = true},
        Case{.name = "orientations", .orientations = true}, Case{.name = "common_noise", .common = 2e-4},
        Case{.name = "by_axis", .by_axis = true}, Case{.name = "common_noise_by_axis", .common = 2e-4, .by_axis = true},
        Case{.name = "effects_by_axis", .effects = true, .free_effects = true, .common = 2e-4, .by_axis = true}),
    [](const auto& instance) { return std::string(instance.param.name); });

}  // namespace
}  // namespace kdl_calibration
