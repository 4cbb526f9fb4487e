#include "results/effects_json.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <string>
#include <utility>

#include "base/number_text.hpp"
#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "calibration/parameter_estimates.hpp"
#include "effects/effect_functions.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/input_check.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/training_rows.hpp"
#include "results/effect_findings.hpp"
#include "results/result_blocks.hpp"
#include "results/result_json.hpp"

namespace kdl_calibration {
namespace {

using Json = nlohmann::ordered_json;
using tree::elements;
using tree::has;
using tree::member;
using tree::Node;
using tree::number;

const std::vector<std::string> kAxes = {"x", "y", "z", "slide", "own"};

// A joint's measured range; null if empty.
Json range_json(const std::pair<double, double>& range) {
  return range.first <= range.second ? Json::array({range.first, range.second}) : Json(nullptr);
}

// The parameters of each kind of function.
Json function_json(const GravityMoment& moment) {
  return {{"link", moment.link + 1}, {"axis", kAxes[static_cast<std::size_t>(moment.axis)]}};
}

Json function_json(const LoadTorque& /*load*/) {
  throw InputError("effects: the torque of known masses has no form in a result, expected terms of effect_terms");
}

Json function_json(const JointGain& /*gain*/) { return Json::object(); }

Json function_json(const LoadSide& side) { return {{"mass", side.mass}}; }

Json function_json(const ApproachSide& /*side*/) { return {{"of", "approach"}}; }

Json function_json(const Sinusoid& swing) { return {{"of", swing.is_cosine ? "cos" : "sin"}, {"times", swing.times}}; }

Json function_json(const JointTable& table) {
  Json withheld = Json::array();
  for (const auto& range : table.withheld) {
    withheld.push_back(range_json(range));
  }
  return {{"number", table.number},
          {"length", table.length},
          {"lower", table.lower},
          {"upper", table.upper},
          {"withheld", withheld}};
}

Json function_json(const MeasuredTorque& torque) {
  return torque.play > 0.0 ? Json{{"of", "tanh"}, {"play", torque.play}} : Json{{"of", "torque"}};
}

Json function_json(const JointCoupling& coupling) {
  Json json = {{"joint", coupling.joint + 1}};
  if (coupling.times > 0.0) {
    json.update({{"of", coupling.is_cosine ? "cos" : "sin"}, {"times", coupling.times}});
  }
  return json;
}

Json function_json(const Temperature& temperature) {
  return {{"of", temperature.of_link ? "temperature and length" : "temperature"}};
}

Json function_json(const PayloadTorque& payload) {
  if (payload.centres.empty()) {
    return {{"centre", array(to_eigen(payload.centre))}};
  }
  Json centres = Json::array();
  for (const PayloadCentre& one : payload.centres) {
    centres.push_back({{"mass", one.mass}, {"centre", array(to_eigen(one.centre))}});
  }
  return {{"centres", centres}};
}

Json function_json(const OwnFunction& own) {
  Json json = {{"effect", own.effect}, {"column", own.column}};
  if (own.fitted != nullptr) {
    Json checks = Json::array();
    for (Eigen::Index i = 0; i < own.fitted->columns.rows(); ++i) {
      const auto q = own.fitted->joint_values.col(i);
      checks.push_back(
          {{"joint_values", std::vector<double>(q.begin(), q.end())}, {"value", own.fitted->columns(i, own.column)}});
    }
    json.update({{"columns", own.fitted->columns.cols()}, {"checks", checks}});
  }
  return json;
}

Json term_json(const EffectTerm& term, double coefficient) {
  return {{"name", term.name},
          {"joint", term.joint},
          {"group", to_string(term.group())},
          {"about", to_string(term.axis)},
          {"function", std::visit([](const auto& kind) { return function_json(kind); }, term.function)},
          {"mean", term.mean},
          {"scale", term.scale},
          {"sigma", term.sigma},
          {"coefficient", coefficient}};
}

int whole_number(const Node& node, int least, int most) {
  const double value = number(node);
  if (value != std::floor(value) || value < least || value > most) {
    tree::fail(node, "a whole number from " + std::to_string(least) + " to " + std::to_string(most));
  }
  return static_cast<int>(value);
}

double positive(const Node& node) {
  const double value = number(node);
  if (!(value > 0.0)) {
    tree::fail(node, "a number above 0");
  }
  return value;
}

// Index of the node's text among `names`.
std::size_t place_among(const std::vector<std::string>& names, const Node& node, const std::string& expected) {
  const auto found = std::find(names.begin(), names.end(), tree::name(node));
  if (found == names.end()) {
    tree::fail(node, expected);
  }
  return static_cast<std::size_t>(found - names.begin());
}

JointTable read_table(const Node& node) {
  JointTable table{.number = whole_number(member(node, "number"), 1, 1000),
                   .length = positive(member(node, "length")),
                   .lower = number(member(node, "lower")),
                   .upper = number(member(node, "upper")),
                   .withheld = {}};
  if (has(node, "withheld")) {
    const Node withheld = member(node, "withheld");
    if (!withheld.json.is_array()) {
      tree::fail(withheld, "an array");
    }
    for (const Node& range : withheld.json.empty() ? std::vector<Node>() : elements(withheld)) {
      const Eigen::Vector2d ends = tree::numbers<2>(range);
      if (!(ends[0] <= ends[1])) {
        tree::fail(range, "the lower end first");
      }
      table.withheld.emplace_back(ends[0], ends[1]);
    }
  }
  if (!(table.lower < table.upper)) {
    tree::fail(member(node, "upper"), "a number above 'lower'");
  }
  return table;
}

JointCoupling read_coupling(const Node& node, int joints) {
  JointCoupling coupling{.joint = whole_number(member(node, "joint"), 1, joints) - 1};
  if (has(node, "of")) {
    coupling.is_cosine = place_among({"sin", "cos"}, member(node, "of"), "sin or cos") == 1;
    coupling.times = whole_number(member(node, "times"), 1, 1000);
  }
  return coupling;
}

// The values of the given function where the result states them. Throws InputError where they are others.
OwnValues require_same_values(const Node& function, const OwnFunction& own, const EffectTerm& term,
                              Eigen::Index joints) {
  constexpr double kSame = 1e-6;
  const auto refuse = [&](const Node& place, const std::string& is, const std::string& was) {
    throw InputError(fmt::format("{}: the given function '{}' {}, expected {} as when it was fitted", place.where,
                                 own.effect, is, was));
  };
  const int columns = whole_number(member(function, "columns"), 1, 1000);
  const std::vector<Node> checks = elements(member(function, "checks"));
  const auto count = static_cast<Eigen::Index>(checks.size());
  OwnValues fitted{.joint_values = Eigen::MatrixXd(joints, count), .columns = Eigen::MatrixXd(count, columns)};
  for (Eigen::Index i = 0; i < count; ++i) {
    const Node& check = checks[static_cast<std::size_t>(i)];
    const Node stated = member(check, "joint_values");
    Eigen::MatrixXd joint_values(joints, 1);
    const std::vector<Node> each = elements(stated);
    if (static_cast<Eigen::Index>(each.size()) != joints) {
      tree::fail(stated, std::to_string(joints) + " joint values");
    }
    std::transform(each.begin(), each.end(), joint_values.data(), [](const Node& value) { return number(value); });
    const Eigen::MatrixXd given = own_columns(own.effect, own.columns, joint_values);
    if (given.cols() != columns || own.column >= columns) {
      refuse(function, fmt::format("has {} columns", given.cols()), std::to_string(columns));
    }
    const double expected = number(member(check, "value"));
    if (!(std::abs(given(0, own.column) - expected) <= kSame * std::max(term.scale, std::abs(expected)))) {
      refuse(check, "is " + shortest(given(0, own.column)) + " there", shortest(expected));
    }
    fitted.joint_values.col(i) = joint_values;
    fitted.columns.row(i) = given;
  }
  return fitted;
}

OwnFunction read_own(const Node& node, const EffectTerm& term, std::span<const OwnEffect> own, Eigen::Index joints) {
  const Node effect = member(node, "effect");
  const std::string name = tree::name(effect);
  const auto found = std::find_if(own.begin(), own.end(), [&](const OwnEffect& given) { return given.name == name; });
  if (found == own.end()) {
    tree::fail(effect, "a result whose effects are all kdlcal's: '" + name +
                           "' is a function of the program that fitted it, which only that program can give again");
  }
  if (found->joint != term.joint || found->axis != term.axis) {
    tree::fail(effect, fmt::format("a result in which '{}' moves {} about '{}', as the given one does", name,
                                   found->joint, to_string(found->axis)));
  }
  OwnFunction function{
      .effect = name, .columns = found->columns, .column = whole_number(member(node, "column"), 0, 1000)};
  if (has(node, "checks")) {
    function.fitted = std::make_shared<const OwnValues>(require_same_values(node, function, term, joints));
  }
  return function;
}

PayloadTorque read_payload(const Node& node) {
  const auto centre = [](const Node& of) {
    const Eigen::Vector3d found = tree::numbers<3>(member(of, "centre"));
    return KDL::Vector(found.x(), found.y(), found.z());
  };
  if (!has(node, "centres")) {
    return {.centre = centre(node)};
  }
  PayloadTorque payload;
  for (const Node& one : elements(member(node, "centres"))) {
    payload.centres.push_back({.mass = positive(member(one, "mass")), .centre = centre(one)});
    if (payload.centres.size() > 1 &&
        !(payload.centres.back().mass > payload.centres[payload.centres.size() - 2].mass)) {
      tree::fail(one, "a larger mass than that of the payload before");
    }
  }
  return payload;
}

EffectFunction read_function(const Node& node, EffectGroup group, const EffectTerm& term, const ErrorModel& model,
                             std::span<const OwnEffect> own) {
  const auto joints = static_cast<int>(model.joints.size());
  switch (group) {
    case EffectGroup::gravity:
    case EffectGroup::transverse:
      return GravityMoment{.link = whole_number(member(node, "link"), 1, joints) - 1,
                           .axis = static_cast<int>(place_among(kAxes, member(node, "axis"), "x, y, z, slide or own"))};
    case EffectGroup::backlash:
      if (!has(node, "of")) {
        return LoadSide{.mass = positive(member(node, "mass"))};
      }
      place_among({"approach"}, member(node, "of"), "approach");
      return ApproachSide{};
    case EffectGroup::harmonics:
    case EffectGroup::ripple: {
      const bool is_ripple = group == EffectGroup::ripple;
      const Node times = member(node, "times");
      return Sinusoid{.times = is_ripple ? positive(times) : whole_number(times, 1, 1000),
                      .is_cosine = tree::name(member(node, "of")) != "sin",
                      .is_ripple = is_ripple};
    }
    case EffectGroup::tables:
      return read_table(node);
    case EffectGroup::torque: {
      const bool is_tanh = place_among({"torque", "tanh"}, member(node, "of"), "torque or tanh") == 1;
      return MeasuredTorque{.play = is_tanh ? positive(member(node, "play")) : 0.0};
    }
    case EffectGroup::coupling:
      return read_coupling(node, joints);
    case EffectGroup::expansion:
    case EffectGroup::drift:
      return Temperature{.of_link = group == EffectGroup::expansion};
    case EffectGroup::payload: {
      return read_payload(node);
    }
    case EffectGroup::own:
      return read_own(node, term, own, joints);
    case EffectGroup::gain:
      break;
  }
  return JointGain{};
}

EffectTerm read_term(const Node& node, const ErrorModel& model, std::span<const OwnEffect> own) {
  EffectTerm term;
  term.name = tree::name(member(node, "name"));
  const Node joint = member(node, "joint");
  term.joint = tree::name(joint);
  const auto found = std::find_if(model.joints.begin(), model.joints.end(),
                                  [&](const MovingJoint& moving) { return moving.name == term.joint; });
  if (found == model.joints.end()) {
    tree::fail(joint, "a moving joint of this robot");
  }
  term.index = static_cast<int>(found - model.joints.begin());
  std::vector<std::string> names = effect_group_names();
  names.emplace_back(to_string(EffectGroup::own));
  const Node group = member(node, "group");
  const auto known = static_cast<EffectGroup>(place_among(names, group, "one of " + comma_separated(names)));
  if (has(node, "about")) {  // else the result has effects about the joints' own axes alone
    term.axis =
        static_cast<EffectAxis>(place_among({"own", "x", "y", "along"}, member(node, "about"), "own, x, y or along"));
  }
  const bool is_across = term.axis == EffectAxis::across_x || term.axis == EffectAxis::across_y;
  if (known != EffectGroup::own && ((known == EffectGroup::transverse) != is_across ||
                                    (known == EffectGroup::expansion) != (term.axis == EffectAxis::along))) {
    tree::fail(group, "about x or y where it is transverse, along where it is expansion, else about its own axis");
  }
  term.mean = number(member(node, "mean"));
  term.scale = positive(member(node, "scale"));
  term.sigma = positive(member(node, "sigma"));
  term.function = read_function(member(node, "function"), known, term, model, own);
  return term;
}

// The mean temperatures and payload, if any was measured.
void add_circumstances(const ErrorModel& model, Json& effects) {
  const auto& [temperature, payload, link_temperatures] = model.circumstances;
  if (!states_any(model.circumstances)) {
    return;
  }
  effects["circumstances"] = {{"temperature", finite_or_null(temperature)}, {"payload", finite_or_null(payload)}};
  if (!link_temperatures.empty()) {
    effects["circumstances"]["link_temperatures"] = link_temperatures;
  }
}

Circumstances read_circumstances(const Node& block) {
  Circumstances read;
  for (const auto& [name, value] : {std::pair{"temperature", &read.temperature}, {"payload", &read.payload}}) {
    if (const Node node = member(block, name); !node.json.is_null()) {
      *value = number(node);
    }
  }
  if (has(block, "link_temperatures")) {
    const Node links = member(block, "link_temperatures");
    if (!links.json.is_object()) {
      tree::fail(links, "an object, a temperature by the name of each link");
    }
    for (const auto& [link, value] : links.json.items()) {
      read.link_temperatures[link] = number(member(links, link));
    }
  }
  return read;
}

}  // namespace

Json effects_json(const CalibrationResult& calibration, const Measurements& measurements) {
  const JointRanges ranges = trained_ranges(measurements);
  Json terms = Json::array();
  for (const ParameterEstimate& parameter : calibration.uncertainty.parameters) {
    const auto term = std::find_if(calibration.model.effects.begin(), calibration.model.effects.end(),
                                   [&](const EffectTerm& other) { return other.name == parameter.name; });
    if (term == calibration.model.effects.end()) {
      continue;
    }
    terms.push_back(term_json(*term, parameter.value));
    terms.back()["std"] = finite_or_null(parameter.std);
    terms.back()["degrees_of_freedom"] = finite_or_null(parameter.degrees_of_freedom);
    terms.back()["valid_range"] = range_json(ranges[static_cast<std::size_t>(term->index)]);
  }
  Json json = {{"gravity_direction", array(to_eigen(calibration.model.gravity))},
               {"terms", terms},
               {"findings", effect_findings(calibration, effect_motions(calibration, measurements))}};
  add_circumstances(calibration.model, json);
  return json;
}

std::string effects_json(const ErrorModel& model, const Eigen::VectorXd& coefficients) {
  check(model);
  require_count("coefficients of effects", coefficients.size(), model.effects.size());
  Json terms = Json::array();
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    terms.push_back(term_json(model.effects[e], coefficients[static_cast<Eigen::Index>(e)]));
  }
  Json json = {{"gravity_direction", array(to_eigen(model.gravity))}, {"terms", terms}};
  add_circumstances(model, json);
  return json.dump();
}

SavedEffects read_effects(const Node& block, const ErrorModel& model, std::span<const OwnEffect> own) {
  SavedEffects saved;
  constexpr double kRounding = 1e-6;
  const Node direction = member(block, "gravity_direction");
  const Eigen::Vector3d gravity = tree::numbers<3>(direction);
  if (!(std::abs(gravity.norm() - 1.0) <= kRounding)) {
    tree::fail(direction, "a direction of norm 1");
  }
  saved.gravity = {gravity.x(), gravity.y(), gravity.z()};
  if (has(block, "circumstances")) {
    saved.circumstances = read_circumstances(member(block, "circumstances"));
  }
  const Node terms = member(block, "terms");
  if (!terms.json.is_array()) {
    tree::fail(terms, "an array");
  }
  std::vector<double> values;
  if (!terms.json.empty()) {
    for (const Node& node : elements(terms)) {
      saved.terms.push_back(read_term(node, model, own));
      values.push_back(number(member(node, "coefficient")));
      const bool stated = has(node, "degrees_of_freedom") && !member(node, "degrees_of_freedom").json.is_null();
      saved.degrees_of_freedom.push_back(stated ? number(member(node, "degrees_of_freedom"))
                                                : std::numeric_limits<double>::infinity());
    }
  }
  saved.values = Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  return saved;
}

}  // namespace kdl_calibration
