#pragma once

// Effects beside the geometry and priors of it: what is asked for, and what was selected.

#include <cstddef>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

/// Joint effects that the model is to have beside the geometry.
struct Effects {
  std::vector<EffectGroup> groups;  ///< these
  bool automatic = false;           ///< or those that cross-validation accepts
};

struct ModelSelectionOptions {
  Priors priors;
  bool automatic_priors = false;  ///< their sizes by evidence, or none, as cross-validation says
  Effects effects;
};
/// Whether priors or effects are to be selected or sized.
inline bool is_open(const ModelSelectionOptions& options) {
  return options.automatic_priors || options.effects.automatic || !options.effects.groups.empty();
}

/// A choice of effects and of priors, and what cross-validation said of it.
struct ModelOption {
  Priors priors;
  std::vector<std::string> effects;  ///< groups, in the order in which they were added
  bool sized = false;                ///< whether the priors' sizes were estimated with it
  double held_out_rms = 0.0;         ///< [m]; infinite where the rest does not determine what was left out
  double evidence = 0.0;             ///< log of the likelihood of the sizes, comparable among options alike in `sized`
};

/// Which effects and priors were selected.
struct ModelSelection {
  std::vector<EffectTerm> terms;  ///< with their sigmas
  Priors priors;
  Priors rigid_priors;             ///< best where the model has no effects
  double noise = 0.0;              ///< [m] 1 sigma of a coordinate of a mean, by the evidence of the selected model
  std::vector<ModelOption> tried;  ///< best first, where something was selected
  std::string not_tried;           ///< which priors and effects were not tried, and why; empty if all were
  std::size_t not_compared = 0;    ///< points of targets that only one fold has
  /// Optimism of the held-out error by the selection, see TriedModels; 1 where effects were asked for by name.
  double optimism = 1.0;
};

}  // namespace kdl_calibration
