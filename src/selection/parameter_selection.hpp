#pragma once

#include <string>
#include <vector>

#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/reduction.hpp"

namespace kdl_calibration {

/// What is estimated as far as the targets could show it.
struct ParameterSelection {
  Reduction reduction;
  std::vector<std::string> free;      ///< names, in the order of all_names
  std::vector<std::string> complete;  ///< those and every geometric error that is neither fixed nor a gauge freedom
};

/// Whether a pattern of ParameterOptions::fix leaves the term out. Patterns are about effects where they begin with
/// the name of one of their groups, else about parameters.
bool fixes_effect(const std::vector<std::string>& fix, const EffectTerm& term);

/// The irreducible or complete model with the patterns of --fix and --free and the known frames applied. `reduction`
/// says at which geometry and noise; what is fixed is added to it.
/// Throws InputError for a pattern that matches nothing and for a fixed coordinate of a frame that is not known.
ParameterSelection select_parameters(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                                     const ParameterOptions& options, ReductionOptions reduction = {});

}  // namespace kdl_calibration
