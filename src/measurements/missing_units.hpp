#pragma once

// Not installed.

#include <cstddef>
#include <string>
#include <vector>

#include "kdl_calibration/measurements.hpp"
#include "measurements/measurement_columns.hpp"

namespace kdl_calibration {

/// Values read from a file. Keeps references.
struct ReadValues {
  const Header& header;
  const std::string& source;
  const std::vector<double>& joint_values;  ///< configuration by configuration
  std::size_t columns;                      ///< values per configuration
  const std::vector<Observation>& observations;
};

/// Throws InputError if a column without unit has values that are implausible in rad or m.
void check_missing_units(const ExpectedJoints& joints, const ReadValues& read);

}  // namespace kdl_calibration
