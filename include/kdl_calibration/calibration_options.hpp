#pragma once

// Options of a calibration.
//
//     CalibrationOptions options;
//     options.parameters.fix = {"Tx*"};
//     const Calibration found = calibrate(model, measurements, options);

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/drive_signals.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/model_selection.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "kdl_calibration/registration.hpp"

namespace kdl_calibration {

enum class Method { joint, two_step };
enum class ModelChoice { irreducible, complete };
/// How rows are weighed.
enum class Weights {
  automatic,  ///< by the parts of the noise, estimated unless stated
  equal,      ///< all alike, or by the stated noise
  repeats     ///< as automatic; repeats are required
};

struct EstimatorOptions {
  Method method = Method::joint;
  int iterations = 0;  ///< limit; 0: 50 for the joint estimator, 1000 rounds for the two-step one
  Loss loss = Loss::none;
};
/// Whether this is joint least squares without a robust loss.
inline bool is_plain(const EstimatorOptions& options) {
  return options.method == Method::joint && options.loss == Loss::none;
}

struct ParameterOptions {
  ModelChoice model = ModelChoice::irreducible;
  std::vector<std::string> fix;                 ///< names or patterns with * and ? that are not estimated
  std::vector<std::string> free;                ///< names or patterns that are estimated in addition
  std::optional<Eigen::Isometry3d> known_base;  ///< X_WB
  std::vector<TargetFrame> known_targets;
};
inline RegistrationOptions known_frames(const ParameterOptions& options) {
  return {.known_base = options.known_base, .known_targets = options.known_targets};
}

struct NoiseOptions {
  NoiseModel stated;  ///< by the user; default: equal weights
  Weights weights = Weights::automatic;
};

struct ValidationOptions {
  bool leave_one_out = false;
  bool nested = false;  ///< leave-one-out that also repeats every automatic choice without each configuration
  int k_fold = 0;       ///< 0: none
  /// Default if neither is requested: leave-one-out or, above kMostLeftOutSingly configurations, ten folds. Without it
  /// doubts cannot consider the error at unseen configurations.
  bool held_out = true;
};

/// Largest number of configurations for leave-one-out by default. The time of exact refits grows with its square.
constexpr std::size_t kMostLeftOutSingly = 5000;
constexpr int kFoldsOfMany = 10;

struct DiagnosisOptions {
  bool try_readings = true;  ///< whether other readings of the data are tried
  /// The convention that converted the joint values, and others that the user may have meant. Other readings try them.
  std::optional<JointConvention> convention;
  std::vector<JointConvention> other_conventions;
};

struct Configurations {
  std::vector<std::string> names;
  Eigen::MatrixXd joint_values;  ///< joints x names, in the URDF's convention [rad] or [m]
  DriveSignals signals;
};

/// Called with the name of a stage ("leave-one-out"), how many of its fits are done and their total. Called from any
/// thread, one at a time.
using ProgressFunction = std::function<void(const std::string& what, std::size_t done, std::size_t of)>;

struct CalibrationOptions {
  EstimatorOptions estimator;
  ParameterOptions parameters;
  NoiseOptions noise;
  ModelSelectionOptions selection;
  ValidationOptions validation;
  DiagnosisOptions diagnosis;
  Configurations predict_at;  ///< where to predict the accuracy
  int threads = 0;            ///< 0: all
  ProgressFunction progress;
};

}  // namespace kdl_calibration
