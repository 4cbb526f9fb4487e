#include "kdl_calibration/measuring_plan.hpp"

#include <string>
#include <utility>

#include "base/number_range.hpp"
#include "base/number_text.hpp"
#include "base/preconditions.hpp"
#include "interface/calibration_parts.hpp"
#include "interface/default_targets.hpp"
#include "kdl_calibration/input_error.hpp"
#include "planning/planner.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration {

MeasuringPlan plan_measurements(const Robot& robot, const PlanOptions& options) {
  const int count = options.count.value_or(options.after != nullptr ? kConfigurationsAfter : kConfigurationsToPlan);
  require_at_least("configurations", count, 1);
  if (count > kMostPlanned) {
    refuse_input(std::to_string(count) + " configurations", "at most " + std::to_string(kMostPlanned));
  }
  if (!(options.noise >= kSmallestSigma && options.noise <= kLargestNumber)) {
    refuse_input("a noise of " + shortest(options.noise) + " m", "one from 1e-15 to 1e12 m");
  }
  complete_model(robot);  // throws for an empty robot
  PlanRequest request{.robot = robot,
                      .targets = targets_or_published(options.targets),
                      .cell = {.ranges = options.ranges.empty() ? limits_of(robot.joints) : options.ranges,
                               .height = options.least_height,
                               .radius = options.least_radius},
                      .noise = {.sigma = options.noise},
                      .count = count,
                      .seed = options.seed,
                      .choosing = options.progress};
  if (options.after != nullptr) {
    require_same_robot(robot, *options.after);
    request.calibrated = options.after->parts();
    request.suspects = options.suspect;
    const std::vector<TargetFrame>& known = request.calibrated->estimate.frames.targets;
    request.targets = options.targets.empty() && !known.empty() ? known : request.targets;
  } else if (!options.suspect.empty()) {
    throw OptionError("suspect", "nothing is known from before, expected a calibration (after) beside it");
  }
  Plan plan = make_plan(request);
  plan.sheet.predicted_mean = plan.planned.sigma.mean;
  plan.sheet.predicted_max = plan.planned.sigma.max;
  return std::move(plan.sheet);
}

}  // namespace kdl_calibration
