#pragma once

#include <vector>

#include "diagnosis/explanations.hpp"
#include "diagnosis/mistake_trial.hpp"
#include "diagnosis/ordinary_fit.hpp"

namespace kdl_calibration {

// Mistakes that are the same in all rows that they concern. Each function adds families of trials, which keep a
// reference to the fit.

/// Factors on the lengths of all stations, of one, and along one axis of W.
void try_lengths(const OrdinaryFit& fit, const Explanations& explanations, std::vector<MistakeFamily>& families);
/// A constant on all distances, or along the lines of sight.
void try_constants(const OrdinaryFit& fit, const Explanations& explanations, std::vector<MistakeFamily>& families);
/// Gains of joints, and their coupling with the joint before.
void try_joints(const OrdinaryFit& fit, const Explanations& explanations, std::vector<MistakeFamily>& families);
/// Stated bases and targets that are elsewhere.
void try_stated_frames(const OrdinaryFit& fit, const Explanations& explanations, std::vector<MistakeFamily>& families);

}  // namespace kdl_calibration
