// Plans for arms that do more than their geometry says.

#include "kdl_calibration/planner.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/observability.hpp"
#include "kdl_calibration/result_json.hpp"
#include "kdl_calibration/simulation.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::planner_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using ::testing::HasSubstr;
using testing::refusal;

PlanRequest request_with(const std::vector<EffectGroup>& effects) {
  PlanRequest request;
  request.robot = testing::fanuc();
  request.targets = published_targets();
  request.cell.ranges = limits_of(request.robot.joints);
  request.effects = effects;
  request.count = 20;
  request.candidates = 100;
  request.workspace = 20;
  request.starts = 1;
  return request;
}

TEST(Planner, WithEffectsPromisesWhatAFitOfThemWillTell) {
  const PlanRequest request = request_with({EffectGroup::gravity, EffectGroup::harmonics});
  const Plan plan = make_plan(request);
  const auto terms = static_cast<Index>(plan.experiment.model.effects.size());
  ASSERT_GT(terms, 30);
  // The least-squares problem of a calibration with these terms, their usual size as prior.
  const ErrorModel& model = plan.experiment.model;
  Estimate nominal{.errors = plan.experiment.errors, .targets = plan.experiment.targets};
  nominal.effects = Eigen::VectorXd::Zero(terms);
  const VirtualRobot robot{.model = model, .truth = nominal};
  Random random(1);
  const Measurements measured = measure(robot, plan.sheet.joint_values, {.sigma = 3e-5}, random);
  const MatrixXd fit = LeastSquaresProblem(model, measured, plan.experiment.free).linearise(nominal).hessian;
  EXPECT_LT((plan.selection.information - fit).norm(), 1e-9 * fit.norm());
  const ColumnRange effects = plan.experiment.free.range(UnknownGroup::effects);
  const Eigen::VectorXd priors = prior_information(plan.experiment).diagonal();
  EXPECT_LT((priors.segment(effects.first, terms).array() * (3e-4 * 3e-4) - 1.0).abs().maxCoeff(), 1e-12);
  EXPECT_TRUE(priors.head(effects.first).isZero(0.0)) << "geometry has none";
}

TEST(Planner, APlanForSaggingArmsTellsMoreOfThem) {
  const PlanRequest request = request_with({EffectGroup::gravity, EffectGroup::transverse});
  const Plan aware = make_plan(request);
  const Plan rigid = make_plan(request_with({}));
  EXPECT_GT(rigid.experiment.free.size(), 0);
  EXPECT_TRUE(rigid.experiment.model.effects.empty());
  const MatrixXd tasks = aware.drawn.joint_values.rightCols(request.workspace);
  const auto promised = [&](const Plan& plan) {
    const MatrixXd information =
        prior_information(aware.experiment) + kdl_calibration::information(aware.experiment, plan.sheet.joint_values);
    return predicted(aware.experiment, information, tasks).sigma;
  };
  EXPECT_NEAR(promised(aware).mean, aware.planned.sigma.mean, 1e-9 * aware.planned.sigma.mean);
  EXPECT_LT(promised(aware).mean, 0.97 * promised(rigid).mean);
  EXPECT_GT(aware.planned.sigma.mean, rigid.planned.sigma.mean) << "there is more to learn";
}

TEST(Planner, OnTopOfACalibrationItsTermsAreTheOnesItFound) {
  const Robot robot = testing::fanuc();
  const ErrorModel model = complete_model(robot);
  testing::VirtualExperiment arm(
      {.model = model, .with_errors = {{2, 4, 8}}, .sizes = {.length = 5e-4, .angle = 5e-4}, .random = Random(5)});
  const MatrixXd q = arm.configurations(60);
  add_effects(arm.robot, {EffectGroup::gravity}, q, 3e-4, arm.random);
  const Measurements measured = arm.measure(q, {.sigma = 3e-5});
  const CalibrationOptions options{
      .effects = {.groups = {EffectGroup::gravity}}, .held_out = false, .try_readings = false};
  const Calibration found = calibrate(model, measured, options);
  PlanRequest request = request_with({EffectGroup::gravity});
  request.calibrated = parse_calibration(result_json(robot, measured, options, found), robot);
  request.targets = request.calibrated->estimate.targets;
  request.count = 5;
  const Plan plan = make_plan(request);
  ASSERT_EQ(plan.experiment.model.effects.size(), found.model.effects.size());
  for (std::size_t e = 0; e < found.model.effects.size(); ++e) {
    EXPECT_EQ(plan.experiment.model.effects[e].name, found.model.effects[e].name);
    EXPECT_EQ(plan.experiment.model.effects[e].scale, found.model.effects[e].scale);
  }
  // Five configurations more than sixty: somewhat better than what the calibration knows, which is all that is known.
  const double before = found.predicted.measured.mean;
  EXPECT_LT(plan.planned.sigma.mean, 1.3 * before);
  EXPECT_GT(plan.planned.sigma.mean, 0.5 * before);
}

// ---- Put together from the library's parts --------------------------------------------------------------------------

PlanRequest small_request() {
  PlanRequest request = request_with({});
  request.count = 9;
  request.candidates = 200;
  request.workspace = 60;
  request.starts = 2;
  request.seed = 3;
  request.threads = 1;
  request.cell.height = 0.2;
  return request;
}

// The information may have been summed in another order.
void expect_near(double found, double expected, const std::string& what) {
  EXPECT_NEAR(found / expected, 1.0, 1e-9) << what;
}

void expect_same(const Prediction& found, const Prediction& expected, const std::string& what) {
  expect_near(found.sigma.mean, expected.sigma.mean, what);
  expect_near(found.sigma.p95, expected.sigma.p95, what);
  expect_near(found.sigma.max, expected.sigma.max, what);
  expect_near(found.worst_configuration, expected.worst_configuration, what);
}

Prediction mean_of_random(const Experiment& experiment, const SelectionTask& task, const RandomDesigns& designs) {
  const std::vector<Prediction> all = predicted(experiment, random_designs(experiment, task, designs), task.tasks, 1);
  Prediction mean;
  for (const Prediction& one : all) {
    mean.sigma.mean += one.sigma.mean / static_cast<double>(all.size());
    mean.sigma.p95 += one.sigma.p95 / static_cast<double>(all.size());
    mean.sigma.max += one.sigma.max / static_cast<double>(all.size());
    mean.worst_configuration += one.worst_configuration / static_cast<double>(all.size());
  }
  return mean;
}

// The plan against what its parts give for the same task.
void expect_put_together(const PlanRequest& request, const Plan& plan, const MatrixXd& given, const MatrixXd& before) {
  constexpr double kPendantStep = 1e-3 * testing::kDegree;
  const Candidates drawn = candidates(request.robot, request.targets, request.cell,
                                      {.count = request.candidates + request.workspace,
                                       .seed = request.seed,
                                       .angle_step = kPendantStep,
                                       .length_step = 1e-6});
  EXPECT_EQ(plan.drawn.joint_values, drawn.joint_values);
  EXPECT_EQ(plan.drawn.samples, drawn.samples);
  const MatrixXd tasks =
      request.tasks.size() > 0 ? request.tasks : MatrixXd(drawn.joint_values.rightCols(request.workspace));
  const SelectionTask task{drawn.joint_values.leftCols(request.candidates), given, tasks};
  const SelectionOptions options{.criterion = request.criterion,
                                 .count = request.count,
                                 .starts = request.starts,
                                 .seed = request.seed,
                                 .threads = 1};
  const Selection selection =
      request.accuracy ? select_for_accuracy(plan.experiment, task, *request.accuracy, request.accuracy_of, options)
                       : select_configurations(plan.experiment, task, options);
  ASSERT_EQ(plan.selection.chosen, selection.chosen);
  EXPECT_LT((plan.selection.information - selection.information).norm(), 1e-12 * selection.information.norm());
  const MatrixXd chosen = task.candidates(Eigen::all, selection.chosen);
  const Eigen::VectorXd home = request.home.size() > 0 ? request.home : Eigen::VectorXd::Zero(chosen.rows());
  const MatrixXd way = chosen(Eigen::all, short_way(request.robot.joints, home, chosen));
  EXPECT_EQ(plan.sheet.joint_values, way);
  EXPECT_DOUBLE_EQ(plan.seconds, way_time(request.robot.joints, home, way));
  expect_same(plan.planned, predicted(plan.experiment, selection.information, tasks, 1), "planned");
  const Prediction of_way = predicted(plan.experiment, selection.information, way, 1);
  expect_near(plan.worst_configuration, std::max(plan.planned.worst_configuration, of_way.worst_configuration),
              "worst");
  const auto count = static_cast<int>(selection.chosen.size());
  expect_same(plan.random,
              mean_of_random(plan.experiment, task, {.count = count, .draws = 200, .seed = request.seed, .threads = 1}),
              "random");
  expect_near(plan.efficiency, d_efficiency(plan.experiment, task, selection.information, count, 1), "efficiency");
  MatrixXd measured(way.rows(), before.cols() + way.cols());
  measured << before, way;
  EXPECT_NEAR(plan.observability.O1, observability_indices(plan.experiment, measured).O1, 1e-12);
  EXPECT_NEAR(plan.observability.O3, observability_indices(plan.experiment, measured).O3, 1e-12);
}

TEST(Planner, PutsAPlanTogether) {
  PlanRequest request = small_request();
  request.robot = parse_robot(testing::kOddArm);
  request.cell.ranges = limits_of(request.robot.joints);
  request.targets = published_targets(3);
  const Plan plan = make_plan(request);
  const MatrixXd nothing = MatrixXd::Zero(columns(plan.experiment), columns(plan.experiment));
  expect_put_together(request, plan, nothing, MatrixXd(5, 0));
  ASSERT_TRUE(plan.floor);
  EXPECT_DOUBLE_EQ(*plan.floor, floor_of_worst_configuration(plan.experiment, 9));
  EXPECT_THAT(plan.sheet.configurations, ::testing::ElementsAre("1", "2", "3", "4", "5", "6", "7", "8", "9"));
  EXPECT_THAT(plan.sheet.targets, ::testing::ElementsAre("A", "B", "C"));
  EXPECT_FALSE(plan.monte_carlo);
  // Noise that is shared has no floor.
  PlanRequest shared = request;
  shared.candidates = 20;
  shared.workspace = 5;
  EXPECT_TRUE(make_plan(shared).floor);
  shared.noise.configuration_sigma = 1e-5;
  EXPECT_FALSE(make_plan(shared).floor);

  request.home = Eigen::Matrix<double, 5, 1>(1.0, 0.2, -1.0, 0.5, 0.3);
  request.tasks = plan.drawn.joint_values.leftCols(7);
  request.criterion = Criterion::i_optimal;
  request.accuracy = 1.3 * plan.planned.sigma.p95;
  request.accuracy_of = Figure::p95;
  expect_put_together(request, make_plan(request), nothing, MatrixXd(5, 0));
}

TEST(Planner, PlansOnTopOfPriorsAndOfWhatWasMeasured) {
  PlanRequest request = small_request();
  request.priors = {.length = 1e-3, .angle = 2e-3};
  testing::VirtualExperiment arm({.targets = request.targets, .random = Random(2)});
  Measurements measured = arm.measure(6, {.sigma = 3e-5});
  measured.configurations = {"2", "3", "5", "seven", "8", "10"};
  for (Observation& observation : measured.observations) {
    observation.split = observation.configuration == 1 ? Split::test : Split::train;
  }
  request.measured = measured;
  const Plan plan = make_plan(request);
  MatrixXd before(6, 5);
  before << measured.joint_values.col(0), measured.joint_values.rightCols(4);
  expect_put_together(request, plan, prior_information(plan.experiment) + information(plan.experiment, measured),
                      before);
  EXPECT_FALSE(plan.floor);
  EXPECT_THAT(plan.sheet.configurations, ::testing::ElementsAre("1", "4", "6", "7", "9", "11", "12", "13", "14"));
}

TEST(Planner, OnTopOfACalibrationKnowsTheInverseOfWhatItSaysOfItsColumns) {
  PlanRequest request = small_request();
  SavedCalibration known;
  known.model = complete_model(request.robot);
  Random random(4);
  known.estimate = {.errors = testing::random_errors(known.model, random, 1e-3, 1e-3), .targets = request.targets};
  // Two that the plan does not estimate, and not all that it does; one of them was left open.
  const std::vector<std::string> names = {"base.Tx", "dq2", "dq3", "Rx1", "Tx1", "Tz2",
                                          "Ty1",     "Rz3", "Ry2", "A.x", "C.z"};
  known.free = Unknowns(known.model, request.targets, names);
  MatrixXd R(11, 11);
  for (double& element : R.reshaped()) {
    element = 1e-4 * random.normal();
  }
  known.covariance = R * R.transpose() + 1e-9 * MatrixXd::Identity(11, 11);
  const Index open = *known.free.column("Tz2");
  known.covariance(open, open) = std::numeric_limits<double>::infinity();
  request.calibrated = known;
  const Plan plan = make_plan(request);
  EXPECT_EQ(plan.experiment.errors, known.estimate.errors);
  std::vector<Index> here;
  std::vector<Index> there;
  for (const std::string& name : names) {
    if (plan.experiment.free.column(name) && name != "Tz2") {
      here.push_back(*plan.experiment.free.column(name));
      there.push_back(*known.free.column(name));
    }
  }
  ASSERT_GE(here.size(), 6U);
  ASSERT_LE(here.size(), 9U);
  MatrixXd given = MatrixXd::Zero(columns(plan.experiment), columns(plan.experiment));
  const MatrixXd inverse = MatrixXd(known.covariance(there, there)).inverse();
  given(here, here) = inverse;
  expect_put_together(request, plan, given, MatrixXd(6, 0));
}

TEST(Planner, TriesThePlanOnVirtualRobotsBeforeTheTracker) {
  PlanRequest request = small_request();
  request.count = 14;
  request.noise = {.configuration_sigma = 1e-5,
                   .tracker = TrackerNoise{.range = 1e-5, .transverse = 2e-5, .transverse_per_metre = 4e-6},
                   .tracker_position = {4.0, 1.0, 0.5}};
  request.priors = {.length = 1e-3, .angle = 1e-3};
  request.monte_carlo = 2;
  const Plan plan = make_plan(request);
  EXPECT_FALSE(plan.floor) << "the tracker's noise depends on where it stands";
  const MatrixXd tasks = plan.drawn.joint_values.rightCols(60);
  NoiseModel noise;
  noise.tracker = request.noise.tracker;
  noise.independent.setConstant(request.noise.sigma);
  noise.common.setConstant(1e-5);
  const MonteCarloResult expected =
      run_monte_carlo({.model = complete_model(request.robot),
                       .with_errors = plan.experiment.free.geometric(),
                       .targets = request.targets,
                       .sizes = {.length = 1e-3, .angle = 1e-3},
                       .noise = {.sigma = request.noise.sigma, .common = noise.common, .tracker = noise.tracker},
                       .X_WB = Eigen::Isometry3d(Eigen::Translation3d(-4.0, -1.0, -0.5)),
                       .train = [&](Random&) { return plan.sheet.joint_values; },
                       .test = [&](Random&) { return MatrixXd(tasks); },
                       .calibration = {.priors = request.priors, .noise = noise},
                       .runs = 2,
                       .seed = 3,
                       .threads = 1,
                       .progress = {}});
  ASSERT_TRUE(plan.monte_carlo);
  EXPECT_EQ(plan.monte_carlo->rms, expected.rms);
  EXPECT_EQ(plan.monte_carlo->not_trusted, expected.not_trusted);
}

// The least useful configurations taken away one by one: least tr(M^+ A).
std::vector<MatrixXd> fewer_and_fewer(const Experiment& experiment, const Plan& plan, std::size_t least) {
  std::vector<MatrixXd> own;
  for (const Index c : plan.selection.chosen) {
    own.push_back(information(experiment, MatrixXd(plan.drawn.joint_values.col(c))));
  }
  std::vector<MatrixXd> designs(own.size() + 1);
  designs[own.size()] = plan.selection.information;
  while (own.size() > least) {
    const MatrixXd covariance = designs[own.size()].completeOrthogonalDecomposition().pseudoInverse();
    std::size_t worst = 0;
    for (std::size_t k = 0; k < own.size(); ++k) {
      worst = (covariance * own[k]).trace() < (covariance * own[worst]).trace() ? k : worst;
    }
    designs[own.size() - 1] = designs[own.size()] - own[worst];
    own.erase(own.begin() + static_cast<std::ptrdiff_t>(worst));
  }
  return designs;
}

TEST(Planner, SaysWhatFewerConfigurationsWouldGive) {
  PlanRequest request = small_request();
  request.count = 12;
  for (const double prior : {0.0, 1e-3}) {
    request.priors = {.length = prior, .angle = prior};
    request.workspace = prior > 0.0 ? 60 : 520;  // of which at most 500 are looked at
    const Plan plan = make_plan(request);
    // 33 parameters and 9 coordinates in a configuration; with priors one configuration tells something.
    std::vector<int> counts = {4, 5, 6, 7, 8, 9, 10, 11, 12};
    if (prior > 0.0) {
      counts = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    }
    const SelectionTask task{plan.drawn.joint_values.leftCols(200), prior_information(plan.experiment),
                             plan.drawn.joint_values.middleCols(200, std::min(500, request.workspace))};
    const std::vector<MatrixXd> designs = fewer_and_fewer(plan.experiment, plan, static_cast<std::size_t>(counts[0]));
    const std::vector<CountedAccuracy> found = accuracy_by_count(request, plan);
    ASSERT_EQ(found.size(), counts.size());
    for (std::size_t k = 0; k < counts.size(); ++k) {
      EXPECT_EQ(found[k].count, counts[k]);
      const Prediction planned =
          predicted(plan.experiment, designs[static_cast<std::size_t>(counts[k])], task.tasks, 1);
      const Prediction random =
          mean_of_random(plan.experiment, task, {.count = counts[k], .draws = 20, .seed = 3, .threads = 1});
      if (std::isfinite(planned.sigma.mean) || std::isfinite(found[k].plan)) {
        EXPECT_NEAR(found[k].plan / planned.sigma.mean, 1.0, 1e-6) << counts[k];
      }
      if (std::isfinite(random.sigma.mean) || std::isfinite(found[k].random)) {
        EXPECT_NEAR(found[k].random / random.sigma.mean, 1.0, 1e-9) << counts[k];
      }
    }
  }
  request.count = 40;
  request.workspace = 30;
  request.priors = {};
  std::vector<int> counts;
  for (const CountedAccuracy& entry : accuracy_by_count(request, make_plan(request))) {
    counts.push_back(entry.count);
  }
  EXPECT_THAT(counts, ::testing::ElementsAre(4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 16, 18, 20, 23, 26, 29, 33, 37, 40));
}

TEST(Planner, RefusesWhatItCannotDo) {
  PlanRequest request = small_request();
  request.candidates = 0;
  EXPECT_THAT(refusal([&] { make_plan(request); }), HasSubstr("candidates"));
  request.candidates = 200;
  request.workspace = -1;
  EXPECT_THAT(refusal([&] { make_plan(request); }), HasSubstr("configurations of the workspace"));
  request.workspace = 60;
  request.calibrated = SavedCalibration{};
  request.monte_carlo = 1;
  EXPECT_THAT(refusal([&] { make_plan(request); }), HasSubstr("a calibration does not have them"));
}

TEST(Planner, NeedsNoWorkspaceBesideTasks) {
  PlanRequest request = small_request();
  request.tasks = Eigen::MatrixXd::Constant(6, 2, 0.3);
  request.workspace = 0;
  EXPECT_FALSE(make_plan(request).selection.chosen.empty());
}

TEST(Planner, RefusesEffectsThatNoPlanCanTell) {
  EXPECT_THAT(refusal([] { make_plan(request_with({EffectGroup::torque})); }), HasSubstr("effects: no torque"));
  EXPECT_THAT(refusal([] { make_plan(request_with({EffectGroup::ripple})); }), HasSubstr("effects: how often a turn"));
  PlanRequest tried = request_with({EffectGroup::gravity});
  tried.monte_carlo = 1;
  EXPECT_THAT(refusal([&] { make_plan(tried); }), HasSubstr("rigid arms"));
  PlanRequest many = request_with({EffectGroup::tables});
  many.candidates = 100000;
  EXPECT_THAT(refusal([&] { make_plan(many); }), HasSubstr("expected fewer"));
}

}  // namespace
}  // namespace kdl_calibration::planner_test
