#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "estimation/least_squares.hpp"
#include "estimation/residual_options.hpp"
#include "estimation/unknowns.hpp"

namespace kdl_calibration {

/// Influence of points and configurations on the fit. A point is one target in one configuration, the mean of its
/// repeats.
///   leverage: sum over its coordinates of d(predicted)/d(measured), which is the diagonal of the hat matrix
///     H = J A^-1 J^T W, A = J^T W J + priors; if all points are independent, that of the whitened one. It sums to the
///     number of parameters p, less the share determined by priors. High: above twice the mean, 2 p / n per coordinate
///     (Hoaglin and Welsch 1978).
///   Cook's distance: (x - x_without)^T A (x - x_without) / (p s^2), x_without the estimate without this point or
///     configuration (to first order), s^2 the residual mean square (Cook 1977; several rows at once: Cook and Weisberg
///     1980). Influential: above 4 / N of N points or configurations (Bollen and Jackman 1985). Infinite if the rest
///     does not determine all parameters.
struct PointInfluence {
  std::int32_t target = 0;
  int coordinates = 0;  ///< 3, or 6 with its orientation
  double leverage = 0.0;
  double cook = 0.0;
  bool high_leverage = false;
  bool influential = false;
};
struct ConfigurationInfluence {
  std::int32_t configuration = 0;
  int coordinates = 0;
  double leverage = 0.0;
  double cook = 0.0;
  bool high_leverage = false;
  bool influential = false;
  std::vector<PointInfluence> points;
  /// How far its residuals move the estimate, in the order of the unknowns. They are divided by the root of what the
  /// fit leaves of them (CR2, Bell and McCaffrey 2002). So the outer products of all add up to the covariance of the
  /// estimate without bias if the noise is white, and hold for a misfit that is not.
  Eigen::VectorXd shift;
};
struct Influence {
  std::vector<ConfigurationInfluence> configurations;  ///< the training ones, in their order
  double leverage_limit = 0.0;                         ///< per coordinate
  double cook_limit = 0.0;                             ///< of a configuration
  double point_cook_limit = 0.0;
};
/// `problem` must be built from these measurements and residuals; `sqrt_information` belongs to its whitened system at
/// the estimate. Empty if that does not determine all columns.
Influence influence(const LeastSquaresProblem& problem, const Measurements& measurements,
                    const ResidualOptions& residuals, const Estimate& estimate,
                    const Eigen::MatrixXd& sqrt_information);

}  // namespace kdl_calibration
