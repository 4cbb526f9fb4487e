#pragma once

// Not installed.

#include <Eigen/Core>
#include <cstdint>
#include <utility>
#include <vector>

#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/prediction.hpp"

namespace kdl_calibration {

/// The training rows of each configuration by themselves.
std::vector<std::pair<std::int32_t, std::vector<std::size_t>>> rows_by_configuration(const Measurements& measurements);

/// One configuration of the whitened system: B = J_c R^-1, e_c, and U of its information U^T U, whose columns are those
/// of its points' coordinates in the flange frame, so that U^-1 e_c are the residuals of its means in metres.
struct ConfigurationSystem {
  Eigen::MatrixXd B;
  Eigen::VectorXd e;
  Eigen::MatrixXd U;
  std::vector<std::int32_t> targets;
  std::vector<std::vector<Eigen::Index>> rows;  ///< of each point
};

/// Of the configuration whose training rows are `rows`. R: upper triangular, of the information R^T R of all columns.
ConfigurationSystem configuration_system(const ErrorModel& model, const Measurements& measurements,
                                         const std::vector<std::size_t>& rows, const Estimate& estimate,
                                         const Unknowns& free, const ResidualOptions& residuals,
                                         const Eigen::MatrixXd& R);

}  // namespace kdl_calibration
