#include "kdl_calibration/suspicions.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "assessment/point_trial.hpp"
#include "assessment/trial_fit.hpp"
#include "assessment/trial_sample.hpp"
#include "base/f_distribution.hpp"
#include "base/number_text.hpp"
#include "kdl_calibration/convention_trial.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/lack_of_fit.hpp"
#include "mistake_table.hpp"
#include "onset.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Vector3d;
using ::testing::AllOf;
using testing::Draw;
using ::testing::ElementsAre;
using testing::for_rows;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::joint_mistakes;
using testing::kDegree;
using testing::large_arm;
using testing::light_arm;
using testing::Measured;
using testing::measured;
using testing::Mistake;
using testing::moved_from;
using testing::order_mistakes;
using testing::point_mistakes;
using testing::true_flange;

std::vector<Suspicion> suspicions_of(const Measured& m) {
  const Identification fit = identify_jointly(m.model, m.data, nominal_start(m.model, m.data), m.free);
  return suspicions(m.model, m.data, fit.estimate, m.free);
}

std::vector<std::string> causes(const std::vector<Suspicion>& all) {
  std::vector<std::string> result;
  for (const Suspicion& suspicion : all) {
    result.push_back(suspicion.cause);
  }
  return result;
}

std::string text(const std::vector<Suspicion>& all) {
  std::string result;
  for (const Suspicion& suspicion : all) {
    result += suspicion.message + "\n";
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
        const std::vector<Suspicion> found = suspicions_of(m);
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

// The arms in turn; SuspicionsLongRun makes each mistake on both.
void expect_named_in_turn(const std::vector<Mistake>& mistakes) {
  for (std::size_t i = 0; i < mistakes.size(); ++i) {
    expect_named({mistakes[i]}, 1, {both_arms()[i % 2]});
  }
}

TEST(Suspicions, NameMistakesInTheJointValues) { expect_named_in_turn(joint_mistakes()); }
TEST(Suspicions, NameMistakesInThePoints) { expect_named_in_turn(point_mistakes()); }
TEST(Suspicions, NameWhatChangedWhileItWasMeasured) { expect_named_in_turn(order_mistakes()); }

TEST(SuspicionsLongRun, NameEveryMistakeOfTheTable) {
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

TEST(Suspicions, SayNothingAboutCorrectDataOfRandomArms) { expect_silence(1, 12); }
TEST(SuspicionsCampaign, SayNothingAboutCorrectDataOfThreeHundredRandomArms) { expect_silence(1, 300); }

TEST(Suspicions, SayNothingAboutShortLeversFewConfigurationsAndRepeats) {
  for (const ErrorModel* model : {&large_arm(), &light_arm()}) {
    for (const Draw& draw : {Draw{.lever = 0.005}, Draw{.configurations = 13, .targets = 1}, Draw{.repeats = 4},
                             Draw{.configurations = 5}, Draw{.noise = 0.0}}) {
      EXPECT_THAT(causes(suspicions_of(measured(*model, 4, draw))), IsEmpty()) << draw.configurations;
    }
  }
}

// ---- words ---------------------------------------------------------------------------------------------------------

TEST(Suspicions, JudgeAModelOfWhichNothingIsFree) {
  testing::VirtualExperiment experiment;
  const Unknowns none(experiment.model, experiment.targets, {});
  Measurements measured = testing::without_sigmas(experiment.measure(40, {.sigma = 3e-5}));
  EXPECT_THAT(causes(suspicions(experiment.model, measured, experiment.robot.truth, none)), IsEmpty());
  for (Observation& o : measured.observations) {
    o.position.x() += o.configuration < 20 ? 0.0 : 0.001;  // somebody moved the tracker
  }
  EXPECT_FALSE(suspicions(experiment.model, measured, experiment.robot.truth, none).empty());
}

TEST(Suspicions, StateTheMisfitOfBothReadings) {
  Measured m = measured(large_arm(), 1);
  m.data.joint_values.row(1) *= -1.0;
  const std::vector<Suspicion> found = suspicions_of(m);
  ASSERT_EQ(found.size(), 1U) << text(found);
  EXPECT_THAT(found.front().message,
              ::testing::MatchesRegex("as they were read the measurements leave a misfit of [0-9]+ mm; with joint_2 "
                                      "with the opposite sign it is 0\\.0[0-9]+ mm; nothing was switched"));
}

TEST(Suspicions, TakeTheOrderFromTheColumnAndElseSayThatTheFileGaveIt) {
  Measured m = measured(large_arm(), 2);
  moved_from(14, {0.001, 0.0, 0.0}).make(m);
  EXPECT_THAT(text(suspicions_of(m)), HasSubstr("after configuration 14 if the file is in the order of measurement"));
  for (const Observation& observation : m.data.observations) {
    m.data.order.push_back(observation.configuration);
  }
  // The same rows from the last configuration to the first.
  std::reverse(m.data.observations.begin(), m.data.observations.end());
  std::reverse(m.data.order.begin(), m.data.order.end());
  EXPECT_THAT(text(suspicions_of(m)), AllOf(HasSubstr("after configuration 14"), ::testing::Not(HasSubstr("if the"))));
}

TEST(Suspicions, LeaveATargetThatSlippedToTheChecksOfTargets) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Measured m = measured(large_arm(), seed);
    for_rows(m, [&](Observation& o) {
      if (o.configuration >= 12 && o.target == 1) {
        o.position += true_flange(m, o.configuration).linear() * Vector3d(0.001, 0.0, 0.0);
      }
    });
    EXPECT_THAT(causes(suspicions_of(m)), IsEmpty()) << seed;
  }
}

// As where a URDF is validated: no length of the arm can take the factor up.
TEST(Suspicions, TellAScaleOfThePointsBesideGeometryThatIsHeld) {
  for (const double factor : {1.008, 1.02}) {
    Measured m = measured(large_arm(), 6, {.length = 0.0003, .angle = 0.0003});
    for_rows(m, [&](Observation& o) { o.position *= factor; });
    const Unknowns frames = m.free.without(UnknownGroup::geometric);
    const std::vector<Suspicion> found = suspicions(m.model, m.data, nominal_start(m.model, m.data), frames);
    ASSERT_THAT(causes(found), ElementsAre("scale")) << text(found);
    EXPECT_THAT(found.front().message, HasSubstr(factor < 1.01 ? "1.00" : "1.0"));
  }
}

// A fit with gains leaves no misfit behind that would show what the values are wrong by.
TEST(Suspicions, DoubtAGainThatTheFitTookForOne) {
  for (const double factor : {0.9, 1.02}) {
    Measured m = measured(light_arm(), 5);
    m.model.effects = gain_terms(m.model);
    m.data.joint_values.row(2) *= factor;
    const Unknowns free = m.free.with(m.model, UnknownGroup::effects, {0, 1, 2, 3, 4, 5});
    Estimate start = nominal_start(m.model, m.data);
    start.effects = Eigen::VectorXd::Zero(6);
    const Estimate fit = identify_jointly(m.model, m.data, start, free).estimate;
    ASSERT_NEAR(1.0 + fit.effects[2], 1.0 / factor, 1e-3);
    const std::vector<Suspicion> found = suspicions(m.model, m.data, fit, free);
    ASSERT_THAT(causes(found), ElementsAre("joint_gain")) << text(found);
    EXPECT_THAT(found.front().message, HasSubstr(factor < 1.0 ? "elbow turning 1.11" : "elbow turning 0.980"));
  }
}

TEST(Suspicions, RemarkThatAFunctionOfOneJointExplainsTheResiduals) {
  Measured m = measured(large_arm(), 3, {.configurations = 40});
  const Eigen::MatrixXd said = m.data.joint_values;
  Random random(3);
  VirtualRobot robot{.model = m.model, .truth = m.truth};
  robot.truth.effects.resize(0);
  // A ring of the first joint that is off centre twice a turn.
  Eigen::MatrixXd real = said;
  real.row(0).array() += 0.0005 * (2.0 * said.row(0).array()).sin();
  m.data = measure(robot, real, {.sigma = 0.00001}, random);
  m.data.joint_values = said;
  const std::vector<Suspicion> found = suspicions_of(m);
  for (const Suspicion& suspicion : found) {
    EXPECT_FALSE(suspicion.doubt) << suspicion.message;
    EXPECT_THAT(suspicion.message, HasSubstr("joint_1"));
  }
}

TEST(Suspicions, RemarkThatAConfigurationHasTwoLabelsAndThatTestRowsAreCopies) {
  Measured m = measured(large_arm(), 1);
  m.data.joint_values.col(7) = m.data.joint_values.col(2);
  for_rows(m, [&](Observation& o) {
    if (o.configuration == 7) {
      o.split = Split::test;
      o.position = m.data.observations[6 + static_cast<std::size_t>(o.target)].position;
    }
  });
  const std::vector<Suspicion> found = suspicions_of(m);
  ASSERT_THAT(causes(found), ElementsAre("same_configuration", "copied_rows")) << text(found);
  EXPECT_THAT(found[0].message, HasSubstr("configurations 3 and 8 have the same joint values"));
  EXPECT_THAT(found[1].message, HasSubstr("test configuration 8 has the very points of train configuration 3"));
  EXPECT_FALSE(found[0].doubt || found[1].doubt);
}

TEST(Suspicions, RefuseMeasurementsOfAnotherRobot) {
  const Measured m = measured(large_arm(), 1);
  const Measured other = measured(light_arm(), 1);
  EXPECT_THROW(suspicions(m.model, other.data, m.truth, m.free), InputError);
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

std::vector<Suspicion> suspicions_of_frames(const Measured& m, const SuspicionOptions& options = {}) {
  return suspicions(m.model, m.data, nominal_start(m.model, m.data), m.free.without(UnknownGroup::geometric), options);
}

std::vector<Suspicion> suspicions_of_truth(const Measured& m) {
  return suspicions(m.model, m.data, m.truth, Unknowns());
}

void scale(Measured& m, const Vector3d& factors) {
  for_rows(m, [&](Observation& o) { o.position = o.position.cwiseProduct(factors); });
}

void disturb(Measured& m, double size) {
  Random random(7);
  for_rows(m, [&](Observation& o) {
    o.position += size * Vector3d{random.normal(), random.normal(), random.normal()};
  });
}

bool has(const std::vector<Suspicion>& found, const std::string& cause) {
  return std::any_of(found.begin(), found.end(), [&](const Suspicion& one) { return one.cause == cause; });
}

TEST(Suspicions, TellAScaleBeyondHalfAPerCentWhereNoLengthIsFitted) {
  const Measured right = exact(light_arm(), 1, {.configurations = 12, .targets = 1, .noise = 1e-6});
  for (const double off : {-0.0053, -0.0047, 0.0047, 0.0053}) {
    Measured m = right;
    scale(m, Vector3d::Constant(1.0 + off));
    EXPECT_EQ(has(suspicions_of_frames(m), "scale"), std::abs(off) > 0.005) << off;
  }
}

// Up to two per cent fitted lengths take it up, and show it.
TEST(Suspicions, TellAScaleThatFittedLengthsHaveInCommonFromHalfAPerCentOn) {
  const Measured right = exact(light_arm(), 1, {.configurations = 16, .targets = 2, .noise = 1e-6});
  const std::vector<std::pair<double, std::string>> expected = {
      {0.9947, "all lengths of the arm are found 0.9947"},
      {0.9953, ""},
      {1.0047, ""},
      {1.0053, "all lengths of the arm are found 1.0053"},
      {1.0190,
       "all lengths of the arm are found 1.019 times as long as nominal (a unit, a temperature or a tracker set "
       "wrong); the fit absorbs that, nothing was switched"},
      {1.0210,
       "with points that are 1.021 times too far apart (a unit, a temperature or a tracker set wrong) it is "
       "0.00"}};
  for (const auto& [factor, words] : expected) {
    Measured m = right;
    scale(m, Vector3d::Constant(factor));
    const std::vector<Suspicion> found = suspicions_of(m);
    EXPECT_EQ(has(found, "scale"), !words.empty()) << factor << " " << text(found);
    EXPECT_THAT(text(found), HasSubstr(words)) << factor;
  }
}

TEST(Suspicions, TellWhichCoordinateIsInAnotherUnit) {
  const Measured right = exact(light_arm(), 1, {.configurations = 12, .targets = 1, .noise = 1e-6});
  const std::vector<std::pair<Vector3d, std::string>> expected = {
      {{1.0, 1.0, 1.9}, ""},
      {{1.0, 1.0, 2.1}, "z in another unit than the other coordinates (x, y and z are 1, 1 and 2.1 times too large)"},
      {{1.0, 50.0, 1.0}, "y in another unit than the other coordinates (x, y and z are 1, 50 and 1 times too large)"},
      {{0.02, 1.0, 1.0},
       "x in another unit than the other coordinates (x, y and z are 0.02, 1 and 1 times too large)"}};
  for (const auto& [factors, words] : expected) {
    Measured m = right;
    scale(m, factors);
    const std::vector<Suspicion> found = suspicions_of_frames(m);
    EXPECT_EQ(has(found, "length_unit"), !words.empty()) << text(found);
    EXPECT_FALSE(has(found, "scale")) << text(found);
    EXPECT_THAT(text(found), HasSubstr(words));
  }
}

TEST(Suspicions, SayNothingOfScalesBesideAFrameThatIsKnown) {
  Measured m = exact(light_arm(), 1, {.configurations = 12, .targets = 1, .noise = 1e-6});
  scale(m, Vector3d::Constant(1.1));
  EXPECT_TRUE(has(suspicions_of_frames(m), "scale"));
  SuspicionOptions base;
  base.registration.known_base = m.truth.X_WB;
  EXPECT_FALSE(has(suspicions_of_frames(m, base), "scale"));
  SuspicionOptions target;
  target.registration.known_targets = m.truth.targets;
  EXPECT_FALSE(has(suspicions_of_frames(m, target), "scale"));
}

/// What a scale of the points leaves beside what they leave as they are, in the robot's unit.
struct Explained {
  double ratio = 0.0;   // present / left
  double chance = 1.0;  // of as large a ratio
};

Explained explained_by_scale(const Measured& m) {
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(m.model, nominal_start(m.model, m.data), m.data);
  const double factor = std::cbrt(coordinate_scales(X_BF, m.data)->prod());
  const Measurements reading = divided(m.data, Vector3d::Constant(factor));
  const double left = rms_of(m.model, reading, nominal_start(m.model, reading));
  const double present = rms_of(m.model, m.data, nominal_start(m.model, m.data)) / std::max(1.0, factor);
  const double freedom = 3.0 * static_cast<double>(m.data.joint_values.cols()) - 9.0;
  return {present / left, f_upper_tail(std::pow(present / left, 2), freedom, freedom)};
}

TEST(Suspicions, TakeAReadingThatLeavesAThirdByMoreThanChance) {
  for (const auto& one : {std::pair(0.7, 20), std::pair(1.6, 20), std::pair(1.6, 5)}) {
    const double factor = one.first;
    const int configurations = one.second;
    const auto noisy = [&](double size) {
      Measured m = exact(light_arm(), 4,
                         {.configurations = configurations, .targets = configurations == 5 ? 3 : 1, .noise = 0.0});
      scale(m, Vector3d::Constant(factor));
      disturb(m, size);
      return m;
    };
    const double size = testing::onset(
        0.0, 0.3, [&](double s) { return !has(suspicions_of_frames(noisy(s)), "scale"); }, 7);
    const Explained at = explained_by_scale(noisy(size));
    if (configurations == 20) {
      EXPECT_NEAR(at.ratio, 3.0, 0.2) << factor << ", noise of " << size;
    } else {
      EXPECT_NEAR(std::log10(at.chance), -4.0, 0.4) << factor << ", noise of " << size;
      EXPECT_GT(at.ratio, 4.0) << "no fair comparison";
    }
  }
}

TEST(Suspicions, TellPointsThatMoveLessThanATwentiethAsFarAsTheFlange) {
  const Measured right = exact(light_arm(), 2, {.configurations = 20, .targets = 2});
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(right.model, right.truth, right.data);
  const auto moving = [&](double size) {
    Measured m = right;
    for_rows(m, [](Observation& o) { o.position = Vector3d(0.1, 0.2, 0.3); });
    disturb(m, size);
    return m;
  };
  const double unit = relative_motion(X_BF, moving(1.0).data);
  EXPECT_TRUE(has(suspicions_of_frames(moving(0.046 / unit)), "tool_frame"));
  EXPECT_FALSE(has(suspicions_of_frames(moving(0.054 / unit)), "tool_frame"));
}

// ---- gains ---------------------------------------------------------------------------------------------------------

TEST(Suspicions, DoubtAGainOfMoreThanOnePerCentThatTheFitHas) {
  Measured right = measured(light_arm(), 5, {.configurations = 20});
  right.model.effects = gain_terms(right.model);
  for (EffectTerm& term : right.model.effects) {
    term.scale = 2.0;
  }
  const Unknowns free = right.free.with_all(right.model, UnknownGroup::effects);
  for (const double gain : {-0.0106, -0.0094, 0.0094, 0.0106}) {
    Measured m = right;
    m.data.joint_values.row(2) /= 1.0 + gain;
    Estimate start = nominal_start(m.model, m.data);
    start.effects = Eigen::VectorXd::Zero(6);
    const Estimate fit = identify_jointly(m.model, m.data, start, free).estimate;
    ASSERT_NEAR(fit.effects[2] / 2.0, gain, 2e-4);
    EXPECT_EQ(has(suspicions(m.model, m.data, fit, free), "joint_gain"), std::abs(gain) > 0.01) << gain;
  }
}

TEST(Suspicions, SayByHowMuchAJointMovesOtherwiseAndWhetherOthersDo) {
  const ErrorModel odd = complete_model(parse_robot(testing::kOddArm));
  Measured slide = measured(odd, 5, {.configurations = 30, .targets = 2, .angle = 0.001});
  slide.data.joint_values.row(1) /= 0.95;
  EXPECT_THAT(text(suspicions_of(slide)), HasSubstr("slide moving 0.95 times as far as its values say (a unit, a gear "
                                                    "ratio or an encoder set wrong)"));
  Measured two = measured(light_arm(), 5, {.configurations = 30, .targets = 2, .angle = 0.001, .noise = 1e-6});
  two.data.joint_values.row(1) /= 1.08;
  two.data.joint_values.row(2) /= 1.04;
  EXPECT_THAT(text(suspicions_of(two)),
              HasSubstr("shoulder_lift turning 1.08 times as far as its values say, and 1 more "
                        "joints likewise (a unit"));
}

// A gain of a joint that hardly moves the points is no matter where the fit is good anyway.
TEST(Suspicions, LookForGainsFromAMisfitOfATenThousandthOfTheArmOn) {
  int looked = 0;
  for (const double lever : {0.006, 0.007, 0.008, 0.009}) {
    Measured m = measured(light_arm(), 6, {.configurations = 20, .targets = 2, .lever = lever, .noise = 1e-6});
    m.data.joint_values.row(5) *= 1.02;
    const Estimate fit = identify_jointly(m.model, m.data, nominal_start(m.model, m.data), m.free).estimate;
    const double share = rms_of(m.model, m.data, fit) / arm_length(m.model);
    EXPECT_EQ(has(suspicions(m.model, m.data, fit, m.free), "joint_gain"), share >= 1e-4) << lever << ": " << share;
    looked += share >= 1e-4 ? 1 : 0;
    EXPECT_TRUE(share > 5e-5 && share < 2e-4) << "no fair comparison: " << share;
  }
  EXPECT_TRUE(looked > 0 && looked < 4) << "no fair comparison";
}

// ---- what moved ----------------------------------------------------------------------------------------------------

TEST(Suspicions, SayHowFarTheBaseMovedAndWhatIsLeft) {
  const std::vector<std::pair<double, std::string>> expected = {
      {0.09994, "99.9 mm"}, {0.09996, "100 mm"}, {0.000996, "1.0 mm"}, {0.000994, "0.994 mm"}};
  for (const auto& [size, words] : expected) {
    Measured m = exact(light_arm(), 3, {.configurations = 14, .targets = 1, .noise = 1e-7});
    moved_from(6, size * Vector3d(0.6, -0.48, 0.64)).make(m);
    EXPECT_THAT(
        text(suspicions_of_truth(m)),
        AllOf(HasSubstr("a base that moved against the measuring device by " + words + " (turned by "),
              HasSubstr(" mrad) after configuration 6 if the file is in the order of measurement it is 0.000 mm; "
                        "nothing was switched")));
  }
}

TEST(Suspicions, SayHowFarTheBaseTurnedAndDrifted) {
  Measured turned = exact(light_arm(), 3, {.configurations = 14, .targets = 1, .noise = 1e-7});
  for_rows(turned, [&](Observation& o) {
    o.position = o.configuration >= 6 ? Vector3d(rotation_exp({0.0, 0.0, 0.0017}) * o.position) : o.position;
  });
  EXPECT_THAT(text(suspicions_of_truth(turned)), HasSubstr("(turned by 1.7 mrad) after configuration 6"));
  Measured drifted = exact(light_arm(), 3, {.configurations = 14, .targets = 1, .noise = 1e-7});
  for_rows(drifted, [](Observation& o) { o.position.x() += 0.0039 * o.configuration / 13.0; });
  const std::vector<Suspicion> found = suspicions_of_truth(drifted);
  EXPECT_THAT(causes(found), ElementsAre("drift"));
  EXPECT_THAT(text(found), HasSubstr("a base that drifts against the measuring device, by 3.9 mm (turned by "));
}

// ---- remarks -------------------------------------------------------------------------------------------------------

/// Residuals of which a function of the second joint explains this share.
Measured with_function(int configurations, double size, double noise) {
  Measured m = exact(light_arm(), 8, {.configurations = configurations, .targets = 2, .noise = 0.0});
  for_rows(m, [&](Observation& o) {
    o.position += size * std::sin(m.data.joint_values(1, o.configuration)) * Vector3d(0.6, 0.0, 0.8);
  });
  disturb(m, noise);
  return m;
}

TEST(Suspicions, RemarkAFunctionOfAJointThatExplainsMoreThanHalfByMoreThanChance) {
  for (const int configurations : {9, 10, 30}) {
    const auto judged = [&](double noise) { return with_function(configurations, 0.001, 0.001 * noise); };
    const auto share_of = [&](const Measured& m) { return explained_by_joints(m.model, m.truth, m.data)[1]; };
    const double rest = 3.0 * configurations - 6.0;
    const auto chance_of = [&](double share) { return f_upper_tail(share / 6.0 / (1.0 - share) * rest, 6.0, rest); };
    const double noise = testing::onset(
        0.01, 2.0,
        [&](double size) {
          const double share = share_of(judged(size));
          return share < 0.5 || chance_of(share) > 1e-3;
        },
        9);
    for (const double times : configurations == 9 ? std::vector{0.97} : std::vector{0.97, 1.03}) {
      const Measured m = judged(times * noise);
      const std::vector<Suspicion> found = suspicions_of_truth(m);
      const bool expected = times < 1.0 && configurations >= 10;
      EXPECT_EQ(has(found, "joint_function"), expected) << configurations << ", " << share_of(m) << text(found);
      if (expected) {
        EXPECT_THAT(text(found),
                    HasSubstr("a function of shoulder_lift alone explains " + significant(100.0 * share_of(m), 2) +
                              " % of the residuals' squares (p = " + significant(chance_of(share_of(m)), 1) + ")"));
      }
    }
  }
}

TEST(Suspicions, RemarkNoFunctionOfAJointInResidualsOfATenthOfAMicrometre) {
  for (const double size : {0.8e-7, 1.25e-7}) {
    Measured m = with_function(20, 1e-4, 1e-5);
    const double present =
        std::min(rms_of(m.model, m.data, m.truth), rms_of(m.model, m.data, nominal_start(m.model, m.data)));
    m = with_function(20, 1e-4 * size / present, 1e-5 * size / present);
    EXPECT_EQ(has(suspicions_of_truth(m), "joint_function"), size > 1e-7) << size;
  }
}

TEST(Suspicions, RemarkHowManyConfigurationsAreTwinsAndLookForCopiesAmongTwenty) {
  for (const int copied : {19, 20}) {
    Measured m = exact(light_arm(), 9, {.configurations = 44, .targets = 1, .noise = 1e-6});
    for (int c = 0; c < 22; ++c) {
      m.data.joint_values.col(22 + c) = m.data.joint_values.col(c);
    }
    for_rows(m, [&](Observation& o) { o.split = o.configuration < 22 ? Split::test : Split::train; });
    m.data.observations[static_cast<std::size_t>(copied)].position =
        m.data.observations[static_cast<std::size_t>(copied) + 22].position;
    const std::vector<Suspicion> found = suspicions_of_truth(m);
    EXPECT_THAT(text(found), HasSubstr("configurations 23 and 1 (and 21 more) have the same joint values"));
    EXPECT_EQ(has(found, "copied_rows"), copied == 19) << text(found);
    if (copied == 19) {
      EXPECT_THAT(text(found),
                  HasSubstr("test configuration 20 has the very points of train configuration 42: copied rows"));
    }
  }
}

TEST(Suspicions, TakeEqualPointsForCopiesOfTheSameTargetAlone) {
  Measured m = exact(light_arm(), 9, {.configurations = 12, .targets = 2, .noise = 1e-6});
  m.data.joint_values.col(7) = m.data.joint_values.col(2);
  m.data.joint_values.col(9) = m.data.joint_values.col(2);
  for_rows(m, [&](Observation& o) {
    o.split = o.configuration == 7 ? Split::test : Split::train;
    if (o.configuration == 7) {  // the points of the other target
      o.position = m.data.observations[static_cast<std::size_t>(4 + 1 - o.target)].position;
    }
  });
  const std::vector<Suspicion> found = suspicions_of_truth(m);
  EXPECT_THAT(text(found), HasSubstr("configurations 3 and 8 (and 1 more) have the same joint values"));
  EXPECT_FALSE(has(found, "copied_rows")) << text(found);
}

TEST(Suspicions, TakeEachTwinBesideTheOneInFrontOfIt) {
  Measured m = exact(light_arm(), 9, {.configurations = 12, .targets = 2, .noise = 1e-6});
  m.data.joint_values.col(7) = m.data.joint_values.col(2);
  m.data.joint_values.col(9) = m.data.joint_values.col(2);
  for_rows(m, [&](Observation& o) {
    o.split = o.configuration == 9 ? Split::test : Split::train;
    if (o.configuration == 9) {
      o.position = m.data.observations[static_cast<std::size_t>(o.target) + 14].position;
    }
  });
  const std::vector<Suspicion> found = suspicions_of_truth(m);
  EXPECT_THAT(text(found), AllOf(HasSubstr("configurations 3 and 8 (and 1 more) have the same joint values"),
                                 HasSubstr("test configuration 10 has the very points of train configuration 8")));
}

// ---- lengths in common ---------------------------------------------------------------------------------------------

/// The factor on all lengths, and how likely errors are that agree as well: every column by itself.
std::pair<double, double> common_factor(const Measured& m, const Estimate& fit) {
  const Unknowns complete = Unknowns(m.model, fit.targets, {}).with_all(m.model, UnknownGroup::geometric);
  const auto rows = static_cast<Eigen::Index>(3 * m.data.observations.size());
  Eigen::MatrixXd J(rows, m.free.size());
  Eigen::MatrixXd all(rows, complete.size());
  Eigen::VectorXd z(rows);
  for (std::size_t i = 0; i < m.data.observations.size(); ++i) {
    const Observation& o = m.data.observations[i];
    const auto at = static_cast<Eigen::Index>(3 * i);
    const auto k = static_cast<std::size_t>(o.target);
    J.middleRows<3>(at) = PositionPredictor(m.model, fit, m.free).jacobians(m.data, o.configuration)[k];
    all.middleRows<3>(at) = PositionPredictor(m.model, fit, complete).jacobians(m.data, o.configuration)[k];
    z.segment<3>(at) = o.position;
  }
  const auto [first, count] = m.free.range(UnknownGroup::geometric);
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(J);
  const Eigen::VectorXd x = qr.solve(z).segment(first, count);
  Eigen::MatrixXd M = qr.solve(all).middleRows(first, count);
  for (Eigen::Index p = 0; p < M.cols(); ++p) {
    M.col(p) *= usual_error(m.model, m.model.parameters[static_cast<std::size_t>(p)]);
  }
  Eigen::VectorXd e(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    e[i] = fit.errors[static_cast<Eigen::Index>(m.free.geometric()[static_cast<std::size_t>(i)])];
  }
  const double misfit = rms_of(m.model, m.data, fit);
  const Eigen::MatrixXd C =
      M * M.transpose() + misfit * misfit / 3.0 * (J.transpose() * J).inverse().block(first, first, count, count);
  const Eigen::MatrixXd weight = C.inverse();
  const double share = x.dot(weight * e) / x.dot(weight * x);
  const Eigen::VectorXd rest = e - share * x;
  const double left = rest.dot(weight * rest);
  const auto freedom = static_cast<double>(count - 1);
  return {1.0 / (1.0 - share), f_upper_tail((e.dot(weight * e) - left) / left * freedom, 1.0, freedom)};
}

TEST(Suspicions, TakeNoLengthsForScaledThatAgreeByChance) {
  int taken = 0;
  int near = 0;
  for (const double factor : {1.0075, 1.010, 1.0125, 1.015, 1.0175}) {
    Measured m = measured(light_arm(), 12,
                          {.configurations = 16, .targets = 2, .length = 0.003, .angle = 0.003, .noise = 0.0015});
    scale(m, Vector3d::Constant(factor));
    const Estimate fit = identify_jointly(m.model, m.data, nominal_start(m.model, m.data), m.free).estimate;
    const auto [found, chance] = common_factor(m, fit);
    const bool expected = std::abs(found - 1.0) > 0.005 && chance < 1e-4;
    const std::vector<Suspicion> all = suspicions(m.model, m.data, fit, m.free);
    EXPECT_EQ(has(all, "scale"), expected) << factor << ": found " << found << " by a chance of " << chance;
    if (expected) {
      ++taken;
      EXPECT_THAT(text(all), HasSubstr("all lengths of the arm are found " + significant(found, 5) + " times"));
    }
    near += chance > 1e-6 && chance < 1e-2 ? 1 : 0;
  }
  EXPECT_TRUE(taken > 0 && taken < 5 && near > 1) << "no fair comparison";
}

TEST(Suspicions, TellACommonLengthOfSixErrorsAtLeastAndWithTheWholeBaseFree) {
  Measured m = exact(light_arm(), 1, {.configurations = 16, .targets = 2, .noise = 1e-6});
  scale(m, Vector3d::Constant(1.012));
  const std::vector<std::size_t> all = m.free.geometric();
  const auto judged = [&](const Unknowns& free) {
    const Estimate fit = identify_jointly(m.model, m.data, nominal_start(m.model, m.data), m.free).estimate;
    return text(suspicions(m.model, m.data, fit, free));
  };
  EXPECT_THAT(judged(m.free), HasSubstr("all lengths of the arm"));
  EXPECT_THAT(judged(m.free.with(m.model, UnknownGroup::base, {0, 1, 2, 3, 4})),
              ::testing::Not(HasSubstr("all lengths of the arm")));
  // Lengths alone, which share the factor as all errors do.
  std::vector<std::size_t> lengths;
  for (const std::size_t p : all) {
    if (is_length(m.model, m.model.parameters[p]) && lengths.size() < 6) {
      lengths.push_back(p);
    }
  }
  ASSERT_EQ(lengths.size(), 6U);
  EXPECT_THAT(judged(m.free.with(m.model, UnknownGroup::geometric, lengths)), HasSubstr("all lengths of the arm"));
  lengths.pop_back();
  EXPECT_THAT(judged(m.free.with(m.model, UnknownGroup::geometric, lengths)),
              ::testing::Not(HasSubstr("all lengths of the arm")));
}

// ---- which rows are looked at --------------------------------------------------------------------------------------

std::string misfit_words(const Measured& m, const Measurements& of) {
  return "leave a misfit of " + fixed(1e3 * rms_of(m.model, of, nominal_start(m.model, of)), 1) + " mm";
}

TEST(Suspicions, LookAtThreeHundredConfigurationsAtMost) {
  Measured m = exact(light_arm(), 10, {.configurations = 410, .targets = 1});
  scale(m, Vector3d::Constant(1.05));
  for_rows(m, [](Observation& o) { o.split = o.configuration % 10 == 0 ? Split::test : Split::train; });
  EXPECT_THAT(text(suspicions_of_frames(m)), HasSubstr(misfit_words(m, training_sample(m.data, 300))));
  EXPECT_NE(misfit_words(m, training_sample(m.data, 300)), misfit_words(m, training_sample(m.data, 1000)));
}

// The last joint turns about the line through the points: orientations alone show its sign.
TEST(Suspicions, LookAtOrientationsAsPointsBesideThem) {
  const Eigen::Vector3d on_axis(0.0, 0.2, 0.0);
  testing::VirtualExperiment experiment({.targets = testing::as_frames(testing::targets_at({on_axis})),
                                         .sizes = {.length = 0.0, .angle = 0.0, .target_length = 0.0}});
  Eigen::MatrixXd q = experiment.configurations(90);
  q.col(40) = q.col(3);
  Measurements data = testing::without_sigmas(experiment.measure(q, {.sigma = 1e-5, .orientation_sigma = 1e-5}));
  const Unknowns free = experiment.free.without(UnknownGroup::geometric);
  EXPECT_THAT(causes(suspicions(experiment.model, data, nominal_start(experiment.model, data), free)),
              ElementsAre("same_configuration"));
  data.joint_values.row(5) *= -1.0;
  const Estimate fit = nominal_start(experiment.model, data);
  const std::vector<Suspicion> found = suspicions(experiment.model, data, fit, free);
  EXPECT_THAT(causes(found), ElementsAre("joint_sign", "same_configuration")) << text(found);
  const PosePoints points = pose_points(experiment.model, data, fit, free, {});
  const Measurements sample = training_sample(points.measurements, 75);
  EXPECT_THAT(text(found),
              HasSubstr("leave a misfit of " +
                        fixed(1e3 * std::min(rms_of(experiment.model, sample, points.fit),
                                             rms_of(experiment.model, sample, nominal_start(experiment.model, sample))),
                              1) +
                        " mm (orientations as points 100 mm away); with joint_6 with the opposite sign it is 0."));
}

// Whatever the answer is that they are asked about.
TEST(Suspicions, CompareWithWhatTheSameFitLeavesOfThePresentReading) {
  Measured m = measured(light_arm(), 14, {.configurations = 20, .targets = 2, .length = 0.001, .angle = 0.001});
  moved_from(9, {0.004, -0.003, 0.002}).make(m);
  const Estimate start = nominal_start(m.model, m.data);
  const double left = rms_of(m.model, m.data, identify_jointly(m.model, m.data, start, m.free).estimate);
  ASSERT_LT(left, 0.9 * rms_of(m.model, m.data, start));
  EXPECT_THAT(text(suspicions(m.model, m.data, start, m.free)),
              HasSubstr("the measurements leave a misfit of " + fixed(1e3 * left, 1) + " mm"));
}

TEST(Suspicions, TryReadingsBesideTheFramesThatAreKnown) {
  Measured m = exact(light_arm(), 11, {.configurations = 14, .targets = 1});
  m.data.joint_values.row(2) *= -1.0;
  const Estimate start = nominal_start(m.model, m.data);
  EXPECT_TRUE(has(suspicions(m.model, m.data, start, Unknowns()), "joint_sign"));
  SuspicionOptions elsewhere;
  elsewhere.registration.known_base = Eigen::Isometry3d::Identity();
  EXPECT_FALSE(has(suspicions(m.model, m.data, start, Unknowns(), elsewhere), "joint_sign"));
}

// With two configurations and frames that are known a reading is the better one by chance now and then, and the more
// readings there are the more often.
TEST(Suspicions, CountTheReadingsThatWereTried) {
  const Measured right = exact(light_arm(), 13, {.configurations = 2, .targets = 1, .noise = 0.0});
  SuspicionOptions known;
  known.registration.known_base = right.truth.X_WB;
  known.registration.known_targets = right.truth.targets;
  const auto noisy = [&](double size) {
    Measured m = right;
    m.data.joint_values.row(1) *= -1.0;
    disturb(m, size);
    return m;
  };
  const double size = testing::onset(
      0.0, 0.3,
      [&](double s) {
        const Measured m = noisy(s);
        return !has(suspicions(m.model, m.data, m.truth, Unknowns(), known), "joint_sign");
      },
      11);
  const Measured m = noisy(size);
  const std::vector<ConventionTrial> trials =
      try_conventions(m.model, m.data, Unknowns(), {.used = nullptr, .others = {}, .registration = known.registration});
  const double ratio = rms_of(m.model, m.data, m.truth) / trials.front().rms;
  const double chance = f_upper_tail(ratio * ratio, 6.0, 6.0) * (2.0 + static_cast<double>(trials.size()));
  EXPECT_EQ(trials.front().description, "shoulder_lift with the opposite sign");
  EXPECT_NEAR(std::log10(chance), -4.0, 0.1) << "with noise of " << size << " m, " << trials.size() << " readings";
}

TEST(Suspicions, RefuseWhatDoesNotHoldTogether) {
  const Measured m = measured(light_arm(), 1, {.configurations = 6});
  Estimate estimate = m.truth;
  estimate.effects.resize(0);
  Estimate other = estimate;
  other.targets.pop_back();
  EXPECT_THROW(suspicions(m.model, m.data, other, m.free), InputError);
  const Measured more = measured(light_arm(), 1, {.configurations = 6, .targets = 5});
  EXPECT_THROW(suspicions(m.model, m.data, estimate, more.free), InputError);
  SuspicionOptions options;
  options.registration.orientation_length = -1.0;
  EXPECT_THROW(suspicions(m.model, m.data, estimate, m.free, options), InputError);
}

}  // namespace
}  // namespace kdl_calibration
