#include "selection/parameter_selection.hpp"

#include <gmock/gmock.h>

#include <array>
#include <iterator>
#include <set>
#include <sstream>

#include "calibration/calibrate.hpp"
#include "effects/effect_terms.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/measurements.hpp"
#include "model/kinematics.hpp"
#include "planning/simulation.hpp"
#include "refusal.hpp"
#include "results/calibrated_urdf.hpp"
#include "urdf_text.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::parameter_selection_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::vector<TargetFrame> a_point_and_a_frame() {
  std::vector<TargetFrame> targets = published_targets(2);
  targets[1].with_orientation = true;
  return targets;
}

std::vector<std::string> words(const std::string& text) {
  std::istringstream stream(text);
  return {std::istream_iterator<std::string>(stream), {}};
}

struct Choice {
  const char* name;
  ParameterOptions options;
  std::string more;  // than the irreducible model, frames included
  std::string less;
};

// By the published irreducible model of such an arm (Klimchik et al. 2014). Its 18 errors, 6 of the base and 6 of the
// frame B are the 30 of a chain of six revolute joints; each known coordinate of base or B makes one more error known.
TEST(ParameterSelection, IsThePublishedModelWithWhatIsFreedWithoutWhatIsFixedOrKnown) {
  const std::string irreducible =
      "base.Tx base.Ty base.Tz base.Rx base.Ry base.Rz A.x A.y A.z B.x B.y B.z B.Rx B.Ry B.Rz "
      "dq2 dq3 dq4 dq5 Tx1 Ty1 Ry1 Tz2 Rz2 Ry2 Tz3 Ty3 Rz3 Tz4 Tx4 Rz4 Tz5 Rz5";
  // What these replace. The offsets of the first and the last joint are gauge.
  const std::string replaced = "Tz0 Tx0 Ty0 Rz0 Rx0 Ry0 Rx1 Ty2 Ry3 Rx4 Ty5 Ry5 Tz6 Tx6 Rz6 Rx6";
  const std::string everything = replaced + " dq1 dq6";
  const std::string behind_b = "dq6 Ty5 Tz6 Tx6 Rz6 Rx6";
  const TargetFrame a = a_point_and_a_frame()[0];
  const TargetFrame b = a_point_and_a_frame()[1];
  const Eigen::Isometry3d base = Eigen::Isometry3d::Identity();
  const std::vector<Choice> choices = {
      {"default", {}, "", ""},
      {"complete", {.model = ModelChoice::complete}, everything, ""},
      {"fixed", {.fix = {"*4", "Rz?", "dq2"}}, "", "dq2 dq4 Tz4 Tx4 Rz4 Rx4 Rz0 Rz2 Rz3 Rz5 Rz6"},
      {"freed", {.free = {"dq1", "T?6"}}, "dq1 Tz6 Tx6", ""},
      {"complete but for some",
       {.model = ModelChoice::complete, .fix = {"Tx*"}, .free = {"dq1"}},
       everything,
       "Tx0 Tx1 Tx4 Tx6"},
      {"base",
       {.known = {.bases = {{.X_WB = base}}}},
       "dq1 Tz0 Tx0 Ty0 Rx0 Ry0",
       "base.Tx base.Ty base.Tz base.Rx base.Ry base.Rz"},
      {"base turned",
       {.free = {"base.T?"}, .known = {.bases = {{.X_WB = base}}}},
       "dq1 Rx0 Ry0",
       "base.Rx base.Ry base.Rz"},
      {"base turned and fixed",
       {.fix = {"base.Rz"}, .free = {"base.T?"}, .known = {.bases = {{.X_WB = base}}}},
       "dq1 Rx0 Ry0",
       "base.Rx base.Ry base.Rz"},
      {"frame", {.known = {.targets = {b}}}, behind_b, "B.x B.y B.z B.Rx B.Ry B.Rz"},
      {"frame turned", {.free = {"B.?"}, .known = {.targets = {b}}}, "dq6 Rz6 Rx6", "B.Rx B.Ry B.Rz"},
      {"frame and point", {.known = {.targets = {b, a}}}, behind_b, "A.x A.y A.z B.x B.y B.z B.Rx B.Ry B.Rz"}};
  const ErrorModel model = complete_model(testing::fanuc());
  for (const Choice& choice : choices) {
    const ParameterSelection found =
        select_parameters(model, a_point_and_a_frame(), choice.options, {.configurations = 15});
    const auto expected = [&](const std::string& candidates) {
      const std::vector<std::string> all = words(candidates + " " + choice.more);
      std::set<std::string> names(all.begin(), all.end());
      for (const std::string& name : words(choice.less)) {
        names.erase(name);
      }
      return names;
    };
    EXPECT_THAT(found.free, ::testing::UnorderedElementsAreArray(expected(irreducible))) << choice.name;
    EXPECT_THAT(found.complete, ::testing::UnorderedElementsAreArray(expected(irreducible + " " + replaced)))
        << choice.name;
  }
  EXPECT_EQ(select_parameters(model, a_point_and_a_frame(), {}, {.configurations = 15}).free, words(irreducible))
      << "in the declared order";
}

TEST(ParameterSelection, IsMadeAtTheGeometryThatIsStated) {
  const ErrorModel model = complete_model(testing::fanuc());
  Random random(2);
  const ReductionOptions bent{.configurations = 15, .errors = testing::random_errors(model, random, 0.01, 0.1)};
  const ParameterSelection found = select_parameters(model, a_point_and_a_frame(), {}, bent);
  EXPECT_EQ(found.reduction.kept, reduced_model(model, a_point_and_a_frame(), bent).kept);
  EXPECT_NE(found.free, select_parameters(model, a_point_and_a_frame(), {}, {.configurations = 15}).free);
}

TEST(ParameterSelection, RefusesPatternsThatNothingMatches) {
  const ErrorModel model = complete_model(testing::fanuc());
  const auto refused = [&](const ParameterOptions& options) {
    return testing::refusal([&] { select_parameters(model, a_point_and_a_frame(), options); });
  };
  EXPECT_THAT(refused({.fix = {"dq2", "dq7"}}), HasSubstr("fix: 'dq7' matches no parameter; there are base.Tx, base"));
  EXPECT_THAT(refused({.free = {"Tz9"}}), HasSubstr("free: 'Tz9' matches no parameter; there are base.Tx"));
  EXPECT_THAT(refused({.free = {"gravity.*"}}), HasSubstr("free: 'gravity.*' matches no parameter"));
  EXPECT_THAT(refused({.fix = {"A.Rx"}}), HasSubstr("'A.Rx' matches no parameter"));
  EXPECT_THAT(refused({.fix = {"dq2", "Ry1"}, .free = {"Ry?"}}), HasSubstr("free: Ry1 is fixed as well"));
  EXPECT_THAT(refused({.fix = {"*4"}, .free = {"Tx4"}}), HasSubstr("free: Tx4 is fixed as well"));
  EXPECT_EQ(refused({.fix = {"gravity.*", "tables", "gain.2", "backlash?2"}}), "nothing was refused");
}

TEST(ParameterSelection, RefusesToFixFramesThatAreNotKnown) {
  const ErrorModel model = complete_model(testing::fanuc());
  const auto refused = [&](const ParameterOptions& options) -> std::vector<std::string> {
    try {
      select_parameters(model, a_point_and_a_frame(), options);
    } catch (const OptionError& error) {
      std::vector<std::string> told = {error.option(), error.fault()};
      told.insert(told.end(), error.remedies().begin(), error.remedies().end());
      return told;
    }
    return {};
  };
  EXPECT_THAT(refused({.fix = {"base.Rx"}}),
              ElementsAre("fix", "base.Rx can only be fixed where its value is known", "known.bases"));
  EXPECT_THAT(refused({.fix = {"A.y"}, .known = {.targets = {a_point_and_a_frame()[1]}}}),
              ElementsAre("fix", "A.y can only be fixed where its value is known", "known.targets"));
  EXPECT_THAT(refused({.fix = {"A.y"}, .known = {.targets = {a_point_and_a_frame()[0]}}}), ElementsAre());
}

TEST(ParameterSelection, PatternsOfEffectsLeaveOutTheTermsThatTheyMatch) {
  const ErrorModel model = complete_model(testing::fanuc());
  const std::vector<EffectTerm> gains = gain_terms(model);
  const auto fixed = [&](const std::vector<std::string>& patterns) {
    std::vector<std::string> names;
    for (const EffectTerm& term : gains) {
      if (fixes_effect(patterns, term)) {
        names.push_back(term.name);
      }
    }
    return names;
  };
  EXPECT_THAT(fixed({}), ElementsAre());
  EXPECT_THAT(fixed({"gain.2", "dq1", "gravity.*"}), ElementsAre("gain.2"));
  EXPECT_THAT(fixed({"dq1", "gain.?"}), ElementsAre("gain.1", "gain.2", "gain.3", "gain.4", "gain.5", "gain.6"));
  EXPECT_THAT(fixed({"g*"}), ElementsAre()) << "no group's name, so of parameters";
  EXPECT_THAT(fixed({"*"}), ElementsAre());
}

}  // namespace
}  // namespace kdl_calibration::parameter_selection_test

// The right parameters of arms as they are drawn in real files: nearly parallel axes, rounded angles, coincident axes,
// exported geometry, skew chains. Predictions where nothing was fitted are what must hold.
namespace kdl_calibration::parameter_selection_test::of_real_arms {
namespace {

using testing::fanuc;

struct JointText {
  std::string type;
  std::string xyz;
  std::string rpy;
  std::string axis;
  double limit;
};

// A chain l0 - j1 - l1 - … with a fixed tool behind it.
std::string chain_of(const std::vector<JointText>& joints, const std::string& tool = "0.1 0 0") {
  std::vector<testing::urdf::Part> parts;
  for (const JointText& joint : joints) {
    const std::string limit = std::to_string(joint.limit);
    parts.push_back({joint.type, "<origin xyz='" + joint.xyz + "' rpy='" + joint.rpy + "'/><axis xyz='" + joint.axis +
                                     "'/>" + testing::urdf::limit("-" + limit + ":" + limit)});
  }
  parts.push_back({"fixed", "<origin xyz='" + tool + "'/>"});
  return testing::urdf::serial(parts);
}

// Three styles of drawing a 6R arm, with `tilt` between axes that are parallel in the drawing.
std::string six_joints(int style, double tilt) {
  std::ostringstream angle;
  angle.precision(17);
  angle << tilt;
  const std::string t = angle.str();
  const auto turn = [](const std::string& xyz, const std::string& rpy, const std::string& axis) {
    return JointText{"revolute", xyz, rpy, axis, 2.6};
  };
  switch (style) {
    case 0:  // the axes along z, y, y, x, y, x of frames that stand upright
      return chain_of({turn("0 0 0.4", "0 0 0", "0 0 1"), turn("0.15 0 0.1", "0 0 0", "0 1 0"),
                       turn("0 0 0.6", t + " 0 0", "0 1 0"), turn("0.1 0 0.1", "0 0 0", "1 0 0"),
                       turn("0.5 0 0", "0 0 0", "0 1 0"), turn("0.1 0 0", "0 0 0", "1 0 0")});
    case 1:  // every axis along z of a frame that is turned, by rounded angles
      return chain_of({turn("0 0 0.3", "0 0 0", "0 0 1"), turn("0.1 0 0.1", "1.5708 0 0", "0 0 1"),
                       turn("0.6 0 0", t + " 0 0", "0 0 1"), turn("0.1 0.5 0", "-1.5708 0 0", "0 0 1"),
                       turn("0 0 0.1", "1.5708 0 0", "0 0 1"), turn("0 0.1 0", "-1.57 0 0", "0 0 1")});
    default:  // three parallel axes and an offset wrist
      return chain_of({turn("0 0 0.09", "0 0 0", "0 0 1"), turn("0 0.13 0", "0 1.5708 0", "0 1 0"),
                       turn("0 -0.12 0.6", t + " 0 0", "0 1 0"), turn("0 0 0.57", t + " 1.5708 0", "0 1 0"),
                       turn("0 0.09 0", "0 0 0", "0 0 1"), turn("0 0 0.09", "0 0 0", "0 1 0")});
  }
}

// A virtual robot with errors behind every joint but the last, measured in 40 configurations with three targets.
struct Simulated {
  Robot robot;
  ErrorModel model;
  Measurements measured;  // 100 further configurations without noise are its test rows

  Simulated(const std::string& urdf, std::uint64_t seed, double noise,
            ErrorSizes sizes = {.length = 0.001, .angle = 0.001})
      : robot(parse_robot(urdf)), model(complete_model(robot)) {
    std::vector<std::size_t> wrong;
    for (std::size_t p = 0; p < model.parameters.size(); ++p) {
      const int frame = model.parameters[p].frame;
      if (frame > 0 && frame < static_cast<int>(model.joints.size())) {
        wrong.push_back(p);
      }
    }
    testing::VirtualExperiment experiment(
        {.model = model, .with_errors = wrong, .sizes = sizes, .random = Random(seed)});
    const Measurements train = experiment.measure(40, {.sigma = noise});
    measured = joined(train, experiment.measure(100, {}, Split::test));
  }
};

constexpr double kNoise = 0.00003;

// sigma sqrt(p / (3 N)) of a coordinate, in three dimensions
double floor_of(const CalibrationResult& found) {
  return kNoise * std::sqrt(3.0 * found.uncertainty.identifiability.rank / 360.0);
}

// However many fits lead to the answer.
void expect_a_misfit_before_each_iteration(const CalibrationResult& found) {
  const Identification& fit = found.fit.identification;
  EXPECT_EQ(fit.rms_history.size(), static_cast<std::size_t>(fit.iterations));
  if (!fit.rms_history.empty()) {
    EXPECT_GE(fit.rms_history.front(), fit.rms);
  }
}

constexpr std::array kTilts = {0.0, 1e-9, 1e-6, 1e-4, 3e-4, 1e-3, 1e-2, 0.1, 3.14};

void expect_no_difference_to_parallel_axes(int style, double tilt) {
  SCOPED_TRACE("style " + std::to_string(style) + ", tilt " + std::to_string(tilt));
  const Simulated exact(six_joints(style, tilt), 7, 0.0);
  const CalibrationResult clean = calibrate(exact.model, exact.measured, {.validation = {.held_out = false}});
  EXPECT_TRUE(clean.trusted()) << clean.fit.identification.message;
  expect_a_misfit_before_each_iteration(clean);
  EXPECT_LT(clean.accuracy.test->after.rms, 1e-9);
  EXPECT_LT(clean.uncertainty.identifiability.condition, 200.0);
  const Simulated noisy(six_joints(style, tilt), 8, kNoise);
  const CalibrationResult found = calibrate(noisy.model, noisy.measured);
  EXPECT_TRUE(found.trusted()) << found.fit.identification.message;
  expect_a_misfit_before_each_iteration(found);
  EXPECT_EQ(found.uncertainty.identifiability.rank, 33);
  EXPECT_LT(found.accuracy.test->after.rms, 2.0 * floor_of(found));
}

TEST(ParametersOfRealArms, NearlyParallelAxesAreTreatedAsWellAsParallelOnes) {
  for (std::size_t i = 0; i < kTilts.size(); i += 4) {  // each style once
    expect_no_difference_to_parallel_axes(static_cast<int>(i / 4), kTilts.at(i));
  }
}

TEST(ParametersOfRealArmsLongRun, NearlyParallelAxesOfEveryStyleAreTreatedAsWellAsParallelOnes) {
  for (int style = 0; style < 3; ++style) {
    for (const double tilt : kTilts) {
      expect_no_difference_to_parallel_axes(style, tilt);
    }
  }
}

TEST(ParametersOfRealArms, AnExportedRobotIsCalibratedAgain) {
  for (const std::uint64_t seed : {1U, 4U, 5U, 6U}) {
    const std::string nominal = seed <= 3 ? fanuc().urdf : six_joints(static_cast<int>(seed) - 4, 0.0);
    const Simulated first(nominal, seed, kNoise);
    const std::string exported =
        calibrated_urdf(first.robot, first.model,
                        calibrate(first.model, first.measured,
                                  {.validation = {.held_out = false}, .diagnosis = {.try_readings = false}})
                            .exported.estimate.errors);
    const Simulated exact(exported, 100 + seed, 0.0);
    const CalibrationResult clean = calibrate(exact.model, exact.measured, {.validation = {.held_out = false}});
    EXPECT_TRUE(clean.trusted()) << seed << ": " << clean.fit.identification.message;
    EXPECT_LT(clean.accuracy.test->after.rms, 1e-9) << seed;
    const Simulated noisy(exported, 200 + seed, kNoise);
    const CalibrationResult found = calibrate(noisy.model, noisy.measured);
    EXPECT_TRUE(found.trusted()) << seed << ": " << found.fit.identification.message;
    EXPECT_EQ(found.uncertainty.identifiability.rank, 33) << seed;
    EXPECT_LT(found.accuracy.test->after.rms, 2.0 * floor_of(found)) << seed;
  }
}

// Five to seven joints about axes in any direction, a fifth of them slides, errors of 2 mm and 5 mrad everywhere.
std::string skew_chain(std::uint64_t seed) {
  Random random(seed);
  const int joints = 5 + static_cast<int>(random.uniform(0.0, 3.0));
  const auto three = [](const Eigen::Vector3d& v) {
    std::ostringstream text;
    text.precision(17);
    text << v.x() << " " << v.y() << " " << v.z();
    return text.str();
  };
  std::vector<JointText> texts;
  for (int i = 0; i < joints; ++i) {
    const bool slides = random.uniform(0.0, 1.0) < 0.2;
    const Eigen::Vector3d axis{random.normal(), random.normal(), random.normal()};
    const Eigen::Vector3d link{random.uniform(-0.35, 0.35), random.uniform(-0.35, 0.35), random.uniform(-0.35, 0.35)};
    texts.push_back(
        {slides ? "prismatic" : "revolute", three(link), "0 0 0", three(axis.normalized()), slides ? 0.4 : 2.6});
  }
  return chain_of(texts, "0.1 0 0.1");
}

// What is measured of that chain, without noise.
struct SkewChain {
  ErrorModel model;
  Measurements measured;

  explicit SkewChain(std::uint64_t seed) : model(complete_model(parse_robot(skew_chain(seed)))) {
    std::vector<TargetFrame> targets = generic_targets(3, seed);
    for (TargetFrame& target : targets) {
      target.X_FT.translation() *= 0.1 / target.X_FT.translation().norm();
    }
    testing::VirtualExperiment experiment({.model = model,
                                           .targets = targets,
                                           .with_errors = testing::all_parameters(model),
                                           .sizes = {.length = 0.002, .angle = 0.005},
                                           .random = Random(1000 + seed)});
    const Measurements train = experiment.measure(40);
    measured = joined(train, experiment.measure(50, {}, Split::test));
  }
};

// Iterations that the noise-free calibration of this chain takes.
int iterations_to_rounding(std::uint64_t seed) {
  const SkewChain chain(seed);
  const CalibrationResult found =
      calibrate(chain.model, chain.measured, {.validation = {.held_out = false}, .diagnosis = {.try_readings = false}});
  EXPECT_EQ(found.fit.identification.termination, Termination::converged)
      << seed << ": " << found.fit.identification.message;
  EXPECT_LT(found.accuracy.test->after.rms, 1e-9) << seed;
  expect_a_misfit_before_each_iteration(found);
  return found.fit.identification.iterations;
}

TEST(ParametersOfRealArms, SkewChainsArriveAtRounding) {
  // The first one, and some of those that the kept parameters alone cannot explain.
  for (const std::uint64_t seed : {1U, 18U, 73U, 231U}) {
    EXPECT_LE(iterations_to_rounding(seed), 20) << seed;
  }
}

TEST(ParametersOfRealArmsLongRun, ThreeHundredSkewChainsArriveAtRounding) {
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    EXPECT_LE(iterations_to_rounding(seed), 20) << seed;
  }
}

// Held-out RMS of fifty noisy calibrations, on average; none is far above what the noise allows.
double mean_held_out(int style, double tilt) {
  constexpr int kSeeds = 50;
  double sum = 0.0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const Simulated noisy(six_joints(style, tilt), 1000 + seed, kNoise);
    const CalibrationResult found = calibrate(noisy.model, noisy.measured);
    EXPECT_TRUE(found.trusted()) << seed << ": " << found.fit.identification.message;
    EXPECT_LT(found.accuracy.test->after.rms, 2.0 * floor_of(found)) << seed;
    sum += found.accuracy.test->after.rms;
  }
  return sum / kSeeds;
}

TEST(ParametersOfRealArmsCampaign, NearlyParallelAxesCostNoAccuracy) {
  for (int style = 0; style < 3; ++style) {
    const double parallel = mean_held_out(style, 0.0);
    for (const double tilt : {3e-4, 1e-3, 1e-2, 3.14}) {
      SCOPED_TRACE("style " + std::to_string(style) + ", tilt " + std::to_string(tilt));
      EXPECT_LT(mean_held_out(style, tilt), 1.05 * parallel);
    }
  }
}

TEST(ParametersOfRealArms, CoincidentAxesRoundedAnglesAndKilometresAreNothingSpecial) {
  for (const double scale : {1.0, 1000.0, 1e6}) {
    const auto at = [&](double x, double y, double z) {
      std::ostringstream text;
      text.precision(17);
      text << x * scale << " " << y * scale << " " << z * scale;
      return text.str();
    };
    const std::string urdf = chain_of({{"revolute", at(0, 0, 0.3), "0 0 0", "0 0 1", 2.6},
                                       {"revolute", at(0, 0, 0), "0 0 1.57", "0 0 1", 2.6},  // on the axis before it
                                       {"revolute", at(0.1, 0, 0.2), "1.57 0 0", "0 0 1", 2.6},
                                       {"prismatic", at(0.4, 0, 0), "3.14 0 1.57", "0 0 1", 0.4 * scale},
                                       {"revolute", at(0, 0, 0.2), "0 -1.57 0", "0 0 -1", 2.6},
                                       {"revolute", at(0, 0, 0), "1.571 0 0", "0 1 0", 2.6}},
                                      at(0.1, 0, 0.2));
    const Simulated s(urdf, 3, 0.0);
    const CalibrationResult found = calibrate(s.model, s.measured);
    EXPECT_TRUE(found.trusted()) << scale << ": " << (found.trusted() ? "" : found.diagnosis.doubts.front().message);
    EXPECT_LT(found.accuracy.test->after.rms, 1e-9 * scale) << scale;
  }
}

TEST(ParametersOfRealArms, TheLastColumnOfTwoThatAreNearlyTheSameIsLeftToBetterOnes) {
  // The second column is the first turned by a milliradian, the third is what is left of it and more.
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(4, 4);
  columns.col(0) << 1.0, 0.0, 0.0, 0.0;
  columns.col(1) << 1.0, 1e-3, 0.0, 0.0;
  columns.col(2) << 0.3, 1.0, 0.0, 0.0;
  columns.col(3) << 0.0, 1.0, 2e-3, 0.0;
  std::vector<bool> replaceable;
  EXPECT_THAT(independent_columns(columns, {true, true, true, true}, {}, &replaceable),
              ::testing::ElementsAre(true, false, true, true));
  EXPECT_THAT(replaceable, ::testing::ElementsAre(false, false, false, true));
  EXPECT_THAT(independent_columns(columns, {true, true, false, false}),
              ::testing::ElementsAre(true, true, false, false));
  ColumnLimits seen;
  seen.seen = Eigen::VectorXd::Constant(4, 0.01);
  EXPECT_THAT(independent_columns(columns, {true, true, true, true}, seen),
              ::testing::ElementsAre(true, false, true, false));
  EXPECT_THAT(independent_columns(1e-13 * columns, {true, true, true, true}),
              ::testing::ElementsAre(false, false, false, false));
}

// What the noise hides there is held in a fit of its own, whose history begins with that of the fit before it.
TEST(ParametersOfRealArms, ATargetAtTheWristCentreKeepsTheHistoryOfEveryFit) {
  testing::VirtualExperiment experiment({.targets = testing::targets_at({{0.0, -0.215, 0.0}})});
  const CalibrationResult found = calibrate(experiment.model, experiment.measure(40));
  EXPECT_EQ(found.fit.identification.termination, Termination::rank_deficient) << found.fit.identification.message;
  EXPECT_GT(found.fit.identification.rms_history.front(), 1e-5) << "of the nominal robot";
  EXPECT_LT(found.accuracy.train.after.max, 1e-9);
  expect_a_misfit_before_each_iteration(found);
}

// ---- cases that went wrong -----------------------------------------------------------------------------------------

CalibrationResult case_of(const std::string& name) {
  const std::string stem = std::string(SHARED_DATA_DIR) + "/cases/" + name;
  const Robot robot = std::filesystem::exists(stem + ".urdf") ? load_robot(stem + ".urdf") : fanuc();
  return calibrate(complete_model(robot), read_measurements(stem + ".csv", joint_names(robot)));
}

TEST(ParametersOfRealArmsOnRealData, CasesWithoutNoiseAreExact) {
  for (const std::string name : {"nearly_parallel", "div_RRRRRRRF11", "fail_g", "s148"}) {
    const CalibrationResult found = case_of(name);
    EXPECT_TRUE(found.trusted()) << name << ": " << found.fit.identification.message;
    EXPECT_LE(found.fit.identification.iterations, 12) << name;
    EXPECT_LT(found.accuracy.train.after.max, 1e-9) << name;
    if (found.accuracy.test) {
      EXPECT_LT(found.accuracy.test->after.max, 1e-9) << name;
    }
  }
}

TEST(ParametersOfRealArmsOnRealData, ATargetAtTheWristCentreDoesNotTellTheWrist) {
  const CalibrationResult found = case_of("wristcentre");
  expect_a_misfit_before_each_iteration(found);
  EXPECT_EQ(found.fit.identification.termination, Termination::rank_deficient) << found.fit.identification.message;
  EXPECT_LT(found.accuracy.train.after.max, 1e-9);
  for (const ParameterEstimate& parameter : found.uncertainty.parameters) {
    if (parameter.kind != ParameterKind::translation && !parameter.joint.empty()) {
      EXPECT_LT(std::abs(parameter.error), 0.1) << parameter.name;
    }
  }
}

TEST(ParametersOfRealArmsOnRealData, AToolThatHardlyTurnsIsFittedInFewIterationsAndDoubted) {
  const CalibrationResult found = case_of("constant_orientation");
  EXPECT_EQ(found.fit.identification.termination, Termination::rank_deficient) << found.fit.identification.message;
  EXPECT_LT(found.fit.identification.iterations, 70);
  EXPECT_LT(found.accuracy.train.after.rms, 0.00014);
  EXPECT_LT(found.fit.identification.estimate.frames.targets[0].X_FT.translation().norm(), 0.3);
  for (std::size_t i = 1; i < found.fit.identification.rms_history.size(); ++i) {
    EXPECT_LE(found.fit.identification.rms_history[i], found.fit.identification.rms_history[i - 1]) << i;
  }
}

}  // namespace
}  // namespace kdl_calibration::parameter_selection_test::of_real_arms
