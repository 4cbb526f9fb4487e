#include "kdl_calibration/suspicions.hpp"

#include <gmock/gmock.h>

#include <algorithm>

#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/input_error.hpp"
#include "mistake_table.hpp"

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

}  // namespace
}  // namespace kdl_calibration
