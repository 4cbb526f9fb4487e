#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "estimation/identification.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/accuracy.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

ErrorStatistics error_statistics(std::vector<double> distances);

/// Subset of the observations.
enum class Rows { all, train, test };

/// 3D distance between measured and predicted point of each observation, in the order of the file; of single
/// coordinates the distance along their directions.
std::vector<double> position_errors(const ErrorModel& model, const Estimate& estimate, const Measurements& measurements,
                                    Rows rows = Rows::all);
/// The same for given flange poses, one per configuration.
std::vector<double> position_errors(const std::vector<Eigen::Isometry3d>& X_BF, const Estimate& estimate,
                                    const Measurements& measurements, Rows rows = Rows::all);

/// The geometry of the estimate with base and targets registered again to the training rows: the best fit of this
/// geometry.
Estimate registered(const ErrorModel& model, const Eigen::VectorXd& errors, const Measurements& measurements,
                    const RegistrationOptions& options = {});

Iso9283 iso_9283(const ErrorModel& model, const Estimate& estimate, const Measurements& measurements,
                 Rows rows = Rows::train);
Iso9283 iso_9283(const std::vector<Eigen::Isometry3d>& X_BF, const Estimate& estimate, const Measurements& measurements,
                 Rows rows = Rows::train);

/// Prediction of training configurations left out of the fit. A fit that does not converge counts with its predictions.
struct HoldOut {
  /// [m] 3D distance between prediction and the mean of the repeats, one for each target of a left-out configuration:
  /// the accuracy of ISO 9283, without repeatability.
  std::vector<double> distances;
  int refits = 0;
  int not_converged = 0;
};

/// The training configurations in `folds` groups, assigned at random from the seed whatever their order; one
/// configuration per group if `folds` is 0 or at least their number. Neighbours (first_of_neighbours) stay in one
/// group. A configuration without which its station would not determine the base is in no group.
std::vector<std::vector<Eigen::Index>> make_folds(const Measurements& measurements, int folds, std::uint64_t seed = 1);

/// The folds and, as a last one, the training configurations that are in none of them, if there are any.
std::vector<std::vector<Eigen::Index>> folds_with_rest(std::vector<std::vector<Eigen::Index>> folds,
                                                       const Measurements& measurements);

/// Whether, without any one fold, the training rows have at least as many equations as there are unknowns, and each
/// station determines its base as before.
bool can_be_left_out(const Measurements& measurements, const std::vector<std::vector<Eigen::Index>>& folds,
                     Eigen::Index unknowns);

/// Exact refits from the start without each fold in turn, on `threads` threads (0: all). The result does not depend on
/// it.
HoldOut cross_validate(const FitProblem& problem, const std::vector<std::vector<Eigen::Index>>& folds, int threads = 0);
/// Largest difference between our flange pose and that of KDL::ChainFkSolverPos_recursive on the chain with error
/// segments, over the columns of `joint_values`, or 1,000 of them evenly spaced where there are more [m, or elements of
/// the rotation matrix].
double difference_to_kdl(const ErrorModel& model, const Eigen::VectorXd& errors, const Eigen::MatrixXd& joint_values);

}  // namespace kdl_calibration
