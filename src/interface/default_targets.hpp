#pragma once

#include <vector>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "kdl_calibration/error_model.hpp"
#include "planning/simulation.hpp"

namespace kdl_calibration {

/// Throws InputError if a name is there twice.
inline std::vector<TargetFrame> targets_or_published(const std::vector<TargetFrame>& targets) {
  for (const TargetFrame& target : targets) {
    if (find_target(targets, target.name) != &target) {
      refuse_input("target " + shown(target.name) + " is there twice", "each name once");
    }
  }
  return targets.empty() ? published_targets() : targets;
}

}  // namespace kdl_calibration
