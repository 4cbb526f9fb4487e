#include "screening/data_quality.hpp"
#include "diagnosis/convention_trial.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <iostream>

#include "better_reading.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "screening/messages.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::data_quality_test {
namespace {

using testing::better_convention;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kDegree;
using testing::messages;
using testing::VirtualExperiment;

Estimate preliminary(const ErrorModel& model, const Measurements& measurements, const Unknowns& free) {
  return identify_robustly({.model = model,
                            .measurements = measurements,
                            .start = nominal_start(model, measurements),
                            .free = free,
                            .options = {.loss = Loss::tukey}})
      .fit.estimate;
}

/// The published experiment: 30 configurations, three tools, errors that the reduced model carries.
struct Experiment : VirtualExperiment {
  Experiment() : VirtualExperiment({.ranges = published_ranges}) {}

  Measurements measured(std::uint64_t seed, const ErrorSizes& errors, double sigma, int repeats = 1,
                        int configurations = 30) const {
    VirtualExperiment drawn = *this;
    drawn.sizes = errors;
    drawn.restart(Random(seed));
    return drawn.measure(configurations, {.sigma = sigma, .repeats = repeats});
  }

  Estimate fitted(const Measurements& measurements) const { return preliminary(model, measurements, free); }
  std::vector<QualityFinding> findings(const Measurements& measurements) const {
    return check_measurements(model, measurements, fitted(measurements));
  }
};

const Experiment& experiment() {
  static const Experiment instance;
  return instance;
}

const ErrorSizes kSmall{.length = 0.001, .angle = 0.001};
const ErrorSizes kPublished{};
constexpr double kNoise = 0.00003;

Observation& row(Measurements& measurements, int configuration, int target, int repeat = 1) {
  for (Observation& observation : measurements.observations) {
    if (observation.configuration == configuration - 1 && observation.target == target &&
        observation.repeat == repeat) {
      return observation;
    }
  }
  throw InputError("no such row");
}

struct Slip {
  int target = 0;
  int after = 0;         // so many configurations
  Eigen::Vector3d step;  // in F
};

void slip_target(const ErrorModel& model, const Estimate& estimate, Measurements& measurements, const Slip& slip) {
  const auto X_BF = flange_poses(model, estimate, measurements.joint_values);
  for (Observation& observation : measurements.observations) {
    if (observation.target == slip.target && observation.configuration >= slip.after) {
      observation.position() += estimate.frames.base().linear() *
                                X_BF[static_cast<std::size_t>(observation.configuration)].linear() * slip.step;
    }
  }
}

void swap_targets(Measurements& measurements, int configuration, int a, int b) {
  for (Observation& observation : measurements.observations) {
    if (observation.configuration == configuration - 1 && (observation.target == a || observation.target == b)) {
      observation.target = observation.target == a ? b : a;
    }
  }
}

// ---- no false alarms -----------------------------------------------------------------------------------------------

using Draw = std::function<Measurements(std::uint64_t seed)>;

std::uint64_t sets_with_findings(std::uint64_t seeds, const Draw& draw) {
  std::uint64_t sets = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const std::vector<std::string> found = messages(experiment().findings(draw(seed)));
    sets += found.empty() ? 0U : 1U;
    std::cout << (found.empty() ? "" : "seed " + std::to_string(seed) + ": " + found.front() + "\n");
  }
  return sets;
}

void expect_nothing_in_clean_data(std::uint64_t seeds) {
  const std::vector<Draw> draws = {[](std::uint64_t seed) { return experiment().measured(seed, kSmall, kNoise); },
                                   [](std::uint64_t seed) { return experiment().measured(seed, kPublished, kNoise); },
                                   [](std::uint64_t seed) { return experiment().measured(seed, kSmall, kNoise, 10); },
                                   [](std::uint64_t seed) { return experiment().measured(seed, kPublished, 0.0); }};
  for (std::size_t draw = 0; draw < draws.size(); ++draw) {
    EXPECT_EQ(sets_with_findings(seeds, draws[draw]), 0U) << draw;
  }
}

TEST(DataQuality, FindsNothingInCleanDataInRepeatsNorWithoutNoise) { expect_nothing_in_clean_data(4); }
TEST(DataQualityLongRun, FindsNothingInCleanDataInRepeatsNorWithoutNoise) { expect_nothing_in_clean_data(200); }

// But for one in a hundred, which noise alone may be.
void expect_nothing_in_a_few_configurations(std::uint64_t seeds) {
  std::uint64_t named = 0;
  for (const int configurations : {4, 6, 8, 10, 12, 15, 20}) {
    named += sets_with_findings(
        seeds, [&](std::uint64_t seed) { return experiment().measured(seed, kSmall, kNoise, 1, configurations); });
  }
  EXPECT_LE(named, seeds * 7 / 100);
}

TEST(DataQuality, FindsNothingInAFewConfigurations) { expect_nothing_in_a_few_configurations(4); }
TEST(DataQualityLongRun, FindsNothingInAFewConfigurations) { expect_nothing_in_a_few_configurations(200); }

/// With noise of Student's t with four degrees of freedom.
Measurements heavy_tailed(std::uint64_t seed) {
  Measurements measured = experiment().measured(seed, kSmall, 0.0);
  Random random(seed, 1);
  for (Observation& observation : measured.observations) {
    for (double& coordinate : observation.position()) {
      const double value = random.normal();
      double squares = 0.0;
      for (int i = 0; i < 4; ++i) {
        squares += std::pow(random.normal(), 2);
      }
      coordinate += kNoise * value / std::sqrt(squares / 4.0);
    }
  }
  return measured;
}

TEST(DataQuality, TakesNoHeavyTailsForTypingErrors) { EXPECT_EQ(sets_with_findings(12, heavy_tailed), 0U); }

// A quarter of the sets without the limit of heavy tails.
TEST(DataQualityLongRun, TakesNoHeavyTailsForTypingErrors) { EXPECT_LE(sets_with_findings(1000, heavy_tailed), 10U); }

int typing_errors_named(std::uint64_t seeds, double amount) {
  int named = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    Measurements measured = experiment().measured(seed, kSmall, kNoise);
    measured.observations[seed * 7 % measured.observations.size()].position()[static_cast<Eigen::Index>(seed % 3)] +=
        amount;
    const std::vector<QualityFinding> findings = experiment().findings(measured);
    named += findings.size() == 1 && findings[0].kind == QualityKind::mistyped_coordinate ? 1 : 0;
  }
  return named;
}

TEST(DataQuality, NamesATypingErrorOfHalfAMillimetre) { EXPECT_EQ(typing_errors_named(12, 0.0005), 12); }

TEST(DataQualityLongRun, NamesATypingErrorOfHalfAMillimetre) { EXPECT_GE(typing_errors_named(1000, 0.0005), 980); }

// ---- slips ---------------------------------------------------------------------------------------------------------

TEST(DataQuality, NamesATargetThatSlipped) {
  const std::vector<Eigen::Vector3d> directions = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-0.6, 0.0, 0.8}};
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    for (int target = 0; target < 3; ++target) {
      // y is perpendicular to the plane of the published targets.
      const Eigen::Vector3d& direction = directions[seed % directions.size()];
      Measurements measured = experiment().measured(seed, kSmall, kNoise);
      slip_target(experiment().model, experiment().fitted(measured), measured, {target, 12, 0.001 * direction});
      if (target == 1) {  // rows may come in any order
        std::reverse(measured.observations.begin(), measured.observations.end());
      }
      const std::vector<QualityFinding> findings = experiment().findings(measured);
      ASSERT_EQ(findings.size(), 1U) << seed << " " << target << ::testing::PrintToString(messages(findings));
      EXPECT_EQ(findings[0].kind, QualityKind::slipped_target);
      EXPECT_EQ(findings[0].configuration, "12") << seed;
      EXPECT_THAT(findings[0].targets, ElementsAre(measured.targets[static_cast<std::size_t>(target)]));
      EXPECT_NEAR(findings[0].amount, 0.001, 0.0001) << seed;
      EXPECT_GT(findings[0].offset.dot(direction), 0.0009) << seed;
    }
  }
}

TEST(DataQuality, DistancesHardlySeeASlipAcrossThePlaneOfTheTargets) {
  Measurements measured = experiment().measured(5, kSmall, kNoise);
  slip_target(experiment().model, experiment().fitted(measured), measured, {2, 12, {0.0, 0.001, 0.0}});
  EXPECT_THAT(messages(check_distances(measured)), IsEmpty());
  EXPECT_THAT(messages(experiment().findings(measured)),
              ElementsAre("target C slipped by about 1.0 mm after configuration 12"));
}

TEST(DataQuality, NamesASlipInDataWithoutNoiseAndInRepeats) {
  for (const double sigma : {0.0, kNoise}) {
    Measurements measured = experiment().measured(6, kPublished, sigma, sigma > 0.0 ? 5 : 1);
    slip_target(experiment().model, experiment().fitted(measured), measured, {0, 12, {0.0, 0.0, -0.001}});
    EXPECT_THAT(messages(experiment().findings(measured)),
                ElementsAre("target A slipped by about 1.0 mm after configuration 12"));
  }
}

TEST(DataQuality, NamesTheOnlyTargetThatSlipped) {
  VirtualExperiment e({.targets = published_targets(1), .sizes = kSmall, .ranges = published_ranges});
  Measurements measured = e.measure(80, {.sigma = kNoise});
  slip_target(e.model, e.robot.truth, measured, {0, 30, {0.0, 0.0006, 0.0008}});
  // Without others to compare it with, the fit bends a little to follow it.
  const std::vector<QualityFinding> findings =
      check_measurements(e.model, measured, preliminary(e.model, measured, e.free));
  ASSERT_EQ(findings.size(), 1U) << ::testing::PrintToString(messages(findings));
  EXPECT_EQ(findings[0].kind, QualityKind::slipped_target);
  EXPECT_EQ(findings[0].configuration, "30");
  EXPECT_NEAR(findings[0].amount, 0.001, 0.00015);
}

// ---- swaps ---------------------------------------------------------------------------------------------------------

TEST(DataQuality, NamesTwoTargetsThatWereSwapped) {
  const std::vector<std::pair<int, int>> pairs = {{0, 1}, {0, 2}, {1, 2}};
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    for (const auto& [a, b] : pairs) {
      Measurements measured = experiment().measured(seed, kPublished, kNoise);
      swap_targets(measured, 7, a, b);
      const std::vector<QualityFinding> findings = experiment().findings(measured);
      const std::string names =
          measured.targets[static_cast<std::size_t>(a)] + " and " + measured.targets[static_cast<std::size_t>(b)];
      ASSERT_THAT(messages(findings), ElementsAre("targets " + names + " are swapped in configuration 7")) << seed;
      EXPECT_EQ(findings[0].kind, QualityKind::swapped_targets);
      EXPECT_GT(findings[0].amount, 0.05);
    }
  }
}

TEST(DataQuality, DistancesAloneNameASwapThatChangesThem) {
  Measurements measured = experiment().measured(1, {.length = 0.001, .angle = 0.001, .target_length = 0.0}, kNoise, 3);
  Measurements symmetric = measured;
  swap_targets(measured, 7, 0, 2);
  EXPECT_THAT(messages(check_distances(measured)), ElementsAre("targets A and C are swapped in configuration 7"));
  swap_targets(symmetric, 7, 0, 1);  // AC and BC are equally long
  EXPECT_THAT(messages(check_distances(symmetric)), IsEmpty());
  EXPECT_THAT(messages(experiment().findings(symmetric)),
              ElementsAre("targets A and B are swapped in configuration 7"));
}

TEST(DataQuality, NamesTheRepeatOfASwapAndARing) {
  Measurements measured = experiment().measured(2, kSmall, kNoise, 3);
  Observation& a = row(measured, 4, 0, 2);
  Observation& b = row(measured, 4, 1, 2);
  std::swap(a.position(), b.position());
  for (int repeat = 1; repeat <= 3; ++repeat) {
    const Eigen::Vector3d first = row(measured, 9, 0, repeat).position();
    row(measured, 9, 0, repeat).position() = row(measured, 9, 1, repeat).position();
    row(measured, 9, 1, repeat).position() = row(measured, 9, 2, repeat).position();
    row(measured, 9, 2, repeat).position() = first;
  }
  EXPECT_THAT(messages(experiment().findings(measured)),
              ElementsAre("targets A and B are swapped in configuration 4, repeat 2",
                          "targets A, B and C are swapped in configuration 9"));
}

// ---- single rows ---------------------------------------------------------------------------------------------------

TEST(DataQuality, SaysInWordsWhichCoordinateAndHowMuch) {
  Measurements measured = experiment().measured(1, kSmall, kNoise, 2);
  row(measured, 5, 1).position().x() += 0.01;
  for (int repeat = 1; repeat <= 2; ++repeat) {
    row(measured, 20, 2, repeat).position().z() -= 0.01;
  }
  EXPECT_THAT(messages(experiment().findings(measured)),
              ElementsAre("target B in configuration 5, repeat 1: x is off by about 10.0 mm",
                          "target C in configuration 20: z is off by about -10.0 mm in every repeat"));
  const std::vector<QualityFinding> of_distances = check_distances(measured);
  ASSERT_FALSE(of_distances.empty());
  EXPECT_EQ(of_distances[0].kind, QualityKind::displaced_point);
  EXPECT_THAT(of_distances[0].message, HasSubstr("target B in configuration 5, repeat 1 is off by at least "));
}

TEST(DataQuality, NamesAConfigurationWhoseJointValuesAreWrong) {
  Measurements measured = experiment().measured(1, kSmall, kNoise);
  measured.joint_values(1, 7) += 2.0 * kDegree;
  const std::vector<QualityFinding> findings = experiment().findings(measured);
  ASSERT_EQ(findings.size(), 1U) << ::testing::PrintToString(messages(findings));
  EXPECT_EQ(findings[0].kind, QualityKind::displaced_configuration);
  EXPECT_EQ(findings[0].configuration, "8");
  EXPECT_THAT(findings[0].message, HasSubstr("are its joint values right?"));
}

TEST(DataQuality, NamesAllThatIsWrongAtOnce) {
  Measurements measured = experiment().measured(4, kSmall, kNoise);
  slip_target(experiment().model, experiment().fitted(measured), measured, {2, 12, {0.0, 0.001, 0.0}});
  swap_targets(measured, 7, 0, 1);
  row(measured, 5, 1).position().x() += 0.01;
  EXPECT_THAT(messages(experiment().findings(measured)),
              ElementsAre("target C slipped by about 1.0 mm after configuration 12",
                          "target B in configuration 5, repeat 1: x is off by about 10.0 mm",
                          "targets A and B are swapped in configuration 7"));
}

TEST(DataQuality, HasNothingToSayAboutNothing) {
  Measurements measured = experiment().measured(1, kSmall, kNoise);
  const Estimate estimate = experiment().fitted(measured);
  measured = subset(measured, [](const Observation&) { return false; });
  EXPECT_THAT(check_distances(measured), IsEmpty());
  EXPECT_THAT(check_residuals(experiment().model, measured, estimate), IsEmpty());
}

// ---- joint conventions ---------------------------------------------------------------------------------------------

JointConvention shipped(const std::string& name) {
  return read_joint_convention(std::string(URDF_DIR) + "/fanuc_r2000ic_165f_" + name + ".json");
}

/// The file's values are those of the controller with convention `truth`; they are read with `used`.
Measurements misread(Measurements measured, const JointConvention& truth, const JointConvention& used) {
  const JointConvention right = matched_convention(truth, measured.joints);
  const JointConvention wrong = matched_convention(used, measured.joints);
  const Eigen::MatrixXd controller =
      right.matrix.inverse() * (measured.joint_values.colwise() - Eigen::VectorXd(right.offset));
  measured.joint_values = (wrong.matrix * controller).colwise() + wrong.offset;
  return measured;
}

TEST(JointConventionsInTheData, NamesTheConventionThatFits) {
  const JointConvention pendant = shipped("pendant");
  const JointConvention serial = shipped("serial");
  const Measurements measured = experiment().measured(1, kPublished, kNoise);
  for (const auto& [truth, used] : {std::pair(pendant, serial), std::pair(serial, pendant)}) {
    const Measurements wrong = misread(measured, truth, used);
    const auto trials =
        try_conventions(experiment().model, wrong, experiment().free, {.used = &used, .others = {pendant, serial}});
    const auto better = better_convention(trials);
    ASSERT_TRUE(better.has_value());
    EXPECT_EQ(better->description, "the convention " + std::filesystem::path(truth.name).filename().string());
    EXPECT_FALSE(better->present);
    EXPECT_LT(better->rms, 0.0001);
    EXPECT_LT((better->joint_values - measured.joint_values).norm(), 1e-12);
    EXPECT_TRUE(
        std::is_sorted(trials.begin(), trials.end(), [](const auto& a, const auto& b) { return a.rms < b.rms; }));
  }
}

TEST(JointConventionsInTheData, NamesTheControllersJointWhereTheConventionCouplesThem) {
  const Measurements measured = experiment().measured(3, kSmall, kNoise);
  const JointConvention pendant = shipped("pendant");
  JointConvention flipped = pendant;
  flipped.matrix.col(1) *= -1.0;
  const auto better =
      better_convention(try_conventions(experiment().model, misread(measured, flipped, pendant), experiment().free,
                                        {.used = &pendant, .others = {shipped("serial")}}));
  ASSERT_TRUE(better.has_value());
  EXPECT_EQ(better->description, "the controller's J2 with the opposite sign");
}

TEST(JointConventionsInTheData, TurnAboutTheirOffset) {
  const Measurements measured = experiment().measured(3, kSmall, kNoise);
  JointConvention used = shipped("serial");
  used.offset[2] = 0.4;
  JointConvention truth = used;
  truth.matrix.row(2) *= -1.0;
  const auto better = better_convention(
      try_conventions(experiment().model, misread(measured, truth, used), experiment().free, {.used = &used}));
  ASSERT_TRUE(better.has_value());
  EXPECT_EQ(better->description, "joint_3 with the opposite sign");
  EXPECT_LT((better->joint_values - measured.joint_values).norm(), 1e-12);
}

TEST(JointConventionsInTheData, NamesTheUnitOfAJoint) {
  VirtualExperiment arm({.model = complete_model(parse_robot(testing::kOddArm)),
                         .targets = testing::circle_of_targets(),
                         .sizes = kSmall,
                         .random = Random(3)});
  const Measurements right = arm.measure(40, {.sigma = kNoise});
  struct Misread {
    Eigen::Index joint;
    double factor;
    const char* words;
  };
  for (const Misread& misread : {Misread{1, 1000.0, "slide in millimetres, read as metres"},
                                 {1, 0.001, "slide in metres, read as millimetres"},
                                 {1, 100.0, "slide in centimetres, read as metres"},
                                 {1, 0.1, "slide in centimetres, read as millimetres"},
                                 {1, 1.0 / 0.0254, "slide in inches, read as metres"},
                                 {1, 1.0 / 25.4, "slide in inches, read as millimetres"},
                                 {3, 1.0 / kDegree, "elbow in degrees, read as radians"},
                                 {3, kDegree, "elbow in radians, read as degrees"},
                                 {3, 1.0 / 0.9, "elbow in gradians, read as degrees"},
                                 {3, 1.0 / (0.9 * kDegree), "elbow in gradians, read as radians"},
                                 {3, 1000.0, "elbow in milliradians, read as radians"},
                                 {3, 1.0 / (360.0 * kDegree), "elbow in turns, read as radians"},
                                 {3, 1.0 / 360.0, "elbow in turns, read as degrees"}}) {
    Measurements wrong = right;
    wrong.joint_values.row(misread.joint) *= misread.factor;
    const auto better = better_convention(try_conventions(arm.model, wrong, arm.free));
    ASSERT_TRUE(better) << misread.words;
    EXPECT_EQ(better->description, misread.words);
    EXPECT_LT((better->joint_values - right.joint_values).cwiseAbs().maxCoeff(), 1e-12) << misread.words;
  }
}

TEST(JointConventionsInTheData, HaveNothingBetterToOfferWhereTheFitIsFine) {
  const JointConvention pendant = shipped("pendant");
  const JointConvention serial = shipped("serial");
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    for (const double noise : {0.0, kNoise}) {
      const Measurements measured = experiment().measured(seed, kPublished, noise);
      const auto trials = try_conventions(experiment().model, measured, experiment().free,
                                          {.used = &serial, .others = {pendant, serial}});
      EXPECT_TRUE(trials.front().present);
      EXPECT_FALSE(better_convention(trials).has_value());
    }
  }
}

// ---- real data -----------------------------------------------------------------------------------------------------

Measurements real_measurements(const JointConvention& convention) {
  return read_measurements(std::string(SHARED_DATA_DIR) + "/r2000ic_165f_tracker/measurements.csv",
                           joint_names(testing::fanuc()), &convention);
}

TEST(DataQualityOnRealData, FindsNothingInTheFanucSeriesNorInItsMeans) {
  const Measurements measured = real_measurements(shipped("serial"));
  EXPECT_THAT(messages(experiment().findings(measured)), IsEmpty());
  EXPECT_THAT(messages(experiment().findings(averaged(measured))), IsEmpty());
}

TEST(DataQualityOnRealData, FindsNothingInTheUr10Poses) {
  const std::string folder = std::string(SHARED_DATA_DIR) + "/ur10_tracker_poses";
  const Robot robot = load_robot(folder + "/ur10.urdf", {.base = "base_link", .tip = "tool0"});
  const ErrorModel model = complete_model(robot);
  const Measurements measured = read_measurements(folder + "/measurements.csv", joint_names(robot));
  const std::vector<TargetFrame> targets = nominal_start(model, measured).frames.targets;
  const Unknowns free(model, targets, reduced_model(model, targets).kept);
  EXPECT_THAT(messages(check_measurements(model, measured, preliminary(model, measured, free))), IsEmpty());
}

TEST(DataQualityOnRealData, NamesDefectsPutIntoTheFanucSeries) {
  const Measurements clean = real_measurements(shipped("serial"));
  const Estimate estimate = experiment().fitted(clean);
  for (int target = 0; target < 3; ++target) {
    for (int axis = 0; axis < 3; ++axis) {
      if (target != 0 && target != axis) {
        continue;  // each axis and each target
      }
      Measurements slipped = clean;
      slip_target(experiment().model, estimate, slipped, {target, 12, 0.001 * Eigen::Vector3d::Unit(axis)});
      const std::string name = clean.targets[static_cast<std::size_t>(target)];
      const std::vector<QualityFinding> findings = experiment().findings(slipped);
      ASSERT_EQ(findings.size(), 1U) << name << axis << ::testing::PrintToString(messages(findings));
      EXPECT_EQ(findings[0].kind, QualityKind::slipped_target);
      EXPECT_EQ(findings[0].configuration, "12");
      EXPECT_THAT(findings[0].targets, ElementsAre(name));
      EXPECT_NEAR(findings[0].amount, 0.001, 0.0002);

      Measurements mistyped = clean;
      row(mistyped, 5, target, 3).position()[axis] += 0.01;
      const std::vector<QualityFinding> typing = experiment().findings(mistyped);
      ASSERT_EQ(typing.size(), 1U) << name << axis << ::testing::PrintToString(messages(typing));
      EXPECT_THAT(typing[0].message, HasSubstr("target " + name + " in configuration 5, repeat 3: " +
                                               static_cast<char>('x' + axis) + " is off by about 10."));
      EXPECT_NEAR(typing[0].amount, 0.01, 0.0001);
    }
    const int other = (target + 1) % 3;
    Measurements swapped = clean;
    swap_targets(swapped, 7, target, other);
    const std::string first = clean.targets[static_cast<std::size_t>(std::min(target, other))];
    const std::string second = clean.targets[static_cast<std::size_t>(std::max(target, other))];
    EXPECT_THAT(messages(experiment().findings(swapped)),
                ElementsAre("targets " + first + " and " + second + " are swapped in configuration 7"));
  }
}

TEST(JointConventionsOnRealData, NameTheConventionThatFits) {
  const JointConvention pendant = shipped("pendant");
  const JointConvention serial = shipped("serial");
  const Measurements wrong = real_measurements(pendant);
  const auto better = better_convention(
      try_conventions(experiment().model, wrong, experiment().free, {.used = &pendant, .others = {pendant, serial}}));
  ASSERT_TRUE(better.has_value());
  EXPECT_EQ(better->description, "the convention fanuc_r2000ic_165f_serial.json");
  EXPECT_NEAR(better->rms, 0.000161, 0.000001);
  const Measurements right = real_measurements(serial);
  EXPECT_FALSE(better_convention(try_conventions(experiment().model, right, experiment().free,
                                                 {.used = &serial, .others = {pendant, serial}}))
                   .has_value());
}

TEST(JointConventionsOnRealData, NameEachJointWithTheOppositeSign) {
  const JointConvention serial = shipped("serial");
  for (Eigen::Index j = 0; j < 6; ++j) {
    Measurements wrong = real_measurements(serial);
    wrong.joint_values.row(j) *= -1.0;
    const auto trials = try_conventions(experiment().model, wrong, experiment().free,
                                        {.used = &serial, .others = {shipped("pendant"), serial}});
    const auto better = better_convention(trials);
    ASSERT_TRUE(better.has_value()) << j << ", best " << trials.front().description << " " << trials.front().rms;
    EXPECT_EQ(better->description, "joint_" + std::to_string(j + 1) + " with the opposite sign");
  }
}

}  // namespace
}  // namespace kdl_calibration::data_quality_test
