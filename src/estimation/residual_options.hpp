#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

/// Independent part of a measured point's covariance, along the axes of W [m^2]; zero if none is stated.
Eigen::Matrix3d point_covariance(const NoiseModel& noise, const Observation& observation);

/// A normal prior of named errors and effects with their correlations, such as an earlier result.
struct GaussianPrior {
  std::vector<std::string> names;
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

/// [m] Orientations without sigma: an error of 1 rad counts as this position error.
constexpr double kOrientationLength = 0.3;

/// Weights and priors of the residuals.
struct ResidualOptions {
  Priors priors;
  std::shared_ptr<const GaussianPrior> earlier = {};  ///< instead of other priors of its errors and effects
  NoiseModel noise;
  std::vector<double> row_weights;  ///< factor on the information of each observation, 0 leaves it out; empty: all 1
  /// [m] for orientations without sigma: an error of 1 rad counts as this position error.
  double orientation_length = kOrientationLength;
  int threads = 1;  ///< of a pass over the data, 0: one per core; the result does not depend on it

  double row_weight(std::size_t row) const { return row_weights.empty() ? 1.0 : row_weights[row]; }
};

/// The priors of the columns as whitened rows, with the residuals expected - rows * values. Most have one entry.
struct PriorRows {
  Eigen::SparseMatrix<double> rows;
  Eigen::VectorXd expected;

  Eigen::SparseMatrix<double> information() const { return rows.transpose() * rows; }
  Eigen::VectorXd residuals(const Eigen::VectorXd& values) const { return expected - rows * values; }
};
/// Columns that are not free in `free` are integrated out of the earlier result.
PriorRows prior_rows(const Unknowns& free, const ResidualOptions& options);

/// Information of a point's coordinate under isotropic noise [1/m^2], without the row weight; 1 if no noise is stated.
double position_information(const ResidualOptions& options, const Observation& observation);
/// Information of an orientation component [1/rad^2], given that of its position, which includes the row's factor.
double orientation_information(const ResidualOptions& options, double position_information,
                               const NoiseFactors& factors = {});

}  // namespace kdl_calibration
