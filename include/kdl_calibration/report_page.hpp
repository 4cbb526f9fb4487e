#pragma once

#include <string>
#include <string_view>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/registration.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

/// One self-contained HTML file that shows `data` in any browser and loads nothing. `data` is a JSON object whose
/// "kind" says which page it is: "calibration", "validation", "plan", "monte_carlo" or "two_step". It stands in the
/// page as it is, with `<` escaped, so that the page's reader can take the numbers out again. Throws InputError where
/// `data` is no JSON.
std::string report_page(std::string_view data);

/// Points that a page draws at most. Of more it has evenly spaced ones, and the largest residuals.
constexpr std::size_t kMostPointsOfPage = 3000;

/// The arm of a page's 3D view as JSON: its joints, the chain with the errors of `estimate`, base and targets, and the
/// boxes, cylinders and spheres of its links.
std::string reported_robot(const Robot& robot, const ErrorModel& model, const Estimate& estimate);

/// What was measured, as JSON: configurations, points with their residuals before (nominal robot, base and targets
/// registered) and after (`estimate`), their distribution, the measured joint ranges and region.
struct ReportedMeasurements {
  const ErrorModel& model;
  const Estimate& estimate;
  const Measurements& measurements;
  const Estimate* before = nullptr;  ///< none where there is nothing to compare with
};
std::string reported_measurements(const ReportedMeasurements& reported);

/// What the page of a calibration shows beside its result. Without a robot there is no picture, without measurements no
/// residuals before the calibration; the page says so.
struct CalibrationPage {
  std::string_view result;  ///< JSON, as result_json writes it
  std::string source;       ///< of the result, for messages
  const Robot* robot = nullptr;
  const Measurements* measurements = nullptr;  ///< those that were fitted; with a robot
  RegistrationOptions known;                   ///< frames that the calibration was given
  std::string plan_command;                    ///< that chooses what to measure next; empty: none is shown
};

/// Same input, same bytes. Throws InputError: a result that is none, or of another robot.
std::string calibration_page(const CalibrationPage& page);

}  // namespace kdl_calibration
