// Plans for arms that do more than their geometry says.

#include "planning/planner.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/least_squares.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "planning/measuring_plan.hpp"
#include "planning/simulation.hpp"
#include "refusal.hpp"
#include "results/result_json.hpp"
#include "robot/joint_ranges.hpp"
#include "uncertainty/observability.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::planner_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
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
  Estimate nominal{.errors = plan.experiment.errors, .frames = {.targets = plan.experiment.targets}, .effects = {}};
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
  add_effects(arm.robot, {EffectGroup::gravity}, {.joint_values = q}, 3e-4, arm.random);
  const Measurements measured = arm.measure(q, {.sigma = 3e-5});
  const CalibrationSettings options{.selection = {.effects = {.groups = {EffectGroup::gravity}}},
                                    .validation = {.held_out = false},
                                    .diagnosis = {.try_readings = false}};
  const CalibrationResult found = calibrate(model, measured, options);
  PlanRequest request = request_with({EffectGroup::gravity});
  request.calibrated = parse_calibration(result_json(robot, measured, found), robot);
  request.targets = request.calibrated->estimate.frames.targets;
  request.count = 5;
  const Plan plan = make_plan(request);
  ASSERT_EQ(plan.experiment.model.effects.size(), found.model.effects.size());
  for (std::size_t e = 0; e < found.model.effects.size(); ++e) {
    EXPECT_EQ(plan.experiment.model.effects[e].name, found.model.effects[e].name);
    EXPECT_EQ(plan.experiment.model.effects[e].scale, found.model.effects[e].scale);
  }
  // Five configurations more than sixty: somewhat better than what the calibration knows, which is all that is known.
  const double before = found.uncertainty.predicted.measured.mean;
  EXPECT_LT(plan.planned.sigma.mean, 1.3 * before);
  EXPECT_GT(plan.planned.sigma.mean, 0.5 * before);
}

// ---- what a plan promises ------------------------------------------------------------------------------------------

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

// The sheet is the chosen candidates in another order.
void expect_a_way_through_what_was_chosen(const PlanRequest& request, const Plan& plan) {
  const MatrixXd& way = plan.sheet.joint_values;
  ASSERT_EQ(static_cast<std::size_t>(way.cols()), plan.selection.chosen.size());
  std::set<Index> left(plan.selection.chosen.begin(), plan.selection.chosen.end());
  for (const auto& q : way.colwise()) {
    const auto found =
        std::find_if(left.begin(), left.end(), [&](Index c) { return plan.drawn.joint_values.col(c) == q; });
    ASSERT_NE(found, left.end()) << "not chosen, or twice";
    left.erase(found);
  }
  const Eigen::VectorXd home = request.home.size() > 0 ? request.home : Eigen::VectorXd::Zero(way.rows());
  EXPECT_NEAR(plan.seconds, way_time(request.robot.joints, home, way), 1e-9);
  EXPECT_EQ(plan.drawn.joint_values.cols(), request.candidates + request.workspace);
}

TEST(Planner, PromisesMoreThanChanceAndNoMoreThanCanBe) {
  PlanRequest request = small_request();
  request.robot = parse_robot(testing::kOddArm);
  request.cell.ranges = limits_of(request.robot.joints);
  request.targets = published_targets(3);
  const Plan plan = make_plan(request);
  expect_a_way_through_what_was_chosen(request, plan);
  EXPECT_LT(plan.planned.sigma.mean, plan.random.sigma.mean);
  EXPECT_LT(plan.planned.sigma.max, plan.random.sigma.max);
  ASSERT_TRUE(plan.floor);
  EXPECT_GE(plan.worst_configuration, *plan.floor);
  EXPECT_GE(plan.worst_configuration, plan.planned.worst_configuration);
  EXPECT_GT(plan.efficiency, 0.8);
  EXPECT_LE(plan.efficiency, 1.0);
  EXPECT_THAT(plan.sheet.configurations, ::testing::ElementsAre("1", "2", "3", "4", "5", "6", "7", "8", "9"));
  EXPECT_THAT(plan.sheet.targets, ::testing::ElementsAre("A", "B", "C"));
  EXPECT_FALSE(plan.monte_carlo);
  // Twice the noise, twice the sigma.
  PlanRequest noisier = request;
  noisier.noise.sigma *= 2.0;
  EXPECT_NEAR(make_plan(noisier).planned.sigma.mean / plan.planned.sigma.mean, 2.0, 1e-6);
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
  const Plan enough = make_plan(request);
  expect_a_way_through_what_was_chosen(request, enough);
  EXPECT_LE(enough.planned.sigma.p95, *request.accuracy);
  EXPECT_LE(enough.selection.chosen.size(), plan.selection.chosen.size());
}

TEST(Planner, PriorsAndWhatWasMeasuredPromiseMore) {
  PlanRequest request = small_request();
  const Plan alone = make_plan(request);
  request.priors = {.length = 1e-3, .angle = 2e-3};
  const Plan with_priors = make_plan(request);
  EXPECT_LT(with_priors.planned.sigma.mean, alone.planned.sigma.mean);
  testing::VirtualExperiment arm({.targets = request.targets, .random = Random(2)});
  Measurements measured = arm.measure(6, {.sigma = 3e-5});
  measured.configurations = {"2", "3", "5", "seven", "8", "10"};
  request.measured = measured;
  const Plan plan = make_plan(request);
  EXPECT_LT(plan.planned.sigma.mean, with_priors.planned.sigma.mean);
  EXPECT_FALSE(plan.floor);
  EXPECT_THAT(plan.sheet.configurations, ::testing::ElementsAre("1", "4", "6", "7", "9", "11", "12", "13", "14"));
  // Rows to test tell nothing.
  for (Observation& observation : measured.observations) {
    observation.split = Split::test;
  }
  request.measured = measured;
  EXPECT_NEAR(make_plan(request).planned.sigma.mean, with_priors.planned.sigma.mean,
              1e-6 * with_priors.planned.sigma.mean);
}

// What is known of some parameters helps as its covariance says, and a parameter that was left open does no harm.
TEST(Planner, OnTopOfACalibrationKnowsWhatItSaysOfItsColumns) {
  PlanRequest request = small_request();
  const auto sigma = [&](double scale, bool open) {
    CalibrationParts known;
    known.model = complete_model(request.robot);
    known.estimate = {.errors = testing::errors_of(known.model), .frames = {.targets = request.targets}, .effects = {}};
    known.free = Unknowns(known.model, request.targets, {"base.Tx", "dq2", "dq3", "Rx1", "Tx1", "Tz2", "A.x"});
    known.covariance = scale * MatrixXd::Identity(known.free.size(), known.free.size());
    if (open) {
      const Index column = *known.free.column("Tz2");
      known.covariance(column, column) = std::numeric_limits<double>::infinity();
    }
    request.calibrated = known;
    return make_plan(request).planned.sigma.mean;
  };
  request.calibrated.reset();
  const double alone = make_plan(request).planned.sigma.mean;
  EXPECT_NEAR(sigma(1e6, false) / alone, 1.0, 1e-3) << "nothing is known";
  EXPECT_LT(sigma(1e-9, false), 0.99 * alone);
  EXPECT_LT(sigma(1e-12, false), sigma(1e-9, false));
  EXPECT_GE(sigma(1e-12, true), sigma(1e-12, false));
  EXPECT_LT(sigma(1e-12, true), alone);
}

// Base and targets are new, and errors of the suspects are uncertain by 1 mm and 1 mrad. All others are known.
TEST(Planner, AfterACalibrationOnlySuspectsAreUncertain) {
  PlanRequest request = small_request();
  CalibrationParts known;
  known.model = complete_model(request.robot);
  known.estimate = {.errors = VectorXd::Zero(static_cast<Index>(known.model.parameters.size())),
                    .frames = {.targets = request.targets}};
  known.free = make_plan(request).experiment.free;
  constexpr double kKnown = 1e-16;
  known.covariance = kKnown * MatrixXd::Identity(known.free.size(), known.free.size());
  request.calibrated = known;
  const std::vector<std::string> one = {"joint_5"};
  for (const std::vector<std::string>& suspects : {one, std::vector<std::string>()}) {
    request.suspects = suspects;
    const Plan plan = make_plan(request);
    const std::vector<std::string> names = plan.experiment.free.names();
    std::vector<Index> uncertain;
    std::vector<double> prior;
    for (std::size_t c = 0; c < names.size(); ++c) {
      const auto& all = known.model.parameters;
      const auto error = std::find_if(all.begin(), all.end(), [&](const auto& p) { return p.name == names[c]; });
      if (error == all.end() || suspects.empty() || error->joint == "joint_5") {
        uncertain.push_back(static_cast<Index>(c));
        prior.push_back(error == all.end() ? 0.0 : 1e6);
      }
    }
    ASSERT_GT(uncertain.size(), suspects.empty() ? 30U : 17U);
    MatrixXd sums = information(plan.experiment, plan.sheet.joint_values)(uncertain, uncertain);
    sums += Eigen::Map<const VectorXd>(prior.data(), static_cast<Index>(prior.size())).asDiagonal();
    const VectorXd expected = sums.inverse().diagonal();
    const VectorXd variances = plan.selection.information.inverse().diagonal();
    for (std::size_t k = 0; k < uncertain.size(); ++k) {
      const std::string& name = names[static_cast<std::size_t>(uncertain[k])];
      EXPECT_NEAR(variances[uncertain[k]] / expected[static_cast<Index>(k)], 1.0, 1e-4) << name;
    }
    if (!suspects.empty()) {
      EXPECT_NEAR(variances.minCoeff() / kKnown, 1.0, 1e-4);
      // The same number of configurations for whatever may have changed tells less of this joint.
      request.suspects = std::vector<std::string>();
      const MatrixXd other = information(plan.experiment, make_plan(request).sheet.joint_values)(uncertain, uncertain);
      const MatrixXd of_all =
          other + MatrixXd(Eigen::Map<const VectorXd>(prior.data(), static_cast<Index>(prior.size())).asDiagonal());
      EXPECT_LT(std::log(of_all.determinant()), std::log(sums.determinant()));
    }
  }
}

TEST(Planner, TriesThePlanOnVirtualRobotsBeforeTheTracker) {
  PlanRequest request = small_request();
  request.count = 14;
  request.noise = {.configuration_sigma = 1e-5,
                   .tracker = TrackerNoise{.range = 1e-5, .transverse = 2e-5, .transverse_per_metre = 4e-6},
                   .tracker_position = {4.0, 1.0, 0.5}};
  request.priors = {.length = 1e-3, .angle = 1e-3};
  request.monte_carlo = 8;
  const Plan plan = make_plan(request);
  EXPECT_FALSE(plan.floor) << "the tracker's noise depends on where it stands";
  ASSERT_TRUE(plan.monte_carlo);
  EXPECT_EQ(plan.monte_carlo->runs, 8);
  EXPECT_EQ(plan.monte_carlo->not_trusted, 0);
  EXPECT_NEAR(plan.monte_carlo->all.rms / plan.planned.sigma.rms, 1.0, 0.25);
}

TEST(Planner, FewerConfigurationsGiveLess) {
  PlanRequest request = small_request();
  request.count = 12;
  for (const double prior : {0.0, 1e-3}) {
    request.priors = {.length = prior, .angle = prior};
    const Plan plan = make_plan(request);
    const std::vector<CountedAccuracy> found = accuracy_by_count(request, plan);
    // 33 parameters and 9 coordinates in a configuration; with priors one configuration tells something.
    ASSERT_EQ(found.size(), prior > 0.0 ? 12U : 9U);
    EXPECT_EQ(found.front().count, prior > 0.0 ? 1 : 4);
    EXPECT_EQ(found.back().count, 12);
    EXPECT_NEAR(found.back().plan / plan.planned.sigma.mean, 1.0, 1e-6);
    for (std::size_t k = 1; k < found.size(); ++k) {
      EXPECT_TRUE(found[k].plan < found[k - 1].plan || std::isinf(found[k - 1].plan)) << found[k].count;
      if (found[k].count > 6) {
        EXPECT_LT(found[k].plan, found[k].random) << found[k].count;
      }
    }
  }
}

TEST(Planner, RefusesWhatItCannotDo) {
  PlanRequest request = small_request();
  request.candidates = 0;
  EXPECT_THAT(refusal([&] { make_plan(request); }), HasSubstr("candidates"));
  request.candidates = 200;
  request.workspace = -1;
  EXPECT_THAT(refusal([&] { make_plan(request); }), HasSubstr("configurations of the workspace"));
  request.workspace = 60;
  request.calibrated = CalibrationParts{};
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
  EXPECT_THAT(refusal([] { make_plan(request_with({EffectGroup::torque})); }),
              HasSubstr("effects: torque is of what is measured with the arm"));
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
