#pragma once

// The block `effects` of the result: motions of joints beyond the geometry, complete enough for programs
// to apply them.

#include <nlohmann/json.hpp>
#include <span>
#include <vector>

#include "base/json_tree.hpp"
#include "calibration/calibration_result.hpp"

namespace kdl_calibration {

nlohmann::ordered_json effects_json(const CalibrationResult& calibration, const Measurements& measurements);

struct SavedEffects {
  std::vector<EffectTerm> terms;
  Eigen::VectorXd values;
  std::vector<double> degrees_of_freedom;  ///< infinite where the file states none
  KDL::Vector gravity = KDL::Vector(0.0, 0.0, -1.0);
  Circumstances circumstances;
};
/// `own`: the functions of effects that are not kdlcal's. Throws InputError if a term does not fit this robot, or is of
/// another function.
SavedEffects read_effects(const tree::Node& block, const ErrorModel& model, std::span<const OwnEffect> own = {});

}  // namespace kdl_calibration
