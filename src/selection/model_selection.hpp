#pragma once

// Selection of joint effects and of priors of the geometry: options and result.

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "selection/earlier_result.hpp"

namespace kdl_calibration {

/// Requested joint effects.
struct Effects {
  std::vector<EffectGroup> groups;  ///< requested groups
  bool automatic = false;           ///< instead the groups that cross-validation accepts
  std::vector<OwnEffect> own = {};  ///< of the caller's own, each as a group
};

struct ModelSelectionOptions {
  Priors priors;
  bool automatic_priors = false;  ///< sizes by evidence, or no priors, by cross-validation
  Effects effects;
  std::shared_ptr<const EarlierResult> earlier = {};  ///< instead of a selection
};
/// Whether priors or effects are to be selected or sized.
inline bool needs_selection(const ModelSelectionOptions& options) {
  const Effects& effects = options.effects;
  return options.automatic_priors || effects.automatic || !effects.groups.empty() || !effects.own.empty();
}

/// A candidate choice of effects and priors, with its scores.
struct ModelOption {
  Priors priors;
  std::vector<std::string> effects;  ///< groups, in the order in which they were added
  bool sized = false;                ///< whether the sizes of the priors were estimated
  double held_out_rms = 0.0;         ///< [m] by cross-validation; infinite if the rest does not determine a prediction
  double evidence = 0.0;             ///< log likelihood of the sizes; compare only options of equal `sized`
};

/// Choices or checks that were not made.
struct NotTried {
  std::string what;  ///< "priors", "gravity, gain"
  std::string why;
};

/// Left-out configurations from which their errors alone tell how wide the radii have to be.
constexpr std::size_t kEnoughForRadii = 40;

/// A model that may be true, with its estimate, linearised at that of geometry alone.
struct PlausibleModel {
  ErrorModel model;
  Estimate estimate;
  double odds = 1.0;  ///< against the chosen one, whose are 1
};

/// The selected effects and priors.
struct ModelSelection {
  std::vector<EffectTerm> terms;  ///< with their sigmas
  Priors priors;
  Priors rigid_priors;             ///< best for the model without effects
  double noise = 0.0;              ///< [m] 1 sigma of a coordinate of a mean, by the evidence of the selected model
  std::vector<ModelOption> tried;  ///< best first; empty without a selection
  std::vector<PlausibleModel> plausible = {};  ///< of few configurations: the chosen one, and those with sag
  std::vector<NotTried> not_tried;             ///< empty if everything was tried
  std::size_t not_compared = 0;                ///< points of targets that occur in one fold only
  /// Optimism of the held-out error due to the selection, see TriedModels; 1 if effects were requested by name.
  double optimism = 1.0;
  std::optional<ContinuedResult> continued = std::nullopt;  ///< of an earlier result
};

}  // namespace kdl_calibration
