#pragma once

#include <string>
#include <vector>

#include "kdl_calibration/calibration.hpp"

namespace kdl_calibration {

/// [m] that the flange can be from the first joint at most: the lengths of the links and the ways of the slides.
double reach(const ErrorModel& model);

/// Why the finished calibration is not to be trusted; empty where it is.
std::vector<Doubt> doubts(const Calibration& found, const Measurements& measurements,
                          const CalibrationOptions& options);

/// Whether the one doubt that there is leaves the answer good where it was measured, see Calibration::reservation.
bool holds_where_measured(const Calibration& found, const std::string& ambiguity);

/// What is worth knowing of it beside that.
std::vector<std::string> warnings(const Calibration& found, const Measurements& measurements,
                                  const std::string& ambiguity);

/// Whether the calibrated robot predicts what was not fitted no better than the nominal one.
bool is_no_help(const Calibration& found);

}  // namespace kdl_calibration
