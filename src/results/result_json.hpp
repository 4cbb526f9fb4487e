#pragma once

#include <string>
#include <utility>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "kdl_calibration/robot.hpp"
#include "model/reduction.hpp"

namespace kdl_calibration {

/// A file, and the SHA-256 of its bytes in hexadecimal digits.
struct HashedFile {
  std::string role;  ///< "measurements", "joint_convention", "output", …
  std::string path;
  std::string sha256;
};

/// Origin of a result, stated by the caller.
struct Provenance {
  std::vector<std::pair<std::string, std::string>> notes;    ///< free text: serial number, payload, …
  std::vector<std::pair<std::string, std::string>> options;  ///< of kdlcal: how the measurements were read
  std::string planned_cell;                                  ///< options of the plan that was measured
  std::vector<HashedFile> files_read;
  std::vector<HashedFile> files_written;
};

/// The result as JSON (see src/cli/README.md): SI units, full precision.
std::string result_json(const Robot& robot, const Measurements& measurements, const CalibrationResult& calibration,
                        const Provenance& provenance = {});

/// Measured minus predicted point of every row in W, [m], as CSV.
std::string residuals_csv(const Measurements& measurements, const CalibrationResult& calibration);
/// The covariance of all estimated unknowns, SI units, as CSV with their names; cells are empty if not determined.
std::string covariance_csv(const CalibrationResult& calibration);

/// The JSON block `effects` of a result or a truth file: the model's terms with these coefficients.
std::string effects_json(const ErrorModel& model, const Eigen::VectorXd& coefficients);

/// The irreducible model as JSON: parameters, dropped, gauge, candidates, rank.
std::string model_json(const ErrorModel& model, const std::vector<TargetFrame>& targets, const Reduction& reduction);

}  // namespace kdl_calibration
