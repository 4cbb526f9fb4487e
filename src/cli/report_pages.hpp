#pragma once

#include <Eigen/Geometry>
#include <string>
#include <utility>
#include <vector>

#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "planning/monte_carlo.hpp"
#include "planning/planner.hpp"
#include "results/report_page.hpp"

namespace kdl_calibration::cli {

/// Settings of a run as pairs of label and text.
using PageFacts = std::vector<std::pair<std::string, std::string>>;

/// Adds the robot and the hashes of the files that were read.
Json with_files(Json result, const RobotArguments& arguments, const Robot& robot, const FileRoles& files);

/// Pages other than that of a calibration. `result` is the output of --json.
std::string monte_carlo_page(const Json& result, const MonteCarlo& experiment, const MonteCarloResult& runs,
                             const PageFacts& setup);
/// `other`: the rounds with the other kind of measurements, recorded or fresh.
std::string two_step_page(const Json& result, const Json& other, const PageFacts& setup);
/// Input of the page of a plan.
struct PlanPage {
  const PlanRequest& request;
  const Plan& plan;
  PageFacts setup;
  const JointConvention* convention = nullptr;             ///< of the joint values shown
  std::string frame = "base";                              ///< in which the places of the cell are stated
  Eigen::Isometry3d X_BW = Eigen::Isometry3d::Identity();  ///< its pose in the base frame
};
std::string plan_page(const Json& result, const PlanPage& page);

/// Input of the page of a robot validated by measurements.
struct ValidationPage {
  Json result;
  const Robot& robot;
  ReportedMeasurements reported;
  std::vector<std::string> warnings;
  Json requirements;                ///< as judged_json writes them
  std::vector<std::string> doubts;  ///< reasons not to trust it
};
std::string validation_page(const ValidationPage& page);

/// The page of a "comparison" or "compensation". `more`: what `result` does not hold.
std::string page_of_result(const char* kind, const Json& result, const Json& more);

}  // namespace kdl_calibration::cli
