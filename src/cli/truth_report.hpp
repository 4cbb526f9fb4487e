#pragma once

#include <string>
#include <vector>

#include "cli/frames.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "planning/truth_comparison.hpp"
#include "planning/two_step_trial.hpp"

namespace kdl_calibration::cli {

/// The drawn values of a virtual robot: "parameters" (those with errors), "base", "targets", and "effects" if any.
Json drawn_json(const VirtualRobot& robot, const std::vector<std::size_t>& with_errors, const Reduction& reduction);

/// Comparison of an estimate with the truth: "parameters", "base", "targets", "largest_difference", "gauge_misfit",
/// "comparable". `truth`: as drawn.
Json truth_json(const ErrorModel& model, const Estimate& estimate, const Estimate& truth,
                const TruthComparison& comparison);
/// The same as a table, lengths in mm and angles in deg.
std::string truth_table(const ErrorModel& model, const Estimate& estimate, const TruthComparison& comparison);

/// The rounds of the published procedure against a virtual robot.
Json rounds_json(const TwoStepTrialResult& result);
std::string rounds_table(const TwoStepTrialResult& result);

}  // namespace kdl_calibration::cli
