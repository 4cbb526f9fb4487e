#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <set>

#include "base/random.hpp"
#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "calibration/parameter_estimates.hpp"
#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/prediction.hpp"
#include "geometry_alone.hpp"
#include "interface/ways_to_measure.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/drive_signals.hpp"
#include "mistakes_support.hpp"
#include "planning/simulation.hpp"
#include "record.hpp"
#include "refusal.hpp"
#include "results/result_json.hpp"
#include "results/saved_calibration.hpp"
#include "selection/effect_selection.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::effect_selection_test {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using testing::fanuc;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kOddArm;
using ::testing::Not;
using testing::refusal;

/// Gives an arm these effects beside those that it has, with coefficients of this size.
void add(VirtualRobot& robot, const std::vector<EffectTerm>& terms, double size, Random& random) {
  robot.model.effects.insert(robot.model.effects.end(), terms.begin(), terms.end());
  robot.truth.effects.conservativeResize(static_cast<Eigen::Index>(robot.model.effects.size()));
  for (double& coefficient : robot.truth.effects.tail(std::ssize(terms))) {
    coefficient = size * random.normal();
  }
}

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
    for (const auto& [group, size] : effects) {
      add(robot, effect_terms(model, group, q), size, random);
    }
    measured = testing::without_sigmas(measure(q, {.sigma = sigma}));
  }

  /// [m] RMS at configurations that were not measured.
  double error_at_unseen(const CalibrationResult& found) const {
    Random none(1);
    const Measurements exact = kdl_calibration::measure(robot, unseen, {}, none);
    return error_statistics(position_errors(found.model, found.fit.identification.estimate, exact)).rms;
  }
};

CalibrationSettings automatic() {
  return {.selection = {.automatic_priors = true, .effects = {.automatic = true}},
          .validation = {.held_out = false},
          .diagnosis = {.try_readings = false}};
}

/// The same without the groups of many terms.
CalibrationSettings automatic_of_few_terms() {
  CalibrationSettings options = automatic();
  options.parameters.fix = {"tables.*", "transverse.*"};
  return options;
}

const CalibrationSettings kGeometry{.validation = {.held_out = false}, .diagnosis = {.try_readings = false}};

void expect_found_and_predicted_by(const std::vector<EffectGroup>& groups) {
  for (const EffectGroup group : groups) {
    const Arm arm(fanuc(), 10 + static_cast<unsigned>(group), 60, {{group, 3e-4}});
    const CalibrationResult found = calibrate(arm.model, arm.measured, automatic());
    ASSERT_FALSE(found.selection.tried.empty());
    EXPECT_FALSE(found.selection.tried.front().effects.empty()) << to_string(group);
    const double with = arm.error_at_unseen(found);
    const double without = arm.error_at_unseen(calibrate(arm.model, arm.measured, kGeometry));
    const std::string of_group = to_string(group);
    testing::record(of_group + ", chosen", ::testing::PrintToString(found.selection.tried.front().effects));
    testing::record(of_group + ", unseen [m]", with);
    testing::record(of_group + ", unseen by geometry [m]", without);
    EXPECT_LT(with, 0.6 * without) << to_string(group);
    EXPECT_LT(found.noise.sigma, 8e-5) << to_string(group);
  }
}

TEST(EffectSelection, FindsSagAndPredictsByIt) { expect_found_and_predicted_by({EffectGroup::gravity}); }

TEST(EffectSelectionLongRun, FindsEachEffectAndPredictsByIt) {
  expect_found_and_predicted_by({EffectGroup::gravity, EffectGroup::transverse, EffectGroup::gain,
                                 EffectGroup::backlash, EffectGroup::harmonics, EffectGroup::tables,
                                 EffectGroup::coupling});
}

/// The second joint yields with the product of two joint values, and the fourth with the sine of three times its own.
std::vector<OwnEffect> own_effects() {
  const OwnColumns product = [](const Eigen::MatrixXd& q) {
    return Eigen::MatrixXd((q.row(1).array() * q.row(2).array()).matrix().transpose());
  };
  const OwnColumns wave = [](const Eigen::MatrixXd& q) {
    return Eigen::MatrixXd((3.0 * q.row(3).array()).sin().matrix().transpose());
  };
  return {{.name = "product", .joint = "joint_2", .columns = product},
          {.name = "wave", .joint = "joint_4", .columns = wave}};
}

// As one of kdlcal's own: only the one that is there is chosen, and its size is found.
TEST(EffectSelection, ChoosesTheCallersOwnEffectThatIsThere) {
  const double size = 4e-4;
  CalibrationSettings options = automatic_of_few_terms();
  options.selection.effects.own = own_effects();
  for (const std::size_t there : {0U, 1U, 2U}) {
    Arm arm(fanuc(), 31 + static_cast<unsigned>(there), 50, {});
    if (there < 2) {
      Random random(6);
      arm.robot.model.effects = own_terms(arm.model, own_effects()[there], arm.measured.joint_values);
      arm.robot.truth.effects = Eigen::VectorXd::Constant(1, size * arm.robot.model.effects[0].scale);
      arm.measured = measure(arm.robot, arm.measured.joint_values, {.sigma = 5e-5}, random);
    }
    const CalibrationResult found = calibrate(arm.model, arm.measured, options);
    if (there == 2) {
      EXPECT_THAT(found.model.effects, IsEmpty());
      continue;
    }
    EXPECT_THAT(found.selection.tried.front().effects, ElementsAre("own." + own_effects()[there].name));
    ASSERT_EQ(found.model.effects.size(), 1U);
    const ColumnRange columns = found.fit.free.range(UnknownGroup::effects);
    const double scale = found.model.effects[0].scale;
    const double sigma = std::sqrt(found.uncertainty.covariance(columns.first, columns.first)) / scale;
    EXPECT_NEAR(found.fit.identification.estimate.effects[0] / scale, size, 4.0 * sigma);
    EXPECT_LT(sigma, 0.1 * size);
    EXPECT_LT(arm.error_at_unseen(found), 0.5 * arm.error_at_unseen(calibrate(arm.model, arm.measured, kGeometry)));
  }
}

/// An arm that warms up by 12 K and carries 0, 5 or 10 kg, with such an effect or none.
Arm in_circumstances(unsigned seed, std::optional<EffectGroup> group, double size, int count = 60) {
  Arm arm(fanuc(), seed, count, {});
  const DrivenConfigurations driven =
      simulated_signals(arm.model, arm.measured.joint_values, {}, {.circumstances = true, .seed = seed});
  Random random(6);
  if (group) {
    add(arm.robot, effect_terms(arm.model, *group, driven.joint_values, driven.signals), size, random);
  }
  arm.measured = testing::without_sigmas(measure(arm.robot, driven, {.sigma = 5e-5}, random));
  return arm;
}

void expect_circumstances_found(unsigned seeds) {
  for (unsigned seed = 0; seed < seeds; ++seed) {
    for (const EffectGroup group : {EffectGroup::expansion, EffectGroup::drift, EffectGroup::payload}) {
      const Arm arm = in_circumstances(80 + seed, group, 2e-4);
      const CalibrationResult found = calibrate(arm.model, arm.measured, automatic_of_few_terms());
      const std::vector<std::string>& names = found.selection.tried.front().effects;
      EXPECT_THAT(names, Contains(to_string(group))) << seed;
      const double without = arm.error_at_unseen(calibrate(arm.model, arm.measured, kGeometry));
      EXPECT_LT(arm.error_at_unseen(found), 0.7 * without) << to_string(group) << " " << seed;
    }
    const Arm rigid = in_circumstances(90 + seed, std::nullopt, 0.0);
    EXPECT_THAT(calibrate(rigid.model, rigid.measured, automatic_of_few_terms()).model.effects, IsEmpty()) << seed;
  }
}

TEST(EffectSelection, FindsWhatTemperatureAndPayloadDo) { expect_circumstances_found(1); }

// A steel arm grows by 12 ppm/K: a dozen configurations show it. Rigid arms and those that sag have no such effect.
TEST(EffectSelection, FindsThatAnArmGrowsInADozenConfigurations) {
  for (const int count : {12, 16}) {
    Arm warm = in_circumstances(70, std::nullopt, 0.0, count);
    const DrivenConfigurations driven =
        simulated_signals(warm.model, warm.measured.joint_values, {}, {.circumstances = true, .seed = 70});
    warm.robot.model.effects = effect_terms(warm.model, EffectGroup::expansion, driven.joint_values, driven.signals);
    warm.robot.truth.effects.resize(std::ssize(warm.robot.model.effects));
    for (std::size_t e = 0; e < warm.robot.model.effects.size(); ++e) {
      warm.robot.truth.effects[static_cast<Eigen::Index>(e)] = 12e-6 * warm.robot.model.effects[e].scale;
    }
    Random random(3);
    warm.measured = testing::without_sigmas(measure(warm.robot, driven, {.sigma = 3e-5}, random));
    const CalibrationResult found = calibrate(warm.model, warm.measured, automatic_of_few_terms());
    EXPECT_THAT(found.selection.tried.front().effects, ElementsAre("expansion")) << count;

    const Arm rigid = in_circumstances(71, std::nullopt, 0.0, count);
    EXPECT_THAT(calibrate(rigid.model, rigid.measured, automatic_of_few_terms()).model.effects, IsEmpty()) << count;
    const Arm sagging = in_circumstances(72, EffectGroup::gravity, 3e-4, count);
    const CalibrationResult bent = calibrate(sagging.model, sagging.measured, automatic_of_few_terms());
    EXPECT_THAT(bent.selection.tried.front().effects, ElementsAre("gravity")) << count;
  }
}

TEST(EffectSelectionLongRun, FindsWhatTemperatureAndPayloadDo) { expect_circumstances_found(8); }

// Where nothing is chosen, they are part of the model whether they help or not, beside the groups asked for.
TEST(EffectSelection, FitsTheCallersOwnEffectsThatAreAskedFor) {
  const Arm arm(fanuc(), 31, 50, {});
  CalibrationSettings options = kGeometry;
  options.selection.effects = {.groups = {EffectGroup::gain}, .own = own_effects()};
  const CalibrationResult found = calibrate(arm.model, arm.measured, options);
  ASSERT_FALSE(found.selection.tried.empty());
  EXPECT_THAT(found.selection.tried.front().effects, ElementsAre("gain", "own.product", "own.wave"));
}

TEST(EffectSelection, RefusesAnOwnEffectThatDoesNotVary) {
  const Arm arm(fanuc(), 31, 30, {});
  CalibrationSettings options = kGeometry;
  options.selection.effects.own = {{.name = "still", .joint = "joint_2", .columns = [](const Eigen::MatrixXd& q) {
                                      return Eigen::MatrixXd(Eigen::MatrixXd::Ones(q.cols(), 2));
                                    }}};
  EXPECT_THAT(refusal([&] { calibrate(arm.model, arm.measured, options); }),
              HasSubstr("still is the same at all configurations"));
}

TEST(EffectSelection, FindsHowOftenGearsRipple) {
  const Arm arm(fanuc(), 21, 120, {{EffectGroup::ripple, 2e-4}});
  const CalibrationResult found = calibrate(arm.model, arm.measured, automatic_of_few_terms());
  ASSERT_THAT(found.selection.tried.front().effects, Contains("ripple"));
  std::map<int, std::pair<double, double>> strongest;  // of each joint: amplitude, times a turn
  for (std::size_t e = 0; e < found.model.effects.size(); ++e) {
    const EffectTerm& term = found.model.effects[e];
    if (term.group() == EffectGroup::ripple) {
      const double amplitude =
          std::abs(found.fit.identification.estimate.effects[static_cast<Eigen::Index>(e)]) / term.scale;
      strongest[term.index] =
          std::max(strongest[term.index], std::pair(amplitude, std::get<Sinusoid>(term.function).times));
    }
  }
  EXPECT_GE(strongest.size(), 5U);
  for (const auto& [joint, swing] : strongest) {
    EXPECT_NEAR(swing.second, 100.0, 0.2) << "joint " << joint + 1;
  }
  EXPECT_LT(arm.error_at_unseen(found), 0.5 * arm.error_at_unseen(calibrate(arm.model, arm.measured, kGeometry)));
}

TEST(EffectSelection, NoRippleIsLookedForAboveHalfTheRateOfTheJointValues) {
  Arm arm(fanuc(), 22, 110, {});
  // Whole degrees, in radians with four decimals.
  const Eigen::MatrixXd whole = (arm.measured.joint_values / testing::kDegree).array().round() * testing::kDegree;
  const Eigen::MatrixXd q = (1e4 * whole).array().round().matrix() / 1e4;
  arm.robot.model.effects = ripple_terms(arm.model, q, 1, 300.0);  // which looks like 60 times at whole degrees
  arm.robot.truth.effects = Eigen::VectorXd::Constant(2, 3e-4);
  Random random(5);
  arm.measured = measure(arm.robot, q, {.sigma = 5e-5}, random);
  const CalibrationResult found = calibrate(arm.model, arm.measured, automatic_of_few_terms());
  ASSERT_THAT(found.selection.tried.front().effects, Contains("ripple"));
  for (const EffectTerm& term : found.model.effects) {
    if (term.group() == EffectGroup::ripple) {
      EXPECT_NEAR(std::get<Sinusoid>(term.function).times, 60.0, 0.5) << term.name;
    }
  }
}

void expect_no_ripple_in_rigid_arms(unsigned count) {
  for (unsigned seed = 0; seed < count; ++seed) {
    const Arm arm(seed % 2 == 0 ? fanuc() : parse_robot(kOddArm), 70 + seed, 110, {});
    for (const ModelOption& option : calibrate(arm.model, arm.measured, automatic()).selection.tried) {
      EXPECT_THAT(option.effects, ::testing::Not(Contains("ripple"))) << "seed " << seed;
    }
  }
}

TEST(EffectSelection, ARigidArmHasNoRipple) { expect_no_ripple_in_rigid_arms(1); }
TEST(EffectSelectionLongRun, ARigidArmHasNoRipple) { expect_no_ripple_in_rigid_arms(6); }

// A table that nothing was measured of over 40 degrees is not made up there.
TEST(EffectSelection, TablesAreWithheldInGaps) {
  Arm arm(fanuc(), 23, 100, {});
  const Eigen::MatrixXd q = 0.3 * arm.measured.joint_values;
  std::vector<EffectTerm> terms = table_terms(arm.model, q, 10.0 * testing::kDegree);
  std::erase_if(terms, [](const EffectTerm& term) { return term.index != 2 && term.index != 3; });
  Random random(24);
  add(arm.robot, terms, 3e-4, random);
  arm.measured = measure(arm.robot, q, {.sigma = 5e-5}, random);
  const auto q3 = arm.measured.joint_values.row(2);
  const double middle = 0.5 * (q3.minCoeff() + q3.maxCoeff());
  const Measurements gapped = subset(arm.measured, [&](const Observation& o) {
    return std::abs(arm.measured.joint_values(2, o.configuration) - middle) > 0.35;
  });
  CalibrationSettings options = kGeometry;
  Eigen::MatrixXd asked = arm.measured.joint_values.leftCols(2);
  for (Eigen::Index c = 0; c < 2; ++c) {
    asked.col(c) = gapped.joint_values.col(7);
  }
  asked(2, 0) = middle;  // where nothing was measured
  options.selection.effects = {.groups = {EffectGroup::tables}};
  options.parameters.fix = {"tables.1.*", "tables.2.*", "tables.5.*", "tables.6.*"};
  options.predict_at = {{"in the gap", "measured there"}, asked};
  const CalibrationResult found = calibrate(arm.model, gapped, options);
  int tables = 0;
  for (std::size_t e = 0; e < found.model.effects.size(); ++e) {
    const EffectTerm& term = found.model.effects[e];
    if (term.index != 2) {
      continue;
    }
    ++tables;
    const auto& withheld = std::get<JointTable>(term.function).withheld;
    ASSERT_EQ(withheld.size(), 1U);
    EXPECT_LT(withheld[0].first, middle);
    EXPECT_GT(withheld[0].first, middle - 0.4);
    EXPECT_GT(withheld[0].second, middle);
    EXPECT_LT(withheld[0].second, middle + 0.4);
    const Eigen::MatrixXd basis = effect_basis(found.model, asked);
    EXPECT_EQ(basis(static_cast<Eigen::Index>(e), 0), 0.0);
  }
  EXPECT_GT(tables, 0);
  ASSERT_FALSE(found.uncertainty.predicted.asked.empty());
  for (const AskedPoint& point : found.uncertainty.predicted.asked) {
    EXPECT_EQ(point.outside, point.configuration == "in the gap") << point.configuration;
  }
  // What a table may be there is part of the uncertainty: a joint that moves by that much.
  const auto& points = found.uncertainty.predicted.asked;
  EXPECT_GT(points.front().sigma, 3.0 * points.back().sigma);
}

TEST(EffectSelection, FindsTheSizeOfWhatIsThere) {
  const Arm arm(fanuc(), 3, 100, {{EffectGroup::gravity, 2e-4}});
  CalibrationSettings options = kGeometry;
  options.selection.effects.groups = {EffectGroup::gravity};
  const CalibrationResult found = calibrate(arm.model, arm.measured, options);
  ASSERT_EQ(found.model.effects.size(), arm.robot.model.effects.size());
  EXPECT_GT(found.model.effects.front().sigma, 1e-4);
  EXPECT_LT(found.model.effects.front().sigma, 4e-4);
  // What is true of the values lies where their covariance says.
  const ColumnRange columns = found.fit.free.range(UnknownGroup::effects);
  ASSERT_EQ(columns.count, static_cast<Eigen::Index>(found.model.effects.size()));
  int inside = 0;
  for (Eigen::Index e = 0; e < columns.count; ++e) {
    const double error = found.fit.identification.estimate.effects[e] - arm.robot.truth.effects[e];
    const double sigma = std::sqrt(found.uncertainty.covariance(columns.first + e, columns.first + e));
    inside += std::abs(error) < 2.0 * sigma ? 1 : 0;
  }
  EXPECT_GE(inside, static_cast<int>(0.8 * static_cast<double>(columns.count)));
}

TEST(EffectSelection, LeavesARigidArmRigid) {
  int kept = 0;
  double worse = 0.0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const Arm arm(seed % 2 == 0 ? fanuc() : parse_robot(kOddArm), 50 + seed, seed % 3 == 0 ? 15 : 45, {});
    const CalibrationResult found = calibrate(arm.model, arm.measured, automatic());
    kept += found.model.effects.empty() ? 0 : 1;
    worse = std::max(worse,
                     arm.error_at_unseen(found) / arm.error_at_unseen(calibrate(arm.model, arm.measured, kGeometry)));
  }
  EXPECT_EQ(kept, 0);
  EXPECT_LT(worse, 1.1);
}

TEST(EffectSelection, NothingIsChosenWhereNothingIsLeft) {
  const Arm arm(fanuc(), 4, 30, {}, 0.0);
  const CalibrationResult found = calibrate(arm.model, arm.measured, automatic());
  EXPECT_THAT(found.model.effects, IsEmpty());
  EXPECT_LT(arm.error_at_unseen(found), 1e-12);
  EXPECT_LE(found.fit.identification.iterations, 8);
}

// Of an arm that is as drawn, where priors leave the geometry nearly nominal.
TEST(EffectSelection, TheNoiseIsInPartsBesideChosenPriors) {
  Arm arm(fanuc(), 2, 30, {});
  arm.robot.truth.errors.setZero();
  Random random(3);
  const MeasuringNoise noise{.sigma = 1e-5, .repeats = 5, .common = Eigen::Vector3d::Constant(5e-5)};
  arm.measured = testing::without_sigmas(measure(arm.robot, arm.measured.joint_values, noise, random));
  const CalibrationResult found = calibrate(arm.model, arm.measured, automatic());
  ASSERT_TRUE(found.selection.tried.front().sized);
  ASSERT_TRUE(found.noise.parts.has_value());
  EXPECT_NEAR(found.noise.sigma, std::hypot(1e-5, 5e-5), 1e-5);
  EXPECT_NEAR(found.noise.independent.norm() / std::sqrt(3.0), 1e-5, 2e-6);
  EXPECT_NEAR(found.noise.common.norm() / std::sqrt(3.0), 5e-5, 1e-5);
}

TEST(EffectSelection, TooFewMeasurementsForWhatIsAskedAreRefused) {
  const Arm arm(fanuc(), 9, 9, {});  // 81 equations
  CalibrationSettings options = kGeometry;
  options.selection.effects.groups = {EffectGroup::gravity, EffectGroup::harmonics};
  EXPECT_THAT(testing::refusal([&] { calibrate(arm.model, arm.measured, options); }),
              ::testing::HasSubstr("simulation: too few measurements for the effects asked for"));
}

TEST(EffectSelection, NestedIsOfChoicesThatDidNotSeeTheConfiguration) {
  const Arm arm(fanuc(), 5, 13, {{EffectGroup::gravity, 3e-4}});
  CalibrationSettings options = automatic();
  options.validation.leave_one_out = true;
  options.validation.nested = true;
  const CalibrationResult found = calibrate(arm.model, arm.measured, options);
  ASSERT_TRUE(found.accuracy.nested_leave_one_out.has_value());
  EXPECT_EQ(found.accuracy.nested_leave_one_out->count, 39);
  EXPECT_GT(found.accuracy.nested_leave_one_out->rms, 0.9 * found.accuracy.leave_one_out->after.rms);
  EXPECT_LT(found.accuracy.nested_leave_one_out->rms, 2.0 * found.accuracy.leave_one_out->after.rms);
}

TEST(EffectSelection, HeldTermsTakeNoPart) {
  const Arm arm(fanuc(), 6, 40, {{EffectGroup::gravity, 3e-4}});
  CalibrationSettings options = kGeometry;
  options.selection.effects.groups = {EffectGroup::gravity, EffectGroup::gain};
  options.parameters.fix = {"gravity.2.*", "gain.4"};
  const CalibrationResult found = calibrate(arm.model, arm.measured, options);
  ASSERT_FALSE(found.model.effects.empty());
  for (const EffectTerm& term : found.model.effects) {
    EXPECT_NE(term.name.rfind("gravity.2.", 0), 0U) << term.name;
    EXPECT_NE(term.name, "gain.4");
  }
  // A pattern that says nothing of effects is about parameters.
  options.parameters.fix = {"*4"};
  const CalibrationResult other = calibrate(arm.model, arm.measured, options);
  EXPECT_FALSE(other.fit.free.column("Tz4").has_value());
}

TEST(EffectSelection, AnArmOnAWallSagsAlongItsOwnDirection) {
  Arm arm(fanuc(), 7, 30, {});
  arm.robot.model.gravity = KDL::Vector(1.0, 0.0, 0.0);
  Random random(8);
  add(arm.robot, effect_terms(arm.robot.model, EffectGroup::gravity, arm.measured.joint_values), 3e-4, random);
  arm.measured = measure(arm.robot, arm.measured.joint_values, {.sigma = 5e-5}, random);
  CalibrationSettings options = kGeometry;
  options.selection.effects.groups = {EffectGroup::gravity};
  const double upright = arm.error_at_unseen(calibrate(arm.model, arm.measured, options));
  ErrorModel on_wall = arm.model;
  on_wall.gravity = arm.robot.model.gravity;
  const double known = arm.error_at_unseen(calibrate(on_wall, arm.measured, options));
  EXPECT_LT(known, 0.7 * upright);
}

TEST(EffectSelection, OfFewConfigurationsOnlyWhatTheyCanTell) {
  const Arm arm(fanuc(), 9, 13, {{EffectGroup::gravity, 3e-4}});
  const CalibrationResult found = calibrate(arm.model, arm.measured, automatic());
  for (const ModelOption& option : found.selection.tried) {
    EXPECT_THAT(option.effects, ::testing::AnyOf(IsEmpty(), ::testing::ElementsAre("gravity")));
  }
}

// Ten configurations do not prove the sag that is there; models with it may be true. Radii of forty follow what was
// left out.
TEST(EffectSelection, OfFewConfigurationsModelsWithSagMayBeTrue) {
  const auto may_sag = [](const CalibrationResult& found) {
    const std::vector<PlausibleModel>& all = found.selection.plausible;
    return std::any_of(all.begin(), all.end(), [](const PlausibleModel& one) { return !one.model.effects.empty(); });
  };
  int plausible = 0;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const Arm arm(fanuc(), seed, 10, {{EffectGroup::gravity, 3e-4}});
    const CalibrationResult found = calibrate(arm.model, arm.measured, automatic());
    EXPECT_TRUE(found.selection.terms.empty());
    plausible += may_sag(found) && found.uncertainty.predicted.region.unproved > 1e-5 ? 1 : 0;
  }
  EXPECT_GE(plausible, 5);
  const Arm many(fanuc(), 3, 40, {{EffectGroup::gravity, 3e-4}});
  EXPECT_TRUE(calibrate(many.model, many.measured, automatic()).selection.plausible.empty());
  CalibrationSettings asked = automatic();
  asked.selection.effects = {.groups = {EffectGroup::gravity}, .automatic = false};
  const Arm few(fanuc(), 3, 14, {{EffectGroup::gravity, 3e-4}});
  EXPECT_TRUE(calibrate(few.model, few.measured, asked).selection.plausible.empty());
}

/// What is found of an arm whose second and third joint sag by up to half a milliradian.
struct Sagging {
  std::set<EffectGroup> groups;
  std::size_t terms = 0;
  double distance = 0.0;  ///< [m] largest from the truth
};

template <class Experiment, class Measure>
Sagging found_of(Experiment experiment, const Measure& measure) {
  VirtualRobot& robot = experiment.robot;
  robot.model.effects = load_terms(experiment.model);
  robot.truth.effects = 3e-4 * Eigen::VectorXd::Ones(std::ssize(robot.model.effects));
  for (std::size_t i = 0; i < robot.model.effects.size(); ++i) {
    robot.truth.effects[static_cast<Eigen::Index>(i)] *= robot.model.effects[i].index == 2 ? 1.0 : -1.5;
  }
  CalibrationOptions options;
  options.diagnosis.try_readings = false;
  options.validation.held_out = false;
  options.threads = 1;
  const Calibration found = calibrate(testing::bundled_robot(), measure(experiment), options);
  Sagging result{.terms = found.parts().model.effects.size()};
  for (const EffectTerm& term : found.parts().model.effects) {
    result.groups.insert(term.group());
  }
  result.distance = testing::distance_from_truth(found, experiment);
  return result;
}

// One coordinate of each configuration is too little for the thirty terms of gravity, so that those of play would take
// their place, and three for a size that thirty terms share. Every arm sags: the main terms alone are tried.
TEST(EffectSelection, SagIsFoundByFewCoordinates) {
  const auto distances = [](testing::Distances& arm) { return arm.measured(3, false, 60, 2e-5); };
  const auto sockets = [](testing::Ball& arm) {
    return arm.touched(4, 60, 2e-5, {{0.0, 0.0, 0.0}, {0.4, 0.0, 0.0}, {0.0, 0.3, 0.0}});
  };
  for (unsigned seed = 1; seed <= 4; ++seed) {
    for (const Sagging& found :
         {found_of(testing::Distances(seed), distances), found_of(testing::Ball(seed), sockets)}) {
      EXPECT_TRUE(found.groups.contains(EffectGroup::gravity)) << seed;
      EXPECT_FALSE(found.groups.contains(EffectGroup::backlash)) << seed;
      EXPECT_FALSE(found.groups.contains(EffectGroup::harmonics)) << seed;
      EXPECT_LE(found.terms, 10U) << seed;
      EXPECT_LT(found.distance, 5e-4) << seed;  // several millimetres without gravity
    }
  }
}

using Names = std::vector<std::string>;

/// The names of the groups that were not tried, with the reason.
std::map<std::string, std::string> not_tried(const CalibrationResult& found) {
  std::map<std::string, std::string> result;
  for (const NotTried& group : found.selection.not_tried) {
    result[group.what] = group.why;
  }
  return result;
}

// However many points are measured of it, a configuration shows six equations, and a group needs one and a half for
// each unknown. Twelve targets have so many unknowns that harmonics need some configurations more than they ever do.
TEST(EffectSelection, AGroupIsTriedFromTheConfigurationsOnThatItsUnknownsNeed) {
  std::vector<Eigen::Vector3d> places;
  for (int i = 0; i < 12; ++i) {
    places.emplace_back(0.2 * std::cos(i), 0.2 * std::sin(i), 0.05 + 0.01 * i);
  }
  testing::VirtualExperiment arm({.targets = testing::targets_at(places), .random = Random(3)});
  CalibrationSettings options = automatic();
  options.selection.automatic_priors = false;
  options.parameters.fix = {"gravity.*", "gain.*", "backlash.*"};
  const auto unknowns =
      static_cast<int>(arm.free.size()) +
      static_cast<int>(effect_terms(arm.model, EffectGroup::harmonics, arm.configurations(24)).size());
  const int needed = (unknowns + 3) / 4;  // 1.5 / 6 of the unknowns, rounded up
  ASSERT_GT(needed, 20);                  // what harmonics need at least
  for (const int count : {needed - 1, needed}) {
    const Measurements measured = testing::without_sigmas(arm.measure(count, {.sigma = 5e-5}));
    const CalibrationResult found = calibrate(arm.model, measured, options);
    const std::vector<ModelOption>& tried = found.selection.tried;
    EXPECT_EQ(std::any_of(tried.begin(), tried.end(),
                          [](const ModelOption& option) { return option.effects == Names{"harmonics"}; }),
              count == needed);
    const std::map<std::string, std::string> left = not_tried(found);
    ASSERT_EQ(left.count("harmonics"), count < needed ? 1U : 0U) << count;
    if (count < needed) {
      EXPECT_EQ(left.at("harmonics"), std::to_string(needed) + " configurations needed beside the geometry");
    }
  }
}

// ---- the choice itself ---------------------------------------------------------------------------------------------

/// The odd arm with these effects, measured, and fitted by its geometry alone.
struct Open : testing::VirtualExperiment {
  Measurements measured;
  CalibrationSettings options;
  Estimate optimum;

  struct How {
    unsigned seed = 1;
    int configurations = 60;
    std::vector<std::pair<EffectGroup, double>> effects;
    double noise = 5e-5;
    double range = 1.0;  // share of the joints' own
  };

  explicit Open(const How& how)
      : VirtualExperiment({.model = complete_model(parse_robot(kOddArm)),
                           .sizes = {.length = 5e-4, .angle = 5e-4},
                           .X_WB = Eigen::Isometry3d(Eigen::Translation3d(2.0, 0.5, 0.3)),
                           .random = Random(how.seed)}) {
    const Eigen::MatrixXd q = how.range * configurations(how.configurations);
    for (const auto& [group, size] : how.effects) {
      if (group == EffectGroup::ripple) {
        add(robot, ripple_terms(model, q, 3, 60.0), size, random);
        add(robot, ripple_terms(model, q, 4, 33.0), size, random);
      } else {
        add(robot, effect_terms(model, group, q), size, random);
      }
    }
    measured = testing::without_sigmas(measure(q, {.sigma = how.noise}));
    options.threads = 1;
    fit();
  }

  void fit() { optimum = identify_jointly(model, measured, nominal_start(model, measured), free).estimate; }

  ModelSelection choice() const {
    return select_effects({.model = model,
                           .measurements = measured,
                           .optimum = optimum,
                           .free = free,
                           .options = options.selection,
                           .fix = options.parameters.fix,
                           .threads = options.threads,
                           .progress = options.progress});
  }
};

/// With four effects at once, which tables can nearly be; of 1 mrad or, where the seed is even, 0.3 mrad.
Open of_four_effects(unsigned seed) {
  const double size = seed % 2 == 1 ? 1e-3 : 3e-4;
  Open arm({.seed = seed,
            .effects = {{EffectGroup::gravity, size},
                        {EffectGroup::gain, size},
                        {EffectGroup::backlash, size},
                        {EffectGroup::harmonics, size}},
            .noise = seed % 4 < 2 ? 2e-5 : 2e-4,
            .range = seed % 3 == 0 ? 1.0 : 0.4});
  arm.options.selection.effects.automatic = true;
  arm.options.parameters.fix = {"tables.1.*", "transverse.*"};
  return arm;
}

/// Of so many arms, those of which the four effects were chosen and no others.
int four_effects_found(unsigned arms) {
  const std::set<std::string> truth = {"gravity", "gain", "backlash", "harmonics"};
  int found = 0;
  for (unsigned seed = 1; seed <= arms; ++seed) {
    const Names names = of_four_effects(seed).choice().tried.front().effects;
    found += std::set(names.begin(), names.end()) == truth ? 1 : 0;
  }
  testing::record("four effects found, of " + std::to_string(arms), found);
  return found;
}

TEST(EffectSelection, FourEffectsAreFoundBesideTables) { EXPECT_GE(four_effects_found(4), 3); }
TEST(EffectSelectionLongRun, FourEffectsAreFoundBesideTables) { EXPECT_GE(four_effects_found(40), 34); }

// Swings are the largest part and are found first; gravity and harmonics are found beside them.
TEST(EffectSelection, RippleIsFoundBesideOtherEffects) {
  for (const unsigned seed : {2U, 4U}) {
    Open arm({.seed = seed,
              .configurations = 100,
              .effects = {{EffectGroup::ripple, 2e-3}, {EffectGroup::gravity, 4e-4}, {EffectGroup::harmonics, 4e-4}},
              .range = 0.5});
    arm.options.selection.effects.automatic = true;
    arm.options.parameters.fix = {"tables.*", "transverse.*"};
    EXPECT_THAT(arm.choice().tried.front().effects, ::testing::UnorderedElementsAre("ripple", "gravity", "harmonics"));
  }
}

void expect_same_choice(const ModelSelection& found, const ModelSelection& expected, const std::string& what) {
  ASSERT_EQ(found.terms.size(), expected.terms.size()) << what;
  for (std::size_t e = 0; e < expected.terms.size(); ++e) {
    EXPECT_EQ(found.terms[e].name, expected.terms[e].name) << what;
    EXPECT_NEAR(found.terms[e].sigma, expected.terms[e].sigma, 1e-4 * expected.terms[e].sigma) << what;
  }
  ASSERT_EQ(found.tried.size(), expected.tried.size()) << what;
  for (std::size_t i = 0; i < expected.tried.size(); ++i) {
    EXPECT_EQ(found.tried[i].effects, expected.tried[i].effects) << what;
    if (std::isfinite(expected.tried[i].held_out_rms)) {
      EXPECT_NEAR(found.tried[i].held_out_rms, expected.tried[i].held_out_rms, 1e-4 * expected.tried[i].held_out_rms)
          << what;
    } else {
      EXPECT_EQ(found.tried[i].held_out_rms, expected.tried[i].held_out_rms) << what;  // no fold determines it
    }
  }
  EXPECT_NEAR(found.noise, expected.noise, 1e-4 * expected.noise) << what;
  EXPECT_NEAR(found.priors.length, expected.priors.length, 1e-4 * expected.priors.length) << what;
}

// The frame of measurement, a second copy of each row, and rows that are not fitted.
TEST(EffectSelection, DoesNotDependOnTheFrameOnCopiesNorOnTestRows) {
  Open arm({.seed = 6, .configurations = 24, .effects = {{EffectGroup::gravity, 3e-4}}});
  arm.options.selection.effects.automatic = true;
  arm.options.selection.automatic_priors = true;
  const ModelSelection expected = arm.choice();
  ASSERT_THAT(expected.tried.front().effects, Contains("gravity"));

  Open elsewhere = arm;
  const Eigen::Isometry3d X =
      Eigen::Translation3d(-3.0, 1.0, 2.0) * Eigen::AngleAxisd(1.3, Eigen::Vector3d(0.2, 0.5, -0.4).normalized());
  for (Observation& o : elsewhere.measured.observations) {
    o.position() = X * o.position();
  }
  elsewhere.fit();
  expect_same_choice(elsewhere.choice(), expected, "another frame");

  Open with_copies = arm;
  for (Observation o : arm.measured.observations) {
    o.repeat = 2;
    with_copies.measured.observations.push_back(o);
  }
  expect_same_choice(with_copies.choice(), expected, "copies");

  Open with_test_rows = arm;
  for (Observation o : arm.measured.observations) {
    o.repeat = 2;
    o.split = Split::test;
    o.position().x() += 0.1;
    with_test_rows.measured.observations.push_back(o);
  }
  expect_same_choice(with_test_rows.choice(), expected, "test rows");
}

// Of four configurations three do not determine the geometry without priors. Three are too few for anything.
TEST(EffectSelection, WhatAFoldDoesNotDetermineIsNotCompared) {
  Open arm({.seed = 11, .configurations = 5});
  arm.options.selection.effects.automatic = true;
  for (const bool priors : {false, true}) {
    arm.options.selection.automatic_priors = priors;
    EXPECT_EQ(std::isfinite(arm.choice().tried.front().held_out_rms), priors);
  }
  arm.options.selection.automatic_priors = false;
  arm.options.selection.effects = {.groups = {EffectGroup::ripple}};
  arm.measured = subset(arm.measured, [](const Observation& o) { return o.configuration < 3; });
  EXPECT_THAT(arm.choice().terms, IsEmpty());
  EXPECT_THAT(arm.choice().tried, IsEmpty());
}

TEST(EffectSelection, ReportsWhichModelIsTried) {
  Open arm({.seed = 5, .configurations = 50, .effects = {{EffectGroup::tables, 1e-3}}, .range = 0.15});
  arm.options.selection.effects.groups = {EffectGroup::gain, EffectGroup::tables};
  arm.options.selection.automatic_priors = true;
  arm.options.parameters.fix = {"tables.1.*", "tables.2.*", "tables.4.*"};
  Names said;
  arm.options.progress = [&](const std::string& what, std::size_t done, std::size_t of) {
    if (done == of) {
      said.push_back(what);
    }
  };
  const std::string with = arm.choice().tried.front().sized ? " with priors" : "";
  ASSERT_GE(said.size(), 4U);
  EXPECT_EQ(said[0], "trying geometry alone");
  EXPECT_EQ(said[1], "trying geometry alone with priors");
  EXPECT_THAT(said[2], ::testing::MatchesRegex("trying gain, tables of [0-9]+ degrees" + with));
  EXPECT_EQ(said[3], "trying gain, tables of 10 degrees" + with);
}

// ---- intervals -----------------------------------------------------------------------------------------------------

/// Geometric errors that lie in their 95 % intervals, of those that the data determine.
struct Coverage {
  double inside = 0.0;
  double all = 0.0;

  void add(const CalibrationResult& found, const testing::VirtualExperiment& arm) {
    for (std::size_t p = 0; p < arm.model.parameters.size(); ++p) {
      const auto parameter =
          std::find_if(found.uncertainty.parameters.begin(), found.uncertainty.parameters.end(),
                       [&](const ParameterEstimate& e) { return e.name == arm.model.parameters[p].name; });
      if (parameter == found.uncertainty.parameters.end() || !parameter->identifiable) {
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

TEST(EffectSelectionLongRun, IntervalsHoldBesideAutomaticChoices) {
  for (const auto& [configurations, with_effects] : {std::pair{30, false}, std::pair{10, false}, std::pair{40, true}}) {
    const double share = covered(200, 60, configurations, with_effects);
    EXPECT_GT(share, 0.90);
    EXPECT_LT(share, 0.98);
  }
}

// Hardly more equations than unknowns.
TEST(EffectSelectionLongRun, IntervalsHoldWhereTenPointsSizeThePriors) {
  Coverage coverage;
  for (unsigned seed = 1; seed <= 60; ++seed) {
    testing::VirtualExperiment arm({.targets = published_targets(1),
                                    .sizes = {.length = 5e-4, .angle = 5e-4},
                                    .X_WB = Eigen::Isometry3d(Eigen::Translation3d(3.0, 0.5, 0.3)),
                                    .random = Random(seed)});
    const Measurements measured = testing::without_sigmas(arm.measure(arm.configurations(10), {.sigma = 5e-5}));
    const CalibrationResult found = calibrate(arm.model, measured, automatic());
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
    VirtualRobot rigid{.model = m.model, .truth = m.truth};
    rigid.truth.effects.resize(0);
    const Eigen::MatrixXd q = testing::measured(model, seed, {.configurations = 300}).data.joint_values;
    const Measurements unseen = measure(rigid, q, {}, random);
    const auto error_of = [&](const CalibrationResult& found) {
      return error_statistics(position_errors(found.model, found.fit.identification.estimate, unseen)).rms;
    };
    const CalibrationResult found = calibrate(m.model, m.data, automatic());
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

TEST(EffectSelectionLongRun, RigidArmsStayRigid) {
  const Rigid found = of_rigid_arms(1000, 40);
  EXPECT_LE(found.kept, 7);
  EXPECT_LT(found.ratio, std::log(1.02));
}

TEST(EffectSelectionCampaign, ThreeHundredRigidArmsStayRigid) {
  const Rigid found = of_rigid_arms(1, 300);
  EXPECT_LE(found.kept, 21);
  EXPECT_LE(found.much_worse, 1);
  EXPECT_LT(found.ratio, std::log(1.02));
}

// ---- what drives tell: the direction of approach and measured torques -----------------------------------------------

constexpr double kSize = 3e-4;  // [rad] of a term, unless another is given
constexpr double kNoise = 3e-5;

bool is_of_load(const EffectTerm& term) { return std::holds_alternative<LoadSide>(term.function); }

/// An arm whose joints move by what its drives tell, and what was measured of it on its way.
struct DrivenArm : testing::VirtualExperiment {
  Measurements measured;
  Measurements unseen;  // without noise

  DrivenArm(EffectGroup group, unsigned seed, double size = kSize)
      : VirtualExperiment({.sizes = {.length = 5e-4, .angle = 5e-4},
                           .X_WB = Eigen::Isometry3d(Eigen::Translation3d(3.0, 0.5, 0.3)),
                           .random = Random(seed)}) {
    const Eigen::MatrixXd q = configurations(60);
    const Eigen::MatrixXd elsewhere = configurations(100);
    const SimulatedSignals told{.approach = true, .torques = true, .seed = seed};
    const DrivenConfigurations driven = simulated_signals(model, q, {}, told);
    std::vector<EffectTerm> terms = effect_terms(model, group, q, driven.signals);
    std::erase_if(terms, is_of_load);
    add(robot, terms, size, random);
    measured = testing::without_sigmas(kdl_calibration::measure(robot, driven, {.sigma = kNoise}, random));
    unseen = kdl_calibration::measure(robot, simulated_signals(model, elsewhere, q, told), {}, random);
  }

  double error_at_unseen(const CalibrationResult& found) const {
    return error_statistics(position_errors(found.model, found.fit.identification.estimate, unseen)).rms;
  }
};

CalibrationSettings named(EffectGroup group) {
  return {.selection = {.automatic_priors = true, .effects = {.groups = {group}}},
          .validation = {.held_out = false},
          .diagnosis = {.try_readings = false}};
}

const DrivenArm& with_play() {
  static const DrivenArm arm(EffectGroup::backlash, 3);
  return arm;
}

const DrivenArm& that_gives_way() {
  static const DrivenArm arm(EffectGroup::torque, 4);
  return arm;
}

/// Where the unseen configurations are approached from is known.
const CalibrationResult& found_with_play() {
  static const CalibrationResult found = [] {
    CalibrationSettings options = automatic();
    const Measurements& unseen = with_play().unseen;
    options.predict_at = {
        .names = unseen.configurations, .joint_values = unseen.joint_values, .signals = unseen.signals};
    return calibrate(with_play().model, with_play().measured, options);
  }();
  return found;
}

const CalibrationResult& found_by_torques() {
  static const CalibrationResult found =
      calibrate(that_gives_way().model, that_gives_way().measured, named(EffectGroup::torque));
  return found;
}

/// Every true coefficient within four of its standard deviations.
void expect_coefficients(const CalibrationResult& found, const DrivenArm& arm) {
  for (std::size_t e = 0; e < arm.robot.model.effects.size(); ++e) {
    const std::string& name = arm.robot.model.effects[e].name;
    const auto parameter = std::find_if(found.uncertainty.parameters.begin(), found.uncertainty.parameters.end(),
                                        [&](const ParameterEstimate& p) { return p.name == name; });
    ASSERT_NE(parameter, found.uncertainty.parameters.end()) << name;
    EXPECT_LT(parameter->std, 0.3 * kSize) << name;
    EXPECT_NEAR(parameter->value, arm.robot.truth.effects[static_cast<Eigen::Index>(e)], 4.0 * parameter->std) << name;
  }
}

TEST(DriveEffects, WhereTheOrderIsKnownBacklashHasADirection) {
  const CalibrationResult& found = found_with_play();
  ASSERT_THAT(found.selection.tried.front().effects, Contains("backlash"));
  expect_coefficients(found, with_play());
  Measurements of_no_order = with_play().measured;
  of_no_order.signals = {};
  const double without = with_play().error_at_unseen(calibrate(with_play().model, of_no_order, automatic()));
  EXPECT_LT(with_play().error_at_unseen(found), 0.3 * without);
}

TEST(DriveEffects, WhereItIsNotKnownPredictionsAreAsUncertainAsThePlayIsWide) {
  CalibrationSettings options = automatic();
  const Measurements& unseen = with_play().unseen;
  options.predict_at = {.names = unseen.configurations, .joint_values = unseen.joint_values, .signals = {}};
  const CalibrationResult unknown = calibrate(with_play().model, with_play().measured, options);
  const CalibrationResult& known = found_with_play();
  ASSERT_EQ(known.uncertainty.predicted.asked.size(), 3U * unseen.configurations.size());
  double normalised = 0.0;
  for (std::size_t i = 0; i < known.uncertainty.predicted.asked.size(); i += 3) {
    const AskedPoint& with = known.uncertainty.predicted.asked[i];
    const AskedPoint& without = unknown.uncertainty.predicted.asked[i];
    EXPECT_GT(without.radius_95, with.radius_95);
    const Eigen::Vector3d error = unseen.observations[i].position() - without.position_W;
    normalised += error.squaredNorm() / (without.sigma * without.sigma);
    // The play of every joint, by the nominal arm's joints moved by hand.
    const auto c = static_cast<Eigen::Index>(i / 3);
    double variance = with.sigma * with.sigma;
    for (std::size_t e = 0; e < known.model.effects.size(); ++e) {
      const EffectTerm& term = known.model.effects[e];
      if (!std::holds_alternative<ApproachSide>(term.function)) {
        continue;
      }
      const double play = known.fit.identification.estimate.effects[static_cast<Eigen::Index>(e)];
      Eigen::MatrixXd beside = unseen.joint_values.col(c).replicate(1, 2);
      beside(term.index, 0) += play;
      Estimate rigid = known.fit.identification.estimate;
      rigid.effects.setZero();
      const auto X_BF = flange_poses(known.model, rigid, beside);
      const Eigen::Vector3d target = rigid.frames.targets[0].X_FT.translation();
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
    const DrivenArm arm(EffectGroup::backlash, seed, 10.0 * kSize);
    EXPECT_THAT(calibrate(arm.model, arm.measured, automatic()).diagnosis.findings, ::testing::IsEmpty())
        << "seed " << seed;
  }
}

TEST(DriveEffects, EveryStageOfACalibrationKnowsThem) {
  for (const DrivenArm* arm : {&with_play(), &that_gives_way()}) {
    CalibrationSettings options = named(arm == &with_play() ? EffectGroup::backlash : EffectGroup::torque);
    options.validation.held_out = true;
    options.validation.nested = true;
    options.diagnosis.try_readings = true;
    Measurements unseen = arm->unseen;
    Random random(8);
    for (Observation& o : unseen.observations) {
      o.split = Split::test;
      for (double& coordinate : o.position()) {
        coordinate += kNoise * random.normal();
      }
    }
    const CalibrationResult found = calibrate(arm->model, joined(arm->measured, unseen), options);
    EXPECT_TRUE(found.trusted());
    EXPECT_TRUE(found.diagnosis.findings.empty());
    EXPECT_TRUE(found.diagnosis.alternative_readings.empty());
    // What is left is noise: of a point 1.7 sigma, and what 33 parameters and the effects cost.
    EXPECT_LT(found.accuracy.train.after.rms, 1.8 * kNoise);
    EXPECT_LT(found.accuracy.test->after.rms, 2.5 * kNoise);
    EXPECT_LT(found.accuracy.held_out()->after.rms, 2.5 * kNoise);
    EXPECT_LT(found.accuracy.nested_leave_one_out->rms, 2.5 * kNoise);
    EXPECT_GT(found.exported.train.rms, 5.0 * kNoise) << "a URDF knows neither";
  }
}

TEST(DriveEffects, MeasuredTorquesAreUsedWhereTheyAreNamed) {
  const CalibrationResult unnamed = calibrate(that_gives_way().model, that_gives_way().measured, automatic());
  for (const ModelOption& option : unnamed.selection.tried) {
    EXPECT_THAT(option.effects, Not(Contains("torque")));
  }
  const CalibrationResult& found = found_by_torques();
  expect_coefficients(found, that_gives_way());
  EXPECT_LT(that_gives_way().error_at_unseen(found), 0.3 * that_gives_way().error_at_unseen(unnamed));
  EXPECT_EQ(found.uncertainty.predicted.workspace.count, 0U) << "where nobody measured a torque";
  EXPECT_GT(found.uncertainty.predicted.measured.count, 0U);
}

// OptionCheck has the other cases.
TEST(DriveEffects, TorquesThatAreMissingAreRefused) {
  Measurements measured = that_gives_way().measured;
  measured.signals.torques(1, 4) = std::nan("");
  EXPECT_THAT(refusal([&] { calibrate(that_gives_way().model, measured, named(EffectGroup::torque)); }),
              HasSubstr("configuration '5' has no torque of joint_2, expected"));
}

TEST(DriveEffects, AResultThatIsReadBackPredictsTheSame) {
  for (const DrivenArm* arm : {&with_play(), &that_gives_way()}) {
    const CalibrationSettings options = named(arm == &with_play() ? EffectGroup::backlash : EffectGroup::torque);
    const CalibrationResult wrote = calibrate(arm->model, arm->measured, options);
    const Robot robot = testing::fanuc();
    const CalibrationParts read = parse_calibration(result_json(robot, arm->measured, wrote), robot);
    ASSERT_EQ(read.model.effects.size(), wrote.model.effects.size());
    const auto X_BF = flange_poses(read.model, read.estimate, arm->unseen);
    const auto expected = flange_poses(wrote.model, wrote.fit.identification.estimate, arm->unseen);
    for (std::size_t c = 0; c < X_BF.size(); ++c) {
      EXPECT_LT((X_BF[c].matrix() - expected[c].matrix()).norm(), 1e-12);
    }
  }
  const CalibrationParts read =
      parse_calibration(result_json(testing::fanuc(), that_gives_way().measured, found_by_torques()), testing::fanuc());
  EXPECT_THAT(refusal([&] { flange_poses(read.model, read.estimate, that_gives_way().unseen.joint_values); }),
              HasSubstr("no measured torque of joint_1, expected one for the effect torque.1"));
}

}  // namespace
}  // namespace kdl_calibration::effect_selection_test
