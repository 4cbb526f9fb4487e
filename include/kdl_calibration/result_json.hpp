#pragma once

#include <string>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// The result as JSON (see the README): SI units, full precision.
std::string result_json(const Robot& robot, const Measurements& measurements, const CalibrationOptions& options,
                        const Calibration& calibration);

/// The irreducible model as JSON: parameters, dropped, gauge, candidates, rank.
std::string model_json(const ErrorModel& model, const std::vector<TargetFrame>& targets, const Reduction& reduction);

}  // namespace kdl_calibration
