#include "diagnosis/likely_mistake.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include "geometry_alone.hpp"
#include "interface/calibration_parts.hpp"
#include "interface/ways_to_measure.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "mistake_table.hpp"
#include "robot/joint_ranges.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::likely_mistake_test {
namespace {

using Eigen::Vector3d;
using testing::Draw;
using testing::for_rows;
using ::testing::HasSubstr;
using testing::large_arm;
using testing::light_arm;
using testing::Measured;
using testing::measured;

Estimate fit_of(const Measured& m) {
  return identify_jointly(m.model, m.data, nominal_start(m.model, m.data), m.free).estimate;
}

MistakeSearch search_beside(const Measured& m, const Estimate& fit) {
  return likely_mistake({.model = m.model, .measurements = m.data, .estimate = fit, .known = {}});
}

std::optional<AlternativeReading> mistake_of(const Measured& m) { return search_beside(m, fit_of(m)).mistake; }

void move_base(Measured& m, int from, const Vector3d& step, double angle) {
  for_rows(m, [&](Observation& o) {
    if (o.configuration >= from) {
      o.position() = rotation_exp({angle, 0.0, -angle}) * o.position() + step;
    }
  });
}

// The points of other joint values than those of the file.
void drive(Measured& m, int from, const std::function<void(Eigen::VectorXd&)>& change) {
  Measured driven = m;
  for (int c = from; c < driven.data.joint_values.cols(); ++c) {
    Eigen::VectorXd q = driven.data.joint_values.col(c);
    change(q);
    driven.data.joint_values.col(c) = q;
  }
  for_rows(m, [&](Observation& o) {
    if (o.configuration >= from) {
      const Vector3d target = m.truth.frames.targets[static_cast<std::size_t>(o.target)].X_FT.translation();
      o.position() +=
          testing::true_flange(driven, o.configuration) * target - testing::true_flange(m, o.configuration) * target;
    }
  });
}

/// What is to be said of a mistake, and the size that was put in.
struct Named {
  Cause cause;
  const char* words;
  std::vector<Subject> subjects;
  double size;
  const char* figure = "estimate";
};

struct Case {
  const char* name;
  Measured m;
  Named named;
};

using About = SubjectKind;
const Subject kStation{About::station, "W"};

std::vector<Subject> and_after(const Subject& subject, int configuration) {
  return {subject, {About::configuration, std::to_string(configuration)}};
}

Case made(const char* name, Named named, Measured m, const std::function<void(Measured&)>& make) {
  make(m);
  return {name, std::move(m), std::move(named)};
}

Measured large(std::uint64_t seed) { return measured(large_arm(), seed, {.configurations = 24}); }

const Vector3d kStep(8e-4, -6e-4, 4e-4);

std::vector<Case> moved_bases() {
  const auto base = [](const char* words, int from, double size, const char* figure = "estimate") {
    return Named{Cause::moved_base, words, and_after(kStation, from), size, figure};
  };
  const double step = kStep.norm();
  return {made("a step", base("the base changed by ", 7, 3.0 * step), large(1),
               [](Measured& m) { move_base(m, 7, 3.0 * kStep, 0.0); }),
          made("a turn", base("after configuration 9", 9, 0.004 * std::sqrt(2.0), "turn"),
               measured(light_arm(), 2, {.configurations = 24}),
               [](Measured& m) { move_base(m, 9, Vector3d::Zero(), 0.004); }),
          made("two visits behind", base("after configuration 22", 22, 10.0 * step), large(3),
               [](Measured& m) { move_base(m, 22, 10.0 * kStep, 0.0); }),
          made("repeats", base("after configuration 8", 8, 3.0 * step),
               measured(large_arm(), 4, {.configurations = 24, .repeats = 2}),
               [](Measured& m) { move_base(m, 8, 3.0 * kStep, 0.0); }),
          made("one target", base("after configuration 12", 12, 10.0 * step),
               measured(light_arm(), 5, {.configurations = 24, .targets = 1}),
               [](Measured& m) { move_base(m, 12, 10.0 * kStep, 0.0); }),
          made("a drift", {Cause::drift, "drifts", {kStation}, 9.0 * step}, large(6), [](Measured& m) {
            for_rows(m, [](Observation& o) { o.position() += o.configuration / 23.0 * 9.0 * kStep; });
          })};
}

std::vector<Case> other_changes() {
  return {
      made("a target",
           {Cause::moved_target, "target 'C' changed by 5.", and_after({About::target, "C"}, 6), 5.0 * kStep.norm()},
           large(7),
           [](Measured& m) {
             for_rows(m, [&](Observation& o) {
               if (o.target == 2 && o.configuration >= 6) {
                 o.position() += testing::true_flange(m, o.configuration).linear() * (5.0 * kStep);
               }
             });
           }),
      made("a zero",
           {Cause::joint_zero_changed, "the zero of joint_3 changed by ", and_after({About::joint, "joint_3"}, 12),
            0.002},
           large(8), [](Measured& m) { drive(m, 12, [](Eigen::VectorXd& q) { q[2] += 0.002; }); })};
}

// The base is there in W.
Measured seen_from(const Vector3d& base) {
  Measured m = large(14);
  const Eigen::Isometry3d before = m.truth.frames.base();
  m.truth.frames.base().translation() = base;
  for_rows(m, [&](Observation& o) { o.position() = m.truth.frames.base() * before.inverse() * o.position(); });
  return m;
}

std::vector<Case> factors() {
  const auto good = measured(large_arm(), 11, {.configurations = 24, .length = 0.0003, .angle = 0.0003});
  return {
      made("a gain", {Cause::joint_gain, "turning 1.01 times", {{About::joint, "joint_2"}}, 0.01}, large(9),
           [](Measured& m) { drive(m, 0, [](Eigen::VectorXd& q) { q[1] *= 1.01; }); }),
      made("coupled joints",
           {Cause::joint_gain, "coupled", {{About::joint, "joint_3"}, {About::joint, "joint_2"}}, 0.01}, large(10),
           [](Measured& m) { drive(m, 0, [](Eigen::VectorXd& q) { q[2] += 0.01 * q[1]; }); }),
      made("lengths", {Cause::scale, "all measured lengths 1.00", {}, 0.008}, good,
           [](Measured& m) { for_rows(m, [](Observation& o) { o.position() *= 1.008; }); }),
      made("a reflector", {Cause::distance_zero, "distances from the origin of the coordinates 4.0", {}, 0.004},
           seen_from(Vector3d(5.0, -2.0, 1.0)),
           [](Measured& m) { for_rows(m, [](Observation& o) { o.position() += 0.004 * o.position().normalized(); }); }),
      made("heights", {Cause::scale, "coordinates z 1.00", {{About::coordinate, "z"}}, 0.004}, large(12),
           [](Measured& m) { for_rows(m, [](Observation& o) { o.position().z() *= 1.004; }); })};
}

/// A row of the table of detectable mistakes, and how a mistake of that size is made.
struct Detected {
  const char* subject;
  std::function<void(Measured&, double)> make;
  Eigen::Index changed = -1;  // joint whose zero is another one in the second half
};

std::vector<Detected> detected_kinds() {
  return {{"all measured lengths",
           [](Measured& m, double size) { for_rows(m, [&](Observation& o) { o.position() *= 1.0 + size; }); }},
          {"joint_3 coupled with joint_2",
           [](Measured& m, double size) { drive(m, 0, [&](Eigen::VectorXd& q) { q[2] += size * q[1]; }); }},
          {"the zero of joint_3 changed halfway",
           [](Measured& m, double size) { drive(m, 12, [&](Eigen::VectorXd& q) { q[2] += size; }); }, 2}};
}

// Monte Carlo: a mistake of the size that should show in 80 of 100 cases is named in most, one of a fifth of it in
// hardly any.
TEST(LikelyMistake, OfTheDetectableSizeShows) {
  const auto search = [](const Measured& m) { return search_beside(m, fit_of(m)); };
  for (const Detected& kind : detected_kinds()) {
    double named = 0.0;
    double faint = 0.0;
    const int count = 20;
    for (int seed = 1; seed <= count; ++seed) {
      const Measured right = measured(large_arm(), static_cast<std::uint64_t>(seed),
                                      {.configurations = 24, .length = 0.0005, .angle = 0.0005});
      const std::vector<DetectableMistake> table = search(right).detectable;
      const auto row = std::find_if(table.begin(), table.end(),
                                    [&](const DetectableMistake& mistake) { return mistake.subject == kind.subject; });
      ASSERT_NE(row, table.end()) << kind.subject;
      Measured wrong = right;
      kind.make(wrong, row->estimate);
      named += search(wrong).mistake ? 1.0 : 0.0;
      Measured hardly = right;
      kind.make(hardly, 0.2 * row->estimate);
      faint += search(hardly).mistake ? 1.0 : 0.0;
    }
    EXPECT_GE(named / count, 0.5) << kind.subject;
    EXPECT_LE(faint / count, 0.1) << kind.subject;
  }
}

// [m] 3D RMS of the estimate's targets from those of the true arm, in measured ranges, whose joints are driven to other
// values than stated.
double distance_from_arm(const Measured& m, const Estimate& fit,
                         const std::function<void(Eigen::VectorXd&)>& drive_to) {
  Random random(7);
  const Eigen::MatrixXd q = random_configurations(m.model.joints, trained_ranges(m.data), 400, random);
  Estimate rigid = m.truth;
  rigid.effects.resize(0);
  double squares = 0.0;
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    Eigen::VectorXd driven = q.col(c);
    drive_to(driven);
    const Eigen::Isometry3d there = rigid.frames.base() * flange_poses(m.model, rigid, driven).front();
    const Eigen::Isometry3d said = fit.frames.base() * flange_poses(m.model, fit, q.col(c)).front();
    for (std::size_t k = 0; k < rigid.frames.targets.size(); ++k) {
      squares += (there * rigid.frames.targets[k].X_FT.translation() - said * fit.frames.targets[k].X_FT.translation())
                     .squaredNorm();
    }
  }
  return std::sqrt(squares / static_cast<double>(q.cols() * std::ssize(rigid.frames.targets)));
}

const std::function<void(Eigen::VectorXd&)> kAsStated = [](Eigen::VectorXd& /*q*/) {};

// A mistake of that size is put in: the fit takes it for errors of the arm, and is off by what is said.
TEST(LikelyMistake, OfTheDetectableSizeMovesPredictionsAsItSays) {
  std::vector<Detected> kinds = detected_kinds();
  kinds.push_back({"the zero of joint_5 changed halfway",
                   [](Measured& m, double size) { drive(m, 12, [&](Eigen::VectorXd& q) { q[4] += size; }); }, 4});
  const Measured right =
      measured(large_arm(), 31, {.configurations = 24, .length = 0.0005, .angle = 0.0005, .noise = 1e-5});
  const Estimate fit = fit_of(right);
  const std::vector<DetectableMistake> table = search_beside(right, fit).detectable;
  for (const Detected& kind : kinds) {
    const auto row = std::find_if(table.begin(), table.end(),
                                  [&](const DetectableMistake& mistake) { return mistake.subject == kind.subject; });
    ASSERT_NE(row, table.end()) << kind.subject;
    Measured wrong = right;
    kind.make(wrong, row->estimate);
    const Estimate off = fit_of(wrong);
    const auto after = [&](Eigen::VectorXd& q) {
      if (kind.changed >= 0) {
        q[kind.changed] += row->estimate;
      }
    };
    const double moves = std::max(distance_from_arm(right, off, kAsStated), distance_from_arm(right, off, after));
    EXPECT_NEAR(row->moves, moves, 0.25 * moves) << kind.subject;
  }
}

// The result is as far from the arm as it is said to move without the mistake; also one that fits little of the arm.
TEST(LikelyMistake, MovesPredictionsByWhatTheResultIsOff) {
  struct Kind {
    const char* name;
    std::function<void(Measured&)> make;
    std::function<void(Eigen::VectorXd&)> drive_to;  // other joint values than stated
  };
  const auto of_gain = [](Eigen::VectorXd& q) { q[1] *= 1.01; };
  const std::vector<Kind> kinds = {
      {"lengths", [](Measured& m) { for_rows(m, [](Observation& o) { o.position() *= 1.008; }); }, kAsStated},
      {"a gain", [&](Measured& m) { drive(m, 0, of_gain); }, of_gain}};
  for (const Kind& kind : kinds) {
    for (const bool of_little : {false, true}) {
      Measured m = measured(large_arm(), 11, {.configurations = 24, .length = 0.0003, .angle = 0.0003});
      kind.make(m);
      if (of_little) {
        m.free = Unknowns(m.model, m.truth.frames.targets, {"base.Tx", "base.Ty", "A.x", "A.y", "A.z"});
      }
      const Estimate fit = fit_of(m);
      const auto found = search_beside(m, fit).mistake;
      ASSERT_TRUE(found) << kind.name;
      const double moves = distance_from_arm(m, fit, kind.drive_to);
      EXPECT_NEAR(*found->as_doubt().figure("moves"), moves, 0.1 * moves) << kind.name << ": " << found->message;
    }
  }
}

// A factor within three times what every uncertainty has of it already is no mistake.
TEST(LikelyMistake, IsNoneWithinTheStatedUncertaintyOfTheScale) {
  Measured m = measured(large_arm(), 11, {.configurations = 24, .length = 0.0003, .angle = 0.0003});
  for_rows(m, [](Observation& o) { o.position() *= 1.008; });
  const Estimate fit = fit_of(m);
  for (const double sigma : {0.0025, 0.0028}) {
    const auto found =
        likely_mistake({.model = m.model, .measurements = m.data, .estimate = fit, .known = {}, .scale_sigma = sigma})
            .mistake;
    EXPECT_EQ(found && found->cause == Cause::scale, sigma < 0.0026) << (found ? found->message : "");
  }
}

// Monte Carlo: a turn is found to within its sigma, and so is a step.
TEST(LikelyMistake, HasTheSigmaOfItsScatter) {
  const double turn = 0.001;
  const Vector3d step = 3.0 * kStep;
  double of_turns = 0.0;
  double of_steps = 0.0;
  const int count = 30;
  for (int seed = 1; seed <= count; ++seed) {
    Measured m = measured(large_arm(), static_cast<std::uint64_t>(seed), {.configurations = 24});
    move_base(m, 12, step, turn / std::sqrt(2.0));
    const std::optional<AlternativeReading> found = mistake_of(m);
    ASSERT_TRUE(found && found->cause == Cause::moved_base) << seed;
    const Doubt doubt = found->as_doubt();
    of_turns += std::pow((*doubt.figure("turn") - turn) / *doubt.figure("turn_sigma"), 2);
    // In the base, about whose origin it turns.
    const Vector3d origin = m.truth.frames.base().translation();
    const Vector3d moved = rotation_exp({turn / std::sqrt(2.0), 0.0, -turn / std::sqrt(2.0)}) * origin + step - origin;
    of_steps += std::pow((*doubt.figure("estimate") - moved.norm()) / *doubt.figure("estimate_sigma"), 2);
  }
  EXPECT_GT(of_turns / count, 0.5);  // chi-squared over 30: within 0.5 and 1.75 but for one in a hundred
  EXPECT_LT(of_turns / count, 1.75);
  EXPECT_GT(of_steps / count, 0.5);
  EXPECT_LT(of_steps / count, 1.75);
}

// What a whole configuration has is named by other checks; what the rest has is found beside it.
TEST(LikelyMistake, IsFoundBesideAConfigurationThatIsOff) {
  Measured m = measured(large_arm(), 13, {.configurations = 24});
  drive(m, 0, [](Eigen::VectorXd& q) { q[1] *= 1.01; });
  const auto displace = [](Measured& one) {
    for_rows(one,
             [](Observation& o) { o.position() += (o.configuration == 5 ? 0.3 : 0.0) * Vector3d(1.0, -1.0, 0.5); });
  };
  displace(m);
  const std::optional<AlternativeReading> found = mistake_of(m);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->cause, Cause::joint_gain) << found->message;
  Measured alone = measured(large_arm(), 13, {.configurations = 24});
  displace(alone);
  EXPECT_FALSE(mistake_of(alone));
}

TEST(LikelyMistake, IsNoneWhereNothingIsWrong) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Draw draw{.configurations = 24, .length = 0.0003 * static_cast<double>(seed), .effect = 0.0003};
    draw.repeats = seed % 3 == 0 ? 2 : 1;
    const Measured m = measured(seed % 2 == 0 ? large_arm() : light_arm(), seed, draw);
    const std::optional<AlternativeReading> found = mistake_of(m);
    EXPECT_FALSE(found) << seed << ": " << found->message;
  }
}

// One target at twelve places: sag and gains that are ordinary explain what noise the geometry leaves, and nothing
// tells its size.
TEST(LikelyMistake, IsNoneWhereOrdinaryErrorsTakeUpTheNoise) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    testing::VirtualExperiment arm({.targets = published_targets(1), .random = Random(seed)});
    const Measurements rows = testing::without_sigmas(arm.measure(12, {.sigma = 3e-5}));
    const Estimate fit = identify_jointly(arm.model, rows, nominal_start(arm.model, rows), arm.free).estimate;
    const MistakeSearch found = likely_mistake(
        {.model = arm.model, .measurements = rows, .estimate = fit, .known = {}, .unknowns = arm.free.size()});
    EXPECT_FALSE(found.mistake) << seed << ": " << found.mistake->message;
  }
}

// The visits are ordered by the angle of the shoulder, so that its sag changes along the order.
TEST(LikelyMistake, IsNotTheSagOfAnArmThatMovesAlongTheOrder) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Measured m = measured(large_arm(), seed, {.configurations = 24, .effect = 0.001});
    for (Observation& o : m.data.observations) {
      o.order = std::lround(1e6 * m.data.joint_values(1, o.configuration));
    }
    const std::optional<AlternativeReading> found = mistake_of(m);
    EXPECT_FALSE(found) << seed << ": " << found->message;
  }
}

// The height of the tip, whose derivative by a joint is the torque of a mass there (virtual work).
double tip_height(const Measured& m, const Eigen::VectorXd& q) {
  Estimate rigid = m.truth;
  rigid.effects.resize(0);
  return flange_poses(m.model, rigid, q).front().translation().z();
}

// Effects that fit a change of the payload hide it: they are doubted as well.
TEST(LikelyMistake, IsFoundThoughEffectsTakeItUp) {
  constexpr double kSag = 2e-4;       // [rad] for each metre of the lever
  constexpr double kHalfStep = 1e-3;  // [rad] of the difference quotient
  for (const int from : {24, 9}) {    // none of 24 configurations, and later ones
    Measured m = measured(large_arm(), 21, {.configurations = 20, .length = 3e-4, .angle = 3e-4, .effect = 1e-4});
    drive(m, from, [&](Eigen::VectorXd& q) {
      const Eigen::VectorXd straight = q;
      for (const Eigen::Index joint : {1, 2, 4}) {
        const Eigen::VectorXd step = kHalfStep * Eigen::VectorXd::Unit(q.size(), joint);
        q[joint] -= kSag * (tip_height(m, straight + step) - tip_height(m, straight - step)) / (2.0 * kHalfStep);
      }
    });
    m.model.effects = effect_terms(m.model, EffectGroup::gravity, m.data.joint_values);
    for (EffectTerm& term : effect_terms(m.model, EffectGroup::harmonics, m.data.joint_values)) {
      m.model.effects.push_back(std::move(term));
    }
    for (EffectTerm& term : m.model.effects) {
      term.sigma = 3e-4;
    }
    m.free = m.free.with_group(m.model, UnknownGroup::effects);
    Estimate start = nominal_start(m.model, m.data);
    start.effects = Eigen::VectorXd::Zero(std::ssize(m.model.effects));
    const Estimate fit = identify_jointly(m.model, m.data, start, m.free).estimate;
    const std::optional<AlternativeReading> found = search_beside(m, fit).mistake;
    ASSERT_EQ(found.has_value(), from < 20) << (found ? found->message : "");
    if (found) {
      EXPECT_EQ(found->cause, Cause::payload_changed) << found->message;
      EXPECT_THAT(found->message, HasSubstr("without, but with the payload changed after configuration "));
    }
  }
}

// The rows of a visit need not stand together, and visits not in their order.
TEST(LikelyMistake, IsPlacedByTheStatedOrderElseByTheFirstRows) {
  Measured m = measured(large_arm(), 1, {.configurations = 24});
  move_base(m, 7, {8e-3, -6e-3, 4e-3}, 0.0);
  const auto message = [&] {
    const std::optional<AlternativeReading> found = mistake_of(m);
    return found ? found->message : "nothing";
  };
  EXPECT_THAT(message(), HasSubstr("after configuration 7 if the file is in the order"));
  std::stable_sort(m.data.observations.begin(), m.data.observations.end(),
                   [](const Observation& a, const Observation& b) { return a.target < b.target; });
  EXPECT_THAT(message(), HasSubstr("after configuration 7 if the file is in the order"));
  std::reverse(m.data.observations.begin(), m.data.observations.end());
  EXPECT_THAT(message(), HasSubstr("after configuration 8 if the file is in the order"));
  for (Observation& o : m.data.observations) {
    o.order = 100 + o.configuration;
  }
  EXPECT_THAT(message(), HasSubstr("after configuration 7 it is"));
}

// By its own factor, for any kind of row and several stations.
TEST(LikelyMistake, OfOneStationIsNamed) {
  struct Way {
    const char* name;
    Measurements measurements;
    int station;
    double factor;
  };
  const std::vector<Way> ways = {{"S2", testing::Tracker(1).measured(36, testing::kNoise), 1, 1.002},
                                 {"S3", testing::Heights(1).measured(48, testing::kNoise), 2, 1.01}};
  for (const Way& way : ways) {
    Measurements wrong = way.measurements;
    for (Observation& observation : wrong.observations) {
      if (observation.station == way.station) {
        testing::scale_lengths(observation, way.factor);
      }
    }
    CalibrationOptions options = testing::geometry_alone();
    options.diagnosis.try_readings = true;
    EXPECT_TRUE(calibrate(testing::bundled_robot(), way.measurements, options).trusted());
    const Calibration found = calibrate(testing::bundled_robot(), wrong, options);
    ASSERT_FALSE(found.doubts().empty()) << way.name;
    EXPECT_EQ(found.doubts()[0].cause, Cause::scale) << found.doubts()[0].message;
    EXPECT_THAT(found.doubts()[0].message,
                HasSubstr("lengths of station '" + wrong.stations[static_cast<std::size_t>(way.station)] + "' 1.0"));
  }
}

struct FrameOff {
  std::string words;  // with its figures in brackets
  Vector3d shift;     // [m] in the frame
  Vector3d turn;      // [rad]
};

// The base of one of two stations by its shift and its turn about its own origin, a target by its shift.
TEST(LikelyMistake, OfAStatedFrameIsNamedByHowFarItIsOff) {
  const std::string of_base = "the known base of station 'S2' (\\S+) mm and (\\S+) degrees from where it was stated";
  const std::string of_target = "target 'B' (\\S+) mm from where it was stated";
  const std::vector<FrameOff> cases = {{of_base, {0.004, -0.003, 0.0}, Vector3d::Zero()},
                                       {of_base, Vector3d::Zero(), {0.0, 0.003, -0.004}},
                                       {of_base, {0.0, 0.0, 0.002}, {0.006, 0.0, 0.0}},
                                       {of_target, {0.0, 0.003, 0.004}, Vector3d::Zero()}};
  testing::Tracker tracker(3, 2);
  const Measurements measurements = tracker.measured(40, 3e-5);
  const Frames& truth = tracker.robot.truth.frames;
  for (const FrameOff& off : cases) {
    CalibrationOptions options = testing::geometry_alone();
    options.diagnosis.try_readings = true;
    KnownFrames& known = options.parameters.known;
    known = {.bases = {{"S1", truth.bases[0]}, {"S2", truth.bases[1]}}, .targets = truth.targets};
    if (off.words == of_base) {
      Eigen::Isometry3d& stated = known.bases[1].X_WB;
      stated.translation() -= stated.linear() * off.shift;
      stated.linear() = stated.linear() * rotation_exp(-off.turn);
    } else {
      known.targets[1].X_FT.translation() -= off.shift;
    }
    const Calibration found = calibrate(testing::bundled_robot(), measurements, options);
    ASSERT_FALSE(found.trusted()) << off.words;
    const std::string message = found.doubts().front().message;
    std::smatch said;
    ASSERT_TRUE(std::regex_search(message, said, std::regex(off.words))) << message;
    EXPECT_NEAR(std::stod(said[1]), 1e3 * off.shift.norm(), 0.1) << message;
    if (off.words == of_base) {
      EXPECT_NEAR(std::stod(said[2]), off.turn.norm() / testing::kDegree, 0.01) << message;
    }
  }
}

// Within three sigma, and two per cent for what is not linear in it.
void expect_size(const AlternativeReading& found, const Named& named, const char* name) {
  const Doubt doubt = found.as_doubt();
  const std::optional<double> size = doubt.figure(named.figure);
  const std::optional<double> sigma = doubt.figure(std::string(named.figure) + "_sigma");
  ASSERT_TRUE(size && sigma) << name;
  EXPECT_GT(*sigma, 0.0) << name;
  EXPECT_NEAR(*size, named.size, 3.0 * *sigma + 0.02 * named.size) << name << ": " << found.message;
  EXPECT_LT(*doubt.figure("misfit_without"), *doubt.figure("misfit")) << name;
  EXPECT_GT(*doubt.figure("moves"), *doubt.figure("radius")) << name;
  EXPECT_LT(*doubt.figure("p_value"), 1e-5) << name;
}

TEST(LikelyMistake, IsNamedWithItsSizeAndPlace) {
  for (const std::vector<Case>& cases : {moved_bases(), other_changes(), factors()}) {
    for (const Case& one : cases) {
      const std::optional<AlternativeReading> found = mistake_of(one.m);
      ASSERT_TRUE(found) << one.name;
      EXPECT_EQ(to_string(found->cause), std::string(to_string(one.named.cause))) << one.name << ": " << found->message;
      EXPECT_THAT(found->message, HasSubstr(one.named.words)) << one.name;
      EXPECT_EQ(found->subjects, one.named.subjects) << one.name << ": " << found->message;
      expect_size(*found, one.named, one.name);
      EXPECT_TRUE(found->doubt) << found->message;
    }
  }
}

}  // namespace
}  // namespace kdl_calibration::likely_mistake_test
