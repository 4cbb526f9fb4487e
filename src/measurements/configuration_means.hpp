#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "measurements/measurement_columns.hpp"
#include "measurements/measurement_row.hpp"

namespace kdl_calibration {

/// Means of optional columns over the rows of each configuration.
class ConfigurationMeans {
public:
  explicit ConfigurationMeans(std::span<const Column> columns);

  void add(const Row& row, std::int32_t configuration);
  /// Columns x configurations, NaN where no row states the value; empty if the file has none of the columns.
  Eigen::MatrixXd means(std::size_t configurations) const;

private:
  std::vector<Column> columns_;  // none if the file has none of them
  std::vector<double> sums_;     // per configuration, for the columns
  std::vector<int> counts_;
};

/// Torques of the joints of the chain (joints x configurations) from those of the file's joints. With a convention q =
/// M c + o, tau_q = M^-T tau_c (equal virtual work).
Eigen::MatrixXd joint_torques(const Eigen::MatrixXd& stated, const ExpectedJoints& joints);

}  // namespace kdl_calibration
