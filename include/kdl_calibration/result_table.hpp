#pragma once

#include <string>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/joint_convention.hpp"

namespace kdl_calibration {

/// What the caller knows beside the calibration.
struct TableOptions {
  std::vector<std::string> written;             ///< files that hold the answer
  std::string fixed = "fixed";                  ///< what is said of a parameter that was not to be estimated
  const JointConvention* convention = nullptr;  ///< joint offsets are shown as the controller counts as well
};

/// The result for people: millimetres and degrees, gains in percent, at most 80 columns where names are not longer than
/// usual. The verdict comes first; where the answer is not to be trusted, the causes and what was found, and no
/// parameters.
std::string result_table(const Measurements& measurements, const Calibration& calibration,
                         const TableOptions& options = {});

/// The line above rows of statistics, and one of these [mm]; 80 columns, for errors up to kilometres.
std::string statistics_heading(const std::string& label, const std::string& counted = "points");
std::string statistics_row(const std::string& label, const ErrorStatistics& statistics);

}  // namespace kdl_calibration
