#pragma once

#include <string>

#include "cli/cell_options.hpp"
#include "cli/frames.hpp"
#include "cli/measurement_options.hpp"
#include "cli/simulate_arguments.hpp"

namespace kdl_calibration::cli {

/// The cell of a plan as options, "--frame base --least-height 0.2", for a comment in its file. Empty if there are
/// none, or if one holds a blank or a quotation mark.
std::string cell_note(const CellArguments& arguments);

/// The text, if it holds options of a cell alone, with values that a shell takes as they are; else empty.
std::string cell_in(const std::string& text);

/// The options in the note of a plan, from the comments before the header of this file; empty if there is no such note
/// or it holds anything else.
std::string planned_cell(const std::string& file);

/// That of the measurements' file, else that of the joint values.
std::string planned_cell_of(const MeasurementArguments& arguments);

/// That of the plan whose measurements a result was made with.
std::string planned_cell_of(const Json& result);

/// What a plan measures of its points: the directions of --directions, or kTouches.
inline constexpr const char* kTouches = "touches";
std::string places_note(const PlaceArguments& arguments);
/// From the note of a plan; empty if there is none.
std::string planned_places(const std::string& file);

}  // namespace kdl_calibration::cli
