#pragma once

// A calibration's options with every default resolved.

#include "estimation/registration.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "selection/model_selection.hpp"

namespace kdl_calibration {

struct CalibrationSettings {
  EstimatorOptions estimator;
  ParameterOptions parameters;
  NoiseOptions noise;
  ModelSelectionOptions selection;  ///< as it stands: neither priors nor effects by default
  ValidationOptions validation;
  DiagnosisOptions diagnosis;
  Configurations predict_at;
  int threads = 0;
  ProgressFunction progress;
};

/// Throws InputError for effects that are named and to be chosen as well.
CalibrationSettings settings_of(const CalibrationOptions& options);

/// Whether this is joint least squares without a robust loss.
inline bool is_plain(const EstimatorOptions& options) {
  return options.method == Method::joint && options.loss == Loss::none;
}

}  // namespace kdl_calibration
