#include "selection/parameter_selection.hpp"

#include <algorithm>
#include <iterator>
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
  std::vector<std::string> names = frame_parameter_names(targets, base_parameter_names(model));
  for (const ErrorParameter& parameter : model.parameters) {
    names.push_back(parameter.name);
  }
  return names;
}

// Base and target coordinates that are known or fixed by the user.
std::vector<std::string> fixed_frames(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                                      const ParameterOptions& options, const std::set<std::string>& fixed,
                                      const std::set<std::string>& freed) {
  std::vector<std::string> result;
  const auto consider = [&](const std::string& name, bool known, const std::string& option) {
    if (fixed.count(name) > 0 && !known) {
      throw OptionError("fix", name + " can only be fixed where its value is known", {option});
    }
    if ((known && freed.count(name) == 0) || fixed.count(name) > 0) {
      result.push_back(name);
    }
  };
  const std::vector<std::string> bases = base_parameter_names(model);
  for (std::size_t i = 0; i < bases.size(); ++i) {
    const bool is_known = find_base(options.known.bases, model.stations[i / 6]) != nullptr;
    consider(bases[i], is_known, "known.bases");
  }
  for (const TargetFrame& target : targets) {
    for (const std::string& name : target_parameter_names(target)) {
      consider(name, find_target(options.known.targets, target.name) != nullptr, "known.targets");
    }
  }
  return result;
}

// The reduction has one base. It is fixed if that of any station is, because the targets are told from the arm there.
std::vector<std::string> of_one_base(const ErrorModel& model, std::vector<std::string> fixed) {
  if (model.has_undetermined_bases && std::erase_if(fixed, is_of_station) > 0) {
    fixed.insert(fixed.end(), base_parameter_names().begin(), base_parameter_names().end());
  }
  return fixed;
}

// With several stations the bases of all stand in the place of the base.
void give_each_station_a_base(const ErrorModel& model, Reduction& reduction) {
  if (!model.has_undetermined_bases) {
    return;
  }
  std::vector<std::string> kept = base_parameter_names(model);
  std::copy_if(reduction.kept.begin(), reduction.kept.end(), std::back_inserter(kept), [](const std::string& name) {
    const std::vector<std::string>& base = base_parameter_names();
    return std::find(base.begin(), base.end(), name) == base.end();
  });
  reduction.kept = std::move(kept);
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
  const std::vector<std::string> fixed_names = fixed_frames(model, targets, options, fixed, freed);
  reduction.fixed = of_one_base(model, fixed_names);
  ParameterSelection choice{.reduction = reduced_model(model, targets, reduction), .free = {}, .complete = {}};
  give_each_station_a_base(model, choice.reduction);
  const std::set<std::string> kept(choice.reduction.kept.begin(), choice.reduction.kept.end());
  const std::set<std::string> held(fixed_names.begin(), fixed_names.end());
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
