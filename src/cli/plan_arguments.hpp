#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "cli/cell_options.hpp"
#include "cli/measurement_options.hpp"
#include "cli/options.hpp"
#include "cli/simulated_places.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "planning/planner.hpp"

namespace kdl_calibration::cli {

struct PlanArguments {
  RobotArguments robot;
  CellArguments cell;
  std::string joint_convention;
  std::optional<int> configurations;
  std::optional<int> add;
  std::optional<double> accuracy_mm;
  std::string accuracy_of = "mean";
  MeasurementArguments measured;
  std::string result;
  std::string after;
  std::vector<std::string> suspects;
  int candidates = 5000;
  int workspace = 5000;
  std::string tasks;
  int targets = 3;
  std::string target_file;
  PlaceArguments places;
  std::string criterion = "D";
  int starts = 8;
  PointNoise noise;
  std::vector<double> tracker_noise;
  Priors priors;
  std::vector<std::string> effects = {"none"};
  std::string home;
  int monte_carlo = 0;
  std::uint64_t seed = 1;
  int threads = 0;
  std::string output;
  bool decimal_comma = false;
  std::string program;
  std::string report;
  bool force = false;
  bool json = false;
};

// The planning request and the joint convention.
struct PlanSetting {
  std::optional<JointConvention> convention;
  Eigen::Isometry3d X_BW = Eigen::Isometry3d::Identity();  // where the cell is stated
  bool is_world = false;                                   // whether that is the controller's world
  PlanRequest request;

  const JointConvention* joint_convention() const { return convention ? &*convention : nullptr; }
};

}  // namespace kdl_calibration::cli
