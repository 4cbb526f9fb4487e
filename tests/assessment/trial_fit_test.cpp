#include "assessment/trial_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "onset.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::kOddArm;
using testing::onset;
using testing::VirtualExperiment;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(TrialFit, AnArmIsAsLongAsItsOriginsAreApart) {
  // sqrt(0.1^2 + 0.2^2 + 0.4^2) and so on; the plate's origin moves what follows it, skew's is behind it.
  const ErrorModel model = complete_model(parse_robot(kOddArm));
  double length = model.tip_origin.p.Norm();
  for (const MovingJoint& joint : model.joints) {
    length +=
        std::sqrt(std::pow(joint.origin.p.x(), 2) + std::pow(joint.origin.p.y(), 2) + std::pow(joint.origin.p.z(), 2));
  }
  EXPECT_NEAR(arm_length(model), length, 1e-12);
  EXPECT_GT(length, 2.0);
}

TEST(TrialFit, ErrorsOfARobotAreBelowFiveCentimetresAndTwentyDegrees) {
  ErrorModel model = complete_model(parse_robot(kOddArm));
  const auto largest = [&](std::size_t p, double sign) {
    return onset(
        0.0, 10.0,
        [&](double size) {
          VectorXd errors = VectorXd::Constant(static_cast<Index>(model.parameters.size()), 1e-3);
          errors[static_cast<Index>(p)] = sign * size;
          return !plausible(model, errors);
        },
        36);
  };
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const double expected = is_length(model, model.parameters[p]) ? 0.05 : 0.35;
    EXPECT_NEAR(largest(p, 1.0), expected, 1e-9) << p;
    EXPECT_NEAR(largest(p, -1.0), expected, 1e-9) << p;
  }
  model.tip_origin.p = KDL::Vector(0.0, 40.0, 0.0);
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const double expected = is_length(model, model.parameters[p]) ? 0.005 * arm_length(model) : 0.35;
    EXPECT_NEAR(largest(p, 1.0), expected, 1e-9) << p;
  }
  VectorXd unknown = VectorXd::Zero(static_cast<Index>(model.parameters.size()));
  unknown[3] = std::nan("");
  EXPECT_FALSE(plausible(model, unknown));
}

TEST(TrialFit, AMisfitIsTheRootMeanSquareOfDistancesOfPoints) {
  VirtualExperiment experiment;
  Measurements measured = experiment.measure(7, {.sigma = 1e-4});
  const Estimate nominal = nominal_start(experiment.model, measured);
  double sum = 0.0;
  for (const Observation& o : measured.observations) {
    KDL::Frame flange =
        testing::kdl_pose(error_chain(experiment.model, nominal.errors), measured.joint_values.col(o.configuration));
    const Vector3d t = nominal.targets[static_cast<std::size_t>(o.target)].X_FT.translation();
    const KDL::Vector seen = flange * KDL::Vector(t.x(), t.y(), t.z());
    sum += (nominal.X_WB * Vector3d(seen.x(), seen.y(), seen.z()) - o.position).squaredNorm();
  }
  EXPECT_NEAR(rms_of(experiment.model, measured, nominal),
              std::sqrt(sum / static_cast<double>(measured.observations.size())), 1e-12);
  measured.observations[2].position.x() = std::nan("");
  EXPECT_EQ(rms_of(experiment.model, measured, nominal), kInfinity);
  measured.observations.clear();
  EXPECT_EQ(rms_of(experiment.model, measured, nominal), kInfinity);
}

/// Of an arm whose second joint is off by this angle [rad].
struct Offset {
  VirtualExperiment experiment;
  Measurements measured;
  Estimate start;

  explicit Offset(double angle) : experiment({.sizes = {.length = 0.0, .angle = 0.0}}) {
    experiment.robot.truth.errors[static_cast<Index>(parameter_index(experiment.model, "dq2"))] = angle;
    measured = experiment.measure(30, {.sigma = 2e-5});
    start = nominal_start(experiment.model, measured);
  }
  double fitted(const Measurements& of) const {
    return fitted_rms({.model = experiment.model, .free = experiment.free, .registration = {}, .joint = {}}, of, start);
  }
  double registered(const Measurements& of) const { return rms_of(experiment.model, of, start); }
};

TEST(TrialFit, AFitCountsWhereItsErrorsAreARobots) {
  const Offset little(0.3);
  const double left =
      rms_of(little.experiment.model, little.measured,
             identify_jointly(little.experiment.model, little.measured, little.start, little.experiment.free).estimate);
  EXPECT_LT(left, 1e-4);
  EXPECT_NEAR(little.fitted(little.measured), left, 1e-12);
  const Offset much(0.4);
  EXPECT_EQ(much.fitted(much.measured), much.registered(much.measured));
  EXPECT_GT(much.registered(much.measured), 0.01);
}

// A gain of 2 % that is free, with a prior or without, would take the misfit away.
TEST(TrialFit, EffectsAreLeftAsTheStartHasThem) {
  for (const double sigma : {0.0, 10.0}) {
    ErrorModel model = complete_model(testing::fanuc());
    EffectTerm gain;
    gain.name = "gain3";
    gain.group = EffectGroup::gain;
    gain.index = 2;
    gain.sigma = sigma;
    model.effects = {gain};
    VirtualExperiment experiment({.model = model});
    experiment.robot.truth.effects = VectorXd::Constant(1, 0.02);
    const Measurements measured = experiment.measure(30, {.sigma = 0.0});
    const Estimate start = nominal_start(model, measured);
    const Unknowns with_gain = experiment.free.with(experiment.model, UnknownGroup::effects, {0});
    const auto fitted = [&](const Unknowns& free) {
      return fitted_rms({.model = experiment.model, .free = free, .registration = {}, .joint = {}}, measured, start);
    };
    EXPECT_GT(fitted(experiment.free), 1e-4);
    EXPECT_EQ(fitted(with_gain), fitted(experiment.free));
    EXPECT_LT(
        rms_of(experiment.model, measured, identify_jointly(experiment.model, measured, start, with_gain).estimate),
        0.1 * fitted(experiment.free));
  }
}

// The fit looks at sigmas, which the misfit does not.
TEST(TrialFit, AFitThatIsWorseThanItsStartCountsAsThat) {
  Offset offset(0.0);
  Random random(6);
  for (Observation& o : offset.measured.observations) {
    o.sigma = o.configuration < 10 ? 1e-6 : 1.0;
    o.position += 1e-4 * Vector3d{random.normal(), random.normal(), random.normal()};
  }
  offset.start = offset.experiment.robot.truth;
  const Estimate worse =
      identify_jointly(offset.experiment.model, offset.measured, offset.start, offset.experiment.free).estimate;
  ASSERT_GT(rms_of(offset.experiment.model, offset.measured, worse), offset.registered(offset.measured));
  EXPECT_EQ(offset.fitted(offset.measured), offset.registered(offset.measured));
}

}  // namespace
}  // namespace kdl_calibration
