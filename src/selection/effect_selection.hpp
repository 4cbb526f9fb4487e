#pragma once

#include <functional>
#include <vector>

#include "estimation/identification.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "selection/model_score.hpp"

namespace kdl_calibration {

/// Estimates sizes by evidence (see SizeEstimator) and selects the model by cross-validation: leave-one-out below 40
/// configurations, else ten folds, of at most 2,000 evenly spaced configurations. Repeats count as their mean. Sizes
/// and noise are estimated again inside every fold. Everything is linearised at the optimum of the rigid model, which
/// effects move by micrometres. One group is added at a time, the likeliest first, where gravity is taken to be e^7
/// times as likely beforehand: every arm sags. Where there are too few configurations for all of its terms, it has the
/// main ones. A group must raise the log evidence by at least 7 and lower the held-out RMS by 2 %, by more than one
/// standard error of the difference. If tables are added before other helpful groups, a second route adds those first
/// and tables last. It replaces the first if its evidence and prediction are better, or the prediction equal with fewer
/// terms. Finally the ripple search runs again with the selected model. Throws InputError if there are too few
/// measurements for effects requested by name.
ModelSelection select_effects(const ModelSelectionTask& task);

/// The same if the options ask for a selection and `rigid`, the fit of geometry alone, has converged. Otherwise the
/// options' priors without effects. Priors are chosen only if all errors are `determined`: they would hide others.
ModelSelection select_model(const ModelSelectionTask& task, const Identification& rigid, bool determined,
                            Method method);

/// [m] errors at left-out points, with the selection repeated without their configuration.
std::vector<double> nested_distances(const ModelSelectionTask& task, const std::function<void()>& after_fold);

}  // namespace kdl_calibration
