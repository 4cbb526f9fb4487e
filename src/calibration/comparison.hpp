#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calibration/effect_choice.hpp"
#include "calibration/whole_fit.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/fold_prediction.hpp"

namespace kdl_calibration {

/// What is compared with the measurements. Keeps references.
struct Compared {
  const FitTask& task;               ///< of the training rows
  const Measurements& measurements;  ///< all rows
  bool tested;                       ///< whether there are test rows
  const WholeFit& fit;
  const RegistrationOptions& known;  ///< frames
  const FitOptions& rigid_options;   ///< of a fit without effects
  const Eigen::MatrixXd* triangle;   ///< of the whitened system at the fit; nullptr where folds must be fitted again
  double noise;                      ///< [m] of a coordinate
  double variance;                   ///< of unit weight, by which the triangle's covariances are multiplied
  const ChoiceTask& choice;          ///< that the nested leave-one-out repeats
};

/// How far the fitted and the test rows are from the nominal and from the calibrated robot.
struct Comparison {
  BeforeAfter train;
  std::optional<BeforeAfter> test;
  std::optional<ErrorStatistics> test_at_fitted_poses;  ///< where there are any
  std::optional<ErrorStatistics> test_at_new_poses;     ///< beside those
  Iso9283 iso_before;
  Iso9283 iso_after;
  std::optional<Iso9283> iso_test_before;
  std::optional<Iso9283> iso_test_after;
  ExportedUrdf exported;
};
Comparison compare(const Compared& compared);

/// How far they predict configurations that were not fitted; `fitted`: what they leave of those that were.
struct HeldOutErrors {
  std::optional<BeforeAfter> leave_one_out;
  std::optional<ErrorStatistics> nested_leave_one_out;
  std::optional<BeforeAfter> k_fold;
  int folds = 0;
  FoldPrediction prediction;  ///< point by point, where the folds were not all fitted again
  std::vector<std::string> warnings;
};
HeldOutErrors hold_out(const Compared& compared, const Comparison& fitted);

}  // namespace kdl_calibration
