#pragma once

#include <vector>

#include "diagnosis/explanations.hpp"
#include "diagnosis/mistake_trial.hpp"
#include "diagnosis/ordinary_fit.hpp"

namespace kdl_calibration {

/// Adds what may have changed from a visit on, by kind, drifting bases, and single configurations beside them. The
/// trials keep a reference to the fit.
void try_changes(const OrdinaryFit& fit, const Explanations& explanations, std::vector<MistakeFamily>& families);

}  // namespace kdl_calibration
