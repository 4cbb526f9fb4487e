#pragma once

// Not installed.

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/prediction.hpp"

namespace kdl_calibration {

/// The rows of each configuration by themselves.
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

/// Gives the systems of some configurations at a time. Safe to ask from several threads.
class ConfigurationSystems {
public:
  /// At the start of the fit, which must outlive this. `R`: upper triangular, of the information R^T R of the whole
  /// system.
  ConfigurationSystems(const FitProblem& fit, Eigen::MatrixXd R);

  /// So many together take a small part of the time that they take one by one.
  static constexpr std::size_t kTogether = 32;

  /// Of the configurations that have these rows.
  std::vector<ConfigurationSystem> of(const std::vector<std::vector<std::size_t>>& rows) const;

private:
  using Oriented = std::map<std::int32_t, bool>;  // of each target that was measured, whether its orientation was

  WhitenedSystem whitened(const std::vector<std::vector<std::size_t>>& rows, std::vector<Oriented>& oriented) const;
  std::vector<Eigen::Index> place_points(const Oriented& oriented, ConfigurationSystem& result) const;

  const ErrorModel& model_;
  const Measurements& measurements_;
  const ResidualOptions& residuals_;
  const Estimate& estimate_;
  Eigen::MatrixXd R_;
  Unknowns all_;
  std::vector<Eigen::Index> estimated_;  // columns of the estimated ones among all
};

}  // namespace kdl_calibration
