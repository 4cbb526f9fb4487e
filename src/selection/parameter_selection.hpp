#pragma once

#include <string>
#include <vector>

#include "kdl_calibration/calibration_options.hpp"
#include "model/reduction.hpp"

namespace kdl_calibration {

/// Names of the parameters to estimate, as far as the targets can identify them.
struct ParameterSelection {
  Reduction reduction;
  std::vector<std::string> free;      ///< names, in the order of all_names
  std::vector<std::string> complete;  ///< those and every geometric error that is neither fixed nor a gauge freedom
};

/// Whether a pattern of ParameterOptions::fix excludes the term. Patterns refer to effects if they begin with a group's
/// name, else to parameters.
bool fixes_effect(const std::vector<std::string>& fix, const EffectTerm& term);

/// The irreducible or complete model with the patterns of --fix and --free and the known frames applied. `reduction`
/// states geometry and noise; fixed names are added to it.
/// Throws InputError for a pattern that matches nothing and for a fixed coordinate of a frame that is not known.
ParameterSelection select_parameters(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                                     const ParameterOptions& options, ReductionOptions reduction = {});

}  // namespace kdl_calibration
