#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "measurements/measurement_columns.hpp"
#include "measurements/measurement_row.hpp"

namespace kdl_calibration {

/// Mean torques of each configuration over its rows.
class TorqueMeans {
public:
  void add(const Header& header, const Row& row, std::int32_t configuration);

  /// Joints of the chain x configurations [Nm or N], NaN if not stated; empty without such columns. With a convention q
  /// = M c + o, tau_q = M^-T tau_c (equal virtual work).
  Eigen::MatrixXd means(const Header& header, const ExpectedJoints& joints, std::size_t configurations) const;

private:
  std::vector<double> sums_;  // per configuration, for the columns in the file
  std::vector<int> counts_;
};

}  // namespace kdl_calibration
