// Effects of what the drives tell besides joint values: the direction of approach and measured torques.

#include <gmock/gmock.h>

#include <cmath>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/prediction.hpp"
#include "kdl_calibration/result_json.hpp"
#include "kdl_calibration/saved_calibration.hpp"
#include "kdl_calibration/simulation.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::drive_effects_test {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::refusal;

constexpr double kSize = 3e-4;  // [rad] of a term, unless another is given
constexpr double kNoise = 3e-5;

/// An arm whose joints move by what its drives tell, and what was measured of it on its way.
struct DrivenArm : testing::VirtualExperiment {
  Measurements measured;
  Measurements unseen;  // without noise

  DrivenArm(DriveSignal signal, unsigned seed, double size = kSize)
      : VirtualExperiment({.sizes = {.length = 5e-4, .angle = 5e-4},
                           .X_WB = Eigen::Isometry3d(Eigen::Translation3d(3.0, 0.5, 0.3)),
                           .random = Random(seed)}) {
    const Eigen::MatrixXd q = configurations(60);
    const Eigen::MatrixXd elsewhere = configurations(100);
    const ToldByDrives told{.approach = true, .torques = true, .seed = seed};
    const DrivenConfigurations driven = driven_to(model, q, {}, told);
    for (const EffectGroup group : {EffectGroup::backlash, EffectGroup::torque}) {
      for (const EffectTerm& term : effect_terms(model, group, q, driven.signals)) {
        if (term.signal == signal) {
          robot.model.effects.push_back(term);
        }
      }
    }
    robot.truth.effects.resize(static_cast<Eigen::Index>(robot.model.effects.size()));
    for (double& value : robot.truth.effects) {
      value = size * random.normal();
    }
    measured = testing::without_sigmas(kdl_calibration::measure(robot, driven, {.sigma = kNoise}, random));
    unseen = kdl_calibration::measure(robot, driven_to(model, elsewhere, q, told), {}, random);
  }

  double error_at_unseen(const Calibration& found) const {
    return error_statistics(position_errors(found.model, found.identification.estimate, unseen)).rms;
  }
};

CalibrationOptions automatic() {
  return {.automatic_priors = true, .effects = {.automatic = true}, .held_out = false, .try_readings = false};
}

CalibrationOptions named(EffectGroup group) {
  return {.automatic_priors = true, .effects = {.groups = {group}}, .held_out = false, .try_readings = false};
}

const DrivenArm& with_play() {
  static const DrivenArm arm(DriveSignal::approach, 3);
  return arm;
}

const DrivenArm& that_gives_way() {
  static const DrivenArm arm(DriveSignal::torque, 4);
  return arm;
}

/// Where the unseen configurations are approached from is known.
const Calibration& found_with_play() {
  static const Calibration found = [] {
    CalibrationOptions options = automatic();
    const Measurements& unseen = with_play().unseen;
    options.predict_at = {
        .names = unseen.configurations, .joint_values = unseen.joint_values, .signals = unseen.signals};
    return calibrate(with_play().model, with_play().measured, options);
  }();
  return found;
}

const Calibration& found_by_torques() {
  static const Calibration found =
      calibrate(that_gives_way().model, that_gives_way().measured, named(EffectGroup::torque));
  return found;
}

/// Every true coefficient within four of its standard deviations.
void expect_coefficients(const Calibration& found, const DrivenArm& arm) {
  for (std::size_t e = 0; e < arm.robot.model.effects.size(); ++e) {
    const std::string& name = arm.robot.model.effects[e].name;
    const auto parameter = std::find_if(found.parameters.begin(), found.parameters.end(),
                                        [&](const ParameterEstimate& p) { return p.name == name; });
    ASSERT_NE(parameter, found.parameters.end()) << name;
    EXPECT_LT(parameter->std, 0.3 * kSize) << name;
    EXPECT_NEAR(parameter->value, arm.robot.truth.effects[static_cast<Eigen::Index>(e)], 4.0 * parameter->std) << name;
  }
}

TEST(DriveEffects, WhereTheOrderIsKnownBacklashHasADirection) {
  const Calibration& found = found_with_play();
  ASSERT_THAT(found.tried.front().effects, Contains("backlash"));
  expect_coefficients(found, with_play());
  Measurements of_no_order = with_play().measured;
  of_no_order.signals = {};
  const double without = with_play().error_at_unseen(calibrate(with_play().model, of_no_order, automatic()));
  EXPECT_LT(with_play().error_at_unseen(found), 0.3 * without);
}

TEST(DriveEffects, WhereItIsNotKnownPredictionsAreAsUncertainAsThePlayIsWide) {
  CalibrationOptions options = automatic();
  const Measurements& unseen = with_play().unseen;
  options.predict_at = {.names = unseen.configurations, .joint_values = unseen.joint_values, .signals = {}};
  const Calibration unknown = calibrate(with_play().model, with_play().measured, options);
  const Calibration& known = found_with_play();
  ASSERT_EQ(known.predicted.asked.size(), 3U * unseen.configurations.size());
  double normalised = 0.0;
  for (std::size_t i = 0; i < known.predicted.asked.size(); i += 3) {
    const PredictedPoint& with = known.predicted.asked[i];
    const PredictedPoint& without = unknown.predicted.asked[i];
    EXPECT_GT(without.radius_95, with.radius_95);
    const Eigen::Vector3d error = unseen.observations[i].position - without.position_W;
    normalised += error.squaredNorm() / (without.sigma * without.sigma);
    // The play of every joint, by the nominal arm's joints moved by hand.
    const auto c = static_cast<Eigen::Index>(i / 3);
    double variance = with.sigma * with.sigma;
    for (std::size_t e = 0; e < known.model.effects.size(); ++e) {
      const EffectTerm& term = known.model.effects[e];
      if (term.signal != DriveSignal::approach) {
        continue;
      }
      const double play = known.identification.estimate.effects[static_cast<Eigen::Index>(e)];
      Eigen::MatrixXd beside = unseen.joint_values.col(c).replicate(1, 2);
      beside(term.index, 0) += play;
      Estimate rigid = known.identification.estimate;
      rigid.effects.setZero();
      const auto X_BF = flange_poses(known.model, rigid, beside);
      const Eigen::Vector3d target = rigid.targets[0].X_FT.translation();
      variance += (X_BF[0] * target - X_BF[1] * target).squaredNorm();
    }
    EXPECT_NEAR(without.sigma, std::sqrt(variance), 0.02 * without.sigma);
  }
  normalised /= static_cast<double>(unseen.configurations.size());
  EXPECT_GT(normalised, 0.7);
  EXPECT_LT(normalised, 1.4);
}

TEST(DriveEffects, APlayOfMillimetresIsNoDefectOfTheMeasurements) {
  for (unsigned seed = 1; seed <= 2; ++seed) {
    const DrivenArm arm(DriveSignal::approach, seed, 10.0 * kSize);
    EXPECT_THAT(calibrate(arm.model, arm.measured, automatic()).findings, ::testing::IsEmpty()) << "seed " << seed;
  }
}

TEST(DriveEffects, EveryStageOfACalibrationKnowsThem) {
  for (const DrivenArm* arm : {&with_play(), &that_gives_way()}) {
    CalibrationOptions options = named(arm == &with_play() ? EffectGroup::backlash : EffectGroup::torque);
    options.held_out = true;
    options.nested = true;
    options.try_readings = true;
    Measurements unseen = arm->unseen;
    Random random(8);
    for (Observation& o : unseen.observations) {
      o.split = Split::test;
      for (double& coordinate : o.position) {
        coordinate += kNoise * random.normal();
      }
    }
    const Calibration found = calibrate(arm->model, joined(arm->measured, unseen), options);
    EXPECT_TRUE(found.trusted());
    EXPECT_TRUE(found.findings.empty());
    EXPECT_TRUE(found.suspicions.empty());
    // What is left is noise: of a point 1.7 sigma, and what 33 parameters and the effects cost.
    EXPECT_LT(found.train.after.rms, 1.8 * kNoise);
    EXPECT_LT(found.test->after.rms, 2.5 * kNoise);
    EXPECT_LT(found.held_out()->after.rms, 2.5 * kNoise);
    EXPECT_LT(found.nested_leave_one_out->rms, 2.5 * kNoise);
    EXPECT_GT(found.exported.train.rms, 5.0 * kNoise) << "a URDF knows neither";
  }
}

TEST(DriveEffects, MeasuredTorquesAreUsedWhereTheyAreNamed) {
  const Calibration unnamed = calibrate(that_gives_way().model, that_gives_way().measured, automatic());
  for (const ModelOption& option : unnamed.tried) {
    EXPECT_THAT(option.effects, Not(Contains("torque")));
  }
  const Calibration& found = found_by_torques();
  expect_coefficients(found, that_gives_way());
  EXPECT_LT(that_gives_way().error_at_unseen(found), 0.3 * that_gives_way().error_at_unseen(unnamed));
  EXPECT_EQ(found.predicted.workspace.count, 0U) << "where nobody measured a torque";
  EXPECT_GT(found.predicted.measured.count, 0U);
}

TEST(DriveEffects, TorquesThatAreMissingAreRefused) {
  const DrivenArm& arm = that_gives_way();
  CalibrationOptions options = named(EffectGroup::torque);
  Measurements measured = arm.measured;
  measured.signals.torques(1, 4) = std::nan("");
  EXPECT_THAT(refusal([&] { calibrate(arm.model, measured, options); }),
              HasSubstr("configuration '5' has no torque of joint_2, expected"));
  measured.signals.torques.resize(0, 0);
  EXPECT_THAT(refusal([&] { calibrate(arm.model, measured, options); }), HasSubstr("effects: torque needs measured"));
  options.predict_at = {.names = {"there"}, .joint_values = arm.unseen.joint_values.leftCols(1), .signals = {}};
  EXPECT_THAT(refusal([&] { calibrate(arm.model, arm.measured, options); }),
              HasSubstr("configuration 'there' has no torque of joint_1"));
  options.predict_at.signals.torques = arm.unseen.signals.torques.leftCols(2);
  EXPECT_THAT(refusal([&] { calibrate(arm.model, arm.measured, options); }), HasSubstr("torques to predict at"));
}

TEST(DriveEffects, AResultThatIsReadBackPredictsTheSame) {
  for (const DrivenArm* arm : {&with_play(), &that_gives_way()}) {
    const CalibrationOptions options = named(arm == &with_play() ? EffectGroup::backlash : EffectGroup::torque);
    const Calibration wrote = calibrate(arm->model, arm->measured, options);
    const Robot robot = testing::fanuc();
    const SavedCalibration read = parse_calibration(result_json(robot, arm->measured, options, wrote), robot);
    ASSERT_EQ(read.model.effects.size(), wrote.model.effects.size());
    const auto X_BF = flange_poses(read, arm->unseen.joint_values, arm->unseen.signals);
    const auto expected = flange_poses(wrote.model, wrote.identification.estimate, arm->unseen);
    for (std::size_t c = 0; c < X_BF.size(); ++c) {
      EXPECT_LT((X_BF[c].matrix() - expected[c].matrix()).norm(), 1e-12);
    }
  }
  const SavedCalibration read = parse_calibration(
      result_json(testing::fanuc(), that_gives_way().measured, named(EffectGroup::torque), found_by_torques()),
      testing::fanuc());
  EXPECT_THAT(refusal([&] { flange_poses(read, that_gives_way().unseen.joint_values); }),
              HasSubstr("no measured torque of joint_1, expected one for the effect torque.1"));
}

}  // namespace
}  // namespace kdl_calibration::drive_effects_test
