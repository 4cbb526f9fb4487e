#pragma once

// Not installed.

#include <cstddef>
#include <string>
#include <vector>

#include "kdl_calibration/measurements.hpp"
#include "measurements/measurement_columns.hpp"

namespace kdl_calibration {

/// What a file held. Keeps references.
struct ReadValues {
  const Header& header;
  const std::string& source;
  const std::vector<double>& joint_values;  ///< configuration by configuration
  std::size_t columns;                      ///< values of each
  const std::vector<Observation>& observations;
};

/// Throws InputError where a column without a unit holds what no robot has in rad or m.
void check_missing_units(const ExpectedJoints& joints, const ReadValues& read);

}  // namespace kdl_calibration
