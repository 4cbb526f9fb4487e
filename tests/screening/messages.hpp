#pragma once

#include <string>
#include <vector>

#include "screening/data_quality.hpp"

namespace kdl_calibration::testing {

inline std::vector<std::string> messages(const std::vector<QualityFinding>& findings) {
  std::vector<std::string> result;
  for (const QualityFinding& finding : findings) {
    result.push_back(finding.message);
  }
  return result;
}

}  // namespace kdl_calibration::testing
