#pragma once

// The result of a calibration: the fit, its accuracy and its reliability.
//
//     const CalibrationResult found = calibrate(model, measurements);
//     if (found.trusted()) std::cout << found.accuracy.held_out()->after.rms << " m at unseen configurations\n";

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "calibration/calibration_settings.hpp"
#include "diagnosis/alternative_readings.hpp"
#include "estimation/identification.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/accuracy.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/doubt.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/reduction.hpp"
#include "noise/lack_of_fit.hpp"
#include "noise/noise_components.hpp"
#include "noise/noise_parts.hpp"
#include "screening/data_quality.hpp"
#include "screening/gross_rows.hpp"
#include "selection/model_selection.hpp"
#include "uncertainty/identifiability.hpp"
#include "uncertainty/influence.hpp"
#include "uncertainty/observability.hpp"
#include "validation/fold_prediction.hpp"
#include "validation/validation.hpp"

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

/// The robot that the exported URDF alone describes, with its own base and targets, and its accuracy.
struct ExportedUrdf {
  Estimate estimate;          ///< without effects
  bool nominal_kept = false;  ///< the input URDF, because the calibration, or its rigid part, is no better
  ErrorStatistics train;
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
  double misfit = 0.0;         ///< [m] shared by the targets of a configuration
  double target_misfit = 0.0;  ///< [m] of a target in a configuration, in every repeat
  /// Of each station, if its instruments differ; else empty. All noise above is that of factors 1, misfits have none.
  std::vector<NoiseFactors> stations;
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
  /// [m] 1 sigma of a coordinate at that station, all parts together.
  double sigma_at(std::size_t station) const;
};

/// The zero of an instrument that measures distances.
struct DistanceZero {
  double length = 0.0;  ///< [m] by which all are too long; 0 if it is not significant
  double sigma = 0.0;   ///< [m]
};

/// A cube of the workspace, with the predicted 3D 1 sigma [m] of configurations whose flange lies in it.
struct WorkspaceCell {
  Eigen::Vector3d centre;  ///< [m] in the base frame
  int count = 0;
  double mean = 0.0;
  double max = 0.0;
};

/// Predicted position of a target in a configuration that was asked for.
struct AskedPoint {
  std::string configuration;
  std::string target;
  Eigen::Vector3d position;         ///< [m] in the base frame
  Eigen::Vector3d nominal;          ///< [m] where the nominal geometry puts the same target
  Eigen::Vector3d position_W;       ///< [m] in the measuring device's frame
  Eigen::Vector3d std;              ///< [m] of the parameters alone along the axes of W; infinite where not determined
  double sigma = 0.0;               ///< [m] 3D 1 sigma of the parameters alone
  double radius_95 = 0.0;           ///< [m] of the sphere that holds a new measured point with 95 %
  bool outside = false;             ///< whether outside the measured region: the radius does not hold there
  double degrees_of_freedom = 0.0;  ///< of the radius and of intervals
};

/// The region where the predicted radii hold, and their factor.
struct MeasuredRegion {
  /// The radii's factor: the smallest one for which 95 % of n + 1 held-out configurations lie within the radii
  /// predicted without them (conformal prediction, Lei et al. 2018; each counts with the share of its targets). Below
  /// 40 configurations it is the optimism of the model selection, times the RMS ratio of the errors of left-out points
  /// to their predicted 1 sigma if that is above 1.
  double radius_factor = 1.0;
  double largest_variance = 0.0;  ///< [m^2] trace of the covariance of a held-out point by the parameters
  JointRanges joints;             ///< of the training rows, and 5 % beyond on both sides
  /// [m] RMS distance of the predictions there from those of models with sag, weighted by odds. It is part of the
  /// radii. 0 if sag was chosen, and from 40 configurations on.
  double unproved = 0.0;

  bool holds(const Eigen::VectorXd& q, const Eigen::Matrix3d& of_parameters) const;
};

/// Up to 1,000 configurations of test rows inside the measured region, and those of them whose points are off by more
/// than `radius_95`, as the root mean square over the points of error over radius.
struct TestedRadius {
  int configurations = 0;
  int outside = 0;
  /// That as many are outside if each is with 15 %; or that they are off by so much more of their radius than left-out
  /// configurations, by more than half.
  double p_value = 1.0;
};

struct PredictedAccuracy {
  ErrorStatistics measured;  ///< 3D 1 sigma [m] at the measured configurations (the first 1,000)
  /// At left-out configurations, predicted from the others; at the measured ones where none was left out.
  ErrorStatistics unseen;
  double of_assumptions = 0.0;       ///< [m] RMS 3D 1 sigma there by what the measurements take as true
  ErrorStatistics workspace;         ///< at 1,000 seeded configurations within the joint limits
  std::vector<WorkspaceCell> cells;  ///< the same 1,000, in cubes of `cell` metres
  double cell = 0.5;
  MeasuredRegion region;
  /// Directions of DeterminedFit::candidates that the measurements do not determine: candidates x directions.
  Eigen::MatrixXd undetermined;
  std::vector<AskedPoint> asked;  ///< CalibrationSettings::predict_at, every target
  TestedRadius tested;
};

/// Which parameters the measurements determine, and their uncertainty.
struct Uncertainty {
  Identifiability identifiability;          ///< of base, targets and geometry, without priors
  std::vector<std::string> fixed_by_gauge;  ///< errors held at zero, frames held as registered
  ObservabilityIndices observability;
  Eigen::MatrixXd covariance;  ///< of the columns of `DeterminedFit::free`
  Influence influence;         ///< of up to 5,000 configurations; empty where there are more
  /// How far the residuals of groups of configurations move the estimate (columns x groups), and each prior by its 1
  /// sigma. Their outer products add up to a covariance that does not take the misfit for white noise. Empty where
  /// `influence` is.
  Eigen::MatrixXd shifts;
  std::vector<ParameterEstimate> parameters;  ///< base, targets, geometric, effects: estimated ones and the gauge
  PredictedAccuracy predicted;
};

/// Faults found in the measurements or the result.
struct Diagnosis {
  std::vector<QualityFinding> findings;  ///< faults of single measurements, found before the fit
  GrossRows gross_rows;                  ///< if left out, the other rows fit more than three times better
  std::vector<AlternativeReading> alternative_readings;  ///< readings that would explain the measurements much better
  std::vector<DetectableMistake> detectable;             ///< the smallest mistakes that would have shown
  std::vector<Remark> remarks;                           ///< whose messages are the warnings
  std::vector<Doubt> doubts;
  /// Set instead of the only doubt if that doubt is "not_determined" for named geometric errors, every prediction in
  /// the measured region is determined, and the held-out error is at most half of the nominal robot's. The result is
  /// then trusted in the measured region.
  std::optional<Doubt> reservation;
};

/// A fit of the joints' zero offsets alone, with base and targets.
struct OffsetsAlone {
  Eigen::VectorXd errors;    ///< one per geometric error parameter; all but the offsets are 0
  ErrorStatistics accuracy;  ///< of the fitted rows (means of repeats)
};

/// Position errors of the same calibration without kept axes.
struct FreeAxes {
  std::string not_computed;  ///< why there are none; empty: there are
  BeforeAfter train;
  std::optional<BeforeAfter> held_out;
};

struct CalibrationResult {
  CalibrationSettings settings;  ///< that made it
  ErrorModel model;              ///< with the selected effects
  DeterminedFit fit;
  ModelSelection selection;
  NoiseReport noise;
  std::optional<DistanceZero> distance_zero;  ///< if distances were measured
  Accuracy accuracy;
  /// Predictions of leave_one_out or k_fold, point by point; empty if the folds were refitted.
  std::vector<HeldOutPoint> held_out_points;
  ExportedUrdf exported;
  std::optional<OffsetsAlone> offsets_alone;  ///< with a joint convention, for mastering
  std::optional<FreeAxes> free_axes;          ///< with kept axes, for comparison
  Uncertainty uncertainty;
  Diagnosis diagnosis;
  double difference_to_kdl = 0.0;  ///< [m] largest difference of our flange poses from KDL's

  Verdict verdict() const {
    return !trusted()              ? Verdict::not_trusted
           : diagnosis.reservation ? Verdict::trusted_where_measured
                                   : Verdict::trusted;
  }
  /// Whether the result may be used, at least in the measured region.
  bool trusted() const { return diagnosis.doubts.empty(); }
};

/// Whether points of the workspace beyond the measured region may be predicted worse than by the nominal robot.
bool is_uncertain_elsewhere(const CalibrationResult& calibration);

/// Measured configurations with a joint value outside its limits.
int configurations_outside_limits(const ErrorModel& model, const Measurements& measurements);

}  // namespace kdl_calibration
