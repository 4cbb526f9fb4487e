#pragma once

#include <Eigen/Dense>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "base/decompositions.hpp"
#include "estimation/identification.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/prediction.hpp"
#include "estimation/residual_options.hpp"

namespace kdl_calibration {

/// Indices of the observations of each configuration.
std::vector<std::pair<std::int32_t, std::vector<std::size_t>>> rows_by_configuration(const Measurements& measurements);

/// One configuration of the whitened system: B = J_c R^-1, e_c and U of its information U^T U. The columns of U are its
/// points' coordinates in the flange frame, so that U^-1 e_c are the residuals of its means in metres. U^-1 is the
/// pseudo-inverse if single coordinates were measured.
struct ConfigurationSystem {
  Eigen::MatrixXd B;
  Eigen::VectorXd e;
  Eigen::MatrixXd U;
  std::vector<std::int32_t> targets;
  std::vector<std::vector<Eigen::Index>> rows;  ///< of each point among the columns of U

  /// U^-1 whitened, column by column.
  Eigen::MatrixXd in_metres(const Eigen::MatrixXd& whitened) const {
    return U.rows() == U.cols() ? solution(U, whitened) : shortest_solution(U, whitened);
  }
};

/// Computes the systems of several configurations at a time. Thread-safe.
class ConfigurationSystems {
public:
  /// Linearised at the start of the fit, which must outlive this object. `R`: upper triangular, with R^T R the
  /// information of the whole system.
  ConfigurationSystems(const FitProblem& fit, const Eigen::MatrixXd& R);

  /// Batch size: a batch is much faster than single configurations.
  static constexpr std::size_t kTogether = 32;

  /// The systems of the configurations with these rows.
  std::vector<ConfigurationSystem> of(const std::vector<std::vector<std::size_t>>& rows) const;

private:
  using Oriented = std::map<std::int32_t, bool>;  // for each measured target, whether with orientation

  WhitenedSystem whitened(const std::vector<std::vector<std::size_t>>& rows, std::vector<Oriented>& oriented) const;
  std::vector<Eigen::Index> place_points(const Oriented& oriented, ConfigurationSystem& result) const;

  const ErrorModel& model_;
  const Measurements& measurements_;
  const ResidualOptions& residuals_;
  const Estimate& estimate_;
  Eigen::MatrixXd transposed_;
  Unknowns all_;
  std::vector<Eigen::Index> estimated_;  // columns of the estimated unknowns among all
};

}  // namespace kdl_calibration
