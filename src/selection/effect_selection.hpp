#pragma once

// Not installed.

#include <functional>
#include <vector>

#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "selection/model_score.hpp"

namespace kdl_calibration {

/// Estimates sizes by evidence (see SizeEstimator) and selects the model by cross-validation: leave-one-out below 40
/// configurations, else ten folds, of at most 2,000 evenly spaced configurations. Repeats count as their mean. Sizes
/// and noise are estimated again inside every fold. Everything is linear around the optimum of the rigid model, which
/// effects move by micrometres. One group is added at a time, the likeliest first. It must raise the log evidence by
/// at least 7 and lower the held-out RMS by 2 %, by more than one standard error of the difference. If tables come
/// before other groups that help, a second route takes those first and tables last. It replaces the first route if it
/// is likelier and predicts better, or as well with fewer terms. Finally the ripple search runs again with the
/// selected model. Throws InputError where effects are asked for by name and the measurements are too
/// few for them.
ModelSelection select_effects(const ModelSelectionTask& task);

/// The same where there is something to select, and where `rigid`, the fit of the geometry alone, allows it. It must
/// have arrived and be `determined`, all geometric errors estimated: priors would hide that some are open.
ModelSelection select_model(const ModelSelectionTask& task, const Identification& rigid, bool determined,
                            Method method);

/// [m] of each left-out point from its prediction, where the choice is made anew without its configuration.
std::vector<double> nested_distances(const ModelSelectionTask& task, const std::function<void()>& after_fold);

}  // namespace kdl_calibration
