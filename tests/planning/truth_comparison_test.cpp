#include "planning/truth_comparison.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/identification.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/parameters.hpp"
#include "planning/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::truth_comparison_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A virtual R-2000iC/165F whose every parameter, gauge included, is off, and the exact estimate in another gauge.
class TruthComparison : public ::testing::Test {
protected:
  void SetUp() override {
    const Measurements exact = experiment.measure(40);
    estimate = identify_jointly(model, exact, nominal_start(model, exact), experiment.free).estimate;
  }
  MatrixXd configurations(int count) { return experiment.configurations(count); }

  const ComparedParameter& of(const kdl_calibration::TruthComparison& comparison, const std::string& name) {
    const std::size_t index = parameter_index(model, name);
    for (const ComparedParameter& parameter : comparison.parameters) {
      if (parameter.index == index) {
        return parameter;
      }
    }
    throw std::logic_error(name + " is not compared");
  }

  ErrorModel model = complete_model(testing::fanuc());
  testing::VirtualExperiment experiment{{.with_errors = with_true_errors(model, {}, true),
                                         .sizes = {.length = 0.001, .angle = 0.005},
                                         .ranges = published_ranges,
                                         .random = Random(11)}};
  Estimate truth = experiment.robot.truth;
  Estimate estimate;
};

TEST_F(TruthComparison, AnExactEstimateInAnotherGaugeDiffersInNothing) {
  const auto found = compare_with_truth(model, estimate, truth, configurations(200));
  EXPECT_TRUE(found.comparable()) << found.gauge_misfit;
  EXPECT_LT(found.largest_length, 1e-10);
  EXPECT_LT(found.largest_angle, 1e-10);
  EXPECT_EQ(found.points.count, 600);
  EXPECT_LT(found.points.max, 1e-10);
  for (const char* gauge : {"dq1", "dq6", "Rx1"}) {
    EXPECT_TRUE(of(found, gauge).gauge) << gauge;
  }
  EXPECT_FALSE(of(found, "Tx1").gauge);
  // The drawn values stand beside it as they are: with the complete model's errors they are others.
  EXPECT_EQ(of(found, "dq1").truth, truth.errors[static_cast<Eigen::Index>(parameter_index(model, "dq1"))]);
  EXPECT_GT(std::abs(of(found, "dq2").truth - of(found, "dq2").truth_in_gauge), 1e-4);
}

TEST_F(TruthComparison, ADifferenceOfOneParameterIsFoundAsWhatItIs) {
  estimate.errors += testing::errors_of(model, {{"Tz2", 2e-4}});
  estimate.frames.base() = estimate.frames.base() * Eigen::Translation3d(0.0, 3e-4, 0.0);
  const MatrixXd q = configurations(100);
  const auto found = compare_with_truth(model, estimate, truth, q);
  const ComparedParameter& shifted = of(found, "Tz2");
  EXPECT_NEAR(shifted.estimated - shifted.truth_in_gauge, 2e-4, 1e-10);
  EXPECT_NEAR(found.base_difference[1], 3e-4, 1e-10);
  EXPECT_NEAR(found.largest_length, 3e-4, 1e-10);
  EXPECT_LT(found.largest_angle, 1e-10);

  // The points, by hand through KDL.
  double largest = 0.0;
  const KDL::Chain estimated = error_chain(model, estimate.errors);
  const KDL::Chain exact = error_chain(model, truth.errors);
  for (const auto& at : q.colwise()) {
    for (int t = 0; t < 3; ++t) {
      const Eigen::Vector3d off =
          testing::kdl_point(estimated, estimate, at, t) - testing::kdl_point(exact, truth, at, t);
      largest = std::max(largest, off.norm());
    }
  }
  EXPECT_NEAR(found.points.max, largest, 1e-12);
}

TEST_F(TruthComparison, TheLargestDifferencesAreOfParametersBaseAndTargets) {
  const MatrixXd q = configurations(80);
  const auto with = [&](const std::function<void(Estimate&)>& change) {
    Estimate changed = estimate;
    change(changed);
    return compare_with_truth(model, changed, truth, q);
  };
  const auto angle = with([&](Estimate& e) { e.errors += testing::errors_of(model, {{"dq3", -5e-4}}); });
  EXPECT_NEAR(angle.largest_angle, 5e-4, 1e-9);
  EXPECT_LT(angle.largest_length, 1e-9);
  const auto turned =
      with([](Estimate& e) { e.frames.base().rotate(Eigen::AngleAxisd(6e-4, -Eigen::Vector3d::UnitY())); });
  EXPECT_NEAR(turned.largest_angle, 6e-4, 1e-9);
  EXPECT_NEAR(turned.base_difference[4], -6e-4, 1e-9);
  EXPECT_LT(turned.base_difference.head<3>().norm(), 1e-9);
  const auto tool = with([](Estimate& e) { e.frames.targets[1].X_FT.translation().z() -= 7e-4; });
  EXPECT_NEAR(tool.largest_length, 7e-4, 1e-9);
  EXPECT_LT(tool.largest_angle, 1e-9);
  // A twist in the base's own frame.
  const auto moved =
      with([](Estimate& e) { e.frames.base() = e.frames.base() * Eigen::Translation3d(1e-4, -2e-4, 8e-4); });
  EXPECT_LT((moved.base_difference.head<3>() - Eigen::Vector3d(1e-4, -2e-4, 8e-4)).norm(), 1e-9);
  EXPECT_NEAR(moved.largest_length, 8e-4, 1e-9);
  EXPECT_NEAR(moved.points.mean, Eigen::Vector3d(1e-4, -2e-4, 8e-4).norm(), 1e-9);
}

TEST_F(TruthComparison, OrientationsOfTargetsAreComparedWhereTheyWereMeasured) {
  testing::VirtualExperiment poses({.targets = testing::as_frames(published_targets(2)),
                                    .sizes = {.length = 0.001, .angle = 0.005},
                                    .ranges = published_ranges,
                                    .random = Random(12)});
  const Measurements exact = poses.measure(30);
  Estimate found = identify_jointly(poses.model, exact, nominal_start(poses.model, exact), poses.free).estimate;
  const MatrixXd q = poses.configurations(50);
  EXPECT_LT(compare_with_truth(poses.model, found, poses.robot.truth, q).largest_angle, 1e-9);
  found.frames.targets[1].X_FT.rotate(Eigen::AngleAxisd(9e-4, Eigen::Vector3d::UnitX()));
  const auto turned = compare_with_truth(poses.model, found, poses.robot.truth, q);
  EXPECT_NEAR(turned.largest_angle, 9e-4, 1e-9);
  EXPECT_LT(turned.largest_length, 1e-9);
}

TEST_F(TruthComparison, ParametersStandBesideTheTruthWithTheirNominalValues) {
  estimate.errors[static_cast<Eigen::Index>(parameter_index(model, "Tx0"))] = 1e-3;  // of the base link: the gauge
  const auto found = compare_with_truth(model, estimate, truth, configurations(40));
  EXPECT_DOUBLE_EQ(of(found, "Tx0").estimated, 1e-3);
  const double error = estimate.errors[static_cast<Eigen::Index>(parameter_index(model, "Tz2"))];
  EXPECT_DOUBLE_EQ(of(found, "Tz2").estimated, 1.075 + error);
  EXPECT_LE(found.parameters.size(), model.parameters.size());
}

TEST_F(TruthComparison, EffectsOfBothArePartOfThePredictions) {
  const MatrixXd q = configurations(60);
  VirtualRobot bent{.model = model, .truth = truth};
  add_effects(bent, {EffectGroup::harmonics, EffectGroup::gravity}, {.joint_values = q}, 3e-4, experiment.random);

  // An estimate that knows them differs in nothing.
  Estimate knowing = estimate;
  knowing.effects = bent.truth.effects;
  const ArmAndTruth same = arm_and_truth(bent.model, knowing, bent);
  EXPECT_EQ(same.model.effects.size(), 2 * bent.model.effects.size());
  const auto found = compare_with_truth(same.model, same.estimate, same.truth, configurations(200));
  EXPECT_TRUE(found.comparable()) << found.gauge_misfit;
  EXPECT_LT(found.points.max, 1e-10);
  EXPECT_LT(found.largest_length, 1e-10);

  // One without them misses what they do, by KDL, and its geometry is the same as before.
  const ArmAndTruth rigid = arm_and_truth(model, estimate, bent);
  const auto missing = compare_with_truth(rigid.model, rigid.estimate, rigid.truth, q);
  EXPECT_TRUE(missing.comparable()) << missing.gauge_misfit;
  EXPECT_LT(missing.largest_length, 1e-10);
  const MatrixXd moved = effective_joint_values(bent.model, bent.truth.effects, q);
  const KDL::Chain chain = error_chain(model, truth.errors);
  double squares = 0.0;
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    for (int t = 0; t < 3; ++t) {
      squares += (testing::kdl_point(chain, truth, moved.col(c), t) - testing::kdl_point(chain, truth, q.col(c), t))
                     .squaredNorm();
    }
  }
  const double rms = std::sqrt(squares / static_cast<double>(missing.points.count));
  EXPECT_GT(rms, 1e-4);
  EXPECT_NEAR(missing.points.rms, rms, 1e-9);
}

TEST_F(TruthComparison, ArmsUnderGravityOfAnotherDirectionAreNotOneModel) {
  VirtualRobot bent{.model = model, .truth = truth};
  add_effects(bent, {EffectGroup::gravity}, {.joint_values = configurations(60)}, 3e-4, experiment.random);
  ErrorModel on_a_wall = model;
  on_a_wall.gravity = {1.0, 0.0, 0.0};
  EXPECT_EQ(arm_and_truth(on_a_wall, estimate, bent).model.gravity, model.gravity) << "it has no effects of its own";
  on_a_wall.effects = effect_terms(on_a_wall, EffectGroup::gravity, configurations(60));
  estimate.effects = VectorXd::Zero(static_cast<Eigen::Index>(on_a_wall.effects.size()));
  EXPECT_THROW(arm_and_truth(on_a_wall, estimate, bent), InputError);
}

TEST_F(TruthComparison, TargetsAreMatchedByName) {
  std::swap(truth.frames.targets[0], truth.frames.targets[2]);
  truth.frames.targets.push_back({.name = "unmeasured"});
  EXPECT_LT(compare_with_truth(model, estimate, truth, configurations(50)).points.max, 1e-10);
  truth.frames.targets.erase(truth.frames.targets.begin());
  EXPECT_THROW(compare_with_truth(model, estimate, truth, configurations(50)), InputError);
}

}  // namespace
}  // namespace kdl_calibration::truth_comparison_test
