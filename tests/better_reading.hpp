#pragma once

#include <algorithm>
#include <optional>
#include <vector>

#include "diagnosis/convention_trial.hpp"

namespace kdl_calibration::testing {

/// The best reading of the joint values if its RMS is below a fifth of that of the present reading.
inline std::optional<ConventionTrial> better_convention(const std::vector<ConventionTrial>& trials) {
  const auto present = std::find_if(trials.begin(), trials.end(), [](const auto& trial) { return trial.present; });
  const bool better = present != trials.begin() && present != trials.end() && trials.front().rms < 0.2 * present->rms;
  return better ? std::optional(trials.front()) : std::nullopt;
}

}  // namespace kdl_calibration::testing
