#pragma once

// Screening of the measurements for gross errors by robust fits.

#include <vector>

#include "estimation/identification.hpp"
#include "screening/data_quality.hpp"
#include "screening/gross_rows.hpp"

namespace kdl_calibration {

/// Wrong single measurements, from distances between targets and a preliminary robust fit from the start of `problem`.
/// Keeps only findings that remain with gravity and joint gains in the model.
std::vector<QualityFinding> screen(const FitProblem& problem);

/// See find_gross_rows. A gross row can prevent the selection of effects, whose misfit then hides the row. So if none
/// is found, the search is repeated with gravity and joint gains in the model. Empty above 2,000 configurations or 200
/// unknowns. `problem`: at its optimum.
GrossRows find_gross_rows_beside_effects(const FitProblem& problem);

}  // namespace kdl_calibration
