#pragma once

#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "selection/effect_selection.hpp"

namespace kdl_calibration {

/// A fit and the measurements that it is compared with. Keeps references.
struct ValidationTask {
  const FitProblem& problem;         ///< training rows, start at the nominal robot, weights of the final fit
  const Measurements& measurements;  ///< all rows
  const DeterminedFit& fit;
  const FitOptions& rigid_options;   ///< of a fit without effects
  const Eigen::MatrixXd* root;       ///< R of the whitened system at the fit; nullptr if folds must be refitted
  double noise;                      ///< [m] of a coordinate
  double variance;                   ///< variance of unit weight, the factor on the covariances of R
  const ModelSelectionTask& choice;  ///< the selection that nested leave-one-out repeats
  const ValidationOptions& options;
};

struct Validation {
  Accuracy accuracy;
  std::vector<HeldOutPoint> held_out_points;  ///< of leave-one-out or k-fold; empty if the folds were refitted
  ExportedUrdf exported;
  std::vector<Remark> remarks;
};

/// Errors of the nominal and the calibrated robot at fitted and test rows and at left-out configurations. The exported
/// robot is the input robot if the calibration does not improve on it, or not without its effects.
Validation validate(const ValidationTask& compared);

/// Whether the calibrated robot predicts unfitted configurations no better than the nominal one.
bool is_no_better_than_nominal(const Accuracy& accuracy);

/// The same of the robot of the exported URDF, which has no effects.
bool is_no_better_without_effects(const BeforeAfter& errors);

/// The accuracy where the exported URDF is the one that was read: its own errors are those before.
Accuracy with_nominal_exported(Accuracy accuracy);

}  // namespace kdl_calibration
