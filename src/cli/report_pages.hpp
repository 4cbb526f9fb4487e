#pragma once

#include <string>
#include <utility>
#include <vector>

#include "cli/frames.hpp"
#include "kdl_calibration/monte_carlo.hpp"
#include "kdl_calibration/planner.hpp"
#include "kdl_calibration/report_page.hpp"

namespace kdl_calibration::cli {

/// What was asked for, in words.
using PageFacts = std::vector<std::pair<std::string, std::string>>;

/// Pages beside that of a calibration. `result` is what --json prints.
std::string monte_carlo_page(const Json& result, const MonteCarlo& experiment, const MonteCarloResult& runs,
                             const PageFacts& setup);
/// `other` has the rounds of the other way to measure, recorded or fresh.
std::string two_step_page(const Json& result, const Json& other, const PageFacts& setup);
std::string plan_page(const Json& result, const PlanRequest& request, const Plan& plan, const PageFacts& setup);

/// A robot against measurements.
struct ValidationPage {
  Json result;
  const Robot& robot;
  ReportedMeasurements reported;
  std::vector<std::string> warnings;
  std::vector<std::string> requirements;  ///< as they were given
  std::vector<std::string> doubts;        ///< why it is not as it should be
};
std::string validation_page(const ValidationPage& page);

}  // namespace kdl_calibration::cli
