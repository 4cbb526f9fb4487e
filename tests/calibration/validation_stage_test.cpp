// What a calibration says of the nominal, the calibrated and the rigid robot, and of what is held out (see
// result_json_test.cpp for fitted rows).

#include "calibration/validation_stage.hpp"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <set>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "effects/effect_terms.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/kinematics.hpp"
#include "planning/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::validation_stage_test {
namespace {

using Eigen::Index;
using Eigen::Vector3d;
using Folds = std::vector<std::vector<Index>>;

constexpr double kNoise = 3e-5;

// An arm whose joints have gains, measured in repeats; some rows are held out by their split.
struct WithGains : testing::VirtualExperiment {
  Measurements train;
  Measurements all;

  explicit WithGains(const MeasuringNoise& noise) : VirtualExperiment({.random = Random(21)}) {
    robot.model.effects = gain_terms(model);
    robot.truth.effects = Eigen::VectorXd::LinSpaced(static_cast<Index>(robot.model.effects.size()), 2e-4, 8e-4);
    train = testing::without_sigmas(measure(24, noise));
    all = joined(train, testing::without_sigmas(measure(5, noise, Split::test)));
  }
};

void expect_equal(const ErrorStatistics& found, const ErrorStatistics& expected, double tolerance,
                  const std::string& what) {
  EXPECT_EQ(found.count, expected.count) << what;
  EXPECT_NEAR(found.mean, expected.mean, tolerance) << what;
  EXPECT_NEAR(found.rms, expected.rms, tolerance) << what;
  EXPECT_NEAR(found.p95, expected.p95, tolerance) << what;
  EXPECT_NEAR(found.max, expected.max, tolerance) << what;
  EXPECT_NEAR(found.std, expected.std, tolerance) << what;
}

struct Gained {
  WithGains arm = WithGains({.sigma = kNoise, .repeats = 2});
  CalibrationSettings options{.noise = {.weights = Weights::equal},
                              .selection = {.effects = {.groups = {EffectGroup::gain}}},
                              .validation = {.leave_one_out = true, .k_fold = 4},
                              .diagnosis = {.try_readings = false},
                              .threads = 1};
  CalibrationResult found;

  Gained() {
    options.noise.stated.independent.setConstant(kNoise);
    found = calibrate(arm.model, arm.all, options);
  }

  FitProblem problem(const ErrorModel& model, const Estimate& start, const Unknowns& free) const {
    FitProblem result{.model = model, .measurements = arm.train, .start = start, .free = free};
    result.options.joint.residuals.noise = options.noise.stated;
    return result;
  }
};

const Gained& gained() {
  static const Gained result;
  return result;
}

// The nominal robot at each fold, with base and targets registered to the others.
ErrorStatistics nominal_without_each_fold(const ErrorModel& model, const Measurements& measured, const Folds& folds) {
  std::vector<double> distances;
  for (const auto& fold : folds) {
    const auto in_fold = [&](const Observation& o) {
      return std::find(fold.begin(), fold.end(), o.configuration) != fold.end();
    };
    const Estimate start = nominal_start(model, subset(measured, [&](const Observation& o) { return !in_fold(o); }));
    const std::vector<double> own = position_errors(model, start, averaged(subset(measured, in_fold)));
    distances.insert(distances.end(), own.begin(), own.end());
  }
  return error_statistics(distances);
}

TEST(ValidationStage, PredictsEveryFoldByEachRobotWithoutIt) {
  const CalibrationResult& found = gained().found;
  const WithGains& arm = gained().arm;
  const Estimate& calibrated = found.fit.identification.estimate;
  Estimate without_gains = calibrated;
  without_gains.effects.setZero();
  EXPECT_EQ(found.accuracy.folds, 4);
  for (const int folds : {0, 4}) {
    const Folds groups = make_folds(arm.train, folds);
    const BeforeAfter& errors = folds == 0 ? *found.accuracy.leave_one_out : *found.accuracy.k_fold;
    const std::string which = std::to_string(folds) + " folds, ";
    const auto refitted = [&](const Estimate& start, const Unknowns& free) {
      return error_statistics(cross_validate(gained().problem(found.model, start, free), groups, 1).distances);
    };
    expect_equal(errors.after, refitted(calibrated, found.fit.free), 0.1 * kNoise, which + "after");
    expect_equal(*errors.rigid, refitted(without_gains, found.fit.free.without(UnknownGroup::effects)), 0.1 * kNoise,
                 which + "rigid");
    expect_equal(errors.before, nominal_without_each_fold(arm.model, arm.train, groups), 0.1 * kNoise,
                 which + "before");
  }
  EXPECT_EQ(found.accuracy.held_out(), &*found.accuracy.leave_one_out);
}

// What a URDF can carry is worth as much beside effects as without them: the weights are its own.
TEST(ValidationStage, TheExportedRobotIsTheOneThatIsFittedWithoutEffects) {
  const WithGains arm({.sigma = kNoise, .repeats = 2});
  const auto calibrated = [&](const std::set<EffectGroup>& groups) {
    CalibrationSettings options{.diagnosis = {.try_readings = false}, .threads = 1};
    options.selection.effects.groups.assign(groups.begin(), groups.end());
    return calibrate(arm.model, arm.all, options);
  };
  const CalibrationResult with = calibrated({EffectGroup::gain});
  const CalibrationResult without = calibrated({});
  EXPECT_LT(with.accuracy.leave_one_out->after.rms, 0.5 * without.accuracy.leave_one_out->after.rms);
  EXPECT_NEAR(with.accuracy.leave_one_out->rigid->rms / without.accuracy.leave_one_out->after.rms, 1.0, 1e-3);
  EXPECT_NEAR(with.exported.test->rms / without.accuracy.test->after.rms, 1.0, 1e-3);
}

// Rows that are predicted at poses that the fit has seen are told apart, in number and in error.
TEST(ValidationStage, TellsTestRowsAtFittedPosesApart) {
  testing::VirtualExperiment experiment({.random = Random(5)});
  const Eigen::MatrixXd q = experiment.configurations(20);
  const Measurements train = testing::without_sigmas(experiment.measure(q, {.sigma = kNoise}));
  const Measurements again = testing::without_sigmas(experiment.measure(q.leftCols(4), {.sigma = kNoise}, Split::test));
  const Measurements elsewhere = testing::without_sigmas(experiment.measure(3, {.sigma = kNoise}, Split::test));
  const auto calibrated = [&](const Measurements& measured) {
    return calibrate(experiment.model, measured,
                     {.validation = {.held_out = false}, .diagnosis = {.try_readings = false}});
  };
  const CalibrationResult both = calibrated(joined(joined(train, again), elsewhere));
  expect_equal(*both.accuracy.test_at_fitted_poses, calibrated(joined(train, again)).accuracy.test->after, 1e-12,
               "at fitted poses");
  expect_equal(*both.accuracy.test_at_new_poses, calibrated(joined(train, elsewhere)).accuracy.test->after, 1e-12,
               "at new poses");
  EXPECT_FALSE(calibrated(joined(train, elsewhere)).accuracy.test_at_fitted_poses.has_value());
}

TEST(ValidationStage, WithoutEffectsTheExportedRobotIsTheCalibratedOne) {
  testing::VirtualExperiment experiment({.random = Random(3)});
  const Measurements measured = testing::without_sigmas(experiment.measure(20, {.sigma = kNoise}));
  const CalibrationResult found =
      calibrate(experiment.model, measured, {.validation = {.k_fold = 5}, .diagnosis = {.try_readings = false}});
  EXPECT_EQ(found.exported.estimate.errors, found.fit.identification.estimate.errors);
  expect_equal(found.exported.train, found.accuracy.train.after, 0.0, "exported");
  expect_equal(*found.exported.held_out, found.accuracy.k_fold->after, 0.0, "exported");
  EXPECT_FALSE(found.exported.test.has_value());
  EXPECT_FALSE(found.accuracy.test || found.accuracy.iso_test_before || found.accuracy.iso_test_after ||
               found.accuracy.train.rigid);
  EXPECT_FALSE(found.accuracy.k_fold->rigid.has_value());
}

// Of measurements without noise the nominal robot is still predicted to a thousandth of a micrometre.
TEST(ValidationStage, TheNominalRobotIsPredictedAsExactlyAsItsErrorsAreLarge) {
  testing::VirtualExperiment experiment({.random = Random(8)});
  const Measurements measured = experiment.measure(20);
  const CalibrationResult found = calibrate(
      experiment.model, measured, {.validation = {.leave_one_out = true}, .diagnosis = {.try_readings = false}});
  const Folds singly = make_folds(measured, 0);
  const ErrorStatistics expected = nominal_without_each_fold(experiment.model, measured, singly);
  EXPECT_GT(expected.rms, 1e-3);
  expect_equal(found.accuracy.leave_one_out->before, expected, 1e-5 * expected.rms, "before");
  EXPECT_LT(found.accuracy.leave_one_out->after.max, 1e-9);
}

TEST(ValidationStage, NothingIsRegisteredWhereAllFramesAreKnown) {
  testing::VirtualExperiment experiment({.random = Random(9)});
  const Measurements measured = testing::without_sigmas(experiment.measure(20, {.sigma = kNoise, .repeats = 2}));
  const Estimate& truth = experiment.robot.truth;
  const CalibrationResult found =
      calibrate(experiment.model, measured,
                {.parameters = {.known = {.bases = {{.X_WB = truth.frames.base()}}, .targets = truth.frames.targets}},
                 .validation = {.leave_one_out = true},
                 .diagnosis = {.try_readings = false}});
  Estimate nominal = truth;
  nominal.errors.setZero();
  const ErrorStatistics expected = error_statistics(position_errors(experiment.model, nominal, averaged(measured)));
  expect_equal(found.accuracy.leave_one_out->before, expected, 1e-12, "before");
}

TEST(ValidationStage, HoldsOutWhatIsAskedForAndNothingElse) {
  testing::VirtualExperiment experiment({.random = Random(10)});
  const Measurements measured = testing::without_sigmas(experiment.measure(16, {.sigma = kNoise}));
  const auto held_out = [&](bool leave_one_out, int k_fold, bool by_default) {
    const CalibrationResult found =
        calibrate(experiment.model, measured,
                  {.validation = {.leave_one_out = leave_one_out, .k_fold = k_fold, .held_out = by_default},
                   .diagnosis = {.try_readings = false}});
    EXPECT_FALSE(found.accuracy.nested_leave_one_out.has_value());
    EXPECT_EQ(found.held_out_points.size(), found.accuracy.leave_one_out || found.accuracy.k_fold ? 48U : 0U);
    return std::pair(found.accuracy.leave_one_out.has_value(), found.accuracy.k_fold ? found.accuracy.folds : 0);
  };
  EXPECT_EQ(held_out(false, 1, true), std::pair(true, 0)) << "one fold is none";
  EXPECT_EQ(held_out(false, 2, true), std::pair(false, 2));
  EXPECT_EQ(held_out(true, 3, false), std::pair(true, 3));
  EXPECT_EQ(held_out(false, 0, false), std::pair(false, 0));
}

TEST(ValidationStage, NestedIsLeaveOneOutAndNestedWhereThereIsAChoice) {
  testing::VirtualExperiment experiment({.random = Random(11)});
  const Measurements measured = testing::without_sigmas(experiment.measure(16, {.sigma = kNoise}));
  CalibrationSettings options{.validation = {.nested = true, .held_out = false}, .diagnosis = {.try_readings = false}};
  const CalibrationResult without_choice = calibrate(experiment.model, measured, options);
  EXPECT_TRUE(without_choice.accuracy.leave_one_out.has_value());
  EXPECT_FALSE(without_choice.accuracy.nested_leave_one_out.has_value());
  std::vector<std::size_t> told;
  options.selection.automatic_priors = true;
  options.threads = 1;
  options.progress = [&](const std::string& what, std::size_t done, std::size_t of) {
    if (what == "nested leave-one-out") {
      told.push_back(100 * done + of);
    }
  };
  const CalibrationResult chosen = calibrate(experiment.model, measured, options);
  ASSERT_TRUE(chosen.accuracy.nested_leave_one_out.has_value());
  EXPECT_EQ(chosen.accuracy.nested_leave_one_out->count, 48);
  ASSERT_EQ(told.size(), 17U);
  EXPECT_EQ(told.back(), 1616U);
}

/// The R-2000iC/165F with errors of a millimetre and a milliradian in 25 configurations.
struct Series : testing::VirtualExperiment {
  Measurements measured;

  explicit Series(const std::vector<TargetFrame>& stated = published_targets())
      : VirtualExperiment({.targets = stated}) {
    measure_at(configurations(25));
  }
  void measure_at(const Eigen::MatrixXd& q) { measured = testing::without_sigmas(measure(q, {.sigma = kNoise})); }
  CalibrationResult calibrated(const CalibrationSettings& options = {}) const {
    return calibrate(model, measured, options);
  }
};

TEST(HeldOut, IsLeaveOneOutAndTenFoldsOfMany) {
  Series s(published_targets(2));
  const CalibrationResult asked =
      s.calibrated({.validation = {.leave_one_out = true}, .diagnosis = {.try_readings = false}});
  const CalibrationResult not_asked = s.calibrated({.diagnosis = {.try_readings = false}});
  ASSERT_TRUE(asked.accuracy.leave_one_out && not_asked.accuracy.leave_one_out);
  EXPECT_EQ(not_asked.accuracy.leave_one_out->after.rms, asked.accuracy.leave_one_out->after.rms);
  EXPECT_FALSE(not_asked.accuracy.k_fold);
  EXPECT_EQ(not_asked.accuracy.held_out()->after.count, 50);
  s = Series(published_targets(1));
  constexpr int kMost = static_cast<int>(kMostLeftOutSingly);
  for (const auto& [count, singly] : {std::pair{kMost, true}, std::pair{kMost + 1, false}}) {
    s.measure_at(s.configurations(count));
    const CalibrationResult found = s.calibrated({.diagnosis = {.try_readings = false}});
    EXPECT_EQ(found.accuracy.leave_one_out.has_value(), singly) << count;
    EXPECT_EQ(found.accuracy.k_fold.has_value(), !singly) << count;
    EXPECT_EQ(found.accuracy.folds, singly ? 0 : 10) << count;
    EXPECT_EQ(found.accuracy.held_out()->after.count, count) << count;
    EXPECT_EQ(found.uncertainty.influence.configurations.size(), singly ? static_cast<std::size_t>(count) : 0U)
        << "one by one";
  }
}

// Nine points determine 27 parameters and leave nothing to tell whether they are right.
TEST(HeldOut, IsNothingWhereTheRestWouldNotSuffice) {
  Series s(published_targets(1));
  const Eigen::MatrixXd q = s.measured.joint_values;
  for (const auto& [count, enough] : {std::pair{9, false}, std::pair{10, true}}) {
    s.measure_at(q.leftCols(count));
    const CalibrationResult found = s.calibrated();
    EXPECT_EQ(found.accuracy.held_out() != nullptr, enough) << count;
    EXPECT_EQ(std::count_if(found.diagnosis.remarks.begin(), found.diagnosis.remarks.end(),
                            [](const Remark& remark) { return remark.cause == Cause::nothing_left_out; }),
              enough ? 0 : 1)
        << count;
  }
}

// Three of four configurations determine fewer parameters than all four: the fit to all would predict the fourth by
// what it took from it.
TEST(HeldOut, IsNothingWhereTheRestLeavesTheParametersOpen) {
  Series s;
  s.measure_at(s.configurations(4));
  const CalibrationResult found = s.calibrated();
  EXPECT_EQ(found.accuracy.held_out(), nullptr);
  EXPECT_THAT(messages_of(found.diagnosis.remarks),
              ::testing::Contains(::testing::HasSubstr("12 of 12 left-out points are not "
                                                       "counted")));
}

// Without its only configuration nobody knows where the fourth target is, but the other three are known.
TEST(HeldOut, LeavesOutOfTheCountOnlyWhatTheRestLeavesOpen) {
  Series s(published_targets());
  s.measured = testing::without_sigmas(s.measure(20, {.sigma = kNoise}));
  s.measured.targets.push_back("D");
  s.measured.observations.push_back(s.measured.observations[6 * 3]);
  s.measured.observations.back().target = 3;
  const CalibrationResult found = s.calibrated();
  EXPECT_THAT(messages_of(found.diagnosis.remarks),
              ::testing::Contains(::testing::HasSubstr("1 of 61 left-out points are not counted")));
  ASSERT_TRUE(found.accuracy.leave_one_out);
  EXPECT_EQ(found.accuracy.leave_one_out->after.count, 60);
  EXPECT_EQ(found.accuracy.leave_one_out->before.count, 60);
  s.measured.observations.pop_back();
  s.measured.targets.pop_back();
  EXPECT_NEAR(found.accuracy.leave_one_out->after.rms, s.calibrated().accuracy.leave_one_out->after.rms, 2e-6);
}

TEST(HeldOut, ReportsEachFitAndWhatItIsFor) {
  std::vector<std::string> reported;
  CalibrationSettings options{.validation = {.k_fold = 3}, .threads = 1};
  options.validation.leave_one_out = true;
  options.progress = [&](const std::string& what, std::size_t done, std::size_t of) {
    if (what == "leave-one-out" || what == "3-fold") {
      reported.push_back(what + " " + std::to_string(done) + "/" + std::to_string(of));
    }
  };
  Series().calibrated(options);
  ASSERT_EQ(reported.size(), 30U);
  EXPECT_EQ(reported[12], "leave-one-out 12/25");
  EXPECT_EQ(reported.back(), "3-fold 3/3");
}

// Few configurations, much noise: what is best depends on which are there. The last four are held out by their split.
struct InDoubt : testing::VirtualExperiment {
  Measurements measured;

  InDoubt()
      : VirtualExperiment({.X_WB = Eigen::Translation3d(2.0, -3.0, 0.5) *
                                   Eigen::AngleAxisd(1.2, Vector3d(0.3, -0.2, 1.1).normalized()),
                           .random = Random(29)}),
        measured(testing::without_sigmas(measure(15, {.sigma = 4e-4, .repeats = 2}))) {
    for (Observation& o : measured.observations) {
      o.split = o.configuration >= 11 ? Split::test : Split::train;
    }
  }
};

// The mean over the repeats of each target of a configuration, against the prediction from KDL's solver.
std::vector<double> distances_to_means(const InDoubt& arm, const Estimate& estimate, Index configuration) {
  const KDL::Chain chain = error_chain(arm.model, estimate.errors);
  std::vector<double> distances;
  for (std::size_t k = 0; k < arm.measured.targets.size(); ++k) {
    Vector3d sum = Vector3d::Zero();
    double count = 0.0;
    for (const Observation& o : arm.measured.observations) {
      if (o.configuration == configuration && o.target == static_cast<int>(k)) {
        sum += o.position();
        count += 1.0;
      }
    }
    if (count > 0.0) {
      const Eigen::VectorXd q = arm.measured.joint_values.col(configuration);
      distances.push_back((sum / count - testing::kdl_point(chain, estimate, q, k)).norm());
    }
  }
  return distances;
}

Measurements without(const Measurements& measurements, const std::vector<Index>& left_out) {
  return subset(measurements, [&](const Observation& o) {
    return o.split == Split::train && std::find(left_out.begin(), left_out.end(), o.configuration) == left_out.end();
  });
}

// Every choice, size and fit made by a calibration that has never seen the configuration. The nested prediction is
// linear and weighs means alike, so that it is not the same to the last digit.
TEST(ValidationStage, NestedLeaveOneOutChoosesWithoutTheConfigurationThatItPredicts) {
  const InDoubt arm;
  CalibrationSettings options{.noise = {.weights = Weights::equal}, .diagnosis = {.try_readings = false}};
  options.selection.automatic_priors = true;
  options.validation.leave_one_out = true;
  options.validation.nested = true;
  const CalibrationResult found = calibrate(arm.model, arm.measured, options);
  std::vector<double> expected;
  std::set<double> chosen;
  for (Index c = 0; c < 11; ++c) {
    const CalibrationResult others = calibrate(arm.model, without(arm.measured, {c}),
                                               {.noise = {.weights = Weights::equal},
                                                .selection = {.automatic_priors = true},
                                                .validation = {.held_out = false},
                                                .diagnosis = {.try_readings = false}});
    chosen.insert(others.selection.priors.length);
    const auto own = distances_to_means(arm, others.fit.identification.estimate, c);
    expected.insert(expected.end(), own.begin(), own.end());
  }
  EXPECT_GT(chosen.size(), 1U) << "the choice is the same without any of them: a leak would not show";
  const ErrorStatistics statistics = error_statistics(expected);
  ASSERT_TRUE(found.accuracy.nested_leave_one_out.has_value());
  EXPECT_EQ(found.accuracy.nested_leave_one_out->count, 33);
  EXPECT_NEAR(found.accuracy.nested_leave_one_out->rms, statistics.rms, 0.02 * statistics.rms);
  EXPECT_NEAR(found.accuracy.nested_leave_one_out->max, statistics.max, 0.05 * statistics.max);
  EXPECT_GT(std::abs(found.accuracy.nested_leave_one_out->rms - found.accuracy.leave_one_out->after.rms),
            0.02 * statistics.rms);
}

TEST(ValidationStage, LeaveOneOutIsALoopWithTheSameLossNoiseAndPriors) {
  InDoubt arm;
  arm.measured.observations[20].position().x() += 0.01;  // an outlier
  CalibrationSettings options{.noise = {.weights = Weights::equal}, .diagnosis = {.try_readings = false}};
  options.selection.priors = {.length = 1e-3, .angle = 1e-3};
  options.noise.stated.independent = Vector3d(3e-4, 4e-4, 5e-4);
  options.noise.stated.common.setConstant(1e-4);
  options.estimator.loss = Loss::tukey;
  options.validation.leave_one_out = true;
  const CalibrationResult found = calibrate(arm.model, arm.measured, options);
  const JointOptions joint{.residuals = {.priors = options.selection.priors, .noise = options.noise.stated}};
  const Estimate& start = found.fit.identification.estimate;
  std::vector<double> after;
  std::vector<double> before;
  for (Index c = 0; c < 11; ++c) {
    const Measurements others = without(arm.measured, {c});
    const Estimate refit = identify_robustly({.model = arm.model,
                                              .measurements = others,
                                              .start = start,
                                              .free = found.fit.free,
                                              .options = {.loss = Loss::tukey, .joint = joint}})
                               .fit.estimate;
    const auto own = distances_to_means(arm, refit, c);
    after.insert(after.end(), own.begin(), own.end());
    const auto nominal = distances_to_means(arm, nominal_start(arm.model, others), c);
    before.insert(before.end(), nominal.begin(), nominal.end());
  }
  ASSERT_TRUE(found.accuracy.leave_one_out.has_value());
  EXPECT_EQ(found.accuracy.leave_one_out->after.count, 33);
  const ErrorStatistics expected = error_statistics(after);
  EXPECT_NEAR(found.accuracy.leave_one_out->after.rms, expected.rms, 1e-5 * expected.rms);
  EXPECT_NEAR(found.accuracy.leave_one_out->after.p95, expected.p95, 1e-5 * expected.p95);
  // Without a fit of its own a fold is predicted to a tenth of the noise.
  EXPECT_NEAR(found.accuracy.leave_one_out->before.rms, error_statistics(before).rms, 0.1 * found.noise.sigma);
}

}  // namespace
}  // namespace kdl_calibration::validation_stage_test
