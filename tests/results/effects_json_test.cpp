// The block `effects` of a result: what is written is read back, and what no result can hold is refused.

#include "results/effects_json.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "measurements/drive_signals.hpp"
#include "planning/simulation.hpp"
#include "refusal.hpp"
#include "results/result_json.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"

namespace kdl_calibration::effects_json_test {
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
    driven = simulated_signals(model, q, {}, {.approach = true, .torques = true});
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
      if (auto* const table = std::get_if<JointTable>(&term.function); table != nullptr && term.index == 3) {
        table->withheld = {{-1.5, -1.0}, {0.25, 0.5}};
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
  const auto& [q, signals, from] = every_sort().driven;
  EXPECT_TRUE(effect_basis(model, q, signals) == effect_basis(every_sort().model, q, signals));
  int withheld = 0;
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    const EffectTerm& wrote = every_sort().model.effects[e];
    EXPECT_EQ(model.effects[e].name, wrote.name);
    EXPECT_EQ(model.effects[e].sigma, wrote.sigma) << wrote.name;
    EXPECT_EQ(model.effects[e].axis, wrote.axis) << wrote.name;
    ASSERT_EQ(model.effects[e].function.index(), wrote.function.index()) << wrote.name;
    EXPECT_EQ(model.effects[e].group(), wrote.group()) << wrote.name;
    if (const auto* const table = std::get_if<JointTable>(&wrote.function)) {
      EXPECT_EQ(std::get<JointTable>(model.effects[e].function).withheld, table->withheld) << wrote.name;
      withheld += static_cast<int>(table->withheld.size());
    }
  }
  EXPECT_GT(withheld, 10);
}

// Its function is not in the file: whoever reads it gives the function again.
TEST(EffectsJson, ACallersFunctionIsReadByItsName) {
  ErrorModel model = complete_model(testing::fanuc());
  const OwnEffect own{
      .name = "bend", .joint = "joint_2", .axis = EffectAxis::across_x, .columns = [](const Eigen::MatrixXd& q) {
        return Eigen::MatrixXd(q.topRows(3).transpose());
      }};
  Random random(3);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 40, random);
  model.effects = own_terms(model, own, q);
  ASSERT_EQ(model.effects.size(), 3U);
  for (EffectTerm& term : model.effects) {
    term.sigma = 1.0;
  }
  const Json json = Json::parse(effects_json(model, Eigen::Vector3d(1e-4, 2e-4, 3e-4)));
  const OwnEffect other{.name = "twist", .joint = "joint_2", .columns = own.columns};
  const SavedEffects read = read_effects({json, "effects"}, complete_model(testing::fanuc()), std::vector{other, own});
  ErrorModel again = complete_model(testing::fanuc());
  again.effects = read.terms;
  ASSERT_EQ(again.effects.size(), 3U);
  EXPECT_TRUE(effect_basis(again, q) == effect_basis(model, q));
  EXPECT_EQ(motion_entry(again, again.effects[2]), motion_entry(model, model.effects[2]));
  for (const std::vector<OwnEffect>& given : {std::vector<OwnEffect>(), std::vector{other}}) {
    EXPECT_THAT(refusal([&] {
                  read_effects({json, "r.json: effects"}, complete_model(testing::fanuc()), given);
                }),
                HasSubstr("effect: expected a result whose effects are all kdlcal's: 'bend' is a function of the"));
  }
  EXPECT_THAT(
      refusal([&] {
        const OwnEffect fewer{
            .name = "bend", .joint = "joint_2", .axis = EffectAxis::across_x, .columns = [](const Eigen::MatrixXd& at) {
              return Eigen::MatrixXd(at.topRows(2).transpose());
            }};
        again.effects = read_effects({json, "effects"}, complete_model(testing::fanuc()), {{fewer}}).terms;
        effect_basis(again, q);
      }),
      HasSubstr("function: the given function 'bend' has 2 columns, expected 3 as when it was fitted"));
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
  EXPECT_THAT(refused("transverse.2", "/about", "z"), HasSubstr("about: expected own, x, y or along"));
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
  EXPECT_THAT(refused("coupling.3.2.sin1", "/function/of", "tan"), HasSubstr("of: expected sin or cos"));
  EXPECT_THAT(refused("coupling.3.2", "/function/joint", 0), HasSubstr("joint: expected a whole number from 1 to 6"));
}

TEST(EffectsJson, TorquesOfKnownMassesAreNotWritten) {
  ErrorModel model = complete_model(testing::fanuc());
  model.effects = load_terms(model);
  EXPECT_THAT(refusal([&] { effects_json(model, Eigen::VectorXd::Zero(3)); }),
              HasSubstr("effects: the torque of known"));
}

TEST(EffectsJson, NumbersOfTermsAreTakenUpToTheirLimits) {
  constexpr const char* kRead = "nothing was refused";
  const auto whole = [](int least, int most) {
    return HasSubstr("expected a whole number from " + std::to_string(least) + " to " + std::to_string(most));
  };
  EXPECT_THAT(refused("gravity.2.", "/function/link", 0), whole(1, 6));
  EXPECT_EQ(refused("gravity.2.", "/function/link", 1), kRead);
  EXPECT_EQ(refused("gravity.2.", "/function/link", 6), kRead);
  for (const auto& [name, pointer] :
       {std::pair{"harmonics.3.sin1", "/function/times"}, std::pair{"tables.4.1", "/function/number"}}) {
    EXPECT_THAT(refused(name, pointer, 0), whole(1, 1000));
    EXPECT_THAT(refused(name, pointer, -3), whole(1, 1000));
    EXPECT_EQ(refused(name, pointer, 1), kRead);
    EXPECT_EQ(refused(name, pointer, 1000), kRead);
    EXPECT_THAT(refused(name, pointer, 1001), whole(1, 1000));
  }
  EXPECT_EQ(refused("gain.2", "/sigma", 1e-9), kRead);
  EXPECT_THAT(refused("gain.2", "/sigma", -1e-9), HasSubstr("sigma: expected a number above 0"));
  EXPECT_THAT(refused("tables.4.1", "/function/length", 0.0), HasSubstr("length: expected a number above 0"));
  EXPECT_EQ(refused("tables.4.1", "/function/withheld/0", Json::array({0.3, 0.3})), kRead);
  const Json terms = every_sort().json()["terms"];
  const auto table = std::find_if(terms.begin(), terms.end(), [](const Json& t) { return t["name"] == "tables.4.1"; });
  EXPECT_THAT(refused("tables.4.1", "/function/lower", (*table)["function"]["upper"]),
              HasSubstr("upper: expected a number above 'lower'"));
}

TEST(EffectsJson, OlderResultsSayNeitherAxisNorWhatIsWithheld) {
  const ErrorModel rigid = complete_model(testing::fanuc());
  Json json = every_sort().json();
  Json kept = Json::array();
  for (Json& term : json["terms"]) {
    if (term["group"] == "gain" || term["group"] == "tables") {
      term.erase("about");
      term["function"].erase("withheld");
      kept.push_back(term);
    }
  }
  json["terms"] = kept;
  json["gravity_direction"] = {0.0, 0.6, -0.8};
  const SavedEffects read = read_effects({json, "effects"}, rigid);
  ASSERT_EQ(read.terms.size(), kept.size());
  for (const EffectTerm& term : read.terms) {
    EXPECT_EQ(term.axis, EffectAxis::own);
    if (const auto* const table = std::get_if<JointTable>(&term.function)) {
      EXPECT_TRUE(table->withheld.empty());
    }
    EXPECT_EQ(term.joint, rigid.joints.at(static_cast<std::size_t>(term.index)).name);
  }
  EXPECT_EQ(read.gravity, KDL::Vector(0.0, 0.6, -0.8));
  json["terms"] = "none";
  EXPECT_THAT(refusal([&] { read_effects({json, "effects"}, rigid); }), HasSubstr("terms: expected an array"));
  json["terms"] = Json::array();
  EXPECT_EQ(read_effects({json, "effects"}, rigid).values.size(), 0);
}

TEST(EffectsJson, OfACalibrationOnlyItsOwnTermsWithTheRangesOfTheFittedRows) {
  const EverySort& s = every_sort();
  CalibrationResult calibration;
  calibration.model = s.model;
  calibration.model.gravity = KDL::Vector(0.0, 0.6, -0.8);
  calibration.fit.identification.estimate.effects = s.values;
  calibration.uncertainty.parameters = {
      {.name = "Tx1", .kind = ParameterKind::translation},
      {.name = "gain.2", .kind = ParameterKind::effect, .value = 0.25, .std = 0.5},
      {.name = "gain.3", .kind = ParameterKind::effect, .value = 0.75, .std = INFINITY}};
  Measurements measured;
  measured.joint_values = s.driven.joint_values;
  measured.signals = s.driven.signals;
  measured.configurations.assign(60, "c");
  measured.targets = {"A"};
  measured.observations.push_back({.reading = Point{Eigen::Vector3d::Zero()}, .configuration = 4});
  const auto written = [&] { return effects_json(calibration, measured); };
  const Json json = written();
  EXPECT_EQ(json["gravity_direction"], Json::array({0.0, 0.6, -0.8}));
  ASSERT_EQ(json["terms"].size(), 2U);
  EXPECT_EQ(json["terms"][0]["name"], "gain.2");
  EXPECT_EQ(json["terms"][0]["coefficient"], 0.25);
  EXPECT_EQ(json["terms"][0]["std"], 0.5);
  EXPECT_EQ(json["terms"][1]["std"], nullptr);
  const double value = measured.joint_values(1, 4);  // where it stood still
  EXPECT_EQ(json["terms"][0]["valid_range"], Json::array({value, value}));
  measured.observations[0].split = Split::test;
  EXPECT_EQ(written()["terms"][0]["valid_range"], nullptr);
}

}  // namespace
}  // namespace kdl_calibration::effects_json_test
