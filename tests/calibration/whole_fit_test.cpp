#include "calibration/whole_fit.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "kdl_calibration/simulation.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::whole_fit_test {
namespace {

using testing::refusal;

struct Arm : testing::VirtualExperiment {
  Measurements measured;
  CalibrationOptions options;
  FitOptions fit_options;
  Estimate start;

  explicit Arm(const testing::VirtualExperimentOptions& of = {}, int count = 20, const MeasuringNoise& noise = {})
      : VirtualExperiment(of),
        measured(testing::without_sigmas(measure(count, noise))),
        start(nominal_start(model, measured)) {}

  WholeFit fitted(const std::vector<std::string>& without = {}) const {
    const ParameterChoice choice = choose_parameters(model, start.targets, options, {.configurations = 20});
    std::vector<std::string> names = choice.free;
    for (const std::string& name : without) {
      std::erase(names, name);
    }
    return fit_whole(
        {.model = model, .measurements = measured, .start = start, .options = options, .fit_options = fit_options},
        choice, Unknowns(model, start.targets, names));
  }
};

TEST(WholeFit, TheTwoStepProcedureRefusesWhatItWasNotPublishedFor) {
  const Arm arm({}, 12, {.sigma = 1e-5, .repeats = 2});
  const auto refused = [&](const std::function<void(Arm&)>& change) {
    Arm changed = arm;
    changed.options.method = Method::two_step;
    changed.options.iterations = 2;
    change(changed);
    return refusal([&] { changed.fitted(); });
  };
  EXPECT_EQ(refused([](Arm&) {}), "nothing was refused");
  const std::string frames = "method: the two-step procedure finds base and targets, which cannot be known or fixed";
  EXPECT_EQ(refused([](Arm& a) { a.options.known_base = a.start.X_WB; }), frames);
  EXPECT_EQ(refused([](Arm& a) { a.options.known_targets = a.start.targets; }), frames);
  EXPECT_EQ(refused([](Arm& a) { a.options.known_targets = {a.start.targets[0], a.start.targets[2]}; }), frames);
  EXPECT_EQ(refused([](Arm& a) {
              a.measured.orientations.assign(a.measured.observations.size(), Eigen::Quaterniond::Identity());
              a.measured.source = "poses.csv";
            }),
            "method: the two-step procedure fits points; the measured orientations of poses.csv need the joint "
            "estimate");
  const std::string more = "method: the published two-step procedure has no priors, effects, losses or noise model";
  EXPECT_EQ(refused([](Arm& a) { a.options.automatic_priors = true; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.priors.length = 1e-3; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.priors.angle = 1e-3; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.effects.automatic = true; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.effects.groups = {EffectGroup::gain}; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.loss = Loss::huber; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.weights = Weights::repeats; }), more);
}

// Joints that hardly move tell so little that the two steps go on and on.
TEST(WholeFit, TheTwoStepProcedureTakesAThousandRoundsUnlessToldOtherwise) {
  const auto a_little = [](const std::vector<MovingJoint>& joints) { return JointRanges(joints.size(), {0.1, 0.4}); };
  Arm arm({.targets = published_targets(1), .ranges = a_little}, 10);
  arm.options.method = Method::two_step;
  const Identification found = arm.fitted().identification;
  EXPECT_EQ(found.termination, Termination::iteration_limit) << found.message;
  EXPECT_EQ(found.iterations, 1000);
  for (const int rounds : {1, 3}) {
    arm.options.iterations = rounds;
    EXPECT_EQ(arm.fitted().identification.iterations, rounds);
  }
}

TEST(WholeFit, OfRobustLossesHasTheirWeightsAndScale) {
  Arm arm({}, 16, {.sigma = 1e-4});
  arm.measured.observations[5].position.x() += 0.02;
  arm.fit_options.loss = Loss::tukey;
  arm.options.loss = Loss::tukey;
  const WholeFit found = arm.fitted();
  const RobustIdentification expected = identify_robustly({.model = arm.model,
                                                           .measurements = arm.measured,
                                                           .start = arm.start,
                                                           .free = arm.free,
                                                           .options = arm.fit_options});
  EXPECT_EQ(found.robust.weights, expected.weights);
  EXPECT_EQ(found.robust.scale, expected.scale);
  EXPECT_EQ(found.identification.estimate.errors, expected.fit.estimate.errors);
  EXPECT_EQ(found.free, arm.free);
  EXPECT_EQ(found.candidates, arm.free);
  arm.fit_options.loss = Loss::none;
  EXPECT_TRUE(arm.fitted().robust.weights.empty());
}

// What was fixed must not come back under other names, and a limit that was set is one.
TEST(WholeFit, GoesOnInTheCompleteSetWhereThatExplainsMoreUnlessSomethingIsAskedOfIt) {
  const Arm arm;
  const auto misfit = [&](const std::function<void(Arm&)>& ask) {
    Arm asked = arm;
    ask(asked);
    return asked.fitted({"dq3", "Tx4"}).identification.rms;  // [m]
  };
  constexpr double kLeft = 1e-5;
  EXPECT_LT(misfit([](Arm&) {}), 1e-10);
  EXPECT_GT(misfit([](Arm& a) { a.options.fix = {"dq3"}; }), kLeft);
  EXPECT_GT(misfit([](Arm& a) { a.options.iterations = 50; }), kLeft);
  EXPECT_GT(misfit([](Arm& a) { a.options.method = Method::two_step; }), kLeft);
  EXPECT_GT(misfit([](Arm& a) { a.options.loss = a.fit_options.loss = Loss::huber; }), kLeft);
}

TEST(WholeFit, ArrivedWhereItsGradientVanishes) {
  for (const Termination termination : {Termination::converged, Termination::rank_deficient, Termination::stalled,
                                        Termination::iteration_limit, Termination::diverged}) {
    const bool expected = termination == Termination::converged || termination == Termination::rank_deficient;
    EXPECT_EQ(arrived({.termination = termination}), expected) << to_string(termination);
  }
}

// The rank of the columns of these names at an estimate.
Eigen::Index rank_of(const Arm& arm, const Estimate& estimate, const Unknowns& columns) {
  const Eigen::MatrixXd J = LeastSquaresProblem(arm.model, arm.measured, columns).whitened(estimate).jacobian;
  const Eigen::VectorXd scale = J.colwise().norm().unaryExpr([](double n) { return n > 0.0 ? 1.0 / n : 0.0; });
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(Eigen::MatrixXd(J * scale.asDiagonal()));
  qr.setThreshold(1e-7);
  return qr.rank();
}

TEST(WholeFit, KeepsOfTheCandidatesAsManyAsTheMeasurementsTellAndTheFirstOfThem) {
  Arm arm({}, 2);
  for (const int held : {0, 2, 5}) {
    Eigen::MatrixXd q = arm.configurations(25);
    q.row(held).setConstant(0.3);
    arm.measured = arm.measure(q);
    arm.start = nominal_start(arm.model, arm.measured);
    const WholeFit found = arm.fitted();
    const Estimate& estimate = found.identification.estimate;
    EXPECT_EQ(found.free.size(), rank_of(arm, estimate, found.candidates)) << held;
    EXPECT_EQ(found.free.size(), rank_of(arm, estimate, found.free)) << held;
    EXPECT_LT(found.free.size(), found.candidates.size());
    EXPECT_EQ(found.free.range(UnknownGroup::base).count, 6) << "base comes first";
    EXPECT_LT(found.identification.rms, 1e-10);
    EXPECT_EQ(found.identification.rms_history.size(), static_cast<std::size_t>(found.identification.iterations));
  }
}

// A target a millimetre beside the last axis: what the tool turns about there moves it little.
WholeFit beside_the_last_axis(double noise, double turned) {
  Arm arm({.targets = testing::targets_at({{0.0, 0.2, 1e-3}})});
  arm.robot.truth.errors[static_cast<Eigen::Index>(parameter_index(arm.model, "Rz5"))] = turned;
  arm.measured = testing::without_sigmas(arm.measure(30, {.sigma = noise}));
  arm.start = nominal_start(arm.model, arm.measured);
  return arm.fitted();
}

TEST(WholeFit, HoldsWhatTheNoiseHidesUnlessThatCostsAMisfit) {
  const WholeFit clear = beside_the_last_axis(1e-6, 0.0);
  EXPECT_THAT(clear.reduction.faint, ::testing::UnorderedElementsAre("Tz5", "Rz5"));
  EXPECT_EQ(clear.candidates.size(), 27);
  const WholeFit hidden = beside_the_last_axis(1e-4, 0.0);
  EXPECT_EQ(hidden.candidates.size(), 25);
  EXPECT_FALSE(hidden.candidates.column("Tz5") || hidden.candidates.column("Rz5"));
  EXPECT_EQ(hidden.identification.rms_history.size(), static_cast<std::size_t>(hidden.identification.iterations));
  const auto held = [](double turned) { return !beside_the_last_axis(1e-4, turned).candidates.column("Rz5"); };
  EXPECT_TRUE(held(0.002));
  EXPECT_FALSE(held(0.2));
}

}  // namespace
}  // namespace kdl_calibration::whole_fit_test
