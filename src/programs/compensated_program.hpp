#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/robot.hpp"
#include "programs/controller.hpp"

namespace kdl_calibration {

/// What became of P[number].
struct CompensatedPosition {
  int number = 0;
  CompensationStatus status = CompensationStatus::unreachable;
  Eigen::Matrix<double, 6, 1> change;  ///< of J1 to J6 [rad]
  double position_error = 0.0;         ///< [m] that the calibrated flange is off with what was written
  double orientation_error = 0.0;      ///< [rad]
  bool written = false;                ///< else the position is as it was, because it cannot be reached as it should
};

/// A straight or circular segment on which the controller's path is off.
struct PathDeviation {
  std::size_t line = 0;
  int from = 0;
  int to = 0;
  double deviation = 0.0;  ///< [m] largest; infinite where the path cannot be followed
};

struct CompensatedProgram {
  std::string text;
  std::vector<CompensatedPosition> positions;
  double rounding = 0.0;              ///< [m] largest displacement of the flange by rounding to 0.001 mm and degrees
  std::vector<PathDeviation> paths;   ///< above 0.1 mm, largest first
  std::vector<std::string> warnings;  ///< what the controller decides at run time, with the lines
};

/// A FANUC program (LS) with positions at which the calibrated arm is where the nominal one would be. Of each position
/// only the numbers of the arm in group 1 change; increments (INC) stay as they are. The compensator holds the joints
/// that are external axes. Throws InputError as parse_ls_program does, for a chain whose joints before the six of the
/// arm are not all external axes, for a position without the value of one, and for a Cartesian position whose frames
/// are not known, that no or several joint values reach with its CONFIG, or that has another external axis.
CompensatedProgram compensated_program(const Robot& robot, const Compensator& compensator, const Controller& controller,
                                       std::string_view text, const std::string& source);

}  // namespace kdl_calibration
