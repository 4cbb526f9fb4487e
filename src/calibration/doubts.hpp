#pragma once

#include <string>
#include <vector>

#include "kdl_calibration/calibration.hpp"

namespace kdl_calibration {

/// [m] that the flange can be from the first joint at most: the lengths of the links and the ways of the slides.
double reach(const ErrorModel& model);

/// Why the finished calibration is not to be trusted; empty where it is. Gross rows and other readings stand in
/// `diagnosis`.
std::vector<Doubt> doubts(const Calibration& found, const Diagnosis& diagnosis, const Measurements& measurements,
                          ModelChoice model);

/// Whether the only doubt leaves the answer good where it was measured, see Diagnosis::reservation.
bool holds_where_measured(const Calibration& found, const std::vector<Doubt>& doubts, const std::string& ambiguity);

/// Findings that do not make the answer doubtful. The doubts stand in `diagnosis`.
std::vector<std::string> warnings(const Calibration& found, const Diagnosis& diagnosis,
                                  const Measurements& measurements, const std::string& ambiguity);

}  // namespace kdl_calibration
