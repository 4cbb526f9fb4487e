#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/observability.hpp"
#include "kdl_calibration/unknowns.hpp"
#include "kdl_calibration/validation.hpp"

namespace kdl_calibration {

/// 1 sigma of every measured coordinate [m]: one part independent for each target, one that all targets of a repeat
/// share (the robot's repeatability), both the same in all directions; or a tracker's own noise for the independent
/// part.
struct PointNoise {
  double sigma = 3e-5;
  double configuration_sigma = 0.0;
  std::optional<TrackerNoise> tracker = std::nullopt;          ///< instead of `sigma`
  Eigen::Vector3d tracker_position = Eigen::Vector3d::Zero();  ///< [m] where it will stand, in the base frame
};

/// The same as the noise model of a calibration whose measuring frame has the base's directions.
NoiseModel noise_model(const PointNoise& noise);

/// What is to be identified and how it will be measured. Only points are planned for, no measured orientations.
struct Experiment {
  ErrorModel model;                  ///< with the effects that `free` may name, about zero
  Eigen::VectorXd errors;            ///< the geometry to linearise at; zero: nominal
  std::vector<TargetFrame> targets;  ///< all measured in every configuration
  Unknowns free;
  PointNoise noise;
  Priors priors;
};

/// The irreducible model at the nominal geometry. Names in `fixed` (of base and targets) are known and so not free.
Experiment nominal_experiment(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                              const PointNoise& noise = {}, const Priors& priors = {},
                              const std::vector<std::string>& fixed = {});

/// Number of free parameters: p.
Eigen::Index columns(const Experiment& experiment);

/// Change of the targets' points per unit of each free parameter at joint values `q`: 3 targets x p, in the flange
/// frame, so that its base and targets are those of the measuring device and no gauge is left.
Eigen::MatrixXd point_jacobian(const Experiment& experiment, const Eigen::Ref<const Eigen::VectorXd>& q);

/// Fisher information (p x p) of the priors alone, of all targets in each of these configurations (joints x N), and of
/// the training rows of a file, whose own sigma counts where it states one. Targets are matched by name; a tracker's
/// place is found from the file.
Eigen::MatrixXd prior_information(const Experiment& experiment);
Eigen::MatrixXd information(const Experiment& experiment, const Eigen::MatrixXd& joint_values);
Eigen::MatrixXd information(const Experiment& experiment, const Measurements& measurements);

/// What a plan promises: 1 sigma of the predicted 3D position of a target [m], sqrt(tr cov), over configurations and
/// targets; base and targets are estimated along with the geometry.
struct Prediction {
  ErrorStatistics sigma;
  /// [m] the largest, over configurations, of the RMS of sigma over the targets.
  double worst_configuration = 0.0;
};
/// One prediction for each information matrix (p x p). Infinite where a matrix is singular.
std::vector<Prediction> predicted(const Experiment& experiment, const std::vector<Eigen::MatrixXd>& informations,
                                  const Eigen::MatrixXd& joint_values, int threads = 0);
Prediction predicted(const Experiment& experiment, const Eigen::MatrixXd& information,
                     const Eigen::MatrixXd& joint_values, int threads = 0);

/// sigma sqrt(p / (T N)) [m] for T targets and N configurations: no design of N configurations has a smaller worst
/// configuration among its candidates (the general equivalence theorem, Kiefer and Wolfowitz 1960). Holds without
/// priors, and for noise that is independent and the same in all directions.
double floor_of_worst_configuration(const Experiment& experiment, int count);

/// Observability indices (see observability.hpp) of a plan in metres and radians, not whitened.
ObservabilityIndices observability_indices(const Experiment& experiment, const Eigen::MatrixXd& joint_values);

}  // namespace kdl_calibration
