// The block `effects` of a result: what is written is read back, and what no result can hold is refused.

#include "calibration/effects_json.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "kdl_calibration/result_json.hpp"
#include "kdl_calibration/simulation.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration {
namespace {

using Json = nlohmann::ordered_json;
using ::testing::HasSubstr;
using testing::refusal;

/// A term of every sort there is, and the joint values and signals that tell them apart.
struct EverySort {
  ErrorModel model = complete_model(testing::fanuc());
  DrivenConfigurations driven;
  Eigen::VectorXd values;

  EverySort() {
    Random random(3);
    const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
    driven = driven_to(model, q, {}, {.approach = true, .torques = true});
    for (const std::string& name : effect_group_names()) {
      for (EffectTerm& term : effect_terms(model, *effect_group(name), q, driven.signals)) {
        term.sigma = 1e-4;
        model.effects.push_back(std::move(term));
      }
    }
    for (EffectTerm& term : ripple_terms(model, q, 2, 200.5)) {
      term.sigma = 2e-4;
      model.effects.push_back(std::move(term));
    }
    for (EffectTerm& term : model.effects) {
      if (term.group == EffectGroup::tables && term.index == 3) {
        term.table.withheld = {{-1.5, -1.0}, {0.25, 0.5}};
      }
    }
    values = Eigen::VectorXd::LinSpaced(static_cast<Eigen::Index>(model.effects.size()), -3e-4, 5e-4);
  }

  Json json() const { return Json::parse(effects_json(model, values)); }
};

const EverySort& every_sort() {
  static const EverySort one;
  return one;
}

TEST(EffectsJson, EverySortOfTermIsReadBackToTheLastBit) {
  const ErrorModel rigid = complete_model(testing::fanuc());
  const Json json = every_sort().json();
  const SavedEffects read = read_effects({json, "effects"}, rigid);
  ErrorModel model = rigid;
  model.effects = read.terms;
  ASSERT_EQ(model.effects.size(), every_sort().model.effects.size());
  EXPECT_TRUE(read.values == every_sort().values);
  const auto& [q, signals] = every_sort().driven;
  EXPECT_TRUE(effect_basis(model, q, signals) == effect_basis(every_sort().model, q, signals));
  int withheld = 0;
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    const EffectTerm& wrote = every_sort().model.effects[e];
    EXPECT_EQ(model.effects[e].name, wrote.name);
    EXPECT_EQ(model.effects[e].sigma, wrote.sigma) << wrote.name;
    EXPECT_EQ(model.effects[e].axis, wrote.axis) << wrote.name;
    EXPECT_EQ(model.effects[e].signal, wrote.signal) << wrote.name;
    EXPECT_EQ(model.effects[e].table.withheld, wrote.table.withheld) << wrote.name;
    withheld += static_cast<int>(wrote.table.withheld.size());
  }
  EXPECT_GT(withheld, 10);
}

/// What reading is refused with where the last term whose name begins so is changed.
std::string refused(const std::string& name, const std::string& pointer, const Json& value) {
  Json json = every_sort().json();
  Json* term = nullptr;
  for (Json& one : json["terms"]) {
    term = one["name"].get<std::string>().starts_with(name) ? &one : term;
  }
  if (term == nullptr) {
    return "there is no term " + name;
  }
  (*term)[Json::json_pointer(pointer)] = value;
  return refusal([&] { read_effects({json, "r.json: effects"}, complete_model(testing::fanuc())); });
}

TEST(EffectsJson, WhatNoTermCanBeIsRefusedWithItsPlace) {
  EXPECT_THAT(refused("torque.2", "/function/of", "speed"), HasSubstr("function: of: expected torque or tanh"));
  EXPECT_THAT(refused("torque.2.tanh", "/function/play", 0.0), HasSubstr("play: expected a number above 0"));
  EXPECT_THAT(refused("backlash.2.approach", "/function/of", "below"), HasSubstr("of: expected approach"));
  EXPECT_THAT(refused("backlash.3", "/function/mass", -1.0), HasSubstr("mass: expected a number above 0"));
  EXPECT_THAT(refused("transverse.2", "/about", "z"), HasSubstr("about: expected own, x or y"));
  EXPECT_THAT(refused("transverse.2", "/about", "own"), HasSubstr("group: expected about x or y"));
  EXPECT_THAT(refused("gain.2", "/about", "x"), HasSubstr("group: expected about x or y"));
  EXPECT_THAT(refused("gravity.2.", "/function/axis", "w"), HasSubstr("axis: expected x, y, z, slide or own"));
  EXPECT_THAT(refused("gravity.2.", "/function/link", 7), HasSubstr("link: expected a whole number from 1 to 6"));
  EXPECT_THAT(refused("gain.2", "/group", "sag"), HasSubstr("group: expected one of gravity"));
  EXPECT_THAT(refused("gain.2", "/joint", "joint_9"), HasSubstr("joint: expected a moving joint"));
  EXPECT_THAT(refused("gain.2", "/scale", 0), HasSubstr("scale: expected a number above 0"));
  EXPECT_THAT(refused("tables.4.1", "/function/withheld", "none"), HasSubstr("withheld: expected an array"));
  EXPECT_THAT(refused("tables.4.1", "/function/withheld/0", Json::array({1.0, -1.0})),
              HasSubstr("expected the lower end first"));
  EXPECT_THAT(refused("tables.4.1", "/function/lower", 99.0), HasSubstr("upper: expected a number above 'lower'"));
  EXPECT_THAT(refused("ripple.3.sin200.5", "/function/times", -1), HasSubstr("times: expected a number above 0"));
  EXPECT_THAT(refused("harmonics.3.sin1", "/function/times", 1.5), HasSubstr("times: expected a whole number"));
}

}  // namespace
}  // namespace kdl_calibration
