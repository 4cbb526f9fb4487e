#pragma once

// The result of a calibration, in groups that say what was fitted and how far to trust it.
//
//     const Calibration found = calibrate(model, measurements);
//     if (found.trusted()) std::cout << found.accuracy.held_out()->after.rms << " m at unseen configurations\n";

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/alternative_readings.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/data_quality.hpp"
#include "kdl_calibration/doubt.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/fold_prediction.hpp"
#include "kdl_calibration/gross_rows.hpp"
#include "kdl_calibration/identifiability.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/influence.hpp"
#include "kdl_calibration/lack_of_fit.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/model_selection.hpp"
#include "kdl_calibration/noise_components.hpp"
#include "kdl_calibration/noise_parts.hpp"
#include "kdl_calibration/observability.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/unknowns.hpp"
#include "kdl_calibration/validation.hpp"

namespace kdl_calibration {

/// Of a fit with a robust loss; no weights without one.
struct RobustRows {
  std::vector<double> weights;  ///< of each row
  double scale = 0.0;           ///< 1 sigma of a whitened coordinate, by the median of the residuals
};

/// The estimate, and which unknowns it has.
struct DeterminedFit {
  Identification identification;
  RobustRows robust;
  Reduction reduction;
  Unknowns candidates;        ///< unknowns that the targets could show
  Unknowns free;              ///< those of them that the measurements determine, and that were estimated
  bool minimum_norm = false;  ///< of all answers that are as good, the one with the smallest errors
};

/// One line of the result: a geometric, base or target parameter, or an effect. SI units.
struct ParameterEstimate {
  std::string name;
  std::string joint;  ///< URDF joint whose origin carries it; empty for base and targets
  ParameterKind kind = ParameterKind::translation;
  std::string axis;  ///< "x", "y", "z"; empty for the axis of a skewed joint
  double nominal = 0.0;
  double value = 0.0;  ///< nominal + error
  double error = 0.0;
  double std = 0.0;                 ///< 1 sigma; 0 where fixed, infinite where not determined
  double degrees_of_freedom = 0.0;  ///< of Student's t for its interval
  bool identifiable = false;
  bool gauge = false;  ///< held by choice: no measurement could tell it, or these measurements cannot
};

struct BeforeAfter {
  ErrorStatistics before;  ///< nominal geometry, base and targets registered
  ErrorStatistics after;
  /// Where effects were fitted: the rigid robot that the URDF can carry, fitted without them.
  std::optional<ErrorStatistics> rigid;
};

/// The robot that the exported URDF alone describes, with a base and targets of its own, and its accuracy.
struct ExportedUrdf {
  Estimate estimate;          ///< without effects
  bool nominal_kept = false;  ///< because the calibration does not help: the URDF is the one that was read
  ErrorStatistics train;
  Iso9283 iso;
  std::optional<ErrorStatistics> test;
  std::optional<ErrorStatistics> held_out;  ///< of leave-one-out, else of k-fold
};

/// What the covariance rests on: estimated parts of the noise or, without them, the stated noise or the residuals.
enum class NoiseSource { parts, stated, residuals };
const char* to_string(NoiseSource source);

struct NoiseReport {
  NoiseSource source = NoiseSource::residuals;
  double sigma = 0.0;                                     ///< [m] of one coordinate of one row, all parts together
  Eigen::Vector3d independent = Eigen::Vector3d::Zero();  ///< [m] along the axes of W
  Eigen::Vector3d common = Eigen::Vector3d::Zero();       ///< [m] shared by the points of a repeat
  /// Where one is stated: the noise of a point at its place, which `independent` is the mean of.
  std::optional<TrackerNoise> tracker;
  double misfit = 0.0;              ///< [m] shared by the targets of a configuration
  double target_misfit = 0.0;       ///< [m] of a target in a configuration, in every repeat
  std::optional<NoiseParts> parts;  ///< where they were estimated
  /// Of each of these: d(covariance of the columns) / d(variance); empty where it is not estimated.
  std::vector<Eigen::MatrixXd> covariance_derivatives;
  double degrees_of_freedom = 0.0;
  /// Square of residuals over stated noise where the fit is worse than that, else 1; without `parts` the covariance and
  /// the variance of a new point are multiplied by it.
  double variance_factor = 1.0;
  std::optional<RepeatNoise> repeats;
  /// [m] where orientations were measured and no sigma of theirs is stated: an error of one radian counted as much as
  /// this error of position, found from the residuals of both.
  std::optional<double> orientation_length;
  std::optional<LackOfFit> lack_of_fit;  ///< where there are repeats

  /// Degrees of freedom that the covariance rests on where no parts were estimated: infinite of stated noise that
  /// holds.
  double freedom_of_covariance() const;
};

/// A cube of the workspace and the predicted 3D 1 sigma [m] of the configurations whose flange lies in it.
struct WorkspaceCell {
  Eigen::Vector3d centre;  ///< [m] in the base frame
  int count = 0;
  double mean = 0.0;
  double max = 0.0;
};

/// Where a target will be, and how far the real one may be from there.
struct PredictedPoint {
  std::string configuration;
  std::string target;
  Eigen::Vector3d position;         ///< [m] in the base frame
  Eigen::Vector3d position_W;       ///< [m] in the measuring device's frame
  Eigen::Vector3d std;              ///< [m] of the parameters alone along the axes of W; infinite where not determined
  double sigma = 0.0;               ///< [m] 3D 1 sigma of the parameters alone
  double radius_95 = 0.0;           ///< [m] of the sphere that holds a new measured point with 95 %
  bool outside = false;             ///< of the region that was measured: the radius is no promise there
  double degrees_of_freedom = 0.0;  ///< that radius and intervals rest on
};

struct PredictedAccuracy {
  ErrorStatistics measured;          ///< 3D 1 sigma [m] at the measured configurations (the first 1,000)
  ErrorStatistics workspace;         ///< at 1,000 seeded configurations within the joint limits
  std::vector<WorkspaceCell> cells;  ///< the same 1,000, in cubes of `cell` metres
  double cell = 0.5;
  /// Radii are multiplied by this. From 40 configurations on it makes 95 % of held-out points lie inside (conformal
  /// prediction). With fewer it is the optimism of the selection.
  double radius_factor = 1.0;
  std::vector<PredictedPoint> asked;  ///< CalibrationOptions::predict_at, every target
};

/// Position errors of the fitted rows, the test rows and configurations left out of the fit.
struct Accuracy {
  BeforeAfter train;
  std::optional<BeforeAfter> test;
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
  /// Point by point the predictions of leave_one_out or k_fold; empty where the folds were fitted again.
  std::vector<HeldOutPoint> held_out_points;

  /// The errors at unseen configurations: leave-one-out, else k-fold; null where neither could be had.
  const BeforeAfter* held_out() const { return leave_one_out ? &*leave_one_out : k_fold ? &*k_fold : nullptr; }
};

/// What the measurements determine, and how well.
struct Uncertainty {
  Identifiability identifiability;          ///< of base, targets and geometry, by the measurements alone
  std::vector<std::string> fixed_by_gauge;  ///< errors at zero, frames as they were registered
  ObservabilityIndices observability;
  Eigen::MatrixXd covariance;                 ///< of the columns of `DeterminedFit::free`
  Influence influence;                        ///< of up to 5,000 configurations; empty where there are more
  std::vector<ParameterEstimate> parameters;  ///< base, targets, geometric, effects: estimated ones and the gauge
  PredictedAccuracy predicted;
};

/// What is wrong with the measurements or the answer.
struct Diagnosis {
  std::vector<QualityFinding> findings;  ///< in the measurements themselves, found before the fit
  GrossRows gross_rows;                  ///< rows without which all others fit more than three times as well
  std::vector<AlternativeReading> alternative_readings;  ///< readings that would explain the measurements much better
  std::vector<std::string> warnings;
  std::vector<Doubt> doubts;
  /// Set instead of the only doubt if that doubt is "not_determined" for named geometric errors, every prediction in
  /// the measured region is determined, and the held-out error is at most half of the nominal robot's. The answer is
  /// then trusted where it was measured.
  std::optional<Doubt> reservation;
};

struct Calibration {
  ErrorModel model;  ///< with the effects that were selected
  DeterminedFit fit;
  ModelSelection selection;
  NoiseReport noise;
  Accuracy accuracy;
  ExportedUrdf exported;
  Uncertainty uncertainty;
  Diagnosis diagnosis;
  double difference_to_kdl = 0.0;  ///< [m] of the flange pose at the measured configurations

  /// Whether the answer may be used as it stands, or where it was measured.
  bool trusted() const { return diagnosis.doubts.empty(); }
};

/// Whether points of the workspace beyond the measured region may be predicted worse than by the nominal robot.
bool is_uncertain_elsewhere(const Calibration& calibration);

/// Measured configurations with a joint value outside its limits.
int configurations_outside_limits(const ErrorModel& model, const Measurements& measurements);

}  // namespace kdl_calibration
