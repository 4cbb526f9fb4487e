#pragma once

// Not installed.

#include <functional>
#include <string>
#include <vector>

#include "calibration/model_worth.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

struct Choice {
  std::vector<EffectTerm> terms;  ///< with their sigmas
  Priors priors;
  Priors rigid_priors;  ///< that are best where there are no effects
  double noise = 0.0;   ///< [m] 1 sigma of a coordinate of a mean, by the evidence of what is chosen
  std::vector<ModelOption> tried;
  std::string not_tried;         ///< groups of effects, and why
  std::size_t not_compared = 0;  ///< points of targets that one fold alone has
  double price = 1.0;            ///< of choosing, see TriedModels; 1 where effects were asked for by name
};

/// Whether there is anything to choose or to size.
bool choice_is_open(const CalibrationOptions& options);

/// Sizes by evidence (see SizeEstimator), the choice by cross-validation: leave-one-out below 40 configurations, else
/// ten folds, of at most 2,000 configurations, evenly spaced. Repeats count as their mean. Sizes and noise are found
/// again inside every fold; everything is linear around the optimum of the rigid model, which effects move by
/// micrometres. One group is added at a time, the likeliest first, while the evidence rises by at least 2 and the
/// held-out mean square falls by 4 % (the RMS by 2 %) and by more than one standard error of its difference over
/// configurations. Where tables come before others that help as well, the model that takes those first, and tables
/// behind them, stays if it is likelier and predicts better, or as well with fewer terms. Ripple is looked for again
/// beside all that came after it. Throws InputError where effects are asked for by name and the measurements are too
/// few for them.
Choice choose_effects(const ChoiceTask& task);

/// [m] of each left-out point from its prediction, where the choice is made anew without its configuration.
std::vector<double> nested_distances(const ChoiceTask& task, const std::function<void()>& after_fold);

}  // namespace kdl_calibration
