#include "selection/parameter_selection.hpp"

#include <algorithm>
#include <set>

#include "base/name_pattern.hpp"
#include "base/text.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"

namespace kdl_calibration {
namespace {

bool is_of_effects(const std::string& pattern) {
  return effect_group(pattern.substr(0, pattern.find_first_of(".*?"))).has_value();
}

std::set<std::string> matching(const std::vector<std::string>& patterns, const std::vector<std::string>& names,
                               const std::string& option) {
  std::set<std::string> result;
  for (const std::string& pattern : patterns) {
    bool any = false;
    for (const std::string& name : names) {
      if (matches_pattern(pattern, name)) {
        result.insert(name);
        any = true;
      }
    }
    if (!any) {
      throw OptionError(option, "'" + pattern + "' matches no parameter; there are " + comma_separated(names));
    }
  }
  return result;
}

std::vector<std::string> all_names(const ErrorModel& model, const std::vector<TargetFrame>& targets) {
  std::vector<std::string> names = frame_parameter_names(targets);
  for (const ErrorParameter& parameter : model.parameters) {
    names.push_back(parameter.name);
  }
  return names;
}

// Base and target coordinates that are known or fixed by the user.
std::vector<std::string> fixed_frames(const std::vector<TargetFrame>& targets, const ParameterOptions& options,
                                      const std::set<std::string>& fixed, const std::set<std::string>& freed) {
  std::vector<std::string> result;
  const auto consider = [&](const std::string& name, bool known, const std::string& option) {
    if (fixed.count(name) > 0 && !known) {
      throw OptionError("fix", name + " can only be fixed where its value is known", {option});
    }
    if ((known && freed.count(name) == 0) || fixed.count(name) > 0) {
      result.push_back(name);
    }
  };
  for (const std::string& name : base_parameter_names()) {
    consider(name, options.known_base.has_value(), "known_base");
  }
  for (const TargetFrame& target : targets) {
    for (const std::string& name : target_parameter_names(target)) {
      consider(name, find_target(options.known_targets, target.name) != nullptr, "known_targets");
    }
  }
  return result;
}

}  // namespace

bool fixes_effect(const std::vector<std::string>& fix, const EffectTerm& term) {
  return std::any_of(fix.begin(), fix.end(), [&](const std::string& pattern) {
    return is_of_effects(pattern) && matches_pattern(pattern, term.name);
  });
}

ParameterSelection select_parameters(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                                     const ParameterOptions& options, ReductionOptions reduction) {
  const std::vector<std::string> names = all_names(model, targets);
  std::vector<std::string> of_parameters = options.fix;
  std::erase_if(of_parameters, is_of_effects);
  const std::set<std::string> fixed = matching(of_parameters, names, "fix");
  const std::set<std::string> freed = matching(options.free, names, "free");
  for (const std::string& name : freed) {
    if (fixed.count(name) > 0) {
      throw OptionError("free", name + " is fixed as well, expected one of the two", {"fix"});
    }
  }
  reduction.fixed = fixed_frames(targets, options, fixed, freed);
  ParameterSelection choice{.reduction = reduced_model(model, targets, reduction), .free = {}, .complete = {}};
  const std::set<std::string> kept(choice.reduction.kept.begin(), choice.reduction.kept.end());
  const std::set<std::string> held(reduction.fixed.begin(), reduction.fixed.end());
  std::set<std::string> gauge;
  for (const GaugeParameter& parameter : choice.reduction.gauge) {
    gauge.insert(parameter.name);
  }
  for (const std::string& name : names) {
    if (fixed.count(name) > 0 || held.count(name) > 0) {
      continue;
    }
    const bool wanted = options.model == ModelChoice::complete || kept.count(name) > 0 || freed.count(name) > 0;
    const bool geometric = name.find('.') == std::string::npos;
    if (wanted) {
      choice.free.push_back(name);
    }
    if (wanted || (geometric && gauge.count(name) == 0)) {
      choice.complete.push_back(name);
    }
  }
  return choice;
}

}  // namespace kdl_calibration
