#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "kdl_calibration/compensation.hpp"
#include "programs/point_compensation.hpp"
#include "programs/program.hpp"

namespace kdl_calibration {

/// A straight line between two points that the tool leaves on its way.
struct PathDeviation {
  std::string source;
  std::size_t line = 0;
  std::string from;  ///< names of points
  std::string to;
  LineDeviation deviation;  ///< largest; infinite where the line cannot be followed
};

/// [m] About the accuracy of a calibrated arm: less would not show.
inline constexpr double kLineTolerance = 1e-4;

struct CompensatedProgram {
  std::vector<std::string> texts;              ///< one for each text of the program
  std::vector<CompensatedPosition> positions;  ///< in the order of Program::points
  double rounding = 0.0;                       ///< [m] largest displacement of the flange by rounding
  std::size_t lines = 0;                       ///< straight lines that were tried
  LineDeviation largest_deviation;             ///< of these
  std::vector<PathDeviation> paths;   ///< those with a deviation of position above the tolerance, largest first
  std::vector<std::string> warnings;  ///< what the controller decides at run time, with the lines
};

/// A program with points at which the calibrated arm is where the nominal one would be. Of each point only the numbers
/// of the arm change. The compensator holds the joints that are external axes. `near`: joint values of the URDF from
/// which the first motion starts, for programs whose poses do not say how the arm reaches them; may be empty.
/// `line_tolerance` [m]: see CompensatedProgram::paths. Throws
/// InputError as ProgramLanguage::parse does, for a chain whose joints before the six of the arm are not all external
/// axes, for a point without the value of one, and for a pose whose frames are not known, that no or several joint
/// values reach in its branch, or that has another external axis.
CompensatedProgram compensated_program(const ProgramSetup& setup, const std::vector<ProgramText>& texts,
                                       const CompensatedJoints& near = {}, double line_tolerance = kLineTolerance);

}  // namespace kdl_calibration
