#pragma once

#include <map>
#include <string>
#include <vector>

#include "cli/subcommands.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration::cli {

/// compensate with --program
struct ProgramArguments {
  std::string result;
  std::string program;
  std::string controller;  ///< empty: that of the bundled robot
  std::string frames;      ///< may be empty
  std::map<int, std::string> external_axes;
  std::string output;
  bool force = false;
  bool json = false;
};

/// Joints of the robot by the number of an external axis, from texts such as "E1=rail". Throws InputError for others.
std::map<int, std::string> external_axes_of(const std::vector<std::string>& texts, const Robot& robot);

/// Writes the program to command and, beside it, what became of its positions (JSON).
ExitStatus compensate_program(const ProgramArguments& arguments, const Robot& robot, const Compensator& compensator);

}  // namespace kdl_calibration::cli
