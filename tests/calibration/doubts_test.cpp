// What a finished calibration is doubted for and what is said beside that: of calibrations that are made up, on both
// sides of each threshold; then of measured arms.

#include "calibration/doubts.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <string>
#include <utility>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "calibration/validation_stage.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "mistake_table.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "planning/simulation.hpp"
#include "results/calibrated_urdf.hpp"
#include "support.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::doubts_test {
namespace {

using ::testing::Contains;
using testing::fanuc;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// A calibration of the FANUC of which there is nothing to say.
struct Found {
  CalibrationResult calibration;
  Measurements measured;
  CalibrationSettings options;

  Found() {
    calibration.model = complete_model(testing::fanuc());
    calibration.fit.identification.termination = Termination::converged;
    calibration.fit.identification.estimate.errors = testing::errors_of(calibration.model);
    calibration.accuracy.train = {.before = {.count = 9, .rms = 2e-3}, .after = {.count = 9, .rms = 1e-4}};
    calibration.uncertainty.predicted.measured.count = 3;
    calibration.noise.source = NoiseSource::parts;
    calibration.noise.degrees_of_freedom = 100.0;
    measured.joints = {"joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"};
    measured.joint_values = Eigen::MatrixXd::Zero(6, 3);
    for (std::int32_t c = 0; c < 3; ++c) {
      measured.joint_values.col(c).setConstant(0.1 * c);
      measured.configurations.push_back(std::to_string(c + 1));
      measured.observations.push_back({.reading = Point{{0.1 * c, 0.1 * c * c, 0.0}}, .configuration = c});
    }
    measured.targets = {"A"};
  }

  std::vector<std::string> doubted() const {
    std::vector<std::string> result;
    for (const Doubt& doubt : doubts(calibration, calibration.diagnosis, measured, options.parameters.model)) {
      result.push_back(std::string(to_string(doubt.cause)) + ": " + doubt.message);
    }
    return result;
  }
  std::vector<std::string> warned(const std::string& ambiguity = {}) const {
    return messages_of(remarks(calibration, calibration.diagnosis, measured, ambiguity));
  }
};
/// A change of that calibration, and words of all that is then said, in their order.
struct Case {
  const char* name;
  std::function<void(Found&)> change;
  std::vector<std::string> words;
};

void expect_words(const std::vector<std::string>& said, const std::vector<std::string>& words, const char* what) {
  std::vector<::testing::Matcher<std::string>> expected;
  for (const std::string& some : words) {
    expected.push_back(HasSubstr(some));
  }
  EXPECT_THAT(said, ::testing::ElementsAreArray(expected)) << what;
}

void expect_doubts(const std::vector<Case>& cases) {
  for (const Case& one : cases) {
    Found found;
    one.change(found);
    expect_words(found.doubted(), one.words, one.name);
  }
}

void expect_warnings(const std::vector<Case>& cases) {
  for (const Case& one : cases) {
    Found found;
    one.change(found);
    expect_words(found.warned(), one.words, one.name);
  }
}

std::vector<std::string> numbered(int count) {
  std::vector<std::string> names;
  for (int i = 1; i <= count; ++i) {
    names.push_back("p" + std::to_string(i));
  }
  return names;
}

// These joints, from the third on, move by so much.
void move(Found& found, double range, int joints) {
  found.calibration.uncertainty.fixed_by_gauge = {"p"};
  for (int joint = 0; joint < joints; ++joint) {
    found.measured.joint_values.row(joint + 2) << 0.3, 0.3 + range, 0.3;
  }
}

TEST(DoubtsByHand, WhatIsNotDetermined) {
  const auto fixed = [](int count) {
    return [=](Found& f) { f.calibration.uncertainty.fixed_by_gauge = numbered(count); };
  };
  expect_doubts(
      {{"nothing", [](Found&) {}, {}},
       {"one", fixed(1), {"not_determined: the measurements do not determine 1 parameter (p1);"}},
       {"seven are named", fixed(7), {"7 parameters (p1, p2, p3, p4, p5, p6, p7)"}},
       {"eight are not", fixed(8), {"8 parameters (p1, p2, p3, p4, p5, p6 and 2 more)"}},
       {"nothing is predicted",
        [](Found& f) { f.calibration.uncertainty.predicted.measured.count = 0; },
        {"not_determined: the measurements do not determine all parameters;"}},
       {"a lacking rank",
        [](Found& f) { f.calibration.fit.identification.termination = Termination::rank_deficient; },
        {"not_determined: the measurements do not determine all parameters;"}},
       {"a tenth of a milliradian", [](Found& f) { move(f, 0.99e-4, 1); }, {"(p): joint_3 never moves; predictions"}},
       {"two joints", [](Found& f) { move(f, 0.99e-4, 2); }, {"(p): joint_3, joint_4 never move; predictions"}},
       {"a joint that moves", [](Found& f) { move(f, 1.01e-4, 1); }, {"(p); predictions"}},
       {"in test rows alone",
        [](Found& f) {
          f.calibration.uncertainty.fixed_by_gauge = {"p"};
          f.measured.joint_values.row(0) << 0.2, 0.2, 1.0;
          f.measured.observations[2].split = Split::test;
        },
        {"(p): joint_1 never moves; predictions"}}});
}

// Of the complete model's 38 geometric errors and frames much cannot be told apart by any measurement.
TEST(DoubtsByHand, OfTheCompleteModelOnlyWhatTheTargetsCouldShowCounts) {
  Found found;
  const ErrorModel& model = found.calibration.model;
  found.calibration.fit.candidates = Unknowns(model, {}, {"dq2", "dq3", "Tx1", "Ty1"});
  found.calibration.fit.reduction.kept = {"dq2", "dq3", "Tx1", "Rz3"};
  found.calibration.uncertainty.fixed_by_gauge = {"Ty1"};
  found.options.parameters.model = ModelChoice::complete;
  found.calibration.fit.free = Unknowns(model, {}, {"dq2", "dq3", "Ty1"});
  EXPECT_THAT(found.doubted(), IsEmpty()) << "three of three";
  found.calibration.fit.free = Unknowns(model, {}, {"dq2", "Ty1"});
  EXPECT_THAT(found.doubted(), SizeIs(1)) << "two of three";
  found.calibration.model.effects.resize(2);
  found.calibration.fit.free = found.calibration.fit.free.with_group(found.calibration.model, UnknownGroup::effects);
  EXPECT_THAT(found.doubted(), SizeIs(1)) << "effects are none of them";
  found.calibration.fit.free = Unknowns(model, {}, {"dq2", "dq3", "Ty1"});
  found.options.parameters.model = ModelChoice::irreducible;
  EXPECT_THAT(found.doubted(), SizeIs(1));
}

BeforeAfter errors_of(double before, double after) {
  return {.before = {.count = 5, .rms = before}, .after = {.count = 5, .rms = after}};
}

TEST(DoubtsByHand, PredictionsNoBetterThanTheNominalOnes) {
  const auto test = [](double before, double after) {
    return [=](Found& f) { f.calibration.accuracy.test = errors_of(before, after); };
  };
  const auto held_out = [](double before, double after) {
    return [=](Found& f) { f.calibration.accuracy.leave_one_out = errors_of(before, after); };
  };
  const auto outside = [=](double p_value) {
    return [=](Found& f) {
      held_out(1e-3, 1e-4)(f);
      test(1e-3, 4e-4)(f);
      f.calibration.uncertainty.predicted.tested = {.configurations = 10, .outside = 4, .p_value = p_value};
    };
  };
  const std::vector<std::string> kept = {"worse_than_nominal: ", "nominal_kept: "};
  expect_doubts({{"test rows as good", test(1e-3, 1e-3), {}},
                 {"worse", test(1e-3, 1.001e-3), {"worse_than_nominal: "}},
                 {"a better held-out error", held_out(1.001e-3, 1e-3), {}},
                 {"one as good", held_out(1e-3, 1e-3), kept},
                 {"none that is finite", held_out(1e-3, kInfinity), kept},
                 {"an exact nominal robot", held_out(4e-13, 5e-13), {}},
                 {"the same at test rows", test(4e-13, 5e-13), {}},
                 {"test rows outside their radius beyond chance", outside(9.9e-4), {"test_rows_differ: "}},
                 {"test rows outside by chance", outside(1.01e-3), {}}});
  // Where nothing else tells: more uncertain than the nominal robot is wrong.
  const auto uncertain = [](double rms) {
    return [=](Found& f) { f.calibration.uncertainty.predicted.measured.rms = rms; };
  };
  const auto beside = [=](const std::function<void(Found&)>& errors) {
    return [=](Found& f) {
      uncertain(2.1e-3)(f);
      errors(f);
    };
  };
  expect_doubts({{"less uncertain than the nominal robot is wrong", uncertain(1.9e-3), {}},
                 {"more", uncertain(2.1e-3), {"worse_than_nominal: the calibrated robot is uncertain by 2.1 mm"}},
                 {"but better at test rows", beside(test(1e-3, 1e-4)), {}},
                 {"but better where left out", beside(held_out(1e-3, 1e-4)), {}}});
  Found worse;
  worse.calibration.accuracy.leave_one_out = errors_of(1e-3, 1.002e-3);
  EXPECT_THAT(worse.doubted().at(0), HasSubstr("(leave-one-out): 1.002 mm against 1 mm;"));
  worse.calibration.accuracy.leave_one_out->after.count = 0;
  EXPECT_FALSE(is_no_better_than_nominal(worse.calibration.accuracy));
}

// 0.312 m, 1.075 m, 0.225 m and 1.28 m, 0.215 m: from joint 1 to the flange.
TEST(DoubtsByHand, MisfitsAndErrorsBeyondAnyRobots) {
  const double length = 0.312 + 1.075 + std::hypot(0.225, 1.28) + 0.215;
  EXPECT_NEAR(reach(Found().calibration.model), length, 1e-12);
  const auto misfit = [](double rms) { return [=](Found& f) { f.calibration.accuracy.train.after.rms = rms; }; };
  const auto error = [](ParameterKind kind, double size, double std) {
    return [=](Found& f) {
      f.calibration.uncertainty.parameters = {
          {.name = "Tx1", .joint = "joint_1", .kind = kind, .error = size, .std = std}};
    };
  };
  const double most = 0.02 * length;
  expect_doubts(
      {{"five millimetres", misfit(0.004999), {}},
       {"more", misfit(0.005001), {"large_misfit: a misfit of 5.001 mm is left, and an arm with a reach of 2.902 m"}},
       {"no reach",
        [](Found& f) {
          f.calibration.accuracy.train.after.rms = 10.0;
          f.calibration.model.tip_origin.p = KDL::Vector::Zero();
          for (MovingJoint& joint : f.calibration.model.joints) {
            joint.origin.p = KDL::Vector::Zero();
          }
        },
        {}},
       {"two per cent", error(ParameterKind::translation, 0.99 * most, 1e-5), {}},
       {"more", error(ParameterKind::translation, -1.01 * most, 1e-5), {"large_error: an error of 58"}},
       {"hardly known", error(ParameterKind::translation, 1.1 * most, 0.05 * most), {}},
       {"twenty degrees", error(ParameterKind::rotation, 19.9 * testing::kDegree, 1e-5), {}},
       {"more",
        error(ParameterKind::joint_offset, 20.1 * testing::kDegree, 1e-5),
        {"large_error: an error of 20.1 degrees in Tx1 (joint_1) is beyond what builders and mastering leave; check "
         "the mastering"}},
       {"stalled",
        [](Found& f) { f.calibration.fit.identification.termination = Termination::stalled; },
        {"not_converged: the fit did not converge: it stands at a misfit of 0.1 mm"}},
       {"infinite uncertainty is named elsewhere",
        [](Found& f) {
          f.calibration.uncertainty.parameters = {
              {.name = "Tz2", .kind = ParameterKind::translation, .std = 2.0},
              {.name = "Rz3", .kind = ParameterKind::rotation, .std = 0.6},
              {.name = "Ry2", .kind = ParameterKind::rotation, .std = 0.4},
              {.name = "Tx1", .kind = ParameterKind::translation, .std = kInfinity}};
        },
        {"unknown_length: the uncertainty exceeds the link itself for Tz2, Rz3;"}}});
}

TEST(DoubtsByHand, ReadingsAreDoubtsOrRemarks) {
  const auto readings = [](Found& f) {
    f.calibration.diagnosis.alternative_readings = {
        {.cause = Cause::length_unit, .message = "they are feet", .doubt = true},
        {.cause = Cause::copied_rows, .message = "they are copies", .doubt = false}};
  };
  expect_doubts({{"readings", readings, {"length_unit: they are feet"}}});
  expect_warnings({{"readings", readings, {"they are copies"}}});
}

TEST(WarningsByHand, WhatIsTiedIsNamedWhereNoPriorsToldItApart) {
  const auto tied = [](Found& f) { f.calibration.uncertainty.identifiability.tied = {{"dq2"}, {"Tx1", "Ry1"}}; };
  const auto fixed = [=](Found& f) {
    tied(f);
    f.calibration.uncertainty.fixed_by_gauge = {"Ry1", "dq2"};
  };
  const std::string alone = "the measurements do not depend on dq2";
  const std::string together = "the measurements cannot tell apart: Tx1, Ry1";
  expect_warnings({{"told apart by priors", tied, {}},
                   {"a lacking rank",
                    [=](Found& f) {
                      tied(f);
                      f.calibration.fit.identification.termination = Termination::rank_deficient;
                    },
                    {alone, together}},
                   {"fixed by gauge", fixed, {alone, together, "fixed by gauge: Ry1, dq2 (errors at zero"}},
                   {"the smallest errors",
                    [=](Found& f) {
                      fixed(f);
                      f.calibration.fit.minimum_norm = true;
                    },
                    {"(Ry1, dq2) was set to the smallest errors that fit"}}});
}

/// A change of that calibration, and what the only doubt or remark about it names.
struct Stated {
  const char* name;
  std::function<void(Found&)> change;
  Cause cause;
  std::vector<Subject> subjects;
  std::vector<NamedFigure> figures;
};

void expect_stated(const std::vector<Stated>& all) {
  for (const Stated& one : all) {
    Found found;
    one.change(found);
    const Diagnosis& diagnosis = found.calibration.diagnosis;
    std::vector<Doubt> stated = doubts(found.calibration, diagnosis, found.measured, found.options.parameters.model);
    const std::vector<Remark> more = remarks(found.calibration, diagnosis, found.measured, {});
    stated.insert(stated.end(), more.begin(), more.end());
    std::erase_if(stated, [&](const Doubt& doubt) { return doubt.cause != one.cause; });
    ASSERT_THAT(stated, SizeIs(1)) << one.name;
    EXPECT_EQ(stated[0].subjects, one.subjects) << one.name;
    EXPECT_EQ(stated[0].figures, one.figures) << one.name;
  }
}

using About = SubjectKind;

TEST(DoubtsByHand, NameWhatTheyConcernAndTheirNumbers) {
  const auto estimate = [](const ParameterEstimate& parameter) {
    return [=](Found& f) { f.calibration.uncertainty.parameters = {parameter}; };
  };
  const auto gross = [](Found& f) {
    f.calibration.diagnosis.gross_rows = {
        .rows = {{.configuration = "2", .target = "A", .distance = 0.01}, {.configuration = "3", .distance = 0.03}},
        .rms_without = 5e-5};
  };
  const auto test_rows = [](Found& f) {
    f.calibration.accuracy.leave_one_out = errors_of(1e-3, 1e-4);
    f.calibration.accuracy.test = errors_of(1e-3, 4e-4);
    f.calibration.uncertainty.predicted.tested = {.configurations = 10, .outside = 4, .p_value = 1e-4};
  };
  expect_stated({{"a joint at rest",
                  [](Found& f) { move(f, 0.0, 1); },
                  Cause::not_determined,
                  {{About::parameter, "p"}, {About::joint, "joint_3"}},
                  {}},
                 {"an error beyond any robot's",
                  estimate({.name = "Tx2", .joint = "joint_2", .error = -0.2, .std = 1e-5}),
                  Cause::large_error,
                  {{About::parameter, "Tx2"}, {About::joint, "joint_2"}},
                  {{"error", -0.2}, {"std", 1e-5}}},
                 {"an unknown length",
                  estimate({.name = "Tz2", .std = 2.0}),
                  Cause::unknown_length,
                  {{About::parameter, "Tz2"}},
                  {}},
                 {"gross rows",
                  gross,
                  Cause::gross_rows,
                  {{About::configuration, "2"}, {About::target, "A"}, {About::configuration, "3"}},
                  {{"distance", 0.03}, {"misfit", 1e-4}, {"misfit_without", 5e-5}}},
                 {"test rows",
                  test_rows,
                  Cause::test_rows_differ,
                  {},
                  {{"test_rms", 4e-4}, {"held_out_rms", 1e-4}, {"count", 4.0}, {"out_of", 10.0}, {"p_value", 1e-4}}},
                 {"a robot that is worse",
                  [](Found& f) { f.calibration.accuracy.k_fold = errors_of(1e-3, 2e-3); },
                  Cause::nominal_kept,
                  {},
                  {{"held_out_rms", 2e-3}, {"nominal", 1e-3}}}});
}

TEST(WarningsByHand, NameWhatTheyConcernAndTheirNumbers) {
  const auto outside = [](Found& f) {
    f.measured.joint_values(1, 2) = 100.0;
    f.measured.joint_values(4, 2) = -100.0;
    f.measured.joint_values(4, 0) = -100.0;
  };
  const auto mistyped = [](Found& f) {
    f.calibration.diagnosis.findings = {{.kind = QualityKind::mistyped_coordinate,
                                         .configuration = "3",
                                         .targets = {"A"},
                                         .axis = 'y',
                                         .amount = 0.01}};
  };
  const auto effects = [](Found& f) {
    f.calibration.accuracy.leave_one_out = errors_of(2e-3, 3e-4);
    f.calibration.accuracy.leave_one_out->rigid = ErrorStatistics{.count = 5, .rms = 2e-4};
    f.calibration.model.effects = {{.name = "gravity.2"}, {.name = "gain.3"}};
  };
  expect_stated({{"limits",
                  outside,
                  Cause::outside_joint_limits,
                  {{About::joint, "joint_2"}, {About::joint, "joint_5"}},
                  {{"count", 2.0}, {"out_of", 3.0}}},
                 {"a mistyped coordinate",
                  mistyped,
                  Cause::wrong_rows,
                  {{About::configuration, "3"}, {About::target, "A"}, {About::coordinate, "y"}},
                  {{"estimate", 0.01}}},
                 {"harmful effects",
                  effects,
                  Cause::harmful_effects,
                  {{About::effect, "gravity.2"}, {About::effect, "gain.3"}},
                  {{"held_out_rms", 3e-4}, {"geometry_alone", 2e-4}}},
                 {"the stated noise",
                  [](Found& f) { f.calibration.noise.variance_factor = 2.25; },
                  Cause::beyond_stated_noise,
                  {},
                  {{"noise_ratio", 1.5}}},
                 {"the zero of distances",
                  [](Found& f) { f.calibration.distance_zero = DistanceZero{.length = -0.002, .sigma = 1e-5}; },
                  Cause::distances_corrected,
                  {},
                  {{"estimate", -0.002}, {"estimate_sigma", 1e-5}}}});
}

TEST(WarningsByHand, FindingsAndTheRegistrationAreHandedOn) {
  Found found;
  found.calibration.diagnosis.findings = {{.message = "A slipped"}};
  EXPECT_THAT(found.warned("two answers"),
              ::testing::ElementsAre("measurements: A slipped", "registration: two answers"));
}

TEST(WarningsByHand, WhatTheMeasurementsAndTheirNoiseShow) {
  const auto outside = [](double value, bool limited) {
    return [=](Found& f) {
      f.measured.joint_values(1, 2) = value;
      if (!limited) {
        f.calibration.model.joints[1].lower.reset();
        f.calibration.model.joints[1].upper.reset();
      }
    };
  };
  const auto scaled = [](double factor, bool parts) {
    return [=](Found& f) {
      f.calibration.noise.variance_factor = factor;
      f.calibration.noise.parts = parts ? std::optional<NoiseParts>(NoiseParts()) : std::nullopt;
    };
  };
  const auto freedom = [](double degrees, NoiseSource source) {
    return [=](Found& f) {
      f.calibration.noise.degrees_of_freedom = degrees;
      f.calibration.noise.source = source;
    };
  };
  const auto lack = [](double p) { return [=](Found& f) { f.calibration.noise.lack_of_fit.emplace().p_value = p; }; };
  expect_warnings({{"above a limit", outside(100.0, true), {"1 of 3 configurations have joint values outside"}},
                   {"below a limit", outside(-100.0, true), {"1 of 3 configurations have joint values outside"}},
                   {"without limits", outside(100.0, false), {}},
                   {"below no limit", outside(-100.0, false), {}},
                   {"the stated noise", scaled(1.0, false), {}},
                   {"more", scaled(2.25, false), {"1.5 times the stated noise; the uncertainties were scaled up"}},
                   {"more, in parts", scaled(2.25, true), {"1.5 times the stated noise; what is beyond it counts as"}},
                   {"ten degrees of freedom", freedom(10.0, NoiseSource::parts), {}},
                   {"fewer", freedom(9.96, NoiseSource::parts), {"few data: all uncertainties rest on 9.96 degrees"}},
                   {"known noise", freedom(9.96, NoiseSource::stated), {}},
                   {"one in a thousand", lack(1e-3), {}},
                   {"less", lack(0.99e-3), {"lack of fit"}}});
}

TEST(WarningsByHand, EffectsMayPredictWorseThanTheGeometryAlone) {
  const auto with = [](double rms, std::optional<ErrorStatistics> rigid) {
    return [=](Found& f) {
      f.calibration.accuracy.leave_one_out = errors_of(2e-3, rms);
      f.calibration.accuracy.leave_one_out->rigid = rigid;
    };
  };
  expect_warnings({{"no effects", with(1.03e-4, std::nullopt), {}},
                   {"by two per cent", with(1.02e-4, ErrorStatistics{.count = 9, .rms = 1e-4}), {}},
                   {"by more",
                    with(1.021e-4, ErrorStatistics{.count = 9, .rms = 1e-4}),
                    {"the effects make predictions worse: configurations left out of the fit are missed by 0.1021 mm"}},
                   {"nothing to compare with", with(1.021e-4, ErrorStatistics{.count = 0, .rms = 1e-4}), {}}});
}

TEST(WarningsByHand, ElsewhereAPointMayBeWorseThanNominal) {
  const auto workspace = [](double rms, int count) {
    return [=](Found& f) { f.calibration.uncertainty.predicted.workspace = {.count = count, .rms = rms}; };
  };
  const std::string worse = "1 sigma of 2.5 mm over the whole workspace, nominal error 2 mm";
  expect_warnings({{"as good", workspace(2e-3, 100), {}},
                   {"worse", workspace(2.5e-3, 1), {worse}},
                   {"nowhere", workspace(2.5e-3, 0), {}}});
  Found found;
  workspace(2.5e-3, 1)(found);
  EXPECT_TRUE(is_uncertain_elsewhere(found.calibration));
  found.calibration.diagnosis.doubts.push_back({.cause = Cause::not_determined, .message = ""});
  EXPECT_FALSE(is_uncertain_elsewhere(found.calibration));
}

// ---- calibrations of measured arms ----------------------------------------------------------------------------------

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

  CalibrationResult calibrated(const CalibrationSettings& options = {}) const {
    return calibrate(model, measured, options);
  }
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

const CalibrationResult& clean() {
  static const CalibrationResult found = Series().calibrated();
  return found;
}

CalibrationResult with_a_held_joint() {
  Series s;
  Eigen::MatrixXd q = s.measured.joint_values;
  q.row(3).setConstant(0.6);
  s.measure_at(q);
  return s.calibrated();
}

// The only target sits on the axis of joint 6, and stays there.
CalibrationResult without_effect_of_joint_6() {
  const std::vector<TargetFrame> targets = testing::targets_at({{0.0, 0.1, 0.0}});
  Series s(2, {.sigma = kNoise}, targets);
  s.robot.truth.frames.targets = targets;
  s.measure_at(s.measured.joint_values);
  return s.calibrated({.parameters = {.fix = {"?x6", "?z6"}, .free = {"dq6"}, .known = {.targets = targets}}});
}

// The only target moves on a circle.
CalibrationResult with_one_moving_joint() {
  Series s(3, {.sigma = kNoise}, published_targets(1));
  Eigen::MatrixXd q = s.measured.joint_values.col(0).replicate(1, 25);
  q.row(0).setLinSpaced(-1.0, 1.0);
  s.measure_at(q);
  return s.calibrated();
}

CalibrationResult with_stated_sigma(double sigma) {
  Series s;
  for (Observation& observation : s.measured.observations) {
    observation.sigma = sigma;
  }
  return s.calibrated();
}

CalibrationResult with_ripple_of(double amplitude, const MeasuringNoise& noise) {
  Series s;
  s.measured = with_ripple(s, amplitude, noise);
  return s.calibrated();
}

const CalibrationResult& without_errors() {
  static const CalibrationResult found = [] {
    Series s;
    s.robot.truth.errors.setZero();
    s.measure_at(s.measured.joint_values);
    return s.calibrated();
  }();
  return found;
}

CalibrationResult with_priors(double size) {
  return Series().calibrated({.selection = {.priors = {.length = size, .angle = size}}});
}

struct Scenario {
  const char* name;
  CalibrationResult found;
  std::vector<std::string> causes;    // of all doubts, in their order
  std::vector<std::string> warnings;  // words of all of them, in their order
  Termination termination = Termination::converged;
};

std::vector<Scenario> scenarios() {
  return {
      {"clean", clean(), {}, {}},
      {"clean repeats", with_ripple_of(0.0, {.sigma = 1e-5, .repeats = 5}), {}, {}},
      {"misfit", with_ripple_of(0.001, {.sigma = 1e-5, .repeats = 5}), {}, {"lack of fit: "}},
      {"another robot",
       with_ripple_of(0.05, {.sigma = kNoise}),
       {"worse_than_nominal", "nominal_kept", "large_misfit"},
       {}},
      {"nothing to calibrate", without_errors(), {"worse_than_nominal", "nominal_kept"}, {}},
      {"noise stated a little too small", with_stated_sigma(0.95 * kNoise), {}, {}},
      {"noise stated too small", with_stated_sigma(0.5 * kNoise), {}, {"times the stated noise; what is beyond it"}},
      {"noise stated a little too large", with_stated_sigma(2.0 * kNoise), {}, {}},
      {"noise stated too large", with_stated_sigma(10.0 * kNoise), {}, {"is it stated in metres"}},
      {"too few iterations",
       Series().calibrated({.estimator = {.iterations = 1}}),
       {"not_converged"},
       {"25 of 25 leave-one-out fits did not converge"},
       Termination::iteration_limit},
      {"held joint",
       with_a_held_joint(),
       {},
       {"the measurements cannot tell apart: ", "fixed by gauge: "},
       Termination::rank_deficient},
      {"no effect of joint 6",
       without_effect_of_joint_6(),
       {"not_determined"},
       {"the measurements do not depend on dq6", "fixed by gauge: dq6"},
       Termination::rank_deficient},
      {"priors as large as the errors", with_priors(0.001), {}, {}},
      {"priors a tenth of the errors", with_priors(0.0001), {}, {"times as large as the priors expect"}}};
}

std::vector<std::string> causes_of(const CalibrationResult& found) {
  std::vector<std::string> causes;
  for (const Doubt& doubt : found.diagnosis.doubts) {
    causes.push_back(to_string(doubt.cause));
  }
  return causes;
}

TEST(WarningsOfCalibrations, AreExactlyThoseOfTheCause) {
  for (const auto& [name, found, causes, warnings, termination] : scenarios()) {
    expect_words(messages_of(found.diagnosis.remarks), warnings, name);
    EXPECT_EQ(causes_of(found), causes) << name;
    EXPECT_EQ(found.fit.identification.termination, termination) << name;
    EXPECT_EQ(found.trusted(), causes.empty()) << name;
    EXPECT_EQ(found.diagnosis.reservation.has_value(), found.trusted() && termination == Termination::rank_deficient)
        << name;
  }
}

TEST(WarningsOfCalibrations, OfTheRegistrationAreHandedOn) {
  EXPECT_THAT(messages_of(with_one_moving_joint().diagnosis.remarks),
              Contains("registration: the configurations leave a rotation of the base undetermined"));
}

TEST(DoubtsOfCalibrations, WhereNothingIsGainedTheUrdfIsTheOneThatWasRead) {
  const Robot robot = fanuc();
  const CalibrationResult& found = without_errors();
  EXPECT_TRUE(found.exported.nominal_kept);
  EXPECT_TRUE(calibrated_urdf(robot, found) == robot.urdf);
  EXPECT_EQ(found.exported.train.rms, found.accuracy.train.before.rms);
  EXPECT_EQ(found.exported.held_out->rms, found.accuracy.leave_one_out->before.rms);
  EXPECT_EQ(found.accuracy.held_out()->rigid->rms, found.accuracy.leave_one_out->before.rms);
  EXPECT_TRUE(found.exported.estimate.errors.isZero(0.0));
  const CalibrationResult& gained = clean();
  EXPECT_FALSE(gained.exported.nominal_kept);
  EXPECT_TRUE(calibrated_urdf(robot, gained) ==
              calibrated_urdf(robot, gained.model, gained.fit.identification.estimate.errors));
  EXPECT_EQ(gained.exported.train.rms, gained.accuracy.train.after.rms);
}

// Only the effects help: a URDF cannot hold them.
TEST(DoubtsOfCalibrations, WhereOnlyTheEffectsHelpTheUrdfIsTheOneThatWasRead) {
  Series series;
  series.robot.truth.errors.setZero();
  series.measured = with_ripple(series, 1e-3, {.sigma = kNoise});
  const CalibrationResult found = series.calibrated({.selection = {.effects = {.groups = {EffectGroup::harmonics}}}});
  EXPECT_TRUE(found.trusted());
  EXPECT_TRUE(found.exported.nominal_kept);
  EXPECT_THAT(messages_of(found.diagnosis.remarks),
              Contains(HasSubstr("the geometry is no better than the nominal robot")));
}

TEST(WarningsOfCalibrations, OfMoreThanTwentyThousandRowsComeFromDistancesAlone) {
  Series s(4, {.sigma = kNoise}, published_targets(4));
  s.measure_at(s.measured.joint_values, {.sigma = kNoise, .repeats = 200});
  ASSERT_EQ(s.measured.observations.size(), 20000U);
  s.measured.observations[401].position().x() += 0.03;
  for (const bool many : {false, true}) {
    if (many) {
      Observation more = s.measured.observations.back();
      more.repeat = 201;
      s.measured.observations.push_back(more);
    }
    const CalibrationResult found =
        s.calibrated({.validation = {.held_out = false}, .diagnosis = {.try_readings = false}});
    ASSERT_EQ(found.diagnosis.findings.size(), 1U);
    EXPECT_EQ(found.diagnosis.findings[0].kind, many ? QualityKind::displaced_point : QualityKind::mistyped_coordinate);
  }
}

}  // namespace
}  // namespace kdl_calibration::doubts_test

// What a calibration says of data that read well and are wrong, and of data that are right.
namespace kdl_calibration::testing::doubts_test {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

/// One line for each doubt and each finding about the data themselves.
std::string said(const CalibrationResult& found) {
  std::string text;
  for (const Doubt& doubt : found.diagnosis.doubts) {
    text += std::string(to_string(doubt.cause)) + ": " + doubt.message + "\n";
  }
  for (const QualityFinding& finding : found.diagnosis.findings) {
    text += "finding: " + finding.message + "\n";
  }
  return text;
}

Doubt doubt_of(const CalibrationResult& found, Cause cause) {
  const std::vector<Doubt>& all = found.diagnosis.doubts;
  const auto first = std::find_if(all.begin(), all.end(), [&](const Doubt& doubt) { return doubt.cause == cause; });
  EXPECT_NE(first, all.end()) << to_string(cause) << "\n" << said(found);
  return first != all.end() ? *first : Doubt();
}

bool doubts_for(const CalibrationResult& found, const std::string& cause, const std::string& words) {
  return std::any_of(found.diagnosis.doubts.begin(), found.diagnosis.doubts.end(), [&](const Doubt& doubt) {
    return to_string(doubt.cause) == cause && doubt.message.find(words) != std::string::npos;
  });
}

const CalibrationSettings kNothingHeldOut{
    .validation = {.held_out = false}};  // which says nothing of the readings of the data

// No more than one explanation of the data, the right one.
void expect_named(const Mistake& mistake, const ErrorModel& model, std::uint64_t seed,
                  const CalibrationSettings& options = kNothingHeldOut) {
  Measured m = measured(model, seed, mistake.draw);
  mistake.make(m);
  const CalibrationResult found = calibrate(model, m.data, options);
  const std::string where = mistake.name + ", " + model.joints.front().name + ", seed " + std::to_string(seed);
  EXPECT_FALSE(found.trusted()) << where;
  EXPECT_TRUE(doubts_for(found, mistake.cause, mistake.words)) << where << "\n" << said(found);
  EXPECT_EQ(std::count_if(found.diagnosis.alternative_readings.begin(), found.diagnosis.alternative_readings.end(),
                          [](const auto& s) { return s.doubt; }),
            1)
      << where << "\n"
      << said(found);
}

std::vector<Mistake> table() {
  std::vector<Mistake> all = joint_mistakes();
  for (const std::vector<Mistake>& more : {point_mistakes(), order_mistakes()}) {
    all.insert(all.end(), more.begin(), more.end());
  }
  return all;
}

/// One mistake of each kind that concerns something, and that.
TEST(Mistakes, AreNamedWithWhatTheyConcern) {
  using About = SubjectKind;
  const auto joint = [](std::size_t j) { return Subject{About::joint, large_arm().joints[j].name}; };
  const std::vector<Mistake> of_points = point_mistakes();
  const auto z_in_millimetres = std::find_if(of_points.begin(), of_points.end(),
                                             [](const Mistake& mistake) { return mistake.name == "z in millimetres"; });
  const std::vector<std::pair<Mistake, std::vector<Subject>>> all = {
      {joint_times(4, -1.0, "joint_sign", ""), {joint(4)}},
      {exchanged(1, 2), {joint(1), joint(2)}},
      {*z_in_millimetres, {{About::coordinate, "z"}}},
      {swapped_from(6), {{About::target, "A"}, {About::target, "B"}, {About::configuration, "7"}}}};
  for (const auto& [mistake, subjects] : all) {
    Measured m = measured(large_arm(), 1, mistake.draw);
    mistake.make(m);
    const CalibrationResult found = calibrate(m.model, m.data, kNothingHeldOut);
    const Doubt doubt = doubt_of(found, cause_named(mistake.cause).value());
    EXPECT_EQ(doubt.subjects, subjects) << mistake.name;
    EXPECT_LT(3.0 * doubt.figure("misfit_without").value(), doubt.figure("misfit").value()) << mistake.name;
  }
}

// By 2 mm along the flange's x.
TEST(Mistakes, ASlippedTargetIsNamedWithItsSizeAndTheLastConfigurationBefore) {
  Measured m = measured(large_arm(), 4);
  for_rows(m, [&](Observation& o) {
    if (o.configuration >= 12 && o.target == 0) {
      o.position() += true_flange(m, o.configuration).linear() * Vector3d(0.002, 0.0, 0.0);
    }
  });
  const CalibrationResult found = calibrate(m.model, m.data, kNothingHeldOut);
  const Doubt doubt = doubt_of(found, Cause::moved_target);
  EXPECT_EQ(doubt.names(SubjectKind::target), std::vector<std::string>{"A"});
  EXPECT_EQ(doubt.names(SubjectKind::configuration), std::vector<std::string>{"12"});
  EXPECT_NEAR(doubt.figure("estimate").value(), 0.002, 3.0 * doubt.figure("estimate_sigma").value()) << said(found);
}

/// Every so many-th mistake of the table, from the first one given.
void expect_cross_section_named(std::size_t first, std::size_t step,
                                const CalibrationSettings& options = kNothingHeldOut) {
  const std::vector<Mistake> all = table();
  for (std::size_t i = first; i < all.size(); i += step) {
    expect_named(all[i], i % 2 == 0 ? large_arm() : light_arm(), 4, options);
  }
}

const CalibrationSettings kAutomatic{
    .selection = {.automatic_priors = true, .effects = {.groups = {}, .automatic = true}},
    .validation = {.held_out = false}};

TEST(Mistakes, ACrossSectionOfTheTableIsDoubted) { expect_cross_section_named(0, 15); }
TEST(MistakesLongRun, ACrossSectionOfTheTableIsDoubted) { expect_cross_section_named(0, 5); }

// Neither effects nor priors explain a mistake away.
TEST(Mistakes, AreDoubtedBesideAutomaticChoices) { expect_cross_section_named(2, 25, kAutomatic); }
TEST(MistakesLongRun, AreDoubtedBesideAutomaticChoices) { expect_cross_section_named(2, 5, kAutomatic); }

TEST(MistakesCampaign, TheWholeTableIsDoubtedOnTwoRobotsWithThreeSeeds) {
  const std::vector<Mistake> all = table();
  EXPECT_GE(all.size(), 40U);
  for (const Mistake& mistake : all) {
    for (const ErrorModel* model : {&large_arm(), &light_arm()}) {
      for (std::uint64_t seed = 1; seed <= 3; ++seed) {
        expect_named(mistake, *model, seed);
      }
    }
  }
}

int false_alarms(std::uint64_t first, std::uint64_t last) {
  const std::set<std::string> never = {"joint_unit",       "joint_sign", "joint_columns",
                                       "joint_convention", "joint_gain", "length_unit",
                                       "mirrored",         "tool_frame", "scale"};
  int alarms = 0;
  for (std::uint64_t seed = first; seed <= last; ++seed) {
    const Measured m = correct_data(seed);
    const CalibrationResult found = calibrate(m.model, m.data, kNothingHeldOut);
    for (const AlternativeReading& reading : found.diagnosis.alternative_readings) {
      EXPECT_EQ(never.count(to_string(reading.cause)), 0U) << seed << ": " << reading.message;
    }
    const bool doubted =
        std::any_of(found.diagnosis.alternative_readings.begin(), found.diagnosis.alternative_readings.end(),
                    [](const AlternativeReading& reading) { return reading.doubt; });
    alarms += doubted || !found.diagnosis.findings.empty() ? 1 : 0;
    EXPECT_LE(alarms, 1) << seed << "\n" << said(found);
  }
  return alarms;
}

TEST(Mistakes, CorrectDataOfRandomArmsAreLeftAlone) { EXPECT_LE(false_alarms(1, 4), 1); }
TEST(MistakesLongRun, CorrectDataOfRandomArmsAreLeftAlone) { EXPECT_LE(false_alarms(1, 15), 1); }

TEST(MistakesCampaign, CorrectDataOfThreeHundredRandomArmsAreLeftAlone) { EXPECT_LE(false_alarms(1, 300), 1); }

// ---- how often what was changed is found ---------------------------------------------------------------------------

constexpr double kSigma = 0.00003;  // [m], of Draw

/// 10 sigma, in a direction of its own.
Vector3d twenty_sigma(std::uint64_t seed) {
  Random random(seed, 3);
  return 20.0 * kSigma * Vector3d{random.normal(), random.normal(), random.normal()}.normalized();
}

int place(std::uint64_t seed) { return 5 + static_cast<int>(seed % 21); }

/// What was done to the measurements of an arm, and whether its calibration says so.
struct Spoiling {
  std::function<void(Measured&, std::uint64_t seed)> spoil;
  std::function<bool(const CalibrationResult&)> is_named;
  std::uint64_t first_arm = 1000;
};

Spoiling named_as(Cause cause, const std::function<void(Measured&, std::uint64_t)>& spoil) {
  return {.spoil = spoil, .is_named = [=](const CalibrationResult& found) {
            const auto& readings = found.diagnosis.alternative_readings;
            return std::any_of(readings.begin(), readings.end(),
                               [&](const AlternativeReading& reading) { return reading.cause == cause; });
          }};
}

// A finding, and nothing else is made of it.
Spoiling found_as(QualityKind kind, const std::function<void(Measured&, std::uint64_t)>& spoil) {
  return {.spoil = spoil,
          .is_named =
              [=](const CalibrationResult& found) {
                return found.diagnosis.findings.size() == 1 && found.diagnosis.findings.front().kind == kind;
              },
          .first_arm = 2000};
}

std::uint64_t named_of(std::uint64_t seeds, const Spoiling& spoiling) {
  std::uint64_t named = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    Measured m = measured(seed % 2 == 0 ? large_arm() : light_arm(), spoiling.first_arm + seed);
    spoiling.spoil(m, seed);
    const CalibrationResult found = calibrate(m.model, m.data, kNothingHeldOut);
    const bool right = spoiling.is_named(found);
    named += right ? 1U : 0U;
    if (!right) {
      std::printf("seed %d: %s\n", static_cast<int>(seed), said(found).c_str());
    }
  }
  std::printf("%d of %d\n", static_cast<int>(named), static_cast<int>(seeds));
  return named;
}

const Spoiling kStep = named_as(
    Cause::moved_base, [](Measured& m, std::uint64_t seed) { moved_from(place(seed), twenty_sigma(seed)).make(m); });

// About an axis through the base, so that a point as far from it as those measured moves by 20 sigma.
const Spoiling kTurn = named_as(Cause::moved_base, [](Measured& m, std::uint64_t seed) {
  const Vector3d base = m.truth.frames.base().translation();
  double squares = 0.0;
  for (const Observation& observation : m.data.observations) {
    squares += (observation.position() - base).squaredNorm();
  }
  const double lever = std::sqrt(squares / static_cast<double>(m.data.observations.size()));
  const Eigen::Matrix3d turn = rotation_exp(twenty_sigma(seed) / lever);
  for_rows(m, [&](Observation& o) {
    o.position() = o.configuration >= place(seed) ? Vector3d(base + turn * (o.position() - base)) : o.position();
  });
});

const Spoiling kDrift = named_as(Cause::drift, [](Measured& m, std::uint64_t seed) {
  for_rows(m, [&](Observation& o) { o.position() += o.configuration / 29.0 * twenty_sigma(seed); });
});

// 1 mm along the flange's x, which only one of three targets does.
const Spoiling kSlip = named_as(Cause::moved_target, [](Measured& m, std::uint64_t seed) {
  const int target = static_cast<int>(seed % 3);
  for_rows(m, [&](Observation& o) {
    if (o.configuration >= place(seed) && o.target == target) {
      o.position() += true_flange(m, o.configuration).linear() * Vector3d(0.001, 0.0, 0.0);
    }
  });
});

const Spoiling kTypingError = found_as(QualityKind::mistyped_coordinate, [](Measured& m, std::uint64_t seed) {
  Observation& row = m.data.observations[seed * 7 % m.data.observations.size()];
  row.position()[static_cast<Eigen::Index>(seed % 3)] += 0.0005;
});

TEST(Mistakes, AMovedTrackerIsNamed) {
  EXPECT_EQ(named_of(2, kStep), 2U);
  EXPECT_EQ(named_of(1, kTurn), 1U);
  EXPECT_EQ(named_of(1, kDrift), 1U);
}

TEST(Mistakes, SlipsAreNamedAndTypingErrorsAreFindings) {
  EXPECT_EQ(named_of(2, kSlip), 2U);
  EXPECT_EQ(named_of(2, kTypingError), 2U);
}

// A user who leaves the named rows out gets the figures that were said of them.
TEST(Mistakes, FiguresOfGrossRowsAreThoseOfACalibrationWithoutThem) {
  constexpr double kOff = 0.005;  // [m]
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    Measured m = measured(seed % 2 == 0 ? large_arm() : light_arm(), seed, {.configurations = 14, .effect = 3e-4});
    for_rows(m, [&](Observation& o) { o.position().x() += o.configuration == 4 ? kOff : 0.0; });
    const CalibrationResult found = calibrate(m.model, m.data, kAutomatic);
    const GrossRows& gross = found.diagnosis.gross_rows;
    ASSERT_THAT(gross.rows, ::testing::SizeIs(1)) << said(found);
    const std::string& name = gross.rows.front().configuration;
    ASSERT_EQ(name, m.data.configurations[4]);
    EXPECT_NEAR(gross.rows.front().distance, kOff, 0.1 * kOff) << "seed " << seed;
    const Doubt doubt = doubt_of(found, Cause::gross_rows);
    EXPECT_EQ(doubt.names(SubjectKind::configuration), std::vector{name}) << "seed " << seed;
    EXPECT_EQ(doubt.figure("misfit_without"), gross.rms_without) << "seed " << seed;
    const CalibrationResult without = calibrate(m.model, without_rows(m.data, {name}), kAutomatic);
    EXPECT_NEAR(gross.rms_without, without.accuracy.train.after.rms, 1e-9) << "seed " << seed;
  }
}

// A file that was measured twice: each configuration has two repeats.
TEST(Mistakes, WhatMovedBetweenTwoRecordingsIsNamed) {
  const auto of = [](std::uint64_t seed, const std::function<void(Measured&)>& spoil) {
    Measured m = measured(seed % 2 == 0 ? large_arm() : light_arm(), seed, {.configurations = 20, .repeats = 2});
    spoil(m);
    return calibrate(m.model, m.data);
  };
  const auto second = [](Measured& m, const std::function<Vector3d(const Observation&)>& by) {
    for_rows(m, [&](Observation& o) { o.position() += o.repeat == 2 ? by(o) : Vector3d::Zero(); });
  };
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    EXPECT_TRUE(of(seed, [](Measured&) {}).trusted()) << "seed " << seed;
    const CalibrationResult slipped = of(seed, [&](Measured& m) {
      second(m, [&](const Observation& o) {
        return o.target == 1 ? Vector3d(true_flange(m, o.configuration).linear() * Vector3d(0.0, 0.0, 0.008))
                             : Vector3d(Vector3d::Zero());
      });
    });
    EXPECT_THAT(said(slipped), HasSubstr("target 'B' is elsewhere on the flange (by ")) << "seed " << seed;
    EXPECT_FALSE(slipped.trusted());
    EXPECT_EQ(slipped.diagnosis.doubts.front().subjects, (std::vector<Subject>{{SubjectKind::target, "B"}}));
    EXPECT_NEAR(slipped.diagnosis.doubts.front().figure("estimate").value(), 0.008, 1e-4) << "seed " << seed;
    const CalibrationResult moved =
        of(seed, [&](Measured& m) { second(m, [](const Observation&) { return Vector3d(0.001, 0.0, 0.0); }); });
    EXPECT_THAT(said(moved), HasSubstr("stands elsewhere (by ")) << "seed " << seed;
    EXPECT_EQ(moved.diagnosis.doubts.front().figure("repeat"), 2.0) << "seed " << seed;
    EXPECT_NEAR(moved.diagnosis.doubts.front().figure("estimate").value(), 0.001, 1e-4) << "seed " << seed;
    EXPECT_FALSE(moved.trusted());
  }
}

// The second half is of a device with ten times the noise, at a place of its own.
TEST(Mistakes, AStationWithOtherNoiseIsNamed) {
  for (const double times : {1.0, 10.0}) {
    Measured m = measured(light_arm(), 5, {.configurations = 40, .noise = 0.0});
    m.data.stations = {"near", "far"};
    Random random(7);
    const Eigen::Isometry3d X(Eigen::Translation3d(1.0, 2.0, 3.0) * Eigen::AngleAxisd(1.0, Vector3d::UnitZ()));
    for_rows(m, [&](Observation& o) {
      const bool far = o.configuration >= 20;
      o.station = far ? 1 : 0;
      o.position() = (far ? X * o.position() : o.position()) +
                     (far ? times : 1.0) * kSigma * Vector3d(random.normal(), random.normal(), random.normal());
    });
    const CalibrationResult found = calibrate(m.model, m.data);
    EXPECT_TRUE(found.trusted()) << said(found);
    EXPECT_EQ(::testing::Matches(::testing::Contains(HasSubstr("the stations measure unlike: ")))(
                  messages_of(found.diagnosis.remarks)),
              times > 1.0)
        << ::testing::PrintToString(messages_of(found.diagnosis.remarks));
    for (const Remark& remark : found.diagnosis.remarks) {
      if (remark.cause == Cause::unlike_stations) {
        EXPECT_EQ(remark.subjects, subjects_named(SubjectKind::station, {"far", "near"}));
        EXPECT_NEAR(remark.figure("sigma").value(), times * kSigma, 0.3 * times * kSigma);
      }
    }
  }
}

TEST(Mistakes, AnArmWithoutErrorsThatWasMeasuredWithoutNoiseIsTrusted) {
  std::size_t kept = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Measured m = measured(seed % 2 == 0 ? large_arm() : light_arm(), seed, {.length = 0.0, .angle = 0.0, .noise = 0.0});
    for (Observation& o : m.data.observations) {
      o.split = o.configuration % 5 == 0 ? Split::test : Split::train;
    }
    const CalibrationResult found = calibrate(m.model, m.data);
    EXPECT_TRUE(found.trusted()) << "seed " << seed << "\n" << said(found);
    kept += found.exported.nominal_kept ? 1U : 0U;
    EXPECT_EQ(found.exported.nominal_kept,
              ::testing::Matches(::testing::Contains(::testing::HasSubstr(
                  "the nominal robot is kept because it is exact")))(messages_of(found.diagnosis.remarks)))
        << "seed " << seed;
  }
  EXPECT_GT(kept, 0U);
}

// What 98 % give at least in 200 draws, two standard deviations of the count below their mean.
constexpr std::uint64_t kOfTwoHundred = 192;

TEST(MistakesLongRun, AStepOfTwentySigmaIsNamedInNinetyEightPercent) { EXPECT_GE(named_of(200, kStep), kOfTwoHundred); }
TEST(MistakesLongRun, ATurnOfTwentySigmaIsNamedInNinetyEightPercent) { EXPECT_GE(named_of(200, kTurn), kOfTwoHundred); }
TEST(MistakesLongRun, ADriftOfTwentySigmaIsNamedInNinetyEightPercent) {
  EXPECT_GE(named_of(200, kDrift), kOfTwoHundred);
}
TEST(MistakesLongRun, SlipsOfAMillimetreAreFoundInNinetyEightPercent) {
  EXPECT_GE(named_of(200, kSlip), kOfTwoHundred);
}
TEST(MistakesLongRun, TypingErrorsOfHalfAMillimetreAreFoundInNinetyEightPercent) {
  EXPECT_GE(named_of(200, kTypingError), kOfTwoHundred);
}

struct RealSet {
  ErrorModel model;
  Measurements data;
  CalibrationSettings options;
};

RealSet fanuc_series() {
  const Robot robot = fanuc();
  RealSet set{.model = complete_model(robot), .data = {}, .options = kNothingHeldOut};
  set.options.diagnosis.convention = read_joint_convention(std::string(URDF_DIR) + "/fanuc_r2000ic_165f_serial.json");
  set.data = read_measurements(robot, std::string(SHARED_DATA_DIR) + "/r2000ic_165f_tracker/measurements.csv",
                               &*set.options.diagnosis.convention);
  return set;
}

RealSet ur10_poses() {
  const std::string folder = std::string(SHARED_DATA_DIR) + "/ur10_tracker_poses";
  const Robot robot = load_robot(folder + "/ur10.urdf", {.base = "base_link", .tip = "tool0"});
  return {.model = complete_model(robot),
          .data = read_measurements(robot, folder + "/measurements.csv"),
          .options = kNothingHeldOut};
}

std::vector<std::string> causes_of(const RealSet& set) {
  std::vector<std::string> causes;
  const CalibrationResult found = calibrate(set.model, set.data, set.options);
  for (const AlternativeReading& reading : found.diagnosis.alternative_readings) {
    causes.push_back(std::string(to_string(reading.cause)) + ": " + reading.message);
  }
  for (const QualityFinding& finding : found.diagnosis.findings) {
    causes.push_back("finding: " + finding.message);
  }
  return causes;
}

TEST(MistakesOnRealData, NothingIsSaidOfWhatIsRight) {
  for (const RealSet& set : {fanuc_series(), ur10_poses()}) {
    EXPECT_THAT(causes_of(set), ::testing::IsEmpty());
  }
}

TEST(MistakesOnRealDataLongRun, NothingIsSaidOfWhatIsRightBesideAutomaticChoices) {
  for (RealSet set : {fanuc_series(), ur10_poses()}) {
    set.options.selection.effects.automatic = true;
    set.options.selection.automatic_priors = true;
    EXPECT_THAT(causes_of(set), ::testing::IsEmpty());
  }
}

// Of a controller whose joints a convention makes others of, the controller's columns are what is exchanged.
TEST(MistakesOnRealData, ColumnsOfTheControllerThatWereExchangedAreNamed) {
  RealSet set = fanuc_series();
  const Eigen::MatrixXd matrix = set.options.diagnosis.convention->matrix;
  Eigen::MatrixXd controller = matrix.inverse() * set.data.joint_values;
  controller.row(0).swap(controller.row(1));
  set.data.joint_values = matrix * controller;
  EXPECT_THAT(causes_of(set), ::testing::ElementsAre(HasSubstr("the controller's J1 and J2 exchanged")));
}

// The measured frame stands on the axis of the last joint: its orientation alone shows how that turns.
TEST(MistakesOnRealData, OrientationsShowWhatPointsDoNot) {
  RealSet wrong_sign = ur10_poses();
  wrong_sign.data.joint_values.row(5) *= -1.0;
  EXPECT_THAT(causes_of(wrong_sign), ::testing::ElementsAre(::testing::AllOf(
                                         HasSubstr("joint_sign"), HasSubstr("(orientations as points 100 mm away)"),
                                         HasSubstr("wrist_3_joint with the opposite sign"))));
}

TEST(MistakesOnRealDataLongRun, OrientationsShowDegreesWherePointsDoNot) {
  RealSet degrees = ur10_poses();
  degrees.data.joint_values.row(5) /= kDegree;
  EXPECT_THAT(causes_of(degrees), ::testing::ElementsAre(HasSubstr("wrist_3_joint in degrees, read as radians")));
}

}  // namespace
}  // namespace kdl_calibration::testing::doubts_test
