#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "estimation/identification.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "uncertainty/observability.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {

/// 1 sigma of every measured coordinate [m]: an independent part for each target, and one shared by all targets of a
/// repeat (the robot's repeatability), both isotropic. A tracker's noise may replace the independent part.
struct PointNoise {
  double sigma = 3e-5;
  double configuration_sigma = 0.0;
  std::optional<TrackerNoise> tracker = std::nullopt;          ///< instead of `sigma`
  Eigen::Vector3d tracker_position = Eigen::Vector3d::Zero();  ///< [m] in the base frame
};

/// The noise model of a calibration if the axes of W are parallel to those of the base.
NoiseModel noise_model(const PointNoise& noise);

/// The parameters to identify and the planned measurements of them: points only, no orientations.
struct Experiment {
  ErrorModel model;                  ///< with the effects of `free`, linearised at zero
  Eigen::VectorXd errors;            ///< the geometry to linearise at; zero: nominal
  std::vector<TargetFrame> targets;  ///< all measured in every configuration
  Unknowns free;
  PointNoise noise;
  Priors priors;
};

/// The irreducible model at the nominal geometry.
Experiment nominal_experiment(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                              const PointNoise& noise = {}, const Priors& priors = {});

/// Number of free parameters: p.
Eigen::Index columns(const Experiment& experiment);

/// Fisher information (p x p) of the priors alone, of all targets in each of these configurations (joints x N), and of
/// the training rows of a file, with the sigma that it states. Targets are matched by name; the tracker's position is
/// found by registration.
Eigen::MatrixXd prior_information(const Experiment& experiment);
Eigen::MatrixXd information(const Experiment& experiment, const Eigen::MatrixXd& joint_values);
Eigen::MatrixXd information(const Experiment& experiment, const Measurements& measurements);

/// Predicted accuracy of a plan: 1 sigma of the predicted 3D position of a target [m], sqrt(tr cov), over
/// configurations and targets; base and targets are estimated along with the geometry.
struct Prediction {
  ErrorStatistics sigma;
  /// [m] the largest, over configurations, of the RMS of sigma over the targets.
  double worst_configuration = 0.0;
};
/// One prediction for each information matrix (p x p). Infinite if a matrix is singular.
std::vector<Prediction> predicted(const Experiment& experiment, const std::vector<Eigen::MatrixXd>& informations,
                                  const Eigen::MatrixXd& joint_values, int threads = 0);
Prediction predicted(const Experiment& experiment, const Eigen::MatrixXd& information,
                     const Eigen::MatrixXd& joint_values, int threads = 0);

/// The mean of each figure.
Prediction mean_of(const std::vector<Prediction>& predictions);

/// sigma sqrt(p / (T N)) [m] for T targets and N configurations: lower bound of the worst configuration's RMS sigma
/// among the candidates, for any design of N of them (the general equivalence theorem, Kiefer and Wolfowitz 1960).
/// Holds without priors, and for noise that is independent and the same in all directions.
double floor_of_worst_configuration(const Experiment& experiment, int count);

/// Observability indices (see observability.hpp) of a plan in metres and radians, not whitened.
ObservabilityIndices observability_indices(const Experiment& experiment, const Eigen::MatrixXd& joint_values);

}  // namespace kdl_calibration
