#include "calibration/signal_check.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;

// Of every joint of which some measured configuration has one.
void require_torques(const Measurements& measurements, const DriveSignals& signals,
                     const std::vector<std::string>& configurations) {
  for (Index j = 0; j < measurements.joint_values.rows(); ++j) {
    if (!has_torques(measurements.signals, j)) {
      continue;
    }
    for (std::size_t c = 0; c < configurations.size(); ++c) {
      if (signals.torques.size() > 0 && !std::isnan(signals.torques(j, static_cast<Index>(c)))) {
        continue;
      }
      const std::string joint = measurements.joints.empty() ? "joint number " + std::to_string(j + 1)
                                                            : measurements.joints[static_cast<std::size_t>(j)];
      throw InputError(measurements.source + ": configuration " + shown(configurations[c]) + " has no torque of " +
                       joint + ", expected one in each that is measured or predicted for the effect torque");
    }
  }
}

}  // namespace

void require_signals(const Measurements& measurements, const CalibrationOptions& options) {
  const Configurations& asked = options.predict_at;
  if (const std::string fault = fault_of(asked.signals, asked.joint_values, " to predict at"); !fault.empty()) {
    throw InputError(fault);
  }
  const std::vector<EffectGroup>& groups = options.effects.groups;
  if (std::find(groups.begin(), groups.end(), EffectGroup::torque) == groups.end()) {
    return;
  }
  if (measurements.signals.torques.array().isNaN().all()) {  // or there are none
    throw OptionError("effects", "torque needs measured torques, expected columns tau_<joint> in the measurements");
  }
  require_torques(measurements, measurements.signals, measurements.configurations);
  require_torques(measurements, asked.signals, asked.names);
}

}  // namespace kdl_calibration
