#pragma once

#include <vector>

#include "calibration/parameter_choice.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

/// What a fit needs to know; keeps references.
struct FitTask {
  const ErrorModel& model;
  const Measurements& measurements;  ///< training rows alone
  const Estimate& start;
  const CalibrationOptions& options;
  const FitOptions& fit_options;
};

/// Of a fit with a robust loss; no weights without one.
struct RobustRows {
  std::vector<double> weights;  ///< of each training row
  double scale = 0.0;           ///< 1 sigma of a whitened coordinate, by the median of the residuals
};

struct WholeFit {
  Identification identification;
  RobustRows robust;
  Reduction reduction;
  Unknowns candidates;  ///< what the targets could show
  Unknowns free;        ///< what the measurements tell of it, and was estimated
};

/// Whether a fit ended where its gradient vanishes.
bool arrived(const Identification& found);

/// Fits what the measurements determine of `candidates`, which are those of `choice`, from `task.start`. Where that set
/// of parameters does not lead to the noise, the complete set with the errors that are usual of an arm goes on, and a
/// set chosen at its end finishes: two parameters that are the same at the nominal geometry may differ at the true one.
/// Parameters that only a measurement without noise could tell are held where the residuals show that there is noise.
WholeFit fit_whole(const FitTask& task, const ParameterChoice& choice, const Unknowns& candidates);

}  // namespace kdl_calibration
