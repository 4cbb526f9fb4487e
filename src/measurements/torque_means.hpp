#pragma once

// Not installed.

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "measurements/measurement_columns.hpp"
#include "measurements/measurement_row.hpp"

namespace kdl_calibration {

/// The torques that the rows of a file state, as means over the rows of each configuration.
class TorqueMeans {
public:
  void add(const Header& header, const Row& row, std::int32_t configuration);

  /// joints of the chain x configurations [Nm or N], NaN where none is stated; empty where the file has no such column.
  /// Behind a convention q = M c + o the same virtual work, tau_q = M^-T tau_c.
  Eigen::MatrixXd means(const Header& header, const ExpectedJoints& joints, std::size_t configurations) const;

private:
  std::vector<double> sums_;  // of each configuration the columns that the file has
  std::vector<int> counts_;
};

}  // namespace kdl_calibration
