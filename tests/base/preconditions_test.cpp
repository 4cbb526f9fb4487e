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
#include "model/error_chains.hpp"
#include "refusal.hpp"
#include "robot/joint_ranges.hpp"
#include "two_step/matrix_derivatives.hpp"
#include "two_step/two_step.hpp"

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
  std::vector<std::size_t> beyond = {1000};

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
  const FoldedChain chain = folded(model, s.errors);
  const std::vector<ChainFactor> factors = chain_factors(model);
  const ChainFolder folder(model, {0, 1});
  FoldedChain shape = folder.shape();
  FoldedChain empty;
  std::vector<ParameterTwist> two(2);
  Matrix6Xd jacobian;
  VectorXd motion = s.few;
  const VectorXd none = VectorXd::Zero(static_cast<Index>(s.elastic.effects.size()));
  const VectorXd values = VectorXd::Ones(none.size());
  const MatrixXd q = MatrixXd::Zero(6, 4);
  EXPECT_CLOSED("3 errors", frame_correction(model, s.few, 1));
  EXPECT_CLOSED("the frame 8 is not there", frame_correction(model, s.errors, 8));
  EXPECT_CLOSED("3 errors", error_chain(model, s.few));
  EXPECT_CLOSED("3 errors", folded_chain(model, s.few));
  EXPECT_CLOSED("3 errors", folded(model, s.few));
  EXPECT_CLOSED("3 errors", parameter_twists(model, s.few, {0}));
  EXPECT_CLOSED("parameter 1000 is not there", parameter_twists(model, s.errors, s.beyond));
  EXPECT_CLOSED("parameter 1000 is not there", ChainFolder(model, s.beyond));
  EXPECT_CLOSED("is not there, expected an index below 3", folder.fold(s.few, shape, two, 0));
  EXPECT_CLOSED("the twist 2 is not there", folder.fold(s.errors, shape, two, 1));
  EXPECT_CLOSED("0 links of a chain", folder.fold(s.errors, empty, two, 0));
  EXPECT_CLOSED("3 joint values", flange_pose(chain, s.few));
  EXPECT_CLOSED("3 joint values", flange_poses(chain, s.few_rows));
  EXPECT_CLOSED("3 joint values", flange_jacobian(chain, {}, s.few, jacobian));
  EXPECT_CLOSED("0 twists in frames of the chain, expected 1", flange_jacobian(chain, {{.frame = 9}}, s.q, jacobian));
  EXPECT_CLOSED("3 joint values, expected 6", matrix_product(factors, s.errors, s.few));
  EXPECT_CLOSED("3 errors", matrix_product(factors, s.few, s.q));
  EXPECT_CLOSED("parameter 1000 is not there",
                point_columns(factors, matrix_product(factors, s.errors, s.q), s.beyond, {}));
  EXPECT_CLOSED("0 derivatives", point_columns(factors, {}, {0}, {}));
  EXPECT_CLOSED("3 joint values", manipulator_jacobians(model, s.errors, s.few));
  EXPECT_CLOSED("3 errors", manipulator_jacobians(model, s.few, s.q));
  EXPECT_CLOSED("3 errors", ArmKinematics(model, s.few, {}));
  EXPECT_CLOSED("3 values of effects, expected 0", ArmKinematics(model, s.errors, s.few));
  EXPECT_CLOSED("3 joint values", effect_terms(model, EffectGroup::gain, s.few_rows));
  EXPECT_CLOSED("3 joint values", table_terms(model, s.few_rows, 0.5));
  EXPECT_CLOSED("the length of a table", table_terms(model, q, kNaN));
  EXPECT_CLOSED("3 joint values", effect_basis(s.elastic, s.few_rows));
  EXPECT_CLOSED("3 motions of joints", effect_motion(s.elastic, none, s.q, motion));
  EXPECT_CLOSED("1 values of effects", effective_joint_values(s.elastic, VectorXd::Ones(1), q));
  EXPECT_CLOSED("rows of a basis", effective_joint_values(s.elastic, values, q, MatrixXd::Zero(1, 4)));
  EXPECT_CLOSED("0 configurations", reduced_model(model, {}, {.configurations = 0}));
  EXPECT_CLOSED("no parameter is named 'base.Tq'", reduced_model(model, {}, {.fixed = {"base.Tq"}}));
  EXPECT_CLOSED("3 errors of a reduction", reduced_model(model, {}, {.errors = s.few}));
  EXPECT_CLOSED("the noise of a reduction", reduced_model(model, {}, {.noise = kNaN}));
  EXPECT_CLOSED("1 marks of candidates, expected 4", independent_columns(s.few_rows, {true}));
}

TEST(Doors, OfTheEstimationRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  const ErrorModel& model = s.model;
  const Measured& m = s.measured;
  Estimate short_one = s.estimate;
  short_one.errors = s.few;
  Estimate alone = s.estimate;
  alone.frames.targets.resize(1);
  const LeastSquaresProblem problem(model, s.data, m.free);
  const std::vector<Eigen::Isometry3d> X_BF(2, Eigen::Isometry3d::Identity());
  const PositionPredictor predictor(model, s.estimate, m.free);
  RowSummary summary(4);
  const auto same_data = [&](int) { return s.data; };
  EXPECT_CLOSED("Tq9", Unknowns(model, s.estimate.frames.targets, {"Tq9"}));
  EXPECT_CLOSED("the unknown 6 is not there", m.free.with(model, UnknownGroup::base, {6}));
  EXPECT_CLOSED("1 marks of unknowns", m.free.subset({true}));
  EXPECT_CLOSED("3 values of a step", m.free.moved(s.estimate, s.few));
  EXPECT_CLOSED("is not there", m.free.moved(short_one, VectorXd::Zero(m.free.size())));
  EXPECT_CLOSED("1 targets of an estimate", m.free.difference(s.estimate, alone));
  EXPECT_CLOSED("is not there", Unknowns::value(short_one, {.group = UnknownGroup::geometric, .index = 3}));
  EXPECT_CLOSED("the target 1", Unknowns::value(alone, {.group = UnknownGroup::targets, .index = 6}));
  EXPECT_CLOSED("3 errors of an estimate", problem.linearise(short_one));
  EXPECT_CLOSED("1 targets of an estimate", problem.cost(alone));
  EXPECT_CLOSED("1 targets of an estimate", problem.whitened(alone));
  EXPECT_CLOSED("1 targets of an estimate", problem.whitened_summary(alone));
  EXPECT_CLOSED("the target 1 is not there", descend(problem, alone, {}));
  EXPECT_CLOSED("the configuration 2", predicted_point(s.estimate, X_BF, {.configuration = 2}));
  EXPECT_CLOSED("the target 3", predicted_point(s.estimate, X_BF, {.configuration = 1, .target = 3}));
  EXPECT_CLOSED("3 joint values", predictor.jacobians(s.few));
  EXPECT_CLOSED("the tool 3", base_and_tool_rows(X_BF[0], 3, 3));
  EXPECT_CLOSED("3 errors", identification_jacobian(model, short_one, m.free, s.q));
  EXPECT_CLOSED("parameter 1000", identify_in_two_steps(model, same_data, s.estimate, s.beyond));
  EXPECT_CLOSED("2 poses of the flange", register_base_and_targets(X_BF, s.data));
  EXPECT_CLOSED("4 columns of an information matrix", well_conditioned_root(s.few_rows));
  EXPECT_CLOSED("6 residuals of a configuration", summary.add_configuration(s.few_rows, s.q));
  EXPECT_CLOSED("3 columns of rows", summary.add_priors(MatrixXd::Zero(1, 3)));
}

TEST(Doors, OfTheAssessmentRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  const ErrorModel& model = s.model;
  const Measured& m = s.measured;
  const FitProblem problem{.model = model, .measurements = s.data, .start = s.estimate, .free = m.free};
  const MatrixXd square = MatrixXd::Identity(3, 3);
  const std::vector<std::vector<Index>> folds = {{0}, {30}};
  const MatrixXd C = MatrixXd::Identity(m.free.size(), m.free.size());
  const std::string fold = "the configuration of a fold 30 is not there";
  const auto predict = [&](const MatrixXd& triangle, double noise, const std::vector<std::vector<Index>>& of) {
    predict_folds({.problem = problem, .sqrt_information = triangle, .noise = noise}, of);
  };
  EXPECT_CLOSED("the floor of the noise", check_distances(s.data, {.noise_floor = kNaN}));
  EXPECT_CLOSED("the smallest slip", check_residuals(model, s.data, s.estimate, {.smallest_slip = kNaN}));
  EXPECT_CLOSED("1 weights of rows", pseudo_values(model, s.data, s.estimate, Loss::huber, {1.0}));
  EXPECT_CLOSED(fold, predict(C, 1e-5, folds));
  EXPECT_CLOSED("0 configurations of a fold", predict(C, 1e-5, {{0}, {}}));
  EXPECT_CLOSED("3 columns of a triangle", predict(square, 1e-5, {{0}}));
  EXPECT_CLOSED("the noise", predict(C, kNaN, {{0}}));
  EXPECT_CLOSED(fold, cross_validate_by_sums(problem, folds, 1e-5));
  EXPECT_CLOSED(fold, cross_validate(problem, folds));
  EXPECT_CLOSED(fold, can_be_left_out(s.data, folds, 33));
  EXPECT_CLOSED("3 errors", registered(model, s.few, s.data));
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
  EXPECT_CLOSED("3 errors of an estimate", reported_robot(s.robot, s.model, short_one));
  EXPECT_CLOSED("3 errors", reported_measurements({.model = s.model, .estimate = short_one, .measurements = s.data}));
  EXPECT_CLOSED("3 errors", flange_poses(s.model, short_one, MatrixXd::Zero(6, 1)));
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
  const auto draw = [](Random&) -> MatrixXd { return MatrixXd::Zero(6, 2); };
  const MonteCarlo nowhere{
      .model = s.model, .with_errors = s.beyond, .targets = s.estimate.frames.targets, .train = draw, .test = draw};
  const MonteCarlo empty{.model = s.model, .targets = s.estimate.frames.targets, .train = draw};
  const MonteCarlo no_target{.model = s.model, .train = draw, .test = draw};
  EXPECT_CLOSED("parameter 1000", virtual_robot(s.model, s.beyond, {}, {}, random));
  EXPECT_CLOSED("the size of true errors", virtual_robot(s.model, {}, {}, {.angle = kNaN}, random));
  EXPECT_CLOSED("3 joint values", add_effects(robot, {EffectGroup::gain}, s.few_rows, 1e-4, random));
  EXPECT_CLOSED("the size of true effects", add_effects(robot, {}, q, -1.0, random));
  EXPECT_CLOSED("3 joint values", measure(robot, s.few_rows, {}, random));
  EXPECT_CLOSED("3 errors", measure(broken, q, {}, random));
  EXPECT_CLOSED("negative or not finite", measure(robot, q, {.sigma = kNaN}, random));
  EXPECT_CLOSED("parameter 1000", run_monte_carlo(nowhere));
  EXPECT_CLOSED("is empty, expected a function", run_monte_carlo(empty));
  EXPECT_CLOSED("0 targets", run_monte_carlo(no_target));
  EXPECT_CLOSED("is empty, expected a function", predicted_errors(empty));
  EXPECT_CLOSED("3 errors", as_one_model(s.model, broken.truth, robot));
  EXPECT_CLOSED("1 targets of the truth", distances_from_truth(s.model, s.estimate, alone, q));
  EXPECT_CLOSED("3 errors", compare_with_truth(s.model, s.estimate, broken.truth, q));
  EXPECT_CLOSED("is empty", run_two_step_trial({.robot = robot, .held_out = q}, random));
  EXPECT_CLOSED("3 joint values held out",
                run_two_step_trial({.robot = robot, .configurations = draw, .held_out = s.few_rows}, random));
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
  const MatrixXd square = MatrixXd::Identity(3, 3);
  const Capsule far{.frame = 99};
  const PlanRequest request{.robot = s.robot, .targets = targets, .candidates = 0};
  const std::string rows = "3 rows of the information, expected 33";
  EXPECT_CLOSED("3 joint values", travel_time(joints, s.q, s.few));
  EXPECT_CLOSED("3 joint values", way_time(joints, s.few, q));
  EXPECT_CLOSED("3 joint values of home", short_way(joints, s.few, q));
  EXPECT_CLOSED("1 labels of configurations", plan_csv({.configurations = {"1"}, .joint_values = q}, joints));
  EXPECT_CLOSED("the radius of the body", body_with_radius(s.robot, -1.0));
  EXPECT_CLOSED("the radius of the tool", tool_body(s.robot, targets, kNaN));
  EXPECT_CLOSED("3 joint values", link_frames(s.robot, s.few));
  EXPECT_CLOSED("the frame of a capsule 99", pairs_to_keep_apart(s.robot, {far}, 0.1));
  EXPECT_CLOSED("the clearance", pairs_to_keep_apart(s.robot, {}, kNaN));
  EXPECT_CLOSED("-1 candidates", candidates(s.robot, targets, {.ranges = limits_of(joints)}, {.count = -1}));
  EXPECT_CLOSED("3 joint values", violated(s.robot, targets, {.ranges = limits_of(joints)}, s.few));
  EXPECT_CLOSED("no parameter is named 'D.x'", nominal_experiment(s.model, targets, {}, {}, {"D.x"}));
  EXPECT_CLOSED("3 errors of an estimate", information(short_one, q));
  EXPECT_CLOSED("3 joint values", information(experiment, s.few_rows));
  EXPECT_CLOSED(rows, predicted(experiment, square, q));
  EXPECT_CLOSED("0 configurations", floor_of_worst_configuration(experiment, 0));
  EXPECT_CLOSED("3 joint values", observability_indices(experiment, s.few_rows));
  EXPECT_CLOSED(rows, select_configurations(experiment, {q, square}));
  EXPECT_CLOSED(rows, select_for_accuracy(experiment, {q, square, q}, 1e-3, Figure::mean, {}));
  EXPECT_CLOSED("40 candidates, expected at least 41",
                random_designs(experiment, {q, none}, {.count = 41, .draws = 2}));
  EXPECT_CLOSED(rows, d_efficiency(experiment, {q, none}, square, 30));
  EXPECT_CLOSED("0 candidates, expected at least 1", make_plan(request));
}

}  // namespace
}  // namespace kdl_calibration::preconditions_test
