#pragma once

// The result of a calibration: the fit, its accuracy and its reliability.
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

/// Row weights of a robust fit; empty without a robust loss.
struct RobustRows {
  std::vector<double> weights;  ///< one per row
  double scale = 0.0;           ///< 1 sigma of a whitened coordinate, from the median residual
};

/// The estimate and its unknowns.
struct DeterminedFit {
  Identification identification;
  RobustRows robust;
  Reduction reduction;
  Unknowns candidates;        ///< unknowns identifiable with these targets
  Unknowns free;              ///< those determined by the measurements, and estimated
  bool minimum_norm = false;  ///< whether the errors are the smallest that fit equally well
};

/// One line of the result: a geometric, base or target parameter, or an effect. SI units.
struct ParameterEstimate {
  std::string name;
  std::string joint;  ///< URDF joint whose origin includes it; empty for base and targets
  ParameterKind kind = ParameterKind::translation;
  std::string axis;  ///< "x", "y", "z"; empty for the axis of a skewed joint
  double nominal = 0.0;
  double value = 0.0;  ///< nominal + error
  double error = 0.0;
  double std = 0.0;                 ///< 1 sigma; 0 where fixed, infinite where not determined
  double degrees_of_freedom = 0.0;  ///< of Student's t for the confidence interval
  bool identifiable = false;
  bool gauge = false;  ///< held fixed: not determined by any measurement, or by these
};

struct BeforeAfter {
  ErrorStatistics before;  ///< nominal geometry, base and targets registered
  ErrorStatistics after;
  /// Only if effects were fitted: the rigid robot of the exported URDF, fitted without effects.
  std::optional<ErrorStatistics> rigid;
};

/// The robot that the exported URDF alone describes, with its own base and targets, and its accuracy.
struct ExportedUrdf {
  Estimate estimate;          ///< without effects
  bool nominal_kept = false;  ///< the input URDF, because the calibration does not improve on it
  ErrorStatistics train;
  Iso9283 iso;
  std::optional<ErrorStatistics> test;
  std::optional<ErrorStatistics> held_out;  ///< leave-one-out, else k-fold
};

/// Source of the covariance: estimated parts of the noise or, without them, the stated noise or the residuals.
enum class NoiseSource { parts, stated, residuals };
const char* to_string(NoiseSource source);

struct NoiseReport {
  NoiseSource source = NoiseSource::residuals;
  double sigma = 0.0;                                     ///< [m] of one coordinate of one row, all parts together
  Eigen::Vector3d independent = Eigen::Vector3d::Zero();  ///< [m] along the axes of W
  Eigen::Vector3d common = Eigen::Vector3d::Zero();       ///< [m] shared by the points of a repeat
  /// The stated tracker noise, if any, which depends on the point's position; `independent` is its mean.
  std::optional<TrackerNoise> tracker;
  double misfit = 0.0;              ///< [m] shared by the targets of a configuration
  double target_misfit = 0.0;       ///< [m] of a target in a configuration, in every repeat
  std::optional<NoiseParts> parts;  ///< if estimated
  /// For each part d(covariance of the columns) / d(variance); empty for parts not estimated.
  std::vector<Eigen::MatrixXd> covariance_derivatives;
  double degrees_of_freedom = 0.0;
  /// Variance of the residuals over the stated variance if significantly above 1, else 1. Without `parts` it multiplies
  /// the covariance and the variance of a new point.
  double variance_factor = 1.0;
  std::optional<RepeatNoise> repeats;
  /// [m] weight of measured orientations without stated sigma, estimated from the residuals: an error of 1 rad counted
  /// as this position error.
  std::optional<double> orientation_length;
  std::optional<LackOfFit> lack_of_fit;  ///< if there are repeats

  /// Degrees of freedom of the covariance if no parts were estimated: infinite if the residuals agree with the stated
  /// noise.
  double freedom_of_covariance() const;
};

/// A cube of the workspace, with the predicted 3D 1 sigma [m] of configurations whose flange lies in it.
struct WorkspaceCell {
  Eigen::Vector3d centre;  ///< [m] in the base frame
  int count = 0;
  double mean = 0.0;
  double max = 0.0;
};

/// Predicted position of a target and its uncertainty.
struct PredictedPoint {
  std::string configuration;
  std::string target;
  Eigen::Vector3d position;         ///< [m] in the base frame
  Eigen::Vector3d position_W;       ///< [m] in the measuring device's frame
  Eigen::Vector3d std;              ///< [m] of the parameters alone along the axes of W; infinite where not determined
  double sigma = 0.0;               ///< [m] 3D 1 sigma of the parameters alone
  double radius_95 = 0.0;           ///< [m] of the sphere that holds a new measured point with 95 %
  bool outside = false;             ///< whether outside the measured region: the radius does not hold there
  double degrees_of_freedom = 0.0;  ///< of the radius and of intervals
};

struct PredictedAccuracy {
  ErrorStatistics measured;          ///< 3D 1 sigma [m] at the measured configurations (the first 1,000)
  ErrorStatistics workspace;         ///< at 1,000 seeded configurations within the joint limits
  std::vector<WorkspaceCell> cells;  ///< the same 1,000, in cubes of `cell` metres
  double cell = 0.5;
  /// Factor on the radii. With at least 40 configurations it makes them contain 95 % of the held-out points (conformal
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
  /// Predictions of leave_one_out or k_fold, point by point; empty if the folds were refitted.
  std::vector<HeldOutPoint> held_out_points;

  /// The errors at unseen configurations: leave-one-out, else k-fold; null without either.
  const BeforeAfter* held_out() const { return leave_one_out ? &*leave_one_out : k_fold ? &*k_fold : nullptr; }
};

/// Which parameters the measurements determine, and their uncertainty.
struct Uncertainty {
  Identifiability identifiability;          ///< of base, targets and geometry, without priors
  std::vector<std::string> fixed_by_gauge;  ///< errors held at zero, frames held as registered
  ObservabilityIndices observability;
  Eigen::MatrixXd covariance;                 ///< of the columns of `DeterminedFit::free`
  Influence influence;                        ///< of up to 5,000 configurations; empty where there are more
  std::vector<ParameterEstimate> parameters;  ///< base, targets, geometric, effects: estimated ones and the gauge
  PredictedAccuracy predicted;
};

/// Faults found in the measurements or the result.
struct Diagnosis {
  std::vector<QualityFinding> findings;  ///< faults of single measurements, found before the fit
  GrossRows gross_rows;                  ///< if left out, the other rows fit more than three times better
  std::vector<AlternativeReading> alternative_readings;  ///< readings that would explain the measurements much better
  std::vector<std::string> warnings;
  std::vector<Doubt> doubts;
  /// Set instead of the only doubt if that doubt is "not_determined" for named geometric errors, every prediction in
  /// the measured region is determined, and the held-out error is at most half of the nominal robot's. The result is
  /// then trusted in the measured region.
  std::optional<Doubt> reservation;
};

struct Calibration {
  ErrorModel model;  ///< with the selected effects
  DeterminedFit fit;
  ModelSelection selection;
  NoiseReport noise;
  Accuracy accuracy;
  ExportedUrdf exported;
  Uncertainty uncertainty;
  Diagnosis diagnosis;
  double difference_to_kdl = 0.0;  ///< [m] largest difference of our flange poses from KDL's

  /// Whether the result may be used, at least in the measured region.
  bool trusted() const { return diagnosis.doubts.empty(); }
};

/// Whether points of the workspace beyond the measured region may be predicted worse than by the nominal robot.
bool is_uncertain_elsewhere(const Calibration& calibration);

/// Measured configurations with a joint value outside its limits.
int configurations_outside_limits(const ErrorModel& model, const Measurements& measurements);

}  // namespace kdl_calibration
