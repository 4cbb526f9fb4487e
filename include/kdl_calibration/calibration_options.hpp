#pragma once

// What a user may state about a calibration. Everything else is chosen by the data.
//
//     CalibrationOptions options;
//     options.parameters.fix = {"Tx*"};
//     const Calibration found = calibrate(robot, measurements, options);

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

class Calibration;

enum class Method { joint, two_step };
enum class ModelChoice { irreducible, complete };
/// How rows are weighed.
enum class Weights {
  automatic,  ///< by the parts of the noise, estimated unless stated
  equal,      ///< all alike, or by the stated noise
  repeats     ///< as automatic; repeats are required
};

constexpr int kJointIterations = 50;        ///< default limit of the joint estimator
constexpr int kTwoStepRounds = 1000;        ///< default limit of the two-step one
constexpr int kMostIterations = 1'000'000;  ///< largest limit

struct EstimatorOptions {
  Method method = Method::joint;
  int iterations = 0;  ///< limit up to kMostIterations; 0: kJointIterations, for two-step kTwoStepRounds
  Loss loss = Loss::none;
};

struct ParameterOptions {
  ModelChoice model = ModelChoice::irreducible;
  std::vector<std::string> fix = {};    ///< names or patterns with * and ? that are not estimated
  std::vector<std::string> free = {};   ///< names or patterns that are estimated in addition
  KnownFrames known = {};               ///< of stations and targets; all others are estimated
  KeptAxes keep_axes = KeptAxes::none;  ///< exactly as nominal; the result states what that costs
};

// Priors and effects that are not stated are chosen by cross-validation. Plain fits (the two-step estimator, the
// complete model, a robust loss) have neither unless they are stated.

/// 1 sigma of the geometric errors beforehand.
struct PriorOptions {
  Priors stated = {};
  /// Whether the sizes are estimated and used where they predict better. Default: where none are stated.
  std::optional<bool> automatic = std::nullopt;
  /// A trusted calibration of the same robot. Its parameters and effects are estimated again, with its covariance as
  /// their prior; base and targets are new. Errors that have changed since are found and freed. It must outlive the
  /// call and excludes other choices of parameters, priors and effects.
  const Calibration* earlier = nullptr;
};

/// Motions of the joints beyond the geometry.
struct EffectOptions {
  std::vector<EffectGroup> groups = {};
  /// Whether the groups are chosen. Default: where none is named. False without groups: a rigid arm.
  std::optional<bool> automatic = std::nullopt;
  /// Direction of gravity in the base frame, of any length. Not down for an arm on a wall or ceiling.
  Eigen::Vector3d gravity_direction = Eigen::Vector3d(0.0, 0.0, -1.0);
  Eigen::Vector3d payload_centre = Eigen::Vector3d::Zero();  ///< [m] centre of mass of the payload in the flange frame
  /// The same of several payloads by their mass [kg], instead. Each measured mass but 0 is one of them, to 0.01 kg.
  std::map<double, Eigen::Vector3d> payload_centres = {};
  /// Effects of the caller's own. Where the groups are chosen, these are candidates as well; else they are part of the
  /// model. A result file names them, and load_calibration wants their functions again.
  std::vector<OwnEffect> own = {};
};

struct NoiseOptions {
  NoiseModel stated = {};  ///< by the user; default: equal weights
  Weights weights = Weights::automatic;
  // What the measurements take as true and their residuals cannot show, 1 sigma. It is in every uncertainty.
  double scale_sigma = 1e-5;   ///< [m/m] of all measured lengths; cameras and motion capture have more
  double length_sigma = 2e-5;  ///< [m] of distances that are stated: between sockets of a plate or anchors, of a bar
};

struct ValidationOptions {
  bool leave_one_out = false;
  bool nested = false;  ///< leave-one-out that also repeats every automatic choice without each configuration
  int k_fold = 0;       ///< at least 2; 0: none
  /// Default if neither is requested: leave-one-out or, above kMostLeftOutSingly configurations, ten folds. Without it
  /// doubts cannot consider the error at unseen configurations.
  bool held_out = true;
};

/// Largest number of configurations for leave-one-out by default. The time of exact refits grows with its square.
constexpr std::size_t kMostLeftOutSingly = 5000;
constexpr int kFoldsOfMany = 10;

/// The frame in which an alternative displaces points. It also says who does so.
enum class DisplacementFrame {
  measuring,  ///< of the station: the measurement is wrong, and predictions should not have it
  base        ///< of the arm, which really is there: predictions should have it
};

/// An explanation of the residuals of the caller's own: unknown multiples of columns, beside all that is fitted. It is
/// tested as the built-in mistakes are, and changes no result: what is significant and moves predictions by more than
/// their radius is a doubt (Cause::own_alternative), else a remark with the same figures.
struct OwnAlternative {
  std::string name;  ///< letters, digits, '_' and '-'
  /// With a joint: its motions [rad or m per unit], N x K. Without: displacements of the measured points [m per unit],
  /// N x 3 K, x, y and z of the first column, then of the next.
  OwnColumns columns = {};
  std::string joint = {};                                  ///< URDF joint that moves
  EffectAxis axis = EffectAxis::own;                       ///< of the joint
  DisplacementFrame frame = DisplacementFrame::measuring;  ///< without a joint
};

struct DiagnosisOptions {
  bool try_readings = true;  ///< whether other readings of the data are tried
  /// The convention that converted the joint values, and others that the user may have meant. Other readings try them.
  std::optional<JointConvention> convention = std::nullopt;
  std::vector<JointConvention> other_conventions = {};
  std::vector<OwnAlternative> alternatives = {};  ///< of the caller's own; they need `try_readings`
};

struct Configurations {
  std::vector<std::string> names;
  Eigen::MatrixXd joint_values;  ///< joints x names, in the URDF's convention [rad] or [m]
  DriveSignals signals;
};

/// Called with the name of a stage ("leave-one-out"), how many of its fits are done and their total. Called from any
/// thread, one at a time.
using ProgressFunction = std::function<void(const std::string& what, std::size_t done, std::size_t of)>;

/// The defaults are those of `kdlcal calibrate`.
struct CalibrationOptions {
  EstimatorOptions estimator = {};
  ParameterOptions parameters = {};
  PriorOptions priors = {};
  EffectOptions effects = {};
  NoiseOptions noise = {};
  ValidationOptions validation = {};
  DiagnosisOptions diagnosis = {};
  Configurations predict_at = {};  ///< where to predict the accuracy
  int threads = 0;                 ///< 0: all
  ProgressFunction progress = {};
};

}  // namespace kdl_calibration
