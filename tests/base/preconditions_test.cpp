#include "base/preconditions.hpp"

#include <gmock/gmock.h>

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "calibration/calibration_settings.hpp"
#include "every_header.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "mistakes_support.hpp"
#include "refusal.hpp"
#include "robot/joint_ranges.hpp"
#include "two_step/matrix_derivatives.hpp"

namespace kdl_calibration::preconditions_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::Measured;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// That the message names the rule that an argument of the call broke.
#define EXPECT_CLOSED(words, ...) EXPECT_REFUSED_WITH(AllOf(HasSubstr(words), HasSubstr("expected")), __VA_ARGS__)

/// A sound robot with effects, what was measured of it, and arguments of a size that does not fit.
struct Sound {
  Robot robot = testing::fanuc();
  Measured measured = testing::measured(complete_model(robot), 1);
  ErrorModel& model = measured.model;
  Measurements& data = measured.data;
  ErrorModel elastic = with_effects(model);
  Estimate estimate = rigid(measured.truth);
  VectorXd errors = estimate.errors;
  VectorXd q = VectorXd::Zero(6);
  VectorXd few = VectorXd::Zero(3);
  MatrixXd few_rows = MatrixXd::Zero(3, 4);

  static ErrorModel with_effects(ErrorModel model) {
    model.effects = load_terms(model);
    return model;
  }
  static Estimate rigid(Estimate estimate) {
    estimate.effects.resize(0);
    return estimate;
  }
};

const Sound& sound() {
  static const Sound instance;
  return instance;
}

TEST(Preconditions, NameWhatWasGivenAndWhatWasExpected) {
  EXPECT_NO_THROW(require_count("joint values", 6, std::size_t{6}));
  EXPECT_NO_THROW(require_index("the target", 2, std::size_t{3}));
  EXPECT_NO_THROW(require_at_least("runs", 1, 1));
  EXPECT_NO_THROW(require_sigma("the noise", 0.0));
  EXPECT_NO_THROW(require_finite("an estimate", true));
  EXPECT_NO_THROW(require_function("what is called", std::function<void()>([] {})));
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_CLOSED("5 joint values, expected 6", require_count("joint values", Index{5}, std::size_t{6}));
  EXPECT_CLOSED("0 runs, expected at least 1", require_at_least("runs", 0, 1));
  EXPECT_CLOSED("the target -1 is not there", require_index("the target", -1, std::size_t{3}));
  EXPECT_CLOSED("the target 3 is not there, expected an index below 3", require_index("the target", 3, 3));
  EXPECT_CLOSED("parameter 9 is not there", require_indices("parameter", std::vector<Index>{0, 9}, 9));
  EXPECT_CLOSED("the noise is negative or not finite, expected 0 or more", require_sigma("the noise", -1.0));
  EXPECT_CLOSED("negative or not finite", require_sigma("the noise", kNaN));
  EXPECT_CLOSED("negative or not finite", require_sigma("the noise", infinity));
  EXPECT_NO_THROW(require_sigma("the noise", 1e12));
  EXPECT_CLOSED("the noise is out of range, expected at most 1e12", require_sigma("the noise", 1.1e12));
  EXPECT_CLOSED("an estimate has a value that is not finite", require_finite("an estimate", false));
  EXPECT_CLOSED("what is called is empty", require_function("what is called", std::function<void()>()));
}

TEST(Doors, OfTheRobotRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  const std::vector<MovingJoint>& joints = s.robot.joints;
  std::vector<MovingJoint> following = joints;
  following[3].mimic = Mimic{.leader = 17};
  Random random(1);
  MatrixXd q = MatrixXd::Zero(6, 2);
  MatrixXd few = s.few_rows;
  EXPECT_CLOSED("3 joint values, expected 6", follow(joints, few));
  EXPECT_CLOSED("the leader 17 is not there", follow(following, q));
  EXPECT_CLOSED("3 values of independent joints", all_joint_values(joints, few));
  EXPECT_CLOSED("3 joint values", independent_joint_values(joints, few));
  EXPECT_CLOSED("-1 configurations", random_configurations(limits_of(joints), -1, random));
  EXPECT_CLOSED("3 joint values", random_configurations(joints, JointRanges(3), 2, random));
}

TEST(Doors, OfMeasurementsRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  Measurements fewer = s.data;
  fewer.targets.emplace_back("another");
  JointConvention open{
      .name = "open", .controller_joints = {"J1"}, .urdf_joints = {"joint_1"}, .matrix = {}, .offset = {}};
  EXPECT_CLOSED("is empty, expected a function", subset(s.data, {}));
  EXPECT_CLOSED("other joints or targets, expected those of the first", joined(s.data, fewer));
  EXPECT_CLOSED("0 rows of a convention's matrix", matched_convention(open, {"joint_1"}));
}

TEST(Doors, OfTheModelRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  const ErrorModel& model = s.model;
  const std::vector<Eigen::Isometry3d> X_BF(2, Eigen::Isometry3d::Identity());
  EXPECT_CLOSED("3 errors", error_chain(model, s.few));
  EXPECT_CLOSED("3 errors", manipulator_jacobians(model, s.few, s.q));
  EXPECT_CLOSED("no parameter is named 'base.Tq'", reduced_model(model, {}, {.fixed = {"base.Tq"}}));
  EXPECT_CLOSED("Tq9", Unknowns(model, s.estimate.frames.targets, {"Tq9"}));
  EXPECT_CLOSED("2 poses of the flange", register_base_and_targets(X_BF, s.data));
  EXPECT_CLOSED("3 joint values", difference_to_kdl(model, s.errors, s.few_rows));
}

TEST(Doors, OfTheCalibrationRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  CalibrationSettings elsewhere;
  elsewhere.predict_at = {.names = {"a", "b", "c", "d"}, .joint_values = s.few_rows};
  CalibrationSettings unnamed;
  unnamed.predict_at = {.names = {"a"}, .joint_values = MatrixXd::Zero(6, 4)};
  Estimate short_one = s.estimate;
  short_one.errors = s.few;
  CalibrationResult calibration;
  calibration.model = s.model;
  calibration.fit.identification.estimate = short_one;
  EXPECT_CLOSED("3 joint values to predict at", calibrate(s.model, s.data, elsewhere));
  EXPECT_CLOSED("1 names of configurations to predict at", calibrate(s.model, s.data, unnamed));
  EXPECT_CLOSED("3 errors", calibrated_urdf(s.robot, s.model, s.few));
  EXPECT_CLOSED("3 errors of an estimate", result_json(s.robot, s.data, calibration));
  EXPECT_CLOSED("3 errors of an estimate", result_table(s.data, calibration));
  EXPECT_CLOSED("3 errors of an estimate", residuals_csv(s.data, calibration));
  EXPECT_CLOSED("1 coefficients of effects", effects_json(s.elastic, VectorXd::Zero(1)));
  EXPECT_CLOSED("3 errors", reported_measurements({.model = s.model, .estimate = short_one, .measurements = s.data}));
}

TEST(Doors, OfTheSimulationRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  Random random(1);
  VirtualRobot robot{.model = s.model, .truth = s.estimate};
  VirtualRobot broken = robot;
  broken.truth.errors = s.few;
  const MatrixXd q = MatrixXd::Zero(6, 2);
  Estimate alone = s.estimate;
  alone.frames.targets.resize(1);
  EXPECT_CLOSED("the size of true errors", virtual_robot(s.model, {}, {}, {.angle = kNaN}, random));
  EXPECT_CLOSED("the size of true effects", add_effects(robot, {}, {.joint_values = q}, -1.0, random));
  EXPECT_CLOSED("3 errors", measure(broken, q, {}, random));
  EXPECT_CLOSED("negative or not finite", measure(robot, q, {.sigma = kNaN}, random));
  EXPECT_CLOSED("1 targets of the truth", distances_from_truth(s.model, s.estimate, alone, q));
  EXPECT_CLOSED("3 errors", compare_with_truth(s.model, s.estimate, broken.truth, q));
}

TEST(Doors, OfThePlanningRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  const std::vector<MovingJoint>& joints = s.robot.joints;
  const std::vector<TargetFrame> targets = published_targets();
  const Experiment experiment = nominal_experiment(s.model, targets);
  Experiment short_one = experiment;
  short_one.errors = s.few;
  const MatrixXd q = MatrixXd::Zero(6, 40);
  const MatrixXd none = prior_information(experiment);
  const PlanRequest request{.robot = s.robot, .targets = targets, .candidates = 0};
  EXPECT_CLOSED("1 labels of configurations", plan_csv({.configurations = {"1"}, .joint_values = q}, joints));
  EXPECT_CLOSED("the radius of the body", body_with_radius(s.robot, -1.0));
  EXPECT_CLOSED("the radius of the tool", tool_body(s.robot, targets, kNaN));
  EXPECT_CLOSED("the clearance", pairs_to_keep_apart(s.robot, {}, kNaN));
  EXPECT_CLOSED("-1 candidates", candidates(s.robot, targets, {.ranges = limits_of(joints)}, {.count = -1}));
  EXPECT_CLOSED("3 errors of an estimate", information(short_one, q));
  EXPECT_CLOSED("40 candidates, expected at least 41",
                random_designs(experiment, {q, none}, {.count = 41, .draws = 2}));
  EXPECT_CLOSED("0 candidates, expected at least 1", make_plan(request));
}

}  // namespace
}  // namespace kdl_calibration::preconditions_test
