#pragma once

#include <CLI/App.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/frames.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "planning/workspace.hpp"

namespace kdl_calibration::cli {

/// Options of the cell: --joint-range, --box, --least-height, --least-radius, --keep-out-sphere, --keep-out-box,
/// --clearance, --arm-radius, --tool-radius, --tracker, --distance-range, --acceptance-angle
struct CellArguments {
  std::vector<std::string> joint_ranges;
  std::string box;
  std::optional<double> least_height;
  std::optional<double> least_radius;
  std::vector<std::string> out_spheres;
  std::vector<std::string> out_boxes;
  std::optional<double> clearance;
  std::optional<double> arm_radius;
  double tool_radius = 0.0;
  std::string tracker;
  std::string distance_range;
  std::optional<double> acceptance_deg;
};
void add_cell_options(CLI::App& app, CellArguments& arguments);

/// The targets of a file (see read_targets) and the facing direction of each ("facing": [x, y, z] in the flange frame),
/// zero if none is stated.
struct FacingTargets {
  std::vector<TargetFrame> targets;
  std::vector<Eigen::Vector3d> facing;
};
FacingTargets facing_targets_of(const Json& json, const std::string& source);
FacingTargets read_facing_targets(const std::string& file);

/// The cell. Warns of links without a shape if a constraint needs shapes.
Cell cell(const CellArguments& arguments, const Robot& robot, const ErrorModel& model, const FacingTargets& targets,
          const JointConvention* convention);

/// Parses "1,2,3" as `count` numbers.
std::vector<double> numbers(const std::string& option, const std::string& text, std::size_t count,
                            const std::string& expected);

}  // namespace kdl_calibration::cli
