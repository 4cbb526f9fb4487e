#pragma once

#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "kdl_calibration/joint_convention.hpp"

namespace kdl_calibration {

/// Options of the table.
struct TableOptions {
  std::vector<std::string> written;             ///< names of the written files
  std::string fixed = "fixed";                  ///< text for a parameter that was not estimated
  const JointConvention* convention = nullptr;  ///< also shows joint offsets in controller values
  bool details = false;                         ///< also shows every parameter, effect, frame and statistic
};

/// The result as text: millimetres and degrees, gains in percent, at most 80 columns unless names are long. The verdict
/// comes first. An untrusted result shows its doubts and no parameters. Without details it has at most 40 lines for an
/// arm of six joints.
std::string result_table(const Measurements& measurements, const CalibrationResult& calibration,
                         const TableOptions& options = {});

/// Heading and row of a table of error statistics [mm]; 80 columns, for errors up to kilometres.
std::string statistics_heading(const std::string& label, const std::string& counted = "points");
std::string statistics_row(const std::string& label, const ErrorStatistics& statistics);

}  // namespace kdl_calibration
