// Plans for arms that do more than their geometry says.

#include "kdl_calibration/planner.hpp"

#include <gmock/gmock.h>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/result_json.hpp"
#include "kdl_calibration/simulation.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
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
  request.count = 40;
  request.candidates = 400;
  request.workspace = 300;
  request.starts = 2;
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
}  // namespace kdl_calibration
