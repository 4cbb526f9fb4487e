#pragma once

// What the measurements take as true and no residual shows, in the covariance: consider covariance of Schmidt (1966),
// Tapley, Schutz and Born (Statistical orbit determination, 2004, chapter 6).

#include <Eigen/Core>

#include "estimation/identification.hpp"

namespace kdl_calibration {

/// 1 sigma of each.
struct AssumedSigmas {
  double scale = 0.0;   ///< [m/m] of all measured lengths, about the middle of each station's points
  double length = 0.0;  ///< [m] of the distance between two stated places, or of a stated distance
  double zero = 0.0;    ///< [m] of the instrument that measures distances
};

/// By how much the estimate moves if what it takes as true is off by one sigma, one column for each independent error:
/// the columns of `fit.free` x errors. With K = (J^T J)^-1 J^T they are K C sigma, and add K C C^T K^T sigma^2 to the
/// covariance. `unit_covariance` is (J^T J)^-1 at the start of the fit. Places are stated if the same coordinates stand
/// in rows of several configurations, as those of a ball in sockets; distances likewise.
Eigen::MatrixXd considered_steps(const FitProblem& fit, const Eigen::MatrixXd& unit_covariance,
                                 const AssumedSigmas& sigmas);

}  // namespace kdl_calibration
