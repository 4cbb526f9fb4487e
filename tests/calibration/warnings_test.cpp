// Everything that a calibration can warn of: each warning has a case in which it appears, and in every other case it
// does not, because all warnings of each case are expected.

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <tuple>

#include "base/f_distribution.hpp"
#include "calibration/doubts.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::warnings_test {
namespace {

using ::testing::Contains;
using ::testing::ElementsAreArray;
using testing::fanuc;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kDegree;
using ::testing::MatchesRegex;
using ::testing::Not;

constexpr double kNoise = 3e-5;

/// The R-2000iC/165F with errors of a millimetre and a milliradian in 25 configurations, no sigma stated.
struct Series : testing::VirtualExperiment {
  Measurements measured;

  explicit Series(std::uint64_t seed = 1, const MeasuringNoise& noise = {.sigma = kNoise},
                  const std::vector<TargetFrame>& stated = published_targets())
      : VirtualExperiment({.targets = stated, .random = Random(seed)}) {
    measure_at(configurations(25), noise);
  }

  void measure_at(const Eigen::MatrixXd& q, const MeasuringNoise& noise = {.sigma = kNoise}) {
    measured = testing::without_sigmas(measure(q, noise));
  }

  void state_sigma(double sigma) {
    for (Observation& observation : measured.observations) {
      observation.sigma = sigma;
    }
  }

  /// Of targets 0, 1, 2 in configurations 1, 2, …
  Observation& row(int configuration, int target) {
    return measured.observations.at(3 * (static_cast<std::size_t>(configuration) - 1) +
                                    static_cast<std::size_t>(target));
  }

  Calibration calibrated(const CalibrationOptions& options = {}) const { return calibrate(model, measured, options); }
};

// An encoder of joint 3 that is off by `amplitude` twice per turn, which no geometry explains.
Measurements with_ripple(const Series& clean, double amplitude, const MeasuringNoise& noise) {
  Random random(7);
  const Eigen::MatrixXd q = clean.measured.joint_values;
  Eigen::MatrixXd off = q;
  off.row(2).array() += amplitude * (2.0 * q.row(2).array()).sin();
  Measurements measured = testing::without_sigmas(measure(clean.robot, off, noise, random));
  measured.joint_values = q;
  return measured;
}

// ---- each warning --------------------------------------------------------------------------------------------------

struct Scenario {
  const char* name;
  std::function<Calibration()> calibrated;
  Termination termination;
  std::vector<std::string> causes;    // of all doubts, in their order
  std::vector<std::string> warnings;  // extended regular expressions of all of them, in their order
};

const Series& clean_series() {
  static const Series series;
  return series;
}

const Calibration& clean() {
  static const Calibration found = clean_series().calibrated();
  return found;
}

Calibration with_too_few_iterations() { return Series().calibrated({.iterations = 1}); }

const Calibration& with_a_held_joint() {
  static const Calibration found = [] {
    Series s;
    Eigen::MatrixXd q = s.measured.joint_values;
    q.row(3).setConstant(0.6);
    s.measure_at(q);
    return s.calibrated();
  }();
  return found;
}

// The only target sits on the axis of joint 6, and stays there.
Calibration without_effect_of_joint_6() {
  const std::vector<TargetFrame> targets = testing::targets_at({{0.0, 0.1, 0.0}});
  Series s(2, {.sigma = kNoise}, targets);
  s.robot.truth.targets = targets;
  s.measure_at(s.measured.joint_values);
  return s.calibrated({.fix = {"?x6", "?z6"}, .free = {"dq6"}, .known_targets = targets});
}

// The only target moves on a circle.
Calibration with_one_moving_joint(double noise) {
  Series s(3, {.sigma = kNoise}, published_targets(1));
  Eigen::MatrixXd q = s.measured.joint_values.col(0).replicate(1, 25);
  q.row(0).setLinSpaced(-1.0, 1.0);
  s.measure_at(q, {.sigma = noise});
  return s.calibrated();
}

Calibration outside_the_limits() {
  Series s;
  Eigen::MatrixXd q = s.measured.joint_values;
  for (const Eigen::Index c : {2, 5, 9}) {
    q(1, c) = *s.model.joints[1].upper + 0.1;
  }
  s.measure_at(q);
  return s.calibrated();
}

Calibration with_stated_sigma(double sigma) {
  Series s;
  s.state_sigma(sigma);
  return s.calibrated();
}

const MeasuringNoise kRepeats{.sigma = 1e-5, .repeats = 5};

Calibration with_misfit() {
  Series s;
  s.measured = with_ripple(s, 0.001, kRepeats);
  return s.calibrated();
}

Calibration with_repeats() {
  Series s;
  s.measured = with_ripple(s, 0.0, kRepeats);
  return s.calibrated();
}

Calibration of_another_robot() {
  Series s;
  s.measured = with_ripple(s, 0.05, {.sigma = kNoise});
  return s.calibrated();
}

const Calibration& without_errors() {
  static const Calibration found = [] {
    Series s;
    s.robot.truth.errors.setZero();
    s.measure_at(s.measured.joint_values);
    return s.calibrated();
  }();
  return found;
}

Calibration with_test_rows_of_another_robot() {
  Series s;
  Series nominal(9);
  nominal.robot.truth.errors.setZero();
  nominal.robot.truth.X_WB = s.robot.truth.X_WB;
  nominal.robot.truth.targets = s.robot.truth.targets;
  nominal.measure_at(nominal.measured.joint_values);
  for (Observation& observation : nominal.measured.observations) {
    observation.split = Split::test;
  }
  s.measured = joined(s.measured, nominal.measured);
  return s.calibrated();
}

Calibration with_priors(double size) { return Series().calibrated({.priors = {.length = size, .angle = size}}); }

Calibration with_few_rows(int configurations) {
  Series s(4, {.sigma = kNoise}, published_targets(1));
  const Eigen::MatrixXd q = s.measured.joint_values.leftCols(configurations);
  s.measure_at(q);
  return s.calibrated();
}

// NOLINTNEXTLINE(readability-function-size): a table
std::vector<Scenario> scenarios() {
  const std::string gauge =
      R"( \(errors at zero, frames as registered\); predictions hold where it was measured, single parameters do not)";
  const auto with_sigma = [](double sigma) { return [sigma] { return with_stated_sigma(sigma); }; };
  return {
      {"clean", clean, Termination::converged, {}, {}},
      {"clean repeats", with_repeats, Termination::converged, {}, {}},
      {"noise stated as it is", with_sigma(kNoise), Termination::converged, {}, {}},
      {"noise stated too large", with_sigma(2.0 * kNoise), Termination::converged, {}, {}},
      {"noise stated a little too small", with_sigma(0.95 * kNoise), Termination::converged, {}, {}},
      {"noise stated too small",
       with_sigma(0.5 * kNoise),
       Termination::converged,
       {},
       {R"(the residuals are (1\.[89]|2\.[01])[0-9]* times the stated noise; what is beyond it counts as misfit of the model)"}},
      {"too few iterations",
       with_too_few_iterations,
       Termination::iteration_limit,
       {"not_converged"},
       {"25 of 25 leave-one-out fits did not converge"}},
      {"too few iterations, asked for the fitted rows alone",
       [] { return Series().calibrated({.iterations = 1, .held_out = false}); },
       Termination::iteration_limit,
       {"not_converged"},
       {}},
      {"held joint",
       with_a_held_joint,
       Termination::rank_deficient,
       {"not_determined"},
       {"the measurements cannot tell apart: .*dq3.*, .*Rz4.*", "fixed by gauge: .*Rz4" + gauge}},
      {"no effect of joint 6",
       without_effect_of_joint_6,
       Termination::rank_deficient,
       {"not_determined"},
       {"the measurements do not depend on dq6", "fixed by gauge: dq6" + gauge}},
      {"priors as large as the errors", [] { return with_priors(0.001); }, Termination::converged, {}, {}},
      {"priors a tenth of the errors",
       [] { return with_priors(0.0001); },
       Termination::converged,
       {},
       {"the estimated errors are [0-9.]+ times as large as the priors expect and were held too close to nominal; "
        "state "
        "larger priors, or none"}},
      {"nine residual degrees of freedom",
       [] { return with_few_rows(12); },
       Termination::converged,
       {},
       {"few data: all uncertainties rest on 9 degrees of freedom; measure more configurations or state the noise"}},
      {"twelve residual degrees of freedom", [] { return with_few_rows(13); }, Termination::converged, {}, {}},
      {"outside the limits",
       outside_the_limits,
       Termination::converged,
       {},
       {"3 of 25 configurations have joint values outside the limits of the URDF"}},
      {"misfit",
       with_misfit,
       Termination::converged,
       {},
       {"lack of fit: the residuals are larger than the scatter of the repeats explains"}},
      {"another robot",
       of_another_robot,
       Termination::converged,
       {"worse_than_nominal", "nominal_kept", "large_misfit"},
       {}},
      {"nothing to calibrate", without_errors, Termination::converged, {"worse_than_nominal", "nominal_kept"}, {}},
  };
}

std::vector<std::string> causes_of(const Calibration& found) {
  std::vector<std::string> causes;
  for (const Doubt& doubt : found.doubts) {
    causes.push_back(doubt.cause);
  }
  return causes;
}

TEST(Warnings, AreExactlyThoseOfTheCause) {
  for (const Scenario& scenario : scenarios()) {
    const Calibration found = scenario.calibrated();
    std::vector<::testing::Matcher<std::string>> expected;
    for (const std::string& pattern : scenario.warnings) {
      expected.push_back(MatchesRegex(pattern));
    }
    EXPECT_THAT(found.warnings, ElementsAreArray(expected)) << scenario.name;
    EXPECT_THAT(causes_of(found), ElementsAreArray(scenario.causes)) << scenario.name;
    EXPECT_EQ(found.identification.termination, scenario.termination) << scenario.name;
    EXPECT_EQ(found.trusted(), scenario.causes.empty()) << scenario.name;
  }
}

TEST(Warnings, OfTheRegistrationAreHandedOn) {
  for (const double noise : {0.0, kNoise}) {
    EXPECT_THAT(with_one_moving_joint(noise).warnings,
                Contains("registration: the configurations leave a rotation of the base undetermined"))
        << noise;
  }
  EXPECT_THAT(clean().warnings, Not(Contains(HasSubstr("registration"))));
}

// ---- doubts --------------------------------------------------------------------------------------------------------

/// The only doubt that `spoil` raises in a calibration that had none.
Doubt doubt_of(const std::function<void(Calibration&)>& spoil) {
  Calibration found = clean();
  EXPECT_THAT(doubts(found, clean_series().measured, {}), IsEmpty());
  spoil(found);
  const std::vector<Doubt> raised = doubts(found, clean_series().measured, {});
  EXPECT_EQ(raised.size(), 1U);
  return raised.empty() ? Doubt{} : raised.front();
}

TEST(Doubts, OnlyAConvergedFitHasNone) {
  for (const auto& [termination, cause, words] :
       {std::tuple{Termination::iteration_limit, "not_converged", "still changing after 7 iterations; allow more"},
        std::tuple{Termination::stalled, "not_converged", "no arm near the nominal one explains the measurements"},
        std::tuple{Termination::diverged, "not_converged", "errors beyond any robot's; check the robot"},
        std::tuple{Termination::rank_deficient, "not_determined", "measure more configurations"}}) {
    const Doubt doubt = doubt_of([how = termination](Calibration& found) {
      found.identification.termination = how;
      found.identification.iterations = 7;
    });
    EXPECT_EQ(doubt.cause, cause);
    EXPECT_THAT(doubt.message, HasSubstr(words));
  }
}

TEST(Doubts, NameTheJointsThatNeverMove) {
  const Calibration& found = with_a_held_joint();
  ASSERT_EQ(found.doubts.size(), 1U);
  EXPECT_THAT(found.doubts[0].message,
              MatchesRegex("the measurements do not determine [0-9]+ parameters \\(.*Rz4.*\\): "
                           "joint_4 never moves; predictions hold where .*"));
}

// 0.312 m, 1.075 m, 0.225 m and 1.28 m, 0.215 m: from joint 1 to the flange.
TEST(Doubts, AMisfitIsLargeAboveFiveMillimetres) {
  const double length = 0.312 + 1.075 + std::hypot(0.225, 1.28) + 0.215;
  EXPECT_NEAR(reach(clean_series().model), length, 1e-12);
  const auto with_rms = [](double rms) { return [rms](Calibration& found) { found.train.after.rms = rms; }; };
  const Doubt doubt = doubt_of(with_rms(0.005001));
  EXPECT_EQ(doubt.cause, "large_misfit");
  EXPECT_THAT(doubt.message, HasSubstr("a misfit of 5.001 mm is left, and an arm with a reach of 2.902 m"));
  Calibration below = clean();
  with_rms(0.004999)(below);
  EXPECT_THAT(doubts(below, clean_series().measured, {}), IsEmpty());
}

TEST(Doubts, NameAnErrorThatNoBuilderLeaves) {
  const auto with_error = [](const std::string& kind, double error, double std) {
    return [=](Calibration& found) {
      const auto parameter = std::find_if(found.parameters.begin(), found.parameters.end(), [&](const auto& p) {
        return p.kind == kind && !p.joint.empty() && !p.gauge;
      });
      ASSERT_NE(parameter, found.parameters.end());
      parameter->error = error;
      parameter->std = std;
    };
  };
  const double most = 0.02 * reach(clean_series().model);
  const Doubt length = doubt_of(with_error("translation", -1.01 * most, 1e-5));
  EXPECT_EQ(length.cause, "large_error");
  EXPECT_THAT(length.message, HasSubstr("check the URDF"));
  const Doubt offset = doubt_of(with_error("joint_offset", 20.1 * testing::kDegree, 1e-5));
  EXPECT_EQ(offset.cause, "large_error");
  EXPECT_THAT(offset.message, HasSubstr("check the mastering"));
  for (const auto& change :
       {with_error("translation", 0.99 * most, 1e-5), with_error("translation", 1.1 * most, 0.05 * most),
        with_error("rotation", 19.9 * testing::kDegree, 1e-5)}) {
    Calibration found = clean();
    change(found);
    EXPECT_THAT(doubts(found, clean_series().measured, {}), IsEmpty());
  }
}

TEST(Doubts, CompareTestRowsWithWhatWasHeldOut) {
  const auto with_test = [](double before, double after) {
    return [=](Calibration& found) {
      found.leave_one_out = BeforeAfter{};
      found.leave_one_out->before = {.count = 30, .rms = 0.001};
      found.leave_one_out->after = {.count = 30, .rms = 0.0001};
      found.test = BeforeAfter{};
      found.test->before = {.count = 30, .rms = before};
      found.test->after = {.count = 30, .rms = after};
    };
  };
  EXPECT_EQ(doubt_of(with_test(2.000079, 2.000044)).cause, "test_rows_differ");
  for (const auto& change : {with_test(0.001, 0.0004), with_test(0.0011, 0.0001), with_test(0.0005, 0.00045)}) {
    Calibration found = clean();
    change(found);
    EXPECT_THAT(doubts(found, clean_series().measured, {}), IsEmpty());
  }
}

// The slide of the odd arm moves from -0.5 to 0.5 m.
TEST(Doubts, SlidesAddToTheReach) {
  const ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  double length = model.tip_origin.p.Norm() + 1.0;
  for (std::size_t i = 1; i < model.joints.size(); ++i) {
    length += model.joints[i].origin.p.Norm();
  }
  EXPECT_NEAR(reach(model), length, 1e-12);
}

TEST(Doubts, AreRaisedByPredictionsThatAreWorseThanNominal) {
  const Doubt test =
      doubt_of([](Calibration& found) { found.test = {.before = {.rms = 1e-3}, .after = {.rms = 2e-3}}; });
  EXPECT_EQ(test.cause, "worse_than_nominal");
  EXPECT_THAT(test.message, HasSubstr("no better than the nominal one at the test rows: 2 mm against 1 mm"));
  const Measurements& measured = clean_series().measured;
  Calibration found = clean();
  found.leave_one_out->before.rms = 7.9e-3;
  found.leave_one_out->after.rms = 15.9e-3;
  const std::vector<Doubt> raised = doubts(found, measured, {});
  ASSERT_EQ(raised.size(), 2U);
  EXPECT_THAT(raised[0].message, HasSubstr("not fitted (leave-one-out): 15.9 mm against 7.9 mm"));
  EXPECT_EQ(raised[1].cause, "nominal_kept");
  found.k_fold = found.leave_one_out;
  found.leave_one_out.reset();
  found.folds = 10;
  EXPECT_THAT(doubts(found, measured, {}).at(0).message, HasSubstr("not fitted (10-fold): 15.9 mm"));
}

TEST(Doubts, AreRaisedByTestRowsOfAnotherRobot) {
  EXPECT_THAT(causes_of(with_test_rows_of_another_robot()), ElementsAreArray({"worse_than_nominal"}));
}

TEST(Doubts, AreRaisedByALengthThatIsKnownNoBetterThanItsLink) {
  const auto with_std = [](double std) {
    return [std](Calibration& found) {
      for (ParameterEstimate& parameter : found.parameters) {
        parameter.std = parameter.name == "Tz2" ? std : parameter.std;
      }
    };
  };
  const Doubt doubt = doubt_of(with_std(1.0751));  // of link 2, 1.075 m
  EXPECT_EQ(doubt.cause, "unknown_length");
  EXPECT_THAT(doubt.message, HasSubstr("exceeds the link itself for Tz2;"));
  Calibration known = clean();
  with_std(1.0749)(known);
  EXPECT_THAT(doubts(known, clean_series().measured, {}), IsEmpty());
}

TEST(Doubts, AreNotRaisedByTheCompleteModelOfGoodData) {
  const Calibration found = Series().calibrated({.model = ModelChoice::complete});
  EXPECT_THAT(causes_of(found), IsEmpty());
  EXPECT_EQ(found.identification.termination, Termination::converged);
  EXPECT_THAT(found.fixed_by_gauge, Not(IsEmpty()));
}

TEST(Doubts, WhereNothingIsGainedTheUrdfIsTheOneThatWasRead) {
  const Robot robot = fanuc();
  const Calibration& found = without_errors();
  EXPECT_TRUE(found.exported.nominal_kept);
  EXPECT_TRUE(calibrated_urdf(robot, found) == robot.urdf);
  EXPECT_EQ(found.exported.train.rms, found.train.before.rms);
  EXPECT_EQ(found.exported.held_out->rms, found.leave_one_out->before.rms);
  EXPECT_EQ(found.exported.iso.accuracy.rms, found.iso_before.accuracy.rms);
  EXPECT_TRUE(found.exported.estimate.errors.isZero(0.0));
  const Calibration& gained = clean();
  EXPECT_FALSE(gained.exported.nominal_kept);
  EXPECT_TRUE(calibrated_urdf(robot, gained) ==
              calibrated_urdf(robot, gained.model, gained.identification.estimate.errors));
  EXPECT_EQ(gained.exported.train.rms, gained.train.after.rms);
}

// ---- what is held out where nobody says ----------------------------------------------------------------------------

TEST(HeldOut, IsLeaveOneOutAndTenFoldsOfMany) {
  Series s(1, {.sigma = kNoise}, published_targets(2));
  const Calibration asked = s.calibrated({.leave_one_out = true, .try_readings = false});
  const Calibration not_asked = s.calibrated({.try_readings = false});
  ASSERT_TRUE(asked.leave_one_out && not_asked.leave_one_out);
  EXPECT_EQ(not_asked.leave_one_out->after.rms, asked.leave_one_out->after.rms);
  EXPECT_FALSE(not_asked.k_fold);
  EXPECT_EQ(not_asked.held_out()->after.count, 50);
  s = Series(1, {.sigma = kNoise}, published_targets(1));
  constexpr int kMost = static_cast<int>(kMostLeftOutSingly);
  for (const auto& [count, singly] : {std::pair{kMost, true}, std::pair{kMost + 1, false}}) {
    s.measure_at(s.configurations(count));
    const Calibration found = s.calibrated({.try_readings = false});
    EXPECT_EQ(found.leave_one_out.has_value(), singly) << count;
    EXPECT_EQ(found.k_fold.has_value(), !singly) << count;
    EXPECT_EQ(found.folds, singly ? 0 : 10) << count;
    EXPECT_EQ(found.held_out()->after.count, count) << count;
    EXPECT_EQ(found.influence.configurations.size(), singly ? static_cast<std::size_t>(count) : 0U) << "one by one";
  }
}

TEST(HeldOut, IsKFoldAloneWhereThatIsAskedFor) {
  const Calibration found = Series().calibrated({.k_fold = 5});
  EXPECT_FALSE(found.leave_one_out);
  ASSERT_TRUE(found.k_fold);
  EXPECT_EQ(found.folds, 5);
  EXPECT_EQ(found.k_fold->before.count, 75);
  EXPECT_EQ(found.held_out(), &*found.k_fold);
  EXPECT_EQ(Series().calibrated({.held_out = false}).held_out(), nullptr);
}

// Nine points determine 27 parameters and leave nothing to tell whether they are right.
TEST(HeldOut, IsNothingWhereTheRestWouldNotSuffice) {
  Series s(1, {.sigma = kNoise}, published_targets(1));
  const Eigen::MatrixXd q = s.measured.joint_values;
  for (const auto& [count, enough] : {std::pair{9, false}, std::pair{10, true}}) {
    s.measure_at(q.leftCols(count));
    const Calibration found = s.calibrated();
    EXPECT_EQ(found.held_out() != nullptr, enough) << count;
    EXPECT_EQ(std::count_if(found.warnings.begin(), found.warnings.end(),
                            [](const std::string& warning) { return warning.rfind("too few measurements", 0) == 0; }),
              enough ? 0 : 1)
        << count;
  }
}

TEST(HeldOut, ReportsEachFitAndWhatItIsFor) {
  std::vector<std::string> reported;
  CalibrationOptions options{.k_fold = 3, .threads = 1};
  options.leave_one_out = true;
  options.progress = [&](const std::string& what, std::size_t done, std::size_t of) {
    reported.push_back(what + " " + std::to_string(done) + "/" + std::to_string(of));
  };
  Series().calibrated(options);
  ASSERT_EQ(reported.size(), 28U);
  EXPECT_EQ(reported[11], "leave-one-out 12/25");
  EXPECT_EQ(reported.back(), "3-fold 3/3");
}

TEST(HeldOut, ReportsWhichModelIsTried) {
  std::vector<std::string> reported;
  CalibrationOptions options{.threads = 1};
  options.automatic_priors = true;
  options.effects.automatic = true;
  options.progress = [&](const std::string& what, std::size_t done, std::size_t of) {
    if (done == of) {
      reported.push_back(what);
    }
  };
  const Calibration found = Series().calibrated(options);
  ASSERT_GE(reported.size(), 3U);
  EXPECT_EQ(reported[0], "trying geometry alone");
  EXPECT_EQ(reported[1], "trying geometry alone with priors");
  EXPECT_EQ(reported.back(), "leave-one-out");
  const auto predicted = std::count_if(found.tried.begin(), found.tried.end(),
                                       [](const ModelOption& option) { return std::isfinite(option.held_out_rms); });
  EXPECT_EQ(static_cast<std::ptrdiff_t>(reported.size()) - 1, predicted);
}

// ---- numbers of warnings -------------------------------------------------------------------------------------------

TEST(Warnings, NumbersOfTheNoiseAreThoseOfTheResult) {
  const Calibration noisy = with_stated_sigma(0.5 * kNoise);
  EXPECT_NEAR(std::stod(noisy.warnings.at(0).substr(std::string("the residuals are ").size())),
              std::sqrt(noisy.noise.variance_factor), 0.001);
}

TEST(Warnings, LimitsOfJointsAreWithinThem) {
  const Series s;
  const JointRanges limits = limits_of(s.model.joints);
  Measurements measured = s.measured;
  for (std::size_t joint = 0; joint < 6; ++joint) {
    for (const bool upper : {false, true}) {
      const double limit = upper ? limits[joint].second : limits[joint].first;
      const auto outside = [&](double beyond) {
        measured.joint_values = s.measured.joint_values;
        measured.joint_values(static_cast<Eigen::Index>(joint), 4) = limit + (upper ? beyond : -beyond);
        return configurations_outside_limits(s.model, measured);
      };
      EXPECT_EQ(outside(0.0), 0) << joint << upper;
      EXPECT_EQ(outside(5e-10), 0) << joint << upper;  // as text with ten digits reads
      EXPECT_EQ(outside(2e-9), 1) << joint << upper;
    }
  }
}

TEST(Warnings, LackOfFitIsWhatHappensOnceInAThousandTimes) {
  const Series s;
  double above = 1.0;  // p-values that did not warn and that did, on both sides of the limit
  double below = 0.0;
  double quiet = 3e-6;  // [rad]
  double loud = 4.5e-6;
  for (int halving = 0; halving < 6; ++halving) {
    const double amplitude = 0.5 * (quiet + loud);
    const Calibration found =
        calibrate(s.model, with_ripple(s, amplitude, kRepeats), {.held_out = false, .try_readings = false});
    const double p = found.lack_of_fit.value().p_value;
    const bool warned = std::any_of(found.warnings.begin(), found.warnings.end(), [](const std::string& warning) {
      return warning.find("lack of fit") != std::string::npos;
    });
    EXPECT_EQ(warned, p < 1e-3) << p;
    (warned ? below : above) = p;
    (warned ? loud : quiet) = amplitude;
  }
  EXPECT_LT(above, 1.2e-3);
  EXPECT_GT(below, 0.9e-3);
}

TEST(Warnings, ScaledNoiseIsWhatHappensOnceInAThousandTimes) {
  const Series& s = clean_series();
  const Calibration& plain = clean();
  const double freedom = plain.noise.degrees_of_freedom;
  for (const double chance : {1.05e-3, 0.95e-3}) {
    const double factor = f_critical(chance, freedom, 1e9);  // the residuals' mean square in units of the stated one
    Series stated = s;
    stated.state_sigma(plain.noise.sigma / std::sqrt(factor));
    const Calibration found = stated.calibrated({.held_out = false, .try_readings = false});
    const double p = f_upper_tail(factor, freedom, 1e9);  // that of a chi-squared distribution
    ASSERT_NEAR(p, chance, 1e-6);
    const bool warned = !found.warnings.empty();
    EXPECT_EQ(warned, p < 1e-3) << p;
    EXPECT_NEAR(found.noise.variance_factor, warned ? factor : 1.0, 1e-6) << p;
  }
}

// ---- findings ------------------------------------------------------------------------------------------------------

struct Defect {
  QualityKind kind;
  std::function<void(Series&)> put_into;
  const char* message;  // regular expression
};

std::vector<Defect> defects() {
  return {{QualityKind::slipped_target,
           [](Series& s) {
             const auto poses = flange_poses(s.model, s.robot.truth, s.measured.joint_values);
             for (int c = 13; c <= 25; ++c) {
               s.row(c, 2).position += s.robot.truth.X_WB.linear() * poses[static_cast<std::size_t>(c - 1)].linear() *
                                       Eigen::Vector3d(0.0, 0.002, 0.0);
             }
           },
           "target C slipped by about 2.0 mm after configuration 12"},
          {QualityKind::swapped_targets, [](Series& s) { std::swap(s.row(7, 0).position, s.row(7, 1).position); },
           "targets A and B are swapped in configuration 7"},
          {QualityKind::mistaken_target, [](Series& s) { s.row(5, 1).position = s.row(5, 2).position; },
           "target B in configuration 5 lies where target C is"},
          {QualityKind::mistyped_coordinate, [](Series& s) { s.row(9, 2).position.z() -= 0.01; },
           "target C in configuration 9, repeat 1: z is off by about -10.0 mm"},
          {QualityKind::displaced_point, [](Series& s) { s.row(9, 2).position += Eigen::Vector3d(0.003, 0.0, -0.004); },
           "target C in configuration 9, repeat 1 is off by about 5.0 mm"},
          {QualityKind::displaced_configuration, [](Series& s) { s.measured.joint_values(1, 7) += 2.0 * kDegree; },
           "targets A, B and C in configuration 8 are off by up to [0-9.]+ mm; are its joint values right\\?"}};
}

TEST(Warnings, NameEachKindOfDefectOfTheMeasurements) {
  EXPECT_THAT(clean().findings, IsEmpty());
  for (const Defect& defect : defects()) {
    Series s;
    defect.put_into(s);
    const Calibration found = s.calibrated({.loss = Loss::tukey, .held_out = false});
    std::vector<::testing::Matcher<std::string>> expected = {
        MatchesRegex(std::string("measurements: ") + defect.message)};
    EXPECT_THAT(found.warnings, ElementsAreArray(expected)) << to_string(defect.kind);
    ASSERT_EQ(found.findings.size(), 1U) << to_string(defect.kind);
    EXPECT_EQ(found.findings[0].kind, defect.kind) << to_string(defect.kind);
    EXPECT_THAT(found.findings[0].message, MatchesRegex(defect.message));
    // A loss keeps the row from the fit, and what it leaves of the row is no misfit of the arm.
    EXPECT_THAT(causes_of(found), IsEmpty()) << to_string(defect.kind);
  }
}

TEST(Warnings, KindsOfFindingsHaveTheNamesOfTheResult) {
  EXPECT_EQ(to_string(QualityKind::slipped_target), "slipped_target");
  EXPECT_EQ(to_string(QualityKind::swapped_targets), "swapped_targets");
  EXPECT_EQ(to_string(QualityKind::mistaken_target), "mistaken_target");
  EXPECT_EQ(to_string(QualityKind::mistyped_coordinate), "mistyped_coordinate");
  EXPECT_EQ(to_string(QualityKind::displaced_point), "displaced_point");
  EXPECT_EQ(to_string(QualityKind::displaced_configuration), "displaced_configuration");
}

TEST(Warnings, OfMoreThanTwentyThousandRowsComeFromDistancesAlone) {
  Series s(4, {.sigma = kNoise}, published_targets(4));
  s.measure_at(s.measured.joint_values, {.sigma = kNoise, .repeats = 200});
  ASSERT_EQ(s.measured.observations.size(), 20000U);
  s.measured.observations[401].position.x() += 0.03;
  for (const bool many : {false, true}) {
    if (many) {
      Observation more = s.measured.observations.back();
      more.repeat = 201;
      s.measured.observations.push_back(more);
    }
    const Calibration found = s.calibrated({.held_out = false, .try_readings = false});
    ASSERT_EQ(found.findings.size(), 1U);
    EXPECT_EQ(found.findings[0].kind, many ? QualityKind::displaced_point : QualityKind::mistyped_coordinate);
  }
}

// ---- how a fit can end ---------------------------------------------------------------------------------------------

Unknowns irreducible(const Series& s) {
  return Unknowns(s.model, s.robot.truth.targets, reduced_model(s.model, s.robot.truth.targets).kept);
}

void expect_end(const Identification& fit, Termination termination, const std::string& name,
                const std::string& message) {
  EXPECT_EQ(to_string(fit.termination), name);
  EXPECT_EQ(fit.termination, termination) << name;
  EXPECT_EQ(fit.message, message) << name;
}

TEST(Terminations, SayHowTheJointFitEnded) {
  Series s;
  const Estimate start = nominal_start(s.model, s.measured);
  const Unknowns free = irreducible(s);
  expect_end(identify_jointly(s.model, s.measured, start, free), Termination::converged, "converged",
             "the last step moved the predicted points by less than the tolerance");
  expect_end(identify_jointly(s.model, s.measured, start, free, {.max_iterations = 2}), Termination::iteration_limit,
             "iteration_limit", "still moving after 2 iterations");
  expect_end(identify_jointly(s.model, s.measured, start, free, {.step_tolerance = 0.0}), Termination::converged,
             "converged", "no step can reduce the misfit by more than its rounding");
  std::vector<std::string> names = free.names();
  names.emplace_back("dq1");
  const Unknowns with_gauge(s.model, start.targets, names);
  expect_end(identify_jointly(s.model, s.measured, start, with_gauge), Termination::rank_deficient, "rank_deficient",
             "converged, but the measurements do not determine all parameters");
  s.measured.observations[10].position.x() = 1e200;  // finite, its square is not
  expect_end(identify_jointly(s.model, s.measured, start, free), Termination::diverged, "diverged",
             "the misfit is no longer finite");
}

/// A robot whose one true error is of that size, and a fit that begins there.
void expect_fit_from_truth(Series& s, const std::string& name, double error, const std::string& ran_away) {
  s.robot.truth.errors.setZero();
  s.robot.truth.errors[static_cast<Eigen::Index>(parameter_index(s.model, name))] = error;
  s.measure_at(s.measured.joint_values, {.sigma = 0.0});
  const Identification fit = identify_jointly(s.model, s.measured, s.robot.truth, irreducible(s));
  EXPECT_EQ(fit.termination, ran_away.empty() ? Termination::converged : Termination::diverged)
      << error << ", " << fit.message;
  if (ran_away.empty()) {
    EXPECT_THAT(fit.message, ::testing::Not(::testing::HasSubstr("ran away")));
  } else {
    EXPECT_EQ(fit.message, "the fit ran away: " + ran_away);
  }
}

TEST(Terminations, AnAngleOfMoreThanARadianHasRunAway) {
  Series s(5, {.sigma = 0.0});
  expect_fit_from_truth(s, "dq3", 0.97, "");
  expect_fit_from_truth(s, "dq3", 1.03, "an angle is off by more than a radian");
}

TEST(Terminations, ALengthOfMoreThanHalfTheArmHasRunAway) {
  Series s(5, {.sigma = 0.0});
  double arm = s.model.tip_origin.p.Norm();  // [m]
  for (const MovingJoint& joint : s.model.joints) {
    arm += joint.origin.p.Norm();
  }
  expect_fit_from_truth(s, "Tz2", -0.48 * arm, "");
  expect_fit_from_truth(s, "Tz2", -0.52 * arm, "a length is off by more than half the arm");
}

TEST(Terminations, PointsInFeetRunAway) {
  Series s(5, {.sigma = 3e-5});
  for (Observation& observation : s.measured.observations) {
    observation.position /= 0.3048;
  }
  const Identification fit = identify_jointly(s.model, s.measured, nominal_start(s.model, s.measured), irreducible(s));
  EXPECT_EQ(fit.termination, Termination::diverged) << fit.message;
  EXPECT_EQ(fit.message, "the fit ran away: a length is off by more than half the arm");
}

TEST(Terminations, SayHowTheTwoStepsEnded) {
  const Series s;
  const Estimate start = nominal_start(s.model, s.measured);
  const std::vector<std::size_t> geometric = irreducible(s).geometric();
  const auto same = [&](int) { return s.measured; };
  expect_end(identify_in_two_steps(s.model, same, start, geometric, {.rounds = 1000}), Termination::converged,
             "converged", "the last round moved the predicted points by less than the tolerance");
  expect_end(identify_in_two_steps(s.model, same, start, geometric, {.rounds = 3}), Termination::iteration_limit,
             "iteration_limit", "still moving after 3 rounds");
  Measurements broken = s.measured;
  broken.observations[0].position.x() = 1e200;
  expect_end(identify_in_two_steps(
                 s.model, [&](int) { return broken; }, start, geometric),
             Termination::diverged, "diverged", "the misfit is no longer finite");
}

}  // namespace
}  // namespace kdl_calibration::warnings_test
