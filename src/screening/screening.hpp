#pragma once

// What is wrong with the measurements themselves, looked for by robust fits. Not installed.

#include <vector>

#include "kdl_calibration/data_quality.hpp"
#include "kdl_calibration/gross_rows.hpp"
#include "kdl_calibration/identification.hpp"

namespace kdl_calibration {

/// What is wrong with single measurements, by the distances between targets and by a preliminary robust fit from the
/// start of `problem`. Only findings stay that remain when gravity and joint gains are in the model.
std::vector<QualityFinding> screen(const FitProblem& problem);

/// See find_gross_rows. A gross row can keep effects from being selected, and their misfit then hides it: where nothing
/// is found, gravity and joint gains are put into the model and the search is repeated. Nothing beyond 2,000
/// configurations or 200 unknowns. `problem`: at its optimum.
GrossRows find_gross_rows_beside_effects(const FitProblem& problem);

}  // namespace kdl_calibration
