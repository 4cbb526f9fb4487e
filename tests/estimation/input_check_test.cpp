#include "estimation/input_check.hpp"

#include <gmock/gmock.h>

#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "diagnosis/alternative_readings.hpp"
#include "diagnosis/convention_trial.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/training_rows.hpp"
#include "mistakes_support.hpp"
#include "noise/lack_of_fit.hpp"
#include "noise/noise_components.hpp"
#include "noise/noise_parts.hpp"
#include "noise/pseudo_values.hpp"
#include "planning/experiment.hpp"
#include "refusal.hpp"
#include "results/calibrated_urdf.hpp"
#include "results/result_json.hpp"
#include "results/result_table.hpp"
#include "screening/data_quality.hpp"
#include "two_step/two_step.hpp"
#include "uncertainty/influence.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration::input_check_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::Measured;
using ::testing::Ne;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

const Measured& sound() {
  static const Measured instance = testing::measured(complete_model(testing::fanuc()), 1);
  return instance;
}

Estimate rigid_truth() {
  Estimate estimate = sound().truth;
  estimate.effects.resize(0);
  return estimate;
}

void expect_refused(const std::string& where, const std::function<void()>& call, const std::string& words = "") {
  EXPECT_THAT(testing::refusal(call), AllOf(Ne("nothing was refused"), HasSubstr(words))) << where;
}

using Spoil = std::function<void(Measurements&)>;

/// Measurements that no reader makes, and the rule that the message names.
std::vector<std::pair<Spoil, std::string>> spoilt() {
  return {
      {[](Measurements& m) { m.observations[3].configuration = 30; }, "configuration 30 is not there"},
      {[](Measurements& m) { m.observations[3].configuration = -1; }, "configuration -1 is not there"},
      {[](Measurements& m) { m.observations[3].target = 3; }, "target 3 is not there"},
      {[](Measurements& m) { m.observations[3].target = -1; }, "target -1 is not there"},
      {[](Measurements& m) { m.observations[3].position.y() = kNaN; }, "coordinate is not finite"},
      {[](Measurements& m) { m.observations[3].sigma = -1.0; }, "sigma is negative"},
      {[](Measurements& m) { m.observations[3].sigma = kNaN; }, "sigma is negative or not finite"},
      {[](Measurements& m) { m.joint_values(2, 4) = kNaN; }, "joint value is not finite"},
      {[](Measurements& m) { m.joint_values.conservativeResize(6, 29); }, "30 configurations, expected 29"},
      {[](Measurements& m) { m.order.assign(3, 1); }, "3 places in the order"},
      {[](Measurements& m) { m.orientations.resize(3, point_alone()); }, "3 orientations"},
      {[](Measurements& m) { m.orientations.assign(m.observations.size(), Eigen::Quaterniond(2.0, 0.0, 0.0, 0.0)); },
       "no unit quaternion"},
      {[](Measurements& m) { m.joint_units.resize(2); }, "2 units of joints"}};
}

TEST(InputCheck, AcceptsWhatTheReaderMakes) {
  EXPECT_NO_THROW(check(sound().data, sound().model));
  EXPECT_NO_THROW(check(rigid_truth(), sound().model, sound().data));
  EXPECT_NO_THROW(check(sound().free, sound().model, sound().data));
  EXPECT_NO_THROW(check(ResidualOptions{}, sound().data));
  EXPECT_NO_THROW(check(RegistrationOptions{}));
}

TEST(InputCheck, NamesWhatDoesNotHoldTogether) {
  for (const auto& [spoil, words] : spoilt()) {
    Measurements wrong = sound().data;
    spoil(wrong);
    expect_refused(
        words, [&] { check(wrong); }, words);
  }
}

using TakesMeasurements = std::pair<std::string, std::function<void(const Measurements&)>>;

void expect_all_refuse(const std::vector<TakesMeasurements>& functions) {
  for (const auto& [name, function] : functions) {
    for (const auto& [spoil, words] : spoilt()) {
      Measurements wrong = sound().data;
      spoil(wrong);
      expect_refused(name + ": " + words, [&, &call = function] { call(wrong); });
    }
  }
}

TEST(InputCheck, FunctionsOfMeasurementsAloneRefuseThoseThatDoNotHoldTogether) {
  const Measured& m = sound();
  const std::vector<Eigen::Isometry3d> X_BF(m.data.configurations.size(), Eigen::Isometry3d::Identity());
  expect_all_refuse({
      {"register_base_and_targets", [&](const Measurements& d) { register_base_and_targets(X_BF, d); }},
      {"check_distances", [&](const Measurements& d) { check_distances(d); }},
      {"make_folds", [&](const Measurements& d) { make_folds(d, 3); }},
      {"can_be_left_out",
       [&](const Measurements& d) {
         can_be_left_out(d, {{0}, {1}}, 33);
       }},
      {"averaged", [&](const Measurements& d) { averaged(d); }},
      {"trained_ranges", [&](const Measurements& d) { trained_ranges(d); }},
      {"training_sample", [&](const Measurements& d) { training_sample(d, 5); }},
      {"joined", [&](const Measurements& d) { joined(m.data, d); }},
      {"joined in front", [&](const Measurements& d) { joined(d, m.data); }},
      {"subset", [&](const Measurements& d) { subset(d, [](const Observation&) { return true; }); }},
      {"noise_from_repeats", [&](const Measurements& d) { noise_from_repeats(d); }},
      {"measurements_csv", [&](const Measurements& d) { measurements_csv(d); }},
  });
}

TEST(InputCheck, FunctionsOfAModelRefuseMeasurementsThatDoNotHoldTogether) {
  const Measured& m = sound();
  const Estimate estimate = rigid_truth();
  const std::vector<Eigen::Isometry3d> X_BF(m.data.configurations.size(), Eigen::Isometry3d::Identity());
  const LeastSquaresProblem problem(m.model, m.data, m.free);
  const Eigen::MatrixXd sqrt_information = Eigen::MatrixXd::Identity(m.free.size(), m.free.size());
  const std::vector<double> weights(m.data.observations.size(), 1.0);
  const Experiment experiment = nominal_experiment(m.model, m.truth.targets);
  CalibrationResult calibration;
  calibration.model = m.model;
  calibration.fit.identification.estimate = estimate;
  expect_all_refuse({
      {"calibrate", [&](const Measurements& d) { calibrate(m.model, d); }},
      {"nominal_start", [&](const Measurements& d) { nominal_start(m.model, d); }},
      {"identify_jointly", [&](const Measurements& d) { identify_jointly(m.model, d, estimate, m.free); }},
      {"identify_robustly",
       [&](const Measurements& d) {
         identify_robustly({.model = m.model,
                            .measurements = d,
                            .start = estimate,
                            .free = m.free,
                            .options = {.loss = Loss::huber}});
       }},
      {"identify_in_two_steps",
       [&](const Measurements& d) {
         identify_in_two_steps(
             m.model, [&](int) { return d; }, estimate, m.free.geometric());
       }},
      {"position_errors", [&](const Measurements& d) { position_errors(m.model, estimate, d); }},
      {"registered", [&](const Measurements& d) { registered(m.model, estimate.errors, d); }},
      {"iso_9283", [&](const Measurements& d) { iso_9283(m.model, estimate, d); }},
      {"position_errors of poses", [&](const Measurements& d) { position_errors(X_BF, estimate, d); }},
      {"iso_9283 of poses", [&](const Measurements& d) { iso_9283(X_BF, estimate, d); }},
      {"LeastSquaresProblem", [&](const Measurements& d) { LeastSquaresProblem(m.model, d, m.free); }},
      {"estimate_noise", [&](const Measurements& d) { estimate_noise(m.model, d, estimate, m.free, {}); }},
      {"test_lack_of_fit", [&](const Measurements& d) { test_lack_of_fit(m.model, d, estimate, m.free); }},
      {"influence", [&](const Measurements& d) { influence(problem, d, {}, estimate, sqrt_information); }},
      {"pseudo_values", [&](const Measurements& d) { pseudo_values(m.model, d, estimate, Loss::huber, weights); }},
      {"cross_validate_nominal",
       [&](const Measurements& d) {
         cross_validate_nominal(m.model, d, {{0}, {1}});
       }},
      {"configurations_outside_limits", [&](const Measurements& d) { configurations_outside_limits(m.model, d); }},
      {"information", [&](const Measurements& d) { information(experiment, d); }},
      {"residuals_csv", [&](const Measurements& d) { residuals_csv(d, calibration); }},
      {"result_table", [&](const Measurements& d) { result_table(d, calibration); }},
      {"check_residuals", [&](const Measurements& d) { check_residuals(m.model, d, estimate); }},
      {"try_conventions", [&](const Measurements& d) { try_conventions(m.model, d, m.free); }},
      {"alternative_readings", [&](const Measurements& d) { alternative_readings(m.model, d, estimate, m.free); }},
      {"explained_by_joints", [&](const Measurements& d) { explained_by_joints(m.model, estimate, d); }},
  });
}

TEST(InputCheck, RefusesModelsWhosePartsAreNotThere) {
  ErrorModel beyond = sound().model;
  beyond.parameters[0].frame = 6;
  expect_refused(
      "joint", [&] { calibrate(beyond, sound().data); }, "the frame of a parameter 6 is not there");
  ErrorModel elastic = sound().model;
  elastic.effects = load_terms(elastic);
  elastic.effects[0].index = -1;
  expect_refused(
      "effect", [&] { check(elastic); }, "the joint of an effect -1 is not there");
  elastic.effects[0].index = 1;
  elastic.effects[0].scale = 0.0;
  expect_refused(
      "scale", [&] { check(elastic); }, "an effect has a value that is not finite");
}

TEST(InputCheck, RefusesDataOfAnotherRobot) {
  Measurements other = sound().data;
  other.joints[2] = "elbow";
  expect_refused(
      "names", [&] { check(other, sound().model); }, "another robot");
  Measurements shorter = sound().data;
  shorter.joints.resize(5);
  shorter.joint_units.clear();
  shorter.joint_values.conservativeResize(5, Eigen::NoChange);
  expect_refused(
      "rows", [&] { calibrate(sound().model, shorter); }, "5 joints, expected the robot's 6");
}

TEST(InputCheck, RefusesEstimatesAndParametersThatDoNotFit) {
  const Measured& m = sound();
  Estimate few = rigid_truth();
  few.errors.conservativeResize(3);
  expect_refused(
      "errors", [&] { identify_jointly(m.model, m.data, few, m.free); }, "3 errors of an estimate");
  Estimate one = rigid_truth();
  one.targets.resize(1);
  expect_refused(
      "targets", [&] { position_errors(m.model, one, m.data); }, "1 targets of an estimate");
  Estimate nan = rigid_truth();
  nan.errors[0] = kNaN;
  expect_refused(
      "nan", [&] { iso_9283(m.model, nan, m.data); }, "not finite");
  ErrorModel longer = m.model;
  longer.parameters.push_back(longer.parameters.back());
  longer.parameters.back().name += " again";
  const Unknowns beyond = m.free.with(longer, UnknownGroup::geometric, {m.model.parameters.size()});
  expect_refused(
      "free", [&] { identify_jointly(m.model, m.data, rigid_truth(), beyond); }, "the free geometric parameter");
  ErrorModel elastic = m.model;
  elastic.effects = load_terms(m.model);
  const Unknowns with_effect = m.free.with(elastic, UnknownGroup::effects, {0});
  expect_refused(
      "effect", [&] { identify_jointly(m.model, m.data, rigid_truth(), with_effect); },
      "the free effect 0 is not there");
  expect_refused(
      "corrections", [&] { origin_corrections(m.model, Eigen::VectorXd::Zero(2)); }, "2 errors");
}

TEST(InputCheck, RefusesSigmasAndPriorsThatAreNegativeOrNotFinite) {
  for (const double value : {-1.0, kNaN, std::numeric_limits<double>::infinity()}) {
    const std::vector<std::function<void(CalibrationSettings&)>> changes = {
        [&](CalibrationSettings& o) { o.selection.priors.length = value; },
        [&](CalibrationSettings& o) { o.selection.priors.angle = value; },
        [&](CalibrationSettings& o) { o.noise.stated.independent.y() = value; },
        [&](CalibrationSettings& o) { o.noise.stated.common.z() = value; },
        [&](CalibrationSettings& o) { o.noise.stated.orientation = value; },
        [&](CalibrationSettings& o) { o.noise.stated.misfit = value; },
        [&](CalibrationSettings& o) { o.noise.stated.target_misfit = value; },
        [&](CalibrationSettings& o) { o.noise.stated.tracker = TrackerNoise{.range = value}; }};
    for (std::size_t i = 0; i < changes.size(); ++i) {
      CalibrationSettings options;
      changes[i](options);
      expect_refused(
          std::to_string(i), [&] { calibrate(sound().model, sound().data, options); }, "0 or more");
    }
  }
  JointOptions weights;
  weights.residuals.row_weights = {1.0, 1.0};
  expect_refused(
      "weights", [&] { identify_jointly(sound().model, sound().data, rigid_truth(), sound().free, weights); },
      "2 weights of rows");
}

}  // namespace
}  // namespace kdl_calibration::input_check_test
