#pragma once

#include <string>

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
  std::string output;
  bool force = false;
  bool json = false;
};

/// Writes the program to command and, beside it, what became of its positions (JSON).
ExitStatus compensate_program(const ProgramArguments& arguments, const Robot& robot, const Compensator& compensator);

}  // namespace kdl_calibration::cli
