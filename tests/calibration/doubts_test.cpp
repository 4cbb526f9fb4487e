// What a finished calibration is doubted for and what is said beside that, word by word and on both sides of each
// threshold, of calibrations that are made up; then all that is said of measured arms.

#include "calibration/doubts.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <string>
#include <tuple>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "calibration/validation_stage.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "mistake_table.hpp"
#include "model/kinematics.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "results/calibrated_urdf.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::doubts_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

const std::string kWrongInput =
    "check the robot, the joint values with their units, signs and order, and the names of the targets";
const std::string kMeasureMore =
    "; predictions hold where it was measured, single parameters do not; measure more configurations, in which every "
    "joint turns and the tool points elsewhere";

/// A calibration of the FANUC of which there is nothing to say.
struct Found {
  CalibrationResult calibration;
  Measurements measured;
  CalibrationSettings options;

  Found() {
    calibration.model = complete_model(testing::fanuc());
    calibration.fit.identification.termination = Termination::converged;
    calibration.fit.identification.estimate.errors =
        Eigen::VectorXd::Zero(static_cast<Eigen::Index>(calibration.model.parameters.size()));
    calibration.accuracy.train = {.before = {.count = 9, .rms = 2e-3}, .after = {.count = 9, .rms = 1e-4}};
    calibration.uncertainty.predicted.measured.count = 3;
    calibration.noise.source = NoiseSource::parts;
    calibration.noise.degrees_of_freedom = 100.0;
    measured.joints = {"joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"};
    measured.joint_values = Eigen::MatrixXd::Zero(6, 3);
    for (std::int32_t c = 0; c < 3; ++c) {
      measured.joint_values.col(c).setConstant(0.1 * c);
      measured.configurations.push_back(std::to_string(c + 1));
      measured.observations.push_back({.position = Eigen::Vector3d::Zero(), .configuration = c});
    }
    measured.targets = {"A"};
  }

  std::vector<std::string> doubted() const {
    std::vector<std::string> result;
    for (const Doubt& doubt : doubts(calibration, calibration.diagnosis, measured, options.parameters.model)) {
      result.push_back(std::string(to_string(doubt.cause)) + ": " + doubt.message);
    }
    return result;
  }
  std::vector<std::string> warned(const std::string& ambiguity = {}) const {
    return warnings(calibration, calibration.diagnosis, measured, ambiguity);
  }
};

TEST(DoubtsByHand, OfNothingThereAreNone) {
  const Found found;
  EXPECT_THAT(found.doubted(), IsEmpty());
  EXPECT_THAT(found.warned(), IsEmpty());
}

TEST(DoubtsByHand, AStalledFitStatesItsMisfit) {
  Found found;
  found.calibration.fit.identification.termination = Termination::stalled;
  EXPECT_THAT(found.doubted(),
              ElementsAre("not_converged: the fit did not converge: it stands at a misfit of 0.1 mm and no arm near "
                          "the nominal one explains the measurements better; " +
                          kWrongInput));
}

TEST(DoubtsByHand, WhatIsNotDeterminedIsNamedUpToSevenNames) {
  std::vector<std::string> names;
  for (int count = 1; count <= 9; ++count) {
    names.push_back("p" + std::to_string(count));
    const std::string list = count == 1   ? "1 parameter (p1)"
                             : count == 2 ? "2 parameters (p1, p2)"
                             : count == 7 ? "7 parameters (p1, p2, p3, p4, p5, p6, p7)"
                             : count == 8 ? "8 parameters (p1, p2, p3, p4, p5, p6 and 2 more)"
                             : count == 9 ? "9 parameters (p1, p2, p3, p4, p5, p6 and 3 more)"
                                          : "";
    if (list.empty()) {
      continue;
    }
    Found found;
    found.calibration.uncertainty.fixed_by_gauge = names;
    EXPECT_THAT(found.doubted(),
                ElementsAre("not_determined: the measurements do not determine " + list + kMeasureMore));
  }
}

TEST(DoubtsByHand, NothingThatIsPredictedOrARankThatIsLackingIsADoubtOfItsOwn) {
  const std::string message = "not_determined: the measurements do not determine all parameters" + kMeasureMore;
  Found unpredicted;
  unpredicted.calibration.uncertainty.predicted.measured.count = 0;
  EXPECT_THAT(unpredicted.doubted(), ElementsAre(message));
  Found open;
  open.calibration.fit.identification.termination = Termination::rank_deficient;
  EXPECT_THAT(open.doubted(), ElementsAre(message));
}

TEST(DoubtsByHand, JointsStandStillBelowATenthOfAMilliradian) {
  const auto said = [](double range, int joints) {
    Found found;
    found.calibration.uncertainty.fixed_by_gauge = {"p"};
    for (int joint = 0; joint < joints; ++joint) {
      found.measured.joint_values.row(joint + 2) << 0.3, 0.3 + range, 0.3;
    }
    return found.doubted().at(0);
  };
  EXPECT_THAT(said(0.99e-4, 1), HasSubstr("(p): joint_3 never moves; predictions"));
  EXPECT_THAT(said(0.99e-4, 2), HasSubstr("(p): joint_3, joint_4 never move; predictions"));
  EXPECT_THAT(said(1.01e-4, 1), HasSubstr("(p); predictions"));
  Found tested;  // it moves in test rows alone
  tested.calibration.uncertainty.fixed_by_gauge = {"p"};
  tested.measured.joint_values.row(0) << 0.2, 0.2, 1.0;
  tested.measured.observations[2].split = Split::test;
  EXPECT_THAT(tested.doubted().at(0), HasSubstr("(p): joint_1 never moves; predictions"));
}

// Of the complete model's 38 geometric errors and frames much cannot be told apart by any measurement.
TEST(DoubtsByHand, OfTheCompleteModelOnlyWhatTheTargetsCouldShowCounts) {
  Found found;
  const ErrorModel& model = found.calibration.model;
  found.calibration.fit.candidates = Unknowns(model, {}, {"dq2", "dq3", "Tx1", "Ty1"});
  found.calibration.fit.reduction.kept = {"dq2", "dq3", "Tx1", "Rz3"};
  found.calibration.uncertainty.fixed_by_gauge = {"Ty1"};
  found.options.parameters.model = ModelChoice::complete;
  found.calibration.fit.free = Unknowns(model, {}, {"dq2", "dq3", "Ty1"});
  EXPECT_THAT(found.doubted(), IsEmpty()) << "three of three";
  found.calibration.fit.free = Unknowns(model, {}, {"dq2", "Ty1"});
  EXPECT_THAT(found.doubted(), SizeIs(1)) << "two of three";
  found.calibration.model.effects.resize(2);
  found.calibration.fit.free = found.calibration.fit.free.with_all(found.calibration.model, UnknownGroup::effects);
  EXPECT_THAT(found.doubted(), SizeIs(1)) << "effects are none of them";
  found.calibration.fit.free = Unknowns(model, {}, {"dq2", "dq3", "Ty1"});
  found.options.parameters.model = ModelChoice::irreducible;
  EXPECT_THAT(found.doubted(), SizeIs(1));
}

TEST(DoubtsByHand, TestRowsMayBeAsGoodAsNominalAndHeldOutRowsMayNot) {
  const auto pair = [](double before, double after) {
    return BeforeAfter{.before = {.count = 5, .rms = before}, .after = {.count = 5, .rms = after}};
  };
  Found tested;
  tested.calibration.accuracy.test = pair(1e-3, 1e-3);
  EXPECT_THAT(tested.doubted(), IsEmpty());
  tested.calibration.accuracy.test = pair(1e-3, 1.001e-3);
  EXPECT_THAT(tested.doubted(),
              ElementsAre("worse_than_nominal: the calibrated robot is no better than the nominal one at the test "
                          "rows: 1.001 mm against 1 mm; check that they were measured under the same conditions and in "
                          "the same region"));
  Found held_out;
  held_out.calibration.accuracy.leave_one_out = pair(1.001e-3, 1e-3);
  EXPECT_FALSE(is_no_better_than_nominal(held_out.calibration.accuracy));
  held_out.calibration.accuracy.leave_one_out = pair(1e-3, 1e-3);
  EXPECT_TRUE(is_no_better_than_nominal(held_out.calibration.accuracy));
  EXPECT_THAT(
      held_out.doubted(),
      ElementsAre(
          "worse_than_nominal: the calibrated robot is no better than the nominal one at configurations that "
          "were not fitted (leave-one-out): 1 mm against 1 mm; the errors may be too small for these measurements, "
          "the measurements too few, or some input wrong: " +
              kWrongInput,
          "nominal_kept: the calibration does not help: the nominal robot is kept, and the URDF to write is "
          "the one that was read"));
  held_out.calibration.accuracy.leave_one_out->after.rms = kInfinity;
  EXPECT_TRUE(is_no_better_than_nominal(held_out.calibration.accuracy));
  held_out.calibration.accuracy.leave_one_out->after.count = 0;
  EXPECT_FALSE(is_no_better_than_nominal(held_out.calibration.accuracy));
  EXPECT_FALSE(is_no_better_than_nominal(Found().calibration.accuracy));
}

TEST(DoubtsByHand, ARobotWithoutAReachHasNoLargeMisfit) {
  Found found;
  found.calibration.accuracy.train.after.rms = 10.0;
  EXPECT_THAT(found.doubted(), SizeIs(1));
  found.calibration.model.tip_origin.p = KDL::Vector::Zero();
  for (MovingJoint& joint : found.calibration.model.joints) {
    joint.origin.p = KDL::Vector::Zero();
  }
  EXPECT_THAT(found.doubted(), IsEmpty());
}

// Of a slide without limits nobody knows how far it goes.
TEST(DoubtsByHand, OnlySlidesWithBothLimitsAddToTheReach) {
  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  const double whole = reach(model);
  model.joints[1].upper = 0.7;
  EXPECT_NEAR(reach(model), whole + 0.2, 1e-12);
  model.joints[1].upper.reset();
  EXPECT_NEAR(reach(model), whole - 1.0, 1e-12);
  model.joints[1].upper = 0.5;
  model.joints[1].lower.reset();
  EXPECT_NEAR(reach(model), whole - 1.0, 1e-12);
  model.joints[0].origin.p = KDL::Vector(7.0, 0.0, 0.0);  // where it stands
  EXPECT_NEAR(reach(model), whole - 1.0, 1e-12);
}

TEST(DoubtsByHand, WhatIsInfinitelyUncertainIsNamedElsewhere) {
  Found found;
  found.calibration.uncertainty.parameters = {{.name = "Tz2", .kind = ParameterKind::translation, .std = 2.0},
                                              {.name = "Rz3", .kind = ParameterKind::rotation, .std = 0.6},
                                              {.name = "Ry2", .kind = ParameterKind::rotation, .std = 0.4},
                                              {.name = "Tx1", .kind = ParameterKind::translation, .std = kInfinity}};
  EXPECT_THAT(found.doubted(),
              ElementsAre("unknown_length: the uncertainty exceeds the link itself for Tz2, Rz3; measure more "
                          "configurations, or hold what is known"));
}

TEST(DoubtsByHand, ReadingsAreDoubtsOrRemarks) {
  Found found;
  found.calibration.diagnosis.alternative_readings = {
      {.cause = Cause::length_unit, .message = "they are feet", .doubt = true},
      {.cause = Cause::copied_rows, .message = "they are copies", .doubt = false}};
  EXPECT_THAT(found.doubted(), ElementsAre("length_unit: they are feet"));
  EXPECT_THAT(found.warned(), ElementsAre("they are copies"));
}

// ---- warnings ------------------------------------------------------------------------------------------------------

TEST(WarningsByHand, WhatIsTiedIsNamedWhereNoPriorsToldItApart) {
  Found found;
  found.calibration.uncertainty.identifiability.tied = {{"dq2"}, {"Tx1", "Ry1"}};
  EXPECT_THAT(found.warned(), IsEmpty());
  const auto tied =
      ElementsAre("the measurements do not depend on dq2", "the measurements cannot tell apart: Tx1, Ry1");
  found.calibration.fit.identification.termination = Termination::rank_deficient;
  EXPECT_THAT(found.warned(), tied);
  found.calibration.fit.identification.termination = Termination::converged;
  found.calibration.uncertainty.fixed_by_gauge = {"Ry1", "dq2"};
  EXPECT_THAT(found.warned(), SizeIs(3));
  EXPECT_EQ(found.warned().at(2),
            "fixed by gauge: Ry1, dq2 (errors at zero, frames as registered); predictions hold where it was measured, "
            "single parameters do not");
  found.calibration.fit.minimum_norm = true;
  EXPECT_THAT(found.warned(),
              ElementsAre("what the measurements cannot tell apart (Ry1, dq2) was set to the smallest errors that "
                          "fit; predictions hold, single parameters do not"));
}

TEST(WarningsByHand, FindingsAndTheRegistrationAreHandedOn) {
  Found found;
  found.calibration.diagnosis.findings = {{.message = "A slipped"}};
  EXPECT_THAT(found.warned("two answers"), ElementsAre("measurements: A slipped", "registration: two answers"));
}

TEST(WarningsByHand, ConfigurationsOutsideTheLimitsAreCounted) {
  Found found;
  found.measured.joint_values(1, 2) = 100.0;
  EXPECT_THAT(found.warned(), ElementsAre("1 of 3 configurations have joint values outside the limits of the URDF"));
  found.calibration.model.joints[1].upper.reset();
  EXPECT_THAT(found.warned(), IsEmpty());
  found.measured.joint_values(1, 2) = -100.0;
  found.calibration.model.joints[1].lower.reset();
  EXPECT_THAT(found.warned(), IsEmpty());
}

TEST(WarningsByHand, ResidualsAboveTheStatedNoise) {
  Found found;
  found.calibration.noise.variance_factor = 1.0;
  EXPECT_THAT(found.warned(), IsEmpty());
  found.calibration.noise.variance_factor = 2.25;
  EXPECT_THAT(found.warned(),
              ElementsAre("the residuals are 1.5 times the stated noise; the uncertainties were scaled up by that"));
  found.calibration.noise.parts.emplace();
  EXPECT_THAT(found.warned(), ElementsAre("the residuals are 1.5 times the stated noise; what is beyond it counts as "
                                          "misfit of the model"));
}

TEST(WarningsByHand, FewDataAreLessThanTenDegreesOfFreedom) {
  Found found;
  found.calibration.noise.degrees_of_freedom = 10.0;
  EXPECT_THAT(found.warned(), IsEmpty());
  found.calibration.noise.degrees_of_freedom = 9.96;
  EXPECT_THAT(found.warned(), ElementsAre("few data: all uncertainties rest on 9.96 degrees of freedom; measure more "
                                          "configurations or state the noise"));
  found.calibration.noise.source = NoiseSource::stated;
  EXPECT_THAT(found.warned(), IsEmpty());
}

TEST(WarningsByHand, LackOfFitIsBelowOneInAThousand) {
  Found found;
  found.calibration.noise.lack_of_fit.emplace().p_value = 1e-3;
  EXPECT_THAT(found.warned(), IsEmpty());
  found.calibration.noise.lack_of_fit->p_value = 0.99e-3;
  EXPECT_THAT(found.warned(),
              ElementsAre("lack of fit: the residuals are larger than the scatter of the repeats explains"));
}

TEST(WarningsByHand, EffectsMayPredictWorseThanTheGeometryAlone) {
  Found found;
  BeforeAfter& left_out = found.calibration.accuracy.leave_one_out.emplace();
  left_out = {.before = {.count = 9, .rms = 2e-3}, .after = {.count = 9, .rms = 1.02e-4}, .rigid = std::nullopt};
  EXPECT_THAT(found.warned(), IsEmpty()) << "no effects";
  left_out.rigid = {.count = 9, .rms = 1e-4};
  EXPECT_THAT(found.warned(), IsEmpty()) << "by two per cent";
  left_out.after.rms = 1.021e-4;
  EXPECT_THAT(found.warned(),
              ElementsAre("the effects make predictions worse: configurations left out of the fit are missed by 0.1021 "
                          "mm with the effects and by 0.1 mm by the geometry alone; leave the effects out, or let "
                          "--effects auto choose those that help"));
  left_out.rigid->count = 0;
  EXPECT_THAT(found.warned(), IsEmpty());
}

TEST(WarningsByHand, ElsewhereAPointMayBeWorseThanNominal) {
  Found found;
  ErrorStatistics& workspace = found.calibration.uncertainty.predicted.workspace;
  workspace = {.count = 100, .rms = 2e-3};
  EXPECT_THAT(found.warned(), IsEmpty()) << "as good";
  workspace.rms = 2.5e-3;
  EXPECT_THAT(found.warned(),
              ElementsAre("beyond the measured configurations a point may be predicted worse than by the nominal "
                          "robot: 1 sigma of 2.5 mm over the whole workspace, nominal error 2 mm; use the calibrated "
                          "robot where it was measured"));
  EXPECT_TRUE(is_uncertain_elsewhere(found.calibration));
  workspace.count = 1;
  EXPECT_TRUE(is_uncertain_elsewhere(found.calibration));
  workspace.count = 0;
  EXPECT_FALSE(is_uncertain_elsewhere(found.calibration));
  workspace.count = 100;
  found.calibration.diagnosis.doubts.push_back({.cause = Cause::not_determined, .message = ""});
  EXPECT_FALSE(is_uncertain_elsewhere(found.calibration));
}

// ---- calibrations of measured arms
// -----------------------------------------------------------------------------------

using ::testing::Contains;
using ::testing::ElementsAreArray;
using testing::fanuc;
using testing::kDegree;
using ::testing::MatchesRegex;
using ::testing::Not;

constexpr double kNoise = 3e-5;

/// The R-2000iC/165F with errors of a millimetre and a milliradian in 25 configurations, no sigma stated.
struct Series : testing::VirtualExperiment {
  Measurements measured;

  explicit Series(std::uint64_t seed = 1, const MeasuringNoise& noise = {.sigma = kNoise},
                  const std::vector<TargetFrame>& stated = published_targets())
      : VirtualExperiment({.targets = stated, .random = Random(seed)}) {
    measure_at(configurations(25), noise);
  }

  void measure_at(const Eigen::MatrixXd& q, const MeasuringNoise& noise = {.sigma = kNoise}) {
    measured = testing::without_sigmas(measure(q, noise));
  }

  void state_sigma(double sigma) {
    for (Observation& observation : measured.observations) {
      observation.sigma = sigma;
    }
  }

  /// Of targets 0, 1, 2 in configurations 1, 2, …
  Observation& row(int configuration, int target) {
    return measured.observations.at(3 * (static_cast<std::size_t>(configuration) - 1) +
                                    static_cast<std::size_t>(target));
  }

  CalibrationResult calibrated(const CalibrationSettings& options = {}) const {
    return calibrate(model, measured, options);
  }
};

// An encoder of joint 3 that is off by `amplitude` twice per turn, which no geometry explains.
Measurements with_ripple(const Series& clean, double amplitude, const MeasuringNoise& noise) {
  Random random(7);
  const Eigen::MatrixXd q = clean.measured.joint_values;
  Eigen::MatrixXd off = q;
  off.row(2).array() += amplitude * (2.0 * q.row(2).array()).sin();
  Measurements measured = testing::without_sigmas(measure(clean.robot, off, noise, random));
  measured.joint_values = q;
  return measured;
}

// ---- each warning --------------------------------------------------------------------------------------------------

struct Scenario {
  const char* name;
  std::function<CalibrationResult()> calibrated;
  Termination termination;
  std::vector<std::string> causes;    // of all doubts, in their order
  std::vector<std::string> warnings;  // extended regular expressions of all of them, in their order
};

const Series& clean_series() {
  static const Series series;
  return series;
}

const CalibrationResult& clean() {
  static const CalibrationResult found = clean_series().calibrated();
  return found;
}

CalibrationResult with_too_few_iterations() { return Series().calibrated({.estimator = {.iterations = 1}}); }

const CalibrationResult& with_a_held_joint() {
  static const CalibrationResult found = [] {
    Series s;
    Eigen::MatrixXd q = s.measured.joint_values;
    q.row(3).setConstant(0.6);
    s.measure_at(q);
    return s.calibrated();
  }();
  return found;
}

// The only target sits on the axis of joint 6, and stays there.
CalibrationResult without_effect_of_joint_6() {
  const std::vector<TargetFrame> targets = testing::targets_at({{0.0, 0.1, 0.0}});
  Series s(2, {.sigma = kNoise}, targets);
  s.robot.truth.targets = targets;
  s.measure_at(s.measured.joint_values);
  return s.calibrated({.parameters = {.fix = {"?x6", "?z6"}, .free = {"dq6"}, .known_targets = targets}});
}

// The only target moves on a circle.
CalibrationResult with_one_moving_joint(double noise) {
  Series s(3, {.sigma = kNoise}, published_targets(1));
  Eigen::MatrixXd q = s.measured.joint_values.col(0).replicate(1, 25);
  q.row(0).setLinSpaced(-1.0, 1.0);
  s.measure_at(q, {.sigma = noise});
  return s.calibrated();
}

CalibrationResult outside_the_limits() {
  Series s;
  Eigen::MatrixXd q = s.measured.joint_values;
  for (const Eigen::Index c : {2, 5, 9}) {
    q(1, c) = *s.model.joints[1].upper + 0.1;
  }
  s.measure_at(q);
  return s.calibrated();
}

CalibrationResult with_stated_sigma(double sigma) {
  Series s;
  s.state_sigma(sigma);
  return s.calibrated();
}

const MeasuringNoise kRepeats{.sigma = 1e-5, .repeats = 5};

CalibrationResult with_misfit() {
  Series s;
  s.measured = with_ripple(s, 0.001, kRepeats);
  return s.calibrated();
}

CalibrationResult with_repeats() {
  Series s;
  s.measured = with_ripple(s, 0.0, kRepeats);
  return s.calibrated();
}

CalibrationResult of_another_robot() {
  Series s;
  s.measured = with_ripple(s, 0.05, {.sigma = kNoise});
  return s.calibrated();
}

const CalibrationResult& without_errors() {
  static const CalibrationResult found = [] {
    Series s;
    s.robot.truth.errors.setZero();
    s.measure_at(s.measured.joint_values);
    return s.calibrated();
  }();
  return found;
}

CalibrationResult with_test_rows_of_another_robot() {
  Series s;
  Series nominal(9);
  nominal.robot.truth.errors.setZero();
  nominal.robot.truth.X_WB = s.robot.truth.X_WB;
  nominal.robot.truth.targets = s.robot.truth.targets;
  nominal.measure_at(nominal.measured.joint_values);
  for (Observation& observation : nominal.measured.observations) {
    observation.split = Split::test;
  }
  s.measured = joined(s.measured, nominal.measured);
  return s.calibrated();
}

CalibrationResult with_priors(double size) {
  return Series().calibrated({.selection = {.priors = {.length = size, .angle = size}}});
}

CalibrationResult with_few_rows(int configurations) {
  Series s(4, {.sigma = kNoise}, published_targets(1));
  const Eigen::MatrixXd q = s.measured.joint_values.leftCols(configurations);
  s.measure_at(q);
  return s.calibrated();
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<Scenario> scenarios() {
  const std::string gauge =
      R"( \(errors at zero, frames as registered\); predictions hold where it was measured, single parameters do not)";
  const auto with_sigma = [](double sigma) { return [sigma] { return with_stated_sigma(sigma); }; };
  return {
      {"clean", clean, Termination::converged, {}, {}},
      {"clean repeats", with_repeats, Termination::converged, {}, {}},
      {"noise stated as it is", with_sigma(kNoise), Termination::converged, {}, {}},
      {"noise stated too large", with_sigma(2.0 * kNoise), Termination::converged, {}, {}},
      {"noise stated a little too small", with_sigma(0.95 * kNoise), Termination::converged, {}, {}},
      {"noise stated too small",
       with_sigma(0.5 * kNoise),
       Termination::converged,
       {},
       {R"(the residuals are (1\.[89]|2\.[01])[0-9]* times the stated noise; what is beyond it counts as misfit of the model)"}},
      {"too few iterations",
       with_too_few_iterations,
       Termination::iteration_limit,
       {"not_converged"},
       {"25 of 25 leave-one-out fits did not converge"}},
      {"too few iterations, asked for the fitted rows alone",
       [] { return Series().calibrated({.estimator = {.iterations = 1}, .validation = {.held_out = false}}); },
       Termination::iteration_limit,
       {"not_converged"},
       {}},
      {"held joint",
       with_a_held_joint,
       Termination::rank_deficient,
       {},
       {"the measurements cannot tell apart: .*dq3.*, .*Rz4.*", "fixed by gauge: .*Rz4" + gauge}},
      {"no effect of joint 6",
       without_effect_of_joint_6,
       Termination::rank_deficient,
       {"not_determined"},
       {"the measurements do not depend on dq6", "fixed by gauge: dq6" + gauge}},
      {"priors as large as the errors", [] { return with_priors(0.001); }, Termination::converged, {}, {}},
      {"priors a tenth of the errors",
       [] { return with_priors(0.0001); },
       Termination::converged,
       {},
       {"the estimated errors are [0-9.]+ times as large as the priors expect, so the priors hold them too close to "
        "nominal; state larger priors, or none"}},
      {"nine residual degrees of freedom",
       [] { return with_few_rows(12); },
       Termination::converged,
       {},
       {"few data: all uncertainties rest on 9 degrees of freedom; measure more configurations or state the noise"}},
      {"twelve residual degrees of freedom", [] { return with_few_rows(13); }, Termination::converged, {}, {}},
      {"outside the limits",
       outside_the_limits,
       Termination::converged,
       {},
       {"3 of 25 configurations have joint values outside the limits of the URDF"}},
      {"misfit",
       with_misfit,
       Termination::converged,
       {},
       {"lack of fit: the residuals are larger than the scatter of the repeats explains"}},
      {"another robot",
       of_another_robot,
       Termination::converged,
       {"worse_than_nominal", "nominal_kept", "large_misfit"},
       {}},
      {"nothing to calibrate", without_errors, Termination::converged, {"worse_than_nominal", "nominal_kept"}, {}},
  };
}

std::vector<std::string> causes_of(const CalibrationResult& found) {
  std::vector<std::string> causes;
  for (const Doubt& doubt : found.diagnosis.doubts) {
    causes.push_back(to_string(doubt.cause));
  }
  return causes;
}

TEST(WarningsOfCalibrations, AreExactlyThoseOfTheCause) {
  for (const Scenario& scenario : scenarios()) {
    const CalibrationResult found = scenario.calibrated();
    std::vector<::testing::Matcher<std::string>> expected;
    for (const std::string& pattern : scenario.warnings) {
      expected.push_back(MatchesRegex(pattern));
    }
    EXPECT_THAT(found.diagnosis.warnings, ElementsAreArray(expected)) << scenario.name;
    EXPECT_THAT(causes_of(found), ElementsAreArray(scenario.causes)) << scenario.name;
    EXPECT_EQ(found.fit.identification.termination, scenario.termination) << scenario.name;
    EXPECT_EQ(found.trusted(), scenario.causes.empty()) << scenario.name;
    EXPECT_EQ(found.diagnosis.reservation.has_value(),
              found.trusted() && scenario.termination == Termination::rank_deficient)
        << scenario.name;
  }
}

TEST(WarningsOfCalibrations, OfTheRegistrationAreHandedOn) {
  for (const double noise : {0.0, kNoise}) {
    EXPECT_THAT(with_one_moving_joint(noise).diagnosis.warnings,
                Contains("registration: the configurations leave a rotation of the base undetermined"))
        << noise;
  }
  EXPECT_THAT(clean().diagnosis.warnings, Not(Contains(HasSubstr("registration"))));
}

// ---- doubts --------------------------------------------------------------------------------------------------------

std::vector<Doubt> doubts_of(const CalibrationResult& found) {
  return doubts(found, found.diagnosis, clean_series().measured, ModelChoice::irreducible);
}

/// The only doubt that `spoil` raises in a calibration that had none.
Doubt doubt_of(const std::function<void(CalibrationResult&)>& spoil) {
  CalibrationResult found = clean();
  EXPECT_THAT(doubts_of(found), IsEmpty());
  spoil(found);
  const std::vector<Doubt> raised = doubts_of(found);
  EXPECT_EQ(raised.size(), 1U);
  return raised.empty() ? Doubt{} : raised.front();
}

// 0.312 m, 1.075 m, 0.225 m and 1.28 m, 0.215 m: from joint 1 to the flange.
TEST(DoubtsOfCalibrations, AMisfitIsLargeAboveFiveMillimetres) {
  const double length = 0.312 + 1.075 + std::hypot(0.225, 1.28) + 0.215;
  EXPECT_NEAR(reach(clean_series().model), length, 1e-12);
  const auto with_rms = [](double rms) {
    return [rms](CalibrationResult& found) { found.accuracy.train.after.rms = rms; };
  };
  const Doubt doubt = doubt_of(with_rms(0.005001));
  EXPECT_EQ(doubt.cause, Cause::large_misfit);
  EXPECT_THAT(doubt.message, HasSubstr("a misfit of 5.001 mm is left, and an arm with a reach of 2.902 m"));
  CalibrationResult below = clean();
  with_rms(0.004999)(below);
  EXPECT_THAT(doubts_of(below), IsEmpty());
}

TEST(DoubtsOfCalibrations, NameAnErrorThatNoBuilderLeaves) {
  const auto with_error = [](ParameterKind kind, double error, double std) {
    return [=](CalibrationResult& found) {
      const auto parameter =
          std::find_if(found.uncertainty.parameters.begin(), found.uncertainty.parameters.end(),
                       [&](const auto& p) { return p.kind == kind && !p.joint.empty() && !p.gauge; });
      ASSERT_NE(parameter, found.uncertainty.parameters.end());
      parameter->error = error;
      parameter->std = std;
    };
  };
  const double most = 0.02 * reach(clean_series().model);
  const Doubt length = doubt_of(with_error(ParameterKind::translation, -1.01 * most, 1e-5));
  EXPECT_EQ(length.cause, Cause::large_error);
  EXPECT_THAT(length.message, HasSubstr("check the URDF"));
  const Doubt offset = doubt_of(with_error(ParameterKind::joint_offset, 20.1 * testing::kDegree, 1e-5));
  EXPECT_EQ(offset.cause, Cause::large_error);
  EXPECT_THAT(offset.message, HasSubstr("check the mastering"));
  for (const auto& change : {with_error(ParameterKind::translation, 0.99 * most, 1e-5),
                             with_error(ParameterKind::translation, 1.1 * most, 0.05 * most),
                             with_error(ParameterKind::rotation, 19.9 * testing::kDegree, 1e-5)}) {
    CalibrationResult found = clean();
    change(found);
    EXPECT_THAT(doubts_of(found), IsEmpty());
  }
}

TEST(DoubtsOfCalibrations, CompareTestRowsWithWhatWasHeldOut) {
  const auto with_test = [](double before, double after) {
    return [=](CalibrationResult& found) {
      found.accuracy.leave_one_out = BeforeAfter{};
      found.accuracy.leave_one_out->before = {.count = 30, .rms = 0.001};
      found.accuracy.leave_one_out->after = {.count = 30, .rms = 0.0001};
      found.accuracy.test = BeforeAfter{};
      found.accuracy.test->before = {.count = 30, .rms = before};
      found.accuracy.test->after = {.count = 30, .rms = after};
    };
  };
  EXPECT_EQ(doubt_of(with_test(2.000079, 2.000044)).cause, Cause::test_rows_differ);
  for (const auto& change : {with_test(0.001, 0.0004), with_test(0.0011, 0.0001), with_test(0.0005, 0.00045)}) {
    CalibrationResult found = clean();
    change(found);
    EXPECT_THAT(doubts_of(found), IsEmpty());
  }
}

TEST(DoubtsOfCalibrations, AreRaisedByTestRowsOfAnotherRobot) {
  EXPECT_THAT(causes_of(with_test_rows_of_another_robot()), ElementsAreArray({"worse_than_nominal"}));
}

TEST(DoubtsOfCalibrations, AreNotRaisedByTheCompleteModelOfGoodData) {
  const CalibrationResult found = Series().calibrated({.parameters = {.model = ModelChoice::complete}});
  EXPECT_THAT(causes_of(found), IsEmpty());
  EXPECT_EQ(found.fit.identification.termination, Termination::converged);
  EXPECT_THAT(found.uncertainty.fixed_by_gauge, Not(IsEmpty()));
}

TEST(DoubtsOfCalibrations, WhereNothingIsGainedTheUrdfIsTheOneThatWasRead) {
  const Robot robot = fanuc();
  const CalibrationResult& found = without_errors();
  EXPECT_TRUE(found.exported.nominal_kept);
  EXPECT_TRUE(calibrated_urdf(robot, found) == robot.urdf);
  EXPECT_EQ(found.exported.train.rms, found.accuracy.train.before.rms);
  EXPECT_EQ(found.exported.held_out->rms, found.accuracy.leave_one_out->before.rms);
  EXPECT_EQ(found.accuracy.held_out()->rigid->rms, found.accuracy.leave_one_out->before.rms);
  EXPECT_TRUE(found.exported.estimate.errors.isZero(0.0));
  const CalibrationResult& gained = clean();
  EXPECT_FALSE(gained.exported.nominal_kept);
  EXPECT_TRUE(calibrated_urdf(robot, gained) ==
              calibrated_urdf(robot, gained.model, gained.fit.identification.estimate.errors));
  EXPECT_EQ(gained.exported.train.rms, gained.accuracy.train.after.rms);
}

// Only the effects help: a URDF cannot hold them.
TEST(DoubtsOfCalibrations, WhereOnlyTheEffectsHelpTheUrdfIsTheOneThatWasRead) {
  Series series;
  series.robot.truth.errors.setZero();
  series.measured = with_ripple(series, 1e-3, {.sigma = kNoise});
  const CalibrationResult found = series.calibrated({.selection = {.effects = {.groups = {EffectGroup::harmonics}}}});
  EXPECT_TRUE(found.trusted());
  EXPECT_TRUE(found.exported.nominal_kept);
  EXPECT_THAT(found.diagnosis.warnings, Contains(HasSubstr("the geometry is no better than the nominal robot")));
}

// ---- findings ------------------------------------------------------------------------------------------------------

struct Defect {
  QualityKind kind;
  std::function<void(Series&)> put_into;
  const char* message;  // regular expression
};

std::vector<Defect> defects() {
  return {{QualityKind::slipped_target,
           [](Series& s) {
             const auto poses = flange_poses(s.model, s.robot.truth, s.measured.joint_values);
             for (int c = 13; c <= 25; ++c) {
               s.row(c, 2).position += s.robot.truth.X_WB.linear() * poses[static_cast<std::size_t>(c - 1)].linear() *
                                       Eigen::Vector3d(0.0, 0.002, 0.0);
             }
           },
           "target C slipped by about 2.0 mm after configuration 12"},
          {QualityKind::swapped_targets, [](Series& s) { std::swap(s.row(7, 0).position, s.row(7, 1).position); },
           "targets A and B are swapped in configuration 7"},
          {QualityKind::mistaken_target, [](Series& s) { s.row(5, 1).position = s.row(5, 2).position; },
           "target B in configuration 5 lies where target C is"},
          {QualityKind::mistyped_coordinate, [](Series& s) { s.row(9, 2).position.z() -= 0.01; },
           "target C in configuration 9, repeat 1: z is off by about -10.0 mm"},
          {QualityKind::displaced_point, [](Series& s) { s.row(9, 2).position += Eigen::Vector3d(0.003, 0.0, -0.004); },
           "target C in configuration 9, repeat 1 is off by about 5.0 mm"},
          {QualityKind::displaced_configuration, [](Series& s) { s.measured.joint_values(1, 7) += 2.0 * kDegree; },
           "targets A, B and C in configuration 8 are off by up to [0-9.]+ mm; are its joint values right\\?"}};
}

TEST(WarningsOfCalibrations, NameEachKindOfDefectOfTheMeasurements) {
  EXPECT_THAT(clean().diagnosis.findings, IsEmpty());
  for (const Defect& defect : defects()) {
    Series s;
    defect.put_into(s);
    const CalibrationResult found =
        s.calibrated({.estimator = {.loss = Loss::tukey}, .validation = {.held_out = false}});
    std::vector<::testing::Matcher<std::string>> expected = {
        MatchesRegex(std::string("measurements: ") + defect.message)};
    EXPECT_THAT(found.diagnosis.warnings, ElementsAreArray(expected)) << to_string(defect.kind);
    ASSERT_EQ(found.diagnosis.findings.size(), 1U) << to_string(defect.kind);
    EXPECT_EQ(found.diagnosis.findings[0].kind, defect.kind) << to_string(defect.kind);
    EXPECT_THAT(found.diagnosis.findings[0].message, MatchesRegex(defect.message));
    // A loss keeps the row from the fit, and what it leaves of the row is no misfit of the arm.
    EXPECT_THAT(causes_of(found), IsEmpty()) << to_string(defect.kind);
  }
}

TEST(WarningsOfCalibrations, OfMoreThanTwentyThousandRowsComeFromDistancesAlone) {
  Series s(4, {.sigma = kNoise}, published_targets(4));
  s.measure_at(s.measured.joint_values, {.sigma = kNoise, .repeats = 200});
  ASSERT_EQ(s.measured.observations.size(), 20000U);
  s.measured.observations[401].position.x() += 0.03;
  for (const bool many : {false, true}) {
    if (many) {
      Observation more = s.measured.observations.back();
      more.repeat = 201;
      s.measured.observations.push_back(more);
    }
    const CalibrationResult found =
        s.calibrated({.validation = {.held_out = false}, .diagnosis = {.try_readings = false}});
    ASSERT_EQ(found.diagnosis.findings.size(), 1U);
    EXPECT_EQ(found.diagnosis.findings[0].kind, many ? QualityKind::displaced_point : QualityKind::mistyped_coordinate);
  }
}

}  // namespace
}  // namespace kdl_calibration::doubts_test

// What a calibration says of data that read well and are wrong, and of data that are right.
namespace kdl_calibration::testing::doubts_test {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

/// One line for each doubt and each finding about the data themselves.
std::string said(const CalibrationResult& found) {
  std::string text;
  for (const Doubt& doubt : found.diagnosis.doubts) {
    text += std::string(to_string(doubt.cause)) + ": " + doubt.message + "\n";
  }
  for (const QualityFinding& finding : found.diagnosis.findings) {
    text += "finding: " + finding.message + "\n";
  }
  return text;
}

bool doubts_for(const CalibrationResult& found, const std::string& cause, const std::string& words) {
  return std::any_of(found.diagnosis.doubts.begin(), found.diagnosis.doubts.end(), [&](const Doubt& doubt) {
    return to_string(doubt.cause) == cause && doubt.message.find(words) != std::string::npos;
  });
}

const CalibrationSettings kNothingHeldOut{
    .validation = {.held_out = false}};  // which says nothing of the readings of the data

// No more than one explanation of the data, the right one.
void expect_named(const Mistake& mistake, const ErrorModel& model, std::uint64_t seed,
                  const CalibrationSettings& options = kNothingHeldOut) {
  Measured m = measured(model, seed, mistake.draw);
  mistake.make(m);
  const CalibrationResult found = calibrate(model, m.data, options);
  const std::string where = mistake.name + ", " + model.joints.front().name + ", seed " + std::to_string(seed);
  EXPECT_FALSE(found.trusted()) << where;
  EXPECT_TRUE(doubts_for(found, mistake.cause, mistake.words)) << where << "\n" << said(found);
  EXPECT_EQ(std::count_if(found.diagnosis.alternative_readings.begin(), found.diagnosis.alternative_readings.end(),
                          [](const auto& s) { return s.doubt; }),
            1)
      << where << "\n"
      << said(found);
}

std::vector<Mistake> table() {
  std::vector<Mistake> all = joint_mistakes();
  for (const std::vector<Mistake>& more : {point_mistakes(), order_mistakes()}) {
    all.insert(all.end(), more.begin(), more.end());
  }
  return all;
}

/// Every so many-th mistake of the table, from the first one given.
void expect_cross_section_named(std::size_t first, std::size_t step,
                                const CalibrationSettings& options = kNothingHeldOut) {
  const std::vector<Mistake> all = table();
  for (std::size_t i = first; i < all.size(); i += step) {
    expect_named(all[i], i % 2 == 0 ? large_arm() : light_arm(), 4, options);
  }
}

const CalibrationSettings kAutomatic{
    .selection = {.automatic_priors = true, .effects = {.groups = {}, .automatic = true}},
    .validation = {.held_out = false}};

TEST(Mistakes, ACrossSectionOfTheTableIsDoubted) { expect_cross_section_named(0, 15); }
TEST(MistakesLongRun, ACrossSectionOfTheTableIsDoubted) { expect_cross_section_named(0, 5); }

// Neither effects nor priors explain a mistake away.
TEST(Mistakes, AreDoubtedBesideAutomaticChoices) { expect_cross_section_named(2, 25, kAutomatic); }
TEST(MistakesLongRun, AreDoubtedBesideAutomaticChoices) { expect_cross_section_named(2, 5, kAutomatic); }

TEST(MistakesCampaign, TheWholeTableIsDoubtedOnTwoRobotsWithThreeSeeds) {
  const std::vector<Mistake> all = table();
  EXPECT_GE(all.size(), 40U);
  for (const Mistake& mistake : all) {
    for (const ErrorModel* model : {&large_arm(), &light_arm()}) {
      for (std::uint64_t seed = 1; seed <= 3; ++seed) {
        expect_named(mistake, *model, seed);
      }
    }
  }
}

// ---- correct data --------------------------------------------------------------------------------------------------

int false_alarms(std::uint64_t first, std::uint64_t last) {
  const std::set<std::string> never = {"joint_unit",       "joint_sign", "joint_columns",
                                       "joint_convention", "joint_gain", "length_unit",
                                       "mirrored",         "tool_frame", "scale"};
  int alarms = 0;
  for (std::uint64_t seed = first; seed <= last; ++seed) {
    const Measured m = correct_data(seed);
    const CalibrationResult found = calibrate(m.model, m.data, kNothingHeldOut);
    for (const AlternativeReading& reading : found.diagnosis.alternative_readings) {
      EXPECT_EQ(never.count(to_string(reading.cause)), 0U) << seed << ": " << reading.message;
    }
    const bool doubted =
        std::any_of(found.diagnosis.alternative_readings.begin(), found.diagnosis.alternative_readings.end(),
                    [](const AlternativeReading& reading) { return reading.doubt; });
    alarms += doubted || !found.diagnosis.findings.empty() ? 1 : 0;
    EXPECT_LE(alarms, 1) << seed << "\n" << said(found);
  }
  return alarms;
}

TEST(Mistakes, CorrectDataOfRandomArmsAreLeftAlone) { EXPECT_LE(false_alarms(1, 4), 1); }
TEST(MistakesLongRun, CorrectDataOfRandomArmsAreLeftAlone) { EXPECT_LE(false_alarms(1, 15), 1); }

TEST(MistakesCampaign, CorrectDataOfThreeHundredRandomArmsAreLeftAlone) { EXPECT_LE(false_alarms(1, 300), 1); }

// ---- how often what was changed is found ---------------------------------------------------------------------------

constexpr double kSigma = 0.00003;  // [m], of Draw

/// 10 sigma, in a direction of its own.
Vector3d ten_sigma(std::uint64_t seed) {
  Random random(seed, 3);
  return 10.0 * kSigma * Vector3d{random.normal(), random.normal(), random.normal()}.normalized();
}

int place(std::uint64_t seed) { return 5 + static_cast<int>(seed % 21); }

// About an axis through the base, so that a point as far from it as those measured moves by 10 sigma.
Mistake turned_by_ten_sigma(const Measured& m, std::uint64_t seed) {
  double squares = 0.0;
  for (const Observation& observation : m.data.observations) {
    squares += (observation.position - m.truth.X_WB.translation()).squaredNorm();
  }
  const double lever = std::sqrt(squares / static_cast<double>(m.data.observations.size()));
  const Vector3d angles = ten_sigma(seed) / lever;
  const Eigen::Isometry3d X_WB = m.truth.X_WB;
  const int from = place(seed);
  return {"turn",
          [=](Measured& changed) {
            for_rows(changed, [&](Observation& o) {
              if (o.configuration >= from) {
                o.position = X_WB.translation() + rotation_exp(angles) * (o.position - X_WB.translation());
              }
            });
          },
          "moved_base", "after configuration " + std::to_string(from)};
}

Mistake drifted_by_ten_sigma(std::uint64_t seed) {
  const Vector3d whole = ten_sigma(seed);
  return {"drift",
          [=](Measured& m) { for_rows(m, [&](Observation& o) { o.position += o.configuration / 29.0 * whole; }); },
          "drift", "drifts"};
}

std::uint64_t found_of(std::uint64_t seeds, const std::function<Mistake(const Measured&, std::uint64_t)>& mistake) {
  std::uint64_t named = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    Measured m = measured(seed % 2 == 0 ? large_arm() : light_arm(), 1000 + seed);
    const Mistake made = mistake(m, seed);
    made.make(m);
    const CalibrationResult found = calibrate(m.model, m.data, kNothingHeldOut);
    const bool right = doubts_for(found, made.cause, "");
    named += right ? 1U : 0U;
    if (!right) {
      std::printf("%s, seed %d: %s\n", made.name.c_str(), static_cast<int>(seed), said(found).c_str());
    }
  }
  std::printf("%d of %d\n", static_cast<int>(named), static_cast<int>(seeds));
  return named;
}

Mistake stepped(const Measured& /*m*/, std::uint64_t seed) { return moved_from(place(seed), ten_sigma(seed)); }
Mistake drifted(const Measured& /*m*/, std::uint64_t seed) { return drifted_by_ten_sigma(seed); }

TEST(Mistakes, AMovedTrackerIsDoubted) {
  EXPECT_GE(found_of(2, stepped), 2U);
  EXPECT_GE(found_of(1, turned_by_ten_sigma), 1U);
  EXPECT_GE(found_of(1, drifted), 1U);
}

// What 98 % give at least in 200 draws, two standard deviations of the count below their mean.
constexpr std::uint64_t kOfTwoHundred = 192;

TEST(MistakesLongRun, AStepOfTenSigmaIsDoubtedInNinetyEightPercent) {
  EXPECT_GE(found_of(200, stepped), kOfTwoHundred);
}
TEST(MistakesLongRun, ATurnOfTenSigmaIsDoubtedInNinetyEightPercent) {
  EXPECT_GE(found_of(200, turned_by_ten_sigma), kOfTwoHundred);
}
TEST(MistakesLongRun, ADriftOfTenSigmaIsDoubtedInNinetyEightPercent) {
  EXPECT_GE(found_of(200, drifted), kOfTwoHundred);
}

// Slips and typing errors are findings, and nothing else is made of them.
std::uint64_t findings_of(std::uint64_t seeds, QualityKind kind,
                          const std::function<void(Measured&, std::uint64_t)>& spoil) {
  std::uint64_t named = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    Measured m = measured(seed % 2 == 0 ? large_arm() : light_arm(), 2000 + seed);
    spoil(m, seed);
    const CalibrationResult found = calibrate(m.model, m.data, kNothingHeldOut);
    const bool right = found.diagnosis.findings.size() == 1 && found.diagnosis.findings.front().kind == kind;
    named += right ? 1U : 0U;
    if (!right) {
      std::printf("seed %d: %s\n", static_cast<int>(seed), said(found).c_str());
    }
  }
  std::printf("%d of %d\n", static_cast<int>(named), static_cast<int>(seeds));
  return named;
}

// 1 mm along the flange's x, which only one of three targets does.
void slip(Measured& m, std::uint64_t seed) {
  const int target = static_cast<int>(seed % 3);
  for_rows(m, [&](Observation& o) {
    if (o.configuration >= place(seed) && o.target == target) {
      o.position += true_flange(m, o.configuration).linear() * Vector3d(0.001, 0.0, 0.0);
    }
  });
}

void mistype(Measured& m, std::uint64_t seed) {
  Observation& row = m.data.observations[seed * 7 % m.data.observations.size()];
  row.position[static_cast<Eigen::Index>(seed % 3)] += 0.0005;
}

TEST(Mistakes, SlipsAndTypingErrorsAreFindings) {
  EXPECT_GE(findings_of(2, QualityKind::slipped_target, slip), 2U);
  EXPECT_GE(findings_of(2, QualityKind::mistyped_coordinate, mistype), 2U);
}

TEST(MistakesLongRun, SlipsOfAMillimetreAreFoundInNinetyEightPercent) {
  EXPECT_GE(findings_of(200, QualityKind::slipped_target, slip), kOfTwoHundred);
}
TEST(MistakesLongRun, TypingErrorsOfHalfAMillimetreAreFoundInNinetyEightPercent) {
  EXPECT_GE(findings_of(200, QualityKind::mistyped_coordinate, mistype), kOfTwoHundred);
}

// ---- real arms -----------------------------------------------------------------------------------------------------

struct RealSet {
  ErrorModel model;
  Measurements data;
  CalibrationSettings options;
};

RealSet fanuc_series() {
  const Robot robot = fanuc();
  RealSet set{.model = complete_model(robot), .data = {}, .options = kNothingHeldOut};
  set.options.diagnosis.convention = read_joint_convention(std::string(URDF_DIR) + "/fanuc_r2000ic_165f_serial.json");
  set.data = read_measurements(robot, std::string(SHARED_DATA_DIR) + "/r2000ic_165f_tracker/measurements.csv",
                               &*set.options.diagnosis.convention);
  return set;
}

RealSet ur10_poses() {
  const std::string folder = std::string(SHARED_DATA_DIR) + "/ur10_tracker_poses";
  const Robot robot = load_robot(folder + "/ur10.urdf", {.base = "base_link", .tip = "tool0"});
  return {.model = complete_model(robot),
          .data = read_measurements(robot, folder + "/measurements.csv"),
          .options = kNothingHeldOut};
}

std::vector<std::string> causes_of(const RealSet& set) {
  std::vector<std::string> causes;
  const CalibrationResult found = calibrate(set.model, set.data, set.options);
  for (const AlternativeReading& reading : found.diagnosis.alternative_readings) {
    causes.push_back(std::string(to_string(reading.cause)) + ": " + reading.message);
  }
  for (const QualityFinding& finding : found.diagnosis.findings) {
    causes.push_back("finding: " + finding.message);
  }
  return causes;
}

TEST(MistakesOnRealData, NothingIsSaidOfWhatIsRight) {
  for (const RealSet& set : {fanuc_series(), ur10_poses()}) {
    EXPECT_THAT(causes_of(set), ::testing::IsEmpty());
  }
}

TEST(MistakesOnRealDataLongRun, NothingIsSaidOfWhatIsRightBesideAutomaticChoices) {
  for (RealSet set : {fanuc_series(), ur10_poses()}) {
    set.options.selection.effects.automatic = true;
    set.options.selection.automatic_priors = true;
    EXPECT_THAT(causes_of(set), ::testing::IsEmpty());
  }
}

// Of a controller whose joints a convention makes others of, the controller's columns are what is exchanged.
TEST(MistakesOnRealData, ColumnsOfTheControllerThatWereExchangedAreNamed) {
  RealSet set = fanuc_series();
  const Eigen::MatrixXd matrix = set.options.diagnosis.convention->matrix;
  Eigen::MatrixXd controller = matrix.inverse() * set.data.joint_values;
  controller.row(0).swap(controller.row(1));
  set.data.joint_values = matrix * controller;
  EXPECT_THAT(causes_of(set), ::testing::ElementsAre(HasSubstr("the controller's J1 and J2 exchanged")));
}

// The measured frame stands on the axis of the last joint: its orientation alone shows how that turns.
TEST(MistakesOnRealData, OrientationsShowWhatPointsDoNot) {
  RealSet wrong_sign = ur10_poses();
  wrong_sign.data.joint_values.row(5) *= -1.0;
  EXPECT_THAT(causes_of(wrong_sign), ::testing::ElementsAre(::testing::AllOf(
                                         HasSubstr("joint_sign"), HasSubstr("(orientations as points 100 mm away)"),
                                         HasSubstr("wrist_3_joint with the opposite sign"))));
}

TEST(MistakesOnRealDataLongRun, OrientationsShowDegreesWherePointsDoNot) {
  RealSet degrees = ur10_poses();
  degrees.data.joint_values.row(5) /= kDegree;
  EXPECT_THAT(causes_of(degrees), ::testing::ElementsAre(HasSubstr("wrist_3_joint in degrees, read as radians")));
}

}  // namespace
}  // namespace kdl_calibration::testing::doubts_test
