#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "kdl_calibration/least_squares.hpp"

namespace kdl_calibration {

/// Covariance of the columns (in their order) for a whitened Jacobian J: factor · (J^T J)^-1 by singular values of the
/// scaled triangular factor. Columns that the measurements do not determine get infinite variance; the others keep the
/// variance that they have whatever those are. `factor`: variance of unit weight, 1 where the noise is absolute.
Eigen::MatrixXd covariance(const Eigen::MatrixXd& whitened_jacobian, double factor);

/// Covariance of the predicted position in W of a target at joint values q: J C J^T, [m^2]. Free of the gauge: fixed
/// parameters and tied directions do not enter.
Eigen::Matrix3d predicted_covariance(const ErrorModel& model, const Estimate& estimate, const FreeParameters& free,
                                     const Eigen::MatrixXd& column_covariance, const Eigen::VectorXd& q,
                                     std::size_t target);

/// Directions of the columns that the measurements do not determine: columns x k. A prediction is determined where its
/// Jacobian has no part along them.
Eigen::MatrixXd undetermined_directions(const Eigen::MatrixXd& whitened_jacobian);

/// Radius [m] of the sphere about the mean that holds a normal error with this covariance with this probability.
double radius_of_probability(const Eigen::Matrix3d& covariance, double probability = 0.95);

/// Variance components of the training rows from their repeats (analysis of variance with targets of one repeat as
/// correlated measurements): per axis of W, `common` is the mean covariance of two targets of one repeat and
/// `independent` what is left of the variance. Where no configuration has two targets with repeats the two cannot be
/// told apart and all is counted as independent.
struct RepeatNoise {
  Eigen::Vector3d independent = Eigen::Vector3d::Zero();  ///< [m] 1 sigma
  Eigen::Vector3d common = Eigen::Vector3d::Zero();       ///< [m] 1 sigma
  Eigen::Vector3d total = Eigen::Vector3d::Zero();        ///< [m] 1 sigma
  double degrees_of_freedom = 0.0;                        ///< per axis; 0: there are no repeats
  bool separable = false;
  double orientation = 0.0;  ///< [rad] 1 sigma of a component of the measured orientations; 0 without repeats of them
  double orientation_degrees_of_freedom = 0.0;  ///< per component
};
RepeatNoise noise_from_repeats(const Measurements& measurements);

/// Lack of fit: the residuals of the means against the scatter of the repeats, both whitened with that scatter.
///   F = [cost of the means / (coordinates of the means - rank)] / 1
/// which follows the F distribution with these degrees of freedom and those of the scatter if geometry explains all
/// but noise (Draper and Smith, Applied Regression Analysis, lack of fit).
struct LackOfFit {
  double f = 0.0;
  double degrees_of_freedom = 0.0;         ///< of the numerator
  double repeat_degrees_of_freedom = 0.0;  ///< of the denominator
  double p_value = 1.0;                    ///< chance of an F as large if geometry explained everything
  /// Share of the residuals' variance that a function a + b sin q + c cos q of each joint would explain.
  std::vector<double> explained_by_joint;
};

/// P(F > f) of the F distribution with a and b degrees of freedom (regularised incomplete beta function by its
/// continued fraction, Abramowitz and Stegun 26.5.8 and 26.6.2).
double f_upper_tail(double f, double a, double b);

/// Residual vectors (measured mean minus predicted, in W) of every target of every training configuration, explained
/// by each joint: entry j is 1 - (residual sum of squares with a + b sin q_j + c cos q_j) / (total sum of squares).
std::vector<double> explained_by_joints(const ErrorModel& model, const Estimate& estimate,
                                        const Measurements& measurements);

/// Variance components of the residuals of a fit with equal weights, pooled over the axes: `common` is what the points
/// of one configuration share (drift, and what the model cannot explain), `independent` the rest. Both are scaled up
/// for the degrees of freedom that the fit has used.
struct ResidualNoise {
  double independent = 0.0;  ///< [m] 1 sigma of a coordinate
  double common = 0.0;       ///< [m] 1 sigma of a coordinate
  double degrees_of_freedom = 0.0;
  double total() const;
};
ResidualNoise noise_from_residuals(const WhitenedSummary& summary, int rank, double unit_weight);
ResidualNoise noise_from_residuals(const WhitenedSystem& system, int rank, double unit_weight);

/// Covariance of the columns for an equal-weight fit whose errors are correlated within each configuration:
///   A^-1 (sum J_c^T S_c J_c + priors) A^-1,  A = sum J_c^T J_c + priors,  S_c = independent^2 I + common^2 (ones ⊗ I).
/// The system must have been whitened by one sigma for all, `unit_weight` = 1 / sigma^2.
Eigen::MatrixXd covariance(const WhitenedSummary& summary, const ResidualNoise& noise, double unit_weight);
Eigen::MatrixXd covariance(const WhitenedSystem& system, const ResidualNoise& noise, double unit_weight);

/// What decides the fit. A point is one target in one configuration, the mean of its repeats.
///   leverage: sum over its coordinates of d(predicted)/d(measured), which is the diagonal of the hat matrix
///     H = J A^-1 J^T W, A = J^T W J + priors; where all points are independent that of the whitened one. Over all
///     points it adds up to the number of parameters p, less what priors decide. High: above twice the mean of as many
///     coordinates, 2 p / n each (Hoaglin and Welsch 1978).
///   Cook's distance: (x - x_without)^T A (x - x_without) / (p s^2), x_without the estimate without this point or
///     configuration (to first order), s^2 the residual mean square (Cook 1977; several rows at once: Cook and Weisberg
///     1980). Influential: above 4 / N of N points or configurations (Bollen and Jackman 1985). Infinite where the rest
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
};
struct Influence {
  std::vector<ConfigurationInfluence> configurations;  ///< the training ones, in their order
  double leverage_limit = 0.0;                         ///< per coordinate
  double cook_limit = 0.0;                             ///< of a configuration
  double point_cook_limit = 0.0;
};
/// `triangle`: of the whitened system at the estimate. Empty where that does not determine all columns.
Influence influence(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                    const FreeParameters& free, const ResidualOptions& residuals, const Eigen::MatrixXd& triangle);

/// Observability indices of a Jacobian with p columns, n configurations and singular values s1 >= … >= sp:
///   O1 = (s1 … sp)^(1/p) / sqrt(n)  (Borm and Menq 1991),  O2 = sp / s1,  O3 = sp,  O4 = sp^2 / s1,
///   O5 = 1 / (1/s1 + … + 1/sp)  (Driels and Pathre 1990; Nahvi et al. 1994; Nahvi and Hollerbach 1996; Sun and
/// Hollerbach 2008). Columns scaled to unit norm would hide what the indices compare, so the units stay.
struct ObservabilityIndices {
  double O1 = 0.0, O2 = 0.0, O3 = 0.0, O4 = 0.0, O5 = 0.0;
};
ObservabilityIndices observability_indices(const Eigen::MatrixXd& jacobian, Eigen::Index configurations);

}  // namespace kdl_calibration
