#pragma once

// How good a calibration is: position errors before and after it, and how far it may be used.
//
//     const BeforeAfter* unseen = found.accuracy().held_out();
//     if (unseen) std::cout << unseen->before.rms << " m -> " << unseen->after.rms << " m\n";

#include <optional>

#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// Statistics of 3D position errors [m].
struct ErrorStatistics {
  long count = 0;
  double mean = 0.0;
  double rms = 0.0;
  double p95 = 0.0;  ///< 95th percentile, linear interpolation between order statistics
  double max = 0.0;
  double std = 0.0;  ///< sample standard deviation
};

/// Figures of ISO 9283 over all configurations and targets [m]: accuracy is the distance of the mean of the repeats
/// from the prediction, repeatability is l + 3 s of the repeats' distances l from their mean.
struct Iso9283 {
  ErrorStatistics accuracy;
  ErrorStatistics repeatability;  ///< of points with repeats
};

struct BeforeAfter {
  ErrorStatistics before;  ///< nominal geometry, base and targets registered
  ErrorStatistics after;
  /// The robot of the exported URDF alone, where it differs from the calibrated one: a rigid robot fitted without
  /// effects, or the nominal one where the calibration does not improve on it.
  std::optional<ErrorStatistics> rigid;
};

/// Position errors of the fitted rows, the test rows and configurations left out of the fit. Where points were measured
/// repeatedly, `train` and `test` are of single points, `train_means` and `test_means` of the means of their repeats;
/// what was left out is compared with the means.
struct Accuracy {
  BeforeAfter train;
  std::optional<BeforeAfter> train_means;
  std::optional<BeforeAfter> test;
  std::optional<BeforeAfter> test_means;
  /// Errors of the calibrated robot at test rows whose poses were fitted too, and at the other test rows. Set only if
  /// there are rows of the first kind.
  std::optional<ErrorStatistics> test_at_fitted_poses;
  std::optional<ErrorStatistics> test_at_new_poses;
  Iso9283 iso_before;
  Iso9283 iso_after;
  std::optional<Iso9283> iso_test_before;
  std::optional<Iso9283> iso_test_after;
  std::optional<BeforeAfter> leave_one_out;
  std::optional<ErrorStatistics> nested_leave_one_out;
  std::optional<BeforeAfter> k_fold;
  int folds = 0;  ///< of k_fold

  /// The errors at unseen configurations: leave-one-out, else k-fold; null without either.
  const BeforeAfter* held_out() const { return leave_one_out ? &*leave_one_out : k_fold ? &*k_fold : nullptr; }
};

/// How far a result may be used.
enum class Verdict {
  trusted,
  trusted_where_measured,  ///< predictions hold in the measured region; some parameters are not determined
  not_trusted
};

}  // namespace kdl_calibration
