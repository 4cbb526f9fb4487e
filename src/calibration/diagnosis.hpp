#pragma once

#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "calibration/calibration_settings.hpp"

namespace kdl_calibration {

/// Results of earlier stages for the diagnosis. Keeps references.
struct DiagnosisTask {
  const DiagnosisOptions& options;
  const ParameterOptions& parameters;
  const std::string& ambiguity;        ///< of the registration
  const std::vector<Remark>& remarks;  ///< of the validation
  int threads = 0;
  ProgressFunction progress = {};
};

/// Other readings of the data, doubts and remarks, from `found` (without diagnosis), the findings of the screening and
/// the gross rows.
Diagnosis diagnose(const CalibrationResult& found, const Measurements& measurements,
                   std::vector<QualityFinding> findings, GrossRows gross_rows, const DiagnosisTask& task);

}  // namespace kdl_calibration
