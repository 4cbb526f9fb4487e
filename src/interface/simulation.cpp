#include "kdl_calibration/simulation.hpp"

#include <memory>
#include <string>
#include <utility>

#include "base/preconditions.hpp"
#include "calibration/point_predictor.hpp"
#include "interface/default_targets.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration {

SimulatedExperiment simulate(const Robot& robot, const SimulationOptions& options) {
  require_at_least("configurations", options.configurations, 1);
  require_at_least("test configurations", options.test_configurations, 0);
  require_at_least("repeats", options.repeats, 1);
  if ((1.0 * options.configurations + options.test_configurations) * options.repeats > kMostSimulatedRows) {
    refuse_input("more than " + std::to_string(kMostSimulatedRows) + " rows", "fewer configurations or repeats");
  }
  require_sigma("noise", options.noise);
  require_sigma("the size of length errors", options.length_error);
  require_sigma("the size of angle errors", options.angle_error);
  const ErrorModel model = complete_model(robot);
  const std::vector<TargetFrame> targets = targets_or_published(options.targets);
  const JointRanges ranges = options.ranges.empty() ? limits_of(model.joints) : options.ranges;
  require_count("joint ranges", ranges.size(), model.joints.size());
  const Reduction reduction = reduced_model(model, targets);
  Random random(options.seed);
  const VirtualRobot virtual_one =
      virtual_robot(model, with_true_errors(model, reduction, false), targets,
                    {.length = options.length_error, .angle = options.angle_error}, random);
  const MeasuringNoise noise{.sigma = options.noise, .repeats = options.repeats};
  const auto measured = [&](int count, Split split) {
    return measure(virtual_one, random_configurations(model.joints, ranges, count, random), noise, random, split);
  };
  Measurements measurements = measured(options.configurations, Split::train);
  if (options.test_configurations > 0) {
    measurements = joined(measurements, measured(options.test_configurations, Split::test));
  }
  auto truth = std::make_shared<PredictionBasis>(
      PredictionBasis{.model = virtual_one.model, .estimate = virtual_one.truth, .region = {.joints = ranges}});
  truth->covariance.resize(0, 0);
  return {.measurements = std::move(measurements), .truth = CalibratedArm(std::move(truth))};
}

}  // namespace kdl_calibration
