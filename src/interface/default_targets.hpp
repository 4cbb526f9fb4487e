#pragma once

#include <string>
#include <vector>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "estimation/input_check.hpp"
#include "kdl_calibration/error_model.hpp"
#include "model/parameters.hpp"
#include "planning/simulation.hpp"

namespace kdl_calibration {

/// Throws InputError for too many targets, a name that is empty or there twice, and a frame that is none.
inline std::vector<TargetFrame> targets_or_published(const std::vector<TargetFrame>& targets) {
  if (targets.size() > kMostTargets) {
    refuse_input(std::to_string(targets.size()) + " targets", "at most " + std::to_string(kMostTargets));
  }
  for (const TargetFrame& target : targets) {
    if (target.name.empty()) {
      refuse_input("a target without a name", "a name for each");
    }
    if (find_target(targets, target.name) != &target) {
      refuse_input("target " + shown(target.name) + " is there twice", "each name once");
    }
    if (!is_rigid(target.X_FT)) {
      refuse_input("the frame of target " + shown(target.name),
                   "a rotation and a translation, finite and up to 1e12 m");
    }
  }
  return targets.empty() ? published_targets() : targets;
}

}  // namespace kdl_calibration
