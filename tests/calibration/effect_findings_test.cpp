#include "calibration/effect_findings.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "support.hpp"

namespace kdl_calibration {
namespace {

using ::testing::ElementsAre;
using testing::fanuc;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kDegree;

/// A calibration of the FANUC with terms of one group, all at zero, measured at joint values that are given by hand.
struct Found {
  Calibration calibration;
  Measurements measurements;

  explicit Found(EffectGroup group, const Robot& robot = fanuc()) {
    const ErrorModel model = complete_model(robot);
    Random random(3);
    measurements.joint_values = random_configurations(limits_of(model.joints), 40, random);
    calibration.model = model;
    calibration.model.effects = effect_terms(model, group, measurements.joint_values);
    calibration.identification.estimate.effects =
        Eigen::VectorXd::Zero(static_cast<Eigen::Index>(calibration.model.effects.size()));
  }

  /// The first term of the joint for which `is` holds.
  template <class Is>
  const EffectTerm& term(int joint, Is is) const {
    return *std::find_if(calibration.model.effects.begin(), calibration.model.effects.end(),
                         [&](const EffectTerm& t) { return t.index == joint && is(t); });
  }
  /// Gives it this factor of its function.
  void set(const EffectTerm& term, double factor) {
    calibration.identification.estimate.effects[&term - calibration.model.effects.data()] = factor * term.scale;
  }
  std::vector<std::string> words() const {
    return effect_findings(calibration, effect_motions(calibration, measurements));
  }
};

bool any(const EffectTerm& /*term*/) { return true; }

TEST(EffectFindings, NameTheJointThatMovesMost) {
  Found found(EffectGroup::gain);
  found.set(found.term(1, any), -3e-4);
  found.set(found.term(4, any), 5e-5);
  EXPECT_THAT(found.words(), ElementsAre("joint_2 moves 0.03 % less far than it is told"));
  found.set(found.term(4, any), 2e-3);
  EXPECT_THAT(found.words(), ElementsAre("joint_5 moves 0.2 % further than it is told"));
  found.set(found.term(4, any), 0.0);
  found.set(found.term(1, any), 2.24e-7);
  EXPECT_THAT(found.words(), ElementsAre("joint_2 moves 0.000022 % further than it is told"));
  found.set(found.term(1, any), 1e-9);
  EXPECT_THAT(found.words(), IsEmpty());
}

TEST(EffectFindings, CountTheSwingsOfATurn) {
  Found found(EffectGroup::harmonics);
  found.set(found.term(2, [](const EffectTerm& t) { return t.harmonic == 2; }), 0.1 * kDegree);
  found.set(found.term(2, [](const EffectTerm& t) { return t.harmonic == 1; }), 0.002 * kDegree);
  ASSERT_EQ(found.words().size(), 1U);
  EXPECT_THAT(found.words()[0], HasSubstr("joint_3 swings by up to 0.1"));
  EXPECT_THAT(found.words()[0], HasSubstr(" degrees, mostly twice a turn"));
}

TEST(EffectFindings, StateTheRangeOfAPlayAndTheLargestMotionUnderGravity) {
  Found play(EffectGroup::backlash);
  play.set(play.term(1, any), 0.01 * kDegree);  // of tanh, which reaches both its ends
  EXPECT_THAT(play.words(),
              ElementsAre("joint_2 has a play of 0.02 degrees between one side of its load and the other"));
  Found weight(EffectGroup::gravity);
  const EffectTerm& term = weight.term(1, any);
  weight.set(term, 0.05 * kDegree);
  const Eigen::VectorXd values = weight.calibration.identification.estimate.effects;
  const Eigen::MatrixXd moved =
      effective_joint_values(weight.calibration.model, values, weight.measurements.joint_values) -
      weight.measurements.joint_values;
  const EffectMotion motion = effect_motions(weight.calibration, weight.measurements)[0];
  EXPECT_EQ(motion.by.joint, 1);
  EXPECT_NEAR(motion.largest(), moved.row(1).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_THAT(weight.words()[0], ::testing::MatchesRegex("joint_2 gives way by up to 0.0[0-9]+ degrees under the arm's "
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
  std::vector<ModelOption>& tried = found.calibration.tried;
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

TEST(EffectFindings, AreNoneWithoutEffects) {
  Found found(EffectGroup::gain);
  found.calibration.model.effects.clear();
  found.calibration.identification.estimate.effects.resize(0);
  EXPECT_THAT(found.words(), IsEmpty());
}

}  // namespace
}  // namespace kdl_calibration
