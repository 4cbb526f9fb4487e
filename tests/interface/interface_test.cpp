// The public interface against KDL, the installed file formats and its own promises.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/number_text.hpp"
#include "calibration/calibration_settings.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/kdl_calibration.hpp"
#include "refusal.hpp"
#include "support.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::interface_test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using testing::kdl_pose;
using testing::refusal;

const Robot& fanuc() {
  static const Robot robot = load_robot(URDF_DIR "/fanuc_r2000ic_165f.urdf");
  return robot;
}

// 30 configurations of a virtual robot, measured with 0.03 mm.
const SimulatedExperiment& experiment() {
  static const SimulatedExperiment made = simulate(fanuc(), {.noise = 3e-5, .length_error = 1e-3, .angle_error = 1e-3});
  return made;
}

const Calibration& found() {
  static const Calibration made = calibrate(fanuc(), experiment().measurements);
  return made;
}

Eigen::VectorXd somewhere() { return (Eigen::VectorXd(6) << 0.3, -0.2, 0.4, -0.5, 0.6, -0.7).finished(); }

// A file of its own in the folder for temporary ones, gone at the end.
class InterfaceFiles : public ::testing::Test {
protected:
  InterfaceFiles() { fs::create_directories(folder_); }
  ~InterfaceFiles() override { fs::remove_all(folder_); }
  fs::path file(const std::string& name) const { return folder_ / name; }
  static std::string text_of(const fs::path& path) {
    std::ifstream stream(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }

  // As a program of others writes it, whose results have no hashes and no verdict.
  static nlohmann::json without_hashes(const std::string& result) {
    nlohmann::json json = nlohmann::json::parse(result);
    for (const char* key : {"hashes", "software", "trusted", "doubts", "reservation"}) {
      json.erase(key);
    }
    return json;
  }

private:
  fs::path folder_ = fs::temp_directory_path() / ("interface_test_" + std::to_string(::getpid()));
};

// ---- Options -------------------------------------------------------------------------------------------------------

TEST(InterfaceOptions, PriorsAndEffectsAreChosenUnlessTheyAreStatedOrTheFitIsPlain) {
  struct Case {
    std::function<void(CalibrationOptions&)> state;
    bool priors;
    bool effects;
  };
  const std::vector<Case> cases = {
      {[](CalibrationOptions&) {}, true, true},
      {[](CalibrationOptions& o) { o.estimator.loss = Loss::huber; }, false, false},
      {[](CalibrationOptions& o) { o.estimator.method = Method::two_step; }, false, false},
      {[](CalibrationOptions& o) { o.parameters.model = ModelChoice::complete; }, false, false},
      {[](CalibrationOptions& o) { o.priors.stated.length = 1e-3; }, false, true},
      {[](CalibrationOptions& o) { o.priors.automatic = false; }, false, true},
      {[](CalibrationOptions& o) { o.effects.groups = {EffectGroup::gravity}; }, true, false},
      {[](CalibrationOptions& o) { o.effects.automatic = false; }, true, false},
      {[](CalibrationOptions& o) {
         o.estimator.loss = Loss::tukey;
         o.effects.automatic = true;
       },
       false, true},
  };
  for (std::size_t i = 0; i < cases.size(); ++i) {
    CalibrationOptions options;
    cases[i].state(options);
    const ModelSelectionOptions selection = settings_of(options).selection;
    EXPECT_EQ(selection.automatic_priors, cases[i].priors) << i;
    EXPECT_EQ(selection.effects.automatic, cases[i].effects) << i;
  }
}

TEST(InterfaceOptions, DirectionOfGravityMayHaveAnyLength) {
  CalibrationOptions options{.validation = {.held_out = false}, .diagnosis = {.try_readings = false}};
  options.effects.groups = {EffectGroup::gravity};
  const auto error_with = [&](double length) {
    options.effects.gravity_direction = Eigen::Vector3d(0.0, 0.0, -length);
    return calibrate(fanuc(), experiment().measurements, options).error("Tx1");
  };
  EXPECT_EQ(error_with(1.0), error_with(4.0));
  EXPECT_NEAR(error_with(1e200), error_with(1.0), 1e-12);  // its square is no number
}

// ---- What was found ------------------------------------------------------------------------------------------------

TEST(Interface, PredictsTheTrueRobotWithinTheRadius) {
  const CalibratedArm arm = found().arm();
  const CalibratedArm& truth = experiment().truth;
  ASSERT_EQ(arm.joints(), joint_names(fanuc()));
  ASSERT_EQ(arm.targets(), truth.targets());
  for (const std::string& target : arm.targets()) {
    const PredictedPoint there = arm.predict(somewhere(), target, PredictionFrame::measuring);
    const Eigen::Vector3d true_place = truth.predict(somewhere(), target, PredictionFrame::measuring).position;
    EXPECT_LT((there.position - true_place).norm(), there.radius_95);
    EXPECT_LT(there.radius_95, 3e-4);
    EXPECT_FALSE(there.outside);
    const PredictedPoint in_base = arm.predict(somewhere(), target);
    EXPECT_NEAR((arm.base() * in_base.position - there.position).norm(), 0.0, 1e-12);
    const Eigen::Matrix3d R_WB = arm.base().linear();
    EXPECT_LT((R_WB * in_base.covariance * R_WB.transpose() - there.covariance).norm(), 1e-9 * there.covariance.norm());
  }
  Eigen::VectorXd beyond = somewhere();
  beyond[1] = 3.0;
  EXPECT_TRUE(arm.predict(beyond, arm.targets().front()).outside);
  EXPECT_GT(beyond[1], arm.measured_ranges().at(1).second);
  EXPECT_EQ(arm.undetermined_motion(beyond), 0.0);
}

TEST(Interface, UncertaintyIsThatOfThePredictionsAskedForBeforeTheFit) {
  const Eigen::MatrixXd q = somewhere();
  const Calibration asked = calibrate(fanuc(), experiment().measurements,
                                      {.predict_at = {.names = {"here"}, .joint_values = q, .signals = {}}});
  for (const std::string& target : asked.arm().targets()) {
    EXPECT_EQ(asked.arm().predict(q, target).radius_95, found().arm().predict(q, target).radius_95);
  }
}

TEST(Interface, ChainIsThatOfTheExportedUrdf) {
  const KDL::Chain exported = parse_robot(calibrated_urdf(fanuc(), found())).chain;
  EXPECT_LT(testing::difference(kdl_pose(found().urdf_chain(), somewhere()), kdl_pose(exported, somewhere())), 1e-12);
}

TEST(Interface, JacobianIsTheDerivativeOfThePose) {
  const CalibratedArm arm = found().arm();
  Eigen::Matrix<double, 6, Eigen::Dynamic> jacobian;
  arm.flange_pose(somewhere(), jacobian);
  const Eigen::MatrixXd expected = testing::central_differences(6, 1e-6, [&](const Eigen::VectorXd& step) {
    return Eigen::VectorXd(arm.flange_pose(somewhere() + step).translation());
  });
  EXPECT_LT((jacobian.topRows<3>() - expected).colwise().norm().maxCoeff(), 1e-8);
}

TEST(Interface, ParametersHaveNames) {
  const std::vector<std::string> names = found().estimated();
  ASSERT_EQ(found().covariance().rows(), static_cast<Eigen::Index>(names.size()));
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto column = static_cast<Eigen::Index>(i);
    const bool motion = names[i].rfind("base.", 0) == 0;  // its columns are motions of the base in its own frame
    if (!motion) {
      EXPECT_NEAR(found().std(names[i]), std::sqrt(found().covariance()(column, column)), 1e-12) << names[i];
    }
  }
}

TEST(Interface, ValidatesWithAndWithoutTheErrors) {
  const double nominal = validate(fanuc(), experiment().measurements).all.rms;
  const double calibrated = validate(found(), experiment().measurements).all.rms;
  EXPECT_GT(nominal, 1e-3);
  EXPECT_LT(calibrated, 6e-5);
  const Robot corrected = parse_robot(calibrated_urdf(fanuc(), found()));
  EXPECT_NEAR(validate(corrected, experiment().measurements).all.rms, calibrated, 1e-6);
}

// The nominal arm against robots whose true error 200 configurations show. Of three configurations base and targets
// hide all: their corrected rms is a twentieth of the true one on average.
TEST(Interface, ValidationLimitsTheTrueErrorByFewConfigurations) {
  constexpr int kRobots = 60;
  testing::VirtualExperiment robots;
  const auto validated = [&](int count) {
    return validate(fanuc(), robots.measure(count, {.sigma = 3e-5}), {}, {.try_readings = false});
  };
  EXPECT_TRUE(std::isinf(validated(3).upper_95_factor));
  for (const int count : {4, 6, 10, 20}) {
    int inside = 0;
    for (std::uint64_t seed = 0; seed < kRobots; ++seed) {
      robots.restart(Random(11, seed));
      const PositionErrors few = validated(count);
      inside += few.all.rms * few.upper_95_factor > validated(200).rms_corrected ? 1 : 0;
    }
    std::cout << count << " configurations: " << inside << " of " << kRobots << " inside\n";
    EXPECT_GE(inside, 0.9 * kRobots) << count;
  }
}

TEST(Interface, ValidationDoubtsDataThatAnotherReadingExplains) {
  const PositionErrors right = validate(fanuc(), experiment().measurements);
  EXPECT_TRUE(right.doubts.empty()) << right.doubts.front().message;
  EXPECT_EQ(right.registered, "base and targets");
  EXPECT_EQ(right.unknowns, 6 + 3 * static_cast<int>(right.frames.targets.size()));
  EXPECT_GT(right.rms_corrected, right.train.rms);
  Measurements mirrored = experiment().measurements;
  for (Observation& row : mirrored.observations) {
    row.position().y() *= -1.0;
  }
  const auto causes = [&](bool try_readings) {
    std::vector<Cause> result;
    for (const Doubt& doubt : validate(fanuc(), mirrored, {}, {.try_readings = try_readings}).doubts) {
      result.push_back(doubt.cause);
    }
    return result;
  };
  EXPECT_THAT(causes(true), ::testing::Contains(Cause::mirrored));
  EXPECT_THAT(causes(false), ::testing::Not(::testing::Contains(Cause::mirrored)));
}

TEST(Interface, PlansWithinTheLimitsThatAreAsked) {
  const MeasuringPlan plan = plan_measurements(fanuc(), {.count = 15, .least_height = 0.3});
  EXPECT_EQ(plan.joint_values.cols(), 15);
  EXPECT_GT(plan.predicted_mean, 0.0);
  EXPECT_LE(plan.predicted_mean, plan.predicted_max);
  for (const auto& q : plan.joint_values.colwise()) {
    EXPECT_GE((kdl_pose(fanuc().chain, q) * KDL::Vector(0.1, 0.0, 0.0)).z(), 0.3);
  }
  EXPECT_THAT(plan_csv(plan, fanuc().joints), HasSubstr("joint_1[deg]"));
}

// Base and targets are new: the zeros of the first and the last joint cannot show.
TEST(Interface, PlansFewConfigurationsAfterACalibration) {
  const MeasuringPlan plan = plan_measurements(fanuc(), {.after = &found(), .suspect = {"joint_2", "joint_6"}});
  EXPECT_EQ(plan.joint_values.cols(), 8);
  EXPECT_EQ(plan.targets, found().arm().targets());
  ASSERT_EQ(plan.warnings.size(), 1U);
  EXPECT_THAT(plan.warnings[0], HasSubstr("zero of joint_6 cannot show"));
  EXPECT_LT(plan.predicted_mean, plan_measurements(fanuc(), {.noise = 3e-4, .after = &found()}).predicted_mean);
  EXPECT_TRUE(plan_measurements(fanuc(), {.count = 12, .after = &found()}).warnings.empty());
}

// ---- Files ---------------------------------------------------------------------------------------------------------

TEST_F(InterfaceFiles, ResultReadBackPredictsTheSame) {
  write_result(file("result.json"), fanuc(), experiment().measurements, found());
  const Calibration again = load_calibration(file("result.json"), fanuc());
  EXPECT_EQ(again.verdict(), found().verdict());
  EXPECT_EQ(again.warnings(), found().warnings());
  EXPECT_EQ(messages_of(again.remarks()), again.warnings());
  EXPECT_EQ(again.accuracy().held_out()->after.rms, found().accuracy().held_out()->after.rms);
  EXPECT_EQ(again.accuracy().iso_after.accuracy.max, found().accuracy().iso_after.accuracy.max);
  ASSERT_EQ(again.parameters().size(), found().parameters().size());
  for (const ParameterEstimate& parameter : found().parameters()) {
    EXPECT_EQ(again.std(parameter.name), parameter.std) << parameter.name;
    EXPECT_EQ(again.parameter(parameter.name).degrees_of_freedom, parameter.degrees_of_freedom) << parameter.name;
    EXPECT_EQ(again.parameter(parameter.name).kind, parameter.kind) << parameter.name;
  }
  EXPECT_EQ(calibrated_urdf(fanuc(), again), calibrated_urdf(fanuc(), found()));
  for (const std::string& target : found().arm().targets()) {
    for (const double reach : {1.0, 4.0}) {
      const Eigen::VectorXd q = reach * somewhere();
      const PredictedPoint before = found().arm().predict(q, target);
      const PredictedPoint after = again.arm().predict(q, target);
      EXPECT_NEAR((after.position - before.position).norm(), 0.0, 1e-12);
      EXPECT_NEAR(after.radius_95 / before.radius_95, 1.0, 1e-9);
      EXPECT_EQ(after.outside, before.outside);
    }
  }
}

// As a result of more than 300 parameters is written.
TEST_F(InterfaceFiles, ResultWithoutCovarianceGivesNoRadius) {
  write_result(file("large.json"), fanuc(), experiment().measurements, found());
  nlohmann::json large = without_hashes(text_of(file("large.json")));
  large["covariance"] = nullptr;
  std::ofstream(file("without.json")) << large;
  const CalibratedArm again = load_calibration(file("without.json"), fanuc()).arm();
  EXPECT_GT(found().arm().predict(somewhere(), "A").covariance.trace(), 0.0);
  EXPECT_LT((again.flange_pose(somewhere()).matrix() - found().arm().flange_pose(somewhere()).matrix()).norm(), 1e-12);
  EXPECT_THAT(refusal([&] { again.predict(somewhere(), "A"); }), HasSubstr("at most 300 parameters"));
}

// A file has their names, not their functions.
TEST_F(InterfaceFiles, ResultsWithEffectsOfTheCallersOwnAreReadWithThem) {
  const OwnEffect bend{.name = "bend", .joint = "joint_2", .columns = [](const Eigen::MatrixXd& q) {
                         return Eigen::MatrixXd((q.row(1).array() * q.row(2).array()).matrix().transpose());
                       }};
  const CalibrationOptions options{.priors = {.automatic = false},
                                   .effects = {.automatic = false, .own = {bend}},
                                   .diagnosis = {.try_readings = false}};
  const Measurements& data = experiment().measurements;
  const Calibration with = calibrate(fanuc(), data, options);
  write_result(file("r.json"), fanuc(), data, with);
  write_report(file("r.html"), fanuc(), data, with);
  EXPECT_THAT(text_of(file("r.html")), HasSubstr("own.bend"));
  const Calibration again = load_calibration(file("r.json"), fanuc(), {bend});
  const PredictedPoint before = with.arm().predict(somewhere(), "B");
  const PredictedPoint after = again.arm().predict(somewhere(), "B");
  EXPECT_LT((after.position - before.position).norm(), 1e-12);
  EXPECT_NEAR(after.radius_95 / before.radius_95, 1.0, 1e-9);
  EXPECT_THAT(refusal([&] { load_calibration(file("r.json"), fanuc()); }),
              HasSubstr("'bend' is a function of the program that fitted it"));

  // One of the same name that is another: by its values, its joint or its axis.
  const auto refused = [&](OwnEffect other) {
    return refusal([&] { load_calibration(file("r.json"), fanuc(), {std::move(other)}); });
  };
  OwnEffect larger = bend;
  larger.columns = [&](const Eigen::MatrixXd& q) { return Eigen::MatrixXd(1.001 * bend.columns(q)); };
  const Eigen::ArrayXd raw = bend.columns(data.joint_values).array();
  EXPECT_THAT(refused(larger), HasSubstr("terms[0]: function: checks["));
  OwnEffect lower_there = bend;
  lower_there.columns = [&](const Eigen::MatrixXd& q) {
    return Eigen::MatrixXd(bend.columns(q).cwiseMin(raw.maxCoeff() - 1e-3));
  };
  EXPECT_THAT(refused(lower_there),
              HasSubstr("the given function 'bend' is " + shortest(raw.maxCoeff() - 1e-3) + " there, expected " +
                        shortest(raw.maxCoeff()) + " as when it was fitted"));
  OwnEffect elsewhere = bend;
  elsewhere.joint = "joint_3";
  EXPECT_THAT(refused(elsewhere), HasSubstr("expected a result in which 'bend' moves joint_3 about 'own'"));
  OwnEffect across = bend;
  across.axis = EffectAxis::across_y;
  EXPECT_THAT(refused(across), HasSubstr("'bend' moves joint_2 about 'y'"));
}

// Values that no calibration has, in a file that no hashes protect.
TEST_F(InterfaceFiles, ImpossibleValuesOfAResultAreRefused) {
  write_result(file("r.json"), fanuc(), experiment().measurements, found());
  const nlohmann::json good = without_hashes(text_of(file("r.json")));
  const auto refused = [&](const std::vector<std::pair<std::string, nlohmann::json>>& changes) {
    nlohmann::json bad = good;
    for (const auto& [path, value] : changes) {
      bad.at(nlohmann::json::json_pointer(path)) = value;
    }
    std::ofstream(file("bad.json")) << bad;
    return refusal([&] { load_calibration(file("bad.json"), fanuc()); });
  };
  EXPECT_EQ(refused({}), "nothing was refused");
  EXPECT_THAT(refused({{"/predicted_accuracy/radius_factor", -1.0}}),
              HasSubstr("radius_factor: expected a number of 0"));
  EXPECT_THAT(refused({{"/predicted_accuracy/region/largest_variance", -1.0}}),
              HasSubstr("largest_variance: expected"));
  EXPECT_THAT(refused({{"/predicted_accuracy/region/unproved", -1.0}}), HasSubstr("unproved: expected"));
  EXPECT_THAT(refused({{"/predicted_accuracy/region/joints/2/0", 100.0}}), HasSubstr("the lower end first"));
  EXPECT_THAT(refused({{"/noise/misfit", -1e-3}}), HasSubstr("misfit"));
  EXPECT_THAT(refused({{"/noise/degrees_of_freedom_of_point", -3.0}}),
              HasSubstr("degrees_of_freedom_of_point: expected"));
  EXPECT_THAT(refused({{"/covariance/matrix/4/4", -1.0}}), HasSubstr("expected a variance"));
  EXPECT_THAT(refused({{"/covariance/matrix/4/3", 1.0}, {"/covariance/matrix/3/4", 1.0}}),
              HasSubstr("expected covariances within the variances"));
}

TEST_F(InterfaceFiles, LinksAndModesStayAndNothingElseThanAFileIsReplaced) {
  std::ofstream(file("old.urdf")) << "old";
  fs::permissions(file("old.urdf"), fs::perms::owner_read | fs::perms::owner_write);
  fs::create_symlink(file("old.urdf"), file("link.urdf"));
  write_urdf(file("link.urdf"), fanuc(), found());
  EXPECT_TRUE(fs::is_symlink(file("link.urdf")));
  EXPECT_EQ(text_of(file("old.urdf")), calibrated_urdf(fanuc(), found()));
  EXPECT_EQ(fs::status(file("old.urdf")).permissions(), fs::perms::owner_read | fs::perms::owner_write);
  ASSERT_EQ(::mkfifo(file("pipe").c_str(), 0600), 0);
  EXPECT_THAT(refusal([&] { write_urdf(file("pipe"), fanuc(), found()); }), HasSubstr("no regular file"));
  EXPECT_TRUE(fs::is_fifo(file("pipe")));
}

TEST_F(InterfaceFiles, UndeterminedDirectionsAreReadBack) {
  Measurements still = experiment().measurements;
  still.joint_values.row(3).setConstant(0.2);
  const SimulatedExperiment& whole = experiment();
  const CalibrationOptions geometry{
      .priors = {.automatic = false}, .effects = {.automatic = false}, .diagnosis = {.try_readings = false}};
  // The true arm at these configurations.
  for (Observation& row : still.observations) {
    row.position() = whole.truth
                         .predict(still.joint_values.col(row.configuration),
                                  still.targets[static_cast<std::size_t>(row.target)], PredictionFrame::measuring)
                         .position;
  }
  const Calibration open = calibrate(fanuc(), still, geometry);
  write_result(file("open.json"), fanuc(), still, open);
  const Calibration again = load_calibration(file("open.json"), fanuc());
  Eigen::VectorXd elsewhere = somewhere();
  EXPECT_EQ(again.arm().predict(elsewhere, "A").radius_95, std::numeric_limits<double>::infinity());
  EXPECT_EQ(open.arm().predict(elsewhere, "A").radius_95, std::numeric_limits<double>::infinity());
  elsewhere[3] = 0.2;
  EXPECT_LT(again.arm().predict(elsewhere, "A").radius_95, 1e-3);
}

TEST_F(InterfaceFiles, ExportsReplaceWholeFilesButNeverTheOneThatWasRead) {
  write_urdf(file("calibrated.urdf"), fanuc(), found());
  EXPECT_EQ(text_of(file("calibrated.urdf")), calibrated_urdf(fanuc(), found()));
  write_urdf(file("calibrated.urdf"), fanuc(), found());
  write_report(file("report.html"), fanuc(), experiment().measurements, found());
  EXPECT_THAT(text_of(file("report.html")), HasSubstr("<html"));
  std::ofstream(file("own.urdf")) << fanuc().urdf;
  const Robot own = load_robot(file("own.urdf"));
  const Calibration of_own = calibrate(own, experiment().measurements, {.diagnosis = {.try_readings = false}});
  EXPECT_THAT(refusal([&] { write_urdf(file("own.urdf"), own, of_own); }),
              HasSubstr("is the file that this calibration reads"));
  EXPECT_EQ(text_of(file("own.urdf")), fanuc().urdf);
  EXPECT_THAT(refusal([&] { write_urdf(file("none/calibrated.urdf"), fanuc(), found()); }),
              HasSubstr("is no directory that exists"));
  EXPECT_EQ(std::distance(fs::directory_iterator(file("")), fs::directory_iterator()), 3);
}

// ---- The door ------------------------------------------------------------------------------------------------------

TEST_F(InterfaceFiles, EveryFunctionRefusesWhatDoesNotFit) {
  const Calibration& c = found();
  const CalibratedArm arm = c.arm();
  const Measurements& data = experiment().measurements;
  write_result(file("r.json"), fanuc(), data, c);
  const Calibration read = load_calibration(file("r.json"), fanuc());
  Robot other = fanuc();
  other.urdf += " ";
  Measurements fewer = data;
  fewer.joint_values.conservativeResize(5, Eigen::NoChange);
  Measurements beyond = data;
  beyond.observations.front().configuration = 99;
  Measurements unknown = data;
  unknown.observations.front().position().x() = std::numeric_limits<double>::quiet_NaN();
  Measurements shifted = data;
  shifted.observations.back().position().z() += 1e-3;
  Eigen::VectorXd nan = somewhere();
  nan[2] = std::numeric_limits<double>::quiet_NaN();
  Eigen::Matrix<double, 6, Eigen::Dynamic> jacobian;
  Measurements twins = data;
  twins.targets[1] = twins.targets[0];
  Measurements nameless = data;
  nameless.targets[0].clear();
  Measurements one_label = data;
  one_label.configurations[1] = one_label.configurations[0];
  CalibrationOptions misspelt;
  misspelt.parameters.known.targets = {{.name = "a"}};
  CalibrationOptions no_group;
  no_group.effects.groups = {static_cast<EffectGroup>(99)};
  CalibrationOptions endless;
  endless.estimator.iterations = std::numeric_limits<int>::max();
  Robot bent = fanuc();
  bent.joints[1].origin.p.x(0.5);
  std::string text = fanuc().urdf;
  const std::string third = R"(<joint name="joint_3" type="revolute">)";
  text.insert(text.find(third) + third.size(), R"(<mimic joint="joint_2"/>)");
  const CalibratedArm lead = simulate(parse_robot(text)).truth;
  const JointConvention flat{.name = "flat",
                             .controller_joints = {"J1", "J2", "J3", "J4", "J5", "J6"},
                             .urdf_joints = joint_names(fanuc()),
                             .matrix = Eigen::MatrixXd::Zero(6, 6),
                             .offset = Eigen::VectorXd::Zero(6)};
  TargetFrame nowhere_at_all{.name = "A"};
  nowhere_at_all.X_FT.translation().x() = std::numeric_limits<double>::quiet_NaN();
  TargetFrame far_away{.name = "A"};
  far_away.X_FT.translation().x() = 1e154;
  std::vector<TargetFrame> crowd;
  Measurements crowded = data;
  Measurements roaming = data;
  for (int i = 0; i < 101; ++i) {
    crowd.push_back({.name = "T" + std::to_string(i)});
    crowded.targets.push_back(crowd.back().name);
    roaming.stations.push_back(crowd.back().name);
  }
  Measurements mixed = data;
  mixed.observations[1].split = mixed.observations[0].split == Split::test ? Split::train : Split::test;
  Measurements fine = data;
  fine.observations[2].sigma = 1e-20;
  Measurements before_all = data;
  before_all.observations[2].repeat = -1;
  CalibrationOptions group_twice;
  group_twice.effects.groups = {EffectGroup::gain, EffectGroup::gravity, EffectGroup::gain};
  const JointConvention none;
  const std::string with_nul("r.json\0.json", 12);
  const MeasuringPlan no_plan;
  const Measurements early = subset(data, [](const Observation& o) { return o.configuration < 4; });
  const Measurements first = subset(data, [](const Observation& o) { return o.configuration == 0; });
  const std::vector<TargetFrame> both_a = {{.name = "A"}, {.name = "A"}};
  const JointRanges of_one = {{0.0, 1.0}};
  JointRanges reversed(6, {-1.0, 1.0});
  reversed[2] = {1.0, -1.0};
  JointRanges endless_range(6, {-1.0, 1.0});
  endless_range[3].second = std::numeric_limits<double>::infinity();
  CalibrationOptions both;
  both.effects = {.groups = {EffectGroup::gain}, .automatic = true};
  CalibrationOptions nowhere;
  nowhere.effects.gravity_direction.setZero();
  Eigen::Isometry3d sheared = Eigen::Isometry3d::Identity();
  sheared.linear()(0, 1) = 0.5;
  CalibrationOptions leaning;
  leaning.parameters.known.bases = {{.X_WB = sheared}};
  struct Case {
    const char* name;
    std::function<void()> call;
    const char* words;
  };
  const OwnColumns still = [](const Eigen::MatrixXd& q) { return Eigen::MatrixXd(Eigen::MatrixXd::Ones(q.cols(), 1)); };
  const auto own_effect = [](const std::string& name, const OwnColumns& columns) {
    const OwnEffect effect{.name = name, .joint = "joint_2", .columns = columns};
    return CalibrationOptions{.effects = {.automatic = false, .own = {effect}}, .diagnosis = {.try_readings = false}};
  };
  CalibrationOptions twice = own_effect("a", still);
  twice.effects.own.push_back(twice.effects.own.front());
  const std::vector<Case> cases = {
      {"calibration of nothing", [] { Calibration(nullptr); }, "calibration of nothing"},
      {"arm of nothing", [] { CalibratedArm(nullptr); }, "arm of nothing"},
      {"calibrate, joints", [&] { calibrate(fanuc(), fewer); }, "6 names of joints"},
      {"calibrate, rows", [&] { calibrate(fanuc(), beyond); }, "configuration"},
      {"calibrate, numbers", [&] { calibrate(fanuc(), unknown); }, "finite"},
      {"calibrate, default", [&] { calibrate(fanuc(), Measurements()); }, "expected"},
      {"calibrate, effects", [&] { calibrate(fanuc(), data, both); }, "named and to be chosen"},
      {"calibrate, gravity", [&] { calibrate(fanuc(), data, nowhere); }, "not all 0"},
      {"calibrate, rotation", [&] { calibrate(fanuc(), data, leaning); }, "rotation"},
      {"calibrate, twins", [&] { calibrate(fanuc(), twins); }, "names that differ"},
      {"calibrate, nameless", [&] { calibrate(fanuc(), nameless); }, "is empty"},
      {"calibrate, misspelt", [&] { calibrate(fanuc(), data, misspelt); }, "none of the known targets"},
      {"calibrate, group", [&] { calibrate(fanuc(), data, no_group); }, "group of effects 99"},
      {"calibrate, iterations", [&] { calibrate(fanuc(), data, endless); }, "1000000"},
      {"calibrate, edited robot", [&] { calibrate(bent, data); }, "not those of its URDF text"},
      {"load, edited robot", [&] { load_calibration(file("r.json"), bent); }, "not those of its URDF text"},
      {"flange_pose, follower", [&] { lead.flange_pose(somewhere()); }, "'joint_3'"},
      {"measurements_csv", [&] { measurements_csv(one_label); }, "there twice"},
      {"parse, convention", [&] { parse_measurements(fanuc(), "configuration,target,J1,x,y,z\n", &flat); }, "rank"},
      {"plan_csv, joints", [&] { plan_csv({.joint_values = Eigen::MatrixXd(5, 0)}, fanuc().joints); }, "joint values"},
      {"error_chain", [&] { error_chain(complete_model(fanuc()), nan); }, "errors"},
      {"calibrate, default robot", [&] { calibrate(Robot(), data); }, "expected a URDF"},
      {"flange_pose, count", [&] { arm.flange_pose(somewhere().head(5)); }, "5 joint values"},
      {"flange_pose, numbers", [&] { arm.flange_pose(nan, jacobian); }, "finite"},
      {"predict, target", [&] { arm.predict(somewhere(), "Z"); }, "target 'Z'"},
      {"predict, numbers", [&] { arm.predict(nan, "A"); }, "finite"},
      {"undetermined_motion, numbers", [&] { arm.undetermined_motion(nan); }, "finite"},
      {"parameter", [&] { c.std("Tx99"); }, "'Tx99'"},
      {"another robot's URDF", [&] { calibrated_urdf(other, c); }, "was not made with"},
      {"another robot's export", [&] { kinematic_export(other, c, KinematicFormat::mdh); }, "was not made with"},
      {"a format that is none", [&] { kinematic_export(fanuc(), c, KinematicFormat{77}); }, "one of KinematicFormat"},
      {"no Universal Robot", [&] { ur_calibrated_urdf(fanuc(), ""); }, "is no Universal Robot"},
      {"no DH table", [&] { load_dh_robot(file("none.csv")); }, "none.csv"},
      {"another robot's file", [&] { write_urdf(file("x"), other, c); }, "was not made with"},
      {"another robot's result", [&] { write_result(file("x"), other, data, c); }, "was not made with"},
      {"another robot's page", [&] { write_report(file("x"), other, data, c); }, "was not made with"},
      {"result of a file", [&] { write_result(file("x"), fanuc(), data, read); }, "read from a file"},
      {"other measurements", [&] { write_result(file("x"), fanuc(), fewer, c); }, "other measurements"},
      {"a part of them", [&] { write_report(file("x"), fanuc(), early, c); }, "other measurements"},
      {"other points", [&] { write_result(file("x"), fanuc(), shifted, c); }, "other measurements"},
      {"load, robot", [&] { load_calibration(file("r.json"), other); }, "hash"},
      {"load, none", [&] { load_calibration(file("none.json"), fanuc()); }, "cannot be opened"},
      {"validate", [&] { validate(fanuc(), fewer); }, "6 names of joints"},
      {"validate, calibration", [&] { validate(c, beyond); }, "configuration"},
      {"validate, frames", [&] { validate(fanuc(), data, {.bases = {{.X_WB = sheared}}}); }, "rotation"},
      {"validate, few", [&] { validate(fanuc(), first); }, "nothing is left to show an error"},
      {"simulate, count", [] { simulate(fanuc(), {.configurations = 0}); }, "configurations"},
      {"simulate, noise", [] { simulate(fanuc(), {.noise = -1.0}); }, "noise"},
      {"simulate, ranges", [&] { simulate(fanuc(), {.ranges = of_one}); }, "range"},
      {"simulate, reversed", [&] { simulate(fanuc(), {.ranges = reversed}); }, "lower end first"},
      {"simulate, endless", [&] { simulate(fanuc(), {.ranges = endless_range}); }, "finite"},
      {"simulate, many", [] { simulate(fanuc(), {.configurations = 2'000'000'000}); }, "10000000 rows"},
      {"plan, many", [] { plan_measurements(fanuc(), {.count = 2'000'000'000}); }, "at most 2000"},
      {"plan, target", [&] { plan_measurements(fanuc(), {.targets = {nowhere_at_all}}); }, "target 'A'"},
      {"simulate, twins", [&] { simulate(fanuc(), {.targets = both_a}); }, "'A'"},
      {"plan, count", [] { plan_measurements(fanuc(), {.count = 0}); }, "configurations"},
      {"plan, noise", [] { plan_measurements(fanuc(), {.noise = std::numeric_limits<double>::infinity()}); }, "noise"},
      {"plan, ranges", [&] { plan_measurements(fanuc(), {.ranges = of_one}); }, "range"},
      {"plan, far target", [&] { plan_measurements(fanuc(), {.targets = {far_away}}); }, "up to 1e12 m"},
      {"plan, crowd", [&] { plan_measurements(fanuc(), {.targets = crowd}); }, "101 targets, expected at most 100"},
      {"plan, nameless", [&] { plan_measurements(fanuc(), {.targets = {TargetFrame{}}}); }, "a name for each"},
      {"plan, small noise", [] { plan_measurements(fanuc(), {.noise = 1e-300}); }, "from 1e-15 to 1e12 m"},
      {"plan, large noise", [] { plan_measurements(fanuc(), {.noise = 1e200}); }, "from 1e-15 to 1e12 m"},
      {"plan, default robot", [] { plan_measurements(Robot()); }, "without moving joints"},
      {"simulate, far target", [&] { simulate(fanuc(), {.targets = {far_away}}); }, "up to 1e12 m"},
      {"simulate, crowd", [&] { simulate(fanuc(), {.targets = crowd}); }, "101 targets, expected at most 100"},
      {"simulate, large noise", [] { simulate(fanuc(), {.noise = 1e300}); }, "at most 1e12"},
      {"simulate, far range",
       [] {
         simulate(fanuc(), {.ranges = JointRanges(6, {-1e300, 1.0})});
       },
       "within 1e12"},
      {"simulate, default robot", [] { simulate(Robot()); }, "without moving joints"},
      {"model, default robot", [] { complete_model(Robot()); }, "without moving joints"},
      {"validate, default robot", [&] { validate(Robot(), data); }, "without moving joints"},
      {"parse, default robot", [] { parse_measurements(Robot(), "configuration\n"); }, "0 moving joints"},
      {"configurations, no joints", [] { parse_configurations("1\n", std::vector<std::string>()); }, "0 moving joints"},
      {"load, default robot", [&] { load_calibration(file("r.json"), Robot()); }, "the robot is empty"},
      {"urdf, default robot", [&] { calibrated_urdf(Robot(), c); }, "the robot is empty"},
      {"calibrate, mixed", [&] { calibrate(fanuc(), mixed); },
       "has train and test rows (observation 1), expected one of both"},
      {"validate, mixed", [&] { validate(fanuc(), mixed); }, "has train and test rows"},
      {"calibrate, fine", [&] { calibrate(fanuc(), fine); }, "observation 2: a sigma of 1e-20 m, expected at least"},
      {"validate, fine", [&] { validate(c, fine); }, "observation 2: a sigma of 1e-20 m"},
      {"calibrate, repeat", [&] { calibrate(fanuc(), before_all); }, "observation 2: repeat -1, expected 0 or more"},
      {"calibrate, group twice", [&] { calibrate(fanuc(), data, group_twice); }, "gain is named twice"},
      {"calibrate, crowd", [&] { calibrate(fanuc(), crowded); }, "targets, expected at most 100"},
      {"calibrate, stations", [&] { calibrate(fanuc(), roaming); }, "102 stations, expected at most 100"},
      {"validate, crowd", [&] { validate(fanuc(), crowded); }, "targets, expected at most 100"},
      {"validate, stations", [&] { validate(c, roaming); }, "102 stations, expected at most 100"},
      {"measurements_csv, crowd", [&] { measurements_csv(crowded); }, "targets, expected at most 100"},
      {"calibrate, convention", [&] { calibrate(fanuc(), data, {.diagnosis = {.convention = none}}); }, "0 joints"},
      {"calibrate, another", [&] { calibrate(fanuc(), data, {.diagnosis = {.other_conventions = {none}}}); },
       "0 joints"},
      {"calibrate, flat", [&] { calibrate(fanuc(), data, {.diagnosis = {.other_conventions = {flat}}}); }, "rank"},
      {"validate, convention", [&] { validate(fanuc(), data, {}, {.convention = none}); }, "0 joints"},
      {"matched_convention", [&] { matched_convention(none, {}); }, "0 joints of a convention, expected at least 1"},
      {"measurements_csv, convention", [&] { measurements_csv(fanuc(), data, none); }, "0 joints"},
      {"plan_csv, convention", [&] { plan_csv(no_plan, {}, &none); }, "0 joints"},
      {"robot, NUL", [&] { load_robot(with_nul); }, "r.json\\x00.json: has a NUL byte in its name"},
      {"measurements, NUL", [&] { read_measurements(fanuc(), file(with_nul)); }, "has a NUL byte in its name"},
      {"load, NUL", [&] { load_calibration(file(with_nul), fanuc()); }, "has a NUL byte in its name"},
      {"write, NUL", [&] { write_result(file(with_nul), fanuc(), data, c); }, "has a NUL byte, expected a file name"},
      {"calibrate, nameless effect", [&] { calibrate(fanuc(), data, own_effect("", still)); }, "'' is not accepted"},
      {"calibrate, two words", [&] { calibrate(fanuc(), data, own_effect("a b", still)); }, "'a b' is not accepted"},
      {"calibrate, no function", [&] { calibrate(fanuc(), data, own_effect("a", {})); }, "a has no function"},
      {"calibrate, still", [&] { calibrate(fanuc(), data, own_effect("a", still)); }, "the same at all configurations"},
      {"calibrate, twin effects", [&] { calibrate(fanuc(), data, twice); }, "a is given twice"},
      {"calibrate, own group", [&] { calibrate(fanuc(), data, {.effects = {.groups = {EffectGroup::own}}}); },
       "group of effects"},
      {"plan, other robot", [&] { plan_measurements(other, {.after = &c}); }, "was not made with"},
      {"plan, suspect", [&] { plan_measurements(fanuc(), {.after = &c, .suspect = {"joint_9"}}); },
       "has no joint 'joint_9', expected some of joint_1, joint_2"},
      {"plan, suspect alone", [&] { plan_measurements(fanuc(), {.suspect = {"joint_3"}}); }, "nothing is known"},
      {"plan, height", [] { plan_measurements(fanuc(), {.least_height = 100.0}); }, "height"},
  };
  for (const Case& each : cases) {
    EXPECT_THAT(refusal(each.call), HasSubstr(each.words)) << each.name;
  }
  EXPECT_STREQ(to_string(static_cast<Cause>(99)), "unknown");
  EXPECT_FALSE(fs::exists(file("x")));
}

// Whatever a fit reads: a result refuses other measurements by this hash.
TEST(Interface, MeasurementsThatDifferInAnythingHaveOtherHashes) {
  Measurements all = testing::one_of_each();
  all.signals = {.approach = Eigen::RowVector3d(1.0, -1.0, 1.0), .torques = Eigen::RowVector3d(5.0, 6.0, 7.0)};
  const std::vector<std::function<void(Measurements&)>> changes = {
      [](Measurements&) {},
      [](Measurements& m) { m.observations[0].position().y() += 1e-12; },
      [](Measurements& m) { m.observations[1].position().y() += 1e-12; },
      [](Measurements& m) { m.observations[2].position().y() += 1e-12; },
      [](Measurements& m) { m.observations[4].position().y() += 1e-12; },
      [](Measurements& m) { std::get<Pose>(m.observations[0].reading).orientation.x() += 1e-12; },
      [](Measurements& m) { testing::remove_orientation(m.observations[0]); },
      [](Measurements& m) { testing::set_orientation(m.observations[1], Orientation::Identity()); },
      [](Measurements& m) { std::get<Coordinates>(m.observations[2].reading).normal.x() += 1e-12; },
      [](Measurements& m) { std::get<Coordinates>(m.observations[2].reading).count = 2; },
      [](Measurements& m) { std::get<Distance>(m.observations[4].reading).length += 1e-12; },
      [](Measurements& m) { m.observations[3].sigma = 0.0; },
      [](Measurements& m) { m.observations[3].order = 6; },
      [](Measurements& m) { m.observations[3].order.reset(); },
      [](Measurements& m) { m.observations[3].order = 0; },
      [](Measurements& m) { m.observations[3].configuration = 0; },
      [](Measurements& m) { m.observations[3].target = 3; },
      [](Measurements& m) { m.observations[3].repeat = 1; },
      [](Measurements& m) { m.observations[3].split = Split::test; },
      [](Measurements& m) { m.observations[3].station = 1; },
      [](Measurements& m) { m.observations.pop_back(); },
      [](Measurements& m) { std::swap(m.observations[0], m.observations[1]); },
      [](Measurements& m) { m.joint_values(0, 1) += 1e-12; },
      [](Measurements& m) { m.signals.approach(0, 1) = 1.0; },
      [](Measurements& m) { m.signals.torques(0, 1) += 1e-12; },
      [](Measurements& m) { m.signals.torques.resize(0, 0); },
      [](Measurements& m) { std::swap(m.signals.torques, m.signals.approach); },
      [](Measurements& m) { m.joints[0] = "q2"; },
      [](Measurements& m) { m.configurations[2] = "s"; },
      [](Measurements& m) { m.targets[2] = "E"; },
      [](Measurements& m) { m.targets[0] += std::exchange(m.targets[1], ""); },
      [](Measurements& m) { m.stations[1] = "behind"; }};
  std::set<std::string> hashes;
  for (std::size_t i = 0; i < changes.size(); ++i) {
    Measurements changed = all;
    changes[i](changed);
    EXPECT_TRUE(hashes.insert(hash_of(changed)).second) << "change " << i;
  }
  Measurements renamed = all;
  renamed.source = "other.csv";
  renamed.remark = "read otherwise";
  EXPECT_EQ(hash_of(renamed), hash_of(all)) << "the same rows";
}

TEST(Interface, WhatWasMovedFromIsStillWhole) {
  Calibration first = found();
  const Calibration second = std::move(first);
  CalibratedArm arm = second.arm();
  const CalibratedArm moved = std::move(arm);
  EXPECT_EQ(first.error("Tx1"), second.error("Tx1"));  // NOLINT(bugprone-use-after-move): what is tested
  EXPECT_EQ(arm.targets(), moved.targets());           // NOLINT(bugprone-use-after-move)
}

}  // namespace
}  // namespace kdl_calibration::interface_test
