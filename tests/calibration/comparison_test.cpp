// What a calibration says of the nominal, the calibrated and the rigid robot, each figure found anew from its estimate.

#include "calibration/comparison.hpp"

#include <gmock/gmock.h>

#include <cmath>

#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::comparison_test {
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

void expect_equal(const Iso9283& found, const Iso9283& expected, const std::string& what) {
  expect_equal(found.accuracy, expected.accuracy, 1e-9, what + ", accuracy");
  expect_equal(found.repeatability, expected.repeatability, 1e-9, what + ", repeatability");
}

struct Gained {
  WithGains arm = WithGains({.sigma = kNoise, .repeats = 2});
  CalibrationOptions options{.effects = {.groups = {EffectGroup::gain}},
                             .weights = Weights::equal,
                             .leave_one_out = true,
                             .k_fold = 4,
                             .threads = 1,
                             .try_readings = false};
  Calibration found;

  Gained() {
    options.noise.independent.setConstant(kNoise);
    found = calibrate(arm.model, arm.all, options);
  }

  FitProblem problem(const ErrorModel& model, const Estimate& start, const Unknowns& free) const {
    FitProblem result{.model = model, .measurements = arm.train, .start = start, .free = free};
    result.options.joint.residuals.noise = options.noise;
    return result;
  }
};

const Gained& gained() {
  static const Gained result;
  return result;
}

TEST(Comparison, StatesWhatEachRobotLeavesOfFittedAndTestRows) {
  const Calibration& found = gained().found;
  const WithGains& arm = gained().arm;
  const Estimate nominal = nominal_start(arm.model, arm.train);
  const Estimate rigid = fit(gained().problem(arm.model, nominal, found.free.without(UnknownGroup::effects))).estimate;
  const Estimate& calibrated = found.identification.estimate;
  const auto statistics = [&](const ErrorModel& model, const Estimate& estimate, Rows rows) {
    return error_statistics(position_errors(model, estimate, arm.all, rows));
  };
  EXPECT_LT((found.exported.estimate.errors - rigid.errors).norm(), 1e-8);
  EXPECT_TRUE(found.exported.estimate.effects.isZero(0.0));
  ASSERT_TRUE(found.test && found.iso_test_before && found.iso_test_after && found.train.rigid && found.test->rigid);
  for (const Rows rows : {Rows::train, Rows::test}) {
    const BeforeAfter& errors = rows == Rows::train ? found.train : *found.test;
    const std::string which = rows == Rows::train ? "train" : "test";
    expect_equal(errors.before, statistics(arm.model, nominal, rows), 1e-9, which + " before");
    expect_equal(errors.after, statistics(found.model, calibrated, rows), 1e-9, which + " after");
    expect_equal(*errors.rigid, statistics(arm.model, rigid, rows), 1e-9, which + " rigid");
    EXPECT_GT(errors.rigid->rms, 1.1 * errors.after.rms) << which;
  }
  expect_equal(found.iso_before, iso_9283(arm.model, nominal, arm.all), "before");
  expect_equal(found.iso_after, iso_9283(found.model, calibrated, arm.all), "after");
  expect_equal(*found.iso_test_before, iso_9283(arm.model, nominal, arm.all, Rows::test), "test before");
  expect_equal(*found.iso_test_after, iso_9283(found.model, calibrated, arm.all, Rows::test), "test after");
  EXPECT_FALSE(found.exported.nominal_kept);
  expect_equal(found.exported.train, *found.train.rigid, 0.0, "exported");
  expect_equal(*found.exported.test, *found.test->rigid, 0.0, "exported, test rows");
  expect_equal(*found.exported.held_out, *found.leave_one_out->rigid, 0.0, "exported, held out");
  expect_equal(found.exported.iso, iso_9283(arm.model, rigid, arm.all), "exported");
}

TEST(Comparison, PredictsEveryFoldByEachRobotWithoutIt) {
  const Calibration& found = gained().found;
  const WithGains& arm = gained().arm;
  const Estimate& calibrated = found.identification.estimate;
  Estimate without_gains = calibrated;
  without_gains.effects.setZero();
  EXPECT_EQ(found.folds, 4);
  for (const int folds : {0, 4}) {
    const Folds groups = make_folds(arm.train, folds);
    const BeforeAfter& errors = folds == 0 ? *found.leave_one_out : *found.k_fold;
    const std::string which = std::to_string(folds) + " folds, ";
    const auto refitted = [&](const Estimate& start, const Unknowns& free) {
      return error_statistics(cross_validate(gained().problem(found.model, start, free), groups, 1).distances);
    };
    expect_equal(errors.after, refitted(calibrated, found.free), 0.1 * kNoise, which + "after");
    expect_equal(*errors.rigid, refitted(without_gains, found.free.without(UnknownGroup::effects)), 1e-9,
                 which + "rigid");
    expect_equal(errors.before, error_statistics(cross_validate_nominal(arm.model, arm.train, groups).distances),
                 0.1 * kNoise, which + "before");
  }
  EXPECT_EQ(found.held_out(), &*found.leave_one_out);
}

TEST(Comparison, WithoutEffectsTheExportedRobotIsTheCalibratedOne) {
  testing::VirtualExperiment experiment({.random = Random(3)});
  const Measurements measured = testing::without_sigmas(experiment.measure(20, {.sigma = kNoise}));
  const Calibration found = calibrate(experiment.model, measured, {.k_fold = 5, .try_readings = false});
  EXPECT_EQ(found.exported.estimate.errors, found.identification.estimate.errors);
  expect_equal(found.exported.iso, found.iso_after, "exported");
  expect_equal(found.exported.train, found.train.after, 0.0, "exported");
  expect_equal(*found.exported.held_out, found.k_fold->after, 0.0, "exported");
  EXPECT_FALSE(found.exported.test.has_value());
  EXPECT_FALSE(found.test || found.iso_test_before || found.iso_test_after || found.train.rigid);
  EXPECT_FALSE(found.k_fold->rigid.has_value());
}

// Weights by what repeats show: shared noise is large, so that weights matter.
TEST(Comparison, TheRigidRobotIsFittedWithTheSamePartsOfTheNoise) {
  const WithGains arm({.sigma = 1e-5, .repeats = 3, .common = Vector3d(2e-4, 2e-5, 1e-4)});
  const Calibration found =
      calibrate(arm.model, arm.train,
                {.effects = {.groups = {EffectGroup::gain}}, .held_out = false, .threads = 1, .try_readings = false});
  ASSERT_TRUE(found.noise.parts.has_value());
  ASSERT_EQ(found.noise.parts->scatter.size(), 0) << "the rows are not weighed by the parts";
  FitProblem problem{.model = arm.model,
                     .measurements = arm.train,
                     .start = nominal_start(arm.model, arm.train),
                     .free = found.free.without(UnknownGroup::effects)};
  const Estimate alike = fit(problem).estimate;
  problem.options.joint.residuals.noise = found.noise.parts->model({});
  const Estimate weighed = fit(problem).estimate;
  EXPECT_LT((found.exported.estimate.errors - weighed.errors).norm(), 1e-7);
  EXPECT_GT((alike.errors - weighed.errors).norm(), 1e-5);
}

// Of measurements without noise the nominal robot is still predicted to a thousandth of a micrometre.
TEST(Comparison, TheNominalRobotIsPredictedAsExactlyAsItsErrorsAreLarge) {
  testing::VirtualExperiment experiment({.random = Random(8)});
  const Measurements measured = experiment.measure(20);
  const Calibration found = calibrate(experiment.model, measured, {.leave_one_out = true, .try_readings = false});
  const Folds singly = make_folds(measured, 0);
  const ErrorStatistics expected =
      error_statistics(cross_validate_nominal(experiment.model, measured, singly).distances);
  EXPECT_GT(expected.rms, 1e-3);
  expect_equal(found.leave_one_out->before, expected, 1e-5 * expected.rms, "before");
  EXPECT_LT(found.leave_one_out->after.max, 1e-9);
}

TEST(Comparison, NothingIsRegisteredWhereAllFramesAreKnown) {
  testing::VirtualExperiment experiment({.random = Random(9)});
  const Measurements measured = testing::without_sigmas(experiment.measure(20, {.sigma = kNoise, .repeats = 2}));
  const Estimate& truth = experiment.robot.truth;
  const Calibration found = calibrate(
      experiment.model, measured,
      {.known_base = truth.X_WB, .known_targets = truth.targets, .leave_one_out = true, .try_readings = false});
  Estimate nominal = truth;
  nominal.errors.setZero();
  const ErrorStatistics expected = error_statistics(position_errors(experiment.model, nominal, averaged(measured)));
  expect_equal(found.leave_one_out->before, expected, 1e-12, "before");
}

TEST(Comparison, HoldsOutWhatIsAskedForAndNothingElse) {
  testing::VirtualExperiment experiment({.random = Random(10)});
  const Measurements measured = testing::without_sigmas(experiment.measure(16, {.sigma = kNoise}));
  const auto held_out = [&](bool leave_one_out, int k_fold, bool by_default) {
    const Calibration found =
        calibrate(experiment.model, measured,
                  {.leave_one_out = leave_one_out, .k_fold = k_fold, .held_out = by_default, .try_readings = false});
    EXPECT_FALSE(found.nested_leave_one_out.has_value());
    EXPECT_EQ(found.held_out_points.size(), found.leave_one_out || found.k_fold ? 48U : 0U);
    return std::pair(found.leave_one_out.has_value(), found.k_fold ? found.folds : 0);
  };
  EXPECT_EQ(held_out(false, 1, true), std::pair(true, 0)) << "one fold is none";
  EXPECT_EQ(held_out(false, 2, true), std::pair(false, 2));
  EXPECT_EQ(held_out(true, 3, false), std::pair(true, 3));
  EXPECT_EQ(held_out(false, 0, false), std::pair(false, 0));
}

TEST(Comparison, NestedIsLeaveOneOutAndNestedWhereThereIsAChoice) {
  testing::VirtualExperiment experiment({.random = Random(11)});
  const Measurements measured = testing::without_sigmas(experiment.measure(16, {.sigma = kNoise}));
  CalibrationOptions options{.nested = true, .held_out = false, .try_readings = false};
  const Calibration without_choice = calibrate(experiment.model, measured, options);
  EXPECT_TRUE(without_choice.leave_one_out.has_value());
  EXPECT_FALSE(without_choice.nested_leave_one_out.has_value());
  std::vector<std::size_t> told;
  options.automatic_priors = true;
  options.threads = 1;
  options.progress = [&](const std::string& what, std::size_t done, std::size_t of) {
    if (what == "nested leave-one-out") {
      told.push_back(100 * done + of);
    }
  };
  const Calibration chosen = calibrate(experiment.model, measured, options);
  ASSERT_TRUE(chosen.nested_leave_one_out.has_value());
  EXPECT_EQ(chosen.nested_leave_one_out->count, 48);
  ASSERT_EQ(told.size(), 16U);
  EXPECT_EQ(told.back(), 1616U);
}

}  // namespace
}  // namespace kdl_calibration::comparison_test
