#pragma once

#include <optional>
#include <vector>

#include "diagnosis/alternative_readings.hpp"
#include "diagnosis/ordinary_fit.hpp"

namespace kdl_calibration {

struct MistakeSearch {
  std::optional<AlternativeReading> mistake;
  /// Of each alternative of the caller's own: a doubt or a remark. None where the fit leaves no misfit.
  std::vector<AlternativeReading> own = {};
  /// Of the mistakes that were tried; of a change midway, one halfway through the rows.
  std::vector<DetectableMistake> detectable = {};
};

/// The single mistake that explains the residuals, and the sizes of the errors, best, see Explanations. Tried are
///   lengths of all stations, of one, or along one axis of W; a constant on all distances, or along the lines of sight;
///   gains of joints, and their coupling with the joint before; a stated base or target;
///   from a visit on: another base of a station, place of a target or of the tool, zero of a joint, or payload; and a
///   base that drifts.
/// A visit is a repeat of a configuration, in the order of measurement, else in that of the file. None if none is
/// significant among all trials of its kind and moves predictions in the measured ranges by more than the radius (95 %)
/// that they would have without it. If there is none beside the effects of the result, one is sought instead of them:
/// it must explain the measurements as well, for its number of unknowns. Where a single configuration explains more, it
/// is left out first. The alternatives of the caller's own are tried in the same way, each by itself; where one
/// explains more than the mistake, the mistake is dropped, else it is a remark. At most 3,000 configurations are used,
/// and 300 places of a change.
MistakeSearch likely_mistake(const FitToDoubt& fit);

}  // namespace kdl_calibration
