#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>

#include "calibration/parameter_estimates.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/random.hpp"
#include "kdl_calibration/simulation.hpp"
#include "mistakes_support.hpp"
#include "record.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::effect_choice_test {
namespace {

using ::testing::Contains;
using testing::fanuc;
using ::testing::IsEmpty;
using testing::kOddArm;

/// An arm that does more than its geometry says, and what a tracker saw of it.
struct Arm : testing::VirtualExperiment {
  Measurements measured;
  Eigen::MatrixXd unseen;

  Arm(const Robot& nominal, unsigned seed, int count, const std::vector<std::pair<EffectGroup, double>>& effects,
      double sigma = 5e-5)
      : VirtualExperiment({.model = complete_model(nominal),
                           .sizes = {.length = 5e-4, .angle = 5e-4},
                           .X_WB = Eigen::Isometry3d(Eigen::Translation3d(3.0, 0.5, 0.3)),
                           .random = Random(seed)}) {
    const Eigen::MatrixXd q = configurations(count);
    unseen = configurations(200);
    std::vector<double> values;
    for (const auto& [group, size] : effects) {
      for (const EffectTerm& term : effect_terms(model, group, q)) {
        robot.model.effects.push_back(term);
        values.push_back(size * random.normal());
      }
    }
    robot.truth.effects = Eigen::Map<Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
    measured = testing::without_sigmas(measure(q, {.sigma = sigma}));
  }

  /// [m] RMS at configurations that were not measured.
  double error_at_unseen(const Calibration& found) const {
    Random none(1);
    const Measurements exact = kdl_calibration::measure(robot, unseen, {}, none);
    return error_statistics(position_errors(found.model, found.identification.estimate, exact)).rms;
  }
};

CalibrationOptions automatic() {
  return {.automatic_priors = true, .effects = {.automatic = true}, .held_out = false, .try_readings = false};
}

/// The same without the groups of many terms.
CalibrationOptions automatic_of_few_terms() {
  CalibrationOptions options = automatic();
  options.fix = {"tables.*", "transverse.*"};
  return options;
}

const CalibrationOptions kGeometry{.held_out = false, .try_readings = false};

void expect_found_and_predicted_by(const std::vector<EffectGroup>& groups) {
  for (const EffectGroup group : groups) {
    const Arm arm(fanuc(), 10 + static_cast<unsigned>(group), 60, {{group, 3e-4}});
    const Calibration found = calibrate(arm.model, arm.measured, automatic());
    ASSERT_FALSE(found.tried.empty());
    EXPECT_FALSE(found.tried.front().effects.empty()) << to_string(group);
    const double with = arm.error_at_unseen(found);
    const double without = arm.error_at_unseen(calibrate(arm.model, arm.measured, kGeometry));
    const std::string of_group = to_string(group);
    testing::record(of_group + ", chosen", ::testing::PrintToString(found.tried.front().effects));
    testing::record(of_group + ", unseen [m]", with);
    testing::record(of_group + ", unseen by geometry [m]", without);
    EXPECT_LT(with, 0.6 * without) << to_string(group);
    EXPECT_LT(found.noise.sigma, 8e-5) << to_string(group);
  }
}

TEST(EffectChoice, FindsSagAndPredictsByIt) { expect_found_and_predicted_by({EffectGroup::gravity}); }

TEST(EffectChoiceLongRun, FindsEachEffectAndPredictsByIt) {
  expect_found_and_predicted_by({EffectGroup::gravity, EffectGroup::transverse, EffectGroup::gain,
                                 EffectGroup::backlash, EffectGroup::harmonics, EffectGroup::tables});
}

TEST(EffectChoice, FindsHowOftenGearsRipple) {
  const Arm arm(fanuc(), 21, 120, {{EffectGroup::ripple, 2e-4}});
  const Calibration found = calibrate(arm.model, arm.measured, automatic_of_few_terms());
  ASSERT_THAT(found.tried.front().effects, Contains("ripple"));
  std::map<int, std::pair<double, double>> strongest;  // of each joint: amplitude, times a turn
  for (std::size_t e = 0; e < found.model.effects.size(); ++e) {
    const EffectTerm& term = found.model.effects[e];
    if (term.group == EffectGroup::ripple) {
      const double amplitude =
          std::abs(found.identification.estimate.effects[static_cast<Eigen::Index>(e)]) / term.scale;
      strongest[term.index] = std::max(strongest[term.index], std::pair(amplitude, std::abs(term.harmonic)));
    }
  }
  EXPECT_GE(strongest.size(), 5U);
  for (const auto& [joint, swing] : strongest) {
    EXPECT_NEAR(swing.second, 100.0, 0.2) << "joint " << joint + 1;
  }
  EXPECT_LT(arm.error_at_unseen(found), 0.5 * arm.error_at_unseen(calibrate(arm.model, arm.measured, kGeometry)));
}

TEST(EffectChoice, NoRippleIsLookedForAboveHalfTheRateOfTheJointValues) {
  Arm arm(fanuc(), 22, 110, {});
  const double degree = std::numbers::pi / 180.0;
  // Whole degrees, in radians with four decimals.
  const Eigen::MatrixXd whole = (arm.measured.joint_values / degree).array().round().matrix() * degree;
  const Eigen::MatrixXd q = (1e4 * whole).array().round().matrix() / 1e4;
  arm.robot.model.effects = ripple_terms(arm.model, q, 1, 300.0);  // which looks like 60 times at whole degrees
  arm.robot.truth.effects = Eigen::VectorXd::Constant(2, 3e-4);
  Random random(5);
  arm.measured = measure(arm.robot, q, {.sigma = 5e-5}, random);
  const Calibration found = calibrate(arm.model, arm.measured, automatic_of_few_terms());
  ASSERT_THAT(found.tried.front().effects, Contains("ripple"));
  for (const EffectTerm& term : found.model.effects) {
    if (term.group == EffectGroup::ripple) {
      EXPECT_NEAR(std::abs(term.harmonic), 60.0, 0.5) << term.name;
    }
  }
}

void expect_no_ripple_in_rigid_arms(unsigned count) {
  for (unsigned seed = 0; seed < count; ++seed) {
    const Arm arm(seed % 2 == 0 ? fanuc() : parse_robot(kOddArm), 70 + seed, 110, {});
    for (const ModelOption& option : calibrate(arm.model, arm.measured, automatic()).tried) {
      EXPECT_THAT(option.effects, ::testing::Not(Contains("ripple"))) << "seed " << seed;
    }
  }
}

TEST(EffectChoice, ARigidArmHasNoRipple) { expect_no_ripple_in_rigid_arms(1); }
TEST(EffectChoiceLongRun, ARigidArmHasNoRipple) { expect_no_ripple_in_rigid_arms(6); }

// A table that nothing was measured of over 40 degrees is not made up there.
TEST(EffectChoice, TablesAreWithheldInGaps) {
  Arm arm(fanuc(), 23, 100, {});
  const Eigen::MatrixXd q = 0.3 * arm.measured.joint_values;
  for (const EffectTerm& term : table_terms(arm.model, q, 10.0 * std::numbers::pi / 180.0)) {
    if (term.index == 2 || term.index == 3) {
      arm.robot.model.effects.push_back(term);
    }
  }
  Random random(24);
  arm.robot.truth.effects = Eigen::VectorXd::NullaryExpr(static_cast<Eigen::Index>(arm.robot.model.effects.size()),
                                                         [&](Eigen::Index) { return 3e-4 * random.normal(); });
  arm.measured = measure(arm.robot, q, {.sigma = 5e-5}, random);
  const auto q3 = arm.measured.joint_values.row(2);
  const double middle = 0.5 * (q3.minCoeff() + q3.maxCoeff());
  const Measurements gapped = subset(arm.measured, [&](const Observation& o) {
    return std::abs(arm.measured.joint_values(2, o.configuration) - middle) > 0.35;
  });
  CalibrationOptions options = kGeometry;
  Eigen::MatrixXd asked = arm.measured.joint_values.leftCols(2);
  for (Eigen::Index c = 0; c < 2; ++c) {
    asked.col(c) = gapped.joint_values.col(7);
  }
  asked(2, 0) = middle;  // where nothing was measured
  options.effects = {.groups = {EffectGroup::tables}};
  options.fix = {"tables.1.*", "tables.2.*", "tables.5.*", "tables.6.*"};
  options.predict_at = {{"in the gap", "measured there"}, asked};
  const Calibration found = calibrate(arm.model, gapped, options);
  int tables = 0;
  for (std::size_t e = 0; e < found.model.effects.size(); ++e) {
    const EffectTerm& term = found.model.effects[e];
    if (term.index != 2) {
      continue;
    }
    ++tables;
    ASSERT_EQ(term.table.withheld.size(), 1U);
    EXPECT_LT(term.table.withheld[0].first, middle);
    EXPECT_GT(term.table.withheld[0].first, middle - 0.4);
    EXPECT_GT(term.table.withheld[0].second, middle);
    EXPECT_LT(term.table.withheld[0].second, middle + 0.4);
    const Eigen::MatrixXd basis = effect_basis(found.model, asked);
    EXPECT_EQ(basis(static_cast<Eigen::Index>(e), 0), 0.0);
  }
  EXPECT_GT(tables, 0);
  ASSERT_FALSE(found.predicted.asked.empty());
  for (const PredictedPoint& point : found.predicted.asked) {
    EXPECT_EQ(point.outside, point.configuration == "in the gap") << point.configuration;
  }
  // What a table may be there is part of the uncertainty: a joint that moves by that much.
  const auto& points = found.predicted.asked;
  EXPECT_GT(points.front().sigma, 3.0 * points.back().sigma);
}

TEST(EffectChoice, FindsTheSizeOfWhatIsThere) {
  const Arm arm(fanuc(), 3, 100, {{EffectGroup::gravity, 2e-4}});
  CalibrationOptions options = kGeometry;
  options.effects.groups = {EffectGroup::gravity};
  const Calibration found = calibrate(arm.model, arm.measured, options);
  ASSERT_EQ(found.model.effects.size(), arm.robot.model.effects.size());
  EXPECT_GT(found.model.effects.front().sigma, 1e-4);
  EXPECT_LT(found.model.effects.front().sigma, 4e-4);
  // What is true of the values lies where their covariance says.
  const ColumnRange columns = found.free.range(UnknownGroup::effects);
  ASSERT_EQ(columns.count, static_cast<Eigen::Index>(found.model.effects.size()));
  int inside = 0;
  for (Eigen::Index e = 0; e < columns.count; ++e) {
    const double error = found.identification.estimate.effects[e] - arm.robot.truth.effects[e];
    const double sigma = std::sqrt(found.covariance(columns.first + e, columns.first + e));
    inside += std::abs(error) < 2.0 * sigma ? 1 : 0;
  }
  EXPECT_GE(inside, static_cast<int>(0.8 * static_cast<double>(columns.count)));
}

TEST(EffectChoice, LeavesARigidArmRigid) {
  int kept = 0;
  double worse = 0.0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const Arm arm(seed % 2 == 0 ? fanuc() : parse_robot(kOddArm), 50 + seed, seed % 3 == 0 ? 15 : 45, {});
    const Calibration found = calibrate(arm.model, arm.measured, automatic());
    kept += found.model.effects.empty() ? 0 : 1;
    worse = std::max(worse,
                     arm.error_at_unseen(found) / arm.error_at_unseen(calibrate(arm.model, arm.measured, kGeometry)));
  }
  EXPECT_EQ(kept, 0);
  EXPECT_LT(worse, 1.1);
}

TEST(EffectChoice, NothingIsChosenWhereNothingIsLeft) {
  const Arm arm(fanuc(), 4, 30, {}, 0.0);
  const Calibration found = calibrate(arm.model, arm.measured, automatic());
  EXPECT_THAT(found.model.effects, IsEmpty());
  EXPECT_LT(arm.error_at_unseen(found), 1e-12);
  EXPECT_LE(found.identification.iterations, 8);
}

// Of an arm that is as drawn, where priors leave the geometry nearly nominal.
TEST(EffectChoice, TheNoiseIsInPartsBesideChosenPriors) {
  Arm arm(fanuc(), 2, 30, {});
  arm.robot.truth.errors.setZero();
  Random random(3);
  const MeasuringNoise noise{.sigma = 1e-5, .repeats = 5, .common = Eigen::Vector3d::Constant(5e-5)};
  arm.measured = testing::without_sigmas(measure(arm.robot, arm.measured.joint_values, noise, random));
  const Calibration found = calibrate(arm.model, arm.measured, automatic());
  ASSERT_TRUE(found.tried.front().sized);
  ASSERT_TRUE(found.noise.parts.has_value());
  EXPECT_NEAR(found.noise.sigma, std::hypot(1e-5, 5e-5), 1e-5);
  EXPECT_NEAR(found.noise.independent.norm() / std::sqrt(3.0), 1e-5, 2e-6);
  EXPECT_NEAR(found.noise.common.norm() / std::sqrt(3.0), 5e-5, 1e-5);
}

TEST(EffectChoice, TooFewMeasurementsForWhatIsAskedAreRefused) {
  const Arm arm(fanuc(), 9, 9, {});  // 81 equations
  CalibrationOptions options = kGeometry;
  options.effects.groups = {EffectGroup::gravity, EffectGroup::harmonics};
  EXPECT_THAT(testing::refusal([&] { calibrate(arm.model, arm.measured, options); }),
              ::testing::HasSubstr("simulation: too few measurements for the effects asked for"));
}

TEST(EffectChoice, NestedIsOfChoicesThatDidNotSeeTheConfiguration) {
  const Arm arm(fanuc(), 5, 13, {{EffectGroup::gravity, 3e-4}});
  CalibrationOptions options = automatic();
  options.leave_one_out = true;
  options.nested = true;
  const Calibration found = calibrate(arm.model, arm.measured, options);
  ASSERT_TRUE(found.nested_leave_one_out.has_value());
  EXPECT_EQ(found.nested_leave_one_out->count, 39);
  EXPECT_GT(found.nested_leave_one_out->rms, 0.9 * found.leave_one_out->after.rms);
  EXPECT_LT(found.nested_leave_one_out->rms, 2.0 * found.leave_one_out->after.rms);
  // Spoiling a configuration changes what is predicted of it by just that, as nothing was learnt from it.
  Measurements spoilt = arm.measured;
  for (Observation& o : spoilt.observations) {
    if (o.configuration == 7) {
      o.position.x() += 1e-3;
    }
  }
  const Calibration other = calibrate(arm.model, spoilt, options);
  EXPECT_GT(other.nested_leave_one_out->max, 0.5e-3);
}

TEST(EffectChoice, HeldTermsTakeNoPart) {
  const Arm arm(fanuc(), 6, 40, {{EffectGroup::gravity, 3e-4}});
  CalibrationOptions options = kGeometry;
  options.effects.groups = {EffectGroup::gravity, EffectGroup::gain};
  options.fix = {"gravity.2.*", "gain.4"};
  const Calibration found = calibrate(arm.model, arm.measured, options);
  ASSERT_FALSE(found.model.effects.empty());
  for (const EffectTerm& term : found.model.effects) {
    EXPECT_NE(term.name.rfind("gravity.2.", 0), 0U) << term.name;
    EXPECT_NE(term.name, "gain.4");
  }
  // A pattern that says nothing of effects is about parameters.
  options.fix = {"*4"};
  const Calibration other = calibrate(arm.model, arm.measured, options);
  EXPECT_FALSE(other.free.column("Tz4").has_value());
}

TEST(EffectChoice, AnArmOnAWallSagsAlongItsOwnDirection) {
  Arm arm(fanuc(), 7, 30, {});
  arm.robot.model.gravity = KDL::Vector(1.0, 0.0, 0.0);
  arm.robot.model.effects = effect_terms(arm.robot.model, EffectGroup::gravity, arm.measured.joint_values);
  Random random(8);
  arm.robot.truth.effects = Eigen::VectorXd::NullaryExpr(static_cast<Eigen::Index>(arm.robot.model.effects.size()),
                                                         [&](Eigen::Index) { return 3e-4 * random.normal(); });
  arm.measured = measure(arm.robot, arm.measured.joint_values, {.sigma = 5e-5}, random);
  CalibrationOptions options = kGeometry;
  options.effects.groups = {EffectGroup::gravity};
  const double upright = arm.error_at_unseen(calibrate(arm.model, arm.measured, options));
  ErrorModel on_wall = arm.model;
  on_wall.gravity = arm.robot.model.gravity;
  const double known = arm.error_at_unseen(calibrate(on_wall, arm.measured, options));
  EXPECT_LT(known, 0.7 * upright);
}

TEST(EffectChoice, OfFewConfigurationsOnlyWhatTheyCanTell) {
  const Arm arm(fanuc(), 9, 13, {{EffectGroup::gravity, 3e-4}});
  const Calibration found = calibrate(arm.model, arm.measured, automatic());
  for (const ModelOption& option : found.tried) {
    EXPECT_THAT(option.effects, ::testing::AnyOf(IsEmpty(), ::testing::ElementsAre("gravity")));
  }
}

/// Geometric errors that lie in their 95 % intervals, of those that the data determine.
struct Coverage {
  double inside = 0.0;
  double all = 0.0;

  void add(const Calibration& found, const testing::VirtualExperiment& arm) {
    for (std::size_t p = 0; p < arm.model.parameters.size(); ++p) {
      const auto parameter =
          std::find_if(found.parameters.begin(), found.parameters.end(),
                       [&](const ParameterEstimate& e) { return e.name == arm.model.parameters[p].name; });
      if (parameter == found.parameters.end() || !parameter->identifiable) {
        continue;
      }
      const double error = parameter->error - arm.robot.truth.errors[static_cast<Eigen::Index>(p)];
      inside += std::abs(error) <= half_width_95(parameter->std, parameter->degrees_of_freedom) ? 1.0 : 0.0;
      all += 1.0;
    }
  }
};

/// Share of them over arms.
double covered(unsigned first, unsigned count, int configurations, bool with_effects) {
  Coverage coverage;
  for (unsigned seed = first; seed < first + count; ++seed) {
    std::vector<std::pair<EffectGroup, double>> effects;
    if (with_effects) {
      effects.emplace_back(EffectGroup::gravity, 2e-4);
    }
    const Arm arm(fanuc(), seed, configurations, effects);
    coverage.add(calibrate(arm.model, arm.measured, automatic()), arm);
  }
  const double share = coverage.inside / coverage.all;
  testing::record("errors in their intervals, " + std::to_string(configurations) + " configurations" +
                      (with_effects ? " of an arm that sags" : ""),
                  share);
  return share;
}

TEST(EffectChoiceLongRun, IntervalsHoldBesideAutomaticChoices) {
  for (const auto& [configurations, with_effects] : {std::pair{30, false}, std::pair{10, false}, std::pair{40, true}}) {
    const double share = covered(200, 60, configurations, with_effects);
    EXPECT_GT(share, 0.90);
    EXPECT_LT(share, 0.98);
  }
}

// Hardly more equations than unknowns.
TEST(EffectChoiceLongRun, IntervalsHoldWhereTenPointsSizeThePriors) {
  Coverage coverage;
  for (unsigned seed = 1; seed <= 60; ++seed) {
    testing::VirtualExperiment arm({.targets = published_targets(1),
                                    .sizes = {.length = 5e-4, .angle = 5e-4},
                                    .X_WB = Eigen::Isometry3d(Eigen::Translation3d(3.0, 0.5, 0.3)),
                                    .random = Random(seed)});
    const Measurements measured = testing::without_sigmas(arm.measure(arm.configurations(10), {.sigma = 5e-5}));
    const Calibration found = calibrate(arm.model, measured, automatic());
    EXPECT_THAT(found.model.effects, IsEmpty());
    coverage.add(found, arm);
  }
  const double share = coverage.inside / coverage.all;
  testing::record("errors in their intervals, ten configurations of one target", share);
  EXPECT_GT(share, 0.85);
  EXPECT_LT(share, 0.99);
}

// ---- rigid arms ----------------------------------------------------------------------------------------------------

struct Rigid {
  int arms = 0;
  int kept = 0;        // an effect
  int much_worse = 0;  // by more than 10 %
  double ratio = 0.0;  // of the errors at unseen configurations, mean of logarithms
};

/// What automatic choices make of arms that geometry explains, against geometry alone.
Rigid of_rigid_arms(unsigned first, unsigned count) {
  Rigid result;
  for (unsigned seed = first; seed < first + count; ++seed) {
    Random random(seed);
    const ErrorModel model = testing::random_arm(random);
    const int configurations = static_cast<int>(12.0 * std::pow(200.0 / 12.0, random.uniform(0.0, 1.0)));
    const testing::Draw draw{.configurations = configurations,
                             .targets = 2 + static_cast<int>(seed % 2),
                             .length = random.uniform(1e-4, 1e-3),
                             .angle = random.uniform(1e-4, 5e-3),
                             .noise = random.uniform(1e-5, 1e-4)};
    const testing::Measured m = testing::measured(model, seed, draw);
    const testing::Measured unseen =
        testing::measured(model, seed, {.configurations = 300, .targets = draw.targets, .noise = 0.0});
    const auto error_of = [&](const Calibration& found) {
      const auto truly = flange_poses(m.model, m.truth, unseen.data.joint_values);
      const auto predicted = flange_poses(found.model, found.identification.estimate, unseen.data.joint_values);
      double squares = 0.0;
      for (std::size_t c = 0; c < truly.size(); ++c) {
        for (std::size_t k = 0; k < m.truth.targets.size(); ++k) {
          const Estimate& estimate = found.identification.estimate;
          squares += (m.truth.X_WB * truly[c] * m.truth.targets[k].X_FT.translation() -
                      estimate.X_WB * predicted[c] * estimate.targets[k].X_FT.translation())
                         .squaredNorm();
        }
      }
      return std::sqrt(squares);
    };
    const Calibration found = calibrate(m.model, m.data, automatic());
    const double ratio = error_of(found) / error_of(calibrate(m.model, m.data, kGeometry));
    ++result.arms;
    result.kept += found.model.effects.empty() ? 0 : 1;
    result.much_worse += ratio > 1.1 ? 1 : 0;
    result.ratio += std::log(ratio) / count;
  }
  testing::record("rigid arms", result.arms);
  testing::record("effects kept in", result.kept);
  testing::record("error at unseen configurations over geometry's", std::exp(result.ratio));
  testing::record("worse by more than 10 %", result.much_worse);
  return result;
}

TEST(EffectChoiceLongRun, RigidArmsStayRigid) {
  const Rigid found = of_rigid_arms(1000, 40);
  EXPECT_LE(found.kept, 7);
  EXPECT_LT(found.ratio, std::log(1.02));
}

TEST(EffectChoiceCampaign, ThreeHundredRigidArmsStayRigid) {
  const Rigid found = of_rigid_arms(1, 300);
  EXPECT_LE(found.kept, 21);
  EXPECT_LE(found.much_worse, 1);
  EXPECT_LT(found.ratio, std::log(1.02));
}

}  // namespace
}  // namespace kdl_calibration::effect_choice_test
