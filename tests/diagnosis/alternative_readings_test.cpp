#include "diagnosis/alternative_readings.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "effects/effect_terms.hpp"
#include "estimation/identification.hpp"
#include "mistake_table.hpp"

namespace kdl_calibration::alternative_readings_test {
namespace {

using Eigen::Vector3d;
using ::testing::Contains;
using testing::Draw;
using ::testing::ElementsAre;
using testing::for_rows;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::joint_mistakes;
using testing::large_arm;
using testing::light_arm;
using testing::Measured;
using testing::measured;
using testing::Mistake;
using testing::order_mistakes;
using testing::point_mistakes;

std::vector<AlternativeReading> suspicions_of(const Measured& m) {
  const Identification fit = identify_jointly(m.model, m.data, nominal_start(m.model, m.data), m.free);
  return alternative_readings(m.model, m.data, fit.estimate, m.free);
}

std::vector<std::string> causes(const std::vector<AlternativeReading>& all) {
  std::vector<std::string> result;
  for (const AlternativeReading& reading : all) {
    result.push_back(to_string(reading.cause));
  }
  return result;
}

std::string text(const std::vector<AlternativeReading>& all) {
  std::string result;
  for (const AlternativeReading& reading : all) {
    result += reading.message + "\n";
  }
  return result;
}

// ---- the table of mistakes -----------------------------------------------------------------------------------------

using Arms = std::vector<const ErrorModel*>;

const Arms& both_arms() {
  static const Arms both = {&large_arm(), &light_arm()};
  return both;
}

void expect_named(const std::vector<Mistake>& mistakes, std::uint64_t seeds, const Arms& arms = both_arms()) {
  for (const Mistake& mistake : mistakes) {
    std::vector<std::string> otherwise;  // at the limit of what can be seen a change may seem one configuration off
    for (const ErrorModel* model : arms) {
      for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
        Measured m = measured(*model, seed, mistake.draw);
        mistake.make(m);
        const std::vector<AlternativeReading> found = suspicions_of(m);
        const std::string where = mistake.name + ", " + model->joints.front().name + ", seed " + std::to_string(seed);
        ASSERT_THAT(causes(found), ElementsAre(mistake.cause)) << where << "\n" << text(found);
        if (found.front().message.find(mistake.words) == std::string::npos) {
          otherwise.push_back(where + ": " + found.front().message);
        }
        EXPECT_TRUE(found.front().doubt) << where;
        EXPECT_LE(found.front().message.size(), 300U) << where;
      }
    }
    EXPECT_LE(otherwise.size(), 2 * seeds / 50) << "expected " << mistake.words << ::testing::PrintToString(otherwise);
  }
}

// The arms in turn; AlternativeReadingsLongRun makes each mistake on both.
void expect_named_in_turn(const std::vector<Mistake>& mistakes) {
  for (std::size_t i = 0; i < mistakes.size(); ++i) {
    expect_named({mistakes[i]}, 1, {both_arms()[i % 2]});
  }
}

TEST(AlternativeReadings, NameMistakesInTheJointValues) { expect_named_in_turn(joint_mistakes()); }
TEST(AlternativeReadings, NameMistakesInThePoints) { expect_named_in_turn(point_mistakes()); }
TEST(AlternativeReadings, NameWhatChangedWhileItWasMeasured) { expect_named_in_turn(order_mistakes()); }

TEST(AlternativeReadingsLongRun, NameEveryMistakeOfTheTable) {
  expect_named(joint_mistakes(), 3);
  expect_named(point_mistakes(), 3);
  expect_named(order_mistakes(), 50);
}

// ---- no false alarms -----------------------------------------------------------------------------------------------

void expect_silence(std::uint64_t first, std::uint64_t last) {
  for (std::uint64_t seed = first; seed <= last; ++seed) {
    EXPECT_THAT(causes(suspicions_of(testing::correct_data(seed))), IsEmpty()) << "seed " << seed;
  }
}

TEST(AlternativeReadings, SayNothingAboutCorrectDataOfRandomArms) { expect_silence(1, 12); }
TEST(AlternativeReadingsCampaign, SayNothingAboutCorrectDataOfThreeHundredRandomArms) { expect_silence(1, 300); }

TEST(AlternativeReadings, SayNothingAboutShortLeversFewConfigurationsAndRepeats) {
  for (const ErrorModel* model : {&large_arm(), &light_arm()}) {
    for (const Draw& draw : {Draw{.lever = 0.005}, Draw{.configurations = 13, .targets = 1}, Draw{.repeats = 4},
                             Draw{.configurations = 5}, Draw{.noise = 0.0}}) {
      EXPECT_THAT(causes(suspicions_of(measured(*model, 4, draw))), IsEmpty()) << draw.configurations;
    }
  }
}

// ---- words ---------------------------------------------------------------------------------------------------------

TEST(AlternativeReadings, JudgeAModelOfWhichNothingIsFree) {
  testing::VirtualExperiment experiment;
  const Unknowns none(experiment.model, experiment.targets, {});
  Measurements measured = testing::without_sigmas(experiment.measure(40, {.sigma = 3e-5}));
  EXPECT_THAT(causes(alternative_readings(experiment.model, measured, experiment.robot.truth, none)), IsEmpty());
  for (Observation& o : measured.observations) {
    o.position().x() += o.configuration < 20 ? 0.0 : 0.001;  // somebody moved the tracker
  }
  EXPECT_FALSE(alternative_readings(experiment.model, measured, experiment.robot.truth, none).empty());
}

TEST(AlternativeReadings, StateTheMisfitOfBothReadings) {
  Measured m = measured(large_arm(), 1);
  m.data.joint_values.row(1) *= -1.0;
  const std::vector<AlternativeReading> found = suspicions_of(m);
  ASSERT_EQ(found.size(), 1U) << text(found);
  EXPECT_THAT(found.front().message,
              ::testing::MatchesRegex("as they were read the measurements leave a misfit of [0-9]+ mm; with joint_2 "
                                      "with the opposite sign it is 0\\.0[0-9]+ mm; the input was used as read"));
}

TEST(AlternativeReadings, TakeTheOrderFromTheColumnAndElseSayThatTheFileGaveIt) {
  Measured m = measured(large_arm(), 2);
  testing::moved_from(14, {0.001, 0.0, 0.0}).make(m);
  EXPECT_THAT(text(suspicions_of(m)), HasSubstr("after configuration 14 if the file is in the order of measurement"));
  for (Observation& observation : m.data.observations) {
    observation.order = observation.configuration;
  }
  // The same rows from the last configuration to the first.
  std::reverse(m.data.observations.begin(), m.data.observations.end());
  EXPECT_THAT(text(suspicions_of(m)),
              ::testing::AllOf(HasSubstr("after configuration 14"), ::testing::Not(HasSubstr("if the"))));
}

TEST(AlternativeReadings, NameATargetThatSlipped) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Measured m = measured(large_arm(), seed);
    for_rows(m, [&](Observation& o) {
      if (o.configuration >= 12 && o.target == 1) {
        o.position() += testing::true_flange(m, o.configuration).linear() * Vector3d(0.001, 0.0, 0.0);
      }
    });
    EXPECT_THAT(causes(suspicions_of(m)), ElementsAre("moved_target")) << seed;
    EXPECT_THAT(text(suspicions_of(m)), HasSubstr("target 'B' changed by ")) << seed;
  }
}

// As where a URDF is validated: no length of the arm can take the factor up.
TEST(AlternativeReadings, TellAScaleOfThePointsBesideGeometryThatIsHeld) {
  for (const double factor : {1.008, 1.02}) {
    Measured m = measured(large_arm(), 6, {.length = 0.0003, .angle = 0.0003});
    for_rows(m, [&](Observation& o) { o.position() *= factor; });
    const Unknowns frames = m.free.without(UnknownGroup::geometric);
    const std::vector<AlternativeReading> found =
        alternative_readings(m.model, m.data, nominal_start(m.model, m.data), frames);
    ASSERT_THAT(causes(found), ElementsAre("scale")) << text(found);
    EXPECT_THAT(found.front().message, HasSubstr(factor < 1.01 ? "1.00" : "1.0"));
  }
}

TEST(AlternativeReadings, RemarkThatAConfigurationHasTwoLabelsAndThatTestRowsAreCopies) {
  Measured m = measured(large_arm(), 1);
  m.data.joint_values.col(7) = m.data.joint_values.col(2);
  for_rows(m, [&](Observation& o) {
    if (o.configuration == 7) {
      o.split = Split::test;
      o.position() = m.data.observations[6 + static_cast<std::size_t>(o.target)].position();
    }
  });
  const std::vector<AlternativeReading> found = suspicions_of(m);
  ASSERT_THAT(causes(found), ElementsAre("same_configuration", "copied_rows")) << text(found);
  EXPECT_THAT(found[0].message,
              HasSubstr("test configuration 8 is at the pose of train configuration 3: that is no independent test"));
  EXPECT_THAT(found[1].message, HasSubstr("test configuration 8 has the very points of train configuration 3"));
  EXPECT_FALSE(found[0].doubt || found[1].doubt);
}

// ---- where a suspicion begins --------------------------------------------------------------------------------------

/// A robot that is as nominal: nothing but what a test does to the data is wrong.
Measured exact(const ErrorModel& model, std::uint64_t seed, Draw draw = {}) {
  draw.length = 0.0;
  draw.angle = 0.0;
  Measured m = measured(model, seed, draw);
  m.truth.effects.resize(0);
  return m;
}

std::vector<AlternativeReading> suspicions_of_frames(const Measured& m, const ReadingOptions& options = {}) {
  return alternative_readings(m.model, m.data, nominal_start(m.model, m.data), m.free.without(UnknownGroup::geometric),
                              options);
}

std::vector<AlternativeReading> suspicions_of_truth(const Measured& m) {
  return alternative_readings(m.model, m.data, m.truth, Unknowns());
}

void scale(Measured& m, const Vector3d& factors) {
  for_rows(m, [&](Observation& o) { o.position() = o.position().cwiseProduct(factors); });
}

void disturb(Measured& m, double size) {
  Random random(7);
  for_rows(m, [&](Observation& o) {
    o.position() += size * Vector3d{random.normal(), random.normal(), random.normal()};
  });
}

bool has(const std::vector<AlternativeReading>& found, const std::string& cause) {
  return std::any_of(found.begin(), found.end(),
                     [&](const AlternativeReading& one) { return to_string(one.cause) == cause; });
}

// Fitted lengths take a small factor up, and show it.
TEST(AlternativeReadings, TellAScaleThatFittedLengthsHaveInCommon) {
  const Measured right = exact(light_arm(), 1, {.configurations = 16, .targets = 2, .noise = 1e-6});
  const std::vector<std::pair<double, std::string>> expected = {
      {0.99, "all measured lengths 0.98"},
      {1.0, ""},
      {1.01, "all measured lengths 1.0"},
      {1.05, "with points that are 1.05 times too far apart"}};
  for (const auto& [factor, words] : expected) {
    Measured m = right;
    scale(m, Vector3d::Constant(factor));
    const std::vector<AlternativeReading> found = suspicions_of(m);
    EXPECT_EQ(has(found, "scale"), !words.empty()) << factor << " " << text(found);
    EXPECT_THAT(text(found), HasSubstr(words)) << factor;
  }
}

TEST(AlternativeReadings, TellWhichCoordinateIsInAnotherUnit) {
  const Measured right = exact(light_arm(), 1, {.configurations = 12, .targets = 1, .noise = 1e-6});
  const std::vector<std::pair<Vector3d, std::string>> expected = {
      {{1.0, 1.0, 2.1}, "z in another unit than the other coordinates (x, y and z are 1, 1 and 2.1 times too large)"},
      {{1.0, 50.0, 1.0}, "y in another unit than the other coordinates (x, y and z are 1, 50 and 1 times too large)"},
      {{0.02, 1.0, 1.0},
       "x in another unit than the other coordinates (x, y and z are 0.02, 1 and 1 times too large)"}};
  for (const auto& [factors, words] : expected) {
    Measured m = right;
    scale(m, factors);
    const std::vector<AlternativeReading> found = suspicions_of_frames(m);
    EXPECT_EQ(has(found, "length_unit"), !words.empty()) << text(found);
    EXPECT_FALSE(has(found, "scale")) << text(found);
    EXPECT_THAT(text(found), HasSubstr(words));
  }
}

// A factor moves the base from where it was said to be, which is said first.
TEST(AlternativeReadings, TellAScaleBesideTargetsThatAreKnown) {
  Measured m = exact(light_arm(), 1, {.configurations = 12, .targets = 1, .noise = 1e-6});
  scale(m, Vector3d::Constant(1.1));
  EXPECT_TRUE(has(suspicions_of_frames(m), "scale"));
  ReadingOptions base;
  base.registration.known.bases = {{.X_WB = m.truth.frames.base()}};
  EXPECT_FALSE(has(suspicions_of_frames(m, base), "scale"));
  ReadingOptions target;
  target.registration.known.targets = m.truth.frames.targets;
  EXPECT_TRUE(has(suspicions_of_frames(m, target), "scale"));
}

TEST(AlternativeReadings, TellPointsThatHardlyMoveWhileTheFlangeDoes) {
  Measured m = exact(light_arm(), 2, {.configurations = 20, .targets = 2});
  EXPECT_FALSE(has(suspicions_of_frames(m), "tool_frame"));
  for_rows(m, [](Observation& o) { o.position() = Vector3d(0.1, 0.2, 0.3); });
  disturb(m, 0.001);
  EXPECT_TRUE(has(suspicions_of_frames(m), "tool_frame"));
}

// A camera on the flange that looks at a board.
TEST(AlternativeReadings, TellPosesOfTheWorldSeenFromTheTool) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    for (const ErrorModel* model : both_arms()) {
      Measured m = measured(*model, seed, {.configurations = 40, .targets = 1, .poses = true});
      EXPECT_FALSE(has(suspicions_of(m), "tool_frame"));
      for_rows(m, [](Observation& o) {
        const Eigen::Isometry3d X_WT = Eigen::Translation3d(o.position()) * *o.orientation();
        const Eigen::Isometry3d X_TW = X_WT.inverse();
        o.reading = Pose{X_TW.translation(), Eigen::Quaterniond(X_TW.linear())};
      });
      const std::vector<AlternativeReading> found = suspicions_of(m);
      EXPECT_THAT(causes(found), ElementsAre("tool_frame")) << "seed " << seed << "\n" << text(found);
      EXPECT_THAT(text(found), HasSubstr("poses of the world seen from the tool; invert them"));
    }
  }
}

// ---- gains ---------------------------------------------------------------------------------------------------------

TEST(AlternativeReadings, SayByHowMuchAJointMovesOtherwiseAndWhetherOthersDo) {
  const ErrorModel odd = complete_model(parse_robot(testing::kOddArm));
  Measured slide = measured(odd, 5, {.configurations = 30, .targets = 2, .angle = 0.001});
  slide.data.joint_values.row(1) /= 0.95;
  EXPECT_THAT(text(suspicions_of(slide)), HasSubstr("slide moving 0.95 times as far as its values say"));
  Measured two = measured(light_arm(), 5, {.configurations = 30, .targets = 2, .angle = 0.001, .noise = 1e-6});
  two.data.joint_values.row(1) /= 1.08;
  two.data.joint_values.row(2) /= 1.04;
  EXPECT_THAT(text(suspicions_of(two)), HasSubstr("shoulder_lift turning 1.07"));
}

// ---- what moved ----------------------------------------------------------------------------------------------------

// A robot as it came, measured a few times or many: its errors are taken for nothing else, a wrong sign is for one.
TEST(AlternativeReadings, OfARobotThatNobodyCalibratedAreNotItsErrors) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const Draw draw{.configurations = seed % 2 == 0 ? 30 : 3 + static_cast<int>(seed), .effect = 0.0003};
    Measured m = measured(seed % 3 == 0 ? large_arm() : light_arm(), seed, draw);
    EXPECT_THAT(causes(alternative_readings_of_nominal(m.model, m.data, nominal_start(m.model, m.data))), IsEmpty())
        << seed;
    m.data.joint_values.row(1) *= -1.0;
    if (draw.configurations > 6) {
      EXPECT_TRUE(has(alternative_readings_of_nominal(m.model, m.data, nominal_start(m.model, m.data)), "joint_sign"))
          << seed;
    }
  }
}

// ---- remarks -------------------------------------------------------------------------------------------------------

::testing::Matcher<const AlternativeReading&> is_about(Cause cause, const std::vector<Subject>& subjects) {
  return ::testing::AllOf(::testing::Field(&AlternativeReading::cause, cause),
                          ::testing::Field(&AlternativeReading::subjects, subjects));
}

/// Residuals of which a function of the second joint explains this share.
Measured with_function(int configurations, double size, double noise) {
  Measured m = exact(light_arm(), 8, {.configurations = configurations, .targets = 2, .noise = 0.0});
  for_rows(m, [&](Observation& o) {
    o.position() += size * std::sin(m.data.joint_values(1, o.configuration)) * Vector3d(0.6, 0.0, 0.8);
  });
  disturb(m, noise);
  return m;
}

TEST(AlternativeReadings, RemarkAFunctionOfAJointThatExplainsTheResidualsAndNoneInNoise) {
  const std::vector<AlternativeReading> found = suspicions_of_truth(with_function(30, 0.001, 1e-5));
  EXPECT_THAT(text(found), HasSubstr("a function of shoulder_lift alone explains"));
  EXPECT_THAT(found, Contains(is_about(Cause::joint_function, {{SubjectKind::joint, "shoulder_lift"}})));
  EXPECT_FALSE(has(suspicions_of_truth(with_function(30, 0.001, 0.005)), "joint_function"));
  EXPECT_FALSE(has(suspicions_of_truth(with_function(30, 0.0, 1e-4)), "joint_function"));
}

TEST(AlternativeReadings, TakeEqualPointsForCopiesOfTheSameTargetAlone) {
  Measured m = exact(light_arm(), 9, {.configurations = 12, .targets = 2, .noise = 1e-6});
  m.data.joint_values.col(7) = m.data.joint_values.col(2);
  m.data.joint_values.col(9) = m.data.joint_values.col(2);
  for_rows(m, [&](Observation& o) {
    o.split = o.configuration == 7 ? Split::test : Split::train;
    if (o.configuration == 7) {  // the points of the other target
      o.position() = m.data.observations[static_cast<std::size_t>(4 + 1 - o.target)].position();
    }
  });
  const std::vector<AlternativeReading> found = suspicions_of_truth(m);
  EXPECT_THAT(text(found), HasSubstr("test configuration 8 is at the pose of train configuration 3 (and 1 more)"));
  EXPECT_THAT(found, Contains(is_about(Cause::same_configuration,
                                       {{SubjectKind::configuration, "3"}, {SubjectKind::configuration, "8"}})));
  EXPECT_FALSE(has(found, "copied_rows")) << text(found);
}

// ---- which rows are looked at --------------------------------------------------------------------------------------

// The last joint turns about the line through the points: orientations alone show its sign.
TEST(AlternativeReadings, LookAtOrientationsAsPointsBesideThem) {
  const Eigen::Vector3d on_axis(0.0, 0.2, 0.0);
  testing::VirtualExperiment experiment({.targets = testing::as_frames(testing::targets_at({on_axis})),
                                         .sizes = {.length = 0.0, .angle = 0.0, .target_length = 0.0}});
  Eigen::MatrixXd q = experiment.configurations(90);
  q.col(40) = q.col(3);
  Measurements data = testing::without_sigmas(experiment.measure(q, {.sigma = 1e-5, .orientation_sigma = 1e-5}));
  const Unknowns free = experiment.free.without(UnknownGroup::geometric);
  EXPECT_THAT(causes(alternative_readings(experiment.model, data, nominal_start(experiment.model, data), free)),
              ElementsAre("same_configuration"));
  data.joint_values.row(5) *= -1.0;
  const Estimate fit = nominal_start(experiment.model, data);
  const std::vector<AlternativeReading> found = alternative_readings(experiment.model, data, fit, free);
  EXPECT_THAT(causes(found), ElementsAre("joint_sign", "same_configuration")) << text(found);
  EXPECT_THAT(text(found),
              HasSubstr("mm (orientations as points 100 mm away); with joint_6 with the opposite sign it is 0."));
}

TEST(AlternativeReadings, TryReadingsBesideTheFramesThatAreKnown) {
  Measured m = exact(light_arm(), 11, {.configurations = 14, .targets = 1});
  m.data.joint_values.row(2) *= -1.0;
  const Estimate start = nominal_start(m.model, m.data);
  EXPECT_TRUE(has(alternative_readings(m.model, m.data, start, Unknowns()), "joint_sign"));
  ReadingOptions elsewhere;
  elsewhere.registration.known.bases.resize(1);
  EXPECT_FALSE(has(alternative_readings(m.model, m.data, start, Unknowns(), elsewhere), "joint_sign"));
}

}  // namespace
}  // namespace kdl_calibration::alternative_readings_test
