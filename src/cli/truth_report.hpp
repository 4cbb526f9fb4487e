#pragma once

#include <string>

#include "cli/frames.hpp"
#include "kdl_calibration/truth_comparison.hpp"
#include "kdl_calibration/two_step_trial.hpp"

namespace kdl_calibration::cli {

/// {"count", "mean", "rms", "p95", "max", "std"}; null where nothing was counted.
Json statistics_json(const ErrorStatistics& statistics);

/// An estimate beside the truth: "parameters", "base", "targets", "largest_difference", "gauge_misfit", "comparable".
/// `truth` is as it was drawn.
Json truth_json(const ErrorModel& model, const Estimate& estimate, const Estimate& truth,
                const TruthComparison& comparison);
/// The same as a table, lengths in mm and angles in deg.
std::string truth_table(const ErrorModel& model, const Estimate& estimate, const TruthComparison& comparison);

/// The rounds of the published procedure against a virtual robot.
Json rounds_json(const TwoStepTrialResult& result);
std::string rounds_table(const TwoStepTrialResult& result);

}  // namespace kdl_calibration::cli
