#include "kdl_calibration/suspicions.hpp"

#include <gmock/gmock.h>

#include <algorithm>

#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/input_error.hpp"
#include "mistakes_support.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Vector3d;
using ::testing::AllOf;
using testing::Draw;
using ::testing::ElementsAre;
using testing::fanuc;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kDegree;
using testing::Measured;
using testing::measured;
using testing::true_flange;

const ErrorModel& large_arm() {
  static const ErrorModel model = complete_model(fanuc());
  return model;
}

const ErrorModel& light_arm() {
  static const ErrorModel model = complete_model(parse_robot(testing::kLightArm));
  return model;
}

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

struct Mistake {
  std::string name;
  std::function<void(Measured&)> make;
  std::string cause;
  std::string words;  // that the message has
  Draw draw = {};
};

void for_rows(Measured& m, const std::function<void(Observation&)>& change) {
  std::for_each(m.data.observations.begin(), m.data.observations.end(), change);
}

Mistake scaled(const std::string& name, double factor, const std::string& cause, const std::string& words,
               const Draw& draw = {}) {
  return {name, [=](Measured& m) { for_rows(m, [&](Observation& o) { o.position *= factor; }); }, cause, words, draw};
}

Mistake joint_times(Eigen::Index j, double factor, const std::string& cause, const std::string& words,
                    const Draw& draw = {}) {
  return {"joint " + std::to_string(j + 1) + " times " + std::to_string(factor),
          [=](Measured& m) { m.data.joint_values.row(j) *= factor; }, cause, words, draw};
}

Mistake exchanged(Eigen::Index j, Eigen::Index k) {
  return {"joints " + std::to_string(j + 1) + " and " + std::to_string(k + 1),
          [=](Measured& m) { m.data.joint_values.row(j).swap(m.data.joint_values.row(k)); }, "joint_columns",
          "exchanged"};
}

Mistake coupled(double sign) {
  return {"J3 counted with J2", [=](Measured& m) { m.data.joint_values.row(2) += sign * m.data.joint_values.row(1); },
          "joint_convention", sign > 0.0 ? " - " : " + "};
}

Mistake swapped_from(int first) {
  return {"targets exchanged",
          [=](Measured& m) {
            for_rows(m, [&](Observation& o) {
              o.target = o.configuration >= first && o.target != 2 ? 1 - o.target : o.target;
            });
          },
          "exchanged_targets", "A and B exchanged from configuration " + std::to_string(first + 1) + " on"};
}

Mistake moved_from(int first, const Vector3d& step) {
  return {"step of the base",
          [=](Measured& m) {
            for_rows(m, [&](Observation& o) { o.position += o.configuration >= first ? step : Vector3d::Zero(); });
          },
          "moved_base", "after configuration " + std::to_string(first)};
}

Mistake turned_from(int first, double angle) {
  return {"turn of the base",
          [=](Measured& m) {
            for_rows(m, [&](Observation& o) {
              if (o.configuration >= first) {
                o.position = rotation_exp({angle, 0.0, 0.0}) * o.position;
              }
            });
          },
          "moved_base", "after configuration " + std::to_string(first)};
}

std::vector<Mistake> joint_mistakes() {
  const double degree = 1.0 / kDegree;
  const Draw short_lever{.lever = 0.005};
  std::vector<Mistake> all = {joint_times(2, degree, "joint_unit", "in degrees, read as radians"),
                              joint_times(5, degree, "joint_unit", "in degrees, read as radians"),
                              joint_times(0, kDegree, "joint_unit", "in radians, read as degrees"),
                              joint_times(5, -1.0, "joint_sign", "opposite sign", short_lever),
                              joint_times(4, -1.0, "joint_sign", "opposite sign", short_lever),
                              exchanged(0, 1),
                              exchanged(1, 2),
                              exchanged(2, 4),
                              exchanged(3, 5),
                              exchanged(4, 5),
                              coupled(1.0),
                              coupled(-1.0)};
  for (Eigen::Index j = 0; j < 6; ++j) {
    all.push_back(joint_times(j, -1.0, "joint_sign", "opposite sign"));
  }
  all.push_back({"degrees as radians", [=](Measured& m) { m.data.joint_values *= degree; }, "joint_unit",
                 "all joint angles in degrees"});
  all.push_back({"radians as degrees", [](Measured& m) { m.data.joint_values *= kDegree; }, "joint_unit",
                 "all joint angles in radians"});
  all.push_back({"reversed", [](Measured& m) { m.data.joint_values = m.data.joint_values.colwise().reverse().eval(); },
                 "joint_columns", "reversed order"});
  return all;
}

std::vector<Mistake> point_mistakes() {
  const auto change = [](const std::function<void(Vector3d&)>& what) {
    return [what](Measured& m) { for_rows(m, [&](Observation& o) { what(o.position); }); };
  };
  return {scaled("feet", 1.0 / 0.3048, "length_unit", "feet read as metres"),
          scaled("inches", 1.0 / 0.0254, "length_unit", "inches read as metres"),
          scaled("centimetres", 100.0, "length_unit", "centimetres read as metres"),
          scaled("millimetres", 1000.0, "length_unit", "millimetres read as metres"),
          scaled("metres as millimetres", 0.001, "length_unit", "metres read as millimetres"),
          scaled("inches as millimetres", 0.001 / 0.0254, "length_unit", "inches read as millimetres"),
          scaled("three per cent", 1.03, "scale", "1.03"),
          scaled("one per cent", 1.01, "scale", "1.0", {.length = 0.0003, .angle = 0.001}),
          {"z in millimetres", change([](Vector3d& p) { p.z() *= 1000.0; }), "length_unit", "z in another unit"},
          {"left-handed", change([](Vector3d& p) { p.y() = -p.y(); }), "mirrored", "mirrored"},
          {"x and y exchanged", change([](Vector3d& p) { std::swap(p.x(), p.y()); }), "mirrored", "exchanged"},
          {"all three signs", change([](Vector3d& p) { p = -p; }), "mirrored", "mirrored"},
          {"frame of the tool",
           [](Measured& m) {
             for_rows(m, [&](Observation& o) { o.position = true_flange(m, o.configuration).inverse() * o.position; });
           },
           "tool_frame", "frame of the tool"}};
}

std::vector<Mistake> order_mistakes() {
  return {swapped_from(6),
          swapped_from(17),
          moved_from(14, {0.0002, -0.0002, 0.0001}),
          moved_from(5, {0.006, -0.008, 0.0}),
          moved_from(24, {0.0, 0.0, 0.0003}),
          turned_from(20, 0.001),
          turned_from(9, 0.0005),
          {"drift",
           [](Measured& m) {
             for_rows(m, [&](Observation& o) { o.position += o.configuration / 29.0 * Vector3d(2e-4, -2e-4, 1e-4); });
           },
           "drift", "drifts"}};
}

void expect_named(const std::vector<Mistake>& mistakes, std::uint64_t seeds) {
  for (const Mistake& mistake : mistakes) {
    for (const ErrorModel* model : {&large_arm(), &light_arm()}) {
      for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
        Measured m = measured(*model, seed, mistake.draw);
        mistake.make(m);
        const std::vector<Suspicion> found = suspicions_of(m);
        const std::string where = mistake.name + ", " + model->joints.front().name + ", seed " + std::to_string(seed);
        ASSERT_THAT(causes(found), ElementsAre(mistake.cause)) << where << "\n" << text(found);
        EXPECT_THAT(found.front().message, HasSubstr(mistake.words)) << where;
        EXPECT_TRUE(found.front().doubt) << where;
        EXPECT_LE(found.front().message.size(), 300U) << where;
      }
    }
  }
}

TEST(Suspicions, NameMistakesInTheJointValues) { expect_named(joint_mistakes(), 1); }
TEST(Suspicions, NameMistakesInThePoints) { expect_named(point_mistakes(), 1); }
TEST(Suspicions, NameWhatChangedWhileItWasMeasured) { expect_named(order_mistakes(), 1); }

TEST(SuspicionsLongRun, NameEveryMistakeOfTheTable) {
  expect_named(joint_mistakes(), 3);
  expect_named(point_mistakes(), 3);
  expect_named(order_mistakes(), 50);
}

// ---- no false alarms -----------------------------------------------------------------------------------------------

void expect_silence(std::uint64_t first, std::uint64_t last) {
  for (std::uint64_t seed = first; seed <= last; ++seed) {
    Random random(seed);
    const ErrorModel model = testing::random_arm(random);
    Draw draw{.configurations = 12 + static_cast<int>(random.uniform(0.0, 40.0)),
              .targets = 1 + static_cast<int>(seed % 5)};
    draw.lever = random.uniform(0.005, 0.2);
    draw.length = random.uniform(0.0, 0.003);
    draw.angle = random.uniform(0.0, 3.0 * kDegree);
    draw.noise = seed % 7 == 0 ? 0.0 : random.uniform(1e-5, 1e-4);
    draw.deflection = seed % 3 == 0 ? 0.0 : random.uniform(0.0, 0.002);
    draw.gain = seed % 4 == 0 ? random.uniform(0.0, 0.001) : 0.0;
    draw.repeats = seed % 6 == 0 ? 3 : 1;
    EXPECT_THAT(causes(suspicions_of(measured(model, seed, draw))), IsEmpty())
        << "seed " << seed << ", " << draw.configurations << " configurations of " << draw.targets << " targets";
  }
}

TEST(Suspicions, SayNothingAboutCorrectDataOfRandomArms) { expect_silence(1, 12); }
TEST(SuspicionsLongRun, SayNothingAboutCorrectDataOfThreeHundredRandomArms) { expect_silence(1, 300); }

TEST(Suspicions, SayNothingAboutShortLeversFewConfigurationsAndRepeats) {
  for (const ErrorModel* model : {&large_arm(), &light_arm()}) {
    for (const Draw& draw : {Draw{.lever = 0.005}, Draw{.configurations = 13, .targets = 1}, Draw{.repeats = 4},
                             Draw{.configurations = 5}, Draw{.noise = 0.0}}) {
      EXPECT_THAT(causes(suspicions_of(measured(*model, 4, draw))), IsEmpty()) << draw.configurations;
    }
  }
}

// ---- words ---------------------------------------------------------------------------------------------------------

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

TEST(Suspicions, RemarkThatAFunctionOfOneJointExplainsTheResiduals) {
  Measured m = measured(large_arm(), 3, {.configurations = 40});
  const Eigen::MatrixXd said = m.data.joint_values;
  Random random(3);
  VirtualRobot robot{.model = m.model, .truth = m.truth};
  robot.truth.deflections.resize(0);
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
      o.position = m.data.observations[static_cast<std::size_t>(6 + o.target)].position;
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
