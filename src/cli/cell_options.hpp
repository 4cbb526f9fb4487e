#pragma once

#include <CLI/App.hpp>
#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "cli/frames.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "planning/workspace.hpp"

namespace kdl_calibration::cli {

/// Options of the cell: --frame, --joint-range, --box, --least-height, --least-radius, --keep-out-sphere,
/// --keep-out-box,
/// --clearance, --arm-radius, --tool-radius, --tracker, --distance-range, --acceptance-angle
struct CellArguments {
  std::string frame;  ///< base or world, in which the others are stated; empty: world with a joint convention
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

/// The cell in the base frame. Warns of links without a shape if a constraint needs shapes. `X_BW`: the frame in which
/// places are stated. Throws InputError if it is turned against the base by other than right angles: boxes would be
/// too.
Cell cell(const CellArguments& arguments, const Robot& robot, const FacingTargets& targets,
          const JointConvention* convention, const Eigen::Isometry3d& X_BW = Eigen::Isometry3d::Identity());

/// Whether boxes, spheres, a height or a tracker are stated.
bool has_places(const CellArguments& arguments);

/// The frame in which they are stated, and the boxes in the base frame: lines of text, empty for a cell without places.
std::string places_text(const CellArguments& arguments, const Cell& cell, const std::string& base,
                        const Eigen::Isometry3d& X_BW);

/// Parses "lower:upper" from this place of the text on, either of which may be omitted.
std::pair<double, double> bounds(const std::string& option, const std::string& text, const std::string& expected,
                                 std::size_t start = 0);

/// Parses "1,2,3" as `count` numbers.
std::vector<double> numbers(const std::string& option, const std::string& text, std::size_t count,
                            const std::string& expected);

}  // namespace kdl_calibration::cli
