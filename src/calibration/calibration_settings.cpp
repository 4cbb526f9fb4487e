#include "calibration/calibration_settings.hpp"

#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include "base/preconditions.hpp"
#include "effects/effect_functions.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

// An earlier result decides parameters, priors and effects, and its gauge needs a free base and free targets.
void require_no_other_choice(const CalibrationOptions& options) {
  const ParameterOptions& parameters = options.parameters;
  const PriorOptions& priors = options.priors;
  const EffectOptions& effects = options.effects;
  for (const auto& [is_made, option] :
       {std::pair{!is_plain(options.estimator), "method or loss"},
        std::pair{parameters.model != ModelChoice::irreducible, "model"}, std::pair{!parameters.fix.empty(), "fix"},
        std::pair{!parameters.free.empty(), "free"}, std::pair{!parameters.known.bases.empty(), "known base"},
        std::pair{!parameters.known.targets.empty(), "known targets"},
        std::pair{priors.stated.length > 0.0 || priors.stated.angle > 0.0 || priors.automatic.value_or(false), "prior"},
        std::pair{!effects.groups.empty() || !effects.own.empty() || effects.automatic.value_or(false), "effects"}}) {
    if (is_made) {
      throw OptionError("priors.earlier", std::string("decides this already, expected no ") + option + " beside it");
    }
  }
}

// They are part of the names of terms.
void require_names(const std::vector<OwnEffect>& effects) {
  std::set<std::string> names;
  for (const OwnEffect& effect : effects) {
    require_named("effects.own", effect.name, effect.columns, names);
  }
}

}  // namespace

CalibrationSettings settings_of(const CalibrationOptions& options) {
  const bool continues = options.priors.earlier != nullptr;
  if (continues) {
    require_no_other_choice(options);
  }
  require_sigma("noise.scale_sigma", options.noise.scale_sigma);
  require_sigma("noise.length_sigma", options.noise.length_sigma);
  const bool chooses =
      is_plain(options.estimator) && options.parameters.model == ModelChoice::irreducible && !continues;
  const Priors& stated = options.priors.stated;
  const EffectOptions& effects = options.effects;
  if (effects.automatic.value_or(false) && !effects.groups.empty()) {
    throw OptionError("effects", "are named and to be chosen as well, expected one of the two");
  }
  for (const EffectGroup group : effects.groups) {
    require_index("the group of effects", static_cast<std::size_t>(group), kEffectGroups);
    if (std::count(effects.groups.begin(), effects.groups.end(), group) > 1) {
      throw OptionError("effects", std::string(to_string(group)) + " is named twice, expected each group once");
    }
  }
  require_names(effects.own);
  if (options.estimator.iterations < 0 || options.estimator.iterations > kMostIterations) {
    throw OptionError("iterations", "from 0 to " + std::to_string(kMostIterations) + " are possible");
  }
  if (options.validation.k_fold < 0 || options.validation.k_fold == 1) {
    throw OptionError("validation.k_fold", "cannot be " + std::to_string(options.validation.k_fold) +
                                               ", expected at least 2 folds, or 0 for none");
  }
  return {.estimator = options.estimator,
          .parameters = options.parameters,
          .noise = options.noise,
          .selection = {.priors = stated,
                        .automatic_priors =
                            options.priors.automatic.value_or(chooses && !(stated.length > 0.0 || stated.angle > 0.0)),
                        .effects = {.groups = effects.groups,
                                    .automatic = effects.automatic.value_or(chooses && effects.groups.empty()),
                                    .own = effects.own}},
          .validation = options.validation,
          .diagnosis = options.diagnosis,
          .predict_at = options.predict_at,
          .threads = options.threads,
          .progress = options.progress};
}

}  // namespace kdl_calibration
