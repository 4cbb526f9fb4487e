#include "results/effects_json.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "calibration/parameter_estimates.hpp"
#include "kdl_calibration/input_check.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/result_json.hpp"
#include "results/effect_findings.hpp"
#include "results/result_blocks.hpp"

namespace kdl_calibration {
namespace {

using Json = nlohmann::ordered_json;
using tree::elements;
using tree::has;
using tree::member;
using tree::Node;
using tree::number;

constexpr const char* kAxes[] = {"x", "y", "z", "slide", "own"};

// Of the joint, as measured; null of nothing.
Json range_json(const std::pair<double, double>& range) {
  return range.first <= range.second ? Json::array({range.first, range.second}) : Json(nullptr);
}

// What the function is made of, beside its group and joint.
Json function_json(const EffectTerm& term) {
  switch (term.group) {
    case EffectGroup::gravity:
    case EffectGroup::transverse:
      return {{"link", term.gravity.link + 1}, {"axis", kAxes[term.gravity.axis]}};
    case EffectGroup::backlash:
      return term.signal == DriveSignal::approach ? Json{{"of", "approach"}} : Json{{"mass", term.masses.front().mass}};
    case EffectGroup::torque:
      return term.play > 0.0 ? Json{{"of", "tanh"}, {"play", term.play}} : Json{{"of", "torque"}};
    case EffectGroup::harmonics:
    case EffectGroup::ripple:
      return {{"of", term.harmonic > 0 ? "sin" : "cos"}, {"times", std::abs(term.harmonic)}};
    case EffectGroup::tables: {
      Json table = {{"number", term.table.number},
                    {"length", term.table.length},
                    {"lower", term.table.lower},
                    {"upper", term.table.upper},
                    {"withheld", Json::array()}};
      for (const auto& range : term.table.withheld) {
        table["withheld"].push_back(range_json(range));
      }
      return table;
    }
    case EffectGroup::gain:
      break;
  }
  return Json::object();
}

Json term_json(const EffectTerm& term, double coefficient) {
  return {{"name", term.name},
          {"joint", term.joint},
          {"group", to_string(term.group)},
          {"about", to_string(term.axis)},
          {"function", function_json(term)},
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

void read_withheld(const Node& node, TableTerm& table) {
  if (!node.json.is_array()) {
    tree::fail(node, "an array");
  }
  if (node.json.empty()) {
    return;
  }
  for (const Node& range : elements(node)) {
    const Eigen::Vector2d ends = tree::numbers<2>(range);
    if (!(ends[0] <= ends[1])) {
      tree::fail(range, "the lower end first");
    }
    table.withheld.emplace_back(ends[0], ends[1]);
  }
}

void read_function(const Node& node, const ErrorModel& model, EffectTerm& term) {
  const auto joints = static_cast<int>(model.joints.size());
  switch (term.group) {
    case EffectGroup::gravity:
    case EffectGroup::transverse: {
      term.gravity.link = whole_number(member(node, "link"), 1, joints) - 1;
      const Node axis = member(node, "axis");
      const auto* const found = std::find(std::begin(kAxes), std::end(kAxes), tree::name(axis));
      if (found == std::end(kAxes)) {
        tree::fail(axis, "x, y, z, slide or own");
      }
      term.gravity.axis = static_cast<int>(found - std::begin(kAxes));
      return;
    }
    case EffectGroup::torque: {
      const Node of = member(node, "of");
      if (tree::name(of) != "torque" && tree::name(of) != "tanh") {
        tree::fail(of, "torque or tanh");
      }
      term.signal = DriveSignal::torque;
      term.play = tree::name(of) == "tanh" ? positive(member(node, "play")) : 0.0;
      return;
    }
    case EffectGroup::backlash:
      if (has(node, "of")) {
        if (tree::name(member(node, "of")) != "approach") {
          tree::fail(member(node, "of"), "approach");
        }
        term.signal = DriveSignal::approach;
        return;
      }
      for (int frame = term.index + 1; frame <= joints; ++frame) {
        term.masses.push_back({.frame = frame, .mass = positive(member(node, "mass")), .centre = {}});
      }
      return;
    case EffectGroup::harmonics:
    case EffectGroup::ripple:
      term.harmonic = term.group == EffectGroup::ripple ? positive(member(node, "times"))
                                                        : whole_number(member(node, "times"), 1, 1000);
      if (tree::name(member(node, "of")) != "sin") {
        term.harmonic = -term.harmonic;
      }
      return;
    case EffectGroup::tables:
      term.table = {.number = whole_number(member(node, "number"), 1, 1000),
                    .length = positive(member(node, "length")),
                    .lower = number(member(node, "lower")),
                    .upper = number(member(node, "upper")),
                    .withheld = {}};
      if (has(node, "withheld")) {
        read_withheld(member(node, "withheld"), term.table);
      }
      if (!(term.table.lower < term.table.upper)) {
        tree::fail(member(node, "upper"), "a number above 'lower'");
      }
      return;
    case EffectGroup::gain:
      return;
  }
}

// A result that does not say it has effects about the joints' own axes alone.
EffectAxis read_axis(const Node& node) {
  if (!has(node, "about")) {
    return EffectAxis::own;
  }
  const Node about = member(node, "about");
  for (const EffectAxis axis : {EffectAxis::own, EffectAxis::across_x, EffectAxis::across_y}) {
    if (tree::name(about) == to_string(axis)) {
      return axis;
    }
  }
  tree::fail(about, "own, x or y");
}

EffectTerm read_term(const Node& node, const ErrorModel& model) {
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
  const Node group = member(node, "group");
  const std::optional<EffectGroup> known = effect_group(tree::name(group));
  if (!known) {
    tree::fail(group, "one of " + comma_separated(effect_group_names()));
  }
  term.group = *known;
  term.axis = read_axis(node);
  if ((term.group == EffectGroup::transverse) == (term.axis == EffectAxis::own)) {
    tree::fail(group, "about x or y where it is transverse, else about its own axis");
  }
  term.mean = number(member(node, "mean"));
  term.scale = positive(member(node, "scale"));
  term.sigma = positive(member(node, "sigma"));
  read_function(member(node, "function"), model, term);
  return term;
}

}  // namespace

Json effects_json(const Calibration& calibration, const Measurements& measurements) {
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
    terms.back()["valid_range"] = range_json(ranges[static_cast<std::size_t>(term->index)]);
  }
  return {{"gravity_direction", array(to_eigen(calibration.model.gravity))},
          {"terms", terms},
          {"findings", effect_findings(calibration, effect_motions(calibration, measurements))}};
}

std::string effects_json(const ErrorModel& model, const Eigen::VectorXd& coefficients) {
  check(model);
  require_count("coefficients of effects", coefficients.size(), model.effects.size());
  Json terms = Json::array();
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    terms.push_back(term_json(model.effects[e], coefficients[static_cast<Eigen::Index>(e)]));
  }
  return Json({{"gravity_direction", array(to_eigen(model.gravity))}, {"terms", terms}}).dump();
}

SavedEffects read_effects(const Node& block, const ErrorModel& model) {
  SavedEffects saved;
  constexpr double kRounding = 1e-6;
  const Node direction = member(block, "gravity_direction");
  const Eigen::Vector3d gravity = tree::numbers<3>(direction);
  if (!(std::abs(gravity.norm() - 1.0) <= kRounding)) {
    tree::fail(direction, "a direction of norm 1");
  }
  saved.gravity = {gravity.x(), gravity.y(), gravity.z()};
  const Node terms = member(block, "terms");
  if (!terms.json.is_array()) {
    tree::fail(terms, "an array");
  }
  std::vector<double> values;
  if (!terms.json.empty()) {
    for (const Node& node : elements(terms)) {
      saved.terms.push_back(read_term(node, model));
      values.push_back(number(member(node, "coefficient")));
    }
  }
  saved.values = Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  return saved;
}

}  // namespace kdl_calibration
