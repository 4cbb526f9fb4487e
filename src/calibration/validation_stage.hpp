#pragma once

#include <string>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "selection/effect_selection.hpp"

namespace kdl_calibration {

/// A fit and the measurements that it is compared with. Keeps references.
struct ValidationTask {
  const FitProblem& problem;         ///< of the training rows; starts at the nominal robot, weighed as at the fit's end
  const Measurements& measurements;  ///< all rows
  const DeterminedFit& fit;
  const FitOptions& rigid_options;   ///< of a fit without effects
  const Eigen::MatrixXd* root;       ///< R of the whitened system at the fit; nullptr where folds must be fitted again
  double noise;                      ///< [m] of a coordinate
  double variance;                   ///< of unit weight, by which the covariances of R are multiplied
  const ModelSelectionTask& choice;  ///< that the nested leave-one-out repeats
  const ValidationOptions& options;
};

struct Validation {
  Accuracy accuracy;
  ExportedUrdf exported;
  std::vector<std::string> warnings;
};

/// How far the fitted and the test rows are from the nominal and from the calibrated robot, and how far both predict
/// configurations that were not fitted. The exported robot is the one that was read if the calibration does not help.
Validation validate(const ValidationTask& compared);

/// Whether the calibrated robot predicts what was not fitted no better than the nominal one.
bool is_no_better_than_nominal(const Accuracy& accuracy);

}  // namespace kdl_calibration
