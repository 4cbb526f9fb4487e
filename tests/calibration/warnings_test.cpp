// Everything that a calibration can warn of: each warning has a case in which it appears, and in every other case it
// does not, because all warnings of each case are expected.

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "base/f_distribution.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/simulation.hpp"
#include "support.hpp"

namespace kdl_calibration {
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
struct Series {
  ErrorModel model = complete_model(fanuc());
  VirtualRobot truth;
  Random random;
  Measurements measured;

  explicit Series(std::uint64_t seed = 1, const MeasuringNoise& noise = {.sigma = kNoise},
                  const std::vector<TargetFrame>& targets = published_targets())
      : random(seed) {
    const FreeParameters free = free_parameters(model, targets, reduced_model(model, targets).kept);
    truth = virtual_robot(model, free.geometric, targets, {.length = 0.001, .angle = 0.001}, random);
    measure_at(random_configurations(limits_of(model.joints), 25, random), noise);
  }

  void measure_at(const Eigen::MatrixXd& q, const MeasuringNoise& noise = {.sigma = kNoise}) {
    measured = measure(truth, q, noise, random);
    state_sigma(0.0);
  }

  void state_sigma(double sigma) {
    for (Observation& observation : measured.observations) {
      observation.sigma = sigma;
    }
  }

  /// Of targets 0, 1, 2 in configurations 1, 2, …
  Observation& row(int configuration, int target) {
    return measured.observations.at(static_cast<std::size_t>(3 * (configuration - 1) + target));
  }

  Calibration calibrated(const CalibrationOptions& options = {}) const { return calibrate(model, measured, options); }
};

// An encoder of joint 3 that is off by `amplitude` twice per turn, which no geometry explains.
Measurements with_ripple(const Series& clean, double amplitude, const MeasuringNoise& noise) {
  Random random(7);
  const Eigen::MatrixXd q = clean.measured.joint_values;
  Eigen::MatrixXd off = q;
  off.row(2).array() += amplitude * (2.0 * q.row(2).array()).sin();
  Measurements measured = measure(clean.truth, off, noise, random);
  measured.joint_values = q;
  for (Observation& observation : measured.observations) {
    observation.sigma = 0.0;
  }
  return measured;
}

// ---- each warning --------------------------------------------------------------------------------------------------

struct Scenario {
  const char* name;
  std::function<Calibration()> calibrated;
  Termination termination;
  bool trusted;
  std::vector<std::string> warnings;  // extended regular expressions of all of them, in their order
};

Calibration clean() { return Series().calibrated(); }

Calibration with_too_few_iterations() { return Series().calibrated({.iterations = 1}); }

Calibration with_a_held_joint() {
  Series s;
  Eigen::MatrixXd q = s.measured.joint_values;
  q.row(3).setConstant(0.6);
  s.measure_at(q);
  return s.calibrated();
}

// The only target sits on the axis of joint 6, and stays there.
Calibration without_effect_of_joint_6() {
  const std::vector<TargetFrame> targets = testing::targets_at({{0.0, 0.1, 0.0}});
  Series s(2, {.sigma = kNoise}, targets);
  s.truth.truth.targets = targets;
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

std::vector<Scenario> scenarios() {
  const std::string number = "[0-9.e-]+";
  const std::string not_trusted = "the answer is not to be trusted: ";
  const std::string gauge =
      R"( \(errors at zero, frames as registered\); predictions hold where it was measured, single parameters do not)";
  return {
      {"clean", clean, Termination::converged, true, {}},
      {"clean repeats", with_repeats, Termination::converged, true, {}},
      {"noise stated as it is", [] { return with_stated_sigma(kNoise); }, Termination::converged, true, {}},
      {"noise stated too large", [] { return with_stated_sigma(2.0 * kNoise); }, Termination::converged, true, {}},
      {"noise stated a little too small",
       [] { return with_stated_sigma(0.95 * kNoise); },
       Termination::converged,
       true,
       {}},
      {"noise stated too small",
       [] { return with_stated_sigma(0.5 * kNoise); },
       Termination::converged,
       true,
       {R"(the residuals are (1\.[89]|2\.[01])[0-9]* times the stated noise; the uncertainties were scaled up by that)"}},
      {"too few iterations",
       with_too_few_iterations,
       Termination::iteration_limit,
       false,
       {not_trusted + "still moving after 1 iterations"}},
      {"too few iterations, left out",
       [] { return Series().calibrated({.iterations = 1, .leave_one_out = true}); },
       Termination::iteration_limit,
       false,
       {"25 of 25 leave-one-out fits did not converge", not_trusted + "still moving after 1 iterations"}},
      {"left out", [] { return Series().calibrated({.leave_one_out = true}); }, Termination::converged, true, {}},
      {"held joint",
       with_a_held_joint,
       Termination::rank_deficient,
       false,
       {not_trusted + "converged, but the measurements do not determine all parameters: [0-9]+ were fixed by gauge",
        "the measurements cannot tell apart: .*dq3.*, .*Rz4.*", "fixed by gauge: .*Rz4" + gauge}},
      {"no effect of joint 6",
       without_effect_of_joint_6,
       Termination::rank_deficient,
       false,
       {not_trusted + "converged, but the measurements do not determine all parameters: 1 were fixed by gauge",
        "the measurements do not depend on dq6", "fixed by gauge: dq6" + gauge}},
      {"outside the limits",
       outside_the_limits,
       Termination::converged,
       true,
       {"3 of 25 configurations have joint values outside the limits of the URDF"}},
      {"misfit",
       with_misfit,
       Termination::converged,
       true,
       {"lack of fit: the residuals are larger than the scatter of the repeats explains"}},
      {"absurd misfit",
       of_another_robot,
       Termination::converged,
       false,
       {"a misfit of " + number + " mm is more than geometric errors explain; is the joint convention right\\?"}},
  };
}

TEST(Warnings, AreExactlyThoseOfTheCause) {
  for (const Scenario& scenario : scenarios()) {
    const Calibration found = scenario.calibrated();
    std::vector<::testing::Matcher<std::string>> expected;
    for (const std::string& pattern : scenario.warnings) {
      expected.push_back(MatchesRegex(pattern));
    }
    EXPECT_THAT(found.warnings, ElementsAreArray(expected)) << scenario.name;
    EXPECT_EQ(found.identification.termination, scenario.termination) << scenario.name;
    EXPECT_EQ(found.trusted(), scenario.trusted) << scenario.name;
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

TEST(Warnings, OnlyAConvergedFitIsTrusted) {
  Calibration found;
  for (const auto& [termination, trusted] :
       {std::pair{Termination::converged, true}, std::pair{Termination::iteration_limit, false},
        std::pair{Termination::stalled, false}, std::pair{Termination::rank_deficient, false},
        std::pair{Termination::diverged, false}}) {
    found.identification.termination = termination;
    EXPECT_EQ(found.trusted(), trusted) << to_string(termination);
  }
}

TEST(Warnings, LargeMisfitsAreThoseAboveFiveMillimetres) {
  Calibration found;
  found.identification.termination = Termination::converged;
  for (const auto& [rms, absurd] : {std::pair{0.0, false}, std::pair{0.005, false}, std::pair{0.0050001, true}}) {
    found.train.after.rms = rms;
    EXPECT_EQ(found.absurd(), absurd) << rms;
    EXPECT_EQ(found.trusted(), !absurd) << rms;
  }
}

TEST(Warnings, NumbersOfMisfitAndNoiseAreThoseOfTheResult) {
  const Calibration other = of_another_robot();
  EXPECT_NEAR(std::stod(other.warnings.at(0).substr(std::string("a misfit of ").size())), other.train.after.rms * 1e3,
              0.001 * other.train.after.rms * 1e3);
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
  double quiet = 0.0;  // [rad]
  double loud = 3e-5;
  for (int halving = 0; halving < 10; ++halving) {
    const double amplitude = 0.5 * (quiet + loud);
    const Calibration found = calibrate(s.model, with_ripple(s, amplitude, kRepeats));
    const double p = found.lack_of_fit.value().p_value;
    const bool warned = std::any_of(found.warnings.begin(), found.warnings.end(), [](const std::string& warning) {
      return warning.find("lack of fit") != std::string::npos;
    });
    EXPECT_EQ(warned, p < 1e-3) << p;
    (warned ? below : above) = p;
    (warned ? loud : quiet) = amplitude;
  }
  EXPECT_LT(above, 1.1e-3);
  EXPECT_GT(below, 0.9e-3);
}

TEST(Warnings, ScaledNoiseIsWhatHappensOnceInAThousandTimes) {
  const Series s;
  double above = 1.0;
  double below = 0.0;
  const Calibration plain = calibrate(s.model, s.measured);
  const double freedom = plain.noise.degrees_of_freedom;
  double quiet = 1.0;  // the residuals' mean square in units of the stated one
  double loud = 1.45;
  for (int halving = 0; halving < 10; ++halving) {
    const double factor = 0.5 * (quiet + loud);
    Series stated = s;
    stated.state_sigma(plain.noise.sigma / std::sqrt(factor));
    const Calibration found = stated.calibrated();
    const double p = f_upper_tail(factor, freedom, 1e9);  // that of a chi-squared distribution
    const bool warned = !found.warnings.empty();
    EXPECT_EQ(warned, p < 1e-3) << p;
    EXPECT_NEAR(found.noise.variance_factor, warned ? factor : 1.0, 1e-6) << p;
    (warned ? below : above) = p;
    (warned ? loud : quiet) = factor;
  }
  EXPECT_LT(above, 1.1e-3);
  EXPECT_GT(below, 0.9e-3);
}

// ---- findings ------------------------------------------------------------------------------------------------------

struct Defect {
  QualityKind kind;
  std::function<void(Series&)> put_into;
  const char* message;  // regular expression
  bool absurd = false;  // the rows themselves, which the fit ignores, count among the misfit
};

std::vector<Defect> defects() {
  return {{QualityKind::slipped_target,
           [](Series& s) {
             const auto poses = flange_poses(s.model, s.truth.truth, s.measured.joint_values);
             for (int c = 13; c <= 25; ++c) {
               s.row(c, 2).position += s.truth.truth.X_WB.linear() * poses[static_cast<std::size_t>(c - 1)].linear() *
                                       Eigen::Vector3d(0.0, 0.002, 0.0);
             }
           },
           "target C slipped by about 2.0 mm after configuration 12"},
          {QualityKind::swapped_targets, [](Series& s) { std::swap(s.row(7, 0).position, s.row(7, 1).position); },
           "targets A and B are swapped in configuration 7", true},
          {QualityKind::mistaken_target, [](Series& s) { s.row(5, 1).position = s.row(5, 2).position; },
           "target B in configuration 5 lies where target C is", true},
          {QualityKind::mistyped_coordinate, [](Series& s) { s.row(9, 2).position.z() -= 0.01; },
           "target C in configuration 9, repeat 1: z is off by about -10.0 mm"},
          {QualityKind::displaced_point, [](Series& s) { s.row(9, 2).position += Eigen::Vector3d(0.003, 0.0, -0.004); },
           "target C in configuration 9, repeat 1 is off by about 5.0 mm"},
          {QualityKind::displaced_configuration, [](Series& s) { s.measured.joint_values(1, 7) += 2.0 * kDegree; },
           "targets A, B and C in configuration 8 are off by up to [0-9.]+ mm; are its joint values right\\?", true}};
}

TEST(Warnings, NameEachKindOfDefectOfTheMeasurements) {
  EXPECT_THAT(clean().findings, IsEmpty());
  for (const Defect& defect : defects()) {
    Series s;
    defect.put_into(s);
    const Calibration found = s.calibrated({.loss = Loss::tukey});
    std::vector<::testing::Matcher<std::string>> expected = {
        MatchesRegex(std::string("measurements: ") + defect.message)};
    if (defect.absurd) {
      expected.push_back(HasSubstr("is more than geometric errors explain"));
    }
    EXPECT_THAT(found.warnings, ElementsAreArray(expected)) << to_string(defect.kind);
    ASSERT_EQ(found.findings.size(), 1U) << to_string(defect.kind);
    EXPECT_EQ(found.findings[0].kind, defect.kind) << to_string(defect.kind);
    EXPECT_THAT(found.findings[0].message, MatchesRegex(defect.message));
    EXPECT_EQ(found.trusted(), !defect.absurd) << to_string(defect.kind);
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
  for (const bool many : {false, true}) {
    Series s(4, {.sigma = kNoise}, published_targets(4));
    s.measure_at(s.measured.joint_values, {.sigma = kNoise, .repeats = 200});
    ASSERT_EQ(s.measured.observations.size(), 20000U);
    s.measured.observations[401].position.x() += 0.03;
    if (many) {
      Observation more = s.measured.observations.back();
      more.repeat = 201;
      s.measured.observations.push_back(more);
    }
    const Calibration found = s.calibrated();
    ASSERT_EQ(found.findings.size(), 1U);
    EXPECT_EQ(found.findings[0].kind, many ? QualityKind::displaced_point : QualityKind::mistyped_coordinate);
  }
}

// ---- how a fit can end ---------------------------------------------------------------------------------------------

FreeParameters irreducible(const Series& s) {
  return free_parameters(s.model, s.truth.truth.targets, reduced_model(s.model, s.truth.truth.targets).kept);
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
  const FreeParameters free = irreducible(s);
  expect_end(identify_jointly(s.model, s.measured, start, free), Termination::converged, "converged",
             "the last step moved the predicted points by less than the tolerance");
  expect_end(identify_jointly(s.model, s.measured, start, free, {.max_iterations = 2}), Termination::iteration_limit,
             "iteration_limit", "still moving after 2 iterations");
  expect_end(identify_jointly(s.model, s.measured, start, free, {.step_tolerance = 0.0}), Termination::converged,
             "converged", "no step can reduce the misfit by more than its rounding");
  FreeParameters with_gauge = free;
  with_gauge.geometric.push_back(parameter_index(s.model, "dq1"));
  expect_end(identify_jointly(s.model, s.measured, start, with_gauge), Termination::rank_deficient, "rank_deficient",
             "converged, but the measurements do not determine all parameters");
  s.measured.observations[10].position.x() = std::numeric_limits<double>::infinity();
  expect_end(identify_jointly(s.model, s.measured, start, free), Termination::diverged, "diverged",
             "the misfit is no longer finite");
}

TEST(Terminations, AnAngleOfMoreThanARadianHasRunAway) {
  Series s(5, {.sigma = 0.0});
  const FreeParameters free = irreducible(s);
  for (const auto& [angle, termination] :
       {std::pair{0.97, Termination::converged}, std::pair{1.03, Termination::diverged}}) {
    s.truth.truth.errors.setZero();
    s.truth.truth.errors[static_cast<Eigen::Index>(parameter_index(s.model, "dq3"))] = angle;
    s.measure_at(s.measured.joint_values, {.sigma = 0.0});
    const Identification fit = identify_jointly(s.model, s.measured, s.truth.truth, free);
    EXPECT_EQ(fit.termination, termination) << angle << ", " << fit.message;
    EXPECT_EQ(fit.message == "the fit ran away: an angle is off by more than a radian",
              termination == Termination::diverged)
        << fit.message;
  }
}

TEST(Terminations, SayHowTheTwoStepsEnded) {
  const Series s;
  const Estimate start = nominal_start(s.model, s.measured);
  const std::vector<std::size_t> geometric = irreducible(s).geometric;
  const auto same = [&](int) { return s.measured; };
  expect_end(identify_in_two_steps(s.model, same, start, geometric, {.rounds = 1000}), Termination::converged,
             "converged", "the last round moved the predicted points by less than the tolerance");
  expect_end(identify_in_two_steps(s.model, same, start, geometric, {.rounds = 3}), Termination::iteration_limit,
             "iteration_limit", "still moving after 3 rounds");
  Measurements broken = s.measured;
  broken.observations[0].position.x() = std::numeric_limits<double>::quiet_NaN();
  expect_end(identify_in_two_steps(
                 s.model, [&](int) { return broken; }, start, geometric),
             Termination::diverged, "diverged", "the misfit is no longer finite");
}

}  // namespace
}  // namespace kdl_calibration
