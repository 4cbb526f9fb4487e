#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "calibration/calibration_settings.hpp"
#include "calibration/point_predictor.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// A calibration with the settings that made it.
struct FittedCalibration {
  CalibrationSettings settings;
  CalibrationResult result;
};

/// What a Calibration holds, whether it was fitted or read from a file.
struct CalibrationParts {
  std::string robot;  ///< hash_of
  Verdict verdict = Verdict::not_trusted;
  std::vector<Doubt> doubts;  ///< with the reservation
  std::vector<std::string> warnings;
  Accuracy accuracy;
  std::vector<ParameterEstimate> parameters;
  PredictionBasis basis;
  Eigen::VectorXd urdf_errors;              ///< of the exported URDF
  std::optional<FittedCalibration> fitted;  ///< none if it was read from a file
};

/// Hash of the URDF, base and tip.
std::string hash_of(const Robot& robot);
/// Throws InputError if the calibration is one of another robot.
void require_same_robot(const Robot& robot, const Calibration& calibration);
/// The fit. Throws InputError if the calibration was read from a file, or for another robot or other measurements.
const FittedCalibration& fitted_calibration(const Robot& robot, const Measurements& measurements,
                                            const Calibration& calibration);

}  // namespace kdl_calibration
