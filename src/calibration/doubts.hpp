#pragma once

#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"

namespace kdl_calibration {

/// Reasons not to trust the finished calibration. Gross rows and other readings are taken from `diagnosis`.
std::vector<Doubt> doubts(const CalibrationResult& found, const Diagnosis& diagnosis, const Measurements& measurements,
                          ModelChoice model);

/// Whether the result holds in the measured region despite its only doubt, see Diagnosis::reservation.
bool holds_where_measured(const CalibrationResult& found, const std::vector<Doubt>& doubts,
                          const std::string& ambiguity);

/// Findings that do not make the result doubtful. The doubts are taken from `diagnosis`.
std::vector<Remark> remarks(const CalibrationResult& found, const Diagnosis& diagnosis,
                            const Measurements& measurements, const std::string& ambiguity);

}  // namespace kdl_calibration
