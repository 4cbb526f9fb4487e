#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "cli/options.hpp"
#include "planning/simulation.hpp"

namespace kdl_calibration::cli {

/// --stations, --sockets, --plate-horizontal, --plate-heights, --directions
struct PlaceArguments {
  int stations = 1;
  std::string sockets;
  bool plate_horizontal = false;
  std::string plate_heights;  ///< "lowest:highest" of its frame [m] in the base frame
  std::string directions = "xyz";
};

struct SimulateArguments {
  RobotArguments robot;
  int configurations = 30;
  int test_configurations = 0;
  std::string plan;
  bool touches_of_plan = false;  ///< whether `plan` has the sockets of a plate
  std::string joint_convention;
  int targets = 3;
  std::string target_file;
  bool poses = false;
  PlaceArguments places;
  MeasuringNoise noise;
  ErrorSizes sizes;
  std::optional<double> angle_sigma_deg;
  std::vector<std::string> effects = {"none"};
  double effect_sigma = 3e-4;
  std::string model = "irreducible";
  std::vector<std::string> joint_ranges = {"limits"};
  int monte_carlo = 0;
  std::string run_range;
  std::string runs;
  int two_step = 0;  // rounds
  bool recorded = false;
  bool order = false;
  int threads = 0;
  std::uint64_t seed = 1;
  std::string output;
  std::string truth;
  std::string report;
  bool force = false;
  bool json = false;
};

}  // namespace kdl_calibration::cli
