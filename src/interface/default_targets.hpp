#pragma once

#include <vector>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "estimation/input_check.hpp"
#include "kdl_calibration/error_model.hpp"
#include "model/parameters.hpp"
#include "planning/simulation.hpp"

namespace kdl_calibration {

/// Throws InputError if a name is there twice or a frame is none.
inline std::vector<TargetFrame> targets_or_published(const std::vector<TargetFrame>& targets) {
  for (const TargetFrame& target : targets) {
    if (find_target(targets, target.name) != &target) {
      refuse_input("target " + shown(target.name) + " is there twice", "each name once");
    }
    if (!is_rigid(target.X_FT)) {
      refuse_input("the frame of target " + shown(target.name), "a rotation and a translation, both finite");
    }
  }
  return targets.empty() ? published_targets() : targets;
}

}  // namespace kdl_calibration
