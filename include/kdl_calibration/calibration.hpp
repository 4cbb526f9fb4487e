#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/calibrated_urdf.hpp"
#include "kdl_calibration/data_quality.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/fold_prediction.hpp"
#include "kdl_calibration/gross_rows.hpp"
#include "kdl_calibration/identifiability.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/influence.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/lack_of_fit.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_components.hpp"
#include "kdl_calibration/noise_parts.hpp"
#include "kdl_calibration/observability.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/suspicions.hpp"
#include "kdl_calibration/unknowns.hpp"
#include "kdl_calibration/validation.hpp"

namespace kdl_calibration {

enum class Method { joint, two_step };
enum class ModelChoice { irreducible, complete };
/// How rows are weighed: by the parts of the noise, estimated where not stated; all alike, or as stated; or by the
/// parts with repeats demanded.
enum class Weights { automatic, equal, repeats };

/// What besides the geometry moves the arm.
struct Effects {
  std::vector<EffectGroup> groups;  ///< these
  bool automatic = false;           ///< or those that cross-validation accepts
};

/// A choice of effects and of priors, and what cross-validation said of it.
struct ModelOption {
  Priors priors;
  std::vector<std::string> effects;  ///< groups, in the order in which they were added
  bool sized = false;                ///< whether the priors' sizes were estimated with it
  double held_out_rms = 0.0;         ///< [m]; infinite where the rest does not determine what was left out
  double evidence = 0.0;             ///< log of the likelihood of the sizes, comparable among options alike in `sized`
};

struct Configurations {
  std::vector<std::string> names;
  Eigen::MatrixXd joint_values;  ///< joints x names, in the URDF's convention [rad] or [m]
  DriveSignals signals;
};

struct CalibrationOptions {
  Method method = Method::joint;
  ModelChoice model = ModelChoice::irreducible;
  int iterations = 0;             ///< limit; 0: 50 for the joint estimator, 1000 rounds for the two-step one
  std::vector<std::string> fix;   ///< names or patterns with * and ? that are not estimated
  std::vector<std::string> free;  ///< names or patterns that are estimated in addition
  Priors priors;
  bool automatic_priors = false;  ///< their sizes by evidence, or none, as cross-validation says
  Effects effects;
  Loss loss = Loss::none;
  NoiseModel noise;  ///< as stated by the user; the default weighs all rows alike
  Weights weights = Weights::automatic;
  std::optional<Eigen::Isometry3d> known_base;  ///< X_WB
  std::vector<TargetFrame> known_targets;
  bool leave_one_out = false;
  bool nested = false;  ///< leave_one_out, and beside it every automatic choice made anew without each configuration
  int k_fold = 0;       ///< 0: none
  /// Where neither is asked for: leave-one-out or, above kMostLeftOutSingly configurations, ten folds. Without it the
  /// answer cannot be doubted for what it does at unseen configurations.
  bool held_out = true;
  int threads = 0;           ///< 0: all
  bool try_readings = true;  ///< look for suspicions
  /// That made the joint values the URDF's, and others that may have been meant: suspicions are tried with them.
  std::optional<JointConvention> convention;
  std::vector<JointConvention> other_conventions;
  Configurations predict_at;  ///< where the predicted accuracy is asked for
  /// Called with what is being done ("leave-one-out") and how many of its fits are, from one thread at a time.
  std::function<void(const std::string& what, std::size_t done, std::size_t of)> progress;
};

/// Configurations up to which each is left out singly unless the options say otherwise. Exact refits take a time that
/// grows with the square of that number.
constexpr std::size_t kMostLeftOutSingly = 5000;
constexpr int kFoldsOfMany = 10;

/// One line of the result: a geometric, base or target parameter, or an effect. SI units.
struct ParameterEstimate {
  std::string name;
  std::string joint;  ///< URDF joint whose origin carries it; empty for base and targets
  std::string kind;   ///< "joint_offset", "translation", "rotation", "effect"
  std::string axis;   ///< "x", "y", "z"; empty for the axis of a skewed joint
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

/// What the exported URDF alone is worth, with a base and targets of its own.
struct ExportedUrdf {
  Estimate estimate;          ///< without effects
  bool nominal_kept = false;  ///< because the calibration does not help: the URDF is the one that was read
  ErrorStatistics train;
  Iso9283 iso;
  std::optional<ErrorStatistics> test;
  std::optional<ErrorStatistics> held_out;  ///< of leave-one-out, else of k-fold
};

/// Why an answer is not to be trusted.
struct Doubt {
  std::string cause;    ///< a word that does not change: "not_converged", "not_determined", …
  std::string message;  ///< what it means and what to do, in words
};

/// What the covariance rests on.
struct NoiseReport {
  std::string model;                                      ///< "parts", or without them "stated" or "residuals"
  double sigma = 0.0;                                     ///< [m] of one coordinate of one row, all parts together
  Eigen::Vector3d independent = Eigen::Vector3d::Zero();  ///< [m] along the axes of W
  Eigen::Vector3d common = Eigen::Vector3d::Zero();       ///< [m] shared by the points of a repeat
  /// Where one is stated: the noise of a point at its place, which `independent` is the mean of.
  std::optional<TrackerNoise> tracker;
  double misfit = 0.0;              ///< [m] shared by the targets of a configuration
  double target_misfit = 0.0;       ///< [m] of a target in a configuration, in every repeat
  std::optional<NoiseParts> parts;  ///< where they were estimated
  /// Of each of these: d(covariance of the columns) / d(variance); empty where it is not estimated.
  std::vector<Eigen::MatrixXd> slopes;
  double degrees_of_freedom = 0.0;
  /// Square of residuals over stated noise where the fit is worse than that, else 1; without `parts` the covariance and
  /// the variance of a new point are multiplied by it.
  double variance_factor = 1.0;
  std::optional<RepeatNoise> repeats;
  /// [m] where orientations were measured and no sigma of theirs is stated: an error of one radian counted as much as
  /// this error of position, found from the residuals of both.
  std::optional<double> orientation_length;

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
  /// What the radii were multiplied by: from 40 configurations on so that 95 % of the held-out points lie inside, below
  /// by how many times larger the held-out RMS is where the model is chosen without what is held out.
  double radius_factor = 1.0;
  std::vector<PredictedPoint> asked;  ///< CalibrationOptions::predict_at, every target
};

struct Calibration {
  ErrorModel model;  ///< with the effects that were chosen
  Identification identification;
  Reduction reduction;
  Unknowns free;                            ///< what was estimated
  Unknowns candidates;                      ///< that and what these measurements cannot tell: `fixed_by_gauge`
  Identifiability identifiability;          ///< of the candidates
  std::vector<std::string> fixed_by_gauge;  ///< errors at zero, frames as they were registered
  bool minimum_norm = false;                ///< of all answers that are as good, the one with the smallest errors
  ObservabilityIndices observability;
  NoiseReport noise;
  std::vector<ParameterEstimate> parameters;  ///< base, targets, geometric, effects: estimated ones and the gauge
  Eigen::MatrixXd covariance;                 ///< of the columns of `free`
  std::vector<ModelOption> tried;             ///< best first, where something was chosen
  std::string not_tried;                      ///< which priors and effects were not tried, and why; empty if all were
  Priors priors;                              ///< in force
  ExportedUrdf exported;
  BeforeAfter train;
  std::optional<BeforeAfter> test;
  /// Errors of the calibrated robot at test rows whose poses were fitted too, and at the other test rows. Set only if
  /// there are rows of the first kind.
  std::optional<ErrorStatistics> test_at_fitted_poses;
  std::optional<ErrorStatistics> test_at_new_poses;
  std::optional<BeforeAfter> leave_one_out;
  std::optional<ErrorStatistics> nested_leave_one_out;
  std::optional<BeforeAfter> k_fold;
  int folds = 0;  ///< of k_fold
  /// Point by point what leave-one-out or k_fold predicts; empty where the folds were fitted again.
  std::vector<HeldOutPoint> held_out_points;
  Iso9283 iso_before;
  Iso9283 iso_after;
  std::optional<Iso9283> iso_test_before;
  std::optional<Iso9283> iso_test_after;
  Influence influence;                   ///< of up to 5,000 configurations; empty where there are more
  std::optional<LackOfFit> lack_of_fit;  ///< where there are repeats
  PredictedAccuracy predicted;
  std::vector<QualityFinding> findings;  ///< what is wrong with the measurements themselves, found before the fit
  /// Rows without which all others fit more than three times as well, and the misfit [m] then.
  std::vector<GrossRow> gross_rows;
  double misfit_without_gross_rows = 0.0;
  std::vector<Suspicion> suspicions;  ///< readings that would explain the measurements much better
  std::vector<double> weights;        ///< of each observation, where a robust loss was used
  double difference_to_kdl = 0.0;     ///< [m] of the flange pose at the measured configurations
  std::vector<std::string> warnings;

  std::vector<Doubt> doubts;
  /// Set instead of the only doubt if that doubt is "not_determined" for named geometric errors, every prediction in
  /// the measured region is determined, and the held-out error is at most half of the nominal robot's. The answer is
  /// then trusted where it was measured.
  std::optional<Doubt> reservation;

  /// Whether the answer may be used as it stands, or where it was measured.
  bool trusted() const { return doubts.empty(); }
  /// The errors at unseen configurations: leave-one-out, else k-fold; null where neither could be had.
  const BeforeAfter* held_out() const;
};

/// The whole calibration: registration, reduction of the model to what the measured targets can show, choice of priors
/// and effects, identification, covariance, validation. No starting values are needed.
/// Throws InputError: measurements that do not hold together or are another robot's, a sigma or prior that is negative
/// or not finite, a pattern that matches nothing, a fixed base or target coordinate that is not known, two-step
/// with known frames, measured orientations, priors, effects or a loss, fewer equations than unknowns, no training
/// rows, noise from repeats without repeats, a sigma of orientations without one of positions or without orientations.
/// Candidates that the measurements at hand cannot tell apart are fixed by the order of the reduction (base, targets,
/// joint offsets, links): each is kept only where its column raises the rank at the data. What is dropped stays exactly
/// at zero, and the answer counts as rank deficient. For the joint estimator.
Calibration calibrate(const ErrorModel& model, const Measurements& measurements,
                      const CalibrationOptions& options = {});

/// Whether points of the workspace beyond the measured region may be predicted worse than by the nominal robot.
bool is_uncertain_elsewhere(const Calibration& calibration);

/// Measured configurations with a joint value outside its limits.
int configurations_outside_limits(const ErrorModel& model, const Measurements& measurements);

}  // namespace kdl_calibration
