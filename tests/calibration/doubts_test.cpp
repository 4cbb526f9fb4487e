// What a finished calibration is doubted for and what is said beside that, word by word and on both sides of each
// threshold, of calibrations that are made up.

#include "calibration/doubts.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>

#include "support.hpp"

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
  Calibration calibration;
  Measurements measured;
  CalibrationOptions options;

  Found() {
    calibration.model = complete_model(testing::fanuc());
    calibration.identification.termination = Termination::converged;
    calibration.identification.estimate.errors =
        Eigen::VectorXd::Zero(static_cast<Eigen::Index>(calibration.model.parameters.size()));
    calibration.train = {.before = {.count = 9, .rms = 2e-3}, .after = {.count = 9, .rms = 1e-4}};
    calibration.predicted.measured.count = 3;
    calibration.noise.model = "parts";
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
    for (const Doubt& doubt : doubts(calibration, measured, options)) {
      result.push_back(doubt.cause + ": " + doubt.message);
    }
    return result;
  }
  std::vector<std::string> warned(const std::string& ambiguity = {}) const {
    return warnings(calibration, measured, ambiguity);
  }
};

TEST(DoubtsByHand, OfNothingThereAreNone) {
  const Found found;
  EXPECT_THAT(found.doubted(), IsEmpty());
  EXPECT_THAT(found.warned(), IsEmpty());
}

TEST(DoubtsByHand, AStalledFitStatesItsMisfit) {
  Found found;
  found.calibration.identification.termination = Termination::stalled;
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
    found.calibration.fixed_by_gauge = names;
    EXPECT_THAT(found.doubted(),
                ElementsAre("not_determined: the measurements do not determine " + list + kMeasureMore));
  }
}

TEST(DoubtsByHand, NothingThatIsPredictedOrARankThatIsLackingIsADoubtOfItsOwn) {
  const std::string message = "not_determined: the measurements do not determine all parameters" + kMeasureMore;
  Found unpredicted;
  unpredicted.calibration.predicted.measured.count = 0;
  EXPECT_THAT(unpredicted.doubted(), ElementsAre(message));
  Found open;
  open.calibration.identification.termination = Termination::rank_deficient;
  EXPECT_THAT(open.doubted(), ElementsAre(message));
}

TEST(DoubtsByHand, JointsStandStillBelowATenthOfAMilliradian) {
  const auto said = [](double range, int joints) {
    Found found;
    found.calibration.fixed_by_gauge = {"p"};
    for (int joint = 0; joint < joints; ++joint) {
      found.measured.joint_values.row(joint + 2) << 0.3, 0.3 + range, 0.3;
    }
    return found.doubted().at(0);
  };
  EXPECT_THAT(said(0.99e-4, 1), HasSubstr("(p): joint_3 never moves; predictions"));
  EXPECT_THAT(said(0.99e-4, 2), HasSubstr("(p): joint_3, joint_4 never move; predictions"));
  EXPECT_THAT(said(1.01e-4, 1), HasSubstr("(p); predictions"));
  Found tested;  // it moves in test rows alone
  tested.calibration.fixed_by_gauge = {"p"};
  tested.measured.joint_values.row(0) << 0.2, 0.2, 1.0;
  tested.measured.observations[2].split = Split::test;
  EXPECT_THAT(tested.doubted().at(0), HasSubstr("(p): joint_1 never moves; predictions"));
}

// Of the complete model's 38 geometric errors and frames much cannot be told apart by any measurement.
TEST(DoubtsByHand, OfTheCompleteModelOnlyWhatTheTargetsCouldShowCounts) {
  Found found;
  const ErrorModel& model = found.calibration.model;
  found.calibration.candidates = Unknowns(model, {}, {"dq2", "dq3", "Tx1", "Ty1"});
  found.calibration.reduction.kept = {"dq2", "dq3", "Tx1", "Rz3"};
  found.calibration.fixed_by_gauge = {"Ty1"};
  found.options.model = ModelChoice::complete;
  found.calibration.free = Unknowns(model, {}, {"dq2", "dq3", "Ty1"});
  EXPECT_THAT(found.doubted(), IsEmpty()) << "three of three";
  found.calibration.free = Unknowns(model, {}, {"dq2", "Ty1"});
  EXPECT_THAT(found.doubted(), SizeIs(1)) << "two of three";
  found.calibration.model.effects.resize(2);
  found.calibration.free = found.calibration.free.with_all(found.calibration.model, UnknownGroup::effects);
  EXPECT_THAT(found.doubted(), SizeIs(1)) << "effects are none of them";
  found.calibration.free = Unknowns(model, {}, {"dq2", "dq3", "Ty1"});
  found.options.model = ModelChoice::irreducible;
  EXPECT_THAT(found.doubted(), SizeIs(1));
}

TEST(DoubtsByHand, TestRowsMayBeAsGoodAsNominalAndHeldOutRowsMayNot) {
  const auto pair = [](double before, double after) {
    return BeforeAfter{.before = {.count = 5, .rms = before}, .after = {.count = 5, .rms = after}};
  };
  Found tested;
  tested.calibration.test = pair(1e-3, 1e-3);
  EXPECT_THAT(tested.doubted(), IsEmpty());
  tested.calibration.test = pair(1e-3, 1.001e-3);
  EXPECT_THAT(tested.doubted(),
              ElementsAre("worse_than_nominal: the calibrated robot is no better than the nominal one at the test "
                          "rows: 1.001 mm against 1 mm; were they measured under the same conditions, and near the "
                          "fitted ones?"));
  Found held_out;
  held_out.calibration.leave_one_out = pair(1.001e-3, 1e-3);
  EXPECT_FALSE(is_no_help(held_out.calibration));
  held_out.calibration.leave_one_out = pair(1e-3, 1e-3);
  EXPECT_TRUE(is_no_help(held_out.calibration));
  EXPECT_THAT(
      held_out.doubted(),
      ElementsAre("worse_than_nominal: the calibrated robot is no better than the nominal one at configurations that "
                  "were not fitted (leave-one-out): 1 mm against 1 mm; either there is nothing to correct that these "
                  "measurements could show, or they are too few, or some input is wrong: " +
                      kWrongInput,
                  "nominal_kept: the calibration does not help: the nominal robot is kept, and the URDF to write is "
                  "the one that was read"));
  held_out.calibration.leave_one_out->after.rms = kInfinity;
  EXPECT_TRUE(is_no_help(held_out.calibration));
  held_out.calibration.leave_one_out->after.count = 0;
  EXPECT_FALSE(is_no_help(held_out.calibration));
  EXPECT_FALSE(is_no_help(Found().calibration));
}

TEST(DoubtsByHand, ARobotWithoutAReachHasNoLargeMisfit) {
  Found found;
  found.calibration.train.after.rms = 10.0;
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
  found.calibration.parameters = {{.name = "Tz2", .kind = "translation", .std = 2.0},
                                  {.name = "Rz3", .kind = "rotation", .std = 0.6},
                                  {.name = "Ry2", .kind = "rotation", .std = 0.4},
                                  {.name = "Tx1", .kind = "translation", .std = kInfinity}};
  EXPECT_THAT(found.doubted(),
              ElementsAre("unknown_length: the uncertainty exceeds the link itself for Tz2, Rz3; measure more "
                          "configurations, or hold what is known"));
}

TEST(DoubtsByHand, SuspicionsAreDoubtsOrRemarks) {
  Found found;
  found.calibration.suspicions = {{.cause = "length_unit", .message = "they are feet", .doubt = true},
                                  {.cause = "copied_rows", .message = "they are copies", .doubt = false}};
  EXPECT_THAT(found.doubted(), ElementsAre("length_unit: they are feet"));
  EXPECT_THAT(found.warned(), ElementsAre("they are copies"));
}

// ---- warnings ------------------------------------------------------------------------------------------------------

TEST(WarningsByHand, WhatIsTiedIsNamedWhereNoPriorsToldItApart) {
  Found found;
  found.calibration.identifiability.tied = {{"dq2"}, {"Tx1", "Ry1"}};
  EXPECT_THAT(found.warned(), IsEmpty());
  const auto tied =
      ElementsAre("the measurements do not depend on dq2", "the measurements cannot tell apart: Tx1, Ry1");
  found.calibration.identification.termination = Termination::rank_deficient;
  EXPECT_THAT(found.warned(), tied);
  found.calibration.identification.termination = Termination::converged;
  found.calibration.fixed_by_gauge = {"Ry1", "dq2"};
  EXPECT_THAT(found.warned(), SizeIs(3));
  EXPECT_EQ(found.warned().at(2),
            "fixed by gauge: Ry1, dq2 (errors at zero, frames as registered); predictions hold where it was measured, "
            "single parameters do not");
  found.calibration.minimum_norm = true;
  EXPECT_THAT(found.warned(),
              ElementsAre("what the measurements cannot tell apart (Ry1, dq2) was shared out so that the errors are "
                          "smallest; predictions hold, single parameters do not"));
}

TEST(WarningsByHand, FindingsAndTheRegistrationAreHandedOn) {
  Found found;
  found.calibration.findings = {{.message = "A slipped"}};
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
  found.calibration.noise.model = "stated";
  EXPECT_THAT(found.warned(), IsEmpty());
}

TEST(WarningsByHand, LackOfFitIsBelowOneInAThousand) {
  Found found;
  found.calibration.lack_of_fit.emplace().p_value = 1e-3;
  EXPECT_THAT(found.warned(), IsEmpty());
  found.calibration.lack_of_fit->p_value = 0.99e-3;
  EXPECT_THAT(found.warned(),
              ElementsAre("lack of fit: the residuals are larger than the scatter of the repeats explains"));
}

TEST(WarningsByHand, ElsewhereAPointMayBeWorseThanNominal) {
  Found found;
  ErrorStatistics& workspace = found.calibration.predicted.workspace;
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
  found.calibration.doubts.push_back({.cause = "not_determined", .message = ""});
  EXPECT_FALSE(is_uncertain_elsewhere(found.calibration));
}

}  // namespace
}  // namespace kdl_calibration::doubts_test
