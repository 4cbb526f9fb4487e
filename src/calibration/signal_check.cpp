#include "calibration/signal_check.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Joints of which some configurations have a torque.
std::vector<Index> joints_with(const MatrixXd& torques) {
  std::vector<Index> result;
  for (Index j = 0; j < torques.rows(); ++j) {
    if (!torques.row(j).array().isNaN().all()) {
      result.push_back(j);
    }
  }
  return result;
}

void require_torques_of(const std::vector<Index>& joints, const MatrixXd& torques, const Measurements& measurements,
                        const std::vector<std::string>& configurations) {
  for (const Index j : joints) {
    for (std::size_t c = 0; c < configurations.size(); ++c) {
      if (torques.size() > 0 && !std::isnan(torques(j, static_cast<Index>(c)))) {
        continue;
      }
      const std::string joint = measurements.joints.empty() ? "joint number " + std::to_string(j + 1)
                                                            : measurements.joints[static_cast<std::size_t>(j)];
      throw InputError(measurements.source + ": configuration " + shown(configurations[c]) + " has no torque of " +
                       joint + ", expected one in each that is measured or predicted for the effect torque");
    }
  }
}

void require_size(const char* what, const MatrixXd& signals, const MatrixXd& joint_values) {
  if (signals.size() > 0) {
    require_count(what, signals.rows(), joint_values.rows());
    require_count(what, signals.cols(), joint_values.cols());
  }
}

}  // namespace

void require_signals(const Measurements& measurements, const CalibrationOptions& options) {
  const Configurations& asked = options.predict_at;
  require_size("directions of approach to predict at", asked.signals.approach, asked.joint_values);
  require_size("torques to predict at", asked.signals.torques, asked.joint_values);
  const std::vector<EffectGroup>& groups = options.effects.groups;
  if (std::find(groups.begin(), groups.end(), EffectGroup::torque) == groups.end()) {
    return;
  }
  const std::vector<Index> joints = joints_with(measurements.signals.torques);
  if (joints.empty()) {
    throw OptionError("effects", "torque needs measured torques, expected columns tau_<joint> in the measurements");
  }
  require_torques_of(joints, measurements.signals.torques, measurements, measurements.configurations);
  require_torques_of(joints, asked.signals.torques, measurements, asked.names);
}

}  // namespace kdl_calibration
