#pragma once

#include <string>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/calibration_options.hpp"

namespace kdl_calibration {

/// What is known beside the calibration and the measurements. Keeps references.
struct DiagnosisTask {
  const DiagnosisOptions& options;
  const ParameterOptions& parameters;
  const std::string& ambiguity;  ///< of the registration
  int threads = 0;
  ProgressFunction progress = {};
};

/// Other readings of the data, doubts and warnings, from all that the other stages found: `found` but for its
/// diagnosis, the findings of the screening and the gross rows. `warnings`: of the validation.
Diagnosis diagnose(const Calibration& found, const Measurements& measurements, std::vector<QualityFinding> findings,
                   GrossRows gross_rows, const std::vector<std::string>& warnings, const DiagnosisTask& task);

}  // namespace kdl_calibration
