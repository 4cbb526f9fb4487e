#pragma once

// The groups of effects that may be added to a model.

#include <Eigen/Core>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "measurements/drive_signals.hpp"
#include "selection/model_selection.hpp"

namespace kdl_calibration {

/// A group of effects with its terms.
struct EffectOption {
  std::string name;
  std::vector<EffectTerm> terms;
};

/// Configurations that a group needs to be tried.
constexpr Eigen::Index kLeastForRipple = 100;
constexpr Eigen::Index kLeastForTables = 50;

/// The groups besides ripple that `configurations` suffice for, in the order of EffectGroup. Those of circumstances
/// only where the signals state them.
std::vector<EffectGroup> groups_allowed(Eigen::Index configurations, const DriveSignals& signals);
/// The groups that they do not suffice for, by the number that they need.
std::vector<NotTried> groups_not_allowed(Eigen::Index configurations, const DriveSignals& signals);

}  // namespace kdl_calibration
