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

/// A call with one argument that does not fit the others, and the rule that the message names.
struct Refused {
  std::string name;
  std::function<void()> call;
  std::string words;
};

void expect_refused(const std::vector<Refused>& all) {
  for (const Refused& refused : all) {
    EXPECT_THAT(testing::refusal(refused.call), AllOf(HasSubstr(refused.words), HasSubstr("expected"))) << refused.name;
  }
}

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
  const std::vector<Index> zero_and_nine = {0, 9};
  expect_refused({
      {"count", [] { require_count("joint values", Index{5}, std::size_t{6}); }, "5 joint values, expected 6"},
      {"least", [] { require_at_least("runs", 0, 1); }, "0 runs, expected at least 1"},
      {"below", [] { require_index("the target", -1, std::size_t{3}); }, "the target -1 is not there"},
      {"above", [] { require_index("the target", 3, 3); }, "the target 3 is not there, expected an index below 3"},
      {"one of many", [&] { require_indices("parameter", zero_and_nine, 9); }, "parameter 9 is not there"},
      {"negative", [] { require_sigma("the noise", -1.0); }, "the noise is negative or not finite, expected 0 or more"},
      {"no number", [] { require_sigma("the noise", kNaN); }, "negative or not finite"},
      {"infinite", [=] { require_sigma("the noise", infinity); }, "negative or not finite"},
      {"not finite", [] { require_finite("an estimate", false); }, "an estimate has a value that is not finite"},
      {"empty", [] { require_function("what is called", std::function<void()>()); }, "what is called is empty"},
  });
}

TEST(Doors, OfTheRobotRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  const std::vector<MovingJoint>& joints = s.robot.joints;
  std::vector<MovingJoint> following = joints;
  following[3].mimic = Mimic{.leader = 17};
  Random random(1);
  MatrixXd q = MatrixXd::Zero(6, 2);
  MatrixXd few = s.few_rows;
  expect_refused({
      {"follow", [&] { follow(joints, few); }, "3 joint values, expected 6"},
      {"follow nobody", [&] { follow(following, q); }, "the leader 17 is not there"},
      {"all_joint_values", [&] { all_joint_values(joints, few); }, "3 values of independent joints"},
      {"independent_joint_values", [&] { independent_joint_values(joints, few); }, "3 joint values"},
      {"random_configurations", [&] { random_configurations(limits_of(joints), -1, random); }, "-1 configurations"},
      {"ranges of others", [&] { random_configurations(joints, JointRanges(3), 2, random); }, "3 joint values"},
  });
}

TEST(Doors, OfMeasurementsRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  Measurements fewer = s.data;
  fewer.targets.emplace_back("another");
  JointConvention open{
      .name = "open", .controller_joints = {"J1"}, .urdf_joints = {"joint_1"}, .matrix = {}, .offset = {}};
  expect_refused({
      {"subset", [&] { subset(s.data, {}); }, "is empty, expected a function"},
      {"joined", [&] { joined(s.data, fewer); }, "other joints or targets, expected those of the first"},
      {"matched_convention", [&] { matched_convention(open, {"joint_1"}); }, "0 rows of a convention's matrix"},
  });
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
  expect_refused({
      {"frame_correction", [&] { frame_correction(model, s.few, 1); }, "3 errors"},
      {"frame_correction's frame", [&] { frame_correction(model, s.errors, 8); }, "the frame 8 is not there"},
      {"error_chain", [&] { error_chain(model, s.few); }, "3 errors"},
      {"folded_chain", [&] { folded_chain(model, s.few); }, "3 errors"},
      {"folded", [&] { folded(model, s.few); }, "3 errors"},
      {"parameter_twists", [&] { parameter_twists(model, s.few, {0}); }, "3 errors"},
      {"twists of nothing", [&] { parameter_twists(model, s.errors, s.beyond); }, "parameter 1000 is not there"},
      {"ChainFolder", [&] { ChainFolder(model, s.beyond); }, "parameter 1000 is not there"},
      {"fold", [&] { folder.fold(s.few, shape, two, 0); }, "is not there, expected an index below 3"},
      {"fold's place", [&] { folder.fold(s.errors, shape, two, 1); }, "the twist 2 is not there"},
      {"fold's chain", [&] { folder.fold(s.errors, empty, two, 0); }, "0 links of a chain"},
      {"flange_pose", [&] { flange_pose(chain, s.few); }, "3 joint values"},
      {"flange_poses", [&] { flange_poses(chain, s.few_rows); }, "3 joint values"},
      {"flange_jacobian", [&] { flange_jacobian(chain, {}, s.few, jacobian); }, "3 joint values"},
      {"flange_jacobian, twist", [&] { flange_jacobian(chain, {{.frame = 9}}, s.q, jacobian); },
       "0 twists in frames of the chain, expected 1"},
      {"position_jacobian_by_matrix_derivatives",
       [&] { position_jacobian_by_matrix_derivatives(model, s.errors, s.beyond, s.q, {}); }, "parameter 1000"},
      {"its joints", [&] { position_jacobian_by_matrix_derivatives(model, s.errors, {0}, s.few, {}); },
       "3 joint values"},
      {"matrix_product", [&] { matrix_product(factors, s.errors, s.few); }, "3 joint values, expected 6"},
      {"its errors, too", [&] { matrix_product(factors, s.few, s.q); }, "3 errors"},
      {"point_columns", [&] { point_columns(factors, matrix_product(factors, s.errors, s.q), s.beyond, {}); },
       "parameter 1000 is not there"},
      {"its product", [&] { point_columns(factors, {}, {0}, {}); }, "0 derivatives"},
      {"manipulator_jacobians", [&] { manipulator_jacobians(model, s.errors, s.few); }, "3 joint values"},
      {"its errors", [&] { manipulator_jacobians(model, s.few, s.q); }, "3 errors"},
      {"ArmKinematics", [&] { ArmKinematics(model, s.few, {}); }, "3 errors"},
      {"ArmKinematics's effects", [&] { ArmKinematics(model, s.errors, s.few); }, "3 values of effects, expected 0"},
      {"effect_terms", [&] { effect_terms(model, EffectGroup::gain, s.few_rows); }, "3 joint values"},
      {"table_terms", [&] { table_terms(model, s.few_rows, 0.5); }, "3 joint values"},
      {"a table's length", [&] { table_terms(model, q, kNaN); }, "the length of a table"},
      {"effect_basis", [&] { effect_basis(s.elastic, s.few_rows); }, "3 joint values"},
      {"effect_motion", [&] { effect_motion(s.elastic, none, s.q, motion); }, "3 motions of joints"},
      {"effective_joint_values", [&] { effective_joint_values(s.elastic, VectorXd::Ones(1), q); },
       "1 values of effects"},
      {"with a basis", [&] { effective_joint_values(s.elastic, values, q, MatrixXd::Zero(1, 4)); }, "rows of a basis"},
      {"reduced_model", [&] { reduced_model(model, {}, {.configurations = 0}); }, "0 configurations"},
      {"its fixed", [&] { reduced_model(model, {}, {.fixed = {"base.Tq"}}); }, "no parameter is named 'base.Tq'"},
      {"its errors", [&] { reduced_model(model, {}, {.errors = s.few}); }, "3 errors of a reduction"},
      {"its noise", [&] { reduced_model(model, {}, {.noise = kNaN}); }, "the noise of a reduction"},
      {"independent_columns", [&] { independent_columns(s.few_rows, {true}); }, "1 marks of candidates, expected 4"},
  });
}

TEST(Doors, OfTheEstimationRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  const ErrorModel& model = s.model;
  const Measured& m = s.measured;
  Estimate short_one = s.estimate;
  short_one.errors = s.few;
  Estimate alone = s.estimate;
  alone.targets.resize(1);
  const LeastSquaresProblem problem(model, s.data, m.free);
  const std::vector<Eigen::Isometry3d> X_BF(2, Eigen::Isometry3d::Identity());
  const PositionPredictor predictor(model, s.estimate, m.free);
  RowSummary summary(4);
  const auto same_data = [&](int) { return s.data; };
  expect_refused({
      {"Unknowns", [&] { Unknowns(model, s.estimate.targets, {"Tq9"}); }, "Tq9"},
      {"with", [&] { static_cast<void>(m.free.with(model, UnknownGroup::base, {6})); }, "the unknown 6 is not there"},
      {"subset", [&] { static_cast<void>(m.free.subset({true})); }, "1 marks of unknowns"},
      {"moved", [&] { static_cast<void>(m.free.moved(s.estimate, s.few)); }, "3 values of a step"},
      {"moved errors", [&] { static_cast<void>(m.free.moved(short_one, VectorXd::Zero(m.free.size()))); },
       "is not there"},
      {"difference", [&] { static_cast<void>(m.free.difference(s.estimate, alone)); }, "1 targets of an estimate"},
      {"value", [&] { Unknowns::value(short_one, {.group = UnknownGroup::geometric, .index = 3}); }, "is not there"},
      {"value of a target", [&] { Unknowns::value(alone, {.group = UnknownGroup::targets, .index = 6}); },
       "the target 1"},
      {"linearise", [&] { static_cast<void>(problem.linearise(short_one)); }, "3 errors of an estimate"},
      {"cost", [&] { static_cast<void>(problem.cost(alone)); }, "1 targets of an estimate"},
      {"whitened", [&] { static_cast<void>(problem.whitened(alone)); }, "1 targets of an estimate"},
      {"whitened_summary", [&] { static_cast<void>(problem.whitened_summary(alone)); }, "1 targets of an estimate"},
      {"descend", [&] { descend(problem, alone, {}); }, "the target 1 is not there"},
      {"predicted_point", [&] { predicted_point(s.estimate, X_BF, {.configuration = 2}); }, "the configuration 2"},
      {"its target", [&] { predicted_point(s.estimate, X_BF, {.configuration = 1, .target = 3}); }, "the target 3"},
      {"PositionPredictor", [&] { static_cast<void>(predictor.jacobians(s.few)); }, "3 joint values"},
      {"base_and_tool_rows", [&] { base_and_tool_rows(X_BF[0], 3, 3); }, "the tool 3"},
      {"identification_jacobian", [&] { identification_jacobian(model, short_one, m.free, s.q); }, "3 errors"},
      {"identify_in_two_steps", [&] { identify_in_two_steps(model, same_data, s.estimate, s.beyond); },
       "parameter 1000"},
      {"register_base_and_targets", [&] { register_base_and_targets(X_BF, s.data); }, "2 poses of the flange"},
      {"well_conditioned_root", [&] { well_conditioned_root(s.few_rows); }, "4 columns of an information matrix"},
      {"RowSummary", [&] { summary.add_configuration(s.few_rows, s.q); }, "6 residuals of a configuration"},
      {"RowSummary's columns", [&] { summary.add_priors(MatrixXd::Zero(1, 3)); }, "3 columns of rows"},
  });
}

TEST(Doors, OfTheAssessmentRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  const ErrorModel& model = s.model;
  const Measured& m = s.measured;
  const FitProblem problem{.model = model, .measurements = s.data, .start = s.estimate, .free = m.free};
  const MatrixXd square = MatrixXd::Identity(3, 3);
  const std::vector<std::vector<Index>> folds = {{0}, {30}};
  const PositionPredictor predictor(model, s.estimate, m.free);
  const MatrixXd C = MatrixXd::Identity(m.free.size(), m.free.size());
  const std::string fold = "the configuration of a fold 30 is not there";
  const std::vector<std::vector<Index>> one = {{0}};
  const std::vector<std::vector<Index>> with_an_empty_one = {{0}, {}};
  const auto predict = [&](const MatrixXd& triangle, double noise, const std::vector<std::vector<Index>>& of) {
    predict_folds({.problem = problem, .sqrt_information = triangle, .noise = noise}, of);
  };
  expect_refused({
      {"check_distances", [&] { check_distances(s.data, {.noise_floor = kNaN}); }, "the floor of the noise"},
      {"check_residuals", [&] { check_residuals(model, s.data, s.estimate, {.smallest_slip = kNaN}); },
       "the smallest slip"},
      {"predicted_covariance", [&] { predicted_covariance(predictor, square, s.q, 0); }, "3 columns of a covariance"},
      {"its target", [&] { predicted_covariance(predictor, C, s.q, 3); }, "the target 3"},
      {"pseudo_values", [&] { pseudo_values(model, s.data, s.estimate, Loss::huber, {1.0}); }, "1 weights of rows"},
      {"predict_folds", [&] { predict(C, 1e-5, folds); }, fold},
      {"its empty fold", [&] { predict(C, 1e-5, with_an_empty_one); }, "0 configurations of a fold"},
      {"its triangle", [&] { predict(square, 1e-5, one); }, "3 columns of a triangle"},
      {"its noise", [&] { predict(C, kNaN, one); }, "the noise"},
      {"cross_validate_by_sums", [&] { cross_validate_by_sums(problem, folds, 1e-5); }, fold},
      {"cross_validate", [&] { cross_validate(problem, folds); }, fold},
      {"cross_validate_nominal", [&] { cross_validate_nominal(model, s.data, folds); }, fold},
      {"can_be_left_out", [&] { can_be_left_out(s.data, folds, 33); }, fold},
      {"registered", [&] { registered(model, s.few, s.data); }, "3 errors"},
      {"difference_to_kdl", [&] { difference_to_kdl(model, s.errors, s.few_rows); }, "3 joint values"},
  });
}

TEST(Doors, OfTheCalibrationRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  CalibrationSettings elsewhere;
  elsewhere.predict_at = {.names = {"a", "b", "c", "d"}, .joint_values = s.few_rows};
  CalibrationSettings unnamed;
  unnamed.predict_at = {.names = {"a"}, .joint_values = MatrixXd::Zero(6, 4)};
  Estimate short_one = s.estimate;
  short_one.errors = s.few;
  SavedCalibration saved{{.model = s.model, .estimate = short_one}};
  CalibrationResult calibration;
  calibration.model = s.model;
  calibration.fit.identification.estimate = short_one;
  expect_refused({
      {"calibrate", [&] { calibrate(s.model, s.data, elsewhere); }, "3 joint values to predict at"},
      {"its names", [&] { calibrate(s.model, s.data, unnamed); }, "1 names of configurations to predict at"},
      {"calibrated_urdf", [&] { calibrated_urdf(s.robot, s.model, s.few); }, "3 errors"},
      {"result_json", [&] { result_json(s.robot, s.data, {}, calibration); }, "3 errors of an estimate"},
      {"result_table", [&] { result_table(s.data, calibration); }, "3 errors of an estimate"},
      {"residuals_csv", [&] { residuals_csv(s.data, calibration); }, "3 errors of an estimate"},
      {"effects_json", [&] { effects_json(s.elastic, VectorXd::Zero(1)); }, "1 coefficients of effects"},
      {"reported_robot", [&] { reported_robot(s.robot, s.model, short_one); }, "3 errors of an estimate"},
      {"reported_measurements",
       [&] { reported_measurements({.model = s.model, .estimate = short_one, .measurements = s.data}); }, "3 errors"},
      {"flange_poses", [&] { flange_poses(saved, MatrixXd::Zero(6, 1)); }, "3 errors"},
  });
}

TEST(Doors, OfTheSimulationRefuseWhatDoesNotFit) {
  const Sound& s = sound();
  Random random(1);
  VirtualRobot robot{.model = s.model, .truth = s.estimate};
  VirtualRobot broken = robot;
  broken.truth.errors = s.few;
  const MatrixXd q = MatrixXd::Zero(6, 2);
  Estimate alone = s.estimate;
  alone.targets.resize(1);
  const auto draw = [](Random&) -> MatrixXd { return MatrixXd::Zero(6, 2); };
  const MonteCarlo nowhere{
      .model = s.model, .with_errors = s.beyond, .targets = s.estimate.targets, .train = draw, .test = draw};
  const MonteCarlo empty{.model = s.model, .targets = s.estimate.targets, .train = draw};
  const MonteCarlo no_target{.model = s.model, .train = draw, .test = draw};
  expect_refused({
      {"virtual_robot", [&] { virtual_robot(s.model, s.beyond, {}, {}, random); }, "parameter 1000"},
      {"its sizes", [&] { virtual_robot(s.model, {}, {}, {.angle = kNaN}, random); }, "the size of true errors"},
      {"add_effects", [&] { add_effects(robot, {EffectGroup::gain}, s.few_rows, 1e-4, random); }, "3 joint values"},
      {"their size", [&] { add_effects(robot, {}, q, -1.0, random); }, "the size of true effects"},
      {"measure", [&] { measure(robot, s.few_rows, {}, random); }, "3 joint values"},
      {"its robot", [&] { measure(broken, q, {}, random); }, "3 errors"},
      {"its noise", [&] { measure(robot, q, {.sigma = kNaN}, random); }, "negative or not finite"},
      {"run_monte_carlo", [&] { run_monte_carlo(nowhere); }, "parameter 1000"},
      {"its functions", [&] { run_monte_carlo(empty); }, "is empty, expected a function"},
      {"its targets", [&] { run_monte_carlo(no_target); }, "0 targets"},
      {"predicted_errors", [&] { predicted_errors(empty); }, "is empty, expected a function"},
      {"as_one_model", [&] { as_one_model(s.model, broken.truth, robot); }, "3 errors"},
      {"distances_from_truth", [&] { distances_from_truth(s.model, s.estimate, alone, q); }, "1 targets of the truth"},
      {"compare_with_truth", [&] { compare_with_truth(s.model, s.estimate, broken.truth, q); }, "3 errors"},
      {"run_two_step_trial", [&] { run_two_step_trial({.robot = robot, .held_out = q}, random); }, "is empty"},
      {"what it holds out",
       [&] { run_two_step_trial({.robot = robot, .configurations = draw, .held_out = s.few_rows}, random); },
       "3 joint values held out"},
  });
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
  const SelectionTask pool{q, none};
  const SelectionTask wrong{q, square};
  const SelectionTask to_rate{q, square, q};
  expect_refused({
      {"travel_time", [&] { travel_time(joints, s.q, s.few); }, "3 joint values"},
      {"way_time", [&] { way_time(joints, s.few, q); }, "3 joint values"},
      {"short_way", [&] { short_way(joints, s.few, q); }, "3 joint values of home"},
      {"plan_csv", [&] { plan_csv({.configurations = {"1"}, .joint_values = q}, joints); },
       "1 labels of configurations"},
      {"body_with_radius", [&] { body_with_radius(s.robot, -1.0); }, "the radius of the body"},
      {"tool_body", [&] { tool_body(s.robot, targets, kNaN); }, "the radius of the tool"},
      {"link_frames", [&] { link_frames(s.robot, s.few); }, "3 joint values"},
      {"pairs_to_keep_apart", [&] { pairs_to_keep_apart(s.robot, {far}, 0.1); }, "the frame of a capsule 99"},
      {"their clearance", [&] { pairs_to_keep_apart(s.robot, {}, kNaN); }, "the clearance"},
      {"candidates", [&] { candidates(s.robot, targets, {.ranges = limits_of(joints)}, {.count = -1}); },
       "-1 candidates"},
      {"violated", [&] { violated(s.robot, targets, {.ranges = limits_of(joints)}, s.few); }, "3 joint values"},
      {"nominal_experiment", [&] { nominal_experiment(s.model, targets, {}, {}, {"D.x"}); },
       "no parameter is named 'D.x'"},
      {"point_jacobian", [&] { point_jacobian(experiment, s.few); }, "3 joint values"},
      {"its errors", [&] { point_jacobian(short_one, s.q); }, "3 errors of an estimate"},
      {"information", [&] { information(experiment, s.few_rows); }, "3 joint values"},
      {"predicted", [&] { predicted(experiment, square, q); }, rows},
      {"floor_of_worst_configuration", [&] { floor_of_worst_configuration(experiment, 0); }, "0 configurations"},
      {"observability_indices", [&] { observability_indices(experiment, s.few_rows); }, "3 joint values"},
      {"select_configurations", [&] { select_configurations(experiment, wrong); }, rows},
      {"select_for_accuracy", [&] { select_for_accuracy(experiment, to_rate, 1e-3, Figure::mean, {}); }, rows},
      {"random_designs", [&] { random_designs(experiment, pool, {.count = 41, .draws = 2}); },
       "40 candidates, expected at least 41"},
      {"d_efficiency", [&] { d_efficiency(experiment, pool, square, 30); }, rows},
      {"make_plan", [&] { make_plan(request); }, "0 candidates, expected at least 1"},
  });
}

}  // namespace
}  // namespace kdl_calibration::preconditions_test
