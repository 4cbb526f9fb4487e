#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "estimation/registration.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/doubt.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// A self-contained HTML file that shows `data` in any browser and loads no other file. `data` is a JSON object whose
/// "kind" says which page it is: "calibration", "validation", "comparison", "compensation", "plan", "monte_carlo" or
/// "two_step". The page contains it unchanged except for escaped `<`, so that programs can extract it. Throws
/// InputError if `data` is not JSON.
std::string report_page(std::string_view data);

/// Most points on a page. Of more points, evenly spaced ones and the largest residuals are shown.
constexpr std::size_t kMostPointsOfPage = 3000;

/// The arm of a page's 3D view as JSON: its joints, the chain with the errors of `estimate`, base and targets, and the
/// boxes, cylinders and spheres of its links.
std::string reported_robot(const Robot& robot, const ErrorModel& model, const Estimate& estimate);

/// The joints that people know, as JSON: "joints" and their "values" at each configuration (column of `q`), the
/// controller's.
std::string reported_joints(const ErrorModel& model, const Eigen::MatrixXd& q, const JointConvention& convention);

/// The measurements as JSON: configurations, points with their residuals before (nominal robot, base and targets
/// registered) and after (`estimate`), their distribution, the measured joint ranges and region. With a convention the
/// configurations also have the controller's joint values, and the ranges are the controller's.
struct ReportedMeasurements {
  const ErrorModel& model;
  const Estimate& estimate;
  const Measurements& measurements;
  const Estimate* before = nullptr;                          ///< null: no comparison
  std::optional<JointConvention> convention = std::nullopt;  ///< none: joint values are shown as in the URDF
  /// The controller's world in the base, in which places are shown; none: they are shown in the base.
  std::optional<Eigen::Isometry3d> X_BK = std::nullopt;
};
std::string reported_measurements(const ReportedMeasurements& reported);

/// Input of a calibration's page. Without a robot it has no 3D view, without measurements no residuals before the
/// calibration; the page says so.
struct CalibrationPage {
  std::string_view result;  ///< JSON, as result_json writes it
  std::string source;       ///< name of the result, for messages
  const Robot* robot = nullptr;
  const Measurements* measurements = nullptr;  ///< the fitted ones; requires `robot`
  KnownFrames known;                           ///< of the calibration
  std::optional<JointConvention> convention = std::nullopt;
  std::optional<Eigen::Isometry3d> X_BK = std::nullopt;  ///< the controller's world, see ReportedMeasurements
  std::string plan_command;                              ///< command that plans the next measurements; empty: not shown
  std::string paper = {};                                ///< size of the printed page in CSS; empty: the printer's
  std::string apply_command = {};                        ///< command after the mastering was entered; empty: not shown
  std::map<Cause, std::string> cures = {};               ///< what helps against doubts, beside their messages
  std::vector<OwnEffect> own = {};                       ///< functions of the result that are not kdlcal's
};

/// Equal input gives equal bytes. Throws InputError for an invalid result or one of another robot.
std::string calibration_page(const CalibrationPage& page);

}  // namespace kdl_calibration
