#pragma once

#include <map>
#include <string>
#include <vector>

#include "cli/options.hpp"
#include "cli/subcommands.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/robot.hpp"
#include "programs/compensated_program.hpp"

namespace kdl_calibration::cli {

/// compensate with --program
struct ProgramArguments {
  RobotArguments robot;
  std::string result;
  std::string program;
  std::string controller;                  ///< empty: by the links of the URDF, or that of the bundled robot
  std::string joint_convention;            ///< empty: that of the controller
  std::string frames;                      ///< may be empty
  std::vector<std::string> external_axes;  ///< such as "E1=rail"
  std::vector<std::string> near;           ///< joint values from which the program starts, or empty
  Circumstances circumstances;
  double line_tolerance;  ///< [m]
  CompensationOptions options;
  std::string output;
  std::string predict;  ///< may be empty
  std::string report;   ///< may be empty
  bool force = false;
  bool json = false;
};

/// Writes the program to command and, beside it, what became of its positions (JSON).
ExitStatus compensate_program(const ProgramArguments& arguments, const Robot& robot);

}  // namespace kdl_calibration::cli
