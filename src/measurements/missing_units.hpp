#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>

#include "measurements/measurement_columns.hpp"

namespace kdl_calibration {

/// Values read from a file. Keeps references.
struct ReadValues {
  const Header& header;
  const std::string& source;
  Eigen::Ref<const Eigen::MatrixXd> joint_values;  ///< joint_columns() x configurations
  Eigen::AlignedBox3d points;
  double largest_distance = 0.0;
};

/// Throws InputError if a column without unit has values that are implausible in rad or m.
void check_missing_units(const ExpectedJoints& joints, const ReadValues& read);

}  // namespace kdl_calibration
