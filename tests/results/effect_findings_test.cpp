#include "results/effect_findings.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "model/parameters.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"

namespace kdl_calibration::effect_findings_test {
namespace {

using ::testing::ElementsAre;
using testing::fanuc;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kDegree;

/// A calibration of the FANUC with terms of one group, all at zero, measured at joint values that are given by hand.
struct Found {
  CalibrationResult calibration;
  Measurements measurements;

  explicit Found(EffectGroup group, const Robot& robot = fanuc()) {
    const ErrorModel model = complete_model(robot);
    Random random(3);
    measurements.joint_values = random_configurations(limits_of(model.joints), 40, random);
    calibration.model = model;
    give(effect_terms(model, group, measurements.joint_values));
  }

  void give(const std::vector<EffectTerm>& terms) {
    calibration.model.effects = terms;
    values() = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(terms.size()));
  }
  Eigen::VectorXd& values() { return calibration.fit.identification.estimate.effects; }

  /// The first term of the joint for which `is` holds.
  template <class Is>
  const EffectTerm& term(int joint, Is is) const {
    return *std::find_if(calibration.model.effects.begin(), calibration.model.effects.end(),
                         [&](const EffectTerm& t) { return t.index == joint && is(t); });
  }
  /// Gives it this factor of its function.
  void set(const EffectTerm& term, double factor) {
    values()[&term - calibration.model.effects.data()] = factor * term.scale;
  }
  std::vector<std::string> words() const {
    return effect_findings(calibration, effect_motions(calibration, measurements));
  }
};

bool any(const EffectTerm& /*term*/) { return true; }

auto swings(double times, bool is_cosine = false) {
  return [=](const EffectTerm& term) {
    const auto& swing = std::get<Sinusoid>(term.function);
    return swing.times == times && swing.is_cosine == is_cosine;
  };
}

TEST(EffectFindings, NameTheJointThatMovesMost) {
  Found found(EffectGroup::gain);
  found.set(found.term(1, any), -3e-4);
  found.set(found.term(4, any), 5e-5);
  EXPECT_THAT(found.words(), ElementsAre("joint_2 moves 0.03 % less far than it is told"));
  found.set(found.term(4, any), 2e-3);
  EXPECT_THAT(found.words(), ElementsAre("joint_5 moves 0.2 % further than it is told"));
  found.set(found.term(4, any), 0.0);
  found.set(found.term(1, any), 1e-9);
  EXPECT_THAT(found.words(), IsEmpty());
  found.give({});
  EXPECT_THAT(found.words(), IsEmpty());
}

TEST(EffectFindings, StateTheRangeOfAPlayAndTheLargestMotionUnderGravity) {
  Found play(EffectGroup::backlash);
  play.set(play.term(1, any), 0.01 * kDegree);  // of tanh, which reaches both its ends
  EXPECT_THAT(play.words(),
              ElementsAre("joint_2 has a play of 0.02 degrees between one side of its load and the other"));
  Found weight(EffectGroup::gravity);
  weight.set(weight.term(1, any), 0.05 * kDegree);
  const Eigen::MatrixXd& q = weight.measurements.joint_values;
  const Eigen::MatrixXd moved = effective_joint_values(weight.calibration.model, weight.values(), q) - q;
  const EffectMotion motion = effect_motions(weight.calibration, weight.measurements)[0];
  EXPECT_EQ(motion.by.joint, 1);
  EXPECT_NEAR(motion.largest(), moved.row(1).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_THAT(weight.words()[0], ::testing::MatchesRegex("joint_2 deflects by up to 0.0[0-9]+ degrees under the arm's "
                                                         "weight"));
}

TEST(EffectFindings, SayInDegreesHowABearingTiltsThatOfASlideAsWell) {
  Found found(EffectGroup::transverse, parse_robot(testing::kOddArm));
  const auto about_y = [](const EffectTerm& term) { return term.axis == EffectAxis::across_y; };
  const EffectTerm& term = found.term(1, about_y);
  ASSERT_EQ(found.calibration.model.joints[1].type, JointType::prismatic);
  found.set(term, 0.05 * kDegree);
  const std::vector<EffectMotion> motions = effect_motions(found.calibration, found.measurements);
  const auto moved = std::find_if(motions.begin(), motions.end(), [](const auto& m) { return m.largest() > 0.0; });
  ASSERT_NE(moved, motions.end());
  EXPECT_EQ(moved->by.joint, 1);
  EXPECT_EQ(moved->by.axis, EffectAxis::across_y);
  EXPECT_FALSE(moved->is_length(found.calibration.model));
  ASSERT_EQ(found.words().size(), 1U);
  EXPECT_THAT(found.words()[0],
              ::testing::MatchesRegex(term.joint + " tilts by up to 0.0[0-9]+ degrees across its axis under the arm's "
                                                   "weight"));
}

TEST(EffectFindings, SayInMillimetresWhatASlideDoes) {
  Found found(EffectGroup::tables, parse_robot(testing::kOddArm));
  const EffectTerm& term = found.term(1, any);
  found.set(term, 1e-4);
  EXPECT_THAT(found.words()[0], ::testing::MatchesRegex("slide is off by up to 0\\.[0-9]+ mm along its range"));
}

TEST(EffectFindings, StateWhatEachGroupExplainsOfTheSquaredErrors) {
  Found found(EffectGroup::gain);
  found.set(found.term(1, any), 3e-4);
  const auto option = [](const std::vector<std::string>& effects, double rms, bool sized = true) {
    return ModelOption{.priors = {}, .effects = effects, .sized = sized, .held_out_rms = rms, .evidence = 0.0};
  };
  std::vector<ModelOption>& tried = found.calibration.selection.tried;
  tried = {option({"gravity", "gain"}, 0.6e-3), option({"gravity"}, 0.8e-3), option({"gain"}, 0.7e-3), option({}, 1e-3),
           option({}, 3e-3, false)};
  EXPECT_THAT(found.words(), ElementsAre("joint_2 moves 0.03 % further than it is told; that explains 28 % of what "
                                         "geometry leaves"));
  tried[1].held_out_rms = std::numeric_limits<double>::infinity();  // given up before it was known
  EXPECT_THAT(found.words(), ElementsAre("joint_2 moves 0.03 % further than it is told"));
  tried[1].held_out_rms = 0.6e-3;  // which it does not help
  EXPECT_THAT(found.words(), ElementsAre("joint_2 moves 0.03 % further than it is told"));
  tried = {option({"gravity"}, 0.5e-3), option({}, 1e-3)};
  EXPECT_THAT(found.words(), ElementsAre("joint_2 moves 0.03 % further than it is told")) << "named by the user";
}

TEST(EffectFindings, HaveTwoDigitsAndAtMostSixDecimals) {
  for (const auto& [share, printed] :
       {std::pair{1.234, "123"}, std::pair{0.1234, "12"}, std::pair{0.101, "10"}, std::pair{0.01236, "1.2"},
        std::pair{0.0101, "1"}, std::pair{0.001236, "0.12"}, std::pair{0.001, "0.1"}, std::pair{1.236e-5, "0.0012"},
        std::pair{1.236e-6, "0.00012"}, std::pair{1.236e-7, "0.000012"}}) {
    Found found(EffectGroup::gain);
    found.set(found.term(1, any), share);
    EXPECT_THAT(found.words(), ElementsAre(std::string("joint_2 moves ") + printed + " % further than it is told"));
  }
}

TEST(EffectFindings, TheStrongestSwingCountsSineAndCosine) {
  Found found(EffectGroup::harmonics);
  for (EffectTerm& term : found.calibration.model.effects) {  // an amplitude is that of the joint, whatever the scale
    term.scale *= std::get<Sinusoid>(term.function).times == 1.0 ? 3.0 : 1.0;
  }
  found.set(found.term(2, swings(1.0)), 0.006);
  found.set(found.term(2, swings(1.0, true)), -0.006);
  found.set(found.term(2, swings(2.0)), -0.008);
  EXPECT_THAT(found.words().at(0), HasSubstr("mostly once a turn"));
  found.set(found.term(2, swings(2.0)), -0.009);
  EXPECT_THAT(found.words().at(0), HasSubstr("mostly twice a turn"));
  Found ripple(EffectGroup::ripple);
  ripple.set(ripple.term(2, any), 0.002);
  EXPECT_THAT(ripple.words().at(0), ::testing::MatchesRegex("joint_3 ripples by up to 0.1[0-9]* degrees, mostly 100 "
                                                            "times a turn"));
}

/// Backlash of joint 2 by its direction of approach and by its load.
TEST(EffectFindings, APlayIsOfTheSideThatMostOfItGoesWith) {
  Found found(EffectGroup::gain);
  const Eigen::Index count = found.measurements.joint_values.cols();
  found.measurements.signals.approach = Eigen::MatrixXd::Ones(6, count);
  found.measurements.signals.approach.leftCols(count / 2).setConstant(-1.0);
  std::vector<EffectTerm> terms = effect_terms(complete_model(fanuc()), EffectGroup::backlash,
                                               found.measurements.joint_values, found.measurements.signals);
  std::erase_if(terms, [](const EffectTerm& term) { return term.index != 1; });
  ASSERT_EQ(terms.size(), 2U);
  found.give(terms);
  Eigen::VectorXd& values = found.values();
  const auto of_approach = [](const EffectTerm& t) { return std::holds_alternative<ApproachSide>(t.function); };
  const Eigen::Index approach = &found.term(1, of_approach) - found.calibration.model.effects.data();
  for (const auto& [by_approach, by_load, mostly] : {std::tuple{1.1e-4, -1e-4, true}, std::tuple{-1.1e-4, 1e-4, true},
                                                     std::tuple{1e-4, -1.1e-4, false}, std::tuple{1e-4, 1e-4, false}}) {
    values[approach] = by_approach;
    values[1 - approach] = by_load;
    EXPECT_THAT(found.words().at(0), HasSubstr(mostly ? "between coming from one side and from the other"
                                                      : "between one side of its load and the other"))
        << by_approach << ", " << by_load;
  }
  values << 0.0, 0.0;
  values[approach] = 0.01 * kDegree / found.term(1, of_approach).scale;
  const EffectMotion motion = effect_motions(found.calibration, found.measurements).at(0);
  EXPECT_LT(motion.lowest, 0.0);
  values[approach] *= 0.03 * kDegree / (motion.highest - motion.lowest);
  EXPECT_THAT(found.words(),
              ElementsAre("joint_2 has a play of 0.03 degrees between coming from one side and from the other"));
}

TEST(EffectFindings, SayHowFarMeasuredTorquesBendAJoint) {
  Found found(EffectGroup::gain);
  found.measurements.signals.torques = 1e3 * found.measurements.joint_values;
  found.give(effect_terms(complete_model(fanuc()), EffectGroup::torque, found.measurements.joint_values,
                          found.measurements.signals));
  found.set(found.term(3, any), 1e-6);
  EXPECT_THAT(found.words().at(0),
              ::testing::MatchesRegex("joint_4 deflects by up to 0\\.[0-9]+ degrees under its measured torque"));
}

TEST(EffectFindings, OfTheFirstGroupIsWhatItTakesOffGeometryAlone) {
  Found found(EffectGroup::gain);
  found.set(found.term(1, any), 3e-4);
  const auto said = [&](double all, double after) {
    found.calibration.selection.tried = {{.effects = {"gain"}, .held_out_rms = after},
                                         {.effects = {}, .held_out_rms = all}};
    const std::string words = found.words().at(0);
    const std::size_t place = words.find(';');
    return place == std::string::npos ? std::string() : words.substr(place);
  };
  EXPECT_EQ(said(1e-3, 0.6e-3), "; that explains 64 % of what geometry leaves");
  EXPECT_EQ(said(1e-3, std::sqrt(0.994) * 1e-3), "; that explains 1 % of what geometry leaves");
  EXPECT_EQ(said(1e-3, std::sqrt(0.996) * 1e-3), "");
  EXPECT_EQ(said(1e-3, 1.2e-3), "");
  EXPECT_EQ(said(2.0, 1.0), "; that explains 75 % of what geometry leaves");
  EXPECT_EQ(said(0.0, 0.0), "");
  EXPECT_EQ(said(std::numeric_limits<double>::infinity(), 1e-3), "");
}

TEST(EffectFindings, AreOneOfEachGroupInTheirOrder) {
  Found found(EffectGroup::gain);
  std::vector<EffectTerm> terms =
      effect_terms(complete_model(fanuc()), EffectGroup::tables, found.measurements.joint_values);
  terms.insert(terms.end(), found.calibration.model.effects.begin(), found.calibration.model.effects.end());
  found.give(terms);
  const auto is = [](EffectGroup group) { return [group](const EffectTerm& t) { return t.group() == group; }; };
  found.set(found.term(0, is(EffectGroup::tables)), 1e-3);
  found.set(found.term(5, is(EffectGroup::tables)), 1.5e-3);
  found.set(found.term(2, is(EffectGroup::gain)), 1e-3);
  EXPECT_THAT(found.words(),
              ElementsAre("joint_3 moves 0.1 % further than it is told", HasSubstr("joint_6 is off by up to ")));
  const std::vector<EffectMotion> motions = effect_motions(found.calibration, found.measurements);
  ASSERT_EQ(motions.size(), 12U);
  EXPECT_EQ(motions[2].by.group, EffectGroup::gain);
  EXPECT_EQ(motions[2].by.joint, 2);
  const auto q = found.measurements.joint_values.row(2);
  EXPECT_NEAR(motions[2].highest - motions[2].lowest, 1e-3 * (q.maxCoeff() - q.minCoeff()), 1e-12);
}

}  // namespace
}  // namespace kdl_calibration::effect_findings_test
